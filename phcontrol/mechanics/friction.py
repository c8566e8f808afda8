"""Joint friction: a diagonal damping matrix D(q̇) = diag(dᵢ(q̇ᵢ)), friction torque D q̇."""

from __future__ import annotations

import math
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array, positive, vector
from phcontrol.exceptions import InvalidArgumentError


class Friction(Protocol):
    """What a system needs of a friction model.

    A :class:`DeclaredFriction` says more, and costs the torque filter less room.
    """

    def coefficients(self, velocity: Array) -> Array:
        """Return dᵢ(q̇ᵢ) ≥ 0, shape (n,) [N·m·s/rad]."""
        ...


@runtime_checkable
class DeclaredFriction(Friction, Protocol):
    """A friction d(w)w = F_v w + s(w) that says what its dry part s, odd and opposed to w, can be.

    Example:
        >>> from phcontrol import DeclaredFriction, StribeckFriction
        >>> isinstance(StribeckFriction(coulomb=0.2), DeclaredFriction)
        True
    """

    viscous: Array
    """F_v, one for all joints or one each [N·m·s/rad]."""

    def dry_torque_range(self, lowest: Array, highest: Array) -> tuple[Array, Array]:
        """Return bounds of sᵢ(w) for all w from lowestᵢ to highestᵢ, shapes (…, n) all four [rad/s, N·m]."""
        ...


class StribeckFriction:
    """Viscous, Coulomb and static friction with the Stribeck effect and a smoothed sign.

        dᵢ(q̇) = (F_c + (F_s − F_c) exp(−|q̇|/q̇_s)) / sqrt(α_f + q̇²) + F_v

    The friction torque is d(q̇)·q̇ (thesis (2.14) and (5.53), corrected: errata E3).

    Args:
        viscous: F_v [N·m·s/rad], one for all joints or one each.
        coulomb: F_c [N·m].
        static: F_s [N·m], not below ``coulomb``; by default equal to it (no Stribeck effect).
        stribeck_velocity: q̇_s [rad/s].
        smoothing: α_f [rad²/s²]; the smaller, the steeper the friction torque around rest.

    Example:
        >>> from phcontrol import MechanicalSystem, StribeckFriction, load_robot
        >>> friction = StribeckFriction(viscous=0.5, coulomb=0.2)  # [N·m·s/rad], [N·m]
        >>> x = MechanicalSystem(load_robot("pera_gripper"), friction=friction).at([0.0], [1.0])
        >>> x.friction_torque.round(3)  # F_v q̇ + F_c [N·m]
        array([0.7])
    """

    def __init__(
        self,
        *,
        viscous: ArrayLike = 0.0,
        coulomb: ArrayLike = 0.0,
        static: ArrayLike | None = None,
        stribeck_velocity: ArrayLike = 0.1,
        smoothing: float = 1e-3,
    ) -> None:
        self.viscous = _not_negative("viscous", viscous)
        self.coulomb = _not_negative("coulomb", coulomb)
        self.static = self.coulomb if static is None else _not_negative("static", static)
        self.stribeck_velocity = finite_array("stribeck_velocity", stribeck_velocity)
        self.smoothing = positive("smoothing", smoothing)
        shapes = {name: getattr(self, name).shape for name in ("viscous", "coulomb", "static", "stribeck_velocity")}
        if len(set(shapes.values()) - {()}) > 1:
            raise InvalidArgumentError("friction", f"needs numbers, or vectors of one length, but has shapes {shapes}")
        if (self.static < self.coulomb).any():
            raise InvalidArgumentError("static", "must not be below coulomb")
        if (self.stribeck_velocity <= 0.0).any():
            raise InvalidArgumentError("stribeck_velocity", "must be > 0")
        self._excess = self.static - self.coulomb
        with np.errstate(over="ignore"):
            steepest = self.static / math.sqrt(self.smoothing)
        if not np.isfinite(steepest).all():
            raise InvalidArgumentError(
                "smoothing", f"{smoothing:g} is too small for a static friction of {self.static}"
            )
        self._has_stribeck = bool(self._excess.any())
        self._is_viscous = not (self.coulomb.any() or self._has_stribeck)
        self._smoothing_velocity = math.sqrt(self.smoothing)
        self._negative_rate = -1.0 / self.stribeck_velocity

    def coefficients(self, velocity: Array) -> Array:
        """Return dᵢ(q̇ᵢ), shape (n,) [N·m·s/rad]."""
        if self._is_viscous:
            return self.viscous if self.viscous.ndim else np.broadcast_to(self.viscous, velocity.shape)
        dry = self.coulomb
        if self._has_stribeck:
            dry = dry + self._excess * np.exp(np.abs(velocity) * self._negative_rate)
        coefficients: Array = np.hypot(velocity, self._smoothing_velocity)
        np.divide(dry, coefficients, coefficients)
        coefficients += self.viscous
        return coefficients

    def dry_torque_range(self, lowest: Array, highest: Array) -> tuple[Array, Array]:
        """Return bounds of (d(w) − F_v)w for all w from ``lowest`` to ``highest``, shapes (…, n) all four [N·m].

        Of the two factors w / sqrt(α_f + w²), which rises with w, and F_c + (F_s − F_c) exp(−|w|/q̇_s), which falls
        with |w|, each is bounded by itself: exact without a Stribeck effect.
        """
        least: Array = lowest / np.hypot(lowest, self._smoothing_velocity)
        most: Array = highest / np.hypot(highest, self._smoothing_velocity)
        if not self._has_stribeck:
            return self.coulomb * least, self.coulomb * most
        slowest = np.maximum(np.maximum(lowest, -highest), 0.0)
        at_least = np.where(lowest > 0.0, highest, slowest)
        at_most = np.where(highest < 0.0, -lowest, slowest)
        least *= self.coulomb + self._excess * np.exp(at_least * self._negative_rate)
        most *= self.coulomb + self._excess * np.exp(at_most * self._negative_rate)
        return least, most

    def scaled(self, factor: float) -> StribeckFriction:
        """Return this friction with all its torques times ``factor``: a model that is wrong by that much."""
        return StribeckFriction(
            viscous=factor * self.viscous,
            coulomb=factor * self.coulomb,
            static=factor * self.static,
            stribeck_velocity=self.stribeck_velocity,
            smoothing=self.smoothing,
        )


def _not_negative(name: str, value: ArrayLike) -> Array:
    array = finite_array(name, value)
    if array.ndim > 1:
        raise InvalidArgumentError(name, f"must be a scalar or a vector, but has shape {array.shape}")
    if (array < 0.0).any():
        raise InvalidArgumentError(name, f"must be >= 0, but is {array}")
    return array


def check_size(friction: StribeckFriction, size: int) -> None:
    """Raise InvalidArgumentError unless every parameter is a scalar or has one entry a joint."""
    for name in ("viscous", "coulomb", "static", "stribeck_velocity"):
        value = getattr(friction, name)
        if value.ndim:
            vector(f"friction.{name}", value, size)
