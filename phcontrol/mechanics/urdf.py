"""A URDF, read strictly: what is not understood is refused, and nothing is dropped.

The parser behind Pinocchio goes on without an ``<inertial>`` whose numbers it cannot read, and it overlooks misspelt
names. So a description is read here, every number and every name of it, and what Pinocchio gets is written
anew from what was understood (:func:`canonical`).
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

from phcontrol._validation import decimal
from phcontrol.exceptions import RobotDescriptionError
from phcontrol.mechanics.markup import Element, parse_markup, read_markup

MOVING = ("revolute", "continuous", "prismatic")
UNBOUNDED = 1e6
"""The limits [rad] that continuous joints have in the canonical text, where infinity cannot stand."""

Triple = tuple[float, float, float]

_CHILDREN = {
    "robot": {"link", "joint"},
    "link": {"inertial", "visual", "collision"},
    "inertial": {"origin", "mass", "inertia"},
    "joint": {
        "origin", "parent", "child", "axis", "limit", "position_based_velocity_limits", "dynamics", "mimic",
        "calibration", "safety_controller",
    },
}  # fmt: skip
_ATTRIBUTES = {
    "origin": {"xyz", "rpy"},
    "mass": {"value"},
    "inertia": {"ixx", "iyy", "izz", "ixy", "ixz", "iyz"},
    "parent": {"link"},
    "child": {"link"},
    "axis": {"xyz"},
    # the last three are limits of URDF 1.2, which are not used
    "limit": {"lower", "upper", "effort", "velocity", "acceleration", "deceleration", "jerk"},
    "position_based_velocity_limits": {"velocity_offset", "deceleration_limit"},
    # the last four are a vendor's own, for his simulator; the two before are of rotors
    "dynamics": {"damping", "friction", "gear_ratio", "motor_inertia", "D", "K", "mu_coulomb", "mu_viscous"},
    "mimic": {"joint", "multiplier", "offset"},
}
_NAMES = {name for names in _CHILDREN.values() for name in names} - {"calibration", "safety_controller"}
_REPEATED = {"visual", "collision", "link", "joint"}
_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


@dataclass(frozen=True)
class Inertial:
    """Mass [kg], pose of the centre of mass in the link (xyz [m], rpy [rad]) and moments about it [kg m²]."""

    mass: float
    xyz: Triple
    rpy: Triple
    moments: dict[str, float]
    line: int


@dataclass(frozen=True)
class Link:
    """A link; without ``inertial`` it has no mass."""

    name: str
    inertial: Inertial | None
    line: int


@dataclass(frozen=True)
class Limit:
    """Limits of position [rad, m], effort [N·m, N] and speed [rad/s, m/s]; the last two are 0 where unknown."""

    lower: float
    upper: float
    effort: float
    velocity: float


@dataclass(frozen=True)
class NearStops:
    """How fast a joint may go near its stops: an offset [rad/s] and a deceleration [rad/s²], see ``StopVelocity``."""

    offset: float
    deceleration: float


@dataclass(frozen=True)
class Mimic:
    """q = multiplier · q of ``joint`` + offset."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Joint:
    """A joint; ``axis`` has length one."""

    name: str
    kind: str
    parent: str
    child: str
    xyz: Triple
    rpy: Triple
    axis: Triple
    limit: Limit | None
    near_stops: NearStops | None
    damping: float
    friction: float
    mimic: Mimic | None
    line: int

    @property
    def moves(self) -> bool:
        """Whether it is more than a fixed joint."""
        return self.kind in MOVING


@dataclass(frozen=True)
class Urdf:
    """What a URDF says of a robot's motion; shapes are left in ``text``."""

    label: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    text: str


