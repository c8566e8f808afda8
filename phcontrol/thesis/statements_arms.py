"""Statements on the arms' models: the three joints of section 5.4, the seven of appendix A."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.thesis import appendix_a
from phcontrol.thesis.claim import Claim
from phcontrol.thesis.exact import exact, off, positive, slope
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.theorems import DEFINITE

SAMPLES, SEED = 20, 20150424
A2, A3, AC2, AC3, G = 0.32, 0.28, 0.16, 0.14, 9.81  # of section 5.4 [m, m/s²]
M2, M3 = 2.9, 1.0  # [kg]
INERTIAS = (1.0, 1.0, 0.5)  # 𝓘ᵢ [kg·m²]
POSTURES = 2000
CHOSEN = "masses, inertias and lengths, which appendix A does not print, as our description of the PERA has them"


def arm_claims() -> list[Claim]:
    """Return the claims of section 5.4's model and of appendix A."""
    return [*_three_joints(), *_seven_joints()]


def printed_mass(q: Array) -> Array:
    """Return M(q) of (5.49) as printed."""
    i1, i2, i3 = INERTIAS
    first = i1 + i2 + i3 + 0.5 * AC3**2 * (M2 + M3) + 0.5 * A2**2 * M3 * (1.0 + np.cos(2.0 * q[1]))
    first += AC3**2 * (
        0.5 * M2 * np.cos(2.0 * q[1])
        + 0.5 * M3 * np.cos(2.0 * (q[1] + q[2]))
        + A2**2 * M3 * (np.cos(q[2]) + np.cos(2.0 * q[1] + q[2]))
    )
    second = i2 + i3 + AC3**2 * (M2 + M3) + A2**2 * M3 * (1.0 + 2.0 * AC3**2 * np.cos(q[2]))
    third, last = i3 + AC3**2 * M3 * (1.0 + A2**2 * np.cos(q[2])), i3 + AC3**2 * M3
    return np.array([[first, 0.0, 0.0], [0.0, second, third], [0.0, third, last]])


def corrected_mass(q: Array) -> Array:
    """Return M(q) by hand: points at the centres of mass, and 𝓘ᵢ about every axis."""
    i1, i2, i3 = INERTIAS
    reach = A2 * np.cos(q[1]) + AC3 * np.cos(q[1] + q[2])
    first = i1 + i2 + i3 + M2 * AC2**2 * np.cos(q[1]) ** 2 + M3 * reach**2
    last = i3 + M3 * AC3**2
    third = last + M3 * A2 * AC3 * np.cos(q[2])
    second = i2 + i3 + M2 * AC2**2 + M3 * (A2**2 + AC3**2 + 2.0 * A2 * AC3 * np.cos(q[2]))
    return np.array([[first, 0.0, 0.0], [0.0, second, third], [0.0, third, last]])


def factor(M: Array) -> Array:
    """Return T(q) of (5.50), from the entries of M."""
    m1, m2, m3, m4 = M[0, 0], M[1, 1], M[1, 2], M[2, 2]
    last = np.sqrt((m2 * m4 - m3**2) / m2)
    return np.array([[np.sqrt(m1), 0.0, 0.0], [0.0, np.sqrt(m2), 0.0], [0.0, m3 / np.sqrt(m2), last]])


def weight(q: Array, lever: float) -> Array:
    """Return ∂V/∂q of (5.51) with a lever of m₂ [N·m]."""
    along, across = (lever * M2 * f(q[1]) + M3 * (A2 * f(q[1]) + AC3 * f(q[1] + q[2])) for f in (np.cos, np.sin))
    return G * np.array([np.sin(q[0]) * along, np.cos(q[0]) * across, M3 * AC3 * np.cos(q[0]) * np.sin(q[1] + q[2])])


def placed(q: Array, a3: float) -> Array:
    """Return the pose of a point on the forearm by table 5.1, shape (4, 4)."""
    pose = np.eye(4)
    for angle, (a, alpha) in zip(q, ((0.0, np.pi / 2), (A2, 0.0), (a3, np.pi / 2)), strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        pose = pose @ np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, 0], [0, 0, 0, 1]])
    return pose


def origin(q: Array) -> Array:
    """Return o(q) of (5.58) [m]."""
    reach = A2 * np.cos(q[1]) + A3 * np.cos(q[1] + q[2])
    height = A2 * np.sin(q[1]) + A3 * np.sin(q[1] + q[2])
    return np.array([np.cos(q[0]) * reach, np.sin(q[0]) * reach, height])


def jacobian(q: Array, a3: float, *, printed: bool) -> Array:
    """Return 𝒥 of (5.56), (5.57), shape (6, 3), as printed or with E21."""
    s1, c1, c23, s23 = np.sin(q[0]), np.cos(q[0]), np.cos(q[1] + q[2]), np.sin(q[1] + q[2])
    reach, height = A2 * np.cos(q[1]) + a3 * c23, A2 * np.sin(q[1]) + a3 * s23
    return np.array([
        [-s1 * reach, -c1 * height, -a3 * c1 * (c23 if printed else s23)],
        [c1 * reach, -s1 * height, a3 * s1 * s23 * (1.0 if printed else -1.0)],
        [0.0, reach, a3 * c23],
        [0.0, s1, s1],
        [0.0, -c1, c1 if printed else -c1],
        [1.0, 0.0, 0.0],
    ])  # fmt: skip


