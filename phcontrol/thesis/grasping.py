"""Thesis figures 4.2 to 4.5 and 4.7 to 4.10: grasping a rigid and a compliant body, under both readings of q_f."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
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
from phcontrol.thesis.constant_mass_grasping import ConstantMassGrasping
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.measures import impact_force, settling_time, touch_time
from phcontrol.thesis.origin import Origin
from phcontrol.thesis.printed_coupling import PrintedCoupling
from phcontrol.thesis.reversed_compensation import ReversedCompensation
from phcontrol.thesis.study import Outcome

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

START, PLACE, FORCE = 0.30, 0.20, 0.20
"""q(0), where the body begins [rad], f_d [N·m]."""
VIRTUAL = {"R1": 0.0, "R2": 0.20}
"""The virtual position q_f [rad] under each reading."""
REST_LENGTH = "q_rl(0) = 0, which the thesis does not print"
STRETCHED = -0.20
"""A rest length q_rl(0) with which the rest-length law touches under R2 too [rad]: chosen for the printed times."""
DURATION, REGULATED_DURATION, DT = 12.0, 30.0, 2e-3  # [s]
NOISE, PERIOD = 0.01, 0.01  # stand-in for the measurements: [N·m], [s]
READ_TIME, READ_LATER, READ_LONG, READ_FORCE, READ_ANGLE = 0.025, 0.05, 0.25, 0.025, 0.01
"""How finely the figures' numbers are given, half of what they are multiples of: of 0.05 s up to a second, of 0.1 s
beyond, of 0.5 s where a force is there after "t > 2 s", of 0.05 N·m (the thesis prints N). And how
far two curves of a figure may be apart and still be called one on top of the other [rad]."""
ALLOYS = {False: (150.0, 1.0), True: (70.0, 1.0)}
"""Stiffness [N·m/rad] and damping [N·m·s/rad] chosen for the rigid body, in simulation and stand-in: with them the
classical law (4.60) has the printed impact."""
FOAM = (35.0, 0.5)  # likewise for the foam; the printed stiffness, 0.1 N·m/rad, needs 2 rad for 0.2 N·m
COUPLED = (0.5, 0.01, 0.1, 5.0)
"""Masses m_c of the body coupled as (4.65) and (4.66) print it [kg·m²], which the thesis does not print: that of the
gripper, and others."""
FOAM_TEXT = f"foam of {FOAM[0]:g} N·m/rad and {FOAM[1]:g} N·m·s/rad instead of the printed numbers"
STYLES = {
    "grasping": ("#0072b2", "-", "rest-length law (4.59)"),
    "grasping-general": ("#56b4e9", "--", "rest-length law, general (4.47)"),
    "classical-compensated": ("#d55e00", "--", "classical, f_e cancelled (4.61)"),
    "classical-reversed": ("#e69f00", "-.", "classical, f_e reversed (4.61)"),
    "classical": ("black", ":", "classical (4.60)"),
    "regulated": ("#009e73", "-", "ours: rest-length law, q_f regulated"),
    "classical-regulated": ("#cc79a7", "-.", "ours: classical, q_f regulated alike"),
}
LAWS = ("grasping", "classical-compensated", "classical")
"""The thesis's three, in the order in which it gives their impacts."""


@dataclass(frozen=True)
class Printed:
    """The thesis's numbers for one body."""

    contact: tuple[float, float | None]
    """Of the rest-length law and the classical ones [s]."""
    impact: tuple[float, float, float]
    """In the order of ``LAWS`` [N·m]."""
    settled: tuple[float, float | None, float | None]
    """When f_d is there, likewise [s]: "at t > 0.90 s", "(4.60) and (4.61) take t > 2 s, and t > 2.5 s"."""


PRINTED = {
    ("rigid", False): Printed((0.60, 0.80), (0.10, 0.40, 0.60), (0.90, 2.5, 2.0)),
    ("compliant", False): Printed((0.80, 1.30), (0.00, 0.20, 0.30), (0.90, 2.5, 2.0)),
    ("rigid", True): Printed((0.55, None), (0.05, 0.25, 0.40), (0.70, None, None)),
    ("compliant", True): Printed((0.78, None), (0.00, 0.05, 0.15), (1.20, None, None)),
}


