"""Every law by name. Property tests and ``phcontrol certify --controller all`` run over this table."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from numpy.typing import ArrayLike

from phcontrol._validation import choice
from phcontrol.controllers.classical_impedance import ClassicalImpedance
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.energy_shaping import EnergyShaping
from phcontrol.controllers.force_control import ForceControl
from phcontrol.controllers.force_feedback import ForceFeedback
from phcontrol.controllers.hamiltonian_servo import HamiltonianServo
from phcontrol.controllers.impedance_grasping import ImpedanceGrasping
from phcontrol.controllers.integral_action import IntegralAction
from phcontrol.controllers.reduction_servo import ReductionServo
from phcontrol.controllers.total_force_rejection import TotalForceRejection
from phcontrol.controllers.trajectory_tracking import TrajectoryTracking
from phcontrol.mechanics.system import MechanicalSystem


@dataclass(frozen=True)
class Entry:
    """A law, or a variant of it that deserves its own certificate."""

    law: type[Controller]
    summary: str
    source: str
    needs: str = "q, q̇"
    options: dict[str, Any] = field(default_factory=dict)
    minimum_joints: int = 1
    """How many joints an arm needs for the law."""


CONTROLLERS: dict[str, Entry] = {
    "energy_shaping": Entry(
        EnergyShaping,
        "holds a position: spring and damper in place of the arm's potential",
        "thesis section 3.2.1, A = 0",
    ),
    "force_feedback": Entry(
        ForceFeedback, "holds a position with feedback of the modeled forces", "Theorem 3.2.1, errata E8 to E11"
    ),
    "force_feedback_measured": Entry(
        ForceFeedback,
        "the same with the measured external force in its feedback",
        "Theorem 3.2.1 and (3.40), errata E12",
        "q, q̇, external force",
        {"measured": True},
    ),
    "integral_action": Entry(
        IntegralAction,
        "force feedback with an integral that takes up a constant unknown force",
        "Theorem 3.2.5, errata E13",
    ),
    "total_force_rejection": Entry(
        TotalForceRejection,
        "holds a position and cancels the measured total force in the same instant",
        "(3.55) to (3.58), errata E7",
        "q, q̇, total force",
    ),
    "force_control": Entry(
        ForceControl,
        "brings the force of the environment on the arm to a wished one",
        "Theorem 4.1.1, errata E14 and E23",
        "q, q̇, external force",
    ),
    "impedance_grasping": Entry(
        ImpedanceGrasping,
        "closes on a virtual position with a spring whose rest length gives way",
        "Theorem 4.2.3, errata E15",
        "q, q̇, external force",
    ),
    "classical_impedance": Entry(
        ClassicalImpedance, "spring and damper to a virtual position, friction compensated (Hogan)", "(4.60)"
    ),
    "classical_impedance_compensated": Entry(
        ClassicalImpedance,
        "the same, with the measured external force cancelled",
        "(4.61)",
        "q, q̇, external force",
        {"compensate_external_force": True},
    ),
    "tracking": Entry(TrajectoryTracking, "follows a trajectory", "Theorem 6.1.1, errata E22"),
    "tracking_measured": Entry(
        TrajectoryTracking,
        "the same, with the measured external force cancelled",
        "Theorem 6.1.1, errata E22",
        "q, q̇, external force",
        {"measured": True},
    ),
    "reduction_servo": Entry(
        ReductionServo,
        "brings an object to where it should be in the image of a camera in the hand, with a constant gain",
        "Theorem 5.2.2, errata E16 to E18",
        "q, q̇, image features",
        minimum_joints=3,
    ),
    "hamiltonian_servo": Entry(
        HamiltonianServo,
        "the same with a port-Hamiltonian closed loop, by the inverse of the image Jacobian",
        "Theorem 5.2.3, errata E16 to E19",
        "q, q̇, image features",
        minimum_joints=3,
    ),
}


def laws_for(system: MechanicalSystem) -> list[str]:
    """Return the names of the laws that an arm has joints enough for."""
    return [name for name, entry in CONTROLLERS.items() if entry.minimum_joints <= system.n]


def make_controller(
    name: str,
    system: MechanicalSystem,
    goal: ArrayLike | None = None,
    *,
    interconnection: str = "coriolis",
    **options: Any,
) -> Controller:
    """Make a law by its name with gains that suit the robot; ``options`` replaces any of them.

    Raises UnknownNameError for an unknown law or option, listing those that exist.
    """
    entry = CONTROLLERS[choice("controller", name, CONTROLLERS)]
    return entry.law.tuned(system, goal, interconnection=interconnection, **(entry.options | options))
