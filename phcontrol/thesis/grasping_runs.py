"""The runs of section 4.2: the thesis's laws, with its gains, on a rigid and a compliant body, under each reading."""

from __future__ import annotations

from functools import cache
from typing import Any

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
from phcontrol.thesis.constant_mass_grasping import ConstantMassGrasping
from phcontrol.thesis.measures import settling_time, touch_time
from phcontrol.thesis.printed_coupling import PrintedCoupling
from phcontrol.thesis.reversed_compensation import ReversedCompensation

START, PLACE, FORCE = 0.30, 0.20, 0.20
"""q(0), where the body begins [rad], f_d [N·m]."""
VIRTUAL = {"R1": 0.0, "R2": 0.20}
"""The virtual position q_f [rad] under each reading."""
REST_LENGTH = "q_rl(0) = 0, which the thesis does not print"
STRETCHED = -0.20
"""A rest length q_rl(0) with which the rest-length law touches under R2 too [rad]: chosen for the printed times."""
DURATION, REGULATED_DURATION, DT = 12.0, 30.0, 2e-3  # [s]
NOISE, PERIOD = 0.01, 0.01  # stand-in for the measurements: [N·m], [s]
READ_TIME, READ_LONG, READ_FORCE, READ_ANGLE = 0.025, 0.25, 0.025, 0.01
"""How finely the figures' numbers are given, half of what they are multiples of: of 0.05 s, of 0.5 s where a force is
there after "t > 2 s", of 0.05 N·m (the thesis prints N). And how far two curves of a figure may be apart and still be
called one on top of the other [rad]."""
ALLOYS = {False: (150.0, 1.0), True: (60.0, 1.0)}
"""Stiffness [N·m/rad] and damping [N·m·s/rad] chosen for the rigid body, in simulation and stand-in: with them the
classical law (4.60) has the printed impact, and (4.61) too with f_e reversed."""
FOAMS = {False: (35.0, 0.5), True: (6.0, 0.5)}
"""Likewise for the foam, with (4.60); the printed stiffness, 0.1 N·m/rad, needs 2 rad for 0.2 N·m."""
COUPLED = (0.5, 0.01, 0.1, 5.0)
"""Masses m_c of the body coupled as (4.65) and (4.66) print it [kg·m²], which the thesis does not print: that of the
gripper, and others."""
LAWS = ("grasping", "classical-compensated", "classical")
"""The thesis's three, in the order in which it gives their impacts."""
LAW_NAMES = {
    "grasping": "rest-length law (4.59)",
    "grasping-general": "rest-length law, general (4.47)",
    "classical-compensated": "classical, f_e cancelled (4.61)",
    "classical-reversed": "classical, f_e reversed (4.61)",
    "classical": "classical (4.60)",
    "regulated": "ours: rest-length law, q_f regulated",
    "classical-regulated": "ours: classical, q_f regulated alike",
}


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
        return RigidBody(where, stiffness=FOAMS[sampled][0], damping=FOAMS[sampled][1], onset=1e-4)
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
def grasp_logs(body: str, sampled: bool) -> dict[str, Log]:
    """Run all laws on one body under both readings, as "R1-grasping"; position and force figure share them."""
    system = MechanicalSystem(load_robot("pera_gripper"))
    logs = {}
    for reading in VIRTUAL:
        for name, law in make_laws(system, body, reading).items():
            duration = REGULATED_DURATION if name.endswith("regulated") else DURATION
            logs[f"{reading}-{name}"] = grasp(law, make_body(body, name, sampled), sampled=sampled, duration=duration)
    if body == "compliant" and not sampled:
        logs |= {f"R8-{name}": log for name, log in coupled_logs(COUPLED[0]).items()}
    if body == "compliant":
        for name, law in make_laws(system, body, "R1").items():
            logs[f"R1-foam-{name}"] = grasp(law, make_body("chosen foam", name, sampled), sampled=sampled)
    return logs


@cache
def coupled_logs(mass: float) -> dict[str, Log]:
    """Run the thesis's laws on the body coupled as (4.65) and (4.66) print it, with a mass m_c [kg·m²]."""
    laws = make_laws(MechanicalSystem(load_robot("pera_gripper")), "compliant", "R1")
    body = PrintedCoupling(JointContact("gripper", PLACE), stiffness=0.1, damping=0.1, mass=mass)
    return {name: grasp(laws[name], body) for name in LAWS}


@cache
def spring_at_a_stop() -> tuple[float, float, float]:
    """Return the force of the virtual spring, (4.39), where a stop holds the fingers at 0.20 rad, under R1.

    At contact and in the end [N·m], and from when it is within 5 % of f_d [s]. No f_e of the stop is measured.
    """
    law = make_laws(MechanicalSystem(load_robot("pera_gripper")), "rigid", "R1")["grasping"]
    log = grasp(law.changed(cancels_force=False), make_body("rigid", "regulated"))
    spring = log.position[:, 0] - log.controller_state[:, 0]  # K_p = 1, q_f = 0
    away = np.flatnonzero(np.abs(spring - FORCE) > 0.05 * FORCE)
    return float(spring[log.time >= touch_time(log)][0]), float(spring[-1]), float(log.time[away[-1] + 1])


@cache
def pressed_at_last() -> tuple[float, float]:
    """Return when the rest-length law touches the alloy, and holds it with f_d to 5 %, where it begins f_d/k early [s].

    Under R2: at q_f, whither the law leads, a body that begins at q_f + f_d/k answers with f_d.
    """
    stiffness, damping = ALLOYS[False]
    where = JointContact("gripper", PLACE + FORCE / stiffness)
    law = make_laws(MechanicalSystem(load_robot("pera_gripper")), "rigid", "R2")["grasping"]
    body = RigidBody(where, stiffness=stiffness, damping=damping, onset=1e-4)
    log = grasp(law, body, duration=REGULATED_DURATION)
    return touch_time(log), settling_time(log, FORCE)


@cache
def printed_contacts(body: str, sampled: bool) -> dict[str, float]:
    """Return when (4.59) touches with the sign of (4.44) as printed, under each reading [s]."""
    system = MechanicalSystem(load_robot("pera_gripper"))
    times = {}
    for reading in VIRTUAL:
        law = make_laws(system, body, reading)["grasping"].changed(printed_sign=True)
        times[reading] = touch_time(grasp(law, make_body(body, "grasping", sampled), sampled=sampled, duration=1.0))
    return times


@cache
def stretched_contact(body: str, sampled: bool) -> float:
    """Return when (4.59) touches under R2 with another rest length at the start [s]."""
    law = make_laws(MechanicalSystem(load_robot("pera_gripper")), body, "R2")["grasping"]
    return touch_time(grasp(law, make_body(body, "grasping", sampled), sampled=sampled, duration=1.5, rest=STRETCHED))


@cache
def contact_damped_alike() -> float:
    """Return when the classical law touches with K_Hd = C = 1.5, the compliant body's C [s]."""
    law = make_laws(MechanicalSystem(load_robot("pera_gripper")), "compliant", "R1")["classical"].changed(damping=1.5)
    return touch_time(grasp(law, make_body("compliant", "classical"), duration=2.0))
