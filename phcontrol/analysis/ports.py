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
from phcontrol.mechanics.system import MechanicalSystem

_STATES = 4  # of which many questions are asked
_MANY = 64  # of which one is
_MOVING, _CREEPING = 0.05, 1e-3  # [rad/s], the last where outputs are compared, not differentiated
_LITTLE = 1e-4  # of a second, over which H_d is differentiated along a change of the state


def port_error(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> Worst:
    """Return how far the output that goes with f_e is from one that moves with q̇, or from none.

    Power enters through f_e at the arm's own velocity. So y = portᵀ∇H_d is q̇ plus what does not depend on it, or 0
    where the law cancels f_e: ∂y/∂q̇ is 1 or 0. Passive from f_e to anything else is no passivity in contact.
    """
    return _worst(_port_error, law, plant, states)


def passive_port_error(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> Worst:
    """Return how far ``passive_port`` is from what target and storage function say, relative to its own terms."""
    return _worst(_passive_port_error, law, plant, states, _MANY, _CREEPING)


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
    law, at, errors = seen.law, seen.at, [0.0]
    if law.active(at.time) is not law:
        return 0.0
    given = law.passive_port(at.time, seen.view, at.state, seen.measured)
    derived = Controller.passive_port(law, at.time, seen.view, at.state, seen.measured)
    # where p̂ = 0, as on a straight way in that an integral leads, output and resistance are rounding
    speed = float(np.abs(at.velocity - reference_velocity(law, at.time, at.position)).max())
    least = (1e-9 * speed, 0.0, 1e-9 * derived.dissipated_power / speed)  # of output, power and resistance
    for own, true, floor in zip(given, derived, least, strict=True):
        expected = np.asarray(true, dtype=float)
        scale = max(float(np.abs(expected).max()), floor, 1e-300)
        errors.append(float(np.abs(np.asarray(own, dtype=float) - expected).max()) / scale)
    return float(np.max(errors))


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
