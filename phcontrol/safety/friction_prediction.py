"""What friction may do to the next velocity: viscous friction is predicted, dry friction is bounded."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.friction import DeclaredFriction, Friction
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.safety import kernels

ROOM = 1e-3
"""By how much a joint may leave its bounds without passing through other velocities than expected [rad/s]."""

_SLOWEST = 1e-6  # speed at which a friction is sampled [rad/s]
_FASTEST = 2.0  # likewise, in velocity limits
_FAST = 100.0  # likewise, for a joint without one [rad/s]
_SAMPLES = 400  # of each sign
_ANY_SPEED = 1e9  # [rad/s]
_ROOMS = (2.0, 8.0, np.inf)  # for joints that leave their bounds, in what they seem to leave them by
_NEGLIGIBLE = 1e-3  # of a period's decay, below which its series is used


class FrictionPrediction:
    """Viscous and dry friction, F_v w + s(w) at a velocity w, in the prediction of the velocity v⁺ after a period h.

    **Viscous**: implicit, with a weight θ that makes the prediction exact for a single joint (1/2 for a weak damping,
    1 for a stiff one):

        v⁺ = q̇ + h(M + hθF_v)⁻¹(f − F_v q̇ − s),   θ = 1/(1 − exp(−x)) − 1/x,   x = hF_v(M⁻¹)_jj at home.

    What the inertia couples in it leaves out: the prediction misses up to 5.4 % of a period's change of velocity where
    viscous friction is stiff (xarm7 with F_v = 10 N·m·s/rad, an armature of 0.01 kg·m² and h = 2 ms), 1.6 % at 1 ms,
    and 0.1 % with the friction of the other arms.

    **Dry**: in one period a joint can pass through many velocities, and s can turn from one end to the other in a
    hundredth of it, so of its mean only an interval is known: what s is at the velocities from q̇_j to anywhere inside
    the bounds of the next one. All of it counts at the other joints, where it acts through (M + hθF_v)⁻¹ with either
    sign. A joint's own friction cannot push it where it does not go: on the way to a bound it is what s is from q̇_i to
    that bound, of which the least counts for the upper bound and the most for the lower.

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
        model = friction if isinstance(friction, DeclaredFriction) else _SampledFriction(friction, velocity_limit)
        self._model: DeclaredFriction = model
        self.viscous: Array = np.array(np.broadcast_to(model.viscous, n), dtype=float)
        """F_v, shape (n,) [N·m·s/rad]."""
        mobility = np.linalg.inv(system.at(system.robot.home).mass_matrix).diagonal()
        self.implicit: Array = period * self.viscous * _implicit_weight(period * self.viscous * mobility)
        """hθF_v, shape (n,): what viscous friction adds to the diagonal of M [kg·m²]."""
        self._most: Array = model.dry_torque_range(np.full(n, -_ANY_SPEED), np.full(n, _ANY_SPEED))[1]
        self.is_dry = bool(self._most.any())
        """Whether there is any dry friction."""
        self._slow, self._fast = np.empty((3, n)), np.empty((3, n))  # towards the upper bound, the lower, anywhere

    def expected(self, velocity: Array, damping: Array, response: Array) -> Array:
        """Return s(v) of a joint that nothing else moves: (d − F_v)v, implicit in its own velocity [N·m]."""
        return kernels.expected_friction(velocity, damping, self.viscous, response)

    def narrowed(
        self, velocity: Array, expected: Array, response: Array, lowest: Array, highest: Array, room: float = ROOM
    ) -> tuple[Array, Array, bool]:
        """Return the bounds of the next velocity *as predicted with* ``expected`` that keep the true one in its bounds.

        Also return whether they are contradictory for some joint: the lowest above the highest.

        Args:
            velocity: q̇ [rad/s].
            expected: the dry friction torque that the prediction assumes [N·m].
            response: h(M + hθF_v)⁻¹, shape (n, n).
            lowest: l [rad/s].
            highest: b [rad/s].
            room: by how much the next velocities may be outside l and b [rad/s].
        """
        kernels.passed_velocities(velocity, lowest, highest, room, self._slow.ravel(), self._fast.ravel())
        least, most = self._model.dry_torque_range(self._slow, self._fast)
        return kernels.narrowed_bounds(response, expected, least.ravel(), most.ravel(), lowest, highest)

    def excess(
        self,
        velocity: Array,
        expected: Array,
        response: Array,
        lowest: Array,
        highest: Array,
        following: Array,
        first: float,
    ) -> float:
        """Return by how much the true next velocity may leave its bounds where ``following`` is predicted [rad/s].

        ``first`` is by how much ``following`` leaves the narrowed bounds, which hold as far as no joint leaves its own
        by more than ``ROOM``. For more than that the room grows until what friction may do with it stays inside.
        """
        room, found = ROOM, first
        for factor in _ROOMS:
            if found <= room:
                break
            room = factor * first
            narrow_low, narrow_high, _ = self.narrowed(velocity, expected, response, lowest, highest, room)
            found = kernels.bound_excess(following, narrow_low, narrow_high)
        return found


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

    def dry_torque_range(self, lowest: Array, highest: Array) -> tuple[Array, Array]:
        """Return from 0 to the largest torque found, against the motion."""
        return np.where(lowest < 0.0, -self._most, 0.0), np.where(highest > 0.0, self._most, 0.0)


def _implicit_weight(decay: Array) -> Array:
    """Return θ(x) = 1/(1 − exp(−x)) − 1/x, with which x(θ) = x/(1 + θx) is 1 − exp(−x); x ≥ 0."""
    x = np.maximum(decay, _NEGLIGIBLE)
    return np.where(decay < _NEGLIGIBLE, 0.5 + decay / 12.0, -1.0 / np.expm1(-x) - 1.0 / x)
