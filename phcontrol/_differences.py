"""Derivatives by finite differences, where analytic ones are what is to be checked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def central_difference(function: Callable[[float], Any], step: float) -> Any:
    """Return the derivative of a function at 0, with an error of the order of step⁴."""
    near = function(step) - function(-step)
    far = function(2.0 * step) - function(-2.0 * step)
    return (8.0 * near - far) / (12.0 * step)
