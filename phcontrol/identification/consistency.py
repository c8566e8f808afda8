"""Parameters that bodies and joints can have: masses and inertias of rigid bodies, friction that takes energy."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from phcontrol._validation import Array
from phcontrol.identification.parameters import Parameters

_SMALLEST = 1e-9
"""Of the pseudo-inertia of a payload in its usual units: what is below is not told from the edge of what can be."""
_NOT_NEGATIVE = ("coulomb", "viscous", "armature")


def pseudo_inertia(body: Array) -> Array:
    """Return the (4, 4) matrix [[Σ, m c], [m cᵀ, m]], Σ = ½tr(I)1 − I, of a body's ten parameters.

    It is positive semidefinite for rigid bodies, and for nothing else: mass, centre of mass and moments of inertia with
    their triangle inequality all at once. (P. Wensing, S. Kim, J.-J. Slotine, IEEE RA-L 3(1), 2018.)

    >>> import numpy as np
    >>> pseudo_inertia(np.array([2.0, 0, 0, 0, 0.3, 0, 0.3, 0, 0, 0.2])).diagonal()
    array([0.1, 0.1, 0.2, 2. ])
    """
    mass, first = body[0], body[1:4]
    moments = np.array([[body[4], body[5], body[7]], [body[5], body[6], body[8]], [body[7], body[8], body[9]]])
    matrix = np.zeros((4, 4))
    matrix[:3, :3] = 0.5 * np.trace(moments) * np.eye(3) - moments
    matrix[:3, 3] = matrix[3, :3] = first
    matrix[3, 3] = mass
    return matrix


def body_of(matrix: Array) -> Array:
    """Return the ten parameters of a pseudo-inertia, the inverse of :func:`pseudo_inertia`."""
    moments = np.trace(matrix[:3, :3]) * np.eye(3) - matrix[:3, :3]
    order = [(0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)]
    return np.concatenate([[matrix[3, 3]], matrix[:3, 3], [moments[place] for place in order]])


def inconsistent(parameters: Parameters, values: Array) -> tuple[str, ...]:
    """Return what of the values no body and no joint can have, in words; nothing where all is possible."""
    found = []
    if "payload" in parameters.groups:
        body = values[parameters.columns("payload")]
        if np.linalg.eigvalsh(_in_usual_units(pseudo_inertia(body)))[0] < -_SMALLEST:
            found.append("payload (mass and inertia of no rigid body)")
    for group in _NOT_NEGATIVE:
        if group in parameters.groups:
            columns = parameters.columns(group)
            names = parameters.names[columns]
            found += [f"{name} (negative)" for name, x in zip(names, values[columns], strict=True) if x < 0.0]
    return tuple(found)


def consistent_values(parameters: Parameters, matrix: Array, known: Array, start: Array) -> Array:
    """Return the values of least |matrix·θ − known| among those that bodies and joints can have.

    The payload is written as L Lᵀ, with L lower triangular; what may not be negative is bounded. ``matrix`` may be
    triangular: what matters is its product with itself.
    """
    scales = parameters.scales
    lower, upper = np.full(len(scales), -np.inf), np.full(len(scales), np.inf)
    guess = start / scales
    for group in _NOT_NEGATIVE:
        if group in parameters.groups:
            lower[parameters.columns(group)] = 0.0
    body = parameters.columns("payload") if "payload" in parameters.groups else None
    places = np.tril_indices(4)
    if body is not None:
        values, axes = np.linalg.eigh(_in_usual_units(pseudo_inertia(start[body])))
        nearest = axes @ np.diag(np.maximum(values, 1e-4)) @ axes.T
        guess[body] = np.linalg.cholesky(nearest)[places]
    guess = np.maximum(guess, lower)

    def values_of(x: Array) -> Array:
        values: Array = x * scales
        if body is not None:
            root = np.zeros((4, 4))
            root[places] = x[body]
            values[body] = body_of(_from_usual_units(root @ root.T))
        return values

    found = least_squares(lambda x: matrix @ values_of(x) - known, guess, bounds=(lower, upper), xtol=1e-12, ftol=1e-12)
    return values_of(found.x)


_UNITS = np.array([0.1, 0.1, 0.1, 1.0])  # of (Σ, m c; m): lengths of 0.1 m


def _in_usual_units(matrix: Array) -> Array:
    scaled: Array = matrix / np.outer(_UNITS, _UNITS)
    return scaled


def _from_usual_units(matrix: Array) -> Array:
    scaled: Array = matrix * np.outer(_UNITS, _UNITS)
    return scaled
