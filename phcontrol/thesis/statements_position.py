"""Statements of chapter 3: force feedback, constant forces, integral action."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from phcontrol._validation import Array
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.force_feedback import ForceFeedback
from phcontrol.controllers.integral_action import IntegralAction
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import Measured
from phcontrol.thesis.claim import Claim
from phcontrol.thesis.exact import exact, largest_real_part, negative, off, positive, rate
from phcontrol.thesis.fig_3_1 import EXTENSION, GOAL, INTEGRAL_GAIN, POSITION
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.origin import Origin
from phcontrol.thesis.statements_plant import FORCE, draw, shoulder
from phcontrol.thesis.theorems import DEFINITE, storage_rate

ANY = 0.01
"""A K_f > 0 [rad²/(N·m)²·J]: (3.38) asks for no more."""
MASS = np.array([[2.0, 0.3], [0.3, 1.0]])  # a constant one, for remark 3.1.2 [kg·m²]


def position_claims() -> list[Claim]:
    """Return the claims of chapter 3 that no figure shows."""
    return [*_extension(), *_stability(), *_constant_force(), *_integral()]


def _feedback(system: MechanicalSystem) -> ForceFeedback:
    if system.n == 2:
        return ForceFeedback(system, **POSITION, **EXTENSION)
    return ForceFeedback(system, goal=[0.2], stiffness=1.0, damping=3.0, coupling=1.0, force_gain=1.0)


def _blocks(x: MechanicalState, law: ForceFeedback) -> tuple[Array, Array]:
    """Return Ĵ of (3.8) and R̂ of (3.9)."""
    n, Y = x.system.n, law.coupling @ law.force_gain
    inverse, J2, D, zero = x.inverse_factor, x.canonical_interconnection, x.transformed_damping, np.zeros((n, n))
    skew = np.block([
        [zero, inverse.T, inverse.T @ Y], [-inverse, J2, J2 @ Y], [-Y.T @ inverse, -Y.T @ J2.T, -Y.T @ J2.T @ Y],
    ])  # fmt: skip
    taken = np.block([[zero, zero, zero], [zero, D, D @ Y], [zero, Y.T @ D, Y.T @ D @ Y]])
    return skew, taken


def _extension() -> list[Claim]:
    system = shoulder()
    law = _feedback(system)
    printed = corrected = asymmetry = 0.0
    least, constant = np.inf, [0.0, 0.0]
    for x, drawn in draw(system, 2):
        moving = x.acceleration(np.zeros(2))
        inner = x.total_force()  # f_in of (3.1), held against ṗ
        assert off(inner, rate(lambda y, _: y.momentum, x, moving)) < 1e-6
        true = rate(lambda y, _: y.transformed_momentum, x, moving)  # what the row of z in (3.5) has
        printed = max(printed, off(x.solve_factor(inner), true))
        corrected = max(corrected, off(x.solve_factor(inner - x.factor_rate @ x.transformed_momentum), true))
        skew, taken = _blocks(x, law)
        asymmetry = max(asymmetry, off(skew, -skew.T))
        least = min(least, float(np.linalg.eigvalsh(0.5 * (taken + taken.T))[0]) / float(np.abs(taken).max()))
        A, K_z = law.coupling, law.force_gain
        Y = np.linalg.solve(MASS, A @ K_z)
        hatted = np.linalg.solve(MASS, MASS @ x.velocity - A @ drawn)  # M⁻¹p̂
        for i, gradient in enumerate((K_z @ drawn, np.linalg.solve(K_z, drawn))):
            constant[i] = max(constant[i], off(hatted + Y @ gradient, x.velocity))
    return [
        exact("internal-forces", "the row of z in (3.5) is (3.2) with (3.1): T⁻¹f_in in new coordinates",
              "remark 3.1.1, (3.2), (3.5)", printed, corrected, "E7", origin=Origin.TEXT),
        exact("extension-skew", "Ĵ of (3.8) is skew-symmetric", "section 3.1, (3.8)", asymmetry),
        Claim("extension-semidefinite", "R̂ of (3.9) is positive semidefinite: least eigenvalue over the largest entry",
              Origin.THEOREM, "section 3.1, (3.9)", (0.0,), "", 1e-12, [Finding((least,))], ">=", "but for rounding"),
        exact("constant-mass", "for a constant M the system (3.5) has the energy (3.10) and Y = M⁻¹AK_z: its row of q",
              "remark 3.1.2, (3.10)", constant[0], constant[1], "E30", origin=Origin.TEXT),
    ]  # fmt: skip


def _loop_rate(law: Controller, force: Array, y: Array) -> Array:
    """Return the rate of (q, q̇, controller state) of the true loop under a constant force."""
    n = law.system.n
    x = law.system.at(y[:n], y[n : 2 * n])
    command = law.evaluate(0.0, x, y[2 * n :], Measured(external_force=force))
    return np.concatenate([y[n : 2 * n], x.acceleration(command.torque, force), command.state_rate])


def _stability() -> list[Claim]:
    system, none = shoulder(), np.zeros(2)
    feedback = largest_real_part(lambda y: _loop_rate(_feedback(system), none, y), np.concatenate([GOAL, np.zeros(4)]))
    integral = IntegralAction(system, **POSITION, **EXTENSION, integral_gain=INTEGRAL_GAIN)
    # where it rests under f_e: q_d, z = 0, ξ = f_e
    rest = np.concatenate([GOAL, np.zeros(4), FORCE])
    assert np.abs(_loop_rate(integral, FORCE, rest)).max() < 1e-9
    with_force = largest_real_part(lambda y: _loop_rate(integral, FORCE, y), rest)
    text = "largest real part of the eigenvalues of the true loop"
    return [
        negative("feedback-stable", f"force feedback brings the arm to (q_d, 0, 0) asymptotically: {text}",
                 "Theorem 3.2.1", [Finding((feedback,), "E8 to E10")], "the shoulder, with the gains of section 3.4",
                 "1/s"),
        negative("integral-stable", f"integral action brings it to (q_d, 0, 0, f_e) asymptotically: {text}",
                 "Theorem 3.2.5", [Finding((with_force,), "E13")], "under f_e = (3, -3)", "1/s"),
    ]  # fmt: skip


# --- constant forces, section 3.2.3 -----------------------------------------------------------------------------


def _lever(x: MechanicalState, law: ForceFeedback) -> tuple[Array, Array]:
    """Return ĜB̄ and Y⁻¹ĜB̄ of (3.36), without their signs."""
    Y = law.coupling @ law.force_gain
    upper: Array = np.linalg.solve(x.transformed_injection(law.damping), x.inverse_factor).astype(float)
    lower: Array = np.linalg.solve(Y, upper).astype(float)
    return upper, lower


def _forced(x: MechanicalState, z: Array, law: ForceFeedback, force: Array, sign: float) -> float:
    """Return H_r of (3.37) with a sign of f_eᵀ(…): +1 as printed, −1 as E29 has it [J]."""
    upper, lower = _lever(x, law)
    hatted = x.transformed_momentum - law.coupling @ z
    return law.storage(0.0, x, z) + sign * float(force @ (upper.T @ hatted - lower.T @ z))


def _balance(system: MechanicalSystem, force: Array, sign: float) -> float:
    """Return how far Ḣ_r along the true motion is from −∂H_rᵀR̃∂H_r of (3.39), over H_r's rate."""
    law, n, worst = _feedback(system), system.n, 0.0
    for x, z in draw(system, system.n):
        y = np.concatenate([x.position, x.velocity, z])
        moving = _loop_rate(law, force, y)
        true = float(
            rate(lambda there, own: _forced(there, own, law, force, sign), x, moving[n : 2 * n], z, moving[2 * n :])
        )
        upper, lower = _lever(x, law)
        hatted = x.transformed_momentum - law.coupling @ z
        gradient = np.concatenate([
            np.zeros(n), hatted + sign * upper @ force, np.linalg.solve(law.force_gain, z) - sign * lower @ force,
        ])  # fmt: skip
        taken = _blocks(x, law)[1]
        taken[n : 2 * n, n : 2 * n] += x.transformed_injection(law.damping)
        worst = max(worst, off(-gradient @ taken @ gradient, true))
    return worst


