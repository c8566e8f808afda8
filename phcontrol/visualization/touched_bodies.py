"""How the bodies that an arm touches are drawn."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array
from phcontrol.environments.contact_geometry import JointContact, SphereContact
from phcontrol.visualization.drawn_arm import DrawnArm
from phcontrol.visualization.shapes import Arrow, Node, Shape, pose_of, read_mesh, tinted

BODY = (0.90, 0.55, 0.10, 0.45)
PLATE = 0.6
"""Edge of the square that stands for a plane [m]."""


class TouchedBody:
    """What is drawn of a touched body; nothing, for one that cannot be."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.arrows: list[Arrow] = []

    def frame(
        self, arm: DrawnArm, position: Array, here: dict[str, pin.SE3], force: float, depth: float
    ) -> tuple[list[float], list[float]]:
        """Return the poses of its nodes and its arrow."""
        return [], []


class JointBody(TouchedBody):
    """A body in a joint's way: the links that the joint moves, where they meet it; its force along the joint's axis."""

    def __init__(self, arm: DrawnArm, number: int, geometry: JointContact) -> None:
        super().__init__()
        self.geometry, robot = geometry, arm.robot
        self.index = robot.joint_index(geometry.joint)
        moved = np.array(robot.home)
        moved[self.index] += 0.1
        before, after = arm.placements(np.array(robot.home)), arm.placements(moved)
        self.links = [name for name in arm.link_shapes if not before[name].isApprox(after[name], 1e-9)]
        self.nodes = [Node(f"bodies/{number}/{name}", tinted(arm.link_shapes[name], BODY)) for name in self.links]
        self.arrows = [Arrow(f"contact moment on {geometry.joint}", "N·m")]
        self.joint = robot.model.getJointId(geometry.joint)
        column = pin.computeJointJacobians(robot.model, arm.data, robot.full_position(moved))[
            :, robot.model.joints[self.joint].idx_v
        ]
        world = column[3:] if np.any(column[3:]) else column[:3]  # turns about its axis, or slides along it
        self.axis = arm.data.oMi[self.joint].rotation.T @ world

    def frame(
        self, arm: DrawnArm, position: Array, here: dict[str, pin.SE3], force: float, depth: float
    ) -> tuple[list[float], list[float]]:
        """Return the links' poses where they touch, and the moment along the axis."""
        sign = 1.0 if self.geometry.side == "below" else -1.0
        touching = np.array(position)
        touching[self.index] = self.geometry.position - sign * depth
        there = arm.placements(touching)
        poses = [value for name in self.links for value in pose_of(there[name])]
        at_joint = arm.data.oMi[self.joint]
        return poses, [*at_joint.translation, *(sign * force * (at_joint.rotation @ self.axis))]


class SphereBody(TouchedBody):
    """A shape in space and the fingertip that touches it."""

    def __init__(self, number: int, geometry: SphereContact, record: Mapping[str, Any]) -> None:
        super().__init__()
        self.geometry = geometry
        kind = record["shape"]
        place = pose_of(pin.SE3(geometry.rotation, geometry.position))
        if kind == "plane":
            shape = Shape("box", (PLATE, PLATE, 0.01), BODY, (0.0, 0.0, -0.005, 0.0, 0.0, 0.0, 1.0))
        elif kind == "mesh":
            points, faces, _ = read_mesh(record["path"])[0]
            shape = Shape("mesh", (), BODY, points=points, faces=faces)
        else:
            size = record["size"]
            shape = Shape(kind, tuple(size) if isinstance(size, list) else (size,), BODY)
        self.place = place
        tip = Shape("sphere", (geometry.radius,), (0.2, 0.2, 0.2, 1.0))
        self.nodes = [Node(f"bodies/{number}/shape", [shape]), Node(f"bodies/{number}/tip", [tip])]
        self.arrows = [Arrow(f"contact force on {geometry.frame}", "N")]

    def frame(
        self, arm: DrawnArm, position: Array, here: dict[str, pin.SE3], force: float, depth: float
    ) -> tuple[list[float], list[float]]:
        """Return the poses of shape and fingertip, and the force at its centre."""
        centre = here[self.geometry.frame]
        away = self.geometry.meet(centre.translation)[1]
        place = np.array(self.place)
        place[:3] -= depth * away
        return [*place, *pose_of(centre)], [*centre.translation, *(force * away)]
