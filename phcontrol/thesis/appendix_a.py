"""Appendix A of the thesis, transcribed: M(q) and ∂V/∂q of the seven-joint PERA, independent of Pinocchio."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array

D3, D5, G = 0.32, 0.28, 9.81  # d_q3, d_q5 [m], g [m/s²]
M = np.array([0.0, 0.25, 0.15, 2.95, 0.10, 0.85, 0.10, 0.24])  # index 1 to 7 [kg]
INERTIA = np.array([0.0, 0.10, 0.10, 0.10, 0.05, 0.05, 0.02, 0.02])  # [kg m²]


def mass_matrix(q: Array, *, printed: bool = False) -> Array:
    """Return M(q) of appendix A, shape (7, 7) [kg·m²]: m̄₁₁ with erratum E1, or as printed."""
    _, c2, c3, c4, c5, c6, _ = np.cos(q)
    _, s2, s3, s4, s5, s6, _ = np.sin(q)
    m67 = M[6] + M[7]
    m4567 = M[4] + M[5] + M[6] + M[7]
    i7 = INERTIA[7]
    i67 = i7 + INERTIA[6]
    i567 = i67 + INERTIA[5]
    i4567 = i567 + INERTIA[4]
    i34567 = i4567 + INERTIA[3]
    m = np.zeros((8, 8))
    m[1, 1] = (
        INERTIA.sum()
        + D3**2 * m4567
        + D5**2 * m67
        - D3**2 * m4567 * c2**2
        - D5**2 * m67 * c3**2
        + 2 * D3 * D5 * m67 * c4
        + D5**2 * m67 * (c2**2 * c3**2 - c2**2 * c3**2 * c4**2)
        - 2 * D3 * D5 * m67 * c2**2 * c4
        + 2 * D3 * D5 * m67 * c2 * c3 * s2 * s4
        + 2 * D5**2 * m67 * c2 * c3 * c4 * s2 * s4
    )
    if printed:
        m[1, 1] += D5**2 * (-M[6] * c2**2 * c4**2 + M[7] * (c2**2 * c4**2 - c3**2 * c4**2 + c3**2 * c4**2))
    else:  # E1: symmetric in m6 and m7
        m[1, 1] += D5**2 * m67 * (c3**2 * c4**2 - c2**2 * c4**2)
    m[1, 2] = -D5 * s3 * m67 * (D3 * c2 * s4 - D5 * c3 * s2 + D5 * c2 * c4 * s4 + D5 * c3 * c4**2 * s2)
    m[1, 3] = (
        i34567 * c2
        + D5**2 * m67 * c2
        - D5**2 * m67 * c2 * c4**2
        + D5**2 * m67 * c3 * c4 * s2 * s4
        + D3 * D5 * m67 * c3 * s2 * s4
    )
    m[1, 4] = s2 * s3 * (i4567 + D5**2 * m67 + D3 * D5 * m67 * c4)
    m[1, 5] = (c2 * c4 - c3 * s2 * s4) * i567
    m[1, 6] = -i67 * (c5 * s2 * s3 + c2 * s4 * s5 + c3 * c4 * s2 * s5)
    m[1, 7] = i7 * (c2 * c4 * c6 - c3 * c6 * s2 * s4 + c2 * c5 * s4 * s6 - s2 * s3 * s5 * s6 + c3 * c4 * c5 * s2 * s6)
    m[2, 2] = (
        i34567
        + INERTIA[2]
        + D3**2 * m4567
        + D5**2 * m67 * (c3**2 + c4**2)
        + 2 * D3 * D5 * m67 * c4
        - D5**2 * m67 * c3**2 * c4**2
    )
    m[2, 3] = -D5 * s3 * s4 * m67 * (D3 + D5 * c4)
    m[2, 4] = c3 * (i4567 + D5**2 * m67 + D3 * D5 * m67 * c4)
    m[2, 5] = s3 * s4 * i567
    m[2, 6] = -(c3 * c5 - c4 * s3 * s5) * i67
    m[2, 7] = i7 * (c6 * s3 * s4 - c3 * s5 * s6 - c4 * c5 * s3 * s6)
    m[3, 3] = i34567 + D5**2 * m67 * s4**2
    m[3, 5] = c4 * i567
    m[3, 6] = -s4 * s5 * i67
    m[3, 7] = i7 * (c4 * c6 + c5 * s4 * s6)
    m[4, 4] = i4567 + D5**2 * m67
    m[4, 6] = -c5 * i67
    m[4, 7] = -i7 * s5 * s6
    m[5, 5] = i567
    m[5, 7] = i7 * c6
    m[6, 6] = i67
    m[7, 7] = i7
    upper: Array = m[1:, 1:]
    whole: Array = upper + np.triu(upper, 1).T
    return whole


def potential_gradient(q: Array) -> Array:
    """Return ∂V/∂q as printed, shape (7,) [N·m]."""
    c1, c2, c3, c4 = np.cos(q[:4])
    s1, s2, s3, s4 = np.sin(q[:4])
    m67, m45 = M[6] + M[7], M[4] + M[5]
    g = np.zeros(7)
    g[0] = G * m67 * (D5 * (s4 * (c1 * s3 + c2 * c3 * s1) + c4 * s1 * s2) + D3 * s1 * s2) + G * D3 * m45 * s1 * s2
    g[1] = -G * m67 * (D5 * (c1 * c2 * c4 - c1 * c3 * s2 * s4) + D3 * c1 * c2) - G * D3 * m45 * c1 * c2
    g[2] = G * D5 * m67 * s4 * (c3 * s1 + c1 * c2 * s3)
    g[3] = G * D5 * m67 * (c4 * (s1 * s3 - c1 * c2 * c3) + c1 * s2 * s4)
    return g
