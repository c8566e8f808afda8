"""What friction may do to the next velocity: viscous friction is predicted, of dry friction only an interval is known."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.friction import DeclaredFriction, Friction
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.safety import kernels

_SLOWEST = 1e-6  # speed at which a friction is sampled [rad/s]
_FASTEST = 2.0  # likewise, in velocity limits
_FAST = 100.0  # likewise, for a joint without one [rad/s]
_SAMPLES = 400  # of each sign
_NEGLIGIBLE = 1e-3  # of a period's decay, below which its series is used


class FrictionPrediction:
    """Viscous and dry friction, F_v w + s(w) at a velocity w, in the prediction of the velocity v⁺ after a period h.

    **Viscous**: implicit, with a weight θ that makes the prediction exact for a single joint (1/2 for a weak damping,
    1 for a stiff one):

        v⁺ = q̇ + h(M + hθF_v)⁻¹(f − F_v q̇ − s),   θ = 1/(1 − exp(−x)) − 1/x,   x = hF_v(M⁻¹)_jj at home.

    **Dry**: in one period a joint can pass through many velocities, and s can turn from one end to the other in a
    hundredth of it, so of its mean only an interval is known. With g(w) the least s at w and all velocities above,
    and l ≤ v⁺ ≤ b the bounds of the next velocity,

        s_j ∈ [g(min(q̇_j, l_j)), −g(−max(q̇_j, b_j))].

    All of it counts at the other joints, where it acts through (M + hθF_v)⁻¹ with either sign. A joint's own friction
    cannot push it where it does not go: where joint i would leave b_i it is at least g(min(q̇_i, b_i)), where it would
    leave l_i at most −g(−max(q̇_i, l_i)).

    A friction that is no :class:`DeclaredFriction` is sampled at 800 velocities up to twice the velocity limits
    (100 rad/s where there is none): F_v is the smallest of its coefficients, and s lies between 0 and the largest
    (d − F_v)|w| against the motion. What such a friction does between the samples is not seen.

    Args:
        system: with a friction.
        period: h [s].
        velocity_limit: shape (n,) [rad/s].

    Raises:
        InvalidArgumentError: the friction has coefficients that are negative or not finite.
    """

    def __init__(self, system: MechanicalSystem, period: float, velocity_limit: Array) -> None:
        friction, n = system.friction, system.n
        assert friction is not None
        model: DeclaredFriction = (
            friction if hasattr(friction, "least_dry_torque") else _SampledFriction(friction, velocity_limit)
        )
        self._model = model
        self.viscous: Array = np.array(np.broadcast_to(model.viscous, n), dtype=float)
        """F_v, shape (n,) [N·m·s/rad]."""
        mobility = np.linalg.inv(system.at(system.robot.home).mass_matrix).diagonal()
        self.implicit: Array = period * self.viscous * _implicit_weight(period * self.viscous * mobility)
        """hθF_v, shape (n,): what viscous friction adds to the diagonal of M [kg·m²]."""
        self._most: Array = -model.least_dry_torque(np.full(n, -1e9))
        self.is_dry = bool(self._most.any())
        """Whether there is any dry friction."""
        self._speeds = np.empty((4, n))

    def expected(self, velocity: Array, damping: Array, response: Array) -> Array:
        """Return s(v) of a joint that nothing else moves: (d − F_v)v, implicit in its own velocity [N·m]."""
        dry = damping - self.viscous
        torque: Array = dry * velocity
        torque /= 1.0 + response.diagonal() * dry
        return torque

    def narrowed(
        self, velocity: Array, expected: Array, response: Array, lowest: Array, highest: Array
    ) -> tuple[Array, Array]:
        """Return the bounds of the next velocity *as predicted with* ``expected`` that keep the true one in its bounds.

        They can be contradictory: the lowest above the highest.

        Args:
            velocity: q̇ [rad/s].
            expected: the dry friction torque that the prediction assumes [N·m].
            response: h(M + hθF_v)⁻¹, shape (n, n).
            lowest: l [rad/s].
            highest: b [rad/s].
        """
        return self._narrowed(velocity, expected, response, lowest, highest, lowest, highest)

    def excess(
        self, velocity: Array, expected: Array, response: Array, lowest: Array, highest: Array, following: Array
    ) -> float:
        """Return by how much the true next velocity may leave its bounds where ``following`` is predicted [rad/s]."""
        spread = np.abs(response).dot(self._most + np.abs(expected))
        reached = following - spread, following + spread
        return kernels.bound_excess(
            following, *self._narrowed(velocity, expected, response, lowest, highest, *reached)
        )

    def _narrowed(
        self,
        velocity: Array,
        expected: Array,
        response: Array,
        lowest: Array,
        highest: Array,
        slowest: Array,
        fastest: Array,
    ) -> tuple[Array, Array]:
        """Return the narrowed bounds, where the next velocities are between ``slowest`` and ``fastest``."""
        speeds = self._speeds
        np.minimum(velocity, highest, out=speeds[0])
        np.minimum(velocity, slowest, out=speeds[1])
        np.maximum(velocity, fastest, out=speeds[2])
        np.maximum(velocity, lowest, out=speeds[3])
        np.negative(speeds[2:], out=speeds[2:])
        least = self._model.least_dry_torque(speeds)
        return kernels.narrowed_bounds(response, expected, least.ravel(), lowest, highest)


class _SampledFriction:
    """A friction that declares nothing but its coefficients, as far as samples of them say."""

    def __init__(self, friction: Friction, velocity_limit: Array) -> None:
        fastest = np.where(np.isfinite(velocity_limit), _FASTEST * velocity_limit, _FAST)
        speeds = np.geomspace(np.full(fastest.size, _SLOWEST), fastest, _SAMPLES)
        speeds = np.concatenate([-speeds, speeds])
        coefficients = np.array([friction.coefficients(speed) for speed in speeds], dtype=float)
        if not (np.isfinite(coefficients).all() and (coefficients >= 0.0).all()):
            raise InvalidArgumentError("friction", "must have finite coefficients >= 0 at every velocity")
        self.viscous: Array = coefficients.min(axis=0)
        self._most: Array = ((coefficients - self.viscous) * np.abs(speeds)).max(axis=0)

    def coefficients(self, velocity: Array) -> Array:
        """Return F_v; no use is made of the others."""
        return np.broadcast_to(self.viscous, velocity.shape)

    def least_dry_torque(self, velocity: Array) -> Array:
        """Return 0 above rest, and minus the largest torque found below it."""
        return np.where(velocity < 0.0, -self._most, 0.0)


def _implicit_weight(decay: Array) -> Array:
    """Return θ(x) = 1/(1 − exp(−x)) − 1/x, with which x(θ) = x/(1 + θx) is 1 − exp(−x); x ≥ 0."""
    x = np.maximum(decay, _NEGLIGIBLE)
    return np.where(decay < _NEGLIGIBLE, 0.5 + decay / 12.0, -1.0 / np.expm1(-x) - 1.0 / x)
