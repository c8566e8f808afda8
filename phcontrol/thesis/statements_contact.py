"""Statements of chapter 4: conditions of the force law, the port of the rest length, the law for the gripper."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import root

from phcontrol._validation import Array
from phcontrol.controllers.impedance_grasping import ImpedanceGrasping
from phcontrol.controllers.virtual_position import virtual_position
from phcontrol.environments.contact_geometry import JointContact
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import Measured
from phcontrol.thesis.claim import Claim
from phcontrol.thesis.constant_mass_grasping import ConstantMassGrasping
from phcontrol.thesis.exact import exact, largest_real_part, negative, off, positive, rate, slope
from phcontrol.thesis.fig_3_1 import GOAL
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.origin import Origin
from phcontrol.thesis.printed_coupling import PrintedCoupling
from phcontrol.thesis.statements_plant import draw, shoulder

SPRING = 20.0  # K_p of remark 4.2.1 on three joints [N·m/rad]
FORCE_GAIN = np.array([0.5, 4.0])  # diagonal of a K_z with two gains: κ₁, κ₂
GRIPPER: dict[str, Any] = {
    "goal": [0.0],
    "stiffness": 1.0,
    "rest_stiffness": 0.5,
    "damping": 3.0,
}  # of section 4.2.2, R1


def contact_claims() -> list[Claim]:
    """Return the claims of chapter 4 that no figure shows."""
    return [_positive_form(), _in_space(), _port(), _stable(), _law_for_the_gripper(), _coupling()]


def _positive_form() -> Claim:
    def least(epsilon: float) -> float:
        form = block_diag(np.diag(1.0 / FORCE_GAIN), np.eye(2))
        form[:2, 2:] = form[2:, :2] = epsilon * np.eye(2)
        return float(np.linalg.eigvalsh(form)[0])

    below = [0.999 / np.sqrt(bound) for bound in FORCE_GAIN]
    chosen = "K_z = diag(0.5, 4), ε 0.1 % below the bound"
    return positive(
        "force-form", "(4.22) is positive definite for every ε that (4.13) allows: least eigenvalue",
        "Theorem 4.1.1, (4.13), (4.22) to (4.24)",
        [Finding((least(below[0]),), chosen=chosen), Finding((least(below[1]),), "E25", chosen=chosen)],
        "K_z ≤ κ₂ is what bounds ε, not κ₁; for a K_z with one gain, as in section 4.1.2, they are the same",
    )  # fmt: skip


def _in_space() -> Claim:
    """Hold the force with which a spring to the q_f of (4.40) presses, where the arm is held, to F_d."""
    system = MechanicalSystem(load_robot("pera_shoulder_elbow"))
    worst, asked = {"printed": 0.0, "corrected": 0.0}, np.array([1.0, -2.0, 3.0])
    for x, _ in draw(system, 0):
        held = system.robot.home + 0.2 * x.position

        def joint_force(q: Array) -> Array:
            return np.asarray(system.at(q).frame_jacobian("tool", "local_world_aligned")[:3].T @ asked)

        lever = slope(lambda q: np.array(system.at(q).placement("tool").translation), held)
        goals = {
            "printed": root(lambda q, c=held: SPRING * (q - c) - joint_force(q), held, tol=1e-13).x,
            "corrected": virtual_position(system, "tool", asked, SPRING, contact=held).position,
        }
        for name, goal in goals.items():
            # F·ṙ is the power of the spring's torque, whatever way the hand is moved
            worst[name] = max(worst[name], off(np.linalg.solve(lever, SPRING * (goal - held)), asked))
    return exact(
        "force-in-space", "the virtual spring to the q_f of (4.40) presses with F_d in space where the arm is held",
        "remark 4.2.1, (4.40)", worst["printed"], worst["corrected"], "E43",
        "𝒥 of (4.40) is that of q_f, where the arm is not while it presses. By virtual work, with the hand's "
        "displacements by finite differences",
        f"F_d = (1, -2, 3) N, K_p = {SPRING:g} N·m/rad, the three joints held near q = (0, 0.7, -1.8) rad",
        origin=Origin.TEXT,
    )  # fmt: skip


def _grasping(system: MechanicalSystem) -> ImpedanceGrasping:
    return ImpedanceGrasping(system, goal=GOAL, stiffness=1.0, rest_stiffness=0.5, damping=3.0)


def _port() -> Claim:
    law = _grasping(shoulder())
    worst = {"printed": 0.0, "sign": 0.0, "corrected": 0.0}
    for x, drawn in draw(law.system, 4):
        rest, force = drawn[:2], drawn[2:]
        command = law.evaluate(0.0, x, rest, Measured(external_force=force))

        def virtual(there: Array, own: Array) -> float:
            e = there - GOAL - own
            return float(0.5 * e @ law.stiffness @ e + 0.5 * own @ law.rest_stiffness @ own)  # (4.38)

        acceleration = x.acceleration(command.torque, force)
        grown = rate(lambda y, own: virtual(y.position, own), x, acceleration, rest, command.state_rate)
        spring = law.stiffness @ (x.position - GOAL - rest)
        ports = {
            "printed": x.transformed_input.T @ (spring + law.rest_stiffness @ rest),
            "sign": x.transformed_input.T @ (law.rest_stiffness @ rest - spring),
            "corrected": law.rest_stiffness @ rest - spring,
        }
        for name, y_rl in ports.items():
            worst[name] = max(worst[name], off(spring @ x.velocity + y_rl @ command.state_rate, grown))
    return exact(
        "rest-length-port", "u_rl and y_rl of (4.45), (4.46) are a port of H_c: with the arm's power y_rlᵀu_rl makes "
        "up its rate", "remark 4.2.2, (4.38), (4.45), (4.46)", worst["printed"], worst["corrected"], "E15, E39",
        f"with E15 alone {worst['sign']:.2g}; of (4.47) with E15 and E27", already="E15 in (4.44)", origin=Origin.TEXT,
    )  # fmt: skip


def _stable() -> Claim:
    law = _grasping(shoulder())

    def loop(y: Array) -> Array:
        x = law.system.at(y[:2], y[2:4])
        command = law.evaluate(0.0, x, y[4:], Measured(external_force=np.zeros(2)))
        return np.concatenate([y[2:4], x.acceleration(command.torque), command.state_rate])

    found = largest_real_part(loop, np.concatenate([GOAL, np.zeros(4)]))
    return negative(
        "grasping-stable", "impedance grasping brings the arm to q_f asymptotically: largest real part of the "
        "eigenvalues of the true loop", "Theorem 4.2.3", [Finding((found,), "E15, E27")],
        "the shoulder, with f_e cancelled", "1/s",
    )  # fmt: skip


def _law_for_the_gripper() -> Claim:
    """Compare (4.59) with the law that makes (4.56) of the gripper."""
    system = MechanicalSystem(load_robot("pera_gripper"))
    simulated, general = ConstantMassGrasping(system, **GRIPPER), ImpedanceGrasping(system, **GRIPPER)
    errors, mass = {"printed": 0.0, "mended": 0.0}, float(system.at([0.2]).mass_matrix[0, 0])
    for x, drawn in draw(system, 2):
        rest, measured = drawn[:1], Measured(external_force=drawn[1:])
        printed = simulated.evaluate(0.0, x, rest, measured).torque
        true = general.evaluate(0.0, x, rest, measured)
        spring = 1.0 * (x.position - rest)
        output = x.velocity + spring
        mended = (
            x.potential_gradient - x.damping * spring - mass * (x.velocity - true.state_rate) + 0.5 * rest
            - 3.0 * output - 2.0 * spring - drawn[1:]
        )  # fmt: skip
        errors["printed"] = max(errors["printed"], off(printed, true.torque))
        errors["mended"] = max(errors["mended"], off(mended, true.torque))
    return exact(
        "law-for-the-gripper", "(4.59) is the law with which the gripper's loop is (4.56)",
        "section 4.2.2, (4.47), (4.59)", errors["printed"], errors["mended"], "E15, E27, E28",
        "for m_g = 0.5: a factor m_g before K_p(q̇ - q̇_rl), none in C(q̇ + …), and -2K_p(q̄ - q_rl)", origin=Origin.TEXT,
    )  # fmt: skip


def _coupling() -> Claim:
    """Hold the energy of gripper and body, coupled as (4.65) and (4.66) print it, to what is supplied and lost."""
    system = MechanicalSystem(load_robot("pera_gripper"))
    body = PrintedCoupling(JointContact("gripper", 0.2), stiffness=0.1, damping=0.1, mass=0.5)
    worst = 0.0
    for x, drawn in draw(system, 3):
        closed = system.at([-abs(x.position[0])], x.velocity)  # beyond where the body begins
        torque, state = drawn[:1], drawn[1:]
        touched = body.touch(closed, state)
        acceleration = closed.acceleration(torque, touched.force)
        grown = rate(
            lambda y, own: y.energy + body.touch(y, own).stored, closed, acceleration, state, touched.state_rate
        )
        lost = closed.velocity @ closed.friction_torque + 0.1 * (state[1] / 0.5) ** 2
        worst = max(worst, off(torque @ closed.velocity - lost, grown))
    return exact(
        "coupling", "(4.65) and (4.66) interconnect gripper and body without loss: H + H_c changes by what u brings "
        "and d_g, d_c take", "section 4.2.2, (4.63) to (4.66)", worst,
        reason="f_e q̇ + u_c y_c = 0. It is a gyrator, no contact: at rest there is no force, and the figures' 0.20 "
        "N·m is not in it (R8)", origin=Origin.TEXT,
    )  # fmt: skip
