"""An arm from MuJoCo's XML (MJCF), read strictly: what would be dropped is refused, by name and line.

Pinocchio reads poses, inertias, classes of defaults and joints, of a text that holds nothing else (``_bare``). Here is
checked beforehand that there is nothing that is passed over; limits are read (Pinocchio 4.1 takes ranges of slide
joints for degrees, and of two unequal bounds of a force the larger one); and a URDF of what was understood is written,
from which everything follows as for any arm.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array, decimal
from phcontrol.exceptions import RobotDescriptionError
from phcontrol.mechanics.markup import Element
from phcontrol.mechanics.mjcf_checks import check_elements
from phcontrol.mechanics.mjcf_defaults import Defaults
from phcontrol.mechanics.urdf import UNBOUNDED, Findings, Inertial, Joint, Limit, Link, Triple, Urdf, as_text

_KINDS = {
    "JointModelRX": ("revolute", (1.0, 0.0, 0.0)),
    "JointModelRY": ("revolute", (0.0, 1.0, 0.0)),
    "JointModelRZ": ("revolute", (0.0, 0.0, 1.0)),
    "JointModelRevoluteUnaligned": ("revolute", None),
    "JointModelPX": ("prismatic", (1.0, 0.0, 0.0)),
    "JointModelPY": ("prismatic", (0.0, 1.0, 0.0)),
    "JointModelPZ": ("prismatic", (0.0, 0.0, 1.0)),
    "JointModelPrismaticUnaligned": ("prismatic", None),
}
_BASE = "world"
_STAGE = "phcontrol_stage"


@dataclass(frozen=True)
class Mjcf:
    """An arm of an MJCF: as a URDF says it, and what a URDF cannot say."""

    urdf: Urdf
    armature: dict[str, float]
    """Reflected rotor inertia by joint [kg m²]."""
    home: dict[str, float]
    """Joint positions of the keyframe "home" [rad, m]; empty without one."""


def read_mjcf(root: Element, label: str, locked: frozenset[str]) -> Mjcf:
    """Read an MJCF from its file; ``locked`` joints may be part of tendons and constraints, which then do nothing.

    Raises RobotDescriptionError, which names all that is wrong.
    """
    findings = Findings(label)
    defaults = Defaults(root, findings)
    check_elements(root, defaults, findings, locked)
    findings.check()
    model = _built(_bare(root), label)
    home = _home(root, list(model.names)[1:], findings)
    limits = _Limits(root, defaults, findings)
    links, joints = _translated(model, limits, findings)
    findings.check()
    urdf = Urdf(label, links, joints, "")
    armature = {name: float(model.armature[model.joints[i].idx_v]) for i, name in enumerate(model.names) if i}
    return Mjcf(
        Urdf(label, links, joints, as_text(urdf)),
        {name: value for name, value in armature.items() if value},
        home,
    )


def _built(text: str, label: str) -> pin.Model:
    with tempfile.TemporaryDirectory() as folder:  # Pinocchio reads files only
        path = Path(folder, "arm.xml")
        path.write_text(text, encoding="utf-8")
        try:
            return pin.buildModelFromMJCF(str(path))
        except Exception as error:  # Pinocchio raises several kinds
            raise RobotDescriptionError(f"{label}: not a valid MJCF: {error}") from error


def _bare(root: Element) -> str:
    """Return the text of what moves: no shapes where an inertia is given, no actuators, no keyframes.

    All bodies are put into one at the world's origin: Pinocchio 4.1 drops the pose of the first body of the world.
    """
    bare = ET.Element("mujoco")
    compiler = next((dict(element.attrib) for element in root if element.tag == "compiler"), {})
    kept: dict[str, str] = {name: compiler[name] for name in ("angle", "autolimits", "eulerseq") if name in compiler}
    ET.SubElement(bare, "compiler", kept)
    for element in root:
        if element.tag == "default":
            bare.append(_moving(element))
    stage = ET.SubElement(ET.SubElement(bare, "worldbody"), "body", name=_STAGE)
    for world in root:
        if world.tag == "worldbody":
            stage.extend([_moving(element) for element in world if element.tag == "body"])
    return ET.tostring(bare, encoding="unicode")


def _moving(element: ET.Element) -> ET.Element:
    """Return a copy of a body or of defaults, without what does not move it."""
    copy = ET.Element(element.tag, element.attrib)
    inertial = any(inner.tag == "inertial" for inner in element)
    for inner in element:
        if inner.tag in ("body", "default", "joint", "inertial", "site") or (inner.tag == "geom" and not inertial):
            copy.append(_moving(inner))
    return copy


class _Limits:
    """Limits of joints [rad, m; N·m, N], of range and of the forces of joint and actuators, and friction."""

    def __init__(self, root: Element, defaults: Defaults, findings: Findings) -> None:
        compiler = next((element for element in root if element.tag == "compiler"), None)
        settings: Mapping[str, str] = {} if compiler is None else compiler.attrib
        self._degrees = settings.get("angle", "degree") == "degree"
        self._auto = settings.get("autolimits", "true") == "true"
        self._findings = findings
        self.lines: dict[str, int] = {}
        self.of: dict[str, Limit] = {}
        self.friction: dict[str, tuple[float, float]] = {}
        self.bounded: dict[str, bool] = {}
        efforts = self._actuators(root, defaults)
        for joint, given in defaults.joints(root):
            self._joint(joint, given, efforts)

    def _joint(self, joint: Element, given: Mapping[str, str], efforts: Mapping[str, float]) -> None:
        name = joint.get("name", "")
        owner = f"joint '{name}'"
        scale = math.pi / 180.0 if self._degrees and given.get("type", "hinge") == "hinge" else 1.0
        pair = self._pair(joint, given, "range", owner) if self._holds(given, "limited", "range") else None
        lower, upper = (-UNBOUNDED, UNBOUNDED) if pair is None else (scale * pair[0], scale * pair[1])
        effort = efforts.get(name, math.inf)
        if self._holds(given, "actuatorfrclimited", "actuatorfrcrange"):
            effort = min(effort, *map(abs, self._pair(joint, given, "actuatorfrcrange", owner)))
        self.lines[name], self.bounded[name] = joint.line, pair is not None
        self.friction[name] = decimal(given.get("damping", "0")) or 0.0, decimal(given.get("frictionloss", "0")) or 0.0
        self.of[name] = Limit(lower, upper, 0.0 if math.isinf(effort) else effort, 0.0)

    def _holds(self, given: Mapping[str, str], flag: str, what: str) -> bool:
        """Return whether a range is a limit: as said, or because there is one."""
        said = given.get(flag, "auto")
        return said == "true" or (said == "auto" and self._auto and what in given)

    def _pair(self, element: Element, given: Mapping[str, str], name: str, owner: str) -> tuple[float, float]:
        values = [decimal(part) for part in given.get(name, "").split()]
        if len(values) != 2 or None in values or values[0] > values[1]:  # type: ignore[operator]
            text = given.get(name)
            self._findings.add(element.line, f"{owner}: {name}='{text}' must be two numbers, the lower first")
            return math.nan, math.nan
        return float(values[0] or 0.0), float(values[1] or 0.0)

    def _actuators(self, root: Element, defaults: Defaults) -> dict[str, float]:
        """Return by joint the largest torque that its actuators make in both directions, where they say so."""
        found: dict[str, float] = {}
        for actuator, given in defaults.actuators(root):
            if "joint" not in given:
                continue
            owner = f"{actuator.tag} '{given.get('name', '')}'"
            gear = abs(decimal(given.get("gear", "1").split()[0]) or 0.0)
            bounds = []
            if self._holds(given, "forcelimited", "forcerange"):
                bounds.append(self._pair(actuator, given, "forcerange", owner))
            if actuator.tag == "motor" and self._holds(given, "ctrllimited", "ctrlrange"):
                bounds.append(self._pair(actuator, given, "ctrlrange", owner))
            if bounds:
                largest = gear * min(abs(bound) for pair in bounds for bound in pair)
                found[given["joint"]] = found.get(given["joint"], 0.0) + largest
        return found


def _translated(model: pin.Model, limits: _Limits, findings: Findings) -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
    bodies = _bodies(model)
    links = [Link(_BASE, None, 0)]
    joints: list[Joint] = []
    for i in range(1, model.njoints):
        name, kind = model.names[i], model.joints[i].shortname()
        if kind not in _KINDS:
            findings.add(limits.lines.get(name, 0), f"joint '{name}' is a {kind}, which an arm of phcontrol has not")
            continue
        moves, axis = _KINDS[kind]
        if moves == "revolute" and not limits.bounded[name]:
            moves = "continuous"
        if moves == "prismatic" and not limits.bounded[name]:
            findings.add(limits.lines[name], f"joint '{name}' slides without limits; give it a range")
        links.append(Link(bodies[i], _inertial(model.inertias[i], limits.lines[name]), limits.lines[name]))
        parent = model.parents[i]
        joints.append(
            Joint(
                name=name,
                kind=moves,
                parent=bodies[parent],
                child=bodies[i],
                xyz=_triple(model.jointPlacements[i].translation),
                rpy=_triple(pin.rpy.matrixToRpy(model.jointPlacements[i].rotation)),
                axis=_triple(model.joints[i].extract().axis) if axis is None else axis,
                limit=limits.of[name],
                near_stops=None,
                damping=limits.friction[name][0],
                friction=limits.friction[name][1],
                mimic=None,
                line=limits.lines[name],
            )
        )
    for frame in _fixed(model, bodies):
        links.append(Link(frame.name, None, 0))
        xyz, rpy = frame.placement.translation, pin.rpy.matrixToRpy(frame.placement.rotation)
        joints.append(_fixed_joint(frame.name, bodies[frame.parentJoint], _triple(xyz), _triple(rpy)))
    return tuple(links), tuple(joints)


def _bodies(model: pin.Model) -> list[str]:
    """Return the link of each joint: the body whose frame is the joint's, or one named after the joint."""
    names = [_BASE]
    for i in range(1, model.njoints):
        own = [frame.name for frame in _frames(model) if frame.parentJoint == i and frame.placement.isIdentity(1e-14)]
        names.append(own[0] if own else f"{model.names[i]}_axis")
    return names


