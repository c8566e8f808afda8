"""What the thesis states in theorems and in their proofs: closed loops, power balances, definite matrices, the gain."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np

from phcontrol._differences import central_difference
from phcontrol._validation import Array
from phcontrol.analysis.certificate import MATCHING_TOLERANCE, Certificate
from phcontrol.analysis.certify import certify
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.force_feedback import ForceFeedback
from phcontrol.controllers.impedance_grasping import ImpedanceGrasping
from phcontrol.controllers.registry import make_controller
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import Measured
from phcontrol.thesis.claim import Claim
from phcontrol.thesis.fig_3_1 import EXTENSION, GOAL, INTEGRAL_GAIN, POSITION
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.origin import Origin
from phcontrol.thesis.study import Outcome
from phcontrol.thesis.theorem import THEOREMS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SAMPLES, SEED = 200, 0
DEFINITE = 1e-9
"""From where a least eigenvalue is more than rounding."""
DAMPINGS = (2.0, 5.0, 10.0, 20.0, 40.0)  # C [N·m·s/rad]
FREQUENCIES = np.logspace(-4, 4, 2000)  # [rad/s]


def run() -> Outcome:
    """Certify every law in every form, and check the matrices and the gain at random states."""
    certificates = {theorem.name: _certificates(theorem.laws, theorem.robot) for theorem in THEOREMS}
    gains = {damping: loop_gain(damping) for damping in DAMPINGS}
    return Outcome(
        "theorems",
        "the thesis's theorems: closed loops, power balances, definite matrices, the L₂ gain",
        {},
        [*_closed_loops(certificates), *_matrices(), *_gain(gains)],
        {"l2-gain": lambda: _figure(gains)},
        notes=(f"{SAMPLES} random states, seed {SEED}; gains of section 3.4, and of section 4.2.2 on the shoulder.",),
    )


# --- closed loops -----------------------------------------------------------------------------------------------


def _certificates(laws: tuple[str, ...], robot: str) -> list[Certificate]:
    system = MechanicalSystem(load_robot(robot))
    return [
        certify(controller, system)
        for law in laws
        for form in type(make_controller(law, system)).forms
        for controller in [make_controller(law, system, interconnection=form)]
    ]


def _closed_loops(certificates: dict[str, list[Certificate]]) -> list[Claim]:
    claims = []
    for theorem in THEOREMS:
        found = certificates[theorem.name]
        residual = max(entry.matching_residual if entry.passed else np.inf for entry in found)
        claims.append(
            Claim(
                f"closed-loop-{theorem.name.split()[-1]}", f"{theorem.claim}: largest residual of its certificates",
                Origin.THEOREM, f"{theorem.name}, {theorem.closed_loop}", (0.0,), "", MATCHING_TOLERANCE,
                [Finding((residual,), theorem.errata)],
                reason=f"{len(found)} certificates on {theorem.robot}: {', '.join(theorem.laws)}, in every form",
            )
        )  # fmt: skip
    return claims


# --- power balances and definite matrices -----------------------------------------------------------------------


def _shoulder() -> MechanicalSystem:
    return MechanicalSystem(load_robot("pera_shoulder"))


def storage_rate(law: Controller, q: Array, v: Array, state: Array, force: Array) -> float:
    """Return the rate of the law's storage function along the closed loop, by finite differences [W]."""
    measured = Measured(external_force=force)
    x = law.system.at(q, v)
    command = law.evaluate(0.0, x, state, measured)
    acceleration = x.acceleration(command.torque, force)

    def stored(step: float) -> float:
        there = law.system.at(q + step * v, v + step * acceleration)
        return law.storage(0.0, there, state + step * command.state_rate, measured)

    return float(central_difference(stored, 1e-4))


