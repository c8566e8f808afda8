"""What others trust of a law: the output that goes with f_e, the passive port, the calmest state."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.analysis.state_sampler import reference_velocity, some
from phcontrol.analysis.thin_states import SLIDING
from phcontrol.analysis.worst import Worst
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.target import MOMENTUM
from phcontrol.mechanics.system import MechanicalSystem

_STATES = 4  # of which many questions are asked
_MANY = 64  # of which one is
_MOVING, _CREEPING = 0.05, 1e-3  # [rad/s], the last where outputs are compared, not differentiated
_LITTLE = 1e-4  # of a second, over which H_d is differentiated along a change of the state
_FASTER = 1e-3  # by how much velocities differ that the passive port is differentiated between [rad/s]


def port_error(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> Worst:
    """Return how far the output that goes with f_e is from one that moves with q̇, or from none.

    Power enters through f_e at the arm's own velocity. So y = portᵀ∇H_d is q̇ plus what does not depend on it, or 0
    where the law cancels f_e: ∂y/∂q̇ is 1 or 0. Passive from f_e to anything else is no passivity in contact.
    """
    return _worst(_port_error, law, plant, states)


def passive_port_error(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> Worst:
    """Return how far ``passive_port`` is from what target and storage function say, relative to its own terms."""
    return _worst(_passive_port_error, law, plant, states, _MANY, _CREEPING)


def claimed_damping(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> Worst:
    """Return by how much more a law says that it damps than its target dissipates, relative to that, and where.

    What it says is ``joint_damping`` and ``injected_damping``, by v̂ᵀG C Gᵀv̂ with v̂ = T⁻ᵀ∂H_d/∂p̂. Of a law with a tank
    a part of that goes into the tank.
    """
    return _worst(_claimed_damping, law, plant, states, _MANY, _CREEPING)


def calming_gain(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> Worst:
    """Return by how much moving to ``calmest_state`` raises H_d, relative to H_d; it must not, at rest neither."""
    if not law.state_size:
        return Worst(0.0, "")
    return Worst.of((_calming_gain(Seen.of(law, plant, at)), at.stratum) for at in some(states, _MANY, plant.n))


def jumping_gain(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> Worst:
    """Return by how much ``jump`` raises H_d, relative to H_d, and of a law that does not say it ``jumps``, any change.

    A state that jumps is energy that nobody supplied.
    """
    if not law.state_size:
        return Worst(0.0, "")
    return Worst.of((_jumping_gain(Seen.of(law, plant, at)), at.stratum) for at in states)


def limited_gain(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> Worst:
    """Return by how much ``rate_under_limits`` makes H_d grow beside the law's own rate, relative to H_d, and where.

    Without a change of the torque the rate is the law's own; with one it may take energy out of the law's state
    (a tank pays), and puts none in.
    """
    if not law.state_size:
        return Worst(0.0, "")
    generator = np.random.default_rng(0)

    def gain(at: SampledState) -> float:
        seen = Seen.of(law, plant, at)
        rate = np.array(seen.command().state_rate)
        change = generator.uniform(-1.0, 1.0, plant.n) * np.abs(seen.command().torque).max(initial=1.0)
        asked = at.time, seen.view, at.state, rate
        unchanged = law.rate_under_limits(*asked, np.zeros(plant.n), seen.measured)
        more = law.rate_under_limits(*asked, change, seen.measured) - rate
        if not np.array_equal(unchanged, rate):
            return np.inf
        if not more.any():
            return 0.0
        ahead, behind = (seen.elsewhere(state=at.state + side * _LITTLE * more).stored() for side in (1.0, -1.0))
        return (ahead - behind) / (2.0 * _LITTLE) / max(abs(seen.stored()), 1e-300)

    return Worst.of((gain(at), at.stratum) for at in some(states, _MANY, plant.n))


def starting_gain(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState], usual: float) -> Worst:
    """Return by how much H_d is higher with the law's initial state than with a state of 0, over what it usually is.

    The law may start anywhere: what it starts with must not be energy that nobody supplied.
    """
    if not law.state_size:
        return Worst(0.0, "")
    figures = []
    for at in some(states, _MANY, plant.n):
        seen = Seen.of(law, plant, at)
        nothing = seen.elsewhere(state=np.zeros(law.state_size)).stored()
        started = seen.elsewhere(state=law.initial_state(seen.view)).stored()
        figures.append(((started - nothing) / max(usual, abs(nothing), 1e-300), at.stratum))
    return Worst.of(figures)


def _worst(
    figure: Callable[[Seen], float],
    law: Controller,
    plant: MechanicalSystem,
    states: Sequence[SampledState],
    count: int = _STATES,
    speed: float = _MOVING,
) -> Worst:
    """Return the largest figure at a few states in which the arm moves away from its reference, and where.

    Not where p̂ = 0: relative to outputs of 0 all is rounding.
    """
    moving = [
        at
        for at in states
        if at.stratum != SLIDING and np.abs(at.velocity - reference_velocity(law, at.time, at.position)).max() > speed
    ]
    return Worst.of((figure(Seen.of(law, plant, at)), at.stratum) for at in some(moving, count, law.system.n))


def _port_error(seen: Seen) -> float:
    velocity, slopes, one = seen.at.velocity, [], np.eye(len(seen.at.velocity))
    for axis in one:  # y is affine in q̇ where ports do not depend on it
        ahead = seen.elsewhere(velocity=velocity + axis).promise()
        behind = seen.elsewhere(velocity=velocity - axis).promise()
        slopes.append(0.5 * (ahead.port.T @ ahead.gradient - behind.port.T @ behind.gradient))
    slope = np.stack(slopes, axis=-1)
    return float(min(np.abs(slope - one).max(), np.abs(slope).max()))


def _passive_port_error(seen: Seen) -> float:
    """Return how far power, output and resistance are from their definitions, the last two along some direction.

    A torque d is the acceleration a = M⁻¹G d, and the output ŷᵀd = ∇H_dᵀ(∂x/∂q̇)a. The force along a is
    (∂∇H_d/∂q̇ a)ᵀR_d∇H_d. Coordinates may depend on q̇ in any way.
    """
    law, at = seen.law, seen.at
    if law.active(at.time) is not law:
        return 0.0
    given = law.passive_port(at.time, seen.view, at.state, seen.measured)
    target, y = seen.target(), law.promised_state(seen.view)
    losses = target.dissipation @ target.gradient
    torque = np.cos(7.0 * (at.position + at.velocity) + np.arange(len(at.velocity)))
    acceleration = np.linalg.solve(y.mass_matrix, y.input_matrix @ torque)
    step = _FASTER / float(np.abs(acceleration).max())
    ahead, behind = (seen.elsewhere(velocity=at.velocity + side * step * acceleration).target() for side in (1.0, -1.0))
    gains = target.gradient * (ahead.coordinates - behind.coordinates) / (2.0 * step)
    takes = losses * (ahead.gradient - behind.gradient) / (2.0 * step)
    # where p̂ = 0, as on a straight way in that an integral leads, output and resistance are rounding
    speed = float(np.abs(at.velocity - reference_velocity(law, at.time, at.position)).max())
    power = float(target.gradient @ losses)
    errors = [abs(given.dissipated_power - power) / max(abs(power), 1e-300)]
    for own, along, terms, least in (
        (given.output, torque, gains, 1e-9 * speed),
        (given.resistance, acceleration, takes, 1e-9 * power / speed),
    ):
        products = np.asarray(own, dtype=float) * along
        scale = max(float(np.abs(products).sum() + np.abs(terms).sum()), least * float(np.abs(along).sum()), 1e-300)
        errors.append(abs(float(products.sum() - terms.sum())) / scale)
    return float(np.max(errors))


def _claimed_damping(seen: Seen) -> float:
    law, at = seen.law, seen.at
    if law.active(at.time) is not law or law.tank_level(at.state) is not None:
        return 0.0
    injected, damping = law.injected_damping, law.joint_damping(at.time, seen.view)
    if injected is None and damping is None:
        return 0.0
    target, y = seen.target(), law.promised_state(seen.view)
    dissipated = float(target.gradient @ target.dissipation @ target.gradient)
    velocity = y.solve_factor_transposed(target.gradient[target.parts[MOMENTUM]])
    output = y.input_matrix.T @ velocity
    claims = [float(v @ C @ v) for v, C in ((output, injected), (velocity, damping)) if C is not None]
    return max(0.0, *(claim - dissipated for claim in claims)) / max(*claims, 1e-300)


def _calming_gain(seen: Seen) -> float:
    calmest = seen.law.calmest_state(seen.at.time, seen.view, seen.at.state)
    before, after = seen.stored(), seen.elsewhere(state=calmest).stored()
    return (after - before) / max(abs(before), abs(after), 1e-300)


def _jumping_gain(seen: Seen) -> float:
    law, at = seen.law, seen.at
    after = law.jump(at.time, seen.view, at.state, seen.measured)
    if np.array_equal(after, at.state):
        return 0.0
    if not law.jumps:
        return np.inf
    before = seen.stored()
    return (seen.elsewhere(state=after).stored() - before) / max(abs(before), 1e-300)
