"""What there is to draw: the visual shapes of a robot's links, as plain numbers for the page."""

from __future__ import annotations

import base64
import io
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array
from phcontrol.exceptions import RobotDescriptionWarning
from phcontrol.mechanics.robot import Robot

GREY = (0.62, 0.64, 0.67, 1.0)


@dataclass(frozen=True)
class Shape:
    """Something drawn, fixed to a node of the scene."""

    kind: str
    """box, cylinder (along z), sphere, mesh or lines."""
    size: tuple[float, ...] = ()
    """A box's edges; a cylinder's radius and length; a sphere's radius [m]."""
    color: tuple[float, ...] = GREY
    """Red, green, blue and opacity, 0 to 1."""
    pose: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    """In the node: position [m] and quaternion (x, y, z, w)."""
    points: Array | None = None
    """Of a mesh or of lines, shape (N, 3) [m]."""
    faces: Array | None = None
    """Of a mesh, shape (M, 3), indices of points."""

    def __post_init__(self) -> None:
        sizes = {"box": 3, "cylinder": 2, "sphere": 1}.get(self.kind, 0)
        points = () if self.points is None else self.points
        if len(self.size) != sizes or not all(np.isfinite(part).all() for part in (self.size, self.pose, points)):
            raise ValueError(f"a {self.kind} of size {self.size} at {self.pose[:3]} cannot be drawn")

    def to_dict(self) -> dict[str, Any]:
        """Return it for the page."""
        entry: dict[str, Any] = {
            "kind": self.kind,
            "size": [round(float(value), 6) for value in self.size],
            "color": [round(float(value), 4) for value in self.color],
            "pose": [round(float(value), 7) for value in self.pose],
        }
        if self.points is not None:
            entry |= _packed_points(self.points)
        if self.faces is not None:
            wide = self.points is not None and len(self.points) > 1 << 16
            faces = encode(self.faces, np.uint32) if wide else differences(self.faces.reshape(-1, 1))
            entry |= {"faces": faces, "wide": wide}
        return entry


@dataclass(frozen=True)
class Node:
    """A part of the stage that moves as one, with the shapes fixed to it."""

    path: str
    shapes: list[Shape]


@dataclass(frozen=True)
class Arrow:
    """A force [N] or, along a joint's axis, a moment [N·m]."""

    name: str
    unit: str


def axes(length: float = 0.09) -> list[Shape]:
    """Return the three axes of a frame as thin bars: x red, y green, z blue."""
    thick, colors = 0.06 * length, ((0.84, 0.15, 0.16, 1.0), (0.17, 0.63, 0.17, 1.0), (0.12, 0.38, 0.85, 1.0))
    bars = []
    for k, color in enumerate(colors):
        size, centre = [thick] * 3, [0.0] * 3
        size[k], centre[k] = length, 0.5 * length
        bars.append(Shape("box", tuple(size), color, (*centre, 0.0, 0.0, 0.0, 1.0)))
    return bars


def tinted(shapes: Sequence[Shape], color: tuple[float, ...]) -> list[Shape]:
    """Return the same shapes in one colour."""
    return [replace(shape, color=color) for shape in shapes]


_SAID = 2  # links whose shapes cannot be drawn that a warning names; the page names all
_STEPS = 2047


def _packed_points(points: Array) -> dict[str, Any]:
    """Return points as whole numbers in the box around them: off by a 4000th of its edges at most."""
    low = points.min(axis=0)
    step = np.maximum(points.max(axis=0) - low, 1e-9) / _STEPS
    return {"points": differences(np.rint((points - low) / step)), "low": low.tolist(), "step": step.tolist()}


