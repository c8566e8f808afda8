"""The port-Hamiltonian system that a generalised canonical transformation makes of an arm, at one point."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from phcontrol._differences import central_difference
from phcontrol._validation import Array
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

_STEP = 2e-4
_DEGENERATE = 1e-8  # smallest singular value of ∂Φ/∂(q, p) with columns of length 1: finite differences leave 1e-11


@dataclass(frozen=True)
class TransformedSystem:
    """x̄̇ = (J̄ − R̄)∂H̄/∂x̄ + ḡ(u + β), ȳ = ḡᵀ∂H̄/∂x̄ = y + α at one (q, p, t): Theorems 2.2.1 and 2.2.2.

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, load_robot, transformed_system
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> unit_mass = lambda q, p, t: np.concatenate([q, system.at(q).solve_factor(p)])
        >>> x = system.at([0.3, 0.2], [0.1, 0.0])
        >>> found = transformed_system(unit_mass, lambda q, p, t: 0.0, system, x.position, x.momentum)
        >>> np.allclose(found.interconnection, -found.interconnection.T, atol=1e-6), found.residual < 1e-6
        (True, True)
    """

    coordinates: Array
    """x̄ = Φ, shape (2n,) (2.21)."""
    storage: float
    """H̄ = H + U [J] (2.22)."""
    interconnection: Array
    """J̄ = ∂Φ/∂x (J + K) ∂Φ/∂xᵀ, shape (2n, 2n) (2.27)."""
    dissipation: Array
    """R̄ = ∂Φ/∂x (R + S) ∂Φ/∂xᵀ, shape (2n, 2n) (2.29)."""
    input_matrix: Array
    """ḡ = ∂Φ/∂x g, shape (2n, n) (2.28)."""
    output_change: Array
    """α = gᵀ∂U/∂x, shape (n,) [rad/s] (2.26)."""
    input_change: Array
    """β, shape (n,) [N·m]: as it was given, or as (2.25) has it."""
    storage_gradient: Array
    """∂H̄/∂x̄, shape (2n,)."""
    residual: float
    """Largest entry of (2.25), divided by the largest of its terms (at least by 1)."""
    least_dissipation: float
    """Smallest eigenvalue of R + S."""
    growth: float
    """H̄̇ − ȳᵀū along the arm's own motion [W]: with u = −β, ∂H̄/∂xᵀ[(J − R)∂H/∂x − gβ] + ∂H̄/∂t. Passive where it is
    ≤ 0 everywhere."""
    printed_condition: float
    """The left-hand side of (2.30) [W], whose sign the thesis calls necessary and sufficient (errata E31)."""
    power: float
    """Sum of the absolute terms of ``growth`` [W]."""

    def feedback(self, gain: Array, output: Array) -> Array:
        """Return u = −β − 𝒞(y + α), shape (n,) [N·m], which brings a zero-state detectable system to rest.

        Args:
            gain: 𝒞 > 0, shape (n, n) [N·m·s/rad].
            output: y = Gᵀq̇ [rad/s].
        """
        torque: Array = -self.input_change - gain.dot(output + self.output_change)
        return torque


def transformed_system(
    transformation: Transformation,
    energy_change: EnergyChange,
    system: MechanicalSystem,
    position: Array,
    momentum: Array,
    time: float = 0.0,
    *,
    input_change: InputChange | None = None,
    interconnection_change: Structure | None = None,
    dissipation_change: Structure | None = None,
) -> TransformedSystem:
    """Return what Φ and U make of an arm at one (q, p, t): J̄, R̄, ḡ, α and β, and whether it is passive there.

    With x = (q, p) and the arm ẋ = (J − R)∂H/∂x + g u the transformation is generalised canonical where

        ∂Φ/∂(x,t) · [(J − R)∂U/∂x + (K − S)∂(H + U)/∂x + g β;  −1] = 0.                              (2.25)

    Without ``input_change`` β is what this equation says: its rows of p give Gβ, those of q must hold by themselves.
    The derivatives of Φ, U and H are finite differences of fourth order: nothing but Φ, U and β is trusted.

    Args:
        transformation: Φ(q, p, t).
        energy_change: U(q, p, t) [J].
        system: the arm.
        position: q [rad].
        momentum: p [N·m·s].
        time: t [s].
        input_change: β(q, p, t) [N·m], or None for that of (2.25).
        interconnection_change: K(q, p, t), skew.
        dissipation_change: S(q, p, t), symmetric.

    Raises InvalidArgumentError for a Φ whose coordinates do not determine (q, p), a K that is not skew, and an S that
    is not symmetric.

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, load_robot, transformed_system
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> unit_mass = lambda q, p, t: np.concatenate([q, system.at(q).solve_factor(p)])
        >>> x = system.at([0.3, 0.2], [0.1, 0.0])
        >>> found = transformed_system(unit_mass, lambda q, p, t: 0.0, system, x.position, x.momentum)
        >>> bool(np.isclose(found.storage, x.energy)), found.residual < 1e-6
        (True, True)
    """
    n = system.n
    inertia = system.at(position)
    state = system.at(position, inertia.solve_factor_transposed(inertia.solve_factor(momentum)))
    point = np.concatenate([position, momentum])

    def energy(x: Array, t: float) -> Array:
        view = system.at(x[:n])
        scaled = view.solve_factor(x[n:])
        return np.array(0.5 * scaled.dot(scaled) + view.potential_energy)

    def change(x: Array, t: float) -> Array:
        return np.array(energy_change(x[:n], x[n:], t))

    def transformed(x: Array, t: float) -> Array:
        return np.asarray(transformation(x[:n], x[n:], t))

    own, added = (_gradient(partial(_fixed, each, time), point) for each in (energy, change))
    total = own + added
    interconnection, dissipation = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 2 * n))
    interconnection[:n, n:], interconnection[n:, :n] = np.eye(n), -np.eye(n)
    dissipation[n:, n:] = state.damping_matrix
    plain = interconnection - dissipation
    K = _structure("interconnection_change", interconnection_change, -1.0, position, momentum, time)
    S = _structure("dissipation_change", dissipation_change, 1.0, position, momentum, time)
    port = np.vstack([np.zeros((n, n)), state.input_matrix])
    flow = plain @ added + (K - S) @ total
    slope = _gradient(partial(_fixed, transformed, time), point)  # [j] is ∂Φ/∂x_j
    _check_regular(slope, point)
    drift = central_difference(partial(_later, transformed, point, time), _STEP)
    if input_change is None:
        needed = np.linalg.solve(slope.T, drift) - flow
        beta = np.asarray(np.linalg.solve(state.input_matrix, needed[n:]), dtype=float)
    else:
        beta = np.asarray(input_change(position, momentum, time))
    pushed = port @ beta
    terms = slope * (flow + pushed)[:, None]
    scale = max(1.0, float(np.abs(terms).max()), float(np.abs(drift).max()))
    rate = float(central_difference(partial(_later, change, point, time), _STEP))
    growing = np.concatenate([total * (plain @ own), -total * pushed, [rate]])
    printed = float(total @ (plain @ added - S @ total + pushed)) - rate
    return TransformedSystem(
        coordinates=transformed(point, time),
        storage=float(energy(point, time) + change(point, time)),
        interconnection=slope.T @ (interconnection + K) @ slope,
        dissipation=slope.T @ (dissipation + S) @ slope,
        input_matrix=slope.T @ port,
        output_change=port.T @ added,
        input_change=beta,
        storage_gradient=np.asarray(np.linalg.solve(slope, total), dtype=float),
        residual=float(np.abs(terms.sum(axis=0) - drift).max()) / scale,
        least_dissipation=float(np.linalg.eigvalsh(dissipation + S)[0]),
        growth=float(growing.sum()),
        printed_condition=printed,
        power=float(np.abs(growing).sum()),
    )


def _structure(
    name: str, change: Structure | None, mirror: float, position: Array, momentum: Array, time: float
) -> Array:
    """Return K or S, checked: zeros without one."""
    size = 2 * position.size
    if change is None:
        return np.zeros((size, size))
    added = np.asarray(change(position, momentum, time))
    if added.shape != (size, size):
        raise InvalidArgumentError(name, f"must have shape {(size, size)}, but has shape {added.shape}")
    if np.abs(added - mirror * added.T).max() > 1e-9 * max(1.0, float(np.abs(added).max())):
        raise InvalidArgumentError(name, "must be symmetric" if mirror > 0.0 else "must be skew-symmetric")
    return added


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


def _fixed(function: Callable[[Array, float], Array], time: float, point: Array) -> Array:
    return function(point, time)


def _later(function: Callable[[Array, float], Array], point: Array, time: float, shift: float) -> Array:
    return function(point, time + shift)


def _along(function: Callable[[Array], Array], point: Array, axis: Array, shift: float) -> Array:
    return function(point + shift * axis)


def _gradient(function: Callable[[Array], Array], point: Array) -> Array:
    """Return the derivatives of a function along each coordinate, stacked first."""
    axes = np.eye(point.size)
    return np.array([central_difference(partial(_along, function, point, axis), _STEP) for axis in axes])
