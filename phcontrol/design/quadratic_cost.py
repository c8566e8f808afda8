"""Squares of errors, velocities and torques, as what is made small."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array, per_joint
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.simulation.log import Log
from phcontrol.simulation.log_slopes import LogSlopes


class QuadraticCost:
    """The mean over a run's samples of Σᵢ w_q (q − q_d)ᵢ² + w_v q̇ᵢ² + w_u uᵢ², and w_e Σᵢ (q − q_d)ᵢ² at its end.

    It says its derivative, so that :func:`tune` goes down its gradient. Errors are differences of the joint angles as
    they are logged: in a continuous joint, give the goal on the same turn.

    Args:
        goal: q_d, shape (n,) [rad].
        position: w_q, for all joints or one each [1/rad²].
        velocity: w_v, likewise [s²/rad²].
        torque: w_u, likewise [1/(N·m)²].
        end: w_e, likewise [1/rad²].

    Raises:
        InvalidArgumentError: a weight is negative, or all are 0.

    Example:
        >>> from phcontrol import MechanicalSystem, QuadraticCost, load_robot, make_controller, simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> cost = QuadraticCost(system.robot.near_home(), velocity=0.1)
        >>> log = simulate(system, make_controller("energy_shaping", system), duration=0.1, dt=1e-2)
        >>> cost(log) > 0.0, cost.slopes(log).velocity.shape
        (True, (11, 2))
    """

    def __init__(
        self,
        goal: ArrayLike,
        *,
        position: ArrayLike = 1.0,
        velocity: ArrayLike = 0.0,
        torque: ArrayLike = 0.0,
        end: ArrayLike = 0.0,
    ) -> None:
        self.goal = finite_array("goal", goal)
        if self.goal.ndim != 1:
            raise InvalidArgumentError("goal", f"must have shape (n,), but has shape {self.goal.shape}")
        given = {"position": position, "velocity": velocity, "torque": torque, "end": end}
        weights = {name: per_joint(name, value, self.goal.size) for name, value in given.items()}
        for name, weight in weights.items():
            if (weight < 0.0).any():
                raise InvalidArgumentError(name, f"must be >= 0, but its smallest entry is {weight.min():g}")
        if not any(weight.any() for weight in weights.values()):
            raise InvalidArgumentError("position", "velocity, torque and end are all 0: nothing would be made small")
        self.position, self.velocity, self.torque, self.end = weights.values()

    def __call__(self, log: Log) -> float:
        """Return the cost of a run."""
        error = self._error(log)
        mean = (self.position * error**2 + self.velocity * log.velocity**2 + self.torque * log.torque**2).sum()
        return float(mean / len(log) + self.end @ error[-1] ** 2)

    def slopes(self, log: Log) -> LogSlopes:
        """Return how it changes with each sample."""
        error, share = self._error(log), 2.0 / len(log)
        position = share * self.position * error
        position[-1] += 2.0 * self.end * error[-1]
        return LogSlopes(position, share * self.velocity * log.velocity, share * self.torque * log.torque)

    def _error(self, log: Log) -> Array:
        if log.position.shape[1] != self.goal.size:
            raise InvalidArgumentError("goal", f"has {self.goal.size} entries, the arm {log.position.shape[1]} joints")
        error: Array = np.asarray(log.position - self.goal)
        return error