def _true_jacobian(q: Array, a3: float) -> Array:
    """Return the Jacobian of ``placed``: of its place, and of its turning."""
    linear = slope(lambda y: placed(y, a3)[:3, 3], q).T
    turning = [each @ placed(q, a3)[:3, :3].T for each in slope(lambda y: placed(y, a3)[:3, :3], q)]
    return np.vstack([linear, np.transpose([[S[2, 1], S[0, 2], S[1, 0]] for S in turning])])


def _postures(n: int, count: int = SAMPLES) -> Array:
    return np.random.default_rng(SEED).uniform(-np.pi, np.pi, size=(count, n))


def _three_joints() -> list[Claim]:
    system = MechanicalSystem(load_robot("pera_shoulder_elbow"))
    postures = _postures(3)
    worst: dict[str, float] = {}

    def keep(name: str, error: float) -> None:
        worst[name] = max(worst.get(name, 0.0), error)

    for q in postures:
        x, centre, camera = system.at(q), _true_jacobian(q, AC3), _true_jacobian(q, A3)
        keep("M printed", off(printed_mass(q), x.mass_matrix))
        keep("M", off(corrected_mass(q), x.mass_matrix))
        keep("T", off(factor(x.mass_matrix) @ factor(x.mass_matrix).T, x.mass_matrix))
        keep("V printed", off(weight(q, AC3), x.potential_gradient))
        keep("V", off(weight(q, AC2), x.potential_gradient))
        keep("o", off(origin(q), placed(q, A3)[:3, 3]))
        keep("J printed", off(jacobian(q, AC3, printed=True), centre))
        keep("J", off(jacobian(q, AC3, printed=False), centre))
        keep("camera printed", off(jacobian(q, AC3, printed=True), camera))
        keep("camera", off(jacobian(q, A3, printed=False), camera))
    where = "section 5.4"
    return [
        exact("three-mass", "M(q) is (5.49)", f"{where}, (5.49)", worst["M printed"], worst["M"], "E20",
              "against Pinocchio's, of masses halfway along their links, as the text says"),
        exact("three-factor", "T(q) of (5.50) is a lower triangular factor of M", f"{where}, (5.50)", worst["T"]),
        exact("three-weight", "∂V/∂q is (5.51)", f"{where}, (5.51)", worst["V printed"], worst["V"], "E32"),
        exact("three-origin", "the end-effector is at (5.58)", f"{where}, (5.58), table 5.1", worst["o"],
              reason="against the product of table 5.1's transformations"),
        exact("three-jacobian", "(5.56) and (5.57) are the geometric Jacobian of the third link's centre of mass",
              f"{where}, (5.56), (5.57)", worst["J printed"], worst["J"], "E21"),
        exact("camera-jacobian", "and the camera's, with which Δ̄ is formed in (5.59)", f"{where}, (5.57), (5.59)",
              worst["camera printed"], worst["camera"], "E21, E33"),
    ]  # fmt: skip


def _seven_joints() -> list[Claim]:
    pera = MechanicalSystem(load_robot("pera"))
    worst = dict.fromkeys(("printed", "M", "V"), 0.0)
    for q in _postures(7):
        x = pera.at(q)
        worst["printed"] = max(worst["printed"], off(appendix_a.mass_matrix(q, printed=True), x.mass_matrix))
        worst["M"] = max(worst["M"], off(appendix_a.mass_matrix(q), x.mass_matrix))
        worst["V"] = max(worst["V"], off(appendix_a.potential_gradient(q), x.potential_gradient))
    masses = {
        printed: np.array([appendix_a.mass_matrix(q, printed=printed) for q in _postures(7, POSTURES)])
        for printed in (True, False)
    }
    least = {printed: float(np.linalg.eigvalsh(each).min()) for printed, each in masses.items()}
    where = "appendix A"
    return [
        exact("seven-mass", "M(q) of appendix A is that of the arm of table A.1", f"{where}, m̄₁₁ to m̄₇₇",
              worst["printed"], worst["M"], "E1", "against Pinocchio's; all entries but m̄₁₁ are as printed",
              chosen=CHOSEN),
        positive("seven-definite", "and it is positive definite, as (2.4) asks: least eigenvalue at "
                 f"{POSTURES} random postures", f"{where}, (2.4)",
                 [Finding((least[True],), chosen=CHOSEN), Finding((least[False],), "E1", chosen=CHOSEN)], "", DEFINITE),
        exact("seven-weight", "ḡ₁ to ḡ₇ are the weight of that arm", f"{where}, ∂V/∂q", worst["V"], chosen=CHOSEN),
    ]  # fmt: skip
