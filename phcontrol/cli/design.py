"""``phcontrol design``."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from phcontrol.cli.arm import goal_of
from phcontrol.cli.arm_options import AS_DESCRIBED, ArmOptions
from phcontrol.cli.laws import law_of
from phcontrol.cli.options import (
    ControllerOption,
    FormOption,
    GoalOption,
    JsonOption,
    RobotOption,
    SetOption,
)
from phcontrol.cli.texts import numbers_of, settings_of
from phcontrol.controllers.law_error import errors_of
from phcontrol.design.design_gains import design_gains
from phcontrol.design.desired_bandwidth import DesiredBandwidth
from phcontrol.design.desired_gain import DesiredGain
from phcontrol.design.desired_settling import DesiredSettling
from phcontrol.design.sampling_budget import SamplingBudget
from phcontrol.design.specification import Specification
from phcontrol.design.torque_budget import TorqueBudget
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.robot import Robot

_RATIO = 0.7  # ζ where none is given


def design(
    controller: ControllerOption,
    robot: RobotOption = "pera",
    bandwidth: Annotated[float | None, typer.Option(help="ω [rad/s], of every mode.")] = None,
    damping_ratio: Annotated[float | None, typer.Option(help=f"ζ of every mode. Default: {_RATIO}.")] = None,
    diagonal: Annotated[
        bool, typer.Option("--diagonal", help="Diagonal gains: the slowest mode is there, the others are faster.")
    ] = False,
    settling_time: Annotated[
        float | None, typer.Option(help="Within which the hand settles to 5 % [s]; with --stiffness.")
    ] = None,
    stiffness: Annotated[
        str | None, typer.Option(help="Of the hand: x,y,z [N/m], and three more about them [N·m/rad].")
    ] = None,
    l2_gain: Annotated[
        float | None, typer.Option("--l2-gain", help="γ from forces to motion [rad/s per N·m]; --bandwidth beside.")
    ] = None,
    period: Annotated[
        float | None, typer.Option(help="The largest gains that are stable with a torque held for this long [s].")
    ] = None,
    delay: Annotated[int, typer.Option(help="By how many periods it is late.", min=0)] = 1,
    torque_share: Annotated[
        float | None,
        typer.Option(help="The largest gains whose torque on a step from home stays below this share of the limits."),
    ] = None,
    goal: GoalOption = None,
    interconnection: FormOption = "coriolis",
    arm: ArmOptions = AS_DESCRIBED,
    settings: SetOption = None,
    as_json: JsonOption = False,
) -> None:
    """Make a law's gains from what its loop should do, or from what limits it.

    Says what the loop then does, and prints the command that uses them. Exit code 1 if the arm's friction keeps them
    from it, or a mode grows.
    """
    system, entry = arm.system(robot), law_of(controller)
    specification = _specification(
        system.robot, bandwidth, damping_ratio, diagonal, settling_time, stiffness, l2_gain, period, delay, torque_share
    )
    options = settings_of(settings, "interconnection", "goal")
    with errors_of(controller, entry.law):
        found = design_gains(
            controller,
            system,
            specification,
            goal_of(system, goal, None, None),
            interconnection=interconnection,
            **options,
        )
    command = found.command(" ".join([robot, *arm.given]))
    if as_json:
        typer.echo(json.dumps(found.record() | {"command": command}, indent=2))
    else:
        typer.echo(str(found))
        typer.echo(f"use them:\n{command}")
    if not found.met:
        raise typer.Exit(1)


def _specification(
    robot: Robot,
    bandwidth: float | None,
    damping_ratio: float | None,
    diagonal: bool,
    settling_time: float | None,
    stiffness: str | None,
    l2_gain: float | None,
    period: float | None,
    delay: int,
    torque_share: float | None,
) -> Specification:
    """Return what the options ask for. Raises InvalidArgumentError unless it is one thing."""
    ratio = _RATIO if damping_ratio is None else damping_ratio
    asked = {"--settling-time": settling_time, "--l2-gain": l2_gain, "--period": period, "--torque-share": torque_share}
    given = [name for name, value in asked.items() if value is not None]
    if len(given) > 1 or (given and given != ["--l2-gain"] and bandwidth is not None):
        raise InvalidArgumentError(given[0], f"is one specification, and {(given[1:] or ['--bandwidth'])[0]} another")
    if (stiffness is None) != (settling_time is None):
        raise InvalidArgumentError("--stiffness", "and --settling-time go together: give both")
    if diagonal and (given or bandwidth is None):
        raise InvalidArgumentError("--diagonal", "goes with --bandwidth alone")
    if l2_gain is not None:
        return DesiredGain(l2_gain, bandwidth=bandwidth, damping_ratio=ratio)
    if stiffness is not None and settling_time is not None:
        numbers = numbers_of("--stiffness", stiffness)
        if len(numbers) not in (1, 3, 6):
            raise InvalidArgumentError("--stiffness", f"must be 1, 3 or 6 numbers, but are {len(numbers)}")
        linear = numbers[0] if len(numbers) == 1 else numbers[:3]
        return DesiredSettling(linear, settling_time, rotational_stiffness=numbers[3:] or None)
    if period is not None:
        return SamplingBudget(period, delay, damping_ratio=ratio)
    if torque_share is not None:
        return TorqueBudget([robot.home], share=torque_share, damping_ratio=ratio)
    if bandwidth is None:
        raise InvalidArgumentError("--bandwidth", f"must be given, or one of {', '.join(asked)}")
    return DesiredBandwidth(bandwidth, ratio, diagonal=diagonal)
