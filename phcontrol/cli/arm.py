"""Goals and joint values that options name."""

from __future__ import annotations

import typer

from phcontrol._validation import Array
from phcontrol.cli.texts import by_joint
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.robot import check_joint_names
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.trajectories import inverse_kinematics


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
