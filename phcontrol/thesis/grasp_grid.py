"""What holds of the thesis's comparison of grasping laws under equal conditions, over bodies and gains."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from phcontrol.controllers.classical_impedance import ClassicalImpedance
from phcontrol.controllers.force_regulation import ForceRegulation
from phcontrol.controllers.impedance_grasping import ImpedanceGrasping
from phcontrol.environments.contact_geometry import JointContact
from phcontrol.environments.rigid_body import RigidBody
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.simulation.closed_loop import simulate
from phcontrol.thesis.claim import Claim
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.measures import settling_time, touch_time
from phcontrol.thesis.origin import Origin
from phcontrol.thesis.study import Outcome

if TYPE_CHECKING:
    from matplotlib.figure import Figure

START, BODY, FORCE = 0.30, 0.20, 0.20
STIFFNESSES = (1e1, 1e2, 1e3, 1e4, 1e5)  # of the body [N·m/rad]
GAINS = {"K_p 1, C 1.5": (1.0, 1.5), "K_p 1, C 3": (1.0, 3.0), "K_p 3, C 3": (3.0, 3.0)}  # [N·m/rad], [N·m·s/rad]
MEASURES = ("contact", "impact", "settled")
DURATION = 12.0


def run() -> Outcome:
    """Run both laws, with the same stiffness, damping and outer integrator, on every body and gain."""
    table = {
        (label, stiffness): (_grasp("grasping", *gains, stiffness), _grasp("classical", *gains, stiffness))
        for label, gains in GAINS.items()
        for stiffness in STIFFNESSES
    }
    wins = [sum(ours[i] < theirs[i] for ours, theirs in table.values()) for i in range(3)]
    total = float(len(table))
    statements = ("contact is earlier", "the impact force is lower", "the force settles faster")
    return Outcome(
        "grasp-grid",
        "rest-length law against classical impedance under equal conditions, both regulated to 0.2 N·m",
        {},
        [
            Claim(measure, f"{statement} with the rest-length law, in how many of {len(table)} cases", Origin.OURS,
                  "section 4.2.2 says so of one body", (total,), "cases", 0.0, [Finding((float(won),))], "=",
                  f"it holds in {won} of {len(table)} cases of body stiffness 10 to 1e5 N·m/rad and three gains")
            for measure, statement, won in zip(MEASURES, statements, wins, strict=True)
        ],
        {"grasp-grid": lambda: _figure(table)},
        ("equal conditions: the same K_p, C and outer integrator (0.3 rad/(N·m·s)), f_e not cancelled by either.",),
    )  # fmt: skip


def _grasp(law: str, stiffness: float, damping: float, body_stiffness: float) -> tuple[float, float, float]:
    """Return contact time [s], largest contact force [N·m] and settling time [s]."""
    system = MechanicalSystem(load_robot("pera_gripper"))
    common: dict[str, Any] = {
        "goal": [BODY],
        "stiffness": stiffness,
        "damping": damping,
        "regulation": ForceRegulation([FORCE], gain=0.3, rate_limit=0.5),
    }
    controller = (
        ImpedanceGrasping(system, **common, rest_stiffness=0.5)
        if law == "grasping"
        else ClassicalImpedance(system, **common)
    )
    body = RigidBody(JointContact("gripper", BODY), stiffness=body_stiffness, damping=0.3 * np.sqrt(body_stiffness))
    log = simulate(system, controller, duration=DURATION, dt=2e-3, q0=[START], bodies=[body], torque_limit=None)
    return touch_time(log), float(log.contact_force.max()), settling_time(log, FORCE)


def _figure(table: Mapping[tuple[str, float], tuple[tuple[float, ...], tuple[float, ...]]]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 4.0), layout="constrained")
    titles = ("contact time", "largest contact force", "settling time")
    for i, (axes, title) in enumerate(zip(figure.subplots(1, 3), titles, strict=True)):
        ratios = np.array([[table[(g, k)][0][i] / table[(g, k)][1][i] for k in STIFFNESSES] for g in GAINS])
        image = axes.imshow(np.log2(ratios), cmap="RdBu_r", vmin=-2.0, vmax=2.0, aspect="auto")
        for row, column in np.ndindex(ratios.shape):
            axes.text(column, row, f"{ratios[row, column]:.2f}", ha="center", va="center", fontsize=9)
        axes.set_xticks(range(len(STIFFNESSES)), [f"{k:g}" for k in STIFFNESSES])
        axes.set_yticks(range(len(GAINS)), list(GAINS) if i == 0 else [""] * len(GAINS))
        axes.set(title=title, xlabel="body stiffness [N·m/rad]")
    figure.suptitle("Rest-length law over classical impedance, both regulated to 0.2 N·m: ratios")
    figure.colorbar(image, ax=figure.axes, label="log₂ ratio (blue: rest-length law is better)")
    return figure
