"""Thesis figures 4.2 to 4.5 and 4.7 to 4.10: grasping a rigid and a compliant body by several laws."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from phcontrol.controllers.classical_impedance import ClassicalImpedance
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.force_regulation import ForceRegulation
from phcontrol.controllers.impedance_grasping import ImpedanceGrasping
from phcontrol.environments.body import Body
from phcontrol.environments.compliant_body import CompliantBody
from phcontrol.environments.contact_geometry import JointContact
from phcontrol.environments.rigid_body import RigidBody
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.force_sensor import ForceSensor
from phcontrol.simulation.closed_loop import simulate
from phcontrol.simulation.log import Log
from phcontrol.thesis.claim import Claim
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.measures import arrival_time, settling_time
from phcontrol.thesis.origin import Origin
from phcontrol.thesis.study import Outcome

if TYPE_CHECKING:
    from matplotlib.figure import Figure

START, GRASP, FORCE = 0.30, 0.20, 0.20  # q(0), q_f [rad], f_d [N·m]
DURATION, DT = 30.0, 2e-3  # [s]
NOISE, PERIOD = 0.01, 0.01  # stand-in for the measurements: [N·m], [s]
STYLES = {
    "grasping": ("#0072b2", "-", "rest-length law (4.59)"),
    "classical-compensated": ("#d55e00", "--", "classical, f_e cancelled (4.61)"),
    "classical": ("black", ":", "classical (4.60)"),
    "regulated": ("#009e73", "-", "ours: rest-length law, q_f regulated"),
    "classical-regulated": ("#cc79a7", "-.", "classical, q_f regulated alike"),
}


@dataclass(frozen=True)
class Printed:
    """The thesis's figures for one body: contact times, impact forces and settling times of its laws."""

    contact: tuple[float, float]
    impact: tuple[float, float, float]
    settled: tuple[float, float, float]


PRINTED = {
    ("rigid", False): Printed((0.60, 0.80), (0.10, 0.40, 0.60), (0.90, 2.0, 2.5)),
    ("compliant", False): Printed((0.80, 1.30), (0.00, 0.20, 0.30), (0.90, 2.0, 2.5)),
    ("rigid", True): Printed((0.55, float("nan")), (0.05, 0.25, 0.40), (0.70, float("nan"), float("nan"))),
    ("compliant", True): Printed((0.78, float("nan")), (0.00, 0.05, 0.15), (1.20, float("nan"), float("nan"))),
}
NAMES = ("grasping", "classical-compensated", "classical")


def run(name: str, body: str, quantity: str, sampled: bool) -> Outcome:
    """Run one of the figures: all laws on a body, with positions or forces as the figure."""
    logs = _logs(body, sampled)
    printed = PRINTED[(body, sampled)]
    claims = _position_claims(logs, printed) if quantity == "position" else _force_claims(logs, printed)
    kind = "a stand-in for the measurement: sampled at 10 ms, noisy force" if sampled else "simulation"
    notes = [
        f"the {body} body begins at {GRASP} rad; contact is counted from 90 % of the gap, since laws that rest at q_f "
        "only approach it.",
        *(
            [f"NOT the thesis's measurement, but a simulation: control every {PERIOD} s, force noise of {NOISE} N·m."]
            * sampled
        ),
        *(
            [
                "K_c = 0.1 N·m/rad as printed needs 2 rad of compression for 0.2 N·m; the regulated laws "
                "grasp a foam of 2 N·m/rad."
            ]
            * (body == "compliant")
        ),
    ]
    return Outcome(
        name,
        f"grasping {quantity} of a {body} body ({kind})",
        logs,
        claims,
        {name: lambda: _figure(logs, body, quantity, name)},
        tuple(notes),
    )


@cache
def _logs(body: str, sampled: bool) -> dict[str, Log]:
    """Run all laws on one body; the position and the force figure share it."""
    system = MechanicalSystem(load_robot("pera_gripper"))
    options: dict[str, Any] = {}
    if sampled:
        options = {"control_period": PERIOD, "sensors": [ForceSensor(noise=NOISE, period=PERIOD)]}
    return {
        name: simulate(
            system,
            law,
            duration=DURATION,
            dt=DT,
            q0=[START],
            bodies=[make_body(body, name)],
            torque_limit=None,
            **options,
        )
        for name, law in make_laws(system, body).items()
    }


def make_body(body: str, law: str) -> Body:
    """Return the rigid or the compliant body of section 4.2.2; for the regulated laws a stiffer foam."""
    where = JointContact("gripper", GRASP)
    if body == "rigid":
        return RigidBody(where, stiffness=2000.0, damping=10.0, onset=1e-4)
    stiffness = 2.0 if law.endswith("regulated") else 0.1
    return CompliantBody(
        where, stiffness=stiffness, damping=0.1, mass=0.01, surface_stiffness=50.0, surface_damping=0.5
    )