class Findings:
    """What is wrong with a description, to be said all at once."""

    SHOWN = 20

    def __init__(self, label: str) -> None:
        self._label = label
        self._problems: list[str] = []

    def add(self, line: int, problem: str) -> None:
        """Note a problem of the element in a line."""
        self._problems.append(f"line {line}: {problem}" if line else problem)

    def check(self) -> None:
        """Raise RobotDescriptionError if there is any."""
        if len(self._problems) == 1:
            raise RobotDescriptionError(f"{self._label}, {self._problems[0]}")
        if self._problems:
            shown = "".join(f"\n  {problem}" for problem in self._problems[: self.SHOWN])
            more = len(self._problems) - self.SHOWN
            rest = f"\n  and {more} more" if more > 0 else ""
            raise RobotDescriptionError(f"{self._label}: {len(self._problems)} problems:{shown}{rest}")


def read_urdf(path: Path, label: str, text: str | None = None) -> Urdf:
    """Read a URDF from a file, or from its text; ``label`` is what errors call it.

    Raises RobotDescriptionError, which names all that is wrong.
    """
    root = read_markup(path, label) if text is None else parse_markup(text, label)
    if root.tag != "robot":
        raise RobotDescriptionError(f"{label}: not a URDF: the root element is <{root.tag}>, not <robot>")
    findings = Findings(label)
    reader = _Reader(findings)
    reader.children(root, "the robot")
    elements = [element for element in root if isinstance(element, Element)]
    links = tuple(reader.link(element) for element in elements if element.tag == "link")
    joints = tuple(reader.joint(element) for element in elements if element.tag == "joint")
    findings.check()
    return Urdf(label, links, joints, ET.tostring(root, encoding="unicode"))


def canonical(urdf: Urdf) -> str:
    """Return a URDF for Pinocchio of what was understood, where every joint is one coordinate (n = nq = nv)."""
    return as_text(urdf, continuous="revolute")


def as_text(urdf: Urdf, continuous: str = "continuous") -> str:
    """Return a URDF of what was understood; ``continuous`` is what continuous joints are called. No followers."""
    root = ET.Element("robot", name="robot")
    for link in urdf.links:
        element = ET.SubElement(root, "link", name=link.name)
        if link.inertial is not None:
            inertial = ET.SubElement(element, "inertial")
            _write(inertial, "origin", xyz=link.inertial.xyz, rpy=link.inertial.rpy)
            _write(inertial, "mass", value=(link.inertial.mass,))
            _write(inertial, "inertia", **{name: (value,) for name, value in link.inertial.moments.items()})
    for joint in urdf.joints:
        kind = continuous if joint.kind == "continuous" else joint.kind
        element = ET.SubElement(root, "joint", name=joint.name, type=kind)
        _write(element, "origin", xyz=joint.xyz, rpy=joint.rpy)
        ET.SubElement(element, "parent", link=joint.parent)
        ET.SubElement(element, "child", link=joint.child)
        if not joint.moves:
            continue
        _write(element, "axis", xyz=joint.axis)
        _write(element, "dynamics", damping=(joint.damping,), friction=(joint.friction,))
        limit = joint.limit or Limit(0.0, 0.0, 0.0, 0.0)
        turns = joint.kind == "continuous"
        low, high = (-UNBOUNDED, UNBOUNDED) if turns else (limit.lower, limit.upper)
        _write(element, "limit", lower=(low,), upper=(high,), effort=(limit.effort,), velocity=(limit.velocity,))
    return ET.tostring(root, encoding="unicode")


def _write(parent: ET.Element, tag: str, **values: Iterable[float]) -> None:
    ET.SubElement(parent, tag, {name: " ".join(repr(float(x)) for x in value) for name, value in values.items()})


