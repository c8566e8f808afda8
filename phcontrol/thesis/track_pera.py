"""All seven joints of the PERA follow sinusoids at once, with control at 1 kHz."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from phcontrol.controllers.trajectory_tracking import TrajectoryTracking
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.simulation.closed_loop import simulate
from phcontrol.simulation.log import Log
from phcontrol.thesis.claim import Claim
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.measures import tracking_error
from phcontrol.thesis.origin import Origin
from phcontrol.thesis.study import Outcome
from phcontrol.trajectories.limits import check_limits
from phcontrol.trajectories.sinusoid import Sinusoid

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TRAJECTORY = Sinusoid(
    [0.35, 0.35, 0.4, 0.5, 0.4, 0.3, 0.25],  # [rad]
    [0.1, 0.1, 0.15, 0.15, 0.2, 0.2, 0.2],  # [Hz]
    offset=[-0.6, 0.9, -0.2, -1.0, 0.2, -1.5, 0.0],  # [rad]
)
GAINS: dict[str, Any] = {
    "stiffness": [80.0, 80.0, 60.0, 60.0, 40.0, 15.0, 15.0],  # [N·m/rad]
    "damping": [8.0, 8.0, 6.0, 6.0, 3.0, 1.0, 1.0],  # [N·m·s/rad]
}
PERIOD, DURATION, STEADY_FROM = 1e-3, 12.0, 7.0  # [s]: steady for half a period of the slowest joints
START_ERROR = 0.01  # [rad], of every joint


def run() -> Outcome:
    """Follow with a continuous law, one held for 1 ms, and one held for 1 ms that makes up for it."""
    system = MechanicalSystem(load_robot("pera"))
    logs = {
        "continuous": _follow(system, None, 0.0),
        "held": _follow(system, PERIOD, 0.0),
        "compensated": _follow(system, PERIOD, PERIOD),
    }
    steady = {name: _steady_error(log) for name, log in logs.items()}
    robot, log = system.robot, logs["compensated"]
    torque = float((np.abs(log.torque) / robot.effort_limit).max())
    speed = float((np.abs(log.velocity) / robot.velocity_limit).max())
    report = check_limits(TRAJECTORY, system)
    claims = [
        Claim("steady-error", "largest steady error of seven joints with control at 1 kHz", Origin.OURS, "our aim",
              (1e-6,), "rad", 0.0, [Finding((steady["compensated"],))], "<=",
              "exact model, torque computed for the middle of the period it is held"),
        Claim("hold", "the same without making up for the hold", Origin.OURS, "our aim", (1e-6,), "rad", 0.0,
              [Finding((steady["held"],))], "<=",
              "a torque held for h acts h/2 late on average: the error is about h/2 times its rate over the stiffness"),
        Claim("torque", "the torque stays inside its limits (largest fraction)", Origin.OURS, "our aim", (1.0,), "",
              0.0, [Finding((torque,))], "<="),
        Claim("velocity", "the velocity stays inside its limits (largest fraction)", Origin.OURS, "our aim", (1.0,),
              "", 0.0, [Finding((speed,))], "<="),
    ]  # fmt: skip
    return Outcome(
        "track-pera",
        "seven joints follow sinusoids of 0.1 to 0.2 Hz at once",
        logs,
        claims,
        {"track-pera": lambda: _figure(logs, system)},
        notes=(
            str(report),
            "largest steady error, any joint: "
            + ", ".join(f"{name} {value:.1e} rad" for name, value in steady.items()),
        ),
    )


def _follow(system: MechanicalSystem, period: float | None, hold: float) -> Log:
    law = TrajectoryTracking(system, trajectory=TRAJECTORY, hold=hold, **GAINS)
    start = TRAJECTORY.at(0.0).position + START_ERROR
    return simulate(system, law, duration=DURATION, dt=PERIOD, q0=start, control_period=period)


def _steady_error(log: Log) -> float:
    return float(np.abs(tracking_error(log, TRAJECTORY)[log.time >= STEADY_FROM]).max())


def _figure(logs: dict[str, Log], system: MechanicalSystem) -> Figure:
    from matplotlib.figure import Figure

    from phcontrol.visualization.colors import COLORS

    figure = Figure(figsize=(10.0, 7.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    log = logs["compensated"]
    for i, name in enumerate(system.robot.joint_names):
        upper.plot(log.time, log.position[:, i], color=COLORS[i], label=name)
        upper.plot(log.time, [TRAJECTORY.at(t).position[i] for t in log.time], "--", color="black", linewidth=0.6)
    for (name, entry), color in zip(logs.items(), ("#999999", "#d55e00", "#0072b2"), strict=True):
        largest = np.abs(tracking_error(entry, TRAJECTORY)).max(axis=1)
        lower.semilogy(entry.time, np.maximum(largest, 1e-14), color=color, label=name)
    upper.set(ylabel="q [rad]", title="Seven joints at once (dashed: desired)")
    lower.set(
        xlabel="t [s]", ylabel="largest joint error [rad]", title="continuous, held for 1 ms, made up for the hold"
    )
    upper.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    lower.legend(fontsize=8)
    for axes in (upper, lower):
        axes.grid(alpha=0.25)
    return figure
