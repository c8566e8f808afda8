"""Statements of chapter 2: the plant, its examples, transformed coordinates, passivity, constant forces."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from phcontrol._differences import central_difference
from phcontrol._validation import Array
from phcontrol.analysis.equilibrium import equilibrium
from phcontrol.analysis.l2_gain import l2_gain
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.energy_shaping import EnergyShaping
from phcontrol.controllers.force_feedback import ForceFeedback
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.mechanics.transformed_system import TransformedSystem, transformed_system
from phcontrol.thesis.claim import Claim
from phcontrol.thesis.exact import exact, largest_real_part, negative, off, positive, rate, slope
from phcontrol.thesis.fig_2_3 import SPRING
from phcontrol.thesis.fig_3_1 import EXTENSION, GOAL, POSITION
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.origin import Origin

SAMPLES, SEED = 20, 20150424
SHOULDER = (3.9, 0.249, 0.013, 1.692)  # m_s [kg], l_s [m], 𝓘₁, 𝓘₂ [kg·m²] of section 3.4
G = 9.81  # [m/s²]
STIFFNESS, DAMPING = np.diag([15.0, 15.0]), np.diag([10.0, 10.0])  # K_p, C of section 3.4
FORCE = np.array([3.0, -3.0])  # f_e of section 3.4 [N·m]
COULOMB = (0.005, 0.025)  # F_c of section 3.4 [N·m]


def shoulder() -> MechanicalSystem:
    """Return the two-joint shoulder."""
    return MechanicalSystem(load_robot("pera_shoulder"))


def draw(system: MechanicalSystem, size: int, count: int = SAMPLES) -> list[tuple[MechanicalState, Array]]:
    """Draw states of an arm, and ``size`` numbers beside."""
    generator = np.random.default_rng(SEED)
    return [
        (
            system.at(generator.uniform(-1.5, 1.5, system.n), generator.normal(size=system.n)),
            generator.normal(size=size),
        )
        for _ in range(count)
    ]


def plant_claims() -> list[Claim]:
    """Return the claims of chapter 2 that no figure shows."""
    return [*_plant(), *_transformations(), *_passivity(), *_constant_forces()]


# --- the plant and its examples (section 2.1) -------------------------------------------------------------------


def _energy(p: Array, system: MechanicalSystem, q: Array) -> float:
    """Return H(q, p) of (2.4)."""
    x = system.at(q)
    return 0.5 * float(p @ np.linalg.solve(x.mass_matrix, p)) + x.potential_energy


def _plant() -> list[Claim]:
    system = shoulder()
    motion = power = example = example_printed = 0.0
    for x, drawn in draw(system, 4):
        torque, force = drawn[:2], drawn[2:]
        acceleration = x.acceleration(torque, force)
        pushed, lost = torque + force, x.damping_matrix @ x.velocity
        momentum_rate = rate(lambda y, _: y.momentum, x, acceleration)
        motion = max(
            motion, off(-slope(partial(_energy, x.momentum, system), x.position) - lost + pushed, momentum_rate)
        )
        grown = rate(lambda y, _: y.energy, x, acceleration)
        power = max(power, off(x.output @ torque + x.velocity @ (force - lost), grown))
        example = max(
            example, off(-slope(partial(_energy, x.momentum, system), x.position) - lost + pushed, momentum_rate)
        )
        example_printed = max(example_printed, off(-x.potential_gradient + lost + pushed, momentum_rate))
    spring = np.array([_spring(q) for q in (0.0, 0.2, 0.5, 0.8)])
    return [
        exact("plant", "(2.2) with (2.4) is the motion of an arm that Newton and Euler's equations give",
              "section 2.1, (2.2), (2.4)", motion, reason="the shoulder under Pinocchio's forward dynamics"),
        exact("power", "the arm is passive: Ḣ is yᵀu + q̇ᵀf_e less q̇ᵀDq̇", "section 1.2, (2.1) to (2.3)", power),
        exact("shoulder", "(2.7) is the shoulder", "example 2.1.2, (2.7)", example_printed, example, "E2, E36"),
        exact("shoulder-matrices", "M of (2.10), (2.11) and ∂V/∂q of (2.12) are of one mechanism: a mass at the end of "
              "a link on two crossing axes", "example 2.1.2, (2.10) to (2.12)", _mechanism()),
        Claim("friction-fades", "beyond the Stribeck velocity the dry part of (2.14) is Coulomb friction: at 2 rad/s",
              Origin.TEXT, "example 2.1.2, (2.14)", COULOMB, "N·m", 1e-3,
              [Finding(_dry_friction(1.0)), Finding(_dry_friction(-1.0), "E3")]),
        exact("gripper-potential", "V of (2.18) is that of the spring K_g(q)(q - c_g) of (2.17)",
              "example 2.1.3, (2.17), (2.18)", float(spring[:, 0].max()), float(spring[:, 1].max()), "E4, E5"),
    ]  # fmt: skip


def _dry_friction(sign: float, speed: float = 2.0) -> tuple[float, ...]:
    """Return the dry friction of the shoulder's joints at a speed, (2.14) with a sign in the exponent [N·m]."""
    parts = zip(COULOMB, (1.905, 2.257), (0.167, 0.170), strict=True)
    return tuple(
        coulomb + (static - coulomb) * float(np.exp(sign * speed / fading)) for coulomb, static, fading in parts
    )


