"""A closed loop about the state where it rests, as a function of (q, q̇, controller state)."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eig

from phcontrol._differences import central_difference, jacobian
from phcontrol._validation import Array
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.system import MechanicalSystem

STEPS = (1e-4, 1e-5, 1e-6)
"""Of the finite differences, in natural units; for each column the best is taken."""
DEPENDENT = 1e-9
"""Smallest singular value of normalised columns, below which one depends on the others."""
_REFERENCE_STEP = 1e-3  # over which q̈_ref is taken of q̇_ref [s]
_ACCURATE = 1e-7  # of the largest entry: an error below which no other step is tried


class Neighbourhood:
    """The closed loop as a function of y = (q, q̇, controller state) at one time.

    Args:
        law: asked at each y.
        plant: whose motion is meant.
        units: of both.
        time: [s].
        force: f_e at the rest posture, shape (n,) [N·m].
        spring: what the arm touches, as a stiffness of the joints about that posture, shape (n, n); None for a force
            that stays.
    """

    def __init__(
        self,
        law: Controller,
        plant: MechanicalSystem,
        units: NaturalUnits,
        time: float,
        force: Array,
        spring: Array | None = None,
    ) -> None:
        self.law, self.plant, self.time = law, plant, time
        self.units = units.motion
        self._n, self._at_rest, self._spring = plant.n, force, spring
        self.posture = np.array(law.rest_posture(time))
        self._scene = law.rest_scene(law.system.at(self.posture))

    def force(self, position: Array) -> Array:
        """Return f_e at a position [N·m]."""
        if self._spring is None:
            return self._at_rest
        away: Array = position - self.posture
        return self._at_rest - self._spring @ away

    def seen(self, y: Array, push: Array | None = None) -> Seen:
        """Return the law at y, under the force there and a ``push`` beside it [N·m]."""
        n, force = self._n, self.force(y[: self._n])
        felt = force if push is None else force + push
        at = SampledState(self.time, y[:n], y[n : 2 * n], y[2 * n :], felt, self._scene, "")
        return Seen.of(self.law, self.plant, at)

    def rate(self, y: Array, push: Array | None = None) -> Array:
        """Return ẏ of the true closed loop."""
        return self.seen(y, push).rate(self.plant)

    def drift(self, y: Array) -> Array:
        """Return ẏ less what a reference moves with, (q̇_ref, q̈_ref, 0): zero where the arm goes along with it."""
        rate, law, n = self.rate(y), self.law, self._n
        if not law.time_span:
            return rate

        def reference(step: float) -> Array:
            x = law.system.at(y[:n] + step * y[n : 2 * n], y[n : 2 * n])
            return law.reference_velocity(self.time + step, x)

        rate[:n] -= reference(0.0)
        rate[n : 2 * n] -= central_difference(reference, _REFERENCE_STEP)
        return rate

    def gradient(self, y: Array) -> Array:
        """Return ∇H_d with respect to the target's coordinates."""
        return self.seen(y).promise().gradient

    def pulled(self, y: Array) -> Array:
        """Return ∇H_d with respect to y."""
        J, _ = jacobian(self.coordinates, y, self.units, STEPS[0])
        pulled: Array = J.T @ self.gradient(y)
        return pulled

    def stored(self, y: Array) -> float:
        """Return H_d [J]."""
        return self.seen(y).stored()

    def coordinates(self, y: Array) -> Array:
        """Return the target's coordinates."""
        return self.seen(y).coordinates()

    def linearised(self, y: Array) -> tuple[Array, Array]:
        """Return S⁻¹(∂ẏ/∂y)S and the error of its entries, column by column that of the best step.

        The columns of S are directions in which one of the target's coordinates changes, a natural unit far: there
        large gains do not drown slow modes. Any regular S gives the same eigenvalues.
        """
        S = self.directions(y)

        def rate(shift: Array) -> Array:
            found: Array = np.asarray(np.linalg.solve(S, self.rate(y + S @ shift)), dtype=float)
            return found

        here, ones = np.zeros(len(y)), np.ones(len(y))
        best, error = jacobian(rate, here, ones, STEPS[0])
        for step in STEPS[1:]:
            if error.max() <= _ACCURATE * np.abs(best).max():
                break
            now, difference = jacobian(rate, here, ones, step)
            nearer = difference.max(axis=0) < error.max(axis=0)
            best, error = np.where(nearer, now, best), np.where(nearer, difference, error)
        return best, error

    def directions(self, y: Array) -> Array:
        """Return S, shape (len(y), len(y)); natural units of y where the coordinates are not as many or dependent."""
        slope = jacobian(self.coordinates, y, self.units, STEPS[0])[0]
        size = np.abs(slope * self.units).max(axis=1, initial=0.0)
        if slope.shape != (len(y), len(y)) or not (size > 0.0).all():
            return np.diag(self.units)
        scaled = slope * self.units / size[:, None]
        if np.linalg.svd(scaled / np.linalg.norm(scaled, axis=0), compute_uv=False)[-1] < DEPENDENT:
            return np.diag(self.units)
        directions = np.linalg.inv(scaled)
        S: Array = self.units[:, None] * directions / np.abs(directions).max(axis=0)
        return S


def spectrum_of(A: Array, error: Array) -> tuple[Array, Array]:
    """Return eigenvalues and how uncertain each is to first order, |wᴴ||E||v| / |wᴴv| with E the entries' errors."""
    if not np.isfinite(A).all():
        return np.array([np.inf]), np.zeros(1)
    rounding = 1e-14 * np.abs(A).max()
    values, left, right = eig(A, left=True, right=True)
    weight = np.abs(np.sum(left.conj() * right, axis=0))
    noise = np.einsum("ik,ij,jk->k", np.abs(left), error + rounding, np.abs(right))
    return values, noise / np.maximum(weight, 1e-12)
