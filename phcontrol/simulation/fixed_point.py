"""The equations of an implicit step, solved."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import root

from phcontrol._validation import Array
from phcontrol.exceptions import PHControlError

_ITERATIONS = 25


def fixed_point(improved: Callable[[Array], Array], guess: Array, what: str, converged: float = 1e-13) -> Array:
    """Return z = improved(z), by iteration, and by SciPy's Powell hybrid method where that does not contract.

    It does not for a stiff contact, or a step that is long for the friction.

    Args:
        improved: the map.
        guess: where to begin.
        what: the error's message.
        converged: change, relative to z, at which it ends; it ends too where a small one falls no more.

    Raises PHControlError when there is no solution near the guess.
    """
    value, last = guess, np.inf
    for _ in range(_ITERATIONS):
        following = improved(value)
        change = float(np.abs(following - value).max() / (1.0 + np.abs(following).max()))
        value = following
        if change <= converged or (change < 1e-11 and change >= last):
            return value
        last = change
    solution = root(lambda z: improved(z) - z, guess, tol=1e-12)
    if not np.abs(improved(solution.x) - solution.x).max() <= 1e-8 * (1.0 + np.abs(solution.x).max()):
        raise PHControlError(what)
    return improved(solution.x)
