"""The arm that options name, and goals for it."""

from __future__ import annotations

import numpy as np
import typer

from phcontrol._validation import Array, decimal
from phcontrol.cli.texts import by_joint
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.payload import Payload
from phcontrol.mechanics.robot import check_joint_names
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.trajectories import inverse_kinematics


def system_of(
    robot: str,
    lock: list[str] | None,
    armature: str | None,
    payload: list[str] | None = None,
    rotor_inertia: bool = False,
) -> MechanicalSystem:
    """Return the arm that --robot, --lock, --armature, --payload and --rotor-inertia name; say what rotors add."""
    rotors = None if armature is None else by_joint("--armature", armature)
    loaded = load_robot(
        robot,
        locked_joints=lock or [],
        armature=rotors[0] if isinstance(rotors, list) and len(rotors) == 1 else rotors,
        rotor_inertia=rotor_inertia,
        payload=[payload_of(text) for text in payload or []],
    )
    if loaded.rotors:
        added = ", ".join(f"{joint} {rotor.armature:.3g}" for joint, rotor in loaded.rotors.items())
        typer.echo(f"rotors add to the diagonal of M [kg m²]: {added}", err=True)
    return MechanicalSystem(loaded)


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


def goal_of(system: MechanicalSystem, goal: str | None, target: str | None, frame: str | None) -> Array | None:
    """Return the joint positions that --goal or --reach asks for; None for neither."""
    robot = system.robot
    if target is None:
        if frame is not None:
            raise InvalidArgumentError("--frame", "is the frame of --reach, which is not given")
        if goal is None:
            return None
        posture = robot.position(by_joint("--goal", goal), "--goal")
        for joint in ((posture < robot.lower) | (posture > robot.upper)).nonzero()[0]:
            typer.echo(
                f"note: --goal puts joint '{robot.joint_names[joint]}' at {posture[joint]:g}, outside its limits "
                f"{robot.lower[joint]:g} to {robot.upper[joint]:g}",
                err=True,
            )
        return posture
    if goal is not None:
        raise InvalidArgumentError("--reach", "and --goal are two goals: give one of them")
    point = by_joint("--reach", target)
    if isinstance(point, dict) or len(point) != 3:
        raise InvalidArgumentError("--reach", f"must be a point x,y,z in metres, but is '{target}'")
    name = frame or robot.tool_frame or robot.frame_names[-1]
    return inverse_kinematics.reach(robot, name, point).position


def joint_values(system: MechanicalSystem, option: str, text: str) -> list[float]:
    """Return one number a joint; joints that pairs do not name get 0."""
    values = by_joint(option, text)
    if isinstance(values, list):
        return values
    check_joint_names(list(values), system.robot.joint_names, system.robot.name)
    return [values.get(name, 0.0) for name in system.robot.joint_names]
