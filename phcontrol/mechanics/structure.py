"""Whether the links and joints of a description make one tree."""

from __future__ import annotations

from collections import Counter

from phcontrol.exceptions import nearest
from phcontrol.mechanics.urdf import Findings, Joint, Urdf

MOST_JOINTS = 128
"""Joints that move. Pinocchio's workspace takes 63 bytes times the cube of their number: 130 MB for 128 joints,
1.7 GB for 300."""
MOST_LINKS = 2000
"""Pinocchio descends a tree by recursion."""


def check_tree(urdf: Urdf) -> None:
    """Raise RobotDescriptionError unless names are unique and all links hang on one root, each by one joint."""
    findings = Findings(urdf.label)
    moving = sum(joint.moves for joint in urdf.joints)
    if not urdf.links:
        findings.add(0, "has no link")
    elif not moving:
        findings.add(0, "has no moving joint")
    if moving > MOST_JOINTS:
        findings.add(0, f"has {moving} moving joints; an arm of phcontrol has at most {MOST_JOINTS}: fix some of them")
    if len(urdf.links) > MOST_LINKS:
        findings.add(0, f"has {len(urdf.links)} links; an arm of phcontrol has at most {MOST_LINKS}")
    findings.check()
    _check_names(urdf, findings)
    findings.check()
    _check_parents(urdf, findings)
    findings.check()


def _check_names(urdf: Urdf, findings: Findings) -> None:
    for kind, items in (("link", urdf.links), ("joint", urdf.joints)):
        counts = Counter(item.name for item in items)
        for item in items:
            if counts[item.name] > 1:
                findings.add(item.line, f"{kind} '{item.name}' is one of {counts[item.name]} of that name")
    links = {link.name for link in urdf.links}
    joints = {joint.name for joint in urdf.joints}
    for joint in urdf.joints:
        for end, name in (("parent", joint.parent), ("child", joint.child)):
            if name not in links:
                findings.add(
                    joint.line, f"joint '{joint.name}' has the {end} '{name}', which is no link{_near(name, links)}"
                )
        if joint.mimic is not None and joint.mimic.joint not in joints:
            leader = joint.mimic.joint
            findings.add(
                joint.line,
                f"joint '{joint.name}' mimics '{leader}', which is no joint it can follow{_near(leader, joints)}",
            )


def _near(name: str, known: set[str]) -> str:
    close = nearest(name, known)
    return f"; did you mean '{close}'?" if close else ""


def _check_parents(urdf: Urdf, findings: Findings) -> None:
    above: dict[str, Joint] = {}
    for joint in urdf.joints:
        if joint.child in above:
            findings.add(
                joint.line,
                f"link '{joint.child}' is the child of two joints, '{above[joint.child].name}' and '{joint.name}'; "
                "phcontrol controls trees, where each link hangs on one",
            )
        above[joint.child] = joint
    roots = [link for link in urdf.links if link.name not in above]
    if len(roots) > 1:
        listing = ", ".join(f"'{root.name}' (line {root.line})" for root in roots)
        findings.add(0, f"{len(roots)} links hang on no joint, and one, the base, may: {listing}")
    findings.check()
    loop = _loop(urdf, above)
    if loop:
        listing = ", ".join(f"'{joint.name}' (line {joint.line})" for joint in loop)
        findings.add(0, f"joints make a loop: {listing}; phcontrol controls trees")


def _loop(urdf: Urdf, above: dict[str, Joint]) -> list[Joint]:
    """Return the joints of a loop, or none. Each link is walked past once."""
    ended: set[str] = set()
    for link in urdf.links:
        path: dict[str, Joint] = {}
        name = link.name
        while name in above and name not in ended and name not in path:
            path[name] = above[name]
            name = above[name].parent
        if name in path:
            joints = list(path.values())
            return joints[list(path).index(name) :]
        ended.update(path)
    return []
