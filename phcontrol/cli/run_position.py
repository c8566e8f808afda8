"""``phcontrol run position``, and ``run LAW`` for the laws that hold a position."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from phcontrol.analysis.certify import SAMPLES
from phcontrol.cli.arm import goal_of, system_of
from phcontrol.cli.laws import CONTROLLER_HELP
from phcontrol.cli.one_run import run_and_write
from phcontrol.cli.options import (
    ArmatureOption,
    FormOption,
    FrameOption,
    LockOption,
    PortOption,
    ReachOption,
    RecordOption,
    RobotOption,
    SetOption,
    StepOption,
    ViewOption,
)
from phcontrol.cli.showing import Showing
from phcontrol.cli.texts import settings_of
from phcontrol.simulation.integrators import INTEGRATORS


def position(
    controller: Annotated[
        str, typer.Option(help=f"A law that holds a position: {CONTROLLER_HELP}.")
    ] = "force_feedback",
    robot: RobotOption = "pera",
    interconnection: FormOption = "coriolis",
    goal: Annotated[
        str | None,
        typer.Option(help="Angles [rad], comma-separated, or joint=angle pairs. Default: a reachable posture."),
    ] = None,
    reach: ReachOption = None,
    frame: FrameOption = None,
    duration: Annotated[float, typer.Option(help="Simulated time [s].")] = 10.0,
    dt: StepOption = None,
    integrator: Annotated[str, typer.Option(help=f"One of {', '.join(INTEGRATORS)}.")] = "rk4",
    control_period: Annotated[
        float | None, typer.Option(help="Hold the torque for this long [s]. Default: continuous control.")
    ] = None,
    step: Annotated[
        bool, typer.Option("--step", help="Give the goal as a jump, in place of a smooth reference. Laws overshoot it.")
    ] = False,
    lock: LockOption = None,
    armature: ArmatureOption = None,
    settings: SetOption = None,
    samples: Annotated[int, typer.Option(help="States at which the law is certified.")] = SAMPLES,
    out: Annotated[Path | None, typer.Option(help="Folder for log, picture and certificate.")] = None,
    view: ViewOption = False,
    record: RecordOption = None,
    port: PortOption = None,
) -> None:
    """Lead an arm from its home to a posture within its velocity limits, and certify the law that does it."""
    system = system_of(robot, lock, armature)
    if step:
        typer.echo("warning: --step: the goal jumps; laws that feed forces back must overshoot it", err=True)
    run_and_write(
        system,
        Path("results/position") if out is None else out,
        Showing(view, record, port),
        controller=controller,
        goal=goal_of(system, goal, reach, frame),
        duration=duration,
        interconnection=interconnection,
        samples=samples,
        options=settings_of(settings, "goal", "interconnection"),
        dt=dt,
        integrator=integrator,
        control_period=control_period,
        step=step,
    )
