"""Rotors of a URDF: motor inertia and gear ratio, which the format itself has no place for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple
from xml.etree import ElementTree as ET

from phcontrol._validation import decimal
from phcontrol.exceptions import RobotDescriptionError
from phcontrol.mechanics.urdf import Urdf

_INERTIAS = ("motor_inertia", "rotor_inertia", "motorInertia", "rotorInertia")
_RATIOS = ("gear_ratio", "mechanicalReduction", "gearRatio")
HIGHEST_RATIO = 1e4
"""Gear ratio beyond which a description is refused."""


class Rotor(NamedTuple):
    """A motor's rotor behind a gear.

    >>> Rotor(4.2e-5, 100.0).armature
    0.42
    """

    inertia: float
    """Of the rotor about its own axis [kg m²]."""
    gear_ratio: float
    """Turns of the motor in one of the joint."""

    @property
    def armature(self) -> float:
        """What it adds to the diagonal of M: inertia · gear_ratio² [kg m²]."""
        return self.inertia * self.gear_ratio**2


def rotors_of(urdf: Urdf) -> dict[str, Rotor]:
    """Return the rotor of each joint that has one in a URDF.

    Read are ``motor_inertia`` and ``gear_ratio`` of a joint's ``<dynamics>`` (Franka's descriptions), and the elements
    of these names, ``rotor_inertia`` (Drake's) or ``mechanicalReduction`` of a ``<transmission>``. A gear ratio alone
    says nothing of inertia, and is passed over.

    Raises RobotDescriptionError for an inertia without a gear ratio, for what is no number, and for a transmission
    between several joints.
    """
    found: dict[str, Rotor] = {}
    moving = {joint.name for joint in urdf.joints if joint.moves}
    for element in ET.fromstring(urdf.text):
        if element.tag == "joint" and element.get("name") in moving:
            dynamics = element.find("dynamics")
            given = {} if dynamics is None else dict(dynamics.attrib)
            _add(found, urdf.label, element.get("name", ""), given)
        elif element.tag == "transmission":
            given = _values(element)
            joints = [joint.get("name", "") for joint in element.iter("joint")]
            if _first(given, _INERTIAS) is None:
                continue
            if len(joints) != 1 or joints[0] not in moving:
                raise RobotDescriptionError(
                    f"{urdf.label}: transmission '{element.get('name')}' has a rotor inertia and must name one moving "
                    f"joint, but names {', '.join(map(repr, joints)) or 'none'}"
                )
            _add(found, urdf.label, joints[0], given)
    return found


def _values(transmission: ET.Element) -> dict[str, str]:
    """Return texts, or the attribute "value", of the elements in a transmission, by name without namespace."""
    return {
        element.tag.rsplit("}", 1)[-1]: element.get("value", element.text or "").strip()
        for element in transmission.iter()
    }


def _first(given: Mapping[str, str], names: tuple[str, ...]) -> tuple[str, str] | None:
    return next(((name, given[name]) for name in names if name in given), None)


def _add(found: dict[str, Rotor], label: str, joint: str, given: Mapping[str, str]) -> None:
    inertia, ratio = _first(given, _INERTIAS), _first(given, _RATIOS)
    if inertia is None:
        return
    if ratio is None:
        raise RobotDescriptionError(
            f"{label}: joint '{joint}' has {inertia[0]} but no gear ratio, without which nothing follows; give "
            f"{_RATIOS[0]}"
        )
    values = []
    for name, text in (inertia, ratio):
        value = decimal(text)
        if value is None or value < 0.0:
            raise RobotDescriptionError(f"{label}: joint '{joint}' has {name}='{text}'; it must be a number >= 0")
        values.append(value)
    if not 0.0 < values[1] <= HIGHEST_RATIO:
        raise RobotDescriptionError(
            f"{label}: joint '{joint}' has the gear ratio {values[1]:g}; it must be > 0, and at most {HIGHEST_RATIO:g} "
            "is believed"
        )
    rotor = Rotor(*values)
    if found.get(joint, rotor) != rotor:
        raise RobotDescriptionError(f"{label}: joint '{joint}' has two rotors: {found[joint]} and {rotor}")
    found[joint] = rotor
