"""Where an arm touches something: a gap, and how it changes with the joints."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import coal
import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, choice, number, vector
from phcontrol._validation import rotation as check_rotation
from phcontrol.exceptions import InvalidArgumentError, RobotDescriptionError
from phcontrol.mechanics.state import MechanicalState


class Gap(NamedTuple):
    """The distance between arm and body at one state."""

    distance: float
    """g [m or rad]: positive apart, negative where they overlap."""
    slope: Array
    """∂g/∂q, shape (n,): a force F that pushes them apart acts on the joints as slope·F."""


class ContactGeometry(Protocol):
    """What a body needs to know of where it may be touched."""

    def gap(self, x: MechanicalState) -> Gap:
        """Return the gap at a state of the arm."""
        ...


class JointContact:
    """A body in the way of one joint: touched when the joint passes ``position``.

    Args:
        joint: the joint's name.
        position: where contact begins [rad or m].
        side: "below" when the body is met as the joint coordinate decreases (a gripper that closes so),
            "above" when it is met as the coordinate increases.

    Example:
        >>> from phcontrol import JointContact, MechanicalSystem, load_robot
        >>> gripper = MechanicalSystem(load_robot("pera_gripper"))
        >>> contact = JointContact("gripper", 0.20)  # touched from above, when the gripper closes
        >>> round(contact.gap(gripper.at([0.30])).distance, 3), round(contact.gap(gripper.at([0.15])).distance, 3)
        (0.1, -0.05)
    """

    def __init__(self, joint: str, position: float, side: str = "below") -> None:
        self.joint = joint
        self.position = number("position", position)
        self.side = choice("side", side, ("below", "above"))
        self._sign = 1.0 if self.side == "below" else -1.0

    def record(self) -> dict[str, Any]:
        """Return joint, position and side."""
        return {"kind": "joint", "joint": self.joint, "position": self.position, "side": self.side}

    def gap(self, x: MechanicalState) -> Gap:
        """Return the joint's distance from the body."""
        index = x.system.robot.joint_index(self.joint)
        slope = np.zeros(x.system.n)
        slope[index] = self._sign
        return Gap(self._sign * (float(x.position[index]) - self.position), slope)


