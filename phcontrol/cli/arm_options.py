"""The options that make an arm of a description."""

from __future__ import annotations

import shlex
from dataclasses import dataclass

import numpy as np
import typer

from phcontrol._validation import decimal
from phcontrol.cli.option_group import OptionGroup
from phcontrol.cli.options import ArmatureOption, LockOption, PayloadOption, RotorOption
from phcontrol.cli.texts import by_joint
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.payload import Payload
from phcontrol.mechanics.system import MechanicalSystem


@dataclass(frozen=True)
class ArmOptions(OptionGroup):
    """What is locked, what its motors add, what it carries."""

    lock: LockOption = None
    armature: ArmatureOption = None
    payload: PayloadOption = None
    rotor_inertia: RotorOption = False

    def system(self, robot: str) -> MechanicalSystem:
        """Return the arm of this description; say what rotors add."""
        rotors = None if self.armature is None else by_joint("--armature", self.armature)
        loaded = load_robot(
            robot,
            locked_joints=self.lock or [],
            armature=rotors[0] if isinstance(rotors, list) and len(rotors) == 1 else rotors,
            rotor_inertia=self.rotor_inertia,
            payload=[payload_of(text) for text in self.payload or []],
        )
        if loaded.rotors:
            added = ", ".join(f"{joint} {rotor.armature:.3g}" for joint, rotor in loaded.rotors.items())
            typer.echo(f"rotors add to the diagonal of M [kg m²]: {added}", err=True)
        return MechanicalSystem(loaded)

    @property
    def given(self) -> list[str]:
        """The options that were given, as they are written on the command line."""
        words = [f"--lock {shlex.quote(joint)}" for joint in self.lock or []]
        words += [] if self.armature is None else [f"--armature {shlex.quote(self.armature)}"]
        words += [f"--payload {shlex.quote(body)}" for body in self.payload or []]
        return words + ["--rotor-inertia"] * self.rotor_inertia


AS_DESCRIBED = ArmOptions()
"""The arm as its description has it."""


def payload_of(text: str) -> Payload:
    """Return what a --payload means: "1.5", or "mass=1.5,com=0 0 0.05,inertia=0.01 0.01 0.01,frame=hand"."""
    wrong = InvalidArgumentError(
        "--payload",
        f"must be a mass [kg], or pairs like mass=1,com=0 0 0.05,inertia=0.01 0.01 0.01,frame=hand, but is '{text}'",
    )
    pairs = [pair.partition("=") for pair in (text if "=" in text else f"mass={text}").split(",")]
    given = {name.strip(): value.strip() for name, _, value in pairs}
    if len(given) < len(pairs) or "mass" not in given or not given.keys() <= {"mass", "com", "inertia", "frame"}:
        raise wrong
    frame = given.pop("frame", None)
    numbers = {name: [decimal(part) for part in value.split()] for name, value in given.items()}
    lengths = {"mass": (1,), "com": (3,), "inertia": (3, 9)}
    if any(len(values) not in lengths[name] or None in values for name, values in numbers.items()):
        raise wrong
    mass, inertia = numbers["mass"][0], np.array(numbers.get("inertia", [0.0, 0.0, 0.0]), dtype=float)
    assert mass is not None
    com = np.array(numbers.get("com", [0.0, 0.0, 0.0]), dtype=float)
    return Payload(mass, com, inertia if inertia.size == 3 else inertia.reshape(3, 3), frame)
