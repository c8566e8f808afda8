"""Image features of an object of known length, and how they move with the camera: pure functions.

The features are τ = (μ, ν, l) = (f/Z)(X, Y, L): where the object's centre (X, Y, Z), in the camera's frame, falls on
the image plane, and how long the object's length L appears there, all in metres (5.1). f is the focal length.
"""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array


def project(point: Array, focal_length: float, length: float) -> Array:
    """Return τ = (f/Z)(X, Y, L), shape (3,) [m], of a point in the camera's frame [m]. Negative depths give l < 0."""
    X, Y, Z = point.tolist()
    scale = focal_length / Z if Z else np.inf
    return np.array([scale * X, scale * Y, scale * length])


def back_project(features: Array, focal_length: float, length: float) -> Array:
    """Return the point (X, Y, Z) = (L/l)(μ, ν, f) in the camera's frame, shape (3,) [m]: the inverse of ``project``."""
    mu, nu, size = features.tolist()
    scale = length / size
    return np.array([scale * mu, scale * nu, scale * focal_length])


def interaction_matrix(features: Array, focal_length: float, length: float) -> Array:
    """Return Δ(τ), shape (3, 6): τ̇ = Δ ξ for a fixed object, thesis (5.3) corrected (errata E16, E17).

    ξ = (v, ω) is the twist of the camera in its own frame [m/s, rad/s].

    Example:
        >>> import numpy as np
        >>> from phcontrol import interaction_matrix
        >>> interaction_matrix(np.array([0.0, 0.0, 0.002]), focal_length=0.01, length=0.04).round(3)
        array([[-0.05,  0.  ,  0.  ,  0.  , -0.01,  0.  ],
               [ 0.  , -0.05,  0.  ,  0.01, -0.  , -0.  ],
               [ 0.  ,  0.  ,  0.01,  0.  , -0.  ,  0.  ]])
    """
    mu, nu, size = features.tolist()
    f = focal_length
    scale = size / length
    cross = mu * nu / f
    return np.array(
        [
            [-scale, 0.0, scale * mu / f, cross, -f - mu * mu / f, nu],
            [0.0, -scale, scale * nu / f, f + nu * nu / f, -cross, -mu],
            [0.0, 0.0, scale * size / f, size * nu / f, -size * mu / f, 0.0],
        ]
    )


def interaction_matrix_rate(features: Array, rate: Array, focal_length: float, length: float) -> Array:
    """Return Δ̇, shape (3, 6): the derivative of Δ(τ) along τ̇."""
    mu, nu, size = features.tolist()
    mu_rate, nu_rate, size_rate = rate.tolist()
    f = focal_length
    scale_rate = size_rate / length
    cross = (mu_rate * nu + mu * nu_rate) / f
    first = (size_rate * mu + size * mu_rate) / f
    second = (size_rate * nu + size * nu_rate) / f
    return np.array(
        [
            [-scale_rate, 0.0, first / length, cross, -2.0 * mu * mu_rate / f, nu_rate],
            [0.0, -scale_rate, second / length, 2.0 * nu * nu_rate / f, -cross, -mu_rate],
            [0.0, 0.0, 2.0 * size * scale_rate / f, second, -first, 0.0],
        ]
    )


def interaction_matrix_derivative(features: Array, focal_length: float, length: float) -> Array:
    """Return ∂Δ/∂τ, shape (3, 3, 6): [k] is the derivative with respect to the k-th feature."""
    return np.array([interaction_matrix_rate(features, unit, focal_length, length) for unit in np.eye(3)])