def _matrices() -> list[Claim]:
    system = _shoulder()
    feedback = ForceFeedback(system, **POSITION, **EXTENSION)
    grasping = ImpedanceGrasping(system, goal=GOAL, stiffness=1.0, rest_stiffness=0.5, damping=3.0)
    A, K_z = feedback.coupling, feedback.force_gain
    Y, K_p, K_rl = A @ K_z, grasping.stiffness, grasping.rest_stiffness
    generator, matrices = np.random.default_rng(SEED), np.random.default_rng(SEED + 1)
    errors: dict[str, list[float]] = {"3.15": [], "3.15 as printed": [], "4.57": [], "4.57 as printed": []}
    least = dict.fromkeys(("K", "K without friction", "U", "U_i", "U_i diagonal"), np.inf)
    for _ in range(SAMPLES):
        q, v, state, force = (generator.normal(size=2) for _ in range(4))
        x = system.at(q, v)
        friction = x.transformed_damping
        damped = friction + x.transformed_injection(feedback.damping)
        crossed = friction @ Y
        printed = np.block([[damped, -crossed], [-crossed.T, Y.T @ friction @ Y]])
        corrected = np.block([[damped, crossed], [crossed.T, Y.T @ friction @ Y]])
        momentum = x.transformed_momentum - A @ state
        gradient = np.concatenate([momentum, np.linalg.solve(K_z, state)])
        rate = storage_rate(feedback, q, v, state, np.zeros(2))
        errors["3.15"].append(_relative(rate, -gradient @ corrected @ gradient))
        errors["3.15 as printed"].append(_relative(rate, -gradient @ printed @ gradient))
        least["K"] = min(least["K"], _least(printed))
        zero = np.zeros((2, 2))
        bare = np.block([[x.transformed_injection(feedback.damping), zero], [zero, zero]])
        least["K without friction"] = min(least["K without friction"], _least(bare))
        for name, ratio in (("U_i diagonal", np.diag(INTEGRAL_GAIN) / 15.0), ("U_i", _full_ratio(matrices))):
            least[name] = min(least[name], _least(np.block([[ratio, np.zeros((2, 4))], [np.zeros((4, 2)), printed]])))

        stretched = K_p @ (q - GOAL - state)
        adapted = x.transformed_momentum + x.factor.T @ stretched
        damped = friction + x.transformed_injection(grasping.damping)
        rate = storage_rate(grasping, q, v, state, force)
        for name, sign in (("4.57", -1.0), ("4.57 as printed", 1.0)):
            yielding = sign * stretched + K_rl @ state
            lost = stretched @ stretched + adapted @ damped @ adapted + yielding @ yielding
            errors[name].append(_relative(rate, -lost))
        least["U"] = min(least["U"], float(np.linalg.eigvalsh(damped)[0]), float(np.linalg.eigvalsh(K_p @ K_p)[0]))
    worst = {name: max(values) for name, values in errors.items()}
    balance: dict[str, Any] = {"printed": (0.0,), "unit": "", "tolerance": MATCHING_TOLERANCE}
    positive: dict[str, Any] = {"printed": (0.0,), "unit": "", "tolerance": 0.0, "relation": ">="}
    return [
        Claim("balance-feedback", "the rate of H_d under force feedback is (3.15): largest relative error",
              Origin.THEOREM, "Theorem 3.2.1, (3.15)",
              findings=[Finding((worst["3.15 as printed"],), "E8 to E10"), Finding((worst["3.15"],), "E8 to E11")],
              **balance),
        Claim("definite-feedback", "the matrix K of (3.15) is positive definite: least eigenvalue",
              Origin.THEOREM, "Theorem 3.2.1, (3.15)", (DEFINITE,), "", 0.0,
              [Finding((min(least["K"], least["K without friction"]),), chosen="D ≥ 0, all that (2.2) asks: D = 0 too"),
               Finding((least["K"],), "E40", chosen="D > 0: the shoulder of section 3.4")], ">=",
              "without friction K is semidefinite, whatever C is; LaSalle's principle needs no more"),
        Claim("definite-integral", "the matrix U of (3.49) is positive semidefinite for K_i, K_p > 0: least eigenvalue",
              Origin.THEOREM, "Theorem 3.2.5, (3.49)",
              findings=[Finding((least["U_i"],), chosen="random full K_i and K_p"),
                        Finding((least["U_i diagonal"],), "E41", chosen="K_i and K_p of section 3.4")],
              reason="of its symmetric part: K_iK_p⁻¹ of two positive definite matrices need not be one; "
              "K_iᵀK_p + K_pK_i must be", **positive),
        Claim("balance-grasping", "the rate of Ĥ under impedance grasping is (4.57) with U of (4.58): relative error",
              Origin.THEOREM, "Theorem 4.2.3, (4.57), (4.58)",
              findings=[Finding((worst["4.57 as printed"],), "E15"), Finding((worst["4.57"],), "E15, E27")],
              reason="K_pK_p is the damping that the rest length adds (remark 4.2.4); q̂_rl is K_rl q_rl - K_p e",
              **balance),
        Claim("definite-grasping", "the matrix U of (4.58) is positive definite: least eigenvalue of K_pK_p and "
              "D̄ + ḠCḠᵀ", Origin.THEOREM, "Theorem 4.2.3, (4.58)",
              findings=[Finding((least["U"],), vacuous="squares, and sums of them")],
              **positive),
    ]  # fmt: skip


def _least(matrix: Array) -> float:
    """Return the least eigenvalue of the symmetric part, which is all that a quadratic form sees."""
    return float(np.linalg.eigvalsh(0.5 * (matrix + matrix.T))[0])


