"""``phcontrol run servo``, and ``run LAW`` for the laws that steer by an image."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from phcontrol.analysis.certify import SAMPLES
from phcontrol.cli import completion
from phcontrol.cli.arm_options import AS_DESCRIBED, ArmOptions
from phcontrol.cli.laws import CONTROLLER_HELP
from phcontrol.cli.one_run import run_and_write
from phcontrol.cli.options import (
    DurationOption,
    FormOption,
    OutOption,
    RobotOption,
    SamplesOption,
    SeedOption,
    SetOption,
)
from phcontrol.cli.showing import UNWATCHED, Showing
from phcontrol.cli.texts import numbers_of, settings_of
from phcontrol.runs.servo import run_servo


def servo(
    robot: RobotOption = "pera",
    controller: Annotated[
        str,
        typer.Option(
            help=f"A law that steers by an image: {CONTROLLER_HELP}.", autocompletion=completion.laws_of("servo")
        ),
    ] = "hamiltonian_servo",
    interconnection: FormOption = "coriolis",
    start: Annotated[
        str, typer.Option(help="Where the object is in the image at home: mu,nu,l [m].")
    ] = "0.004,0.003,0.0028",
    goal: Annotated[str, typer.Option(help="Where it should be: mu,nu,l [m].")] = "0,0,0.002",
    duration: DurationOption = 6.0,
    dt: Annotated[float, typer.Option(help="Step of the integrator [s].")] = 2e-3,
    camera_rate: Annotated[
        float | None, typer.Option(help="Frames in a second [Hz], one late. Default: features at every instant.")
    ] = None,
    arm: ArmOptions = AS_DESCRIBED,
    settings: SetOption = None,
    samples: SamplesOption = SAMPLES,
    out: OutOption = Path("results/servo"),
    showing: Showing = UNWATCHED,
    seed: SeedOption = 0,
) -> None:
    """Bring an object to where it should be in the image of a camera in the hand, and certify the law that does it."""
    run_and_write(
        arm.system(robot),
        out,
        showing,
        study=run_servo,
        controller=controller,
        start=numbers_of("--start", start),
        goal=numbers_of("--goal", goal),
        interconnection=interconnection,
        samples=samples,
        seed=seed,
        camera_rate=camera_rate,
        options=settings_of(settings, "goal", "interconnection"),
        duration=duration,
        dt=dt,
    )
