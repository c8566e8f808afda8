"""How far Theorem 4.1.1's proof of force control reaches: its ε over a box of states."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigh

from phcontrol._validation import Array, count, positive, vector
from phcontrol.analysis.certify import require_certificate
from phcontrol.controllers.force_control import ForceControl
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem


@dataclass(frozen=True)
class ForceConditions:
    """For which ε > 0 the function H_ε = ½|p̂|² + ½wᵀK_z⁻¹w + εp̂ᵀw is a Lyapunov function of (4.17) at every sample.

    Example:
        >>> from phcontrol import MechanicalSystem, force_control_conditions, load_robot, make_controller
        >>> gripper = MechanicalSystem(load_robot("pera_gripper"))
        >>> found = force_control_conditions(make_controller("force_control", gripper), gripper, samples=1)
        >>> found.passed, found.samples
        (True, 1)
    """

    positive: float
    """H_ε > 0 for ε below this: 1/sqrt(λ_max(K_z)). The thesis's (4.13) has κ₁ = λ_min(K_z) in its place."""
    decreasing: float
    """Ḣ_ε < 0 along (4.17) at every sampled state for ε below this; 0 where friction is missing in some joint."""
    printed: tuple[float, float, float]
    """The right-hand sides of (4.13), (4.14), (4.15) as printed, from the bounds over the sampled states."""
    samples: int

    @property
    def largest(self) -> float:
        """The largest ε of the proof, without the slack of the printed conditions."""
        return min(self.positive, self.decreasing)

    @property
    def passed(self) -> bool:
        """Whether there is such an ε."""
        return self.largest > 0.0


def force_control_conditions(
    controller: ForceControl,
    system: MechanicalSystem,
    *,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    speed: float = 1.0,
    samples: int = 200,
    seed: int = 0,
) -> ForceConditions:
    """Compute the conditions (4.13) to (4.15) of Theorem 4.1.1 over a box of configurations.

    The theorem looks at the rows of p̂ and w of the closed loop (4.17) with f_e and f_d taken out,

        p̂̇ = (J̄₂ − D̄ − ḠCḠᵀ)p̂ + (J̄₂ − D̄)Aw,   ẇ = −Yᵀ(J̄₂ᵀ + D̄)(p̂ + Aw),

    and bounds Ḣ_ε by norms. Here Ḣ_ε = −½[p̂; w]ᵀQ(ε)[p̂; w] is taken as it is: Q(ε) = Q₀ + εQ₁ at each sampled
    state, whose largest ε with Q(ε) > 0 is one generalised eigenvalue. The printed conditions are computed beside it;
    they are neither necessary nor sufficient: (4.14) bounds ε from the wrong side (errata E25).

    Args:
        controller: the law of force control.
        system: the model of the arm.
        lower: corner of the box of positions [rad]; the joints' limits if not given.
        upper: the other corner [rad].
        speed: velocities are drawn from ±speed [rad/s], since D̄ and J̄₂ depend on them.
        samples: number of random states; sampled, not proved, between them.
        seed: of the random states.

    Raises InvalidArgumentError for another law and for a box that is empty, PHControlError for a law that is not what
    it promises on this system.

    Example:
        >>> from phcontrol import MechanicalSystem, force_control_conditions, load_robot, make_controller
        >>> gripper = MechanicalSystem(load_robot("pera_gripper"))
        >>> force_control_conditions(make_controller("force_control", gripper), gripper, samples=1).passed
        True
    """
    if not isinstance(controller, ForceControl):
        raise InvalidArgumentError("controller", f"must be a ForceControl, but is {type(controller).__name__}")
    count("samples", samples)
    positive("speed", speed)
    generator = np.random.default_rng(seed)
    low = system.robot.lower if lower is None else vector("lower", lower, system.n)
    high = system.robot.upper if upper is None else vector("upper", upper, system.n)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise InvalidArgumentError("lower", f"{system.robot.name} has joints without limits: give lower and upper")
    if (low > high).any():
        raise InvalidArgumentError("lower", f"must not be above upper, but is {low} with upper {high}")
    require_certificate(controller, system, "the proof of force control")
    states = [
        system.at(generator.uniform(low, high), generator.uniform(-speed, speed, system.n)) for _ in range(samples)
    ]
    return ForceConditions(
        positive=1.0 / math.sqrt(float(np.linalg.eigvalsh(controller.force_gain)[-1])),
        decreasing=min(_largest(controller, x) for x in states),
        printed=_printed(controller, states),
        samples=samples,
    )


def _largest(controller: ForceControl, x: MechanicalState) -> float:
    """Return the largest ε with Q₀ + εQ₁ > 0 at one state."""
    n, A = x.system.n, controller.coupling
    port = A @ controller.force_gain  # Y
    skew, friction = x.interconnection(controller.interconnection), x.transformed_damping
    injected = friction + x.transformed_input @ controller.damping @ x.transformed_input.T
    rows = np.block(
        [[skew - injected, (skew - friction) @ A], [port.T @ (skew - friction), port.T @ (skew - friction) @ A]]
    )
    inverse = np.linalg.inv(controller.force_gain)
    zero, one = np.zeros((n, n)), np.eye(n)
    energy, crossed = np.block([[one, zero], [zero, inverse]]), np.block([[zero, one], [one, zero]])
    at_zero, slope = (-(part @ rows + rows.T @ part) for part in (energy, crossed))
    values = np.linalg.eigvalsh(at_zero)
    if values[0] <= 1e-12 * values[-1]:  # no friction in some joint: w can move without loss
        return 0.0
    worst = float(eigh(-slope, at_zero, eigvals_only=True)[-1])
    return math.inf if worst <= 0.0 else 1.0 / worst


def _printed(controller: ForceControl, states: list[MechanicalState]) -> tuple[float, float, float]:
    """Return the right-hand sides of (4.13), (4.14), (4.15) as printed."""

    def bounds(matrices: list[Array]) -> tuple[float, float]:
        values = [np.linalg.svd(matrix, compute_uv=False) for matrix in matrices]
        return float(min(value[-1] for value in values)), float(max(value[0] for value in values))

    d1, d2 = bounds([x.transformed_damping for x in states])
    g1, g2 = bounds([x.transformed_input for x in states])
    c1, c2 = bounds([controller.damping])
    k1, k2 = bounds([controller.force_gain])
    y1, y2 = bounds([controller.coupling @ controller.force_gain])
    spread = d2 / d1 if d1 > 0.0 else math.inf  # of the friction
    second = y2 / y1 * spread * k1 / math.sqrt(k2)
    third = y1 / y2 * math.sqrt((d1 + c1 * g1**2) / (d2 + c2 * g2**2) / spread * k2 / k1)
    return math.sqrt(1.0 / k1), second, third
