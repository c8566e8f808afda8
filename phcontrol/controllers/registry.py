"""Every law by name. Property tests and ``phcontrol certify --controller all`` run over this table."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from numpy.typing import ArrayLike

from phcontrol._validation import choice, count, text
from phcontrol.controllers.adaptive_payload import AdaptivePayload
from phcontrol.controllers.cartesian_impedance import CartesianImpedance
from phcontrol.controllers.cartesian_tracking import CartesianTracking
from phcontrol.controllers.classical_impedance import ClassicalImpedance
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.energy_shaping import EnergyShaping
from phcontrol.controllers.force_control import ForceControl
from phcontrol.controllers.force_feedback import ForceFeedback
from phcontrol.controllers.hamiltonian_servo import HamiltonianServo
from phcontrol.controllers.impedance_grasping import ImpedanceGrasping
from phcontrol.controllers.integral_action import IntegralAction
from phcontrol.controllers.own_laws import check_law, import_law, installed_laws, load_law, origin_of
from phcontrol.controllers.reduction_servo import ReductionServo
from phcontrol.controllers.total_force_rejection import TotalForceRejection
from phcontrol.controllers.trajectory_tracking import TrajectoryTracking
from phcontrol.exceptions import InvalidArgumentError, PHControlError, UnknownNameError
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
    origin: str = "phcontrol"
    """The package, or the module, that the law comes from."""


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
    "adaptive_payload": Entry(
        AdaptivePayload,
        "holds a position, or follows, and finds out what the hand carries",
        "J.-J. Slotine and W. Li, 1987; docs/theory.md: the adaptive law",
    ),
    "force_control": Entry(
        ForceControl,
        "brings the force of the environment on the arm to the desired one",
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
    "cartesian_impedance": Entry(
        CartesianImpedance,
        "holds the hand at a pose by a spring and a damper of desired stiffness, through singular postures too",
        "docs/cartesian-impedance.md: the law and its proof",
        minimum_joints=6,
    ),
    "cartesian_impedance_with_tank": Entry(
        CartesianImpedance,
        "the same, and holds the arm's posture without disturbing the hand, paid for by an energy tank",
        "docs/cartesian-impedance.md: the law and its proof; an energy tank",
        options={"posture": "tank"},
        minimum_joints=6,
    ),
    "cartesian_tracking": Entry(
        CartesianTracking,
        "leads the hand along a path by the same spring and damper",
        "docs/cartesian-impedance.md: the law and its proof; docs/theory.md: the error state",
        minimum_joints=6,
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
"""Every law by its name.

Example:
    >>> from phcontrol import CONTROLLERS
    >>> CONTROLLERS["force_feedback"].source
    'Theorem 3.2.1, errata E8 to E11'
"""


def register(
    name: str,
    law: type[Controller],
    summary: str = "",
    source: str = "",
    *,
    needs: str = "q, q̇",
    options: dict[str, Any] | None = None,
    minimum_joints: int = 1,
) -> None:
    """Give a law of one's own a name, by which ``make_controller``, runs and certificates then know it.

    A class that is defined again, as in a notebook, takes its own place.

    Args:
        name: what it will be called; it must be free.
        law: its class.
        summary: what it does, in a line; by default the first line of its docstring.
        source: where it comes from: a theorem, a paper; by default its module.
        needs: what it needs measured, in words.
        options: arguments that make it the variant of this name.
        minimum_joints: how many joints an arm needs for it.

    Raises:
        InvalidArgumentError: the name is taken, or the law cannot be made: it is no subclass of Controller, has no
            name, or does not state its storage and target.

    Example:
        >>> from phcontrol import CONTROLLERS, EnergyShaping, register
        >>> class Stiff(EnergyShaping):
        ...     name = "stiff"
        >>> register("stiff", Stiff, "holds a position, stiffly")
        >>> CONTROLLERS.pop("stiff").summary
        'holds a position, stiffly'
    """
    checked = check_law("law", law)
    if ":" in text("name", name):
        raise InvalidArgumentError("name", f"must have no colon, which stands for a module and a class: '{name}'")
    taken = CONTROLLERS.get(name)
    if taken is not None and (taken.law.__module__, taken.law.__qualname__) != (law.__module__, law.__qualname__):
        raise InvalidArgumentError("name", f"'{name}' is taken by {taken.law.__qualname__} of {taken.origin}")
    for option in options or {}:
        if option not in checked.parameters:
            raise UnknownNameError("option", option, checked.parameters, f" of {name}")
    CONTROLLERS[name] = Entry(
        checked,
        summary or _summary(checked),
        source or law.__module__,
        needs,
        dict(options or {}),
        count("minimum_joints", minimum_joints),
        law.__module__,
    )


def find_law(name: str, folder: str | None = None) -> Entry:
    """Return a law by its name: a registered one, one that an installed package offers, or "my_module:MyLaw".

    Args:
        name: of the law.
        folder: where modules are looked for before anywhere else, for instance the working directory.

    Raises:
        UnknownNameError: there is none; lists those that exist.
        InvalidArgumentError: what is named is no law that can be made.
        LawError: its module raised an error; says where.
    """
    if not isinstance(name, str):
        raise UnknownNameError("controller", str(name), list(CONTROLLERS))
    if name in CONTROLLERS:
        return CONTROLLERS[name]
    if isinstance(name, str) and ":" in name:
        law = import_law(name, folder)
        return Entry(law, _summary(law), name, origin=law.__module__)
    installed = installed_laws()
    choice("controller", name, [*CONTROLLERS, *installed])
    law = load_law(installed[name])
    return Entry(law, _summary(law), law.__module__, origin=origin_of(installed[name][0]))


def all_laws() -> tuple[dict[str, Entry], list[str]]:
    """Return every law by its name, of installed packages too, and what is wrong with those that cannot be used."""
    laws, problems = dict(CONTROLLERS), []
    for name, points in installed_laws().items():
        if name in CONTROLLERS:
            owner = CONTROLLERS[name].origin
            problems.append(f"'{name}' of {origin_of(points[0])} has the name of a law of {owner}, which is used")
            continue
        try:
            laws[name] = find_law(name)
        except PHControlError as error:
            problems.append(str(error))
    return laws, problems


def _summary(law: type[Controller]) -> str:
    """Return the first line of a law's own docstring."""
    lines = (vars(law).get("__doc__") or "").strip().splitlines()
    return lines[0].rstrip(".") if lines else "says nothing about itself"


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

    The name is a registered one, that of a law of an installed package, or "my_module:MyLaw". Raises UnknownNameError
    for an unknown law or option, listing those that exist, InvalidArgumentError for an arm of too few joints, and what
    ``find_law`` raises.

    Example:
        >>> from phcontrol import MechanicalSystem, load_robot, make_controller
        >>> system = MechanicalSystem(load_robot("ur5"))
        >>> law = make_controller("force_feedback", system, bandwidth=6.0)  # [rad/s]
        >>> law.name, law.stiffness.shape
        ('force_feedback', (6, 6))
    """
    entry = find_law(name)
    if getattr(system, "n", entry.minimum_joints) < entry.minimum_joints:
        raise InvalidArgumentError("system", f"has {system.n} joints, but {name} needs at least {entry.minimum_joints}")
    return entry.law.tuned(system, goal, interconnection=interconnection, **(entry.options | options))
