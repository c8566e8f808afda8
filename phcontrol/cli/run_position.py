"""``phcontrol run position``, and ``run LAW`` for the laws that hold a position."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from phcontrol.analysis.certify import SAMPLES
from phcontrol.cli import completion
from phcontrol.cli.arm import goal_of
from phcontrol.cli.arm_options import AS_DESCRIBED, ArmOptions
from phcontrol.cli.laws import CONTROLLER_HELP
from phcontrol.cli.one_run import run_and_write
from phcontrol.cli.options import (
    DurationOption,
    FormOption,
    FrameOption,
    IntegratorOption,
    OutOption,
    PeriodOption,
    ReachOption,
    RobotOption,
    SamplesOption,
    SeedOption,
    SetOption,
    StepOption,
)
from phcontrol.cli.showing import UNWATCHED, Showing
from phcontrol.cli.texts import settings_of


def position(
    controller: Annotated[
        str,
        typer.Option(
            help=f"A law that holds a position: {CONTROLLER_HELP}.", autocompletion=completion.laws_of("position")
        ),
    ] = "force_feedback",
    robot: RobotOption = "pera",
    interconnection: FormOption = "coriolis",
    goal: Annotated[
        str | None,
        typer.Option(help="Angles [rad], comma-separated, or joint=angle pairs. Default: a reachable posture."),
    ] = None,
    reach: ReachOption = None,
    frame: FrameOption = None,
    duration: DurationOption = 10.0,
    dt: StepOption = None,
    integrator: IntegratorOption = "rk4",
    control_period: PeriodOption = None,
    step: Annotated[
        bool, typer.Option("--step", help="Give the goal as a jump, in place of a smooth reference. Laws overshoot it.")
    ] = False,
    arm: ArmOptions = AS_DESCRIBED,
    settings: SetOption = None,
    samples: SamplesOption = SAMPLES,
    out: OutOption = Path("results/position"),
    showing: Showing = UNWATCHED,
    seed: SeedOption = 0,
) -> None:
    """Lead an arm from its home to a posture within its velocity limits, and certify the law that does it."""
    system = arm.system(robot)
    if step:
        typer.echo("warning: --step: the goal jumps; laws that feed forces back must overshoot it", err=True)
    run_and_write(
        system,
        out,
        showing,
        controller=controller,
        goal=goal_of(system, goal, reach, frame),
        duration=duration,
        interconnection=interconnection,
        samples=samples,
        seed=seed,
        options=settings_of(settings, "goal", "interconnection"),
        dt=dt,
        integrator=integrator,
        control_period=control_period,
        step=step,
    )
