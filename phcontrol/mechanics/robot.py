"""A robot arm: a Pinocchio model and what a URDF cannot say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from phcontrol._validation import Array, text, vector
from phcontrol.exceptions import InvalidArgumentError, RobotDescriptionError, UnknownNameError
from phcontrol.mechanics.friction import Friction
from phcontrol.mechanics.payload import Payload
from phcontrol.mechanics.pose import check_pose
from phcontrol.mechanics.potentials import Potential
from phcontrol.mechanics.rotors import Rotor
from phcontrol.mechanics.stop_velocity import StopVelocity

REFERENCES = {
    "local": pin.ReferenceFrame.LOCAL,
    "world": pin.ReferenceFrame.WORLD,
    "local_world_aligned": pin.ReferenceFrame.LOCAL_WORLD_ALIGNED,
}
"""Frames of reference of a Jacobian: axes and origin of the frame itself ("local"), of the world
("world", the origin there too), or the frame's origin with the axes of the world."""


@dataclass(frozen=True)
class Coupling:
    """Mimic joints: all joint angles of the model are ``matrix @ q + offset``, with q the independent ones.

    Since the map is affine, the dynamics in q are exactly M = EᵀM_full E, C = EᵀC_full E, g = Eᵀg_full.
    """

    matrix: Array
    offset: Array


