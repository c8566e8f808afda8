"""Statements that the thesis prints beside its figures and closed loops, each held to the arm's motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phcontrol.thesis.claim import Claim
from phcontrol.thesis.exact import EXACT
from phcontrol.thesis.statements_arms import arm_claims
from phcontrol.thesis.statements_contact import contact_claims
from phcontrol.thesis.statements_plant import SAMPLES, SEED, plant_claims
from phcontrol.thesis.statements_position import position_claims
from phcontrol.thesis.statements_vision import tracking_claims, vision_claims
from phcontrol.thesis.study import Outcome

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NOT_CHECKED = (
    "not claims that can be held to a number, and left out: that the approach is physically clearer, more tunable or "
    "cleaner than Euler and Lagrange's (1.4, 3, 3.1, 4.2), that results outperform most others (3), robustness and "
    "consistency in general (1.5, 6.4, 7.1); and conclusions (3.5, 4.3, 5.5, 6.4, 7.1, summary) that say again what is "
    "counted where it is first said."
)
ROUNDING = 1e-16
"""Where residuals that are 0 are drawn."""


def run() -> Outcome:
    """Hold every statement to the motion of the arm, or to what does not know the formula."""
    claims = [
        *plant_claims(), *position_claims(), *contact_claims(), *vision_claims(), *tracking_claims(), *arm_claims(),
    ]  # fmt: skip
    return Outcome(
        "statements",
        "the thesis's equations, examples and remarks, chapter by chapter, and appendix A",
        {},
        claims,
        {"residuals": lambda: _figure(claims)},
        notes=(
            f"{SAMPLES} random states or postures each, seed {SEED}; rates are finite differences along the motion "
            "that Pinocchio's forward dynamics gives.",
            NOT_CHECKED,
        ),
    )


def _figure(claims: list[Claim]) -> Figure:
    from matplotlib.figure import Figure

    rows = [claim for claim in claims if claim.tolerance == EXACT and claim.relation == "="]
    figure = Figure(figsize=(9.0, 1.2 + 0.3 * len(rows)), layout="constrained")
    axes = figure.subplots()
    places = np.arange(len(rows))
    for shift, which, color, label in ((-0.2, 0, "#d55e00", "as printed"), (0.2, -1, "#0072b2", "at its best")):
        found = [max(claim.findings[which].ours[0], ROUNDING) for claim in rows]
        axes.barh(places + shift, found, 0.38, left=ROUNDING, color=color, label=label)
    axes.axvline(EXACT, color="black", linestyle=":", label="exact to finite differences")
    axes.set_xscale("log")
    axes.set_yticks(places, [f"{claim.source.split(', ')[-1]}: {claim.name}" for claim in rows], fontsize=8)
    axes.invert_yaxis()
    axes.set(xlabel="largest relative residual", xlim=(ROUNDING, 100.0), title="Statements, printed and corrected")
    axes.legend(fontsize=8, loc="lower right")
    axes.grid(alpha=0.25, axis="x")
    return figure
