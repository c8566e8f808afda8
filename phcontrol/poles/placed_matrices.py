"""The gain matrices of all joints that put the poles of every direction where they should be."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from phcontrol._validation import Array
from phcontrol.poles.diagonal_directions import DiagonalDirections
from phcontrol.poles.directions import Directions
from phcontrol.poles.poles import Placed, Poles


class PlacedMatrices(NamedTuple):
    """Gains, and what each direction came to."""

    gains: dict[str, Any]
    """By the arguments of the law."""
    found: tuple[Placed, ...]
    """Of each direction."""
    friction: Array
    """What friction damps in each, shape (n,) [1/s]."""


def placed_matrices(
    poles: Poles, inertia: Array, friction: Array, input_matrix: Array | None = None, *, diagonal: bool = False
) -> PlacedMatrices:
    """Return the gains with which every direction of the joints has its poles; a force gain is that of A = 1.

    Args:
        poles: where they should be.
        inertia: M where the law rests, shape (n, n).
        friction: D there, shape (n, n); zero for laws that cancel it.
        input_matrix: G there, of laws that damp through it, shape (n, n); None for a damping of the joints themselves.
        diagonal: diagonal gains, which put the slowest mode there and the others further.

    Raises PHControlError where no positive gains do that.
    """
    directions = (DiagonalDirections if diagonal else Directions)(inertia, friction)
    found = tuple(poles.place(float(d)) for d in directions.friction)
    gains: dict[str, Any] = {
        name: directions.matrix(how, np.array([each.gains[name] for each in found]))
        for name, how in poles.kinds.items()
    }
    if "force_gain" in gains:
        gains["coupling"] = 1.0
    if input_matrix is not None:
        inverse = np.linalg.inv(input_matrix)
        gains["damping"] = inverse @ gains["damping"] @ inverse.T
    return PlacedMatrices(gains, found, directions.friction)
