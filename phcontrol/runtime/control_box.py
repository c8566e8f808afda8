"""A stand-in for the control box of an arm: the plant, its motors, and a watchdog of its own."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, choice, per_joint, positive, real_array, vector
from phcontrol.environments.disturbances import Disturbance
from phcontrol.mechanics.system import MechanicalSystem, check_system
from phcontrol.runtime.arm_driver import Reading
from phcontrol.runtime.control_loop import GRAVITY, Gravity
from phcontrol.runtime.number_window import NumberWindow
from phcontrol.safety.clipping import clipped
from phcontrol.sensors.measured import Measured
from phcontrol.simulation.integrators import runge_kutta_step


class ControlBox:
    """An arm as its manufacturer hands it over: torques in, readings out, every ``period``.

    The last torque is held, clipped to the effort limits; with ``gravity="robot"`` the box adds the arm's weight to
    it. When no newer one came for ``patience``, the box brakes by
    itself: gravity is compensated, motion is damped. Commands carry a number; one that is not newer than the last
    (late, duplicated, out of order), too far ahead of it (:class:`NumberWindow`), has another length, or is not finite,
    is not used.

    Args:
        system: the plant.
        period: time step [s]; the plant is integrated with RK4 in it.
        position: at the start [rad]; by default home.
        patience: [s].
        damping: of its own braking [N·m·s/rad]; by default what stops M(home)'s diagonal in 0.05 s.
        disturbance: f_e, a function of time and state, or None.
        gravity: "controller" for motors that do what they are sent, "robot" for a box that adds G⁻¹g(q) itself.

    Example:
        >>> import numpy as np
        >>> from phcontrol import ControlBox, MechanicalSystem, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> box = ControlBox(system, period=1e-3)
        >>> box.command(1, system.at(system.robot.home).potential_gradient)  # [N·m]: its weight
        True
        >>> box.advance()
        >>> bool(np.abs(box.reading().velocity).max() < 1e-9), box.time
        (True, 0.001)
    """

    def __init__(
        self,
        system: MechanicalSystem,
        *,
        period: float = 1e-3,
        position: ArrayLike | None = None,
        patience: float = 0.02,
        damping: ArrayLike | None = None,
        disturbance: Disturbance | None = None,
        gravity: Gravity = "controller",
    ) -> None:
        check_system(system)
        self.system, self.period = system, positive("period", period)
        self.patience = positive("patience", patience)
        start = system.robot.home if position is None else position
        self._state: Array = np.concatenate([vector("position", start, system.n), np.zeros(system.n)])
        inertia = system.at(system.robot.home).mass_matrix.diagonal() / 0.05
        self._damping: Array = inertia if damping is None else per_joint("damping", damping, system.n)
        self._disturbance = disturbance
        chosen: Any = choice("gravity", gravity, GRAVITY)
        self.gravity: Gravity = chosen
        self._torque: Array = np.zeros(system.n)
        self._silence, self._steps = np.inf, 0
        self._window, self._accepted_at = NumberWindow(), 0
        self.counts = {"accepted": 0, "refused": 0, "braking": 0}
        """Commands accepted and refused, and steps of braking."""

    @property
    def time(self) -> float:
        """The box's time [s]."""
        return self._steps * self.period

    def command(self, number: int, torque: Array) -> bool:
        """Take a torque over unless it is old or makes no sense; return whether it was."""
        finite = real_array(torque, (self.system.n,))
        if finite is None or not self._window.accepts(number, self._steps - self._accepted_at):
            self.counts["refused"] += 1
            return False
        limit = self.system.robot.effort_limit
        self._torque = clipped(finite, -limit, limit)
        self._accepted_at, self._silence = self._steps, 0.0
        self.counts["accepted"] += 1
        return True

    def advance(self) -> None:
        """Let one period pass."""
        y, h, t = self._state, self.period, self.time
        self._silence += h
        braking = self._silence > self.patience
        self.counts["braking"] += braking
        self._state = runge_kutta_step(lambda t, y: self._rate(t, y, braking), t, y, h, self._rate(t, y, braking))
        self._steps += 1

    def reading(self) -> Reading:
        """Return what the sensors show now: position, velocity and the external force."""
        n = self.system.n
        force = np.zeros(n)
        if self._disturbance is not None:
            force = self._disturbance(self.time, self.system.at(self._state[:n], self._state[n:]))
        return Reading(self._state[:n].copy(), self._state[n:].copy(), Measured(external_force=force))

    def _rate(self, t: float, y: Array, braking: bool) -> Array:
        n, system = self.system.n, self.system
        x = system.state_type(system, y[:n], y[n:])
        torque = self._torque
        if self.gravity == "robot":
            torque = torque + system.motor_torque(x.gravity)
        if braking:
            torque = x.motor_torque(x.potential_gradient - self._damping * x.velocity)
            limit = system.robot.effort_limit
            torque = clipped(torque, -limit, limit)
        force = None if self._disturbance is None else self._disturbance(t, x)
        return np.concatenate((x.velocity, x.acceleration(torque, force)))
