"""What a URDF says of a robot's motion, read with nothing of phcontrol, urdfdom or Pinocchio's parser."""

from __future__ import annotations

from dataclasses import dataclass, field
from decimal import Decimal
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin

PARTS = {
    "link": ["inertial", "visual", "collision", "gravity", "kinematic", "surface"],
    "inertial": ["origin", "mass", "inertia"],
    "joint": ["origin", "parent", "child", "axis", "limit", "dynamics", "mimic", "safety_controller", "calibration"],
    "origin": [], "mass": [], "inertia": [], "parent": [], "child": [], "axis": [], "limit": [], "dynamics": [],
    "mimic": [],
}  # fmt: skip
ATTRIBUTES = {
    "link": {"name", "type"},
    "joint": {"name", "type"},
    "inertial": set(),
    "origin": {"xyz", "rpy"},
    "mass": {"value"},
    "inertia": {"ixx", "iyy", "izz", "ixy", "ixz", "iyz"},
    "parent": {"link"},
    "child": {"link"},
    "axis": {"xyz"},
    "limit": {"lower", "upper", "effort", "velocity"},
    "dynamics": {"damping", "friction", "D", "K", "mu_coulomb", "mu_viscous"},
    "mimic": {"joint", "multiplier", "offset"},
}


@dataclass
class Mover:
    """A moving joint, with all that is fixed to its child link."""

    parent: str
    placement: np.ndarray
    axis: np.ndarray
    prismatic: bool
    limits: list[float]
    masses: list[float] = field(default_factory=list)
    centres: list[np.ndarray] = field(default_factory=list)
    inertias: list[np.ndarray] = field(default_factory=list)  # about the joint's origin


def numbers(text):
    """Return decimal numbers; Decimal refuses what is none, and would take "1_0", "nan" and "inf"."""
    assert "_" not in text
    assert text.isascii()
    values = np.array([float(Decimal(part)) for part in text.split()])
    assert np.isfinite(values).all()
    return values


def one(element, tag):
    found = element.findall(tag)
    assert len(found) <= 1, f"which {tag}?"
    return found[0] if found else None


def check_names(element):
    assert set(element.attrib) <= ATTRIBUTES[element.tag], element.attrib
    for child in element:
        assert child.tag in PARTS[element.tag], child.tag
        if child.tag in ATTRIBUTES:
            check_names(child)


def turned(rpy):
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return z @ y @ x


def pose(element):
    result = np.eye(4)
    origin = one(element, "origin")
    if origin is not None:
        xyz, rpy = (numbers(origin.get(name, "0 0 0")) for name in ("xyz", "rpy"))
        result[:3, 3], result[:3, :3] = xyz, turned(rpy)
        assert xyz.shape == rpy.shape == (3,)
    return result


def read(text):
    """Return the movers by name, in no order. Raises where the text leaves a doubt."""
    root = ET.fromstring(text)
    links = {link.get("name"): link for link in root.findall("link")}
    assert len(links) == len(root.findall("link"))
    above = {}
    for element in root:
        if element.tag in ("link", "joint"):
            check_names(element)
    for joint in root.findall("joint"):
        child = one(joint, "child").get("link")
        assert child in links
        assert one(joint, "parent").get("link") in links
        assert child not in above
        above[child] = joint
    (base,) = set(links) - set(above)
    movers = {}

    def place(name):
        """Return the moving joint that a link is fixed to, and the link's pose in it."""
        if name == base:
            return "universe", np.eye(4)
        joint = above[name]
        mover, where = place(one(joint, "parent").get("link"))
        where = where @ pose(joint)
        if joint.get("type") == "fixed":
            return mover, where
        known = joint.get("name")
        assert known
        if known not in movers:
            axis, limit, kind = one(joint, "axis"), one(joint, "limit"), joint.get("type")
            direction = np.array([1.0, 0.0, 0.0]) if axis is None else numbers(axis.attrib["xyz"])
            said = dict.fromkeys(("lower", "upper", "effort", "velocity"), 0.0)
            if limit is not None:
                said |= {key: float(numbers(limit.get(key, "0")).item()) for key in said}
            else:
                assert kind == "continuous"
            assert kind in ("revolute", "continuous", "prismatic")
            if kind == "continuous":
                said |= {"lower": -np.inf, "upper": np.inf}
            said |= {key: said[key] or np.inf for key in ("effort", "velocity")}
            movers[known] = Mover(
                mover, where, direction / np.linalg.norm(direction), kind == "prismatic", list(said.values())
            )
        return known, np.eye(4)

    for name, link in links.items():
        mover, where = place(name)
        inertial = one(link, "inertial")
        if inertial is None or mover == "universe":
            continue
        frame = where @ pose(inertial)
        mass = numbers(one(inertial, "mass").attrib["value"]).item()
        i = {key: numbers(one(inertial, "inertia").attrib[key]).item() for key in ATTRIBUTES["inertia"]}
        own = np.array([[i["ixx"], i["ixy"], i["ixz"]], [i["ixy"], i["iyy"], i["iyz"]], [i["ixz"], i["iyz"], i["izz"]]])
        c, rotation = frame[:3, 3], frame[:3, :3]
        movers[mover].masses.append(mass)
        movers[mover].centres.append(c)
        movers[mover].inertias.append(rotation @ own @ rotation.T + mass * (c @ c * np.eye(3) - np.outer(c, c)))
    return movers


def compare(robot, text):
    """Assert that a robot is what a URDF says. Tolerances are for the rounding of sums of a few dozen terms."""
    movers, model = read(text), robot.model
    assert set(movers) == set(model.names[1:])
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    for index in range(1, model.njoints):
        name = model.names[index]
        mover = movers[name]
        assert model.names[model.parents[index]] == mover.parent
        np.testing.assert_allclose(model.jointPlacements[index].homogeneous, mover.placement, rtol=0, atol=1e-12)
        column = pin.getJointJacobian(model, data, index, pin.LOCAL)[:, index - 1]
        expected = np.concatenate([mover.axis, np.zeros(3)] if mover.prismatic else [np.zeros(3), mover.axis])
        np.testing.assert_allclose(column, expected, rtol=0, atol=1e-12)
        inertia = model.inertias[index]
        mass = sum(mover.masses)
        np.testing.assert_allclose(inertia.mass, mass, rtol=1e-12, atol=0)
        moment = sum((m * c for m, c in zip(mover.masses, mover.centres, strict=True)), start=np.zeros(3))
        scale = max(1e-3, sum(m * np.linalg.norm(c) for m, c in zip(mover.masses, mover.centres, strict=True)))
        np.testing.assert_allclose(inertia.mass * inertia.lever, moment, rtol=0, atol=1e-12 * scale)
        about_joint = inertia.matrix()[3:, 3:]
        total = sum(mover.inertias, start=np.zeros((3, 3)))
        np.testing.assert_allclose(about_joint, total, rtol=0, atol=1e-12 * max(1e-3, np.abs(total).max()))
    for k, name in enumerate(robot.joint_names):
        got = [robot.lower[k], robot.upper[k], robot.effort_limit[k], robot.velocity_limit[k]]
        assert got == movers[name].limits