def run(name: str, body: str, quantity: str, sampled: bool) -> Outcome:
    """Run one of the figures: all laws on a body, with positions or forces as the figure."""
    logs = _logs(body, sampled)
    printed = PRINTED[(body, sampled)]
    claims = _position_claims(body, sampled, printed) if quantity == "position" else _force_claims(body, sampled)
    if sampled:
        claims = [replace(claim, stand_in=claim.origin.of_the_thesis) for claim in claims]
    kind = "a stand-in for the measurement: sampled at 10 ms, noisy force" if sampled else "simulation"
    notes = [
        "R1: the body stands at 0.20 rad, the virtual position is 0, against the printed q_f = 0.20. R2: both are at "
        f"0.20 rad, and with {REST_LENGTH}, no law touches; there only our laws grasp, which move q_f by the "
        "measured force.",
        "forces of the thesis are printed in N, K_p without a unit: read as N·m and N·m/rad, of the one joint.",
        f"chosen: {_body_text(body, sampled)}.",
        *([f"NOT the thesis's measurement, but a simulation: control every {PERIOD} s, force noise of {NOISE} N·m."]
          * sampled),
    ]  # fmt: skip
    title = f"grasping {quantity} of a {body} body ({kind})"
    return Outcome(
        name, title, logs, claims, {name: lambda: _figure(logs, body, quantity, name, printed)}, tuple(notes)
    )


def _body_text(body: str, sampled: bool) -> str:
    if body == "rigid":
        return "alloy of {:g} N·m/rad and {:g} N·m·s/rad, so that (4.60) has the printed impact".format(
            *ALLOYS[sampled]
        )
    return (
        "mass of the foam 0.01 kg·m², its surface 50 N·m/rad; the foam's K_c and d_c are the printed ones unless said "
        "otherwise; coupled by (4.65), f_e = -y_c, and (4.66), as printed, under R8, elsewhere by what touches"
    )


# --- laws, bodies and runs ------------------------------------------------------------------------------------


def make_laws(system: MechanicalSystem, body: str, reading: str) -> dict[str, Controller]:
    """Return the thesis's laws with its gains for a body.

    Under R1 also (4.61) with f_e reversed; under R2, where they do not touch, two of ours.
    """
    rest, damping = (0.5, 3.0) if body == "rigid" else (0.25, 1.5)
    goal = [VIRTUAL[reading]]
    grasp: dict[str, Any] = {"goal": goal, "stiffness": 1.0, "rest_stiffness": rest, "damping": damping}
    classical: dict[str, Any] = {"goal": goal, "stiffness": 1.0, "damping": 3.0}
    laws: dict[str, Controller] = {
        "grasping": ConstantMassGrasping(system, **grasp),
        "grasping-general": ImpedanceGrasping(system, **grasp),
        "classical-compensated": ClassicalImpedance(system, **classical, compensate_external_force=True),
        "classical": ClassicalImpedance(system, **classical),
    }
    if reading == "R1":
        laws["classical-reversed"] = ReversedCompensation(system, **classical, compensate_external_force=True)
    else:
        regulation = ForceRegulation([FORCE], gain=0.3, rate_limit=0.5)
        laws["regulated"] = ImpedanceGrasping(system, **grasp, regulation=regulation)
        laws["classical-regulated"] = ClassicalImpedance(system, **classical, regulation=regulation)
    return laws


