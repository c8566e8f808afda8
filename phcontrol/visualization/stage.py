"""The stage of a run: what stands in it, and where everything is at one moment."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array
from phcontrol.environments.contact_geometry import JointContact, geometry_from_record
from phcontrol.exceptions import PHControlError
from phcontrol.mechanics.robot import Robot
from phcontrol.simulation.log import Log
from phcontrol.visualization.drawn_arm import DrawnArm
from phcontrol.visualization.recorded_robot import recorded_robot
from phcontrol.visualization.shapes import Arrow, Node, Shape, axes, pose_of, tinted
from phcontrol.visualization.signals import ENERGIES, HAND, TANK, Signal, contact_signal, joint_signals, joint_values
from phcontrol.visualization.touched_bodies import JointBody, SphereBody, TouchedBody

GHOST = (0.0, 0.45, 0.70, 0.22)
SIGHT = (0.35, 0.35, 0.40, 1.0)
OBJECT = (0.10, 0.60, 0.35, 1.0)
FRUSTUM = 0.12
"""How far in front of the camera its frustum is cut off [m]."""


class Stage:
    """Everything drawn of a run, and :meth:`frame`, which says where it is at one sample.

    A frame is one row of numbers: time, seven for the pose of each node (position and quaternion x, y, z, w),
    six for each arrow (origin and vector), one for each signal, the position of the point that leaves a trail, and
    where a camera is, the features (μ, ν, l) that it shows.

    Args:
        robot: the arm.
        bodies: what it touches, as ``Body.record`` says it.
        wrench_frames: where external wrenches act.
        sight: the camera, what it looks at and where that shall be in its image, as the log's metadata has it.
        largest_features: the largest features of the run, shape (3,) [m], for a camera whose image has no end.
        tank: whether the law has an energy tank.
        goal: whether the law has a posture to go to, drawn as a ghost.
        title: of the page.
        confined: whether of the robot's meshes only those in its package directories are opened.
        foreign_bodies: whether ``bodies`` may be anyone's: then no mesh that they name is opened.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        bodies: Sequence[Mapping[str, Any]] = (),
        wrench_frames: Sequence[str] = (),
        sight: Mapping[str, Any] | None = None,
        largest_features: Array | None = None,
        tank: bool = False,
        goal: bool = False,
        title: str = "",
        confined: bool = False,
        foreign_bodies: bool = False,
    ) -> None:
        self.title = title
        self.arm = DrawnArm(robot, confined=confined)
        self.notes, shapes = self.arm.notes, self.arm.link_shapes
        self.trail = self.arm.checked_frame(robot.tool_frame or list(self.arm.links)[-1])
        self.nodes = [Node(f"robot/{link}", entries) for link, entries in shapes.items()]
        moving = [link for link in shapes if robot.model.frames[self.arm.links[link]].parentJoint > 0]
        self._ghosts = moving if goal else []
        self.nodes += [Node(f"goal/{link}", tinted(shapes[link], GHOST)) for link in self._ghosts]
        self.nodes += [Node(f"frames/{name}", axes()) for name in ("hand", *(["goal"] if goal else []))]
        self.arrows: list[Arrow] = []
        self._contacts: list[TouchedBody] = []
        for number, record in enumerate(bodies):
            self._add_body(number, record, foreign_bodies)
        self.image: dict[str, Any] | None = None
        self._camera_frame = ""
        self._object: tuple[float, ...] | None = None
        if sight is not None:
            self._add_sight(sight, largest_features)
        self._wrench_frames = tuple(self.arm.checked_frame(frame) for frame in wrench_frames)
        self.arrows += [Arrow(f"external force at {frame}", "N") for frame in wrench_frames]
        joints_only = bool(self._contacts) and all(isinstance(contact, JointBody) for contact in self._contacts)
        self._tank, self._goal, self._touches = tank, goal, bool(bodies)
        self.signals: list[Signal] = [*ENERGIES, *([TANK] if tank else [])]
        if bodies:
            self.signals.append(contact_signal("N·m" if joints_only else "N"))
        self.signals += joint_signals(robot, goal) + list(HAND if goal else ())

    @classmethod
    def of(cls, log: Log, robot: Robot | None = None, goal: bool | None = None, tank: bool | None = None) -> Stage:
        """Return the stage of a log.

        Of a log that was read from a file, nothing that it names is opened but the meshes of a robot that is installed
        here. Raises PHControlError when it does not say what robot it is of, or says what cannot be.
        """
        try:
            return cls._of(log, robot, goal, tank)
        except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RuntimeError) as error:
            if isinstance(error, PHControlError) or log.path is None:
                raise
            raise PHControlError(
                f"cannot show {log.path}: what it says of its robot, bodies or camera is damaged ({error!r})"
            ) from error

    @classmethod
    def _of(cls, log: Log, robot: Robot | None, goal: bool | None, tank: bool | None) -> Stage:
        metadata, foreign = log.metadata, log.path is not None
        arm = recorded_robot(log) if robot is None else robot
        if list(arm.joint_names) != metadata["joint_names"]:
            raise PHControlError(
                f"this log is of the joints {metadata['joint_names']}, {arm.name} has {arm.joint_names}"
            )
        sight = metadata.get("sight")
        law = f"{metadata.get('controller', '')} ({metadata.get('interconnection', '')})"
        return cls(
            arm,
            bodies=metadata.get("bodies", ()),
            wrench_frames=metadata.get("wrench_frames", ()),
            sight=sight,
            largest_features=np.nan_to_num(np.abs(log.features[: len(log)])).max(axis=0) if sight else None,
            tank=log.tank_level is not None if tank is None else tank,
            goal=log.goal is not None if goal is None else goal,
            title=f"{arm.name} under {law}",
            confined=foreign and robot is None,
            foreign_bodies=foreign,
        )

    # --- one moment ---------------------------------------------------------------------------------

    def frame(self, time: float, position: Array, row: Mapping[str, Any]) -> Array:
        """Return one frame, shape (columns,), from the position and what ``Log.derive`` gives."""
        here, there = self.arm.placements(position), None
        parts: list[Any] = [time]
        for link in self.arm.link_shapes:
            parts.extend(pose_of(here[link]))
        if self._goal:
            there = self.arm.placements(np.asarray(row["goal"]))
            for link in self._ghosts:
                parts.extend(pose_of(there[link]))
        parts.extend(pose_of(here[self.trail]))
        if there is not None:
            parts.extend(pose_of(there[self.trail]))
        arrows: list[float] = []
        for contact, force, depth in zip(self._contacts, row["contact_forces"], row["contact_depths"], strict=False):
            poses, arrow = contact.frame(self.arm, position, here, float(force), float(depth))
            parts.extend(poses)
            arrows.extend(arrow)
        if self.image is not None:
            parts.extend(pose_of(here[self._camera_frame]))
            if self._object is not None:
                parts.extend(self._object)
        for frame, force in zip(self._wrench_frames, row.get("wrench_forces", ()), strict=False):
            arrows.extend([*here[frame].translation, *force])
        parts.extend(arrows)
        parts.extend(
            (
                row["storage"],
                row["kinetic_energy"] + row["potential_energy"],
                row["dissipated_power"],
                row["supplied_power"],
                row["control_power"],
            )
        )
        parts.extend([row["tank_level"]] if self._tank else [])
        parts.extend([row["contact_force"]] if self._touches else [])
        parts.extend(joint_values(self.arm.robot, position, row, self._goal))
        if there is not None:
            off = there[self.trail].actInv(here[self.trail])
            parts.extend([np.linalg.norm(off.translation), np.linalg.norm(pin.log3(off.rotation))])
        parts.extend(here[self.trail].translation)
        if self.image is not None:
            parts.extend(np.nan_to_num(np.asarray(row["features"])))
        return np.array(parts, dtype=np.float64)

    # --- what stands in it --------------------------------------------------------------------------

    def _add_body(self, number: int, record: Mapping[str, Any], foreign: bool) -> None:
        try:
            contact = self._touched(number, record["geometry"], foreign)
        except (PHControlError, LookupError, TypeError, ValueError, AttributeError, RuntimeError) as error:
            self.notes.append(f"body {number} is not drawn: {error}")
            contact = TouchedBody()
        self._contacts.append(contact)
        self.nodes += contact.nodes
        self.arrows += contact.arrows

    def _touched(self, number: int, record: Mapping[str, Any], foreign: bool) -> TouchedBody:
        if foreign and record.get("shape") == "mesh":
            raise PHControlError(f"its mesh {record.get('path')} is not opened because a log's file names it")
        geometry = geometry_from_record(record)
        if isinstance(geometry, JointContact):
            return JointBody(self.arm, number, geometry)
        self.arm.checked_frame(geometry.frame)
        return SphereBody(number, geometry, record)

    def _add_sight(self, sight: Mapping[str, Any], largest: Array | None) -> None:
        """Draw the camera's frustum and the object, and say how the image plane is to be drawn."""
        camera, seen, goal = sight["camera"], sight["object"], sight["goal"]
        self._camera_frame = self.arm.checked_frame(camera["frame"])
        marks = np.abs([value for value in (largest, goal) if value is not None] or [[1e-3] * 3]).max(axis=0)
        half = [
            known if known is not None else 1.2 * (float(marks[i]) + 0.5 * float(marks[2]))
            for i, known in enumerate(camera["half_size"])
        ]
        x, y = (FRUSTUM * value / camera["focal_length"] for value in half)
        corners = [np.array([sx * x, sy * y, FRUSTUM]) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        edges = [(np.zeros(3), corner) for corner in corners]
        edges += [(corners[i], corners[(i + 1) % 4]) for i in range(4)]
        lines = Shape("lines", color=SIGHT, points=np.array([point for edge in edges for point in edge]))
        self.nodes.append(Node("camera/frustum", [lines, *axes(0.5 * FRUSTUM)]))
        if seen is not None:
            length, width, depth = seen["size"]
            box = Shape("box", (length, width, depth), OBJECT, (0.0, 0.0, 0.5 * depth, 0.0, 0.0, 0.0, 1.0))
            self._object = pose_of(pin.SE3(np.array(seen["rotation"]), np.array(seen["position"])))
            self.nodes.append(Node("object/box", [box]))
        self.image = {"width": 2.0 * half[0], "height": 2.0 * half[1], "goal": goal, "columns": 3}

    def extent(self, frames: Array) -> tuple[list[float], float, float]:
        """Return centre and radius of what the nodes of some frames span, and the height of a floor below them [m]."""
        count = len([node for node in self.nodes if node.path.startswith(("robot/", "goal/"))])
        corners = []
        for pose, node in zip(frames[:, 1 : 1 + 7 * count].reshape(len(frames), -1, 7).transpose(1, 0, 2), self.nodes,
                              strict=False):  # fmt: skip
            for shape in node.shapes:
                placements = [pin.XYZQUATToSE3(row) for row in pose]
                corners += [place.act(point) for place in placements for point in _corners(shape)]
        cloud = np.array(corners)
        low, high = cloud.min(axis=0), cloud.max(axis=0)
        floor = min(0.0, float(low[2]))
        return [float(value) for value in 0.5 * (low + high)], float(0.5 * np.linalg.norm(high - low)), floor

    def to_dict(self) -> dict[str, Any]:
        """Return what the page needs beside the frames."""
        shapes: list[dict[str, Any]] = []
        known: dict[int, int] = {}
        nodes = []
        for node in self.nodes:
            numbers = []
            for shape in node.shapes:
                entry = shape.to_dict()
                color = entry.pop("color")
                # a ghost's shape is the link's, in another colour: written once
                key = hash(json.dumps(entry, sort_keys=True))
                if key not in known:
                    known[key] = len(shapes)
                    shapes.append(entry)
                numbers.append({"shape": known[key], "color": color})
            nodes.append({"path": node.path, "shapes": numbers})
        return {
            "title": self.title,
            "shapes": shapes,
            "nodes": nodes,
            "arrows": [{"name": arrow.name, "unit": arrow.unit} for arrow in self.arrows],
            "signals": [signal.to_dict() for signal in self.signals],
            "trail": self.trail,
            "image": self.image,
            "notes": self.notes,
        }


def _corners(shape: Shape) -> Array:
    """Return the corners of a box around a shape, in its node's frame, shape (8, 3) [m]."""
    if shape.points is not None:
        low, high = shape.points.min(axis=0), shape.points.max(axis=0)
    else:
        if shape.kind == "box":
            half = 0.5 * np.array(shape.size)
        elif shape.kind == "cylinder":
            half = np.array([shape.size[0], shape.size[0], 0.5 * shape.size[1]])
        else:
            half = np.full(3, shape.size[0])
        low, high = -half, half
    grid = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    place = pin.XYZQUATToSE3(np.array(shape.pose))
    return np.array([place.act(point) for point in grid])
