"""Derivatives by finite differences, where analytic ones are what is to be checked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from phcontrol._validation import Array

TINY, BEND = 1e-7, 1e-3
"""A step, and by how much, relatively, slopes ahead and behind may differ over it: more in a kink."""


def central_difference(function: Callable[[float], Any], step: float) -> Any:
    """Return the derivative of a function at 0, with an error of the order of step⁴."""
    near = function(step) - function(-step)
    far = function(2.0 * step) - function(-2.0 * step)
    return (8.0 * near - far) / (12.0 * step)


def slope_change(function: Callable[[float], Any], step: float) -> Any:
    """Return the slope of a function ahead of 0 minus that behind: what a kink has, and central differences miss."""
    return (function(step) + function(-step) - 2.0 * function(0.0)) / step


def jacobian(function: Callable[[Array], Array], point: Array, units: Array, step: float) -> tuple[Array, Array]:
    """Return ∂f/∂x at a point, shape (len(f), len(x)), with steps of ``step`` units along each axis, and its error.

    The error of each entry is estimated by how much the fourth order differs from the second: a safe bound.
    """
    slopes, errors = [], []
    for axis in step * np.diag(units):
        near = function(point + axis) - function(point - axis)
        far = function(point + 2.0 * axis) - function(point - 2.0 * axis)
        slopes.append((8.0 * near - far) / (12.0 * step))
        errors.append(np.abs(slopes[-1] - near / (2.0 * step)))
    return np.stack(slopes, axis=-1) / units, np.stack(errors, axis=-1) / units
