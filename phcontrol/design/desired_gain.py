"""An L₂ gain from forces to motion."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import positive
from phcontrol.analysis.l2_gain import damping_for_gain
from phcontrol.controllers.joint_damped_law import JointDampedLaw
from phcontrol.design.design_problem import DesignProblem
from phcontrol.design.placed_gains import placed_gains
from phcontrol.design.specification import Choice, Specification
from phcontrol.exceptions import InvalidArgumentError


class DesiredGain(Specification):
    """An L₂ gain γ from f_e to ŷ: G C Gᵀ ⪰ 1/γ (:func:`l2_gain`, Theorem 3.2.2).

    With a bandwidth the other gains are those of :class:`DesiredBandwidth`, and C is raised in the directions in which
    it is less than 1/γ; without one they are the law's own, and G C Gᵀ = 1/γ.

    Args:
        gain: γ [rad/s per N·m].
        bandwidth: ω beside [rad/s].
        damping_ratio: ζ beside; what C is raised by makes it larger.

    Example:
        >>> from phcontrol import DesiredGain, MechanicalSystem, design_gains, l2_gain, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> found = design_gains("force_feedback", system, DesiredGain(0.1))
        >>> round(l2_gain(found.law, system).bound, 6)
        0.1
    """

    def __init__(self, gain: float, *, bandwidth: float | None = None, damping_ratio: float = 0.7) -> None:
        self.gain = positive("gain", gain)
        self.bandwidth = None if bandwidth is None else positive("bandwidth", bandwidth)
        self.damping_ratio = positive("damping_ratio", damping_ratio)

    def choose(self, problem: DesignProblem) -> Choice:
        """Return the gains."""
        if not issubclass(problem.law, JointDampedLaw):
            raise InvalidArgumentError("controller", f"'{problem.name}' has no damping C that its gain follows from")
        if problem.options.get("measured"):
            raise InvalidArgumentError("measured", "forces that are fed back move z, which C does not damp")
        problem.system.need_constant_input("a gain")
        G = problem.state.input_matrix
        least = damping_for_gain(self.gain, problem.system.n, input_matrix=G)
        if self.bandwidth is None:
            return Choice({"damping": least})
        placed = placed_gains(problem, self.bandwidth, self.damping_ratio)
        damping = G @ placed.gains["damping"] @ G.T
        values, vectors = np.linalg.eigh(damping)
        raised = np.maximum(values, 1.0 / self.gain)
        if np.array_equal(raised, values):
            return placed
        inverse = np.linalg.inv(G)
        C = inverse @ ((vectors * raised) @ vectors.T) @ inverse.T
        note = f"C is raised in {int((raised > values).sum())} directions for the sake of the gain: ζ is larger there"
        return Choice(placed.gains | {"damping": 0.5 * (C + C.T)}, exact=placed.exact, notes=(*placed.notes, note))

    def __str__(self) -> str:
        """Return it in words."""
        beside = "" if self.bandwidth is None else f", bandwidth {self.bandwidth:g} rad/s"
        return f"L₂ gain from forces of {self.gain:g} rad/s per N·m{beside}"
