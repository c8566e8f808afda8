"""Where the thesis can be read in more than one way: the readings under which studies run it.

``docs/theory.md`` has the same list, with what speaks for each.
"""

from __future__ import annotations

READINGS: dict[str, str] = {
    "R1": "the body stands at 0.20 rad and the virtual position is 0, so that K_p (0.20 - 0) is f_d = 0.20 in (4.39)",
    "R2": "the virtual position is q_f = 0.20 rad, where the body begins: q̄ = q - 0.20 in (4.59), with q_rl(0) = 0",
    "R3": "the friction in section 6.2, of the plant and in the law, is the linear damping of example 2.1.2, F_v",
    "R4": "the law of section 6.3 has a model of the viscous friction only, the arm has all of it",
    "R5": "image features are in millimetres, as section 5.4.2 gives them, so K_tau in rad/s/mm",
    "R6": "the law of figure 3.1 feeds back the measured f_e too, which (3.2) with (3.1) leaves out",
    "R8": "the compliant body is coupled as (4.65) and (4.66) print it, f_e = -y_c and u_c = y_g, from contact on",
    "R9": "what takes t > 2 s takes more than 2 s, and less than the half second more in which such times are given",
    "R10": "the S of (2.30) is any with R + S >= 0, as Theorem 2.2.1 leaves it open: there is one with which it holds",
}