def make_body(body: str, law: str, sampled: bool = False) -> Body:
    """Return the rigid or the compliant body of section 4.2.2; our regulated laws grasp harder ones."""
    where = JointContact("gripper", PLACE)
    ours = law.endswith("regulated")
    if body == "rigid":
        stiffness, damping = (2000.0, 10.0) if ours else ALLOYS[sampled]
        return RigidBody(where, stiffness=stiffness, damping=damping, onset=1e-4)
    if body == "chosen foam":
        return RigidBody(where, stiffness=FOAM[0], damping=FOAM[1], onset=1e-4)
    return CompliantBody(
        where, stiffness=2.0 if ours else 0.1, damping=0.1, mass=0.01, surface_stiffness=50.0, surface_damping=0.5
    )


def grasp(
    law: Controller, body: Body, *, sampled: bool = False, duration: float = DURATION, rest: float | None = None
) -> Log:
    """Close the gripper on a body from q(0) = 0.30 rad, with a rest length q_rl(0) if given [rad]."""
    options: dict[str, Any] = {} if rest is None else {"controller_state0": [rest]}
    if sampled:
        options |= {"control_period": PERIOD, "sensors": [ForceSensor(noise=NOISE, period=PERIOD)]}
    return simulate(law.system, law, duration=duration, dt=DT, q0=[START], bodies=[body], torque_limit=None, **options)


@cache
def _logs(body: str, sampled: bool) -> dict[str, Log]:
    """Run all laws on one body under both readings, as "R1-grasping"; position and force figure share them."""
    system = MechanicalSystem(load_robot("pera_gripper"))
    logs = {}
    for reading in VIRTUAL:
        for name, law in make_laws(system, body, reading).items():
            duration = REGULATED_DURATION if name.endswith("regulated") else DURATION
            logs[f"{reading}-{name}"] = grasp(law, make_body(body, name, sampled), sampled=sampled, duration=duration)
    if body == "compliant" and not sampled:
        logs |= {f"R8-{name}": log for name, log in _coupled(COUPLED[0]).items()}
    if body == "compliant":
        for name, law in make_laws(system, body, "R1").items():
            logs[f"R1-foam-{name}"] = grasp(law, make_body("chosen foam", name), sampled=sampled)
    return logs


@cache
def _coupled(mass: float) -> dict[str, Log]:
    """Run the thesis's laws on the body coupled as (4.65) and (4.66) print it, with a mass m_c [kg·m²]."""
    laws = make_laws(MechanicalSystem(load_robot("pera_gripper")), "compliant", "R1")
    body = PrintedCoupling(JointContact("gripper", PLACE), stiffness=0.1, damping=0.1, mass=mass)
    return {name: grasp(laws[name], body) for name in LAWS}


@cache
def _spring_at_a_stop() -> float:
    """Return the force of the virtual spring in the end, (4.39), where a stop holds the fingers at 0.20 rad [N·m]."""
    law = make_laws(MechanicalSystem(load_robot("pera_gripper")), "rigid", "R1")["grasping"]
    log = grasp(law.changed(cancels_force=False), make_body("rigid", "regulated"))
    return float(log.position[-1, 0] - log.controller_state[-1, 0])  # K_p = 1, q_f = 0


@cache
def _as_printed(body: str, sampled: bool) -> dict[str, float]:
    """Return when (4.59) touches with the sign of (4.44) as printed, under each reading [s]."""
    system = MechanicalSystem(load_robot("pera_gripper"))
    times = {}
    for reading in VIRTUAL:
        law = make_laws(system, body, reading)["grasping"].changed(printed_sign=True)
        times[reading] = touch_time(grasp(law, make_body(body, "grasping", sampled), sampled=sampled, duration=1.0))
    return times


@cache
def _stretched(body: str, sampled: bool) -> float:
    """Return when (4.59) touches under R2 with another rest length at the start [s]."""
    law = make_laws(MechanicalSystem(load_robot("pera_gripper")), body, "R2")["grasping"]
    return touch_time(grasp(law, make_body(body, "grasping", sampled), sampled=sampled, duration=1.5, rest=STRETCHED))


@cache
def _damped_alike() -> float:
    """Return when the classical law touches with K_Hd = C = 1.5, the compliant body's C [s]."""
    law = make_laws(MechanicalSystem(load_robot("pera_gripper")), "compliant", "R1")["classical"].changed(damping=1.5)
    return touch_time(grasp(law, make_body("compliant", "classical"), duration=2.0))