def _mechanism() -> float:
    """Return how far (2.10) to (2.12) are from a mass on a link that turns about two crossing axes."""
    m, length, first, second = SHOULDER
    worst = 0.0

    def place(q: Array) -> Array:
        return length * np.array([np.cos(q[1]) * np.sin(q[0]), np.sin(q[1]), -np.cos(q[1]) * np.cos(q[0])])

    for q in np.random.default_rng(SEED).uniform(-np.pi, np.pi, size=(SAMPLES, 2)):
        moved = slope(place, q)
        mass = m * moved @ moved.T + np.diag([first + second, second])
        printed = np.diag([m * length**2 * np.cos(q[1]) ** 2 + first + second, m * length**2 + second])
        weight = G * m * length * np.array([np.cos(q[1]) * np.sin(q[0]), np.sin(q[1]) * np.cos(q[0])])
        worst = max(worst, off(printed, mass), off(weight, slope(lambda y: m * G * place(y)[2], q)))
    return worst


def _spring(q: float) -> tuple[float, float]:
    """Return by how much V′ is off K_g(q)(q − c_g): both as printed, and both corrected."""
    k1, k2, c, a = SPRING.closing_stiffness, SPRING.opening_stiffness, SPRING.rest_angle, SPRING.smoothing

    def potential(y: float, factor: float, sign: float) -> float:
        s = y - c
        root = np.sqrt(a + s * s)
        mixed = s * root + a * (np.log(np.sqrt(a)) - np.log(s + root))
        return float(0.25 * (k1 + k2) * s * s + sign * factor * (k1 - k2) * mixed)

    def force(sign: float) -> float:
        return float((0.5 * (k1 + k2) + sign * 0.5 * (k1 - k2) * (q - c) / np.sqrt(a + (q - c) ** 2)) * (q - c))

    def error(factor: float, sign: float) -> float:
        found = slope(lambda y: potential(float(y[0]), factor, sign), np.array([q]))
        return off(found, [force(sign)])

    return error(0.5, 1.0), error(0.25, -1.0)


# --- transformed coordinates (section 2.2) ----------------------------------------------------------------------


def _unit_mass_rate(x: MechanicalState, momentum: Array) -> Array:
    """Return p̄̇ of (2.35) without input, J̄₂ of (2.37) from ∂(T⁻¹·momentum)/∂q at constant momentum."""
    P = slope(lambda q: np.linalg.solve(x.system.at(q).factor, momentum), x.position).T
    turned = P @ np.linalg.inv(x.factor).T
    result: Array = (
        -x.solve_factor(x.potential_gradient) + (turned - turned.T - x.transformed_damping) @ x.transformed_momentum
    )
    return result


def _shaped(system: MechanicalSystem) -> Callable[..., TransformedSystem]:
    """Return what makes of a (q, p) the transformation Φ = (q − q_d, T⁻¹p), U = ½q̃ᵀK_p q̃ − V, β from (2.25)."""
    return partial(transformed_system, partial(_phi, system), partial(_u, system), system)


def _phi(system: MechanicalSystem, q: Array, p: Array, t: float) -> Array:
    return np.concatenate([q - GOAL, system.at(q).solve_factor(p)])


