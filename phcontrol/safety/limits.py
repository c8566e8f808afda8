"""The limits of an arm, and the velocities from which it can still stop inside them."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array, number
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.safety import kernels

_SAMPLES = 300  # of the configurations and velocities that the braking acceleration is good for
_RESERVE = 0.8  # of the effort that braking may take
_SHORTEST_STOP = 0.1  # from full speed [s]: braking faster than that gains nothing and costs the other joints
_RETURN_TIME = 0.05  # of a joint that is outside its limits [s]
_RETURN_SPEED = 0.25  # at most this part of the velocity limit


class Limits:
    """Effort, torque rate, velocity and position limits of the joints, and how hard each joint can brake.

    A position limit is kept by a bound on the next velocity v⁺: with the braking acceleration α the joint must
    still stop in front of the limit,

        q⁺ + τv⁺ + v⁺²/(2α) ≤ q_max,   q⁺ = q + ½h(v + v⁺),

    τ being the time in which a limited torque rate can turn the torque round (0 without such a limit). Braking with
    α keeps the inequality from one period to the next. Outside the limits the bound asks for a gentle return.

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
            inside the limits.
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
        with np.errstate(invalid="ignore"):
            turning = 2.0 * self.effort / self.torque_rate
        self.reaction_time: Array = np.where(np.isinf(self.torque_rate), 0.0, turning)
        if np.isinf(self.reaction_time).any():
            raise InvalidArgumentError("torque_rate", "needs an effort limit for the same joint")
        self._twice_velocity = np.tile(self.velocity, 2)
        self._return_speed = -np.minimum(_RETURN_SPEED * self._twice_velocity, 0.5)
        self._twice_braking = np.tile(self.braking_acceleration, 2)
        self._twice_reaction = np.tile(self.reaction_time, 2)
        self._edges = np.concatenate([self.upper, -self.lower])
        for array in vars(self).values():
            array.flags.writeable = False
        self._period, self._lag = 0.0, self._twice_reaction

    def velocity_bounds(self, position: Array, velocity: Array, period: float) -> tuple[Array, Array]:
        """Return the lowest and the highest next velocity, shape (n,) each [rad/s]."""
        if period != self._period:
            self._period, self._lag = period, (self._twice_reaction + 0.5 * period) * self._twice_braking
        return kernels.speed_bounds(
            position,
            velocity,
            period,
            self._edges,
            self._twice_braking,
            self._lag,
            self._twice_velocity,
            _RETURN_TIME,
            self._return_speed,
        )


def braking_acceleration_within(system: MechanicalSystem, effort: Array, velocity: Array) -> Array:
    """Return α, shape (n,) [rad/s²]: all joints can brake with it at once, in any directions, within the effort.

    Braking takes |G⁻¹(M a + C q̇ + ∂V/∂q)| ≤ |G⁻¹M|α + |G⁻¹(C q̇ + ∂V/∂q)| of the motors. Friction, which helps, is not
    counted. Joints without an effort limit stop from full speed in 0.1 s.

    Raises InvalidArgumentError when the motors cannot even hold the arm somewhere.
    """
    fastest = np.where(np.isinf(velocity), 1.0, velocity)
    swing = np.where(np.isinf(velocity), 0.0, velocity)
    generator, n = np.random.default_rng(0), system.n
    levers, reserves = np.zeros((_SAMPLES, n, n)), np.zeros((_SAMPLES, n))
    inverse = np.eye(n) if system.input_matrix is None else np.linalg.inv(system.input_matrix)
    for sample in range(_SAMPLES):
        x = system.at(system.robot.random_position(generator), generator.uniform(-1.0, 1.0, n) * swing)
        levers[sample] = np.abs(inverse @ x.mass_matrix)
        load = inverse @ (x.coriolis_matrix @ x.velocity + x.potential_gradient)
        reserves[sample] = _RESERVE * (effort - np.abs(load))
    scarce = reserves.min(axis=0)
    if (scarce <= 0.0).any():
        joint = system.robot.joint_names[int(np.argmin(scarce))]
        raise InvalidArgumentError(
            "effort",
            f"{effort.tolist()} N·m cannot hold the arm everywhere (joint '{joint}' lacks some); give higher limits, "
            "or the braking_acceleration that it has where you use it",
        )
    proportions = np.minimum(scarce / levers.diagonal(axis1=1, axis2=2).max(axis=0), fastest / _SHORTEST_STOP)
    result: Array = proportions * min(1.0, float((reserves / (levers @ proportions)).min()))
    return result


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