def _measured_balance(system: MechanicalSystem, force: Array) -> float:
    """Return the same of the law that measures f_e: 𝒦 of (2.46) is then [1; 0; 0], and H_r = Ĥ_d − f_eᵀq."""
    law, n, worst = ForceFeedback(system, **POSITION, **EXTENSION, measured=True), system.n, 0.0
    for x, z in draw(system, system.n):
        moving = _loop_rate(law, force, np.concatenate([x.position, x.velocity, z]))
        true = float(
            rate(
                lambda there, own: law.storage(0.0, there, own) - float(force @ there.position),
                x, moving[n : 2 * n], z, moving[2 * n :],
            )
        )  # fmt: skip
        hatted = x.transformed_momentum - law.coupling @ z
        gradient = np.concatenate([np.zeros(n), hatted, np.linalg.solve(law.force_gain, z)])
        taken = _blocks(x, law)[1]
        taken[n : 2 * n, n : 2 * n] += x.transformed_injection(law.damping)
        worst = max(worst, off(-gradient @ taken @ gradient, true))
    return worst


def _constant_force() -> list[Claim]:
    system, gripper = shoulder(), MechanicalSystem(load_robot("pera_gripper"))
    law = _feedback(system)
    least, enough, needed = np.inf, np.inf, 0.0
    for x, _ in draw(system, 0):
        upper, lower = _lever(x, law)
        schur = upper.T @ upper + lower.T @ law.force_gain @ lower
        needed = max(needed, float(np.linalg.eigvalsh(schur)[-1]))

    def smallest(x: MechanicalState, K_f: float) -> float:
        upper, lower = _lever(x, law)
        zero, one = np.zeros((2, 2)), np.eye(2)
        P = np.block([
            [15.0 * one, zero, zero, zero],
            [zero, one, zero, upper],
            [zero, zero, np.linalg.inv(law.force_gain), -lower],
            [zero, upper.T, -lower.T, K_f * one],
        ])  # fmt: skip
        return float(np.linalg.eigvalsh(0.5 * (P + P.T))[0])

    for x, _ in draw(system, 0):
        least, enough = min(least, smallest(x, ANY)), min(enough, smallest(x, 1.01 * needed))
    force = np.array([0.1])
    return [
        positive("forced-definite", "P̂ of (3.38) is positive definite with any K_f > 0: least eigenvalue",
                 "section 3.2.3, (3.38)",
                 [Finding((least,), chosen=f"K_f = {ANY:g}"),
                  Finding((enough,), "E42", chosen=f"K_f = {1.01 * needed:.3g}, 1 % above what E42 asks")],
                 "Schur's complement of K_f is K_f - B̄ᵀĜᵀ(1 + Y⁻ᵀK_zY⁻¹)ĜB̄, at the sampled states of the shoulder "
                 f"positive from {needed:.3g} on", DEFINITE),
        _forced_balance(
            "of the law that measures f_e, which rests at (3.40), as this section says, with p̂ = z = 0: H_r is then "
            "least there, on any arm. Of the modeled law (3.21) it is not: ĜB̄ in (3.37) changes with q, of which 𝒦 in "
            "(3.36) knows nothing (E34), so that with E29 it is true for the constant mass of the gripper alone "
            f"({_balance(gripper, force, -1.0):.1g}; as printed {_balance(gripper, force, 1.0):.2g})"
        ),
    ]  # fmt: skip


