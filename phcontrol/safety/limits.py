"""The limits of an arm, and the velocities from which it can still stop inside them."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array, number
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.safety import kernels
from phcontrol.safety.braking import braking_acceleration_within, braking_jerk_within

_BUILD_UP = (
    0.5  # of the velocity limit may be lost while α builds up, α²/j: more, and building up would need more than j
)
_RETURN_TIME = 0.05  # of a joint that is outside its limits [s]
_RETURN_SPEED = 0.25  # at most this part of the velocity limit


class Limits:
    """Effort, torque rate, velocity and position limits of the joints, and how hard each joint can brake.

    A position limit is kept by a bound w on the next velocity v⁺: with the braking acceleration α the joint must
    still stop in front of the limit,

        q⁺ + w²/(2α) ≤ q_max,   q⁺ = q + ½h(v + w).

    Braking with α keeps the inequality from one period to the next. A limited torque rate cannot turn the acceleration
    a = (v⁺ − v)/h at once: with the jerk j it takes a/j, in which the velocity still grows by a²/(2j). So for the
    velocity limit, and likewise for w, relative to its own rate ẇ ≤ 0,

        v⁺ + (a − ẇ)²/(2j) ≤ w   while a > ẇ,

    which turning with j keeps from one period to the next. Outside the position limits a gentle return is asked for.

    Args:
        system: the model of the arm.
        effort: |u| ≤ effort [N·m]; "robot" for what the robot's description gives.
        torque_rate: |u̇| ≤ torque_rate [N·m/s]; None for no limit.
        velocity: |q̇| ≤ velocity [rad/s].
        lower: of the position [rad].
        upper: of the position [rad].
        position_margin: how far inside the position limits the arm is kept [rad].
        velocity_margin: by what part of themselves the velocity limits are lowered: 0.05 leaves room for what the
            prediction over one period does not see, a bump above all.
        braking_acceleration: α [rad/s²]; by default the largest, in proportions that suit the joints, with which
            all joints can brake at once within 80 % of their effort, at any of 300 random positions and velocities
            inside the limits; less where a limited torque rate builds it up too slowly.
        braking_jerk: j [rad/s³], ∞ without a torque rate; by default the largest, likewise, with which all joints can
            change their accelerations at once within 80 % of the torque rate, while the load changes as it does.
    """

    def __init__(
        self,
        system: MechanicalSystem,
        *,
        effort: Literal["robot"] | ArrayLike = "robot",
        torque_rate: ArrayLike | None = None,
        velocity: Literal["robot"] | ArrayLike = "robot",
        lower: Literal["robot"] | ArrayLike = "robot",
        upper: Literal["robot"] | ArrayLike = "robot",
        position_margin: float = 0.0,
        velocity_margin: float = 0.0,
        braking_acceleration: ArrayLike | None = None,
        braking_jerk: ArrayLike | None = None,
    ) -> None:
        robot, n = system.robot, system.n
        self.effort = _limit("effort", effort, robot.effort_limit, n)
        self.velocity = _limit("velocity", velocity, robot.velocity_limit, n)
        self.velocity = self.velocity * (1.0 - number("velocity_margin", velocity_margin, minimum=0.0, maximum=0.9))
        self.torque_rate = _limit("torque_rate", np.inf if torque_rate is None else torque_rate, robot.effort_limit, n)
        margin = number("position_margin", position_margin, minimum=0.0)
        self.lower = _place("lower", lower, robot.lower, n) + margin
        self.upper = _place("upper", upper, robot.upper, n) - margin
        if (self.lower >= self.upper).any():
            raise InvalidArgumentError("upper", "must be above lower by more than twice the position_margin")
        if braking_acceleration is None:
            self.braking_acceleration = braking_acceleration_within(system, self.effort, self.velocity)
        else:
            self.braking_acceleration = _limit("braking_acceleration", braking_acceleration, robot.effort_limit, n)
            if np.isinf(self.braking_acceleration).any():
                raise InvalidArgumentError("braking_acceleration", "must be finite")
        if braking_jerk is None:
            self.braking_jerk = braking_jerk_within(system, self.torque_rate, self.velocity, self.braking_acceleration)
        else:
            self.braking_jerk = _limit("braking_jerk", braking_jerk, robot.effort_limit, n)
        if braking_acceleration is None:
            gentle = np.sqrt(_BUILD_UP * self.braking_jerk * self.velocity)
            self.braking_acceleration = np.minimum(self.braking_acceleration, gentle)
        self._twice_velocity = np.tile(self.velocity, 2)
        self._return_speed = -np.minimum(_RETURN_SPEED * self._twice_velocity, 0.5)
        self._twice_braking = np.tile(self.braking_acceleration, 2)
        self._twice_jerk = np.tile(self.braking_jerk, 2)
        self._edges = np.concatenate([self.upper, -self.lower])
        for array in vars(self).values():
            array.flags.writeable = False

    def velocity_bounds(self, position: Array, velocity: Array, period: float) -> tuple[Array, Array]:
        """Return the lowest and the highest next velocity, shape (n,) each [rad/s]."""
        return kernels.speed_bounds(
            position,
            velocity,
            period,
            self._edges,
            self._twice_braking,
            self._twice_jerk,
            self._twice_velocity,
            _RETURN_TIME,
            self._return_speed,
        )


def _limit(name: str, value: Literal["robot"] | ArrayLike, of_robot: Array, n: int) -> Array:
    """Return a limit > 0 for each joint; infinity means none."""
    if isinstance(value, str):
        _check_word(name, value)
        return np.array(of_robot)
    array = _broadcast(name, value, n)
    if not (array > 0.0).all():
        raise InvalidArgumentError(name, f"must be > 0 for every joint, but is {array.tolist()}")
    return array


def _place(name: str, value: Literal["robot"] | ArrayLike, of_robot: Array, n: int) -> Array:
    if isinstance(value, str):
        _check_word(name, value)
        return np.array(of_robot)
    return _broadcast(name, value, n)


def _broadcast(name: str, value: ArrayLike, n: int) -> Array:
    """Return a number, or one each joint, infinities allowed."""
    try:
        raw = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidArgumentError(name, f"must be 'robot', a number or one number each joint ({error})") from error
    finite_array(name, np.where(np.isinf(raw), 0.0, raw))
    if raw.shape not in ((), (n,)):
        raise InvalidArgumentError(name, f"must be a number or have shape ({n},), but has shape {raw.shape}")
    return np.array(np.broadcast_to(raw, (n,)))


def _check_word(name: str, value: str) -> None:
    if value != "robot":
        raise InvalidArgumentError(name, f"must be 'robot' or numbers, but is '{value}'")
