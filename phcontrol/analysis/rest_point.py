"""Where a law rests, whether H_d has a minimum there, and how the closed loop moves about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from phcontrol._differences import jacobian
from phcontrol._validation import Array
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.neighbourhood import DEPENDENT, STEPS, Neighbourhood, spectrum_of
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.system import MechanicalSystem

_BEND = 1e-3  # of second differences, in natural units
_ITERATIONS = 30
_SMALLEST_STEP = 1e-2  # in natural units, to which a step that leads away is halved
_FOUND = 1e-8  # of what a natural unit away changes
_EXACT = 1e-12  # the same, of a zero that cannot be bettered
_DIRECTIONS, _PROBE = 3, 0.01  # in which and how far away that is looked at
ENVIRONMENT_FREQUENCIES = (4.0, 0.5)
"""Of each joint on the springs that it touches where a force-controlled law rests [rad/s]."""

TOUCH_FREQUENCIES = (0.5, 4.0, 100.0)
"""Likewise, where a law rests freely and f_e drives it: something may touch it [rad/s]."""

STABLE, MARGINAL, UNSTABLE = "asymptotically stable", "marginal", "unstable"


@dataclass(frozen=True)
class RestPoint:
    """A state at which nothing moves, or moves with the reference, and the linearised closed loop about it."""

    time: float
    position: Array
    velocity: Array
    state: Array
    force: Array
    """The external force there: 0, or what a force-controlled law desires [N·m]."""
    in_contact: bool
    """Whether an elastic environment exerts it."""
    touched: bool
    """Whether one is there though it exerts nothing there."""
    found: bool
    """Whether ∇H_d (or, in an environment, the rate) vanishes near the law's own goal."""
    unrest: float
    """What is left of the true closed loop's rate there, over what a natural unit away changes it; 0 for a law that
    changes with time and so moves."""
    curvature: float
    """Smallest eigenvalue of the Hessian of H_d, scaled to a unit diagonal; NaN for a law that lacks a minimum."""
    eigenvalues: Array = field(repr=False)
    """Of the linearised closed loop, complex [1/s]."""
    uncertainty: Array = field(repr=False)
    """Of each eigenvalue, from the finite differences [1/s]."""

    @property
    def stability(self) -> str:
        """Whether the linearised loop is asymptotically stable, marginal or unstable."""
        if not self.eigenvalues.size or (self.eigenvalues.real - self.uncertainty > 0.0).any():
            return UNSTABLE
        return STABLE if (self.eigenvalues.real + self.uncertainty < 0.0).all() else MARGINAL

    @property
    def slowest(self) -> float:
        """Time constant of the slowest mode that fades [s]."""
        fading = -self.eigenvalues.real[self.eigenvalues.real < -self.uncertainty]
        return float(1.0 / fading.min()) if fading.size else np.inf


def find_rest(
    law: Controller,
    plant: MechanicalSystem,
    units: NaturalUnits,
    time: float,
    frequency: float = ENVIRONMENT_FREQUENCIES[0],
    touched: bool = False,
) -> RestPoint:
    """Find the law's rest point from its rest posture, and linearise the true closed loop about it.

    Where a law rests in free motion (or with its reference) that is where ∇H_d = 0. A law that rests under a force
    (``Controller.rest_force``) is given an elastic environment that exerts it at the rest posture, a spring that
    gives each joint a natural frequency [rad/s], and rests where the closed loop's rate is 0, or its reference's.
    ``touched`` gives it to a law that rests in free motion too: it is at ease at the rest posture.
    """
    return _Resting(law, plant, units, time, frequency, touched).rest()


def touched_spring(law: Controller, plant: MechanicalSystem, time: float, frequency: float) -> Array:
    """Return a spring that gives each joint a frequency [rad/s] where a law rests, and what it is meant to press on.

    A stiffness of the joints, shape (n, n) [N·m/rad].
    """
    x = plant.at(law.rest_posture(time))
    spring: Array = np.diag(frequency**2 * np.diag(x.mass_matrix))
    surface = None if law.rest_force(x) is None else law.contact_stiffness(x)
    return spring if surface is None else spring + surface


