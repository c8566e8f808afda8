"""Thesis figure 4.1: the gripper presses a squash ball with 3.5 N·m."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from phcontrol.controllers.force_control import ForceControl
from phcontrol.environments.contact_geometry import JointContact
from phcontrol.environments.rigid_body import RigidBody
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.simulation.closed_loop import simulate
from phcontrol.simulation.log import Log
from phcontrol.thesis.claim import Claim
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.measures import settling_time, touch_time
from phcontrol.thesis.origin import Origin
from phcontrol.thesis.study import Outcome

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORCE = 3.5  # [N·m]
GAINS: dict[str, Any] = {"force": [FORCE], "coupling": 1.0, "force_gain": 1.0, "damping": 5.0}
APPROACH_SPEED = 0.21  # [rad/s]
START, BALL = 0.30, 0.20  # [rad]
FIT = "ball of 20 N·m/rad and 0.5 N·m·s/rad at 0.20 rad, approach limited to 0.21 rad/s"


def run() -> Outcome:
    """Press with the thesis's law, with the feedforward, and without a limit of the approach speed."""
    logs = {
        "thesis": _press(feedforward=False, approach_speed=APPROACH_SPEED),
        "feedforward": _press(feedforward=True, approach_speed=APPROACH_SPEED),
        "unlimited": _press(feedforward=True, approach_speed=None),
    }
    log = logs["thesis"]
    impact = {name: float(-entry.velocity[entry.contact_force > 0.0][0, 0]) for name, entry in logs.items()}
    return Outcome(
        "fig-4-1",
        "force control of the gripper on a squash ball (thesis figure 4.1)",
        logs,
        [
            Claim("contact", "contact with the ball", Origin.FIGURE, "section 4.1.2, figure 4.1", (0.50,), "s", 0.02,
                  [Finding((touch_time(log),), "E14", chosen=FIT, fitted=True)]),
            Claim("settled", "f_d = 3.5 is held within 5 %", Origin.FIGURE, "section 4.1.2, figure 4.1", (1.50,), "s",
                  0.05, [Finding((settling_time(log, FORCE),), "E14", chosen=FIT, fitted=True)]),
            Claim("error", "steady-state error of the force", Origin.TEXT, "section 4.1.2, Theorem 4.1.1", (0.0,),
                  "N·m", 1e-3, [Finding((abs(float(log.contact_force[-1]) - FORCE),), "E14", chosen=FIT)]),
        ],
        {"fig-4-1": lambda: _figure(logs)},
        notes=(
            f"speed at impact: thesis's law {impact['thesis']:.2f}, with feedforward {impact['feedforward']:.2f}, "
            f"without a limit {impact['unlimited']:.2f} rad/s: in free motion w winds up.",
            "with the feedforward the force is within 5 % at "
            f"{settling_time(logs['feedforward'], FORCE):.2f} s, and peaks at "
            f"{logs['feedforward'].contact_force.max():.2f} N·m against {log.contact_force.max():.2f}.",
        ),
    )  # fmt: skip


def _press(**options: Any) -> Log:
    system = MechanicalSystem(load_robot("pera_gripper"))
    ball = RigidBody(JointContact("gripper", BALL), stiffness=20.0, damping=0.5, onset=1e-4)
    controller = ForceControl(system, **GAINS, **options)
    return simulate(system, controller, duration=4.0, dt=1e-3, q0=[START], bodies=[ball])


def _figure(logs: dict[str, Log]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.5, 6.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    styles = {
        "thesis": ("#0072b2", "-", "thesis's law, approach speed limited"),
        "feedforward": ("#d55e00", "-", "with feedforward, limited"),
        "unlimited": ("#999999", "--", "with feedforward, unlimited"),
    }
    for name, (color, line, label) in styles.items():
        log = logs[name]
        upper.plot(log.time, log.contact_force, color=color, linestyle=line, label=label)
        lower.plot(log.time, log.position[:, 0], color=color, linestyle=line)
    upper.axhline(FORCE, color="black", linewidth=0.6)
    lower.axhline(BALL, color="black", linewidth=0.6)
    upper.set(ylabel="contact force [N·m]", title="Figure 4.1: squash ball")
    lower.set(ylabel="q [rad] (line: ball)", xlabel="t [s]")
    upper.legend(fontsize=8)
    for axes in (upper, lower):
        axes.grid(alpha=0.25)
    return figure
