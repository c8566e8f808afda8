"""Cartesian impedance along the path of a frame (docs/cartesian-impedance.md)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from phcontrol._validation import Array
from phcontrol.controllers.cartesian_law import CartesianLaw
from phcontrol.controllers.parameters import Parameter
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.trajectories.figure_of_eight import FigureOfEight
from phcontrol.trajectories.frame_path import FramePath, check_frame_path

_TRAVEL_TIME = 4.0  # of the default path [s]


def _path(name: str, value: Any, system: MechanicalSystem) -> FramePath:
    return check_frame_path(name, value, system.robot)


class CartesianTracking(CartesianLaw):
    """Follow the path of a frame: spring and damper between the hand and a goal that moves.

        u = G⁻¹(∂V/∂q − 𝒥ᵀF − Δ v_e + M q̈_ref + C q̇_ref + D q̇_ref),   v_e = q̇ − q̇_ref,   q̇_ref = 𝒥#ξ_d(t)

    F, Δ as in :class:`CartesianImpedance`, with the goal (r_d, R_d)(t). 𝒥v_e is the rate of the pose error, so that the
    closed loop on (e, R_e, p̄_e) is that of Cartesian impedance and does not know the time. Near singularities 𝒥# is
    damped, and what of ξ_d the joints then cannot follow drives the loop: no passivity is claimed there.

    Args:
        system: the model of the arm.
        path: a ``FramePath``, of pose or of position alone; by default a figure of eight near home.

    Further arguments are those of :class:`CartesianLaw` and :class:`TankedLaw`; ``frame`` is the path's.

    Example:
        >>> import numpy as np
        >>> from phcontrol import CartesianTracking, FrameLine, MechanicalSystem, Pose, load_robot, simulate
        >>> fingers = ["panda_finger_joint1", "panda_finger_joint2"]
        >>> system = MechanicalSystem(load_robot("panda", locked_joints=fingers))
        >>> start = system.at(system.robot.home).placement("panda_hand_tcp")
        >>> end = Pose(start.translation + [0.0, 0.1, 0.0], start.rotation)
        >>> line = FrameLine("panda_hand_tcp", start, end, travel_time=1.0)
        >>> law = CartesianTracking.tuned(system, path=line)
        >>> log = simulate(system, law, duration=1.5, dt=2e-3)
        >>> there = system.at(log.position[-1]).placement("panda_hand_tcp").translation
        >>> bool(np.linalg.norm(there - end.translation) < 2e-3)  # [m]
        True
    """

    name = "cartesian_tracking"
    run = "cartesian_tracking"

    path: Parameter[FramePath, FramePath] = Parameter("ξ_d", check=_path)

    def prepare(self) -> None:
        """Take the path for the reference, and its frame for the hand."""
        if self.reference is not None:
            raise InvalidArgumentError("reference", "is the path: give path alone")
        if self.frame not in (None, self.path.frame):
            raise InvalidArgumentError("frame", f"must be that of the path, '{self.path.frame}', but is '{self.frame}'")
        if self.path.at(0.0).rotation is None and self.rotational_stiffness is not None:
            raise InvalidArgumentError("rotational_stiffness", "must be None: the path leaves the orientation free")
        self.frame, self.reference = self.path.frame, self.path
        super().prepare()

    @classmethod
    def default_gains(
        cls, system: MechanicalSystem, goal: Array, *, given: Mapping[str, Any] = MappingProxyType({}), **desired: Any
    ) -> dict[str, Any]:
        """Return gains of the base, and a figure of eight about where the hand is at the goal."""
        path = given.get("path")
        if path is not None:
            _path("path", path, system)
        known = dict(given) if path is None else {"frame": path.frame} | dict(given)
        made = super().default_gains(system, goal, given=known, **desired)
        if path is not None:
            if path.at(0.0).rotation is None and "rotational_stiffness" not in given:
                made["rotational_stiffness"] = None
            return made
        frame = given.get("frame") or system.hand_frame
        pose = system.at(goal).placement(frame)
        centre = (np.array(pose.translation), np.array(pose.rotation))
        return made | {"path": FigureOfEight(frame, centre, 0.1, 0.06, _TRAVEL_TIME, turn=0.2)}

    @classmethod
    def check_goal(cls, system: MechanicalSystem, goal: Any) -> Array:
        """Return a posture about which the default path goes [rad]: one near home."""
        return system.robot.near_home() if goal is None else super().check_goal(system, goal)
