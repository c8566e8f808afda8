"""Velocity limits that fall towards the stops of a joint, as a Franka robot's firmware keeps them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array
from phcontrol.exceptions import InvalidArgumentError


@dataclass(frozen=True, eq=False)
class StopVelocity:
    """How fast joints may go towards their stops q_max and q_min, whatever their velocity limits are.

        q̇ ≤ max(0, −o + √(2a(q_max − q)))     q̇ ≥ min(0, o − √(2a(q − q_min)))

    That is what ``<position_based_velocity_limits velocity_offset="o" deceleration_limit="a"/>`` of a URDF says, with
    q_max and q_min of the joint's ``<limit>`` (libfranka 0.21, ``joint_velocity_limits.cpp``; libfranka's
    ``rate_limiting.h`` has the same with numbers). Within o²/(2a) of a stop no speed towards it is allowed at all.

    Args:
        offset: o ≥ 0, one or one each joint [rad/s]; [m/s] of a prismatic joint.
        deceleration: a > 0 likewise [rad/s²]; ∞ where a joint has no such limit.

    >>> import numpy as np
    >>> from phcontrol import StopVelocity
    >>> limit = StopVelocity(offset=0.3, deceleration=6.0)
    >>> limit.upper(np.array([2.7501 - 0.5]), np.array([2.7501]))  # half a radian in front of the stop
    array([2.14948974])
    """

    offset: Array
    deceleration: Array

    def __init__(self, offset: ArrayLike, deceleration: ArrayLike) -> None:
        try:
            o, a = np.broadcast_arrays(np.array(offset, dtype=float), np.array(deceleration, dtype=float))
        except (TypeError, ValueError, OverflowError) as error:
            raise InvalidArgumentError(
                "offset", f"must be one number or one each joint, and deceleration too ({error})"
            ) from error
        o, a = np.atleast_1d(o).copy(), np.atleast_1d(a).copy()
        if o.ndim != 1 or not (np.isfinite(o) & (o >= 0.0)).all():
            raise InvalidArgumentError("offset", f"must be finite and >= 0 for every joint, but is {o.tolist()}")
        if not (a > 0.0).all():
            raise InvalidArgumentError("deceleration", f"must be > 0 for every joint, but is {a.tolist()}")
        o.flags.writeable = a.flags.writeable = False
        object.__setattr__(self, "offset", o)
        object.__setattr__(self, "deceleration", a)

    @property
    def no_speed(self) -> Array:
        """How near a stop no speed towards it is allowed: o²/(2a), shape (n,) [rad]."""
        near: Array = 0.5 * self.offset * self.offset / self.deceleration
        return near

    def upper(self, position: Array, stop: Array) -> Array:
        """Return the highest velocity at a position with the stop q_max, shape (n,) each [rad/s]."""
        return self._towards(stop - position)

    def lower(self, position: Array, stop: Array) -> Array:
        """Return the lowest velocity at a position with the stop q_min, shape (n,) each [rad/s]."""
        return -self._towards(position - stop)

    def _towards(self, way: Array) -> Array:
        limited = np.isfinite(self.deceleration)
        room = np.maximum(np.where(limited, way, 0.0), 0.0)
        speed = np.maximum(0.0, np.sqrt(2.0 * np.where(limited, self.deceleration, 0.0) * room) - self.offset)
        result: Array = np.where(limited, speed, np.inf)
        return result