class SphereContact:
    """A small sphere fixed at a frame of the arm, against a shape that is fixed in space.

    Signed distance and normal of planes and spheres have a closed form; those of boxes and meshes come from coal. The
    contact force acts along the normal, through the sphere's centre; what friction a body has acts where the sphere
    touches. A mesh is a surface without inside: the sphere must not sink into it by more than its radius.

    Args:
        frame: the arm's frame that carries the sphere at its origin.
        radius: of the sphere [m].
        shape: "plane" (the half space below z = 0 of its own frame), "sphere", "box", or a coal shape.
        size: of the shape: a sphere's radius, a box's three edges [m].
        position: of the shape's origin in the world [m].
        rotation: of the shape in the world, shape (3, 3).

    Example:
        >>> import coal
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, SphereContact, load_robot
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> floor = coal.Halfspace(np.array([0.0, 0.0, 1.0]), -2.0)  # 2 m below
        >>> tip = SphereContact("tool", 0.01, floor)
        >>> x = system.at(system.robot.home)
        >>> bool(np.isclose(tip.gap(x).distance, x.placement("tool").translation[2] + 2.0 - 0.01))
        True
    """

    def __init__(
        self,
        frame: str,
        radius: float,
        shape: Any,
        *,
        size: ArrayLike | None = None,
        position: ArrayLike = (0.0, 0.0, 0.0),
        rotation: ArrayLike | None = None,
    ) -> None:
        self.frame = frame
        self.radius = number("radius", radius, minimum=1e-6)
        self._sphere = coal.Sphere(self.radius)
        self._shape = _shape(shape, size)
        self._named = {"shape": shape, "size": None if size is None else np.asarray(size, dtype=float).tolist()}
        self._turn: Array = np.eye(3) if rotation is None else check_rotation("rotation", rotation)
        self._origin: Array = vector("position", position, 3)
        self._place = coal.Transform3s(np.array(self._turn), np.array(self._origin))
        self._ball = number("size", self._named["size"], minimum=1e-6) if self._is("sphere") else 0.0
        self._request = coal.DistanceRequest()
        self._request.enable_signed_distance = True

    @classmethod
    def with_mesh(cls, frame: str, radius: float, path: str | os.PathLike[str], **pose: ArrayLike) -> SphereContact:
        """Make a contact with a mesh file that coal can read (STL, OBJ, DAE). Raises RobotDescriptionError."""
        if not Path(path).is_file():
            raise RobotDescriptionError(f"{path}: no such mesh file")
        try:
            mesh = coal.MeshLoader().load(os.fspath(path))
        except Exception as error:  # coal raises several kinds
            raise RobotDescriptionError(f"{path}: cannot be read as a mesh: {error}") from error
        contact = cls(frame, radius, mesh, **pose)
        contact._named = {"shape": "mesh", "path": str(Path(path).resolve())}
        return contact

    @property
    def position(self) -> Array:
        """Origin of the shape in the world, shape (3,) [m]."""
        return np.array(self._origin)

    @property
    def rotation(self) -> Array:
        """Orientation of the shape in the world, shape (3, 3)."""
        return np.array(self._turn)

    def record(self) -> dict[str, Any]:
        """Return frame, radius, shape and pose; a shape that has no name here is called "other"."""
        named = self._named if isinstance(self._named["shape"], str) else {"shape": "other"}
        pose = {"position": self.position.tolist(), "rotation": self.rotation.tolist()}
        return {"kind": "sphere", "frame": self.frame, "radius": self.radius} | named | pose

    def gap(self, x: MechanicalState) -> Gap:
        """Return the sphere's distance from the shape."""
        distance, away = self.meet(x.placement(self.frame).translation)
        slope: Array = away.dot(x.frame_jacobian(self.frame, "local_world_aligned")[:3])
        return Gap(distance, slope)

    def slip(self, x: MechanicalState) -> Array:
        """Return S, shape (3, n): S q̇ is how fast the sphere's point next to the shape slides along it [m/s]."""
        kinematics = x.frame_kinematics(self.frame)
        away = self.meet(kinematics.translation)[1]
        linear, angular = kinematics.jacobian[:3], kinematics.jacobian[3:]
        point: Array = linear + self.radius * np.cross(away, angular, axisb=0, axisc=0)  # ω × (−ρ n) = ρ n × ω
        return point - np.outer(away, away @ point)

    @property
    def has_closed_form(self) -> bool:
        """Whether distance and normal are formulas, and not asked of coal: of a plane and of a sphere."""
        return self._is("plane") or self._is("sphere")

    def _is(self, shape: str) -> bool:
        return isinstance(self._named["shape"], str) and self._named["shape"] == shape

    def meet(self, centre: Array) -> tuple[float, Array]:
        """Return, for the sphere at a centre in the world [m], its distance and the direction away from the shape."""
        offset = centre - self._origin
        if self._is("plane"):
            away: Array = self._turn[:, 2]
            return float(away.dot(offset)) - self.radius, away
        if self._is("sphere"):
            length = math.sqrt(float(offset.dot(offset)))
            if length > 0.0:
                return length - self._ball - self.radius, offset / length
        result = coal.DistanceResult()
        here = coal.Transform3s(np.eye(3), centre)
        distance = coal.distance(self._sphere, here, self._shape, self._place, self._request, result)
        return float(distance), -np.asarray(result.normal).ravel()  # coal's points from the sphere to the shape


def geometry_from_record(record: Mapping[str, Any]) -> JointContact | SphereContact:
    """Return the geometry of which ``record()`` was kept. Raises RobotDescriptionError where that is impossible."""
    if record.get("kind") == "joint":
        return JointContact(record["joint"], record["position"], record["side"])
    if record.get("kind") != "sphere" or record["shape"] == "other":
        raise RobotDescriptionError("a touched body has a shape of its own that a log does not keep")
    pose = {"position": record["position"], "rotation": record["rotation"]}
    if record["shape"] == "mesh":
        return SphereContact.with_mesh(record["frame"], record["radius"], record["path"], **pose)
    return SphereContact(record["frame"], record["radius"], record["shape"], size=record["size"], **pose)


def _shape(shape: Any, size: ArrayLike | None) -> Any:
    if not isinstance(shape, str):
        if not isinstance(shape, coal.CollisionGeometry):
            raise InvalidArgumentError(
                "shape", f"must be plane, sphere, box or a coal shape, but is {type(shape).__name__}"
            )
        return shape
    choice("shape", shape, ("plane", "sphere", "box"))
    if shape == "plane":
        return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
    if size is None:
        raise InvalidArgumentError("size", f"is needed for a {shape}")
    if shape == "sphere":
        return coal.Sphere(number("size", float(np.asarray(size)), minimum=1e-6))
    edges = vector("size", size, 3)
    if (edges <= 0.0).any():
        raise InvalidArgumentError("size", "edges must be > 0")
    return coal.Box(*edges.tolist())


def effective_mass(x: MechanicalState, slope: Array) -> float:
    """Return the mass felt along a gap, 1/(∂g/∂q M⁻¹ ∂g/∂qᵀ) [kg or kg·m²]."""
    reduced = x.solve_factor(slope)
    inverse = float(reduced.dot(reduced))
    return 1.0 / inverse if inverse > 0.0 else math.inf