@dataclass(frozen=True, eq=False)
class Robot:
    """A fixed-base arm of n independent joints, each revolute, continuous or prismatic.

    ``position`` vectors hold n joint angles [rad] (or lengths [m]) in the order of ``joint_names``; a
    continuous joint is one angle too, and errors in it are wrapped to (-π, π]. ``model`` is the
    Pinocchio model; it has more coordinates than n only where mimic joints follow others
    (``coupling``). Make one with :func:`phcontrol.load_robot`.

    Example:
        >>> from phcontrol import load_robot
        >>> robot = load_robot("pera_shoulder")
        >>> robot.n, robot.joint_names, robot.position({robot.joint_names[0]: 0.2})
        (2, ('shoulder_pitch', 'shoulder_roll'), array([0.2, 0. ]))
    """

    name: str
    model: pin.Model
    joint_names: tuple[str, ...]
    home: Array
    lower: Array
    upper: Array
    velocity_limit: Array
    effort_limit: Array
    continuous: Array
    stop_velocity: StopVelocity | None = None
    prismatic: tuple[bool, ...] = ()
    friction: Friction | None = None
    potentials: tuple[Potential, ...] = ()
    tool_frame: str | None = None
    camera_frame: str | None = None
    coupling: Coupling | None = None
    description: str = ""
    path: Path | None = None
    package_directories: tuple[Path, ...] = ()
    locked_joints: dict[str, float] = field(default_factory=dict)
    payloads: tuple[Payload, ...] = ()
    """What the arm carries beside its description; its inertia is in ``model``."""
    rotors: dict[str, Rotor] = field(default_factory=dict)
    """Rotors taken from the URDF by joint (``load_robot(rotor_inertia=True)``); their armature is in ``model``."""

    @property
    def n(self) -> int:
        """Number of independent joints (degrees of freedom)."""
        return len(self.joint_names)

    def __repr__(self) -> str:
        return f"<Robot {self.name}: {self.n} joints>"

    @property
    def label(self) -> str:
        """The arm's name, with what it carries."""
        return self.name + (f" with {', '.join(map(str, self.payloads))}" if self.payloads else "")

    def record(self) -> dict[str, Any]:
        """Return, for JSON, what ``robot_from_record`` makes this arm's kinematics of again."""
        return {
            "name": self.name,
            "urdf": self.description,
            "joint_names": list(self.joint_names),
            "locked_joints": dict(self.locked_joints),
            "package_directories": [str(directory) for directory in self.package_directories],
            "tool_frame": self.tool_frame,
            "camera_frame": self.camera_frame,
            "payloads": [payload.record() for payload in self.payloads],
        }

    def joint_index(self, name: str) -> int:
        """Return the index of a joint by name. Raises UnknownNameError, listing the joints."""
        if name not in self.joint_names:
            raise UnknownNameError("joint", name, self.joint_names, f" of {self.name}")
        return self.joint_names.index(name)

    def frame_id(self, name: str) -> int:
        """Return Pinocchio's index of a frame (a link's name). Raises UnknownNameError, listing the frames."""
        for index, frame in enumerate(self.model.frames):
            if isinstance(name, str) and frame.name == name:
                return index
        raise UnknownNameError("frame", name, self.frame_names, f" of {self.name}")

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Names of the links and fixed frames."""
        kinds = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)
        return tuple(frame.name for frame in self.model.frames if frame.type in kinds)

    def with_frame(self, name: str, parent: str, placement: Any) -> Robot:
        """Return the robot with another fixed frame: where a camera was found to be, for instance.

        Args:
            name: of the new frame; not one that the robot has.
            parent: the frame that it is fixed to.
            placement: its pose in the parent's frame [m]: a ``Pose``, a pin.SE3 or a (4, 4) matrix.
        """
        if text("name", name) in [frame.name for frame in self.model.frames]:
            raise InvalidArgumentError("name", f"'{name}' is a frame of {self.name} already")
        index, pose = self.frame_id(parent), check_pose("placement", placement)
        model = pin.Model(self.model)
        beside = model.frames[index]
        place = beside.placement * pin.SE3(np.array(pose.rotation), np.array(pose.translation))
        model.addFrame(pin.Frame(name, beside.parentJoint, index, place, pin.FrameType.OP_FRAME))
        return replace(self, model=model)

    def with_payload(self, payload: Payload) -> Robot:
        """Return the robot with another body fixed to one of its frames.

        Raises InvalidArgumentError when no frame is given and the robot has no tool frame, or when the frame does
        not move; UnknownNameError when there is no such frame.
        """
        if not isinstance(payload, Payload):
            raise InvalidArgumentError("payload", f"must be a Payload, but is {payload!r}")
        name = payload.frame or self.tool_frame
        if name is None:
            raise InvalidArgumentError(
                "payload.frame", f"must be given, for {self.name} names no tool frame: {', '.join(self.frame_names)}"
            )
        frame = self.model.frames[self.frame_id(name)]
        if frame.parentJoint == 0:
            raise InvalidArgumentError(
                "payload.frame", f"'{name}' is fixed to the base of {self.name}: nothing moves it"
            )
        model = pin.Model(self.model)
        model.appendBodyToJoint(frame.parentJoint, payload.spatial, frame.placement)
        placed = Payload(payload.mass, payload.com, payload.inertia, name)
        return replace(self, model=model, payloads=(*self.payloads, placed))

    def position(self, joints: dict[str, float] | ArrayLike, name: str = "position") -> Array:
        """Return a position vector from an array, or from angles by joint name (others at home).

        ``name`` is what errors call it.
        """
        if not isinstance(joints, dict):
            return vector(name, joints, self.n)
        position = np.array(self.home)
        for joint, value in joints.items():
            position[self.joint_index(joint)] = value
        return vector(name, position, self.n)

    def difference(self, position: Array, target: Array) -> Array:
        """Return position ⊖ target, shape (n,) [rad]; in continuous joints wrapped to (−π, π]."""
        error = position - target
        return np.where(self.continuous, wrapped(error), error)

    def near_home(self) -> Array:
        """Return a posture inside the limits a step from home: 0.4 rad at most, 0.05 m for prismatic joints."""
        bounded = np.isfinite(self.lower) & np.isfinite(self.upper)
        low, high = np.where(bounded, self.lower, self.home), np.where(bounded, self.upper, self.home + 2.0)
        middle = 0.5 * (low + high)
        step = np.where(np.array(self.prismatic or [False] * self.n), 0.05, 0.4)
        posture: Array = self.home + np.clip(np.where(middle == self.home, step, middle - self.home), -step, step)
        return np.clip(posture, self.lower, self.upper)

    def full_position(self, position: Array) -> Array:
        """Return all joint angles of ``model`` at n independent ones (the same, without mimic joints)."""
        if self.coupling is None:
            return position
        full: Array = self.coupling.matrix.dot(position) + self.coupling.offset
        return full

    def placement(self, frame: str, position: ArrayLike) -> pin.SE3:
        """Return the pose of a frame in the world at a position."""
        data = self.model.createData()
        full = self.full_position(vector("position", position, self.n))
        pin.framesForwardKinematics(self.model, data, full)
        return data.oMf[self.frame_id(frame)].copy()

    def random_position(self, generator: np.random.Generator, margin: float = 0.0) -> Array:
        """Draw a position uniformly inside the joint limits, at least ``margin`` (a fraction) away from them.

        Where a joint has no limits, or more than a full turn of them, one turn about its zero is used
        (one metre for a prismatic joint).
        """
        reach = np.where(np.array(self.prismatic or [False] * self.n), 0.5, np.pi)
        wide = (self.upper - self.lower) > 2.0 * reach
        low, high = np.where(wide, -reach, self.lower), np.where(wide, reach, self.upper)
        width = high - low
        return generator.uniform(low + margin * width, high - margin * width)

    def check_inertia(self, samples: int = 8) -> None:
        """Raise RobotDescriptionError unless masses and M(q) at sampled positions are positive definite."""
        model, data = self.model, self.model.createData()
        for index in range(1, model.njoints):
            inertia = model.inertias[index]
            values = np.concatenate([[inertia.mass], inertia.lever, inertia.inertia.ravel()])
            if not np.isfinite(values).all():
                raise RobotDescriptionError(
                    f"{self.name}: mass or inertia behind joint '{model.names[index]}' is not finite"
                )
            moments = np.linalg.eigvalsh(inertia.inertia)
            if inertia.mass < 0.0 or moments[0] < -1e-2 * moments[-1]:
                raise RobotDescriptionError(
                    f"{self.name}: the link moved by joint '{model.names[index]}' has mass {inertia.mass:g} kg and "
                    f"principal moments of inertia {moments} kg m²; none may be negative"
                )
        self._check_massless()
        generator = np.random.default_rng(0)
        for sample in range(samples):
            position = self.home if sample == 0 else self.random_position(generator)
            mass_matrix = pin.crba(model, data, self.full_position(position))
            if self.coupling is not None:
                mass_matrix = self.coupling.matrix.T @ mass_matrix @ self.coupling.matrix
            if not np.isfinite(mass_matrix).all():
                raise RobotDescriptionError(
                    f"{self.name}: the mass matrix is not finite: masses or lengths are too large"
                )
            values, directions = np.linalg.eigh(mass_matrix)
            if not values[0] > 1e-12 * max(values[-1], 1e-6):
                joint = self.joint_names[int(np.argmax(np.abs(directions[:, 0])))]
                raise RobotDescriptionError(
                    f"{self.name}: the mass matrix is not positive definite (smallest eigenvalue {values[0]:.3g}): "
                    f"what moves with joint '{joint}' has no mass or inertia. Give that link an <inertial> element, "
                    f"or lock the joint with locked_joints=['{joint}']"
                )

    def _check_massless(self) -> None:
        """Raise RobotDescriptionError, naming all of them, where joints move nothing that has mass or inertia."""
        model = self.model
        moved = np.zeros(model.njoints, dtype=bool)  # whether a joint moves something, or turns a rotor
        for index in range(model.njoints - 1, 0, -1):
            inertia = model.inertias[index]
            moved[index] |= bool(inertia.mass > 0.0 or inertia.inertia.any())
            moved[model.parents[index]] |= moved[index]
        moved[1:] |= np.asarray(model.armature) > 0.0
        matrix = np.eye(model.nv) if self.coupling is None else self.coupling.matrix
        massless = [name for k, name in enumerate(self.joint_names) if not moved[1:][matrix[:, k] != 0.0].any()]
        if not massless:
            return
        bodies = [
            frame.name
            for frame in model.frames
            if frame.type == pin.FrameType.BODY and model.names[frame.parentJoint] in massless
        ]
        raise RobotDescriptionError(
            f"{self.name}: the mass matrix is not positive definite: what moves with {_listing('joint', massless)} has "
            f"no mass or inertia. Give {_listing('link', bodies)} an <inertial> element, give the joints rotors with "
            f"armature=..., or lock them with locked_joints={massless}"
        )


def wrapped(angle: Array) -> Array:
    """Return angles taken to (−π, π] by whole turns [rad]."""
    result: Array = np.pi - np.remainder(np.pi - angle, 2.0 * np.pi)
    return result


def _listing(kind: str, names: list[str]) -> str:
    return f"{kind}{'s' if len(names) > 1 else ''} " + ", ".join(f"'{name}'" for name in names)


def check_joint_names(names: Sequence[str], known: Sequence[str], robot: str) -> None:
    """Raise UnknownNameError for the first of ``names`` that is not a joint of the robot."""
    for name in names:
        if not isinstance(name, str) or name not in known:
            raise UnknownNameError("joint", name, known, f" of {robot}")
