"""An arm as it is drawn: the shapes of its links, and where they are."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array
from phcontrol.exceptions import UnknownNameError
from phcontrol.mechanics.robot import Robot
from phcontrol.visualization.link_ends import link_end
from phcontrol.visualization.shapes import Shape, robot_shapes, tinted

GHOST_LINK = (0.45, 0.47, 0.50, 0.55)
"""The colour of a link that its description gives no shape."""


class DrawnArm:
    """The links of an arm with what is drawn of each; lines from joint to joint where a link has no shapes.

    Args:
        robot: the arm.
        confined: whether of the robot's meshes only those in its package directories are opened.
    """

    def __init__(self, robot: Robot, *, confined: bool = False) -> None:
        self.robot = robot
        self.data = robot.model.createData()
        self.links = {
            frame.name: index
            for index, frame in enumerate(robot.model.frames)
            if frame.type in (pin.FrameType.BODY, pin.FrameType.OP_FRAME)
        }
        shapes, self.notes = robot_shapes(robot, confined=confined)
        skeleton = self._skeleton()
        drawn = any(shapes.values())
        for name, lines in skeleton.items():
            if not drawn or (not shapes.get(name) and len(lines) > 1):  # between links that are drawn, a ghost
                shapes[name] = tinted(lines, GHOST_LINK) if drawn else lines
        self.link_shapes = {name: entries for name, entries in shapes.items() if entries and name in self.links}

    def checked_frame(self, name: str) -> str:
        """Return the name of a frame that is placed. Raises UnknownNameError, listing them."""
        if not isinstance(name, str) or name not in self.links:
            raise UnknownNameError("frame", str(name), self.links, f" of {self.robot.name}")
        return name

    def placements(self, position: Array) -> dict[str, pin.SE3]:
        """Return where every link is in the world at a position [rad]; leaves the joints' poses in ``data``."""
        pin.framesForwardKinematics(self.robot.model, self.data, self.robot.full_position(position))
        return {name: self.data.oMf[index].copy() for name, index in self.links.items()}

    def _skeleton(self) -> dict[str, list[Shape]]:
        """Return a line from each joint to the next or to its link's end, and a dot, for robots without shapes."""
        model = self.robot.model
        shapes: dict[str, list[Shape]] = {}
        for name, index in self.links.items():
            frame = model.frames[index]
            ends = [
                frame.placement.inverse().act(model.jointPlacements[child].translation)
                for child in range(1, model.njoints)
                if model.parents[child] == frame.parentJoint
            ]
            end = link_end(model, frame.parentJoint) if frame.parentJoint > 0 else None
            if end is not None and np.allclose(frame.placement.translation, 0.0):
                ends.append(frame.placement.inverse().act(end))
            points = np.array([point for end in ends for point in (np.zeros(3), end)]).reshape(-1, 3)
            shapes[name] = [Shape("sphere", (0.02,)), *([Shape("lines", points=points)] if ends else [])]
        return shapes
