"""What closed loops an arm can be given: potential × reference × law, each part from a table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from phcontrol._validation import choice
from phcontrol.controllers.adaptive_payload import AdaptivePayload
from phcontrol.controllers.cartesian_law import CartesianLaw
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.force_control import ForceControl
from phcontrol.controllers.impedance_grasping import ImpedanceGrasping
from phcontrol.controllers.position_law import PositionLaw
from phcontrol.controllers.registry import CONTROLLERS, make_controller
from phcontrol.controllers.shaped_law import AnyReference, ShapedLaw
from phcontrol.controllers.trajectory_tracking import TrajectoryTracking, swing
from phcontrol.mechanics.pose import Pose
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.potentials.frame_spring import FrameSpring
from phcontrol.potentials.holding import Holding
from phcontrol.potentials.joint_spring import JointSpring
from phcontrol.potentials.potential import Potential
from phcontrol.trajectories.figure_of_eight import FigureOfEight
from phcontrol.trajectories.frame_line import FrameLine
from phcontrol.trajectories.minimum_jerk import MinimumJerk

TRANSLATIONAL, ROTATIONAL = 300.0, 10.0  # stiffness of the springs on a frame [N/m], [N·m/rad]
_SOFT = 2.0  # of the joints' springs beside one on a frame [N·m/rad]
_FORCE = 1.0  # what force control presses with [N], on each joint [N·m]
_TRAVEL_TIME = 2.0  # [s]


class Workplace:
    """An arm, the frame that does its work, and where it works: about the posture ``near_home``.

    Args:
        system: the arm.
        frame: by default the tool, or the last link.
    """

    def __init__(self, system: MechanicalSystem, frame: str | None = None) -> None:
        robot = system.robot
        self.system, self.goal = system, robot.near_home()
        self.frame = frame or system.hand_frame
        self.turns = system.n >= 6
        """Whether it has joints enough for an orientation, too."""
        self.halfway = robot.home + 0.5 * robot.difference(self.goal, robot.home)
        """Where paths begin: home itself may be singular, where no spring on a frame has a strict minimum [rad]."""

    def pose(self, position: Any = None) -> Pose:
        """Return the frame's pose, at the goal by default."""
        at = self.system.at(self.goal if position is None else position).placement(self.frame)
        return Pose(np.array(at.translation), np.array(at.rotation))

    def target(self, position: Any = None) -> Any:
        """Return what a path leads through: the pose, or the point where there are no joints for more."""
        pose = self.pose(position)
        return (pose.translation, pose.rotation) if self.turns else pose.translation

    def spring(self, **options: Any) -> FrameSpring:
        """Return a spring on the frame, with the goal where it works."""
        rotational = ROTATIONAL if self.turns else None
        return FrameSpring(
            self.frame,
            self.pose(),
            translational_stiffness=TRANSLATIONAL,
            rotational_stiffness=rotational,
            **options,
        )


JOINT_SPRING = "joint spring"
POTENTIALS: dict[str, Callable[[Workplace], Potential | None]] = {
    JOINT_SPRING: lambda place: None,  # each law makes its own, of goal and stiffness
    "frame spring": lambda place: place.spring(),
    "frame and joint springs": lambda place: place.spring() + JointSpring(place.goal, _SOFT),
    "free direction": lambda place: place.spring(free_direction=(0.0, 0.0, 1.0)),
    "holding": lambda place: Holding(
        place.frame,
        place.system.at(place.goal),
        (0.0, 0.0, 1.0),
        rotational_stiffness=ROTATIONAL if place.turns else 0.0,
        joint=place.system.robot.joint_names[place.system.n // 2],
    ),
}
"""What energy is shaped."""

AT_REST = "at rest"
REFERENCES: dict[str, Callable[[Workplace], AnyReference | None]] = {
    AT_REST: lambda place: None,
    "minimum jerk": lambda place: MinimumJerk.within_limits(place.system.robot, place.system.robot.home, place.goal),
    "sinusoid": lambda place: swing(place.system.robot, place.goal),
    "frame line": lambda place: FrameLine(place.frame, place.target(place.halfway), place.target(), _TRAVEL_TIME),
    "figure of eight": lambda place: FigureOfEight(
        place.frame, place.target(), 0.1, 0.06, 2.0 * _TRAVEL_TIME, turn=0.2 if place.turns else 0.0
    ),
}
"""Along what."""

OF_THE_JOINTS = ("minimum jerk", "sinusoid")
MOVED_BY = {
    JOINT_SPRING: (AT_REST, *OF_THE_JOINTS),
    "frame spring": (AT_REST, "frame line", "figure of eight"),
    "frame and joint springs": (AT_REST,),
    "free direction": (AT_REST, "frame line", "figure of eight"),
    "holding": (AT_REST,),
}
"""Which references move each potential as a whole; others would leave a part of it behind, and are refused."""


@dataclass(frozen=True)
class Composition:
    """A law, about a potential, along a reference: names from the tables, and what makes the law of them."""

    law: str
    potential: str
    reference: str
    options: dict[str, Any]

    def make(self, system: MechanicalSystem, interconnection: str) -> Controller:
        """Make the law with gains that suit the arm."""
        return make_controller(self.law, system, interconnection=interconnection, **self.options)


def takes_any_potential(law: type[Controller]) -> bool:
    """Whether a law is made about any potential: position laws but for those with a spring of their own.

    Nor the adaptive law, whose velocities hold ∂Ψ/∂q: about a spring of a frame, far off and near singularities, they
    are so large that runs cannot be followed.
    """
    if issubclass(law, (TrajectoryTracking, ImpedanceGrasping, AdaptivePayload)):
        return False
    return issubclass(law, (PositionLaw, ForceControl))


def compositions(
    system: MechanicalSystem, laws: Sequence[str] = tuple(CONTROLLERS), *, frame: str | None = None
) -> Iterator[Composition]:
    """Return every closed loop that can be composed for an arm, law by law.

    Args:
        system: the arm.
        laws: registered names; those that shape no potential along a reference are left out.
        frame: on which springs and paths are, by default the tool.
    """
    place = Workplace(system, frame)
    springs, references = _each(POTENTIALS, place), _each(REFERENCES, place)
    for name in laws:
        law = CONTROLLERS[choice("controller", name, CONTROLLERS)].law
        if not issubclass(law, ShapedLaw) or issubclass(law, (TrajectoryTracking, CartesianLaw)):
            continue
        for potential, moved_by in MOVED_BY.items():
            if potential != JOINT_SPRING and not takes_any_potential(law):
                continue
            for reference in moved_by:
                given = {} if reference == AT_REST else {"reference": references[reference]}
                shaped = _pressing if issubclass(law, ForceControl) else _shaped
                yield Composition(name, potential, reference, given | shaped(place, springs[potential]))


def _each(table: dict[str, Callable[[Workplace], Any]], place: Workplace) -> dict[str, Any]:
    return {name: make(place) for name, make in table.items()}


def _shaped(place: Workplace, potential: Potential | None) -> dict[str, Any]:
    return {} if potential is None else {"potential": potential}


def _pressing(place: Workplace, potential: Potential | None) -> dict[str, Any]:
    """Return a force on the joints and springs on them, or a force on the frame and what holds the rest."""
    if potential is None:
        return {"force": np.full(place.system.n, _FORCE), "holding": (JointSpring(place.goal, 20.0),)}
    return {"force": (0.0, 0.0, -_FORCE), "frame": place.frame, "holding": (potential,)}
