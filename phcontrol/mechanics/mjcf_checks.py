"""What of MuJoCo's XML an arm of phcontrol cannot have, and what would be dropped."""

from __future__ import annotations

from collections.abc import Mapping

from phcontrol._validation import decimal
from phcontrol.mechanics.markup import Element
from phcontrol.mechanics.mjcf_defaults import Defaults
from phcontrol.mechanics.urdf import Findings

_REFUSED_SECTIONS = {
    "include": "is not followed; put the file's content in its place",
    "deformable": "deformable bodies are no part of an arm",
    "extension": "plugins are not run",
}
_BODY = {"body", "inertial", "joint", "geom", "site", "camera", "light", "freejoint"}
_JOINT = {
    "name", "class", "type", "group", "pos", "axis", "springdamper", "limited", "actuatorfrclimited", "solreflimit",
    "solimplimit", "solreffriction", "solimpfriction", "stiffness", "range", "actuatorfrcrange", "actuatorgravcomp",
    "margin", "ref", "springref", "armature", "damping", "frictionloss", "user",
}  # fmt: skip
_INERTIAL = {"pos", "quat", "axisangle", "xyaxes", "zaxis", "euler", "mass", "diaginertia", "fullinertia"}
_SHAPES = {"sphere", "capsule", "cylinder", "box", "ellipsoid"}
_COMPILER = {
    "settotalmass": "-1", "boundmass": "0", "boundinertia": "0", "balanceinertia": "false", "inertiafromgeom": "auto",
    "inertiagrouprange": "0 5", "coordinate": "local", "alignfree": "false",
}  # fmt: skip
_DISABLED = ("gravity", "frictionloss", "passive", "damper")
_GRAVITY = (0.0, 0.0, -9.81)


def check_elements(root: Element, defaults: Defaults, findings: Findings, locked: frozenset[str]) -> None:
    """Note everything in an MJCF that would be dropped, or that no arm of phcontrol has, as a finding."""
    for section in root:
        assert isinstance(section, Element)
        if section.tag in _REFUSED_SECTIONS:
            findings.add(section.line, f"<{section.tag}>: {_REFUSED_SECTIONS[section.tag]}")
        elif section.tag == "compiler":
            _check_compiler(section, findings)
        elif section.tag == "option":
            _check_option(section, findings)
        elif section.tag == "worldbody":
            _check_bodies(section, defaults, findings)
    for section in root:
        if section.tag in ("equality", "tendon"):
            for element in section:
                assert isinstance(element, Element)
                _check_constraint(section.tag, element, findings, locked)


def _check_compiler(compiler: Element, findings: Findings) -> None:
    for name, default in _COMPILER.items():
        value = compiler.get(name, default)
        if value != default and not (_numbers(value) and _numbers(value) == _numbers(default)):
            findings.add(compiler.line, f"<compiler {name}='{value}'> would be overlooked; it must be '{default}'")


def _check_option(option: Element, findings: Findings) -> None:
    gravity = _numbers(option.get("gravity", "0 0 -9.81"))
    if gravity != list(_GRAVITY):
        findings.add(
            option.line,
            f"<option gravity='{option.get('gravity')}'> would be overlooked; take it out, and give "
            "MechanicalSystem(..., gravity=...)",
        )
    for name in ("density", "viscosity", "wind"):
        if any(value != 0.0 for value in _numbers(option.get(name, "0")) or [1.0]):
            findings.add(option.line, f"<option {name}='{option.get(name)}'> would be overlooked: no medium drags here")
    for flag in option.iter("flag"):
        for name in _DISABLED:
            if flag.get(name, "enable") != "enable":
                findings.add(option.line, f"<flag {name}='{flag.get(name)}'> would be overlooked")


def _check_bodies(world: Element, defaults: Defaults, findings: Findings) -> None:
    with_inertial = {id(body) for item, _, body in defaults.inside(world) if item.tag == "inertial"}
    for element, given, body in defaults.inside(world):
        where, inside = _owner(element), _owner(body)
        if element.tag not in _BODY:
            findings.add(
                element.line, f"{inside} holds <{element.tag}>, which is not followed; write out what it makes"
            )
        elif element.tag == "freejoint":
            findings.add(element.line, f"{inside} is free to float; phcontrol controls arms on a fixed base")
        elif element.tag == "joint":
            _check_joint(element, given, findings)
        elif element.tag == "inertial":
            _check_known(element, _INERTIAL, f"<inertial> of {inside}", findings)
        elif element.tag == "body":
            _check_body(element, where, findings)
        elif element.tag == "geom" and body.tag == "body" and id(body) not in with_inertial:
            _check_mass(element, given, inside, findings)


