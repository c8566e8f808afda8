"""Whether a transformation (Φ, U, β) of an arm is a generalised canonical one, by Theorem 2.2.1."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from phcontrol._differences import central_difference
from phcontrol._validation import Array, count
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.system import MechanicalSystem

Transformation = Callable[[Array, Array, float], Array]
"""Φ(q, p, t): the new coordinates."""
EnergyChange = Callable[[Array, Array, float], float]
"""U(q, p, t) [J]: what is added to H."""
InputChange = Callable[[Array, Array, float], Array]
"""β(q, p, t), shape (n,) [N·m]: what is added to u."""
Structure = Callable[[Array, Array, float], Array]
"""K or S(q, p, t), shape (2n, 2n): what is added to J or to R."""

TOLERANCE = 1e-6
_STEP = 2e-4
_DEGENERATE = 1e-8  # smallest singular value of ∂Φ/∂(q, p) with columns of length 1: finite differences leave 1e-11


@dataclass(frozen=True)
class CanonicalCheck:
    """What was found at random points of (q, p, t)."""

    samples: int
    residual: float
    """Largest entry of (2.25), divided by the largest of its terms at the same point (at least by 1)."""
    smallest_dissipation: float
    """Smallest eigenvalue of R + S, which must not be negative."""

    @property
    def passed(self) -> bool:
        """Whether the transformation turns the arm into another port-Hamiltonian system."""
        return self.residual <= TOLERANCE and self.smallest_dissipation >= -TOLERANCE


def check_canonical_transformation(
    transformation: Transformation,
    energy_change: EnergyChange,
    input_change: InputChange,
    system: MechanicalSystem,
    *,
    interconnection_change: Structure | None = None,
    dissipation_change: Structure | None = None,
    samples: int = 20,
    seed: int = 0,
    horizon: float = 10.0,
) -> CanonicalCheck:
    """Check the partial differential equation (2.25) at random points.

    With x = (q, p) and the arm ẋ = (J − R)∂H/∂x + g u, the transformation x̄ = Φ, H̄ = H + U, ū = u + β is
    generalised canonical if

        ∂Φ/∂(x,t) · [(J − R)∂U/∂x + (K − S)∂(H + U)/∂x + g β;  −1] = 0

    with a skew K and a symmetric S such that R + S ⪰ 0 (both zero when not given). The derivatives of Φ,
    U and H are taken by finite differences of fourth order, so that nothing but Φ, U and β is trusted.

    Args:
        transformation: Φ(q, p, t).
        energy_change: U(q, p, t) [J].
        input_change: β(q, p, t) [N·m].
        system: the arm.
        interconnection_change: K(q, p, t).
        dissipation_change: S(q, p, t).
        samples: number of points.
        seed: of the random points.
        horizon: times are drawn from 0 to this [s].
    """
    count("samples", samples)
    n, generator = system.n, np.random.default_rng(seed)
    residual, smallest = 0.0, np.inf
    for _ in range(samples):
        position, velocity = system.robot.random_position(generator), generator.normal(size=n)
        time = float(generator.uniform(0.0, horizon))
        state = system.at(position, velocity)
        momentum = state.momentum
        point = np.concatenate([position, momentum])

        def energy(x: Array, t: float = time) -> Array:
            momentum = x[n:]
            view = system.at(x[:n])
            inverse_momentum = view.solve_factor(momentum)
            kinetic = 0.5 * inverse_momentum.dot(inverse_momentum)
            return np.array(kinetic + view.potential_energy + energy_change(x[:n], momentum, t))

        def change(x: Array, t: float = time) -> Array:
            return np.array(energy_change(x[:n], x[n:], t))

        def transformed(x: Array, t: float = time) -> Array:
            return np.asarray(transformation(x[:n], x[n:], t))

        change_gradient = _gradient(change, point)
        total_gradient = _gradient(energy, point)
        dissipation = np.zeros((2 * n, 2 * n))
        dissipation[n:, n:] = state.damping_matrix
        flow = np.concatenate([change_gradient[n:], -change_gradient[:n]]) - dissipation @ change_gradient
        if interconnection_change is not None:
            added = interconnection_change(position, momentum, time)
            if np.abs(added + added.T).max() > 1e-9 * max(1.0, np.abs(added).max()):
                raise InvalidArgumentError("interconnection_change", "must be skew-symmetric")
            flow = flow + added @ total_gradient
        if dissipation_change is not None:
            added = dissipation_change(position, momentum, time)
            if np.abs(added - added.T).max() > 1e-9 * max(1.0, np.abs(added).max()):
                raise InvalidArgumentError("dissipation_change", "must be symmetric")
            flow = flow - added @ total_gradient
            dissipation = dissipation + added
        flow[n:] += state.input_matrix @ input_change(position, momentum, time)
        slope = _gradient(transformed, point)
        _check_regular(slope, point)
        drift = central_difference(partial(_later, transformed, point, time), _STEP)
        terms = slope * flow[:, None]
        scale = max(1.0, float(np.abs(terms).max()), float(np.abs(drift).max()))
        residual = max(residual, float(np.abs(terms.sum(axis=0) - drift).max()) / scale)
        smallest = min(smallest, float(np.linalg.eigvalsh(dissipation)[0]))
    return CanonicalCheck(samples, residual, smallest)


def _check_regular(slope: Array, point: Array) -> None:
    """Raise InvalidArgumentError where Φ is no change of coordinates: too few of them, or dependent ones."""
    place = np.array2string(point, precision=3)
    if slope.shape != (point.size, point.size):
        raise InvalidArgumentError(
            "transformation", f"must give {point.size} coordinates for (q, p), but gives {slope.shape[-1:]} at {place}"
        )
    lengths = np.linalg.norm(slope, axis=0)
    if not np.isfinite(slope).all() or not (lengths > 0.0).all():
        raise InvalidArgumentError("transformation", f"a coordinate does not change with (q, p) at {place}")
    if np.linalg.svd(slope / lengths, compute_uv=False)[-1] < _DEGENERATE:
        raise InvalidArgumentError(
            "transformation", f"is degenerate: its coordinates do not determine (q, p) at {place}"
        )


def _later(function: Callable[[Array, float], Array], point: Array, time: float, shift: float) -> Array:
    return function(point, time + shift)


def _along(function: Callable[[Array], Array], point: Array, axis: Array, shift: float) -> Array:
    return function(point + shift * axis)


def _gradient(function: Callable[[Array], Array], point: Array) -> Array:
    """Return the derivatives of a function along each coordinate, stacked first."""
    axes = np.eye(point.size)
    return np.array([central_difference(partial(_along, function, point, axis), _STEP) for axis in axes])
