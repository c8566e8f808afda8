"""``phcontrol run cartesian_impedance`` and ``run cartesian_tracking``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from phcontrol.analysis.certify import SAMPLES
from phcontrol.cli.arm_options import AS_DESCRIBED, ArmOptions
from phcontrol.cli.errors import say_aside
from phcontrol.cli.one_run import run_and_write
from phcontrol.cli.options import (
    DurationOption,
    FormOption,
    IntegratorOption,
    OutOption,
    PeriodOption,
    RobotOption,
    SamplesOption,
    SeedOption,
    SetOption,
    StepOption,
)
from phcontrol.cli.showing import UNWATCHED, Showing
from phcontrol.cli.texts import numbers_of, settings_of
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.runs.cartesian import run_cartesian

StiffnessOption = Annotated[
    str | None,
    typer.Option(help="Of the hand: x,y,z [N/m], and three more about them [N·m/rad]. Default: what suits the arm."),
]
PushOption = Annotated[
    str | None, typer.Option(help="Force on the hand x,y,z in the world [N], and a torque, three more [N·m].")
]
_DIRECTIONS = 6  # of a pose
HandOption = Annotated[
    str | None,
    typer.Option(
        help="The hand: a frame. Default: the tool, or the last frame that all joints move; the result names it."
    ),
]


def _with_hand(system: MechanicalSystem, frame: str | None) -> MechanicalSystem:
    """Return an arm; say so where its hand is a finger, or has too few joints to be moved in every direction."""
    fingers = [] if frame is not None else _fingers(system)
    if fingers:
        say_aside(
            f"note: the hand is {system.hand_frame}, a finger: --lock {' --lock '.join(fingers)} makes it the frame "
            "that carries the fingers; --frame names another"
        )
    if system.n < _DIRECTIONS:
        joints = "1 joint" if system.n == 1 else f"{system.n} joints"
        say_aside(
            f"note: {system.robot.name} has {joints}, and a pose six directions: the springs act on what the "
            "joints can move of the hand"
        )
    return system


def _fingers(system: MechanicalSystem) -> list[str]:
    """Return the joints that branch from one link and end in the hand's default frame; none where it is no finger."""
    model = system.robot.model
    last = model.frames[system.frame_id(system.hand_frame)].parentJoint
    carrier = model.parents[last]
    branches = [joint for joint in range(1, model.njoints) if model.parents[joint] == carrier]
    return [model.names[joint] for joint in branches] if carrier and len(branches) > 1 else []


def impedance(
    controller: str = "cartesian_impedance",
    robot: RobotOption = "panda",
    stiffness: StiffnessOption = None,
    push: PushOption = None,
    frame: HandOption = None,
    interconnection: FormOption = "coriolis",
    duration: DurationOption = 5.0,
    dt: StepOption = None,
    integrator: IntegratorOption = "rk4",
    control_period: PeriodOption = None,
    arm: ArmOptions = AS_DESCRIBED,
    settings: SetOption = None,
    samples: SamplesOption = SAMPLES,
    out: OutOption = Path("results/cartesian_impedance"),
    showing: Showing = UNWATCHED,
    seed: SeedOption = 0,
) -> None:
    """Hold the hand of an arm at a pose by a spring and a damper, push at it, and certify the law."""
    run_and_write(
        _with_hand(arm.system(robot), frame),
        out,
        showing,
        controller=controller,
        study=run_cartesian,
        stiffness=None if stiffness is None else numbers_of("--stiffness", stiffness),
        push=None if push is None else numbers_of("--push", push),
        frame=frame,
        interconnection=interconnection,
        duration=duration,
        samples=samples,
        seed=seed,
        options=settings_of(settings, "stiffness", "frame", "interconnection"),
        dt=dt,
        integrator=integrator,
        control_period=control_period,
    )


def tracking(
    controller: str = "cartesian_tracking",
    robot: RobotOption = "panda",
    path: Annotated[
        str,
        typer.Option(
            help="'circle' or 'line' from where the hand is near home, or a CSV file of time [s], x, y, z [m] and, if "
            "the hand shall turn, qx, qy, qz, qw, one row an instant."
        ),
    ] = "circle",
    stiffness: StiffnessOption = None,
    push: PushOption = None,
    frame: HandOption = None,
    interconnection: FormOption = "coriolis",
    duration: DurationOption = 5.0,
    dt: StepOption = None,
    control_period: PeriodOption = None,
    arm: ArmOptions = AS_DESCRIBED,
    settings: SetOption = None,
    samples: SamplesOption = SAMPLES,
    out: OutOption = Path("results/cartesian_tracking"),
    showing: Showing = UNWATCHED,
    seed: SeedOption = 0,
) -> None:
    """Lead the hand of an arm along a path by a spring and a damper, and certify the law."""
    run_and_write(
        _with_hand(arm.system(robot), frame),
        out,
        showing,
        controller=controller,
        study=run_cartesian,
        path=path,
        stiffness=None if stiffness is None else numbers_of("--stiffness", stiffness),
        push=None if push is None else numbers_of("--push", push),
        frame=frame,
        interconnection=interconnection,
        duration=duration,
        samples=samples,
        seed=seed,
        options=settings_of(settings, "stiffness", "frame", "interconnection", "path"),
        dt=dt,
        control_period=control_period,
    )
