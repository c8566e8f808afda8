"""Derivatives by finite differences, where analytic ones are what is to be checked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from phcontrol._validation import Array


def central_difference(function: Callable[[float], Any], step: float) -> Any:
    """Return the derivative of a function at 0, with an error of the order of step⁴."""
    near = function(step) - function(-step)
    far = function(2.0 * step) - function(-2.0 * step)
    return (8.0 * near - far) / (12.0 * step)


def jacobian(function: Callable[[Array], Array], point: Array, units: Array, step: float) -> Array:
    """Return ∂f/∂x at a point, shape (len(f), len(x)), with steps of ``step`` units along each axis."""

    def along(axis: Array) -> Callable[[float], Array]:
        return lambda shift: function(point + shift * axis)

    columns = [central_difference(along(axis), step) for axis in np.diag(units)]
    slope: Array = np.stack(columns, axis=-1) / units
    return slope
