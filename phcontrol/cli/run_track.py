"""``phcontrol run track``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from phcontrol._validation import Array, choice
from phcontrol.analysis.certify import SAMPLES
from phcontrol.cli.arm import goal_of, joint_values
from phcontrol.cli.arm_options import AS_DESCRIBED, ArmOptions
from phcontrol.cli.one_run import run_and_write
from phcontrol.cli.options import (
    DurationOption,
    FrameOption,
    OutOption,
    ReachOption,
    RobotOption,
    SamplesOption,
    SeedOption,
    SetOption,
    StepOption,
)
from phcontrol.cli.showing import UNWATCHED, Showing
from phcontrol.cli.texts import settings_of
from phcontrol.controllers.trajectory_tracking import TrajectoryTracking, swing
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.momentum_observer import MomentumObserver
from phcontrol.trajectories.files import read_trajectory
from phcontrol.trajectories.minimum_jerk import MinimumJerk
from phcontrol.trajectories.trajectory import Trajectory


def track(
    robot: RobotOption = "pera",
    trajectory: Annotated[
        str,
        typer.Option(
            help="'swing' from home to the goal and back for ever, 'reach' the goal by minimum jerk, or a CSV file of "
            "times [s] and joint positions [rad], one row an instant."
        ),
    ] = "swing",
    goal: Annotated[
        str | None, typer.Option(help="Angles [rad] or joint=angle pairs. Default: a posture near home.")
    ] = None,
    speed: Annotated[float, typer.Option(help="Largest fraction of the velocity limits (swing, reach).")] = 0.5,
    external_force: Annotated[
        str, typer.Option(help="What the law knows of it: none, measured, or observed (momentum observer).")
    ] = "none",
    push: Annotated[str | None, typer.Option(help="Constant external force on the joints [N·m], as --goal.")] = None,
    interconnection: Annotated[
        str, typer.Option(help=f"Which J2 the law uses: {', '.join(TrajectoryTracking.forms)}.")
    ] = "coriolis",
    reach: ReachOption = None,
    frame: FrameOption = None,
    duration: DurationOption = 10.0,
    dt: StepOption = None,
    control_period: Annotated[
        float | None,
        typer.Option(help="Hold the torque for this long [s]; it is computed for the middle of that time."),
    ] = None,
    arm: ArmOptions = AS_DESCRIBED,
    settings: SetOption = None,
    samples: SamplesOption = SAMPLES,
    out: OutOption = Path("results/track"),
    showing: Showing = UNWATCHED,
    seed: SeedOption = 0,
) -> None:
    """Follow a trajectory with any arm; say what it asks of the joints, and certify the law."""
    system = arm.system(robot)
    desired = goal_of(system, goal, reach, frame)
    posture = system.robot.near_home() if desired is None else desired
    knowledge = choice("external force", external_force, ("none", "measured", "observed"))
    run_and_write(
        system,
        out,
        showing,
        controller="tracking" if knowledge == "none" else "tracking_measured",
        goal=posture,
        duration=duration,
        interconnection=interconnection,
        samples=samples,
        seed=seed,
        options={"trajectory": _trajectory(trajectory, system, posture, speed), "hold": control_period or 0.0}
        | settings_of(settings, "goal", "interconnection"),
        dt=dt,
        control_period=control_period,
        disturbance=None if push is None else joint_values(system, "--push", push),
        sensors=[MomentumObserver(system)] if knowledge == "observed" else None,
    )


def _trajectory(kind: str, system: MechanicalSystem, goal: Array, speed: float) -> Trajectory:
    if kind == "swing":
        return swing(system.robot, goal, fraction=speed)
    if kind == "reach":
        return MinimumJerk.within_limits(system.robot, system.robot.home, goal, fraction=speed)
    return read_trajectory(kind, system.robot)