# --- claims ---------------------------------------------------------------------------------------------------


def _where(body: str, sampled: bool, quantity: str) -> str:
    figures = {("rigid", False): (2, 3), ("compliant", False): (4, 5), ("rigid", True): (7, 8)}
    figure = figures.get((body, sampled), (9, 10))[quantity == "force"]
    return f"section 4.2.{3 if sampled else 2}, figure 4.{figure}"


def _position_claims(body: str, sampled: bool, printed: Printed) -> list[Claim]:
    logs, where = _logs(body, sampled), _where(body, sampled, "position")
    touch = {key: touch_time(log) for key, log in logs.items()}
    literal = _as_printed(body, sampled)
    claims = [
        Claim(
            "contact-grasping", "first contact with the rest-length law (4.59)", Origin.FIGURE, where,
            (printed.contact[0],), "s", READ_TIME,
            [
                *(Finding((literal[reading],), reading=reading, chosen=REST_LENGTH) for reading in VIRTUAL),
                *(Finding((touch[f"{reading}-grasping"],), "E15", reading, REST_LENGTH) for reading in VIRTUAL),
                Finding((_stretched(body, sampled),), "E15", "R2", f"q_rl(0) = {STRETCHED} rad", fitted=True),
            ],
            reason=f"of (4.59), for a constant mass; the general law (4.47) touches "
            f"at {touch['R1-grasping-general']:.2f} s under R1. Before contact no body "
            "matters, so that the simulation and the stand-in differ by sampling alone",
        )
    ]  # fmt: skip
    if printed.contact[1] is not None:
        claims += [
            Claim(
                "contact-classical", "first contact with the classical laws (4.60), (4.61)", Origin.FIGURE, where,
                (printed.contact[1],), "s", READ_TIME if printed.contact[1] <= 1.0 else READ_LATER,
                [Finding((touch[f"{reading}-classical"],), reading=reading) for reading in VIRTUAL],
                reason="before contact the body does not matter, so that with K_Hd = 3, as printed for both bodies, "
                "figures 4.2 and 4.4 are of one motion, yet print 0.80 s and 1.30 s. The note \"we choose K_Hd = C\" "
                f"would make it 1.5 for the compliant body, and {_damped_alike():.2f} s, beside "
                f"{touch['R1-classical']:.2f} s with 3: near the two printed times, but each at the other body",
            ),
            Claim(
                "contact-earlier", "contact is earlier with the rest-length law than with the classical one: ratio",
                Origin.TEXT, where, (1.0,), "", 0.0,
                [Finding((_ratio(touch["R1-grasping"], touch["R1-classical"]),), "E15", "R1", REST_LENGTH),
                 Finding((_ratio(touch["R2-grasping"], touch["R2-classical"]),), "E15", "R2", REST_LENGTH)],
                "<=", "under R2 neither touches",
            ),
        ]  # fmt: skip
    apart = {group: _apart(logs, group, "classical-compensated") for group in VIRTUAL}
    reversed_in = ["R1", *(["R1-foam"] * (body == "compliant"))]
    never = "neither touches, so that f_e = 0 but for noise, and then (4.61) is (4.60)"
    claims.append(
        Claim(
            "on-top", "the classical law with f_e cancelled (4.61) runs on top of (4.60): farthest apart",
            Origin.FIGURE, where, (0.0,), "rad", READ_ANGLE,
            [Finding((apart["R1"],), reading="R1"),
             Finding((apart["R2"],), reading="R2", vacuous=never),
             *(Finding((_apart(logs, "R8", "classical-compensated"),), reading="R1, R8", chosen=COUPLED_MASS)
               for _ in range("R8-classical" in logs)),
             *(Finding((_apart(logs, group, "classical-reversed"),), reading="R1", chosen=_reversed_on(group),
                       fitted=True) for group in reversed_in)],
            reason="once there is contact, (4.60) is held by the body and (4.61), which does not feel it, is not; with "
            "the sign of f_e reversed it is held twice",
        )
    )  # fmt: skip
    return claims


