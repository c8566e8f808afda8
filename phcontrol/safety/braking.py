"""How hard all joints of an arm can brake at once, and how fast they can begin to."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.system import MechanicalSystem

_SAMPLES = 300  # of the configurations and velocities that the results are good for
_RESERVE = 0.8  # of the effort, and of the torque rate, that braking may take
_SHORTEST_STOP = 0.1  # from full speed [s]: braking faster than that gains nothing and costs the other joints
_STEP = 1e-5  # for the rate of the load [s]


def braking_acceleration_within(system: MechanicalSystem, effort: Array, velocity: Array) -> Array:
    """Return α, shape (n,) [rad/s²]: all joints can brake with it at once, in any directions, within the effort.

    Braking takes |G⁻¹(M a + C q̇ + ∂V/∂q)| ≤ |G⁻¹M|α + |G⁻¹(C q̇ + ∂V/∂q)| of the motors. Friction, which helps, is not
    counted. Joints without an effort limit stop from full speed in 0.1 s.

    Raises InvalidArgumentError when the motors cannot even hold the arm somewhere.
    """
    levers, loads = np.zeros((_SAMPLES, system.n, system.n)), np.zeros((_SAMPLES, system.n))
    inverse = _inverse_input(system)
    for sample, (position, speed) in enumerate(_samples(system, velocity)):
        x = system.at(position, speed)
        levers[sample] = np.abs(inverse @ x.mass_matrix)
        loads[sample] = np.abs(inverse @ (x.coriolis_matrix @ x.velocity + x.potential_gradient))
    reserves = _RESERVE * (effort - loads)
    scarce = reserves.min(axis=0)
    if (scarce <= 0.0).any():
        joint = system.robot.joint_names[int(np.argmin(scarce))]
        raise InvalidArgumentError(
            "effort",
            f"{effort.tolist()} N·m cannot hold the arm everywhere (joint '{joint}' lacks some); give higher limits, "
            "or the braking_acceleration that it has where you use it",
        )
    fastest = np.where(np.isinf(velocity), 1.0, velocity)
    return _within(levers, reserves, fastest / _SHORTEST_STOP)


def braking_jerk_within(system: MechanicalSystem, torque_rate: Array, velocity: Array, acceleration: Array) -> Array:
    """Return j, shape (n,) [rad/s³]: all accelerations can be turned with it at once within the torque rate.

    That takes |G⁻¹(M ȧ + d/dt(M a + C q̇ + ∂V/∂q)|ₐ)| ≤ |G⁻¹M|j + the rate of the load at accelerations up to α.
    Joints without a limit of the torque rate have j = ∞.

    Raises InvalidArgumentError when the load alone changes faster somewhere.
    """
    limited = np.isfinite(torque_rate)
    if not limited.any():
        return np.full(system.n, np.inf)
    levers, rates = np.zeros((_SAMPLES, system.n, system.n)), np.zeros((_SAMPLES, system.n))
    inverse = _inverse_input(system)
    for sample, (position, speed) in enumerate(_samples(system, velocity)):
        a = np.random.default_rng(sample).uniform(-1.0, 1.0, system.n) * acceleration
        levers[sample] = np.abs(inverse @ system.at(position).mass_matrix)
        rates[sample] = np.abs(inverse @ _load_rate(system, position, speed, a))
    reserves = (_RESERVE * torque_rate - rates)[:, limited]
    scarce = reserves.min(axis=0)
    if (scarce <= 0.0).any():
        joint = int(np.flatnonzero(limited)[np.argmin(scarce)])
        raise InvalidArgumentError(
            "torque_rate",
            f"{torque_rate.tolist()} N·m/s is too little to follow the load at full speed: joint "
            f"'{system.robot.joint_names[joint]}' needs more than {rates[:, joint].max() / _RESERVE:.3g} N·m/s; give "
            "higher rates, lower velocity limits, or the braking_jerk that it has where you use it",
        )
    result = np.full(system.n, np.inf)
    result[limited] = _within(levers[:, limited][:, :, limited], reserves, np.full(limited.sum(), np.inf))
    return result


def _load_rate(system: MechanicalSystem, position: Array, speed: Array, acceleration: Array) -> Array:
    """Return d/dt(M a + C q̇ + ∂V/∂q) along the motion with a constant acceleration a, shape (n,) [N·m/s]."""

    def load(time: float) -> Array:
        moved = position + time * speed + 0.5 * time * time * acceleration
        x = system.at(moved, speed + time * acceleration)
        torque: Array = x.mass_matrix @ acceleration + x.coriolis_matrix @ x.velocity + x.potential_gradient
        return torque

    return (load(_STEP) - load(-_STEP)) / (2.0 * _STEP)


def _samples(system: MechanicalSystem, velocity: Array) -> list[tuple[Array, Array]]:
    """Return positions, and velocities inside the limits."""
    generator, n = np.random.default_rng(0), system.n
    swing = np.where(np.isinf(velocity), 0.0, velocity)
    return [(system.robot.random_position(generator), generator.uniform(-1.0, 1.0, n) * swing) for _ in range(_SAMPLES)]


def _inverse_input(system: MechanicalSystem) -> Array:
    """Return G⁻¹."""
    matrix = system.input_matrix
    inverse: Array = np.eye(system.n) if matrix is None else np.asarray(np.linalg.inv(matrix), dtype=float)
    return inverse


def _within(levers: Array, reserves: Array, most: Array) -> Array:
    """Return the largest x, in proportions that suit the joints, with levers·x ≤ reserves in all samples, x ≤ most."""
    proportions = np.minimum(reserves.min(axis=0) / levers.diagonal(axis1=1, axis2=2).max(axis=0), most)
    result: Array = proportions * min(1.0, float((reserves / (levers @ proportions)).min()))
    return result
