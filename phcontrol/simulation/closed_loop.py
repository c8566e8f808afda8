"""Plant and controller in closed loop, with fixed steps."""

from __future__ import annotations

import math
import platform
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from scipy.linalg import lapack
from tqdm import tqdm

from phcontrol._validation import Array, choice, finite_array, number, positive, vector
from phcontrol._version import __version__
from phcontrol.controllers.controller import Controller
from phcontrol.exceptions import InvalidArgumentError, PHControlError, SimulationError, SimulationInterrupted
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import Measured
from phcontrol.simulation.integrators import INTEGRATORS
from phcontrol.simulation.log import Log

Disturbance = Callable[[float, MechanicalState], Array]
"""External force f_e(t, x) [N·m], shape (n,)."""


def simulate(
    system: MechanicalSystem,
    controller: Controller,
    *,
    duration: float,
    dt: float = 1e-3,
    q0: ArrayLike | None = None,
    v0: ArrayLike | None = None,
    controller_state0: ArrayLike | None = None,
    disturbance: Disturbance | ArrayLike | None = None,
    integrator: str = "rk4",
    control_period: float | None = None,
    torque_limit: Literal["robot"] | ArrayLike | None = "robot",
    progress: bool | None = None,
) -> Log:
    """Run a plant under a controller and return the log.

    Args:
        system: the plant. The controller computes with its own ``system``, which may differ.
        controller: the law.
        duration: simulated time [s]; rounded up to whole steps.
        dt: step of the integrator [s]; times are k·dt.
        q0: initial position [rad], by default the robot's home.
        v0: initial velocity [rad/s], by default 0.
        controller_state0: the controller's initial state, by default what it says itself.
        disturbance: external force f_e on the joints [N·m]: constant, or a function of time and state.
        integrator: a name in ``INTEGRATORS``.
        control_period: None for a continuous controller, whose state is integrated with the plant;
            or the period [s] at which the torque is computed and then held. Its state then
            advances by one Euler step a period. A whole multiple of dt.
        torque_limit: "robot" clips each torque to the joint's effort limit as the motors would; an
            array gives other limits [N·m]; None clips nothing. ``Log.saturated`` says where it acted.
        progress: show a progress bar; by default only on a terminal.

    Raises:
        InvalidArgumentError: an argument is out of its domain.
        SimulationError: the run diverged or the controller failed; carries the log so far.
        SimulationInterrupted: the run was stopped from the keyboard; carries the log so far.
    """
    dt, duration = positive("dt", dt), positive("duration", duration)
    step = INTEGRATORS[choice("integrator", integrator, INTEGRATORS)].step
    if controller.system.n != system.n:
        raise InvalidArgumentError("controller", f"is for {controller.system.n} joints, the system has {system.n}")
    position = vector("q0", system.robot.home if q0 is None else q0, system.n)
    velocity = vector("v0", np.zeros(system.n) if v0 is None else v0, system.n)
    state = controller.initial_state(controller.system.at(position, velocity))
    if controller_state0 is not None:
        state = vector("controller_state0", controller_state0, state.size)
    loop = ClosedLoop(
        system, controller, _disturbance(disturbance, system.n), _torque_limit(torque_limit, system), control_period
    )
    stride = _stride(control_period, dt)
    steps = max(1, math.ceil(duration / dt - 1e-9))
    log = Log.empty(
        loop,
        steps + 1,
        state.size,
        {
            "robot": system.robot.name,
            "controller": controller.name,
            "interconnection": controller.interconnection,
            "joint_names": list(system.robot.joint_names),
            "dt": dt,
            "integrator": integrator,
            "control_period": control_period,
            "versions": {"phcontrol": __version__, "pinocchio": pin.__version__, "numpy": np.__version__,
                         "python": platform.python_version()},
        },
    )  # fmt: skip
    y = np.concatenate([position, velocity, state])
    disable = None if progress is None else not progress
    done, k = 0, 0
    try:
        with np.errstate(all="ignore"), tqdm(total=steps, unit="step", disable=disable, delay=0.5, leave=False) as bar:
            for k in range(steps + 1):
                t = k * dt
                if stride and k % stride == 0:
                    y = loop.sample(t, y)
                rate = loop.rate(t, y)
                log.record(k, t, y, loop.torque, loop.external_force)
                if k % 100 == 0:
                    bar.update(k - done)
                    done = k
                if k == steps:
                    break
                y = step(loop, t, y, dt, rate)
                if not math.isfinite(y.dot(y)):
                    raise PHControlError("the state is no longer finite: the loop diverged")
    except SimulationError:
        raise
    except PHControlError as error:
        message = f"stopped at t = {k * dt:g} s: {error}. Try a smaller dt ({dt:g} s) or lower gains"
        raise SimulationError(message, log.truncated()) from error
    except KeyboardInterrupt as error:
        raise SimulationInterrupted(f"interrupted at t = {k * dt:g} s", log.truncated()) from error
    return log