def _forced_balance(reason: str) -> Claim:
    system = shoulder()
    claim = exact(
        "forced-balance", "under a constant f_e the rate of H_r is (3.39), so that it is a Lyapunov function",
        "section 3.2.3, (3.37), (3.39)", _balance(system, FORCE, 1.0), _balance(system, FORCE, -1.0),
        "E8 to E10, E29", reason, already="E8 to E10",
    )  # fmt: skip
    chosen = "H_r = Ĥ_d - f_eᵀq, which (2.46) and (2.54) give once f_e is in the rate of z too"
    measured = Finding((_measured_balance(system, FORCE),), "E8 to E10, E12", "R6", chosen)
    return replace(claim, findings=[*claim.findings, measured])


def _integral() -> list[Claim]:
    system = shoulder()
    law = IntegralAction(system, **POSITION, **EXTENSION, integral_gain=INTEGRAL_GAIN)
    A, K_z, K_i, K_p = law.coupling, law.force_gain, np.diag(INTEGRAL_GAIN), 15.0 * np.eye(2)
    Y, worst = A @ K_z, {-1.0: 0.0, 1.0: 0.0}
    for x, state in draw(system, 4):
        z, error = state[:2], x.position - GOAL
        integral_rate = law.evaluate(0.0, x, state).state_rate[2:]
        # Ĥ_i has ½|ξ − f_e|², the law, which does not know f_e, ½|ξ|²
        grown = storage_rate(law, x.position, x.velocity, state, FORCE) - FORCE @ integral_rate
        D, damped = x.transformed_damping, x.transformed_damping + x.transformed_injection(law.damping)
        hatted = x.transformed_momentum - A @ z + x.factor.T @ K_i @ error
        gradient = np.concatenate([K_p @ error, hatted, np.linalg.solve(K_z, z)])
        for sign in worst:
            zero = np.zeros((2, 2))
            U = np.block([
                [K_i @ np.linalg.inv(K_p), zero, zero],
                [zero, damped, sign * D @ Y],
                [zero, sign * Y.T @ D, Y.T @ D @ Y],
            ])  # fmt: skip
            worst[sign] = max(worst[sign], off(-gradient @ U @ gradient, grown))
    return [
        exact("balance-integral", "the rate of Ĥ_i under integral action and a constant f_e is (3.49)",
              "Theorem 3.2.5, (3.47), (3.49)", worst[-1.0], worst[1.0], "E13, E35",
              "with E13 alone, and with +D̄Y off the diagonal of U", already="E13"),
    ]  # fmt: skip
