"""The limits of an arm, and the velocities from which it can still stop inside them."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, choice, finite_array, number
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.stop_velocity import StopVelocity
from phcontrol.mechanics.system import MechanicalSystem, check_system
from phcontrol.safety import kernels
from phcontrol.safety.braking import braking_acceleration_within, braking_jerk_within
from phcontrol.safety.franka_limits import FRANKA_LIMITS

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

    A robot whose velocity limits fall towards its stops (:class:`StopVelocity`, offset o and deceleration a) gets

        q⁺ + ((w + o)² − o²)/(2α) ≤ q_max − o²/(2a)

    in place of the first, with a for α where that is less, and o in the same proportion where α is less: a curve below
    the robot's, that α can follow. Where the robot allows no speed towards a stop counts as outside.

    Args:
        system: the model of the arm.
        effort: |u| ≤ effort [N·m]; "robot" for what the robot's description gives.
        torque_rate: |u̇| ≤ torque_rate [N·m/s]; None for no limit.
        velocity: |q̇| ≤ velocity [rad/s].
        lower: of the position [rad].
        upper: of the position [rad].
        stop_velocity: of the velocity near the stops; "robot" for what the robot's description gives, None for no
            such limit.
        position_margin: how far inside the position limits the arm is kept [rad].
        velocity_margin: by what part of themselves the velocity limits are lowered: 0.05 leaves room for what the
            prediction over one period does not see, a bump above all. Those near the stops too.
        acceleration: α is at most this, where one is documented [rad/s²].
        braking_acceleration: α [rad/s²]; by default the largest, in proportions that suit the joints, with which
            all joints can brake at once within 80 % of their effort, at any of 300 random positions and velocities
            inside the limits; less where a limited torque rate builds it up too slowly.
        braking_jerk: j [rad/s³], ∞ without a torque rate; by default the largest, likewise, with which all joints can
            change their accelerations at once within 80 % of the torque rate, while the load changes as it does.

    Example:
        >>> import numpy as np
        >>> from phcontrol import Limits, MechanicalSystem, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> limits = Limits(system, position_margin=0.01, velocity_margin=0.1)  # [rad], a tenth
        >>> np.allclose(limits.velocity, 0.9 * system.robot.velocity_limit)
        True
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
        stop_velocity: Literal["robot"] | StopVelocity | None = "robot",
        position_margin: float = 0.0,
        velocity_margin: float = 0.0,
        acceleration: ArrayLike | None = None,
        braking_acceleration: ArrayLike | None = None,
        braking_jerk: ArrayLike | None = None,
    ) -> None:
        check_system(system)
        robot, n = system.robot, system.n
        self.effort = _limit("effort", effort, robot.effort_limit, n)
        self.velocity = _limit("velocity", velocity, robot.velocity_limit, n)
        slower = 1.0 - number("velocity_margin", velocity_margin, minimum=0.0, maximum=0.9)
        self.velocity = self.velocity * slower
        self.torque_rate = _limit("torque_rate", np.inf if torque_rate is None else torque_rate, robot.effort_limit, n)
        margin = number("position_margin", position_margin, minimum=0.0)
        near = _stop_velocity(stop_velocity, system)
        has_curve = np.isfinite(near.deceleration)  # whose stops are the robot's, wherever the limits are
        lowest = np.where(has_curve, robot.lower + near.no_speed, -np.inf)
        highest = np.where(has_curve, robot.upper - near.no_speed, np.inf)
        self.lower = np.maximum(_place("lower", lower, robot.lower, n), lowest) + margin
        self.upper = np.minimum(_place("upper", upper, robot.upper, n), highest) - margin
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
        if acceleration is not None:
            most = _limit("acceleration", acceleration, robot.effort_limit, n)
            self.braking_acceleration = np.minimum(self.braking_acceleration, most)
        # below the robot's curve by the margin, and with the same slope at its end where braking is the weaker
        curve = slower * slower * near.deceleration
        stopping = np.minimum(self.braking_acceleration, curve)
        self._twice_offset = np.tile(slower * near.offset * (stopping / curve), 2)
        self._twice_velocity = np.tile(self.velocity, 2)
        self._return_speed = -np.minimum(_RETURN_SPEED * self._twice_velocity, 0.5)
        self._twice_braking = np.tile(stopping, 2)
        self._twice_jerk = np.tile(self.braking_jerk, 2)
        self._edges = np.concatenate([self.upper, -self.lower])
        for array in vars(self).values():
            array.flags.writeable = False

    @classmethod
    def franka(
        cls,
        system: MechanicalSystem,
        model: Literal["fr3", "fer"] = "fr3",
        *,
        position_margin: float = 0.01,
        velocity_margin: float = 0.1,
    ) -> Limits:
        """Return the documented limits of a Franka arm: torque, its rate (1000 N·m/s), velocity, acceleration.

        Where the arm's description has narrower limits of position, effort or velocity these hold, and where it has
        velocity limits near the stops, these and the stops they belong to: they are the robot's own.

        Args:
            system: the model of the arm; the seven joints must be in the robot's order.
            model: "fr3" for a Franka Research 3, "fer" for a Franka Emika Robot (Panda).
            position_margin: as above [rad].
            velocity_margin: as above; on top of what is documented.

        The numbers are from libfranka 0.21 (``rate_limiting.h``) and Franka's "Robot Limits".
        """
        check_system(system)
        robot = system.robot
        documented = FRANKA_LIMITS[choice("model", model, FRANKA_LIMITS)]
        if system.n != len(documented.effort):
            message = f"must be an arm of 7 joints, but {robot.name} has {system.n}; lock the others (locked_joints)"
            raise InvalidArgumentError("system", message)
        near, (lower, upper) = robot.stop_velocity, (robot.lower.tolist(), robot.upper.tolist())
        if near is None:
            near, (lower, upper) = documented.stop_velocity, documented.range_within(robot.lower, robot.upper)
        return cls(
            system,
            effort=np.minimum(documented.effort, robot.effort_limit),
            torque_rate=documented.torque_rate,
            velocity=np.minimum(documented.velocity, robot.velocity_limit),
            lower=lower,
            upper=upper,
            stop_velocity=near,
            position_margin=position_margin,
            velocity_margin=velocity_margin,
            acceleration=documented.acceleration,
        )

    def velocity_bounds(self, position: Array, velocity: Array, period: float) -> tuple[Array, Array]:
        """Return the lowest and the highest next velocity, shape (n,) each [rad/s]."""
        return kernels.speed_bounds(
            position,
            velocity,
            period,
            self._edges,
            self._twice_braking,
            self._twice_offset,
            self._twice_jerk,
            self._twice_velocity,
            _RETURN_TIME,
            self._return_speed,
        )


def _stop_velocity(value: Literal["robot"] | StopVelocity | None, system: MechanicalSystem) -> StopVelocity:
    """Return the limits near the stops for each joint; those of a joint without one do not bind."""
    if isinstance(value, str):
        _check_word("stop_velocity", value)
        value = system.robot.stop_velocity
    if value is None:
        value = StopVelocity(0.0, np.inf)
    if not isinstance(value, StopVelocity):
        raise InvalidArgumentError("stop_velocity", f"must be 'robot', a StopVelocity or None, but is {value!r}")
    if value.offset.size not in (1, system.n):
        raise InvalidArgumentError("stop_velocity", f"must be for {system.n} joints, but is for {value.offset.size}")
    return StopVelocity(np.broadcast_to(value.offset, system.n), np.broadcast_to(value.deceleration, system.n))


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
