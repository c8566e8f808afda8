"""The options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from phcontrol.cli import completion
from phcontrol.cli.laws import CONTROLLER_HELP
from phcontrol.mechanics.state import INTERCONNECTIONS
from phcontrol.simulation.integrators import INTEGRATORS

OUT_HELP = "Folder for log, picture and certificate."
RobotOption = Annotated[
    str,
    typer.Option(
        help="A shipped robot, a URDF, MJCF or xacro file, or a name of example-robot-data.",
        autocompletion=completion.robots,
    ),
]
ControllerOption = Annotated[str, typer.Option(help=f"A law: {CONTROLLER_HELP}.", autocompletion=completion.laws)]
LockOption = Annotated[list[str] | None, typer.Option(help="Joint to lock at home; may be repeated.", metavar="JOINT")]
GoalOption = Annotated[str | None, typer.Option(help="Joint positions: numbers, or joint=value pairs. Default: home.")]
FormOption = Annotated[
    str,
    typer.Option(
        help=f"Which J2 the law uses: {' or '.join(INTERCONNECTIONS)}.",
        autocompletion=completion.one_of(INTERCONNECTIONS),
    ),
]
ArmatureOption = Annotated[
    str | None,
    typer.Option(help="Reflected rotor inertia [kg m²]: one number, one each joint, or joint=value pairs."),
]
PayloadOption = Annotated[
    list[str] | None,
    typer.Option(
        help="What the arm carries: a mass [kg] at the tool frame, or 'mass=1,com=0 0 0.05,inertia=0.01 0.01 "
        "0.01,frame=hand'. May be repeated.",
        metavar="BODY",
    ),
]
RotorOption = Annotated[
    bool, typer.Option("--rotor-inertia", help="Add the rotors that the URDF gives (motor_inertia, gear_ratio) to M.")
]
StepOption = Annotated[
    float | None, typer.Option(help="Step of the integrator [s]. Default: 1 ms, or less if friction asks for it.")
]
ReachOption = Annotated[
    str | None,
    typer.Option(help="Goal for a frame instead of the joints: a point x,y,z in the world [m] (needs Pink)."),
]
FrameOption = Annotated[str | None, typer.Option(help="The frame of --reach. Default: the tool, or the last frame.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="A gain or option of the law: a number, a word, true, false, None, a list like 1,2, or rows like "
        "'1,0; 0,1'. May be repeated.",
        metavar="NAME=VALUE",
    ),
]
IntegratorOption = Annotated[
    str, typer.Option(help=f"One of {', '.join(INTEGRATORS)}.", autocompletion=completion.one_of(INTEGRATORS))
]
PeriodOption = Annotated[
    float | None, typer.Option(help="Hold the torque for this long [s]. Default: continuous control.")
]
DurationOption = Annotated[float, typer.Option(help="Simulated time [s].")]
SamplesOption = Annotated[int, typer.Option(help="States at which the law is certified.")]
SeedOption = Annotated[int, typer.Option(min=0, help="Of the states at which the law is certified.")]
OutOption = Annotated[Path, typer.Option(help=OUT_HELP)]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]
ViewOption = Annotated[bool, typer.Option("--view", help="Watch in a browser, at the pace of the clock.")]
RecordOption = Annotated[
    Path | None, typer.Option(help="Write a page that plays the run, to be opened offline.", metavar="FILE.html")
]
PortOption = Annotated[
    int | None,
    typer.Option(
        min=0, max=65535, help="To serve the view on; 0 for any free one. Default: the first free one from 7000."
    ),
]
