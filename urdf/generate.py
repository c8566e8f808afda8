"""Write the URDF of every robot in ``robots.toml``. Run it after changing a number there.

``python urdf/generate.py`` writes the files; ``python urdf/generate.py --check`` only compares.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

HERE = Path(__file__).parent
COLORS = {
    "white": "0.92 0.92 0.90 1",
    "grey": "0.55 0.57 0.60 1",
    "dark": "0.18 0.20 0.23 1",
    "orange": "0.90 0.45 0.10 1",
}
NO_ROTATION = [0.0, 0.0, 0.0]


def main() -> int:
    """Write or check every URDF; the exit code is 1 when a checked file is not up to date."""
    stale = []
    table = tomllib.loads((HERE / "robots.toml").read_text())
    for name, robot in table.items():
        if "extends" in robot:
            robot = extended(table[robot["extends"]], robot)
        path, text = HERE / f"{name}.urdf", urdf(name, robot)
        if "--check" not in sys.argv:
            path.write_text(text)
        elif not path.exists() or path.read_text() != text:
            stale.append(path.name)
    if stale:
        print(f"not up to date: {', '.join(stale)}; run python urdf/generate.py", file=sys.stderr)
    return 1 if stale else 0


def extended(base: dict[str, Any], robot: dict[str, Any]) -> dict[str, Any]:
    """Return a robot that has the parts of another and more of its own; ``bare_links`` lose their shapes."""
    joints = [joint | ({"visuals": []} if joint["link"] in robot["bare_links"] else {}) for joint in base["joints"]]
    parts = {key: base.get(key, []) + robot.get(key, []) for key in ("visuals", "frames", "frame_visuals", "followers")}
    return base | robot | parts | {"joints": joints + robot["joints"]}


def urdf(name: str, robot: dict[str, Any]) -> str:
    """Return the URDF document of one robot of the table."""
    root = ET.Element("robot", name=name)
    root.append(ET.Comment(f" {robot['title']}. Generated from robots.toml: do not edit. "))
    for color, rgba in COLORS.items():
        ET.SubElement(ET.SubElement(root, "material", name=color), "color", rgba=rgba)
    visuals = robot.get("visuals", []) + robot.get("frame_visuals", [])
    _link(root, "base", visuals)
    parent = "base"
    for joint in robot["joints"]:
        _link(root, joint["link"], visuals, joint)
        _joint(root, joint, parent, "revolute")
        parent = joint["link"]
    for follower in robot.get("followers", []):
        _link(root, follower["link"], visuals, follower)
        _joint(root, follower, follower["parent"], "revolute", robot["joints"])
    for frame in robot.get("frames", []):
        _link(root, frame["name"], visuals)
        _joint(root, frame | {"name": f"{frame['name']}_joint", "link": frame["name"]}, frame["parent"], "fixed")
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _link(root: ET.Element, name: str, visuals: list[dict[str, Any]], body: dict[str, Any] | None = None) -> None:
    link = ET.SubElement(root, "link", name=name)
    body = body or {}
    if "mass" in body:
        inertial = ET.SubElement(link, "inertial")
        _origin(inertial, [*body.get("centre_of_mass", [0.0, 0.0, 0.0]), *NO_ROTATION])
        ET.SubElement(inertial, "mass", value=_text(body["mass"]))
        moments = dict.fromkeys(("ixx", "iyy", "izz"), _text(body["inertia"]))
        ET.SubElement(inertial, "inertia", moments | dict.fromkeys(("ixy", "ixz", "iyz"), "0"))
    for visual in body.get("visuals", []) + [v for v in visuals if v["link"] == name]:
        element = ET.SubElement(link, "visual")
        _origin(element, [*visual.get("xyz", [0.0, 0.0, 0.0]), *visual.get("rpy", NO_ROTATION)])
        sizes = {key: _text(visual[key]) for key in ("size", "radius", "length") if key in visual}
        ET.SubElement(ET.SubElement(element, "geometry"), visual["shape"], sizes)
        ET.SubElement(element, "material", name=visual["color"])


def _joint(
    root: ET.Element,
    joint: dict[str, Any],
    parent: str,
    kind: str,
    leaders: list[dict[str, Any]] | None = None,
) -> None:
    element = ET.SubElement(root, "joint", name=joint["name"], type=kind)
    _origin(element, joint["origin"])
    ET.SubElement(element, "parent", link=parent)
    ET.SubElement(element, "child", link=joint["link"])
    if kind == "fixed":
        return
    ET.SubElement(element, "axis", xyz=_text(joint.get("axis", [0.0, 0.0, 1.0])))
    limits = joint
    if leaders:
        leader = next(item for item in leaders if item["name"] == joint["follows"])
        gain = joint["multiplier"]
        scaled = sorted(gain * bound for bound in leader["limits"])
        limits = {"limits": scaled, "effort": 0.0, "velocity": abs(gain) * leader["velocity"]}
        ET.SubElement(element, "mimic", joint=joint["follows"], multiplier=_text(gain))
    else:
        ET.SubElement(element, "dynamics", damping=_text(joint["viscous"]), friction=_text(joint["coulomb"]))
    lower, upper = limits["limits"]
    bounds = {"lower": lower, "upper": upper, "effort": limits["effort"], "velocity": limits["velocity"]}
    ET.SubElement(element, "limit", {key: _text(value) for key, value in bounds.items()})


def _origin(parent: ET.Element, pose: list[float]) -> None:
    ET.SubElement(parent, "origin", xyz=_text(pose[:3]), rpy=_text(pose[3:]))


def _text(value: float | list[float]) -> str:
    return " ".join(repr(float(number)) for number in (value if isinstance(value, list) else [value]))


if __name__ == "__main__":
    sys.exit(main())