def _frames(model: pin.Model) -> Iterator[Any]:
    kinds = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)
    yield from (frame for frame in model.frames if frame.type in kinds)


def _fixed(model: pin.Model, bodies: list[str]) -> Iterator[Any]:
    """Yield bodies without joints, bodies whose joint is beside their origin, and sites."""
    yield from (frame for frame in _frames(model) if frame.name not in (*bodies, _STAGE))


def _fixed_joint(name: str, parent: str, xyz: Triple, rpy: Triple) -> Joint:
    axis = (1.0, 0.0, 0.0)
    return Joint(f"{name}_fixed", "fixed", parent, name, xyz, rpy, axis, None, None, 0.0, 0.0, None, 0)


def _inertial(inertia: pin.Inertia, line: int) -> Inertial | None:
    matrix = np.asarray(inertia.inertia)
    if inertia.mass == 0.0 and not matrix.any():
        return None
    places = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
    moments = {name: float(matrix[place]) for name, place in places.items()}
    return Inertial(float(inertia.mass), _triple(inertia.lever), (0.0, 0.0, 0.0), moments, line)


def _triple(values: Array) -> Triple:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _home(root: Element, names: list[str], findings: Findings) -> dict[str, float]:
    for key in root.iter("key"):
        if key.get("name") != "home" or "qpos" not in key.attrib:
            continue
        assert isinstance(key, Element)
        values = [decimal(part) for part in key.attrib["qpos"].split()]
        if len(values) != len(names) or None in values:
            findings.add(key.line, f"keyframe 'home' must have {len(names)} numbers in qpos, one a joint")
            return {}
        return {name: float(value or 0.0) for name, value in zip(names, values, strict=True)}
    return {}
