"""Whether bodies like those of a description can exist, and whether its numbers are in SI units."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from phcontrol.mechanics.urdf import Findings, Inertial, Link, Urdf

HEAVIEST, LONGEST = 1e6, 1e4
"""Mass [kg] and length [m] beyond which a description is refused."""
LARGE = 30.0
"""Length or radius of gyration [m] and angle of a joint's limit [rad] beyond which units are doubted."""
ROUNDING = 1e-3
"""Part of the largest principal moment by which the digits of a file may contradict the laws below."""
GROSS = 0.5
"""Part of the largest principal moment by which the other two may fall short of it. Arms in use fall short
by 0.09 (PSYONIC hand) and 0.20 (Allegro hand); a misplaced decimal point gives more."""


def check_bodies(urdf: Urdf) -> None:
    """Raise RobotDescriptionError for links that cannot exist, and lengths and angles beyond all arms.

    Of principal moments I₁ ≤ I₂ ≤ I₃ of a body none is negative, and I₃ ≤ I₁ + I₂. Links that are fixed to the base
    are not looked at: they are in no equation of motion.
    """
    findings = Findings(urdf.label)
    for joint in urdf.joints:
        for name, values, most in (("xyz", joint.xyz, LONGEST), ("rpy", joint.rpy, LONGEST)):
            if max(map(abs, values)) > most:
                findings.add(
                    joint.line, f"joint '{joint.name}' has the {name} {_listed(values)}; at most {most:g} is believed"
                )
    for link, inertial in _moving_bodies(urdf):
        problem = _impossible(inertial)
        if problem:
            findings.add(inertial.line, f"link '{link.name}' {problem}")
    findings.check()


def doubts(urdf: Urdf) -> Iterator[str]:
    """Yield what is implausible without being impossible: it is used as given, but said."""
    found: dict[str, list[str]] = {}
    for doubt, where, line in _doubts(urdf):
        found.setdefault(doubt, []).append(f"{where} (line {line})")
    for doubt, places in found.items():
        yield f"{', '.join(places)}: {doubt}"


def _doubts(urdf: Urdf) -> Iterator[tuple[str, str, int]]:
    for link, inertial in _moving_bodies(urdf):
        small, middle, large = _principal_moments(inertial)
        where, line = f"link '{link.name}'", inertial.line
        if large - middle - small > ROUNDING * large:
            yield (
                "the largest principal moment of inertia is larger than the sum of the others "
                f"(by {(large - middle - small) / large:.0%} of itself), which is so in no rigid body. It is used as "
                "given; correct the description",
                where,
                line,
            )
        if large > inertial.mass * LARGE**2:
            yield f"the radius of gyration is more than {LARGE:g} m: are the moments in kg mm²?", where, line
        if max(map(abs, inertial.xyz)) > LARGE:
            yield f"the centre of mass is more than {LARGE:g} m away: is it in mm?", where, line
    for joint in urdf.joints:
        where, line, limit = f"joint '{joint.name}'", joint.line, joint.limit
        if max(map(abs, joint.xyz)) > LARGE:
            yield f"the origin is more than {LARGE:g} m away: is it in mm?", where, line
        if max(map(abs, joint.rpy)) > 2.001 * math.pi:
            yield "an angle of the origin is more than a turn: is it in degrees?", where, line
        if limit is None or joint.kind == "continuous" or joint.mimic is not None:
            continue
        if limit.lower == limit.upper:
            yield "the lower and the upper limit are the same: it cannot move, or should be continuous", where, line
        if joint.kind == "revolute" and LARGE < max(-limit.lower, limit.upper) <= 360.0:
            yield f"a limit is more than {LARGE:g} rad: is it in degrees?", where, line


def _impossible(inertial: Inertial) -> str:
    """Return what makes a body impossible, or nothing."""
    small, middle, large = _principal_moments(inertial)
    if inertial.mass < 0.0:
        return f"has mass {inertial.mass:g} kg; it must not be negative"
    if inertial.mass > HEAVIEST:
        return f"has mass {inertial.mass:g} kg; at most {HEAVIEST:g} kg is believed"
    if max(map(abs, inertial.xyz)) > LONGEST or max(map(abs, inertial.rpy)) > LONGEST:
        pose = f"xyz {_listed(inertial.xyz)} and rpy {_listed(inertial.rpy)}"
        return f"has its centre of mass at {pose}; at most {LONGEST:g} is believed"
    if small < -ROUNDING * large:
        return f"has the principal moments of inertia {_listed((small, middle, large))} kg m²; none may be negative"
    if large > HEAVIEST * LONGEST:
        return f"has the moment of inertia {large:g} kg m²; at most {HEAVIEST * LONGEST:g} kg m² is believed"
    if inertial.mass == 0.0 and large > 0.0:
        return f"has no mass, but the moment of inertia {large:g} kg m²; give its mass, or no moments"
    if large - middle - small > GROSS * large:
        return (
            f"has the principal moments of inertia {_listed((small, middle, large))} kg m²; in a rigid body the "
            "largest is at most the sum of the others. Is a decimal point misplaced? A thin plate has ixx + iyy = izz"
        )
    return ""


def _principal_moments(inertial: Inertial) -> tuple[float, float, float]:
    i = inertial.moments
    matrix = [[i["ixx"], i["ixy"], i["ixz"]], [i["ixy"], i["iyy"], i["iyz"]], [i["ixz"], i["iyz"], i["izz"]]]
    small, middle, large = np.linalg.eigvalsh(np.array(matrix))
    return float(small), float(middle), float(large)


def _moving_bodies(urdf: Urdf) -> Iterator[tuple[Link, Inertial]]:
    above = {joint.child: joint for joint in urdf.joints}
    for link in urdf.links:
        name, moves = link.name, False
        while name in above and not moves:
            name, moves = above[name].parent, above[name].moves
        if moves and link.inertial is not None:
            yield link, link.inertial


def _listed(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:.6g}" for value in values)