def _check_body(body: Element, where: str, findings: Findings) -> None:
    if not body.get("name"):
        findings.add(body.line, "a <body> has no name")
    if _nonzero(body.get("gravcomp")):
        findings.add(
            body.line, f"{where}: gravcomp='{body.get('gravcomp')}' would be overlooked; laws compensate weight"
        )
    if body.get("mocap", "false") != "false":
        findings.add(body.line, f"{where} is moved by mocap data, which an arm is not")
    joints = [element for element in body if element.tag == "joint"]
    if len(joints) > 1:
        findings.add(body.line, f"{where} has {len(joints)} joints; give each a body of its own")


def _check_joint(joint: Element, given: Mapping[str, str], findings: Findings) -> None:
    where = _owner(joint)
    if not joint.get("name"):
        findings.add(joint.line, "a <joint> has no name")
    _check_known(joint, _JOINT, where, findings)
    kind = given.get("type", "hinge")
    if kind in ("ball", "free"):
        findings.add(joint.line, f"{where} is a {kind} joint; phcontrol controls arms of hinge and slide joints")
    elif kind not in ("hinge", "slide"):
        findings.add(joint.line, f"{where} has the unknown type '{kind}'")
    if _nonzero(given.get("stiffness")) or "springdamper" in given:
        name = "stiffness" if "stiffness" in given else "springdamper"
        findings.add(
            joint.line,
            f"{where}: {name}='{given[name]}' would be dropped; springs are potentials of a MechanicalSystem",
        )
    for name in ("armature", "damping", "frictionloss"):
        values = _numbers(given.get(name, "0"))
        if values is None or len(values) != 1 or values[0] < 0.0:
            findings.add(joint.line, f"{where}: {name}='{given[name]}' must be one number >= 0")


def _check_mass(geom: Element, given: Mapping[str, str], where: str, findings: Findings) -> None:
    """Note shapes that give a body its mass where that cannot be followed."""
    name = "mass" if "mass" in given else "density"
    if not _nonzero(given.get(name, "1000")):
        return
    shape = given.get("type", "mesh" if "mesh" in given else "sphere")
    if shape not in _SHAPES or "mesh" in given:
        findings.add(geom.line, f"{where} has its mass from a {shape}; give it an <inertial>")
    if given.get("shellinertia", "false") != "false":
        findings.add(geom.line, f"{where} has its mass from a shell; give it an <inertial>")


def _check_constraint(section: str, element: Element, findings: Findings, locked: frozenset[str]) -> None:
    if element.get("active", "true") == "false":
        return
    names = [element.get(key) for key in ("joint1", "joint2") if key in element.attrib]
    names += [inner.get("joint") for inner in element.iter("joint") if inner is not element]
    if names and all(name in locked for name in names):
        return
    kind = "constraint" if section == "equality" else "tendon"
    label = f"{kind} <{element.tag}>" + (f" '{element.get('name')}'" if element.get("name") else "")
    free = [name for name in names if name not in locked]
    between = f" of {', '.join(map(str, free))}" if free else ""
    advice = f"; lock them (locked_joints=[{', '.join(map(repr, free))}]), or take it out" if free else "; take it out"
    findings.add(element.line, f"{label}{between} would be dropped{advice}")


def _check_known(element: Element, known: set[str], where: str, findings: Findings) -> None:
    for name in element.attrib:
        if name not in known:
            findings.add(element.line, f"{where} has no attribute '{name}'; it may have {', '.join(sorted(known))}")


def _owner(element: Element) -> str:
    return "the world" if element.tag == "worldbody" else f"{element.tag} '{element.get('name', '')}'"


def _numbers(text: str) -> list[float] | None:
    values = [decimal(part) for part in text.split()]
    return None if None in values or not values else [float(value or 0.0) for value in values]


def _nonzero(text: str | None) -> bool:
    """Return whether a text is there and does not say zero."""
    return text is not None and any(value != 0.0 for value in _numbers(text) or [1.0])