def _full_ratio(generator: np.random.Generator) -> Array:
    """Return K_iK_p⁻¹ of two random full gains, symmetric and positive definite, with eigenvalues from 1 to 20."""
    turns = [np.linalg.qr(generator.normal(size=(2, 2)))[0] for _ in range(2)]
    first, second = (turn @ np.diag(generator.uniform(1.0, 20.0, 2)) @ turn.T for turn in turns)
    ratio: Array = np.linalg.solve(second, first).T
    return ratio


def _relative(rate: float, expected: float) -> float:
    return abs(rate - expected) / max(abs(rate), abs(expected), 1e-3)


# --- the gain from f_e to ŷ -------------------------------------------------------------------------------------


def loop_gain(damping: float) -> float:
    """Return the H∞ norm from f_e to ŷ of the shoulder under force feedback, linearised at q_d [rad/s per N·m].

    The true closed loop is differentiated, plant and law, not the promise.
    """
    system = _shoulder()
    law = ForceFeedback(system, **(POSITION | {"damping": damping}), **EXTENSION)

    def rate(x: Array, force: Array) -> Array:
        arm = system.at(x[:2], x[2:4])
        command = law.evaluate(0.0, arm, x[4:])
        return np.concatenate([x[2:4], arm.acceleration(command.torque, force), command.state_rate])

    def output(x: Array) -> Array:
        return law.passive_port(0.0, system.at(x[:2], x[2:4]), x[4:]).output

    rest, none, h = np.concatenate([GOAL, np.zeros(4)]), np.zeros(2), 1e-5
    A = np.column_stack([(rate(rest + h * e, none) - rate(rest - h * e, none)) / (2.0 * h) for e in np.eye(6)])
    B = np.column_stack([(rate(rest, h * e) - rate(rest, -h * e)) / (2.0 * h) for e in np.eye(2)])
    C = np.column_stack([(output(rest + h * e) - output(rest - h * e)) / (2.0 * h) for e in np.eye(6)])
    return max(
        float(np.linalg.svd(C @ np.linalg.solve(1j * w * np.eye(6) - A, B), compute_uv=False)[0]) for w in FREQUENCIES
    )


def _gain(gains: dict[float, float]) -> list[Claim]:
    falls = sum(after < before for before, after in itertools.pairwise(gains.values()))
    allowed = {damping: 1.0 / np.sqrt(2.0 * damping - 1.0) for damping in DAMPINGS}
    share = max(gains[damping] / allowed[damping] for damping in DAMPINGS)
    first = max(gains[damping] * np.sqrt(4.0 * damping - 2.0) for damping in DAMPINGS)
    return [
        Claim("gain-falls", f"a larger C makes the L₂ gain γ smaller: in how many of {len(gains) - 1} steps",
              Origin.TEXT, "remark 3.2.3", (len(gains) - 1.0,), "", 0.0, [Finding((float(falls),), "E8 to E10")],
              reason=", ".join(f"C = {damping:g}: {gain:.3g}" for damping, gain in gains.items())),
        Claim("gain-bound", "f_e is attenuated to the γ of (3.17) to (3.20): gain over γ", Origin.THEOREM,
              "Theorem 3.2.2", (1.0,), "", 0.0,
              [Finding((first,), "E8 to E10", chosen="γ = 1/√(4C - 2), to which (3.17) alone goes, without friction"),
               Finding((share,), "E8 to E10, E24", chosen="γ = 1/√(2C - 1), the least of H_d's")], "<=",
              "of the true loop, linearised at q_d. An invertible A makes (3.18) ask for the corrected γ "
              "too; the bound is loose, 1/λ_min(C) is the gain itself"),
    ]  # fmt: skip


def _figure(gains: dict[float, float]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axes = figure.subplots()
    fine = np.linspace(min(gains), max(gains), 200)
    axes.loglog(fine, 1.0 / np.sqrt(2.0 * fine - 1.0), color="#999999", linestyle="--", label="γ of Theorem 3.2.2")
    axes.loglog(fine, 1.0 / fine, color="#d55e00", label="1/λ_min(C)")
    axes.loglog(list(gains), list(gains.values()), "o", color="#0072b2", label="H∞ norm of the true loop at q_d")
    axes.set(
        xlabel="C [N·m·s/rad]", ylabel="gain from f_e to ŷ [rad/s per N·m]",
        title="Remark 3.2.3: more injected damping, less of the disturbance",
    )  # fmt: skip
    axes.set_xticks(list(gains), [f"{damping:g}" for damping in gains])
    axes.set_xticks([], minor=True)
    axes.legend(fontsize=9)
    axes.grid(alpha=0.25, which="both")
    return figure