def _apart(logs: dict[str, Log], group: str, law: str) -> float:
    """Return how far a law's position is at most from that of (4.60) [rad]."""
    return float(np.abs(logs[f"{group}-classical"].position - logs[f"{group}-{law}"].position).max())


def _reversed_on(group: str) -> str:
    """Return what is chosen for (4.61) with f_e reversed, which the text does not say."""
    return "the sign of f_e in (4.61) reversed" + (f"; {FOAM_TEXT}" if group == "R1-foam" else "")


def _ratio(ours: float, theirs: float) -> float:
    return ours / theirs if math.isfinite(ours) and math.isfinite(theirs) and theirs > 0.0 else math.inf


GROWS = (
    "(4.59) and (4.61) cancel the f_e that they measure, so that nothing which the body does can hold them: they close "
    "until q = q_f, and the force is what the body answers, more and more on the way (R1); or, with q_rl(0) = 0, they "
    "never touch (R2). By (4.65) as printed f_e = -y_c is a velocity, and no force is left at rest either. "
    "K_p q_f of (4.39) is the force of the virtual spring, not of the contact. Nor would (4.59) without -f_e do: it "
    "would rest where f_e = (d_g + C) K_p 0.20 N·m"
)
COUPLED_MASS = f"m_c = {COUPLED[0]:g} kg·m², as the gripper's"
NOT_FELT = "it cancels the f_e that it measures: it presses on, whatever the body answers (R1), or never touches (R2)"
OUT_OF_ORDER = (
    f"{NOT_FELT}. Up to contact (4.60) and (4.61) are one law and hit the body equally fast; then (4.61), with the "
    "printed sign, does not feel it and presses deeper. With the sign of f_e reversed its impact is the lower one, as "
    "is printed, but then it rests at 0.10 N·m, not at f_d"
)


ALIKE = "on the foam's printed numbers (4.60) and (4.61) have one impact, whatever they do with f_e"


def _late(body: str) -> str:
    """Return why the classical law is settled when it is."""
    if body == "compliant":
        return "the foam's printed numbers do not answer with f_d; the time is that of the approach, and of the band"
    log = _logs("rigid", False)["R1-classical"]
    return f"within 10 % it would be {settling_time(log, FORCE, 0.1):.2f} s: the band is ours, and was not fitted"


