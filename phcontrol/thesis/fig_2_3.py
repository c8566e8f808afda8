"""Thesis figure 2.3: the stiffness of the gripper's spring, and what (2.17) would give as printed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phcontrol._validation import Array
from phcontrol.mechanics.potentials import GripperSpring
from phcontrol.thesis.claim import Claim
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.origin import Origin
from phcontrol.thesis.study import Outcome

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SPRING = GripperSpring(closing_stiffness=0.21, opening_stiffness=0.06, rest_angle=0.30, smoothing=0.001)


def run() -> Outcome:
    """Evaluate the stiffness on both sides of rest."""

    def at(position: float) -> tuple[float, float]:
        q = np.array([position])
        return float(_printed(q)[0]), float(SPRING.stiffness(q)[0])

    return Outcome(
        "fig-2-3",
        "stiffness of the gripper's spring (thesis figure 2.3)",
        {},
        [
            Claim(name, statement, Origin.FIGURE, "figure 2.3, (2.16), (2.17)", (stiffness,), "N·m/rad", 0.005,
                  [Finding((printed,)), Finding((corrected,), "E4")],
                  reason="the printed sign of (2.17) exchanges the two stiffnesses")
            for name, statement, stiffness, printed, corrected in (
                ("closing", "stiffness when closing beyond rest, k_g1", 0.21, *at(-0.2)),
                ("opening", "stiffness when opening beyond rest, k_g2", 0.06, *at(0.8)),
            )
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
