"""How much of a disturbance reaches the output: the L₂ gain of a closed loop (Theorem 3.2.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import simpson

from phcontrol._validation import Array, count, positive
from phcontrol.analysis.certify import require_certificate
from phcontrol.controllers.controller import Controller
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import Measured
from phcontrol.simulation.log import Log

TOLERANCE = 1e-9


@dataclass(frozen=True)
class GainBound:
    """A bound on the L₂ gain from f_e to ŷ = portᵀ∇H_d, and how it held at random states."""

    bound: float
    """γ [rad/s per N·m]: ∫|ŷ|² ≤ γ²∫|f_e|² for every run that starts at rest at the goal."""
    storage_scale: float
    """W = storage_scale · H_d solves the Hamilton–Jacobi inequality."""
    largest_residual: float
    """Largest left-hand side of the Hamilton–Jacobi inequality (2.44), over its terms; must not be positive."""
    samples: int

    @property
    def passed(self) -> bool:
        """Whether the inequality held at every sampled state."""
        return self.largest_residual <= TOLERANCE


def l2_gain(controller: Controller, system: MechanicalSystem, *, samples: int = 50, seed: int = 0) -> GainBound:
    """Bound the L₂ gain from the external force to ŷ = T⁻ᵀp̂ (for G = I), and check it at random states.

    Along the closed loop Ḣ_d = −q̇ᵀDq̇ − ŷᵀCŷ + ŷᵀf_e, so the gain is at most γ = 1/λ_min(C), with
    W = H_d/λ_min(C) (Theorem 3.2.2; the conditions printed there are replaced: errata E24). Friction
    never helps: at rest, and in directions in which z moves and the arm does not, it takes nothing.

    The check evaluates (2.44), ∂Wᵀẋ₀ + |portᵀ∂W|²/(2γ²) + ½|ŷ|² ≤ 0, with ẋ₀ = (J_d − R_d)∇H_d.

    The bound is one of the promise: the law must have its certificate on this system first.

    Raises InvalidArgumentError for a law to which the theorem does not apply: one without ``injected_damping``, one
    that feeds the measured force back (its port is another), a system with an input matrix. Raises PHControlError
    for a law that is not what it promises.
    """
    count("samples", samples)
    damping = controller.injected_damping
    if damping is None:
        raise InvalidArgumentError("controller", f"{controller.name} injects no damping matrix C")
    if controller.needs:
        raise InvalidArgumentError(
            "controller",
            f"{controller.name} feeds back {', '.join(controller.needs)}; the theorem is for modeled forces",
        )
    if system.input_matrix is not None:
        raise InvalidArgumentError("system", "the bound is for G = I")
    require_certificate(controller, system, "the bound of the L₂ gain")
    smallest = float(np.linalg.eigvalsh(damping)[0])
    bound, scale = 1.0 / smallest, 1.0 / smallest
    generator, worst = np.random.default_rng(seed), -np.inf
    for _ in range(samples):
        x = system.at(system.robot.random_position(generator), generator.normal(size=system.n))
        state = controller.random_state(generator)
        target = controller.target(0.0, x, state, Measured())
        output = target.port.T @ target.gradient
        terms = (
            scale * float(target.gradient @ target.rate(np.zeros(system.n))),
            0.5 * scale**2 / bound**2 * float(output @ output),
            0.5 * float(output @ output),
        )
        worst = max(worst, sum(terms) / max(abs(term) for term in terms))
    return GainBound(bound, scale, worst, samples)


def damping_for_gain(gain: float, n: int) -> Array:
    """Return the injected damping C = 1₍ₙ₎/γ [N·m·s/rad] that keeps the L₂ gain below ``gain`` γ."""
    result: Array = np.eye(n) / positive("gain", gain)
    return result


def measured_l2_gain(log: Log) -> float:
    """Return sqrt(∫|ŷ|²dt / ∫|f_e|²dt) of a run that started without stored energy.

    ŷ is the output conjugate to f_e, ``Log.force_output``. Raises PHControlError when there was no
    force, or when H_d was not zero at the start (what was stored then would be counted as gain).
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