def _force_claims(body: str, sampled: bool) -> list[Claim]:
    logs, where, printed = _logs(body, sampled), _where(body, sampled, "force"), PRINTED[(body, sampled)]
    impact = {key: impact_force(log) for key, log in logs.items()}
    settled = {key: settling_time(log, FORCE) for key, log in logs.items()}
    compliant = body == "compliant"
    alloy = "" if compliant else _body_text(body, sampled)

    def findings(values: dict[str, float], law: str, fitted: bool) -> list[Finding]:
        erratum = "E15" if law == "grasping" else ""
        untouched = "it never touches" if values[f"R2-{law}"] == 0.0 else ""
        same = ALIKE if compliant and fitted and law != "grasping" else ""
        found = [
            Finding((values[f"R1-{law}"],), erratum, "R1", alloy, fitted=fitted and not compliant, vacuous=same),
            Finding((values[f"R2-{law}"],), erratum, "R2", vacuous=untouched),
        ]
        if f"R8-{law}" in values:
            found.append(Finding((values[f"R8-{law}"],), erratum, "R1, R8", COUPLED_MASS))
        if values is settled and law != "grasping" and math.isfinite(values[f"R1-{law}"]):
            passed, alike = 0.5 * math.floor(2.0 * values[f"R1-{law}"]), f"in half seconds passed. {alloy}".strip()
            found.append(Finding((passed,), erratum, "R1, R9", alike, vacuous=same))
        if compliant:
            found.append(Finding((values[f"R1-foam-{law}"],), erratum, "R1", FOAM_TEXT, fitted=True))
        if law == "classical-compensated":
            found += [
                Finding((values[f"{group}-classical-reversed"],), reading="R1", chosen=_reversed_on(group), fitted=True)
                for group in ["R1-foam" if compliant else "R1"]
            ]
        return found

    reasons = {"grasping": NOT_FELT, "classical-compensated": OUT_OF_ORDER, "classical": ""}
    if compliant:
        reasons["classical"] = (
            "the printed foam (K_c = 0.1 N·m/rad) answers with 0.02 N·m at rest; for the impact of the simulation it "
            f"must be some {FOAM[0]:g} N·m/rad, and the measured one rests at f_d = 0.20 above its own impact of 0.15"
        )
    claims = [
        Claim(f"impact-{law}", f"impact force, {STYLES[law][2]}", Origin.FIGURE, where, (value,), "N·m", READ_FORCE,
              findings(impact, law, True), reason=reasons[law])
        for law, value in zip(LAWS, printed.impact, strict=True)
    ]  # fmt: skip
    for law, value in zip(LAWS, printed.settled, strict=True):
        if value is None:
            continue
        first = law == "grasping"
        statement = f"f_d = 0.20 is there, within 5 %, from: {STYLES[law][2]}"
        claims.append(
            Claim(f"settled-{law}", statement, Origin.FIGURE, where, (value,), "s",
                  READ_TIME if first else READ_LONG, findings(settled, law, False),
                  reason=_late(body) if law == "classical" else NOT_FELT)
        )  # fmt: skip
    claims += [
        Claim("steady-force", "the force of the rest-length law has no steady-state error", Origin.TEXT, where,
              (FORCE,), "N·m", 0.05 * FORCE,
              [*(Finding((float(logs[f"{group}-grasping"].contact_force[-1]),), "E15", reading, chosen)
                 for group, reading, chosen in _groups(logs, alloy)), *_at_a_stop(body, sampled)], reason=GROWS),
    ]  # fmt: skip
    if not sampled:
        claims.append(
            Claim("impact-lower", "impact with the rest-length law is lower than with the classical one: ratio",
                  Origin.TEXT, where, (1.0,), "", 0.0,
                  [Finding((_ratio(impact["R1-grasping"], impact["R1-classical"]),), "E15", "R1", alloy)], "<=",
                  "it arrives earlier, so faster, and cancels f_e: it presses deeper on any body")
        )  # fmt: skip
    if compliant and not sampled:
        rigid = {key: impact_force(log) for key, log in _logs("rigid", False).items()}
        worst = max(_ratio(impact[f"R1-{law}"], rigid[f"R1-{law}"]) for law in LAWS)
        claims.append(
            Claim("smoother", "contact is smoother with the compliant body than with the rigid one: ratio of impacts",
                  Origin.TEXT, "section 4.2.2", (1.0,), "", 0.0,
                  [Finding((worst,), "E15", "R1", vacuous="of two bodies the softer answers less, whatever the law"),
                   Finding((_coupled_impact(rigid),), "E15", "R1, R8", "the worst m_c of "
                           + ", ".join(f"{mass:g}" for mass in COUPLED) + " kg·m²")],
                  "<=", "the largest ratio of the three laws")
        )  # fmt: skip
    return claims + _own_claims(logs)


def _groups(logs: dict[str, Log], alloy: str) -> list[tuple[str, str, str]]:
    """Return the groups of runs, the readings that each is under, and what was chosen for it."""
    groups = [(reading, reading, alloy) for reading in VIRTUAL]
    return [*groups, ("R8", "R1, R8", COUPLED_MASS)] if "R8-grasping" in logs else groups


def _at_a_stop(body: str, sampled: bool) -> list[Finding]:
    """Return the force of (4.39) where a rigid body is a stop; a sensor does not show it, so not where it measured."""
    if body == "compliant" or sampled:
        return []
    return [Finding((_spring_at_a_stop(),), "E15", "R1, R7", "a body of 2000 N·m/rad; K_p(q - q_rl) after 12 s")]