def _u(system: MechanicalSystem, q: Array, p: Array, t: float) -> float:
    return float(0.5 * (q - GOAL) @ STIFFNESS @ (q - GOAL)) - system.at(q).potential_energy


def _transformations() -> list[Claim]:
    system = shoulder()
    printed = corrected = structure = 0.0
    shaped = _shaped(system)
    for x, torque in draw(system, 2):
        true = rate(lambda y, _: y.transformed_momentum, x, x.acceleration(np.zeros(2)))
        printed = max(printed, off(_unit_mass_rate(x, x.transformed_momentum), true))
        corrected = max(corrected, off(_unit_mass_rate(x, x.momentum), true))
        made = shaped(x.position, x.momentum)
        moved = rate(lambda y, _: _phi(system, y.position, y.momentum, 0.0), x, x.acceleration(torque))
        port = made.input_matrix @ (torque + made.input_change)
        structure = max(structure, off((made.interconnection - made.dissipation) @ made.storage_gradient + port, moved))
    return [
        exact("unit-mass", "(2.35) with J̄₂ of (2.37) is the arm in the coordinates (2.31)", "(2.31) to (2.37)",
              printed, corrected, "E6"),
        Claim("canonical", "(2.31) is a generalised canonical transformation: residual of (2.25) with U = β = 0",
              Origin.TEXT, "Theorem 2.2.1, (2.25), (2.31)", (0.0,), "", 0.0,
              [Finding((0.0,), vacuous="with U, β, K and S nought so is each term, whatever Φ(q, p) is")]),
        exact("transformed-structure", "where (2.25) holds, J̄, R̄, ḡ of (2.27) to (2.29) and α make the transformed "
              "system", "Theorem 2.2.1, (2.26) to (2.29)", structure,
              reason="on energy shaping: Φ of (2.31), U = ½q̃ᵀK_p q̃ - V, β out of (2.25)"),
    ]  # fmt: skip


# --- passivity (Theorem 2.2.2) ----------------------------------------------------------------------------------


def _passivity() -> list[Claim]:
    system = shoulder()
    shaped = _shaped(system)
    growth = max(made.growth / made.power for made in (shaped(x.position, x.momentum) for x, _ in draw(system, 0)))

    def loop(y: Array) -> Array:
        x = system.at(y[:2], y[2:])
        torque = shaped(x.position, x.momentum).feedback(DAMPING, x.output)
        return np.concatenate([y[2:], x.acceleration(torque)])

    stable = largest_real_part(loop, np.concatenate([GOAL, np.zeros(2)]))
    return [
        negative("passive-if", "where (2.30) holds, ū to ȳ is passive with H + U: largest growth over the power of its "
                 "terms", "Theorem 2.2.2, (2.30)", [Finding((growth,))],
                 "on energy shaping, where (2.30) is 0: with (2.25) all of it cancels"),
        positive("passive-only-if", "and only there: where (2.30) fails, H + U grows by more than is supplied, by at "
                 "least", "Theorem 2.2.2, (2.30)",
                 [Finding((_growth_where_it_fails(),)),
                  Finding((_growth_where_no_split_helps(),), reading="R10",
                          chosen="of the shoulder, an energy that changes with time and a feedback, both at random")],
                 "with the S of the transformation not: in a spring that stiffens slowly in a damped coordinate, one "
                 "joint, (2.30) fails at every sampled state, and at none does H̄ grow by more than is supplied, since "
                 "what R + S takes pays (E31). Where no S with R + S ≥ 0 makes (2.30) hold it does grow, the least of "
                 "all such states by this", 1e-6),
        negative("feedback-stabilises", "the feedback u = -β - 𝒞(y + α) brings the system to rest asymptotically: "
                 "largest real part of the eigenvalues of the true loop", "Theorem 2.2.2", [Finding((stable,))],
                 "on energy shaping of the shoulder, with β out of (2.25)", "1/s"),
    ]  # fmt: skip


