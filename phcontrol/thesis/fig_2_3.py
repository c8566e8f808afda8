"""Thesis figure 2.3: the stiffness of the gripper's spring, and what (2.17) would give as printed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phcontrol._validation import Array
from phcontrol.mechanics.potentials import GripperSpring
from phcontrol.thesis.claims import Claim
from phcontrol.thesis.study import Outcome

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SPRING = GripperSpring(closing_stiffness=0.21, opening_stiffness=0.06, rest_angle=0.30, smoothing=0.001)


def run() -> Outcome:
    """Evaluate the stiffness on both sides of rest."""
    closed, opened = SPRING.stiffness(np.array([-0.2, 0.8]))
    return Outcome(
        "fig-2-3",
        "stiffness of the gripper's spring (thesis figure 2.3)",
        {},
        [
            Claim("closing", "stiffness when closing beyond rest, k_g1", "(2.16)", (0.21,), (float(closed),), "N·m/rad",
                  0.005, "E4"),
            Claim("opening", "stiffness when opening beyond rest, k_g2", "(2.16)", (0.06,), (float(opened),), "N·m/rad",
                  0.005, "E4"),
            Claim("closing-as-printed", "the same with the sign of (2.17) as printed", "(2.17)", (0.21,),
                  (float(_printed(np.array([-0.2]))[0]),), "N·m/rad", 0.005, "",
                  "the printed sign exchanges the two stiffnesses (errata E4)"),
        ],
        {"fig-2-3": _figure},
    )  # fmt: skip


def _printed(position: Array) -> Array:
    """Return K_g with the sign of (2.17) as printed."""
    mean = SPRING.closing_stiffness + SPRING.opening_stiffness
    return mean - SPRING.stiffness(position)


def _figure() -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axes = figure.subplots()
    q = np.linspace(0.0, 0.6, 400)
    axes.plot(q, SPRING.stiffness(q), color="#0072b2", label="corrected (E4)")
    axes.plot(q, _printed(q), color="#999999", linestyle="--", label="(2.17) as printed")
    axes.axvline(SPRING.rest_angle, color="black", linewidth=0.7, linestyle=":")
    axes.set(xlabel="q [rad]", ylabel="K_g [N·m/rad]", title="Figure 2.3: stiffness of the gripper, rest at 0.30 rad")
    axes.legend(fontsize=9)
    axes.grid(alpha=0.25)
    return figure
