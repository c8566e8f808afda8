"""Thesis figure 4.1: the gripper presses a squash ball with 3.5 N·m."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from phcontrol.analysis.force_conditions import force_control_conditions
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
CHOICES: dict[str, dict[str, Any]] = {
    "ball of 10 N·m/rad": {"stiffness": 10.0, "approach_speed": APPROACH_SPEED},
    "ball of 40 N·m/rad": {"stiffness": 40.0, "approach_speed": APPROACH_SPEED},
    "ball without a damper": {"damping": 0.0, "approach_speed": APPROACH_SPEED},
    "ball with 1 N·m·s/rad": {"damping": 1.0, "approach_speed": APPROACH_SPEED},
    "approach at 0.15 rad/s": {"approach_speed": 0.15},
    "approach at 0.30 rad/s": {"approach_speed": 0.30},
    "approach not limited": {"approach_speed": None},
}
SOME = 1e-6
"""From where an ε is more than rounding."""
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
    others = {text: _press(feedforward=False, duration=6.0, dt=4e-3, **choice) for text, choice in CHOICES.items()}
    runs = [log, *others.values()]
    touch, settled = ([measure(entry) for entry in runs] for measure in (touch_time, _settled))
    wrong = max(abs(float(entry.contact_force[-1]) - FORCE) for entry in runs)
    return Outcome(
        "fig-4-1",
        "force control of the gripper on a squash ball (thesis figure 4.1)",
        logs,
        [
            Claim("contact", "contact with the ball", Origin.FIGURE, "section 4.1.2, figure 4.1", (0.50,), "s", 0.02,
                  [Finding((touch[0],), "E14", chosen=FIT, fitted=True)],
                  stand_in=True, reason=f"over the other choices {min(touch):.2f} to {max(touch):.2f} s"),
            Claim("settled", "f_d = 3.5 is held within 5 %", Origin.FIGURE, "section 4.1.2, figure 4.1", (1.50,), "s",
                  0.05, [Finding((settled[0],), "E14", chosen=FIT, fitted=True)],
                  stand_in=True, reason=f"over the other choices {min(settled):.2f} to {max(settled):.2f} s"),
            Claim("error", "steady-state error of the force", Origin.THEOREM, "section 4.1.2, Theorem 4.1.1",
                  (0.0,), "N·m", 1e-3, [Finding((wrong,), "E14", chosen="the worst of all choices of the ball")],
                  reason="after 4 s, of the other choices after 6 s; of the theorem: what was measured is contact "
                  "and settled"),
            *_conditions(),
        ],
        {"fig-4-1": lambda: _figure(logs, others)},
        notes=(
            "a fit: the thesis gives neither the ball's stiffness and damping nor what keeps the approach slow.",
            "forces are printed in N, read as N·m of the one joint. K_z is not printed: K_p = 1, which law (4.9) does "
            "not have, is taken for K_z = 1.",
            *(f"{text}: contact {touch_time(entry):.2f} s, settled {_settled(entry):.2f} s, peak "
              f"{entry.contact_force.max():.1f} N·m." for text, entry in others.items()),
            f"speed at impact: thesis's law {impact['thesis']:.2f}, with feedforward {impact['feedforward']:.2f}, "
            f"without a limit {impact['unlimited']:.2f} rad/s: in free motion w winds up.",
            f"with the feedforward the force is within 5 % at {_settled(logs['feedforward']):.2f} s, and peaks at "
            f"{logs['feedforward'].contact_force.max():.2f} N·m against {log.contact_force.max():.2f}.",
        ),
    )  # fmt: skip


def _settled(log: Log) -> float:
    return settling_time(log, FORCE)


def _conditions() -> list[Claim]:
    """Return what becomes of the conditions on ε with the gripper's numbers."""
    system = MechanicalSystem(load_robot("pera_gripper"))
    law = ForceControl(system, **GAINS, feedforward=True)
    found = force_control_conditions(law, system, samples=20)
    allowed = min(found.printed)
    return [
        Claim("conditions", "with these gains (4.13) to (4.15) hold for a small ε: least of their right-hand sides",
              Origin.TEXT, "section 4.1.2", (0.0,), "", 0.0,
              [Finding((allowed,), vacuous="each right-hand side is made of positive numbers, so some ε is below it")],
              ">="),
        Claim("lyapunov-exists", "for a sufficiently small ε (4.21) is positive and decreases: largest such ε",
              Origin.THEOREM, "Theorem 4.1.1", (SOME,), "", 0.0, [Finding((found.largest,), "E23")], ">=",
              "its rate, a quadratic form in p̂ and w, is exactly -xᵀQ(ε)x along (4.17); the largest ε with Q(ε) > 0 is "
              "one eigenvalue, at each sampled state. There is none where a joint has no friction"),
        Claim("lyapunov", "the printed (4.13) to (4.15) are sufficient: largest ε with which (4.21) decreases, against "
              "the largest that they allow", Origin.THEOREM, "Theorem 4.1.1", (allowed,), "", 0.0,
              [Finding((found.decreasing,), "E23")], ">=",
              "(4.32), from which (4.14) is, has its inequality turned: Q₁ of (4.31) is positive definite for an ε "
              "above it, Q₂ for one below (4.33), and here, where all bounds are equal, both are at 1: no ε serves "
              "both. Their sum, which is what must be positive, allows ε² < 4d/(4d + c), d = d_g/m_g and c = C/m_g: "
              "friction decides, of which the printed bounds know nothing (E25)"),
    ]  # fmt: skip


def _press(
    duration: float = 4.0, dt: float = 1e-3, stiffness: float = 20.0, damping: float = 0.5, **options: Any
) -> Log:
    system = MechanicalSystem(load_robot("pera_gripper"))
    ball = RigidBody(JointContact("gripper", BALL), stiffness=stiffness, damping=damping, onset=1e-4)
    controller = ForceControl(system, **GAINS, **options)
    return simulate(system, controller, duration=duration, dt=dt, q0=[START], bodies=[ball])


def _figure(logs: dict[str, Log], others: dict[str, Log]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.5, 6.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    styles = {
        "thesis": ("#0072b2", "-", "thesis's law, approach speed limited"),
        "feedforward": ("#d55e00", "-", "with feedforward, limited"),
        "unlimited": ("#999999", "--", "with feedforward, unlimited"),
    }
    for position, entry in enumerate(others.values()):
        label = "thesis's law, other choices of ball and approach" if position == 0 else None
        upper.plot(entry.time, entry.contact_force, color="#0072b2", linewidth=0.6, alpha=0.45, label=label)
        lower.plot(entry.time, entry.position[:, 0], color="#0072b2", linewidth=0.6, alpha=0.45)
    for name, (color, line, label) in styles.items():
        log = logs[name]
        upper.plot(log.time, log.contact_force, color=color, linestyle=line, label=label)
        lower.plot(log.time, log.position[:, 0], color=color, linestyle=line)
    upper.plot([0.5, 1.5], [0.0, FORCE], "v", color="black", label="printed: contact, settled")
    upper.axhline(FORCE, color="black", linewidth=0.6)
    lower.axhline(BALL, color="black", linewidth=0.6)
    upper.set(ylabel="contact force [N·m]", title="Figure 4.1: squash ball, a fit", ylim=(-0.3, 10.0), xlim=(0.0, 4.0))
    lower.set(ylabel="q [rad] (line: ball)", xlabel="t [s]")
    upper.legend(fontsize=8)
    for axes in (upper, lower):
        axes.grid(alpha=0.25)
    return figure