class ClosedLoop:
    """The vector field of plant and controller, on y = (q, q̇, controller state)."""

    def __init__(
        self,
        plant: MechanicalSystem,
        controller: Controller,
        disturbance: Disturbance | Array | None,
        torque_limit: Array | None,
        control_period: float | None,
    ) -> None:
        self.plant, self.controller, self.model = plant, controller, controller.system
        self.n = plant.n
        self.torque = np.zeros(self.n)
        """The applied torque of the last evaluation [N·m]."""
        self.external_force = np.zeros(self.n)
        """f_e of the last evaluation [N·m]."""
        self.torque_limit = torque_limit
        self.control_period = control_period
        self._end = 2 * self.n
        self._plant_state, self._model_state = plant.state_type, self.model.state_type
        self._same_model = self.model is plant
        self._disturbance = disturbance if callable(disturbance) else None
        if disturbance is not None and not callable(disturbance):
            self.external_force = disturbance
        self._is_free = disturbance is None
        self._measured = Measured(self.external_force)
        self._held_rate: Array | None = None

    def rate(self, t: float, y: Array) -> Array:
        """Return ẏ; leaves the applied torque and f_e in ``torque`` and ``external_force``."""
        n, end = self.n, self._end
        x = self._plant_state(self.plant, y[:n], y[n:end])
        state_rate = self._act(t, x, y)
        acceleration = x.acceleration(self.torque, None if self._is_free else self.external_force)
        if y.size == end:
            return np.concatenate((x.velocity, acceleration))
        return np.concatenate((x.velocity, acceleration, state_rate))

    def momentum_rate(self, t: float, y: Array) -> tuple[Array, Array]:
        """Return ṗ [N·m] and the rate of the controller's state."""
        x = self._plant_state(self.plant, y[: self.n], y[self.n : self._end])
        state_rate = self._act(t, x, y)
        return x.momentum_rate(self.torque, self.external_force), state_rate

    def momentum(self, y: Array) -> Array:
        """Return p = M(q)q̇ [N·m·s]."""
        return self._plant_state(self.plant, y[: self.n], y[self.n : self._end]).momentum

    def velocity(self, position: Array, momentum: Array) -> Array:
        """Return q̇ = M(q)⁻¹p [rad/s]."""
        factor = self._plant_state(self.plant, position, momentum).factor
        solution: Array = lapack.dpotrs(factor, momentum, lower=1)[0]
        return solution

    def sample(self, t: float, y: Array) -> Array:
        """Compute the torque to be held from now on, and advance the controller's state by one period."""
        assert self.control_period is not None
        if self._held_rate is not None and self._held_rate.size:
            y = y.copy()
            y[self._end :] += self.control_period * self._held_rate
        self._held_rate = self._control(t, self._plant_state(self.plant, y[: self.n], y[self.n : self._end]), y)
        return y

    def model_state(self, position: Array, velocity: Array) -> MechanicalState:
        """Return the state as the controller's model sees it."""
        return self._model_state(self.model, position, velocity)

    def _act(self, t: float, x: MechanicalState, y: Array) -> Array:
        """Bring torque and f_e up to date; return the rate of the controller's state."""
        if self.control_period is None:
            return self._control(t, x, y)
        if self._disturbance is not None:
            self._disturb(t, x)
        return np.zeros(y.size - self._end)

    def _control(self, t: float, x: MechanicalState, y: Array) -> Array:
        if self._disturbance is not None:
            self._disturb(t, x)
        view = x if self._same_model else self.model_state(x.position, x.velocity)
        torque, state_rate = self.controller.evaluate(t, view, y[self._end :], self._measured)
        limit = self.torque_limit
        if limit is not None:
            torque = np.maximum(np.minimum(torque, limit), -limit)
        self.torque = torque
        return state_rate

    def _disturb(self, t: float, x: MechanicalState) -> None:
        assert self._disturbance is not None
        force = self._disturbance(t, x)
        if type(force) is not np.ndarray or force.shape != (self.n,) or force.dtype != np.float64:
            force = vector("disturbance", force, self.n)
        self.external_force = force
        self._measured = Measured(force)


def _disturbance(value: Any, n: int) -> Disturbance | Array | None:
    if value is None or callable(value):
        return value  # type: ignore[no-any-return]
    return vector("disturbance", value, n)


def _torque_limit(value: Any, system: MechanicalSystem) -> Array | None:
    if value is None:
        return None
    if isinstance(value, str):
        choice("torque limit", value, ["robot"])
        limit = np.asarray(system.robot.effort_limit)
    else:
        limit = np.broadcast_to(finite_array("torque_limit", value), (system.n,))
        if (limit <= 0.0).any():
            raise InvalidArgumentError("torque_limit", "must be > 0")
    return None if np.isinf(limit).all() else limit


def _stride(control_period: float | None, dt: float) -> int:
    if control_period is None:
        return 0
    ratio = number("control_period", control_period, minimum=0.0, exclusive=True) / dt
    stride = round(ratio)
    if stride < 1 or abs(ratio - stride) > 1e-6 * stride:
        raise InvalidArgumentError(
            "control_period", f"must be a whole multiple of dt = {dt:g} s, but is {control_period:g} s"
        )
    return stride