def differences(table: Array, bits: int = 16) -> str:
    """Return a table of whole numbers below 2¹⁶, or 2³², as letters that compress well.

    Column by column, each entry less the one before, modulo 2ᵇⁱᵗˢ; small differences of either sign as small numbers;
    all lowest bytes first, then all next ones.
    """
    columns = np.ascontiguousarray(table.T).astype(np.int64)
    steps = np.diff(columns, axis=1, prepend=0).astype(f"i{bits // 8}").astype(np.int64)
    whole = ((steps << 1) ^ (steps >> 63)).astype(f"<u{bits // 8}").reshape(-1)
    return encode(whole.view(np.uint8).reshape(-1, bits // 8).T, np.uint8)


def encode(array: Any, kind: Any) -> str:
    """Return an array's little-endian bytes as base64."""
    return base64.b64encode(np.ascontiguousarray(array, dtype=np.dtype(kind).newbyteorder("<")).tobytes()).decode()


def pose_of(placement: pin.SE3) -> tuple[float, ...]:
    """Return position [m] and quaternion (x, y, z, w) of a placement."""
    return tuple(float(value) for value in pin.SE3ToXYZQUAT(placement))


def robot_shapes(robot: Robot, *, confined: bool = False) -> tuple[dict[str, list[Shape]], list[str]]:
    """Return the visual shapes of each link, and a note for each that cannot be drawn.

    A link without a visual shape has none here; a robot without any is drawn as lines between its joints.
    ``confined``: of meshes, only those in the robot's package directories are opened.
    """
    import yourdfpy

    # meshes are found and read one by one below, so that one that is missing spares the others
    with np.errstate(all="ignore"):
        urdf = yourdfpy.URDF.load(io.StringIO(robot.description), build_scene_graph=False, load_meshes=False)
    materials = {material.name: material for material in urdf.robot.materials}
    shapes: dict[str, list[Shape]] = {}
    notes: list[str] = []
    for link in urdf.robot.links:
        shapes[link.name] = []
        for visual in link.visuals:
            try:
                shapes[link.name] += _visual(visual, materials, robot, confined)
            except (OSError, ValueError, ImportError) as error:
                notes.append(f"link {link.name} is not drawn: {error}")
    if notes:
        said = "; ".join(notes[:_SAID]) + (f"; and {len(notes) - _SAID} more" if len(notes) > _SAID else "")
        advice = (
            ". Meshes are sought from the folder of the description on; other folders are named by "
            "load_robot(..., package_directories=...)"
            if not confined
            else ""
        )
        warnings.warn(f"{robot.name}: {said}{advice}", RobotDescriptionWarning, stacklevel=2)
    if not any(shapes.values()):
        notes.append(f"{robot.name} has no shapes to draw: lines between its joints instead")
    return shapes, notes


def _visual(visual: Any, materials: dict[str, Any], robot: Robot, confined: bool) -> Iterator[Shape]:
    origin = np.eye(4) if visual.origin is None else visual.origin
    geometry, color = visual.geometry, _color(visual.material, materials)
    pose = _pose(origin)
    if geometry.box is not None:
        yield Shape("box", tuple(geometry.box.size), color or GREY, pose)
    elif geometry.cylinder is not None:
        yield Shape("cylinder", (geometry.cylinder.radius, geometry.cylinder.length), color or GREY, pose)
    elif geometry.sphere is not None:
        yield Shape("sphere", (geometry.sphere.radius,), color or GREY, pose)
    elif geometry.mesh is not None:
        path = find_mesh(geometry.mesh.filename, robot, confined=confined)
        scale = np.ones(3) if geometry.mesh.scale is None else np.broadcast_to(geometry.mesh.scale, (3,))
        for points, faces, own_color in read_mesh(path):
            yield Shape("mesh", (), color or own_color, pose, points * scale, faces)


def _color(material: Any, materials: dict[str, Any]) -> tuple[float, ...] | None:
    if material is None:
        return None
    known = material if material.color is not None else materials.get(material.name)
    if known is None or known.color is None:
        return None
    return tuple(float(value) for value in known.color.rgba)


def _pose(matrix: Array) -> tuple[float, ...]:
    return pose_of(pin.SE3(np.asarray(matrix[:3, :3]), np.asarray(matrix[:3, 3])))


def find_mesh(name: str, robot: Robot, *, confined: bool = False) -> Path:
    """Return where a mesh of a URDF is: as its path says, else in one of the robot's package directories.

    ``confined`` to these directories, a path that leads out of them, also by a link, is refused.
    Raises FileNotFoundError, naming the mesh.
    """
    relative = Path(name.removeprefix("package://").removeprefix("file://"))
    places = [relative] if relative.is_absolute() else []
    places += [directory / relative for directory in robot.package_directories]
    if name.startswith("package://"):  # some packages are looked for by what stands behind their name
        places += [directory / Path(*relative.parts[1:]) for directory in robot.package_directories]
    outside = False
    for place in places:
        if confined and not any(place.resolve().is_relative_to(inner.resolve()) for inner in robot.package_directories):
            outside = True
        elif place.is_file():
            return place
    if outside or (confined and not robot.package_directories):
        raise FileNotFoundError(f"mesh {name} is not opened because a log's file names it: give the robot (--robot)")
    raise FileNotFoundError(f"mesh {name} is missing")


@cache
def read_mesh(path: Path) -> tuple[tuple[Array, Array, tuple[float, ...]], ...]:
    """Return points, faces and colour of each part of a mesh file. Raises ValueError when it cannot be read."""
    import trimesh

    try:
        scene = trimesh.load_scene(path)
        parts = scene.dump()
    except Exception as error:  # the readers raise many kinds
        raise ValueError(f"mesh {path.name} cannot be read ({error})") from error
    meshes = []
    for part in parts:
        if not isinstance(part, trimesh.Trimesh) or len(part.faces) == 0:
            continue
        color = getattr(part.visual, "main_color", None)
        if color is None:
            material = getattr(part.visual, "material", None)
            color = getattr(material, "main_color", None)
        rgba = GREY if color is None else tuple(float(value) / 255.0 for value in color)
        part.merge_vertices(merge_tex=True, merge_norm=True)
        meshes.append((np.asarray(part.vertices, dtype=float), np.asarray(part.faces), rgba))
    if not meshes:
        raise ValueError(f"mesh {path.name} is empty")
    return tuple(meshes)