def make_laws(system: MechanicalSystem, body: str) -> dict[str, Controller]:
    """Return the thesis's three laws with its gains, and the two regulated ones."""
    rest, damping = (0.5, 3.0) if body == "rigid" else (0.25, 1.5)
    grasp: dict[str, Any] = {"goal": [GRASP], "stiffness": 1.0, "rest_stiffness": rest, "damping": damping}
    classical: dict[str, Any] = {"goal": [GRASP], "stiffness": 1.0, "damping": 3.0}
    regulation = ForceRegulation([FORCE], gain=0.3, rate_limit=0.5)
    return {
        "grasping": ImpedanceGrasping(system, **grasp),
        "classical-compensated": ClassicalImpedance(system, **classical, compensate_external_force=True),
        "classical": ClassicalImpedance(system, **classical),
        "regulated": ImpedanceGrasping(system, **grasp, regulation=regulation),
        "classical-regulated": ClassicalImpedance(system, **classical, regulation=regulation),
    }


def _claim(name: str, statement: str, printed: float, ours: float, unit: str, tolerance: float, reason: str) -> Claim:
    return Claim(name, statement, Origin.FIGURE, "sections 4.2.2 and 4.2.3", (printed,), unit, tolerance,
                 [Finding((ours,), "E15", "R2")], "=", reason)  # fmt: skip


def _position_claims(logs: dict[str, Log], printed: Printed) -> list[Claim]:
    reasons = {
        "grasping": "with K_p = 1, K_rl = 0.5, C = 3 the slow pole of (4.56) is at -0.22/s, slower than the classical",
        "classical": "with K = 1, K_d = 3, m = 0.5 the slow pole is at -0.35/s",
    }
    return [
        _claim(
            f"contact-{law}",
            f"contact, {STYLES[law][2]}",
            value,
            arrival_time(logs[law], GRASP, 0.1 * (START - GRASP)),
            "s",
            0.1,
            reasons[law],
        )
        for law, value in zip(("grasping", "classical"), printed.contact, strict=True)
        if np.isfinite(value)
    ]


def _force_claims(logs: dict[str, Log], printed: Printed) -> list[Claim]:
    nothing = (
        "the law cancels f_e or rests at q_f, which is the body's own place: it arrives without pressing; K_p q_f is "
        "the force of the virtual spring, not of the contact"
    )
    claims = [
        _claim(f"impact-{law}", f"impact force, {STYLES[law][2]}", value, float(logs[law].contact_force.max()), "N·m",
               0.05, nothing)
        for law, value in zip(NAMES, printed.impact, strict=True)
    ]  # fmt: skip
    claims += [
        _claim(f"settled-{law}", f"f_d = 0.20 within 5 %, {STYLES[law][2]}", value,
               settling_time(logs[law], FORCE), "s", 0.2, nothing)
        for law, value in zip(NAMES, printed.settled, strict=True)
        if np.isfinite(value)
    ]  # fmt: skip
    claims.append(
        Claim(
            "force-regulated",
            f"f_d reached without steady-state error, {STYLES['regulated'][2]}",
            Origin.OURS,
            "our law",
            (FORCE,),
            "N·m",
            0.01 * FORCE,
            [Finding((float(logs["regulated"].contact_force[-500:].mean()),))],
            "=",
            "by moving q_f with the measured contact force",
        )
    )
    peaks = [float(logs[law].contact_force.max()) for law in ("regulated", "classical-regulated")]
    claims.append(
        Claim("impact-regulated", "peak force of ours over that of the classical law, both regulated alike, is below 1",
              Origin.OURS, "our law", (1.0,), "", 0.0, [Finding((peaks[0] / peaks[1],))], "<=",
              f"{peaks[0]:.2f} and {peaks[1]:.2f} N·m; a soft body is hardly hit, and ours overshoots a little")
    )  # fmt: skip
    return claims


def _figure(logs: dict[str, Log], body: str, quantity: str, name: str) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.5, 4.8), layout="constrained")
    axes = figure.subplots()
    for law, (color, line, label) in STYLES.items():
        log = logs[law]
        values = log.position[:, 0] if quantity == "position" else log.contact_force
        axes.plot(log.time, values, color=color, linestyle=line, label=label)
    axes.axhline(GRASP if quantity == "position" else FORCE, color="black", linewidth=0.6)
    label = "q [rad] (line: where the body begins)" if quantity == "position" else "contact force [N·m] (line: f_d)"
    axes.set(xlabel="t [s]", ylabel=label, title=f"Figure {name[4:].replace('-', '.')}: {quantity}, {body} body")
    axes.legend(fontsize=8)
    axes.grid(alpha=0.25)
    return figure