class _Reader:
    """Reads elements; what it cannot read becomes a finding, with NaN in its place."""

    def __init__(self, findings: Findings) -> None:
        self._findings = findings

    def link(self, element: Element) -> Link:
        name = self._name(element)
        owner = f"link '{name}'"
        found = self.children(element, owner)
        return Link(name, self._inertial(found["inertial"], owner) if "inertial" in found else None, element.line)

    def joint(self, element: Element) -> Joint:
        name = self._name(element)
        owner = f"joint '{name}'"
        found = self.children(element, owner)
        kind = element.get("type", "")
        self._check_kind(element, owner, kind)
        parent, child = (self._end(element, found, tag, owner) for tag in ("parent", "child"))
        xyz, rpy = self._pose(found.get("origin"), owner)
        moves = kind in MOVING
        return Joint(
            name=name,
            kind=kind,
            parent=parent,
            child=child,
            xyz=xyz,
            rpy=rpy,
            axis=self._axis(found.get("axis"), owner) if moves else (1.0, 0.0, 0.0),
            limit=self._limit(element, found.get("limit"), owner, kind) if moves else None,
            near_stops=self._near_stops(found.get("position_based_velocity_limits"), owner) if moves else None,
            damping=self._friction(found.get("dynamics"), "damping", owner) if moves else 0.0,
            friction=self._friction(found.get("dynamics"), "friction", owner) if moves else 0.0,
            mimic=self._mimic(found["mimic"], owner) if moves and "mimic" in found else None,
            line=element.line,
        )

    def children(self, element: Element, owner: str) -> dict[str, Element]:
        """Return the children that are read, by name; refuse misspelt, misplaced and repeated ones."""
        known, found = _CHILDREN[element.tag], {}
        for child in element:
            assert isinstance(child, Element)
            tag = child.tag
            if tag not in known:
                self._check_unknown(element, child, owner)
                continue
            if tag in found and tag not in _REPEATED:
                self._findings.add(child.line, f"{owner} has a second <{tag}>; only one can hold")
            found[tag] = child
            if tag not in _ATTRIBUTES:
                continue
            for inner in child:
                self._findings.add(
                    child.line, f"{owner}: <{tag}> holds an element <{inner.tag}>; nothing is read there"
                )
            for name in child.attrib:
                if name not in _ATTRIBUTES[tag] and ":" not in name:
                    listing = ", ".join(sorted(_ATTRIBUTES[tag]))
                    self._findings.add(child.line, f"{owner}: <{tag}> has no attribute '{name}'; it may have {listing}")
        return found

    def _check_unknown(self, element: Element, child: Element, owner: str) -> None:
        """Let pass what other programs add; refuse what looks as if it should be read."""
        near = difflib.get_close_matches(child.tag.lower(), _NAMES, n=1, cutoff=0.75)
        if element.tag == "robot":
            near = [name for name in near if name in ("link", "joint")]
        if near or element.tag == "inertial":
            listing = ", ".join(f"<{name}>" for name in sorted(_CHILDREN[element.tag]))
            self._findings.add(
                child.line,
                f"{owner} has an element <{child.tag}>, which would be overlooked there; what is read in "
                f"<{element.tag}>: {listing}",
            )

    def _name(self, element: Element) -> str:
        name = element.get("name", "")
        if not name:
            self._findings.add(element.line, f"a <{element.tag}> has no name")
        return name

    def _check_kind(self, element: Element, owner: str, kind: str) -> None:
        if kind in ("floating", "planar"):
            self._findings.add(
                element.line,
                f"{owner} is {kind}; phcontrol controls fixed-base arms of revolute, continuous and prismatic joints",
            )
        elif kind != "fixed" and kind not in MOVING:
            listing = ", ".join(("fixed", *MOVING))
            self._findings.add(element.line, f"{owner} has the unknown type '{kind}'; there are {listing}")

    def _end(self, element: Element, found: dict[str, Element], tag: str, owner: str) -> str:
        link = found[tag].get("link", "") if tag in found else ""
        if not link:
            self._findings.add(element.line, f'{owner} has no {tag} link; give <{tag} link="..."/>')
        return link

    def _inertial(self, element: Element, owner: str) -> Inertial:
        found = self.children(element, owner)
        for tag in ("mass", "inertia"):
            if tag not in found:
                self._findings.add(element.line, f"{owner}: its <inertial> has no <{tag}>, and would be dropped")
        xyz, rpy = self._pose(found.get("origin"), owner)
        mass = self._number(found["mass"], "value", owner) if "mass" in found else math.nan
        inertia = found.get("inertia")
        moments = {} if inertia is None else {name: self._number(inertia, name, owner) for name in _MOMENTS}
        return Inertial(mass, xyz, rpy, moments, element.line)

    def _pose(self, element: Element | None, owner: str) -> tuple[Triple, Triple]:
        return self._triple(element, "xyz", owner), self._triple(element, "rpy", owner)

    def _axis(self, element: Element | None, owner: str) -> Triple:
        if element is None:
            return 1.0, 0.0, 0.0
        if "xyz" not in element.attrib:
            self._findings.add(element.line, f'{owner}: <axis> has no xyz, such as xyz="0 0 1"')
        axis = self._triple(element, "xyz", owner)
        length = math.hypot(*axis)
        if length < 1e-3:
            self._findings.add(
                element.line, f'{owner}: <axis xyz="{element.get("xyz")}"> is no direction; give one such as "0 0 1"'
            )
            return axis
        return axis[0] / length, axis[1] / length, axis[2] / length

    def _limit(self, joint: Element, element: Element | None, owner: str, kind: str) -> Limit | None:
        if element is None:
            if kind != "continuous":
                self._findings.add(
                    joint.line,
                    f'{owner} has no limits; give <limit lower="..." upper="..." effort="..." velocity="..."/>',
                )
            return None
        lower, upper = (self._number(element, name, owner, default=0.0) for name in ("lower", "upper"))
        effort, velocity = (
            self._number(element, name, owner, advice='; "0" says that no limit is known')
            for name in ("effort", "velocity")
        )
        if lower > upper:
            self._findings.add(
                element.line, f"{owner} has the lower limit {lower:g} and the upper limit {upper:g}; exchange them?"
            )
        for name, value in (("effort", effort), ("velocity", velocity)):
            if value < 0.0:
                self._findings.add(element.line, f"{owner} has the {name} limit {value:g}; it must not be negative")
        return Limit(lower, upper, effort, velocity)

    def _near_stops(self, element: Element | None, owner: str) -> NearStops | None:
        if element is None:
            return None
        offset, deceleration = (
            self._number(element, name, owner) for name in ("velocity_offset", "deceleration_limit")
        )
        if offset < 0.0:
            self._findings.add(element.line, f"{owner} has the velocity_offset {offset:g}; it must not be negative")
        if deceleration <= 0.0:
            self._findings.add(
                element.line, f"{owner} has the deceleration_limit {deceleration:g}; it must be above zero"
            )
        return NearStops(offset, deceleration)

    def _friction(self, element: Element | None, name: str, owner: str) -> float:
        value = 0.0 if element is None else self._number(element, name, owner, default=0.0)
        if element is not None and value < 0.0:
            self._findings.add(element.line, f"{owner} has the {name} {value:g}; it must not be negative")
        return value

    def _mimic(self, element: Element, owner: str) -> Mimic:
        leader = element.get("joint", "")
        if not leader:
            self._findings.add(element.line, f'{owner}: <mimic> has no leader; give joint="..."')
        multiplier = self._number(element, "multiplier", owner, default=1.0)
        return Mimic(leader, multiplier, self._number(element, "offset", owner, default=0.0))

    def _triple(self, element: Element | None, name: str, owner: str) -> Triple:
        if element is None or name not in element.attrib:
            return 0.0, 0.0, 0.0
        text = element.attrib[name]
        values = [decimal(part) for part in text.split()]
        if len(values) == 3 and None not in values:
            x, y, z = (math.nan if value is None else value for value in values)
            return x, y, z
        self._findings.add(
            element.line,
            f'{owner}: <{element.tag} {name}="{text}"> must be three decimal numbers with spaces between them, '
            'such as "0 0.5 1e-3"',
        )
        return math.nan, math.nan, math.nan

    def _number(
        self, element: Element, name: str, owner: str, *, default: float | None = None, advice: str = ""
    ) -> float:
        text = element.get(name)
        if text is None and default is not None:
            return default
        value = None if text is None else decimal(text)
        if value is not None:
            return value
        if text is None:
            self._findings.add(element.line, f'{owner}: <{element.tag}> has no {name}; give {name}="..."{advice}')
        else:
            self._findings.add(
                element.line,
                f'{owner}: <{element.tag} {name}="{text}"> must be one decimal number such as 0.85 or 1e-3, '
                f"finite, with a point and without a unit{advice}",
            )
        return math.nan
