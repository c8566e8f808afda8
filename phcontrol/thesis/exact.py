"""Statements that hold to rounding or not at all, and rates along an arm's true motion to hold them against."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from phcontrol._differences import central_difference
from phcontrol._validation import Array
from phcontrol.mechanics.state import MechanicalState
from phcontrol.thesis.claim import Claim
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.origin import Origin

EXACT = 1e-6
"""Largest relative residual of what is exact: what finite differences leave is below."""
_STEP = 2e-4  # of the finite differences [s or rad]


def exact(
    name: str, statement: str, source: str, printed: float, corrected: float | None = None, erratum: str = "",
    reason: str = "", chosen: str = "", already: str = "", origin: Origin = Origin.THEOREM,
) -> Claim:  # fmt: skip
    """Return the claim that a residual is 0.

    Args:
        name: of the claim.
        statement: what is said to hold exactly.
        source: where.
        printed: the residual with the formula as printed.
        corrected: with the formula corrected; None where there is nothing to correct.
        erratum: what the correction mends, all of it.
        reason: why they differ, or what to know.
        chosen: what the thesis leaves open.
        already: corrections that the printed formula was held against, of the law for instance.
        origin: whose it is.
    """
    findings = [Finding((printed,), already, chosen=chosen)]
    if corrected is not None:
        findings.append(Finding((corrected,), erratum, chosen=chosen))
    return Claim(
        name, f"{statement}: largest relative residual", origin, source, (0.0,), "", EXACT, findings, reason=reason
    )


def positive(name: str, statement: str, source: str, findings: list[Finding], reason: str, least: float = 0.0) -> Claim:
    """Return the claim that a number is positive, at least ``least``."""
    return Claim(name, statement, Origin.THEOREM, source, (least,), "", 0.0, findings, ">=", reason)


def negative(name: str, statement: str, source: str, findings: list[Finding], reason: str, unit: str = "") -> Claim:
    """Return the claim that a number is negative, or nought but for rounding."""
    return Claim(name, statement, Origin.THEOREM, source, (0.0,), unit, EXACT, findings, "<=", reason)


def rate(
    quantity: Callable[[MechanicalState, Array], Any],
    x: MechanicalState,
    acceleration: Array,
    state: Array | None = None,
    state_rate: Array | None = None,
) -> Any:
    """Return the rate of a quantity of arm and controller state along the arm's motion, by finite differences."""
    own, changing = (np.zeros(0) if each is None else each for each in (state, state_rate))

    def moved(h: float) -> Any:
        there = x.system.at(x.position + h * x.velocity, x.velocity + h * acceleration)
        return quantity(there, own + h * changing)

    return central_difference(moved, _STEP)


def slope(function: Callable[[Array], Any], point: Array) -> Array:
    """Return ∂f/∂x by finite differences: [k] is the derivative by x_k."""
    return np.array([central_difference(partial(_shifted, function, point, e), _STEP) for e in np.eye(point.size)])


def _shifted(function: Callable[[Array], Any], point: Array, direction: Array, h: float) -> Any:
    return function(point + h * direction)


def off(found: Any, true: Any) -> float:
    """Return the largest error over the largest true entry."""
    return float(np.abs(np.subtract(found, true)).max() / max(float(np.abs(true).max()), 1e-12))


def largest_real_part(rate_of: Callable[[Array], Array], rest: Array) -> float:
    """Return the largest real part of the eigenvalues of ẏ = f(y) about a rest [1/s]."""
    return float(np.linalg.eigvals(slope(rate_of, rest).T).real.max())