def _coupled_impact(rigid: dict[str, float]) -> float:
    """Return the largest impact of any law on the body coupled as printed, of any mass, over that on the rigid one."""
    return max(_ratio(impact_force(_coupled(mass)[law]), rigid[f"R1-{law}"]) for law in LAWS for mass in COUPLED)


def _own_claims(logs: dict[str, Log]) -> list[Claim]:
    held = float(logs["R2-regulated"].contact_force[-500:].mean())
    peaks = [float(logs[f"R2-{law}"].contact_force.max()) for law in ("regulated", "classical-regulated")]
    return [
        Claim("force-regulated", f"f_d without steady-state error, {STYLES['regulated'][2]}", Origin.OURS, "our law",
              (FORCE,), "N·m", 0.01 * FORCE, [Finding((held,))], "=", "by moving q_f with the measured contact force"),
        Claim("impact-regulated", "peak force of ours over that of the classical law, both regulated alike",
              Origin.OURS, "our law", (1.0,), "", 0.0, [Finding((peaks[0] / peaks[1],))], "<=",
              f"{peaks[0]:.2f} and {peaks[1]:.2f} N·m; a soft body is hardly hit, and ours overshoots a little"),
    ]  # fmt: skip


# --- figures --------------------------------------------------------------------------------------------------


def _figure(logs: dict[str, Log], body: str, quantity: str, name: str, printed: Printed) -> Figure:
    from matplotlib.figure import Figure

    panels = {"R1": "R1: virtual position 0, body at 0.20", "R2": "R2: virtual position 0.20, where the body begins"}
    if body == "compliant":
        panels = {"R1": "R1, foam as printed", "R1-foam": f"R1, foam of {FOAM[0]:g} N·m/rad", "R2": panels["R2"]}
        if "R8-grasping" in logs:
            panels["R8"] = "R1, R8: foam as printed, coupled by (4.65) and (4.66)"
    figure = Figure(figsize=(8.5, 1.2 + 2.9 * len(panels)), layout="constrained")
    figure.suptitle(f"Figure {name[4:].replace('-', '.', 1)}: {quantity}, {body} body")
    for axes, (group, title) in zip(figure.subplots(len(panels), 1, sharey=True), panels.items(), strict=True):
        for law, (color, line, label) in STYLES.items():
            if f"{group}-{law}" in logs:
                log = logs[f"{group}-{law}"]
                values = log.position[:, 0] if quantity == "position" else log.contact_force
                axes.plot(log.time, values, color=color, linestyle=line, label=label)
        _mark(axes, quantity)
        axes.set(xlim=(0.0, 5.0 if group != "R2" else 12.0))
        if group == "R1" and quantity == "position":
            for law, time in zip(("grasping", "classical"), printed.contact, strict=True):
                if time is not None:
                    axes.plot(time, PLACE, "v", color=STYLES[law][0], label="printed time of contact")
        axes.set_title(title, fontsize=10)
        axes.grid(alpha=0.25)
    label = "q [rad] (line: where the body begins)" if quantity == "position" else "contact force [N·m] (line: f_d)"
    figure.axes[-1].set_xlabel("t [s]")
    figure.supylabel(label, fontsize=10)
    handles = {
        text: handle for axes in figure.axes for handle, text in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(list(handles.values()), list(handles), fontsize=8, loc="outside lower center", ncols=3)
    return figure


def _mark(axes: Axes, quantity: str) -> None:
    """Draw what is to be reached; forces that grow without bound leave the picture."""
    if quantity == "position":
        axes.axhspan(0.0, PLACE, color="#bbbbbb", alpha=0.25, linewidth=0.0)
        axes.axhline(PLACE, color="black", linewidth=0.6)
        axes.set_ylim(0.0, 0.31)
    else:
        axes.axhline(FORCE, color="black", linewidth=0.6)
        axes.set_ylim(-0.02, 1.2)