class _Resting:
    """The search for a law's rest point at one time."""

    def __init__(
        self,
        law: Controller,
        plant: MechanicalSystem,
        units: NaturalUnits,
        time: float,
        frequency: float,
        touched: bool,
    ) -> None:
        x = plant.at(np.array(law.rest_posture(time)))
        desired = law.rest_force(x)
        self._law, self._n, self._units = law, plant.n, units.motion
        self._free, self._touched = desired is None, touched
        force = np.zeros(plant.n) if desired is None else desired
        spring = touched_spring(law, plant, time, frequency) if touched or desired is not None else None
        self._around = Neighbourhood(law, plant, units, time, force, spring)
        self._start = np.concatenate([x.position, np.zeros(plant.n), law.initial_state(x)])

    def rest(self) -> RestPoint:
        free, around = self._free, self._around
        y, found = self._root(around.gradient if free else around.drift)
        self._bent = False
        if free and not found:  # coordinates that are more than they need: ∇H_d is zero only along what moves
            y, found = self._root(around.rate)
            found = found and self._left(around.pulled, y, around.pulled(y)) <= _FOUND
            self._bent = found
        n, law = self._n, self._law
        unrest = 0.0 if law.time_span else self._left(around.rate, y, around.rate(y))
        values, uncertainty = spectrum_of(*around.linearised(y))
        curvature = self._curvature(y) if found and not law.lacks_minimum else np.nan
        return RestPoint(
            around.time, y[:n], y[n : 2 * n], y[2 * n :], around.force(y[:n]), not free,
            free and self._touched, found, unrest, curvature, values, uncertainty,
        )  # fmt: skip

    def _root(self, function: Callable[[Array], Array]) -> tuple[Array, bool]:
        """Return a zero of a function near the rest posture, and whether it is one.

        By Gauss-Newton steps, halved where they lead away.
        """
        y = best = self._start
        smallest, step = np.inf, np.zeros(y.size)
        for _ in range(_ITERATIONS):
            value = function(y)
            if not value.size or not np.isfinite(value).all():
                break
            left = self._left(function, y, value)
            if left < smallest:
                nearer, smallest, best = left < 0.5 * smallest, left, y
                if left <= _EXACT or (left <= _FOUND and not nearer):  # no nearer any more
                    break
                slope, _ = jacobian(function, y, self._units, STEPS[0])
                step = self._units * np.linalg.lstsq(slope * self._units, value, rcond=1e-12)[0]
            elif smallest <= _FOUND or (np.abs(step) <= _SMALLEST_STEP * self._units).all():
                break
            else:
                step = 0.5 * step
            y = best - step
        return best, smallest <= _FOUND

    def _left(self, function: Callable[[Array], Array], y: Array, value: Array) -> float:
        """Return the largest entry of a function's value at y over what it changes a natural unit away.

        That is taken from a hundredth of it: farther off a camera may see nothing.
        """
        signs = np.random.default_rng(0).choice([-_PROBE, _PROBE], size=(_DIRECTIONS, y.size))
        unit = np.max([np.abs(function(y + sign * self._units) - value) for sign in signs], axis=0) / _PROBE
        return float((np.abs(value) / np.maximum(unit, 1e-9 * max(float(unit.max()), 1e-300))).max())

    def _curvature(self, y: Array) -> float:
        """Return the smallest eigenvalue of H_xx, the Hessian of H_d in the target's coordinates, scaled.

        With J = ∂x/∂y the derivative of ∇H_d along y is H_xx J. Coordinates that y does not reach do not count.
        """
        if self._bent:
            return _smallest_scaled(self._second_differences(y))
        J = jacobian(self._around.coordinates, y, self._units, STEPS[0])[0] * self._units
        bent = jacobian(self._around.gradient, y, self._units, STEPS[0])[0] * self._units
        lengths = np.linalg.norm(J, axis=0)
        fewer = J.shape[0] < J.shape[1]
        if fewer or not (lengths > 0.0).all() or np.linalg.svd(J / lengths, compute_uv=False)[-1] < DEPENDENT:
            return 0.0  # H_d does not know everything that moves
        if J.shape[0] == J.shape[1]:
            hessian = np.linalg.solve(J.T, bent.T).T
        else:
            basis, triangle = np.linalg.qr(J)
            hessian = basis.T @ np.linalg.solve(triangle.T, bent.T).T
        return _smallest_scaled(hessian)

    def _second_differences(self, y: Array) -> Array:
        """Return the Hessian of H_d in y, in natural units."""
        steps, here, size = _BEND * np.diag(self._units), self._around.stored(y), len(y)
        ahead = [self._around.stored(y + step) for step in steps]
        behind = [self._around.stored(y - step) for step in steps]
        hessian = np.diag([a - 2.0 * here + b for a, b in zip(ahead, behind, strict=True)])
        for i in range(size):
            for j in range(i):
                both = self._around.stored(y + steps[i] + steps[j]) + self._around.stored(y - steps[i] - steps[j])
                hessian[i, j] = hessian[j, i] = 0.5 * (both + 2.0 * here - ahead[i] - behind[i] - ahead[j] - behind[j])
        result: Array = hessian / _BEND**2
        return result


def _smallest_scaled(hessian: Array) -> float:
    """Return the smallest eigenvalue of a symmetric matrix scaled to a unit diagonal; 0 where that has a zero."""
    hessian = 0.5 * (hessian + hessian.T)
    root = np.sqrt(np.abs(np.diag(hessian)))
    if not (root > 0.0).all():
        return 0.0
    return float(np.linalg.eigvalsh(hessian / np.outer(root, root))[0])
