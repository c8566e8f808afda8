"""The documented limits of Franka arms."""

from __future__ import annotations

from typing import NamedTuple

from phcontrol._validation import Array
from phcontrol.mechanics.stop_velocity import StopVelocity


class DocumentedLimits(NamedTuple):
    """What a manufacturer documents for its arm, one number each joint, in radians and N·m."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    velocity: tuple[float, ...]
    acceleration: tuple[float, ...]
    effort: tuple[float, ...]
    torque_rate: float
    stop_velocity: StopVelocity | None
    """Velocity limits near the stops."""

    def range_within(self, lower: Array, upper: Array) -> tuple[list[float], list[float]]:
        """Return where the arm may be inside the documented limits, and inside those of a description."""
        near = [0.0] * len(self.lower) if self.stop_velocity is None else self.stop_velocity.no_speed.tolist()
        low = [max(own + gap, given) for own, gap, given in zip(self.lower, near, lower.tolist(), strict=True)]
        high = [min(own - gap, given) for own, gap, given in zip(self.upper, near, upper.tolist(), strict=True)]
        return low, high


_EFFORT = (87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0)

FRANKA_LIMITS = {
    # The torque rates are 1000 N·m/s less libfranka's kLimitEps: at 1000 rounding decides whether the robot stops.
    # libfranka 0.21, include/franka/rate_limiting.h: computeUpperLimitsJointVelocity and its lower twin (position,
    # velocity, and velocity near the stops), kMaxJointAcceleration, kMaxTorqueRate
    "fr3": DocumentedLimits(
        lower=(-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196),
        upper=(2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196),
        velocity=(2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26),
        acceleration=(10.0,) * 7,
        effort=_EFFORT,
        torque_rate=1000.0 - 1e-3,
        stop_velocity=StopVelocity([0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35], [6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0]),
    ),
    # Franka Robotics, "Control Interface Specification and Robot Limits", limits for the Franka Emika Robot (FER)
    "fer": DocumentedLimits(
        lower=(-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
        upper=(2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
        velocity=(2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61),
        acceleration=(15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0),
        effort=_EFFORT,
        torque_rate=1000.0 - 1e-3,
        stop_velocity=None,
    ),
}