def _growth_where_it_fails() -> float:
    """Return the largest H̄̇ − ȳᵀū of p̂ = p + m q, H̄ = ½p̂²/m + ½(1 + t/10)q², where (2.30), −½k̇q², is negative [W]."""
    m, d, largest = 0.5, 0.1, -np.inf
    generator = np.random.default_rng(SEED)
    for _ in range(SAMPLES):
        q, v, u, t = (float(value) for value in generator.normal(size=4))

        acceleration = (-(1.0 + 0.1 * t) * q - d * (v + q) - m * v + u) / m  # of p̂̇ = −kq − d p̂/m + ū

        def stored(h: float, q: float = q, v: float = v, a: float = acceleration, t: float = t) -> float:
            there, speed = q + h * v, v + h * a
            return 0.5 * m * (speed + there) ** 2 + 0.5 * (1.0 + 0.1 * (t + h)) * there**2

        grown = float(central_difference(stored, 1e-4))
        largest = max(largest, grown - (v + q) * u)
    return largest


def _growth_where_no_split_helps() -> float:
    """Return the least growth of H + U beyond ȳᵀū where (2.30) fails for every S with R + S ≥ 0 [W].

    Of these S, −R makes the left side of (2.30) largest. U is ½k(t)|q̃|² + ½|Tᵀṽ|² less what H has already, with
    another momentum p + M W q̃, and β a random feedback; the growth is taken along the arm's true motion.
    """
    system, least = shoulder(), np.inf
    generator = np.random.default_rng(SEED)
    zero, one = np.zeros((2, 2)), np.eye(2)
    skew = np.block([[zero, one], [-one, zero]])
    for x, drawn in draw(system, 3):
        turned, back = generator.normal(size=(2, 2)), generator.normal(size=(2, 4))
        t, port = float(abs(drawn[0])), drawn[1:]

        def energy(y: Array, at: float = t, W: Array = turned) -> float:
            """Return (H + U)(q, p, t)."""
            there = system.at(y[:2])
            e = y[:2] - GOAL
            moved = there.solve_factor(y[2:] + there.mass_matrix @ W @ e)
            return 0.5 * float(moved @ moved) + 0.5 * (1.0 + 3.0 * at) * float(e @ e)

        point = np.concatenate([x.position, x.momentum])
        gradient = slope(energy, point)
        bare = np.concatenate([slope(partial(_energy, x.momentum, system), x.position), x.velocity])
        fed_back = back @ point  # β
        resisted = np.block([[zero, zero], [zero, x.damping_matrix]])
        added = (skew - resisted) @ (gradient - bare) + resisted @ gradient + np.concatenate([np.zeros(2), fed_back])
        left = float(gradient @ added) - 1.5 * float((x.position - GOAL) @ (x.position - GOAL))
        if left >= 0.0:
            continue

        def stored(y: MechanicalState, own: Array, energy: Callable[..., float] = energy) -> float:
            return energy(np.concatenate([y.position, y.momentum]), float(own[0]))

        grown = rate(stored, x, x.acceleration(port - fed_back), np.array([t]), np.ones(1))
        least = min(least, float(grown - gradient[2:] @ port))
    return least if np.isfinite(least) else -np.inf


# --- disturbances and constant forces (sections 2.3, 2.4) -------------------------------------------------------


def _constant_forces() -> list[Claim]:
    system = shoulder()
    laws: list[Controller] = [
        EnergyShaping(system, **POSITION),
        ForceFeedback(system, **POSITION, **EXTENSION),
    ]
    gains = [l2_gain(law, system, samples=SAMPLES) for law in laws]
    share = max(found.linear_norm / found.bound for found in gains)
    rest = equilibrium(laws[0], system, FORCE)
    return [
        Claim("gain-theorem", "where (2.44) holds with a γ, the L₂ gain is at most γ: gain over γ", Origin.TEXT,
              "section 2.3, (2.43), (2.44)", (1.0,), "", 1e-3,
              [Finding((share,), "E8 to E10")], "<=",
              f"energy shaping and force feedback of the shoulder, γ = {gains[0].bound:.3g} and {gains[1].bound:.3g}; "
              "the gain is the H∞ norm of the true loop at rest"),
        exact("forced-representation", "under a constant input, where the Casimirs exist, the loop is (2.55) with H_r "
              "of (2.56)", "Theorem 2.4.1, (2.55), (2.56)", rest.imbalance,
              reason="energy shaping of the shoulder under f_e = (3, -3), whose 𝒦 is constant"),
        negative("forced-lyapunov", "and H_r is a Lyapunov function: largest rate along it over its terms",
                 "Theorem 2.4.1", [Finding((rest.growth,))], "in random states away from the rest"),
    ]  # fmt: skip
