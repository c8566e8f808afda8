"""How much of a disturbance reaches the output: the L₂ gain of a closed loop (Theorem 3.2.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import simpson

from phcontrol._validation import Array, count, matrix, positive
from phcontrol.analysis.certificate import MATCHING_TOLERANCE
from phcontrol.analysis.certify import require_certificate
from phcontrol.analysis.flow import Flow
from phcontrol.analysis.linearization import linearize
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.promise import Promise
from phcontrol.analysis.rest_point import find_rest
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.analysis.state_sampler import StateSampler
from phcontrol.controllers.controller import Controller
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.mechanics.friction import DeclaredFriction
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.simulation.log import Log

TOLERANCE = MATCHING_TOLERANCE
"""Of the terms of the inequality, whose first is a finite difference."""
_EXACT = 1e-9  # of a gain that a matrix gives
_NORM_TOLERANCE = 1e-5  # of the H∞ norm: the loop is linearised by finite differences
_ROUNDING = 1e-6  # of the largest terms anywhere, below which those of a state are rounding
_REACHED = 1e-9  # of a port, by which R_d may miss it


@dataclass(frozen=True)
class GainBound:
    """A bound on the L₂ gain from f_e to y = portᵀ∇H_d, and how the true closed loop kept to it.

    Example:
        >>> from phcontrol import EnergyShaping, MechanicalSystem, l2_gain, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> found = l2_gain(EnergyShaping.tuned(system), system, samples=4)
        >>> found.linear_norm <= found.bound
        True
    """

    bound: float
    """γ [rad/s per N·m]: ∫|y|² ≤ γ²∫|f_e|² for every run that starts at rest at the goal."""
    storage_scale: float
    """W = storage_scale · H_d solves the Hamilton–Jacobi inequality."""
    source: str
    """What the bound comes from: "injected damping" or "viscous friction", which hold in every state, or "samples"."""
    largest_residual: float
    """Largest left-hand side of the Hamilton–Jacobi inequality (2.44), over its terms, along the true motion; must not
    be positive."""
    linear_norm: float
    """H∞ norm of the true closed loop about its rest, which γ must not be below; NaN for a law that changes with
    time."""
    samples: int

    @property
    def passed(self) -> bool:
        """Whether the inequality held at every sampled state, and for the linear loop at every frequency."""
        below = self.linear_norm > self.bound * (1.0 + _NORM_TOLERANCE)
        return self.largest_residual <= TOLERANCE and not below


def l2_gain(controller: Controller, system: MechanicalSystem, *, samples: int = 50, seed: int = 0) -> GainBound:
    """Bound the L₂ gain from the external force to the output y = portᵀ∇H_d that goes with it.

    Along the closed loop Ḣ_d = −∇H_dᵀR_d∇H_d + yᵀf_e. Where R_d ⪰ λ·port·portᵀ in every state the gain is at most
    γ = 1/λ, with W = H_d/λ (Theorem 3.2.2 for any law; the conditions printed there are replaced: errata E24).

    - A law of modeled forces with injected damping C has y = T⁻ᵀp̂ and λ = λ_min(GCGᵀ). Friction never helps force
      feedback: in directions in which z moves and the arm does not, it takes nothing.
    - One that feeds the measured f_e back (``measured``) has y = q̇, for which C does nothing where z moves with the
      arm: λ is the least viscous friction, and without friction there is no bound.
    - A law that cancels f_e has no port and the gain 0.
    - Elsewhere λ is the least of the sampled states, which is no proof.

    Two checks look at the true motion and not at the promise: (2.44), ∂Wᵀẋ + |y|²(½ + ½) ≤ 0 with W = H_d/λ along it,
    and the H∞ norm of the loop linearised about its rest, which is a gain that small forces reach.

    Raises InvalidArgumentError for a law that is driven by something else or changes hands (``Schedule``),
    PHControlError for a law without a certificate on this system, and for one without a finite gain.

    Example:
        >>> from phcontrol import EnergyShaping, MechanicalSystem, l2_gain, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> found = l2_gain(EnergyShaping(system, goal=[0.0, 0.0], stiffness=20.0, damping=5.0), system, samples=4)
        >>> round(found.bound, 3)  # 1/5 for C = 5 N·m·s/rad [rad/s per N·m]
        0.2
    """
    count("samples", samples)
    if controller.driven_by or len(controller.phases) > 1:
        why = f"is driven by {controller.driven_by}" if controller.driven_by else "changes hands"
        raise InvalidArgumentError("controller", f"{controller.name} {why}: no storage function bounds its gain")
    require_certificate(controller, system, "the bound of the L₂ gain")
    states = _states(controller, system, samples, seed)
    gains = [_gain(Seen.of(controller, system, at).promise()) for at in states]
    bound, source = _bound(controller, system, max(gains))
    if not math.isfinite(bound):
        place = states[int(np.argmax(gains))].position
        raise PHControlError(
            f"{controller.name} has no finite L₂ gain on {system.robot.name}: at q = {place} f_e moves what neither "
            "damping nor friction takes energy from"
        )
    sides = np.array([_sides(controller, system, at, bound) for at in states])
    unit = np.maximum(sides[:, 1], _ROUNDING * sides[:, 1].max())
    residual = float((sides[:, 0] / np.where(unit > 0.0, unit, 1.0)).max())
    norm = math.nan if controller.time_span else linearize(controller, system, exact=False).norm
    return GainBound(bound, bound, source, residual, norm, samples)


def _states(controller: Controller, system: MechanicalSystem, samples: int, seed: int) -> list[SampledState]:
    """Return states as a certificate draws them, without an external force."""
    units = NaturalUnits.of(controller, system, 0.0)
    rest = find_rest(controller, system, units, 0.0)
    sampler = StateSampler(controller, system, units, (rest.position, rest.velocity, rest.state), rest.force)
    return [at._replace(force=np.zeros(system.n)) for at in sampler.draw(samples, seed)]


def _gain(target: Promise) -> float:
    """Return 1/λ with the largest λ for which R − λ·port·portᵀ ⪰ 0: the largest eigenvalue of portᵀR⁺port."""
    size = np.sqrt(np.maximum(np.diag(target.R), 0.0))
    live = size > 0.0
    if np.abs(target.port[~live]).max(initial=0.0) > 0.0:
        return math.inf
    if not live.any():
        return 0.0
    port = target.port[live] / size[live, None]
    values, vectors = np.linalg.eigh(target.R[np.ix_(live, live)] / np.outer(size[live], size[live]))
    kept = values > 1e-12
    seen, missed = vectors[:, kept].T @ port, vectors[:, ~kept].T @ port
    if np.abs(missed).max(initial=0.0) > _REACHED * np.abs(port).max(initial=0.0):
        return math.inf
    return float(np.linalg.eigvalsh(seen.T @ (seen / values[kept, None]))[-1])


def _bound(controller: Controller, system: MechanicalSystem, largest: float) -> tuple[float, str]:
    """Return γ and what it comes from: a damping that is the same in every state, where that explains all of them."""
    constant: dict[str, float] = {}
    if system.varying_input is not None:
        return largest, "samples"
    if controller.injected_damping is not None:
        G = np.eye(system.n) if system.constant_input is None else system.constant_input
        constant["injected damping"] = float(np.linalg.eigvalsh(G @ controller.injected_damping @ G.T)[0])
    if isinstance(system.friction, DeclaredFriction):
        constant["viscous friction"] = float(np.min(system.friction.viscous))
    for source, least in constant.items():
        if least > 0.0 and 0.0 < largest <= (1.0 + _EXACT) / least:
            return 1.0 / least, source
    return largest, "samples"


def _sides(controller: Controller, system: MechanicalSystem, at: SampledState, bound: float) -> tuple[float, float]:
    """Return the left-hand side of (2.44), the rate of H_d taken along the true motion, and the size of its terms."""
    flow = Flow(controller, system, at)
    target = flow.start.promise()
    output = target.port.T @ target.gradient
    squared = float(output @ output)
    powers = bound * float(np.abs(target.gradient) @ np.abs(target.rate(at.force)))
    return bound * float(flow.derivative(flow.storage)) + squared, max(powers, squared)


def damping_for_gain(gain: float, n: int, *, input_matrix: ArrayLike | None = None) -> Array:
    """Return the injected damping C = G⁻¹G⁻ᵀ/γ [N·m·s/rad] that keeps the L₂ gain below ``gain`` γ: GCGᵀ = 1/γ.

    Args:
        gain: γ [rad/s per N·m].
        n: number of joints.
        input_matrix: G, (n, n); the identity if not given.

    Example:
        >>> from phcontrol import damping_for_gain
        >>> damping_for_gain(0.5, 2)  # γ [rad/s per N·m], joints
        array([[2., 0.],
               [0., 2.]])
    """
    inverse = np.eye(n) if input_matrix is None else np.linalg.inv(matrix("input_matrix", input_matrix, n))
    result: Array = inverse @ inverse.T / positive("gain", gain)
    return result


def measured_l2_gain(log: Log) -> float:
    """Return sqrt(∫|ŷ|²dt / ∫|f_e|²dt) of a run that started without stored energy.

    ŷ is the output conjugate to f_e, ``Log.force_output``. Raises PHControlError when there was no
    force, or when H_d was not zero at the start (what was stored then would be counted as gain).

    Example:
        >>> from phcontrol import EnergyShaping, MechanicalSystem, Sine, load_robot, measured_l2_gain, simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = EnergyShaping(system, goal=[0.0, 0.0], stiffness=20.0, damping=5.0)
        >>> log = simulate(system, law, duration=2.0, dt=2e-3, q0=[0.0, 0.0], disturbance=Sine([1.0, 0.5], 1.0))
        >>> measured_l2_gain(log) <= 0.2  # 1/5, what l2_gain promises
        True
    """
    supplied = float(simpson(np.sum(log.external_force**2, axis=1), x=log.time))
    if supplied <= 0.0:
        raise PHControlError("the run has no external force, so it has no gain")
    if log.storage[0] > 1e-9 * max(1.0, float(log.storage.max())):
        raise PHControlError(
            f"the run must start at the goal at rest, but its storage function starts at {log.storage[0]:g} J"
        )
    returned = float(simpson(np.sum(log.force_output**2, axis=1), x=log.time))
    return float(np.sqrt(returned / supplied))
