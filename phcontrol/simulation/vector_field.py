"""The vector field of plant and controller."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.linalg import lapack

from phcontrol._validation import Array, vector
from phcontrol.controllers.controller import Controller
from phcontrol.environments.body import Body
from phcontrol.environments.disturbances import wrenches_of
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.safety.torque_filter import TorqueFilter
from phcontrol.sensors.measured import Measured
from phcontrol.simulation.sampled_control import SampledControl
from phcontrol.vision.scene import Scene

ExternalForce = Callable[[float, MechanicalState], Array]
"""External force f_e(t, x) [N·m], shape (n,)."""


class ClosedLoop:
    """The vector field of plant, controller, bodies and scene.

    Its state is y = (q, q̇, controller state, bodies' states, scene's state).
    """

    def __init__(
        self,
        plant: MechanicalSystem,
        controller: Controller,
        disturbance: ExternalForce | Array | None,
        torque_limit: Array | None,
        control_period: float | None,
        bodies: Sequence[Body] = (),
        torque_filter: TorqueFilter | None = None,
        scene: Scene | None = None,
    ) -> None:
        self.plant, self.controller, self.model = plant, controller, controller.system
        self.n = plant.n
        self.torque = np.zeros(self.n)
        """The applied torque of the last evaluation [N·m]."""
        self.external_force = np.zeros(self.n)
        """f_e of the last evaluation [N·m]."""
        self.torque_limit = torque_limit
        self.control_period = control_period
        self.bodies = tuple(bodies)
        self.scene = scene
        self.features: Array | None = None
        """What there is to see, at the last evaluation; None without a scene."""
        self._end = 2 * self.n
        self._bodies_start = self._end + controller.state_size
        self._plant_state, self._model_state = plant.state_type, self.model.state_type
        self._same_model = self.model is plant
        self._disturbance = disturbance if callable(disturbance) else None
        self.wrenches = wrenches_of(disturbance)
        """The wrenches at frames that the disturbance is made of."""
        if disturbance is not None and not callable(disturbance):
            self.external_force = disturbance
        self._steady_force = self.external_force
        self._is_free = disturbance is None and not self.bodies
        self._scene_size = 0 if scene is None else scene.state_size
        self._varies = self._disturbance is not None or bool(self.bodies) or scene is not None
        self._bodies_rate = np.zeros(0)
        self.measured: Measured | None = None
        """What sensors show; None when the controller is shown the truth."""
        self._truth = Measured(self.external_force)
        self._needs_total_force = "total_force" in controller.needs
        self.sampled = (
            None if control_period is None else SampledControl(controller, control_period, torque_limit, torque_filter)
        )
        """The controller's period; None for a continuous controller."""

    def rate(self, t: float, y: Array) -> Array:
        """Return ẏ; leaves the applied torque and f_e in ``torque`` and ``external_force``."""
        n, end = self.n, self._end
        x = self._plant_state(self.plant, y[:n], y[n:end])
        state_rate = self._act(t, x, y)
        acceleration = x.acceleration(self.torque, None if self._is_free else self.external_force)
        if y.size == end:
            return np.concatenate((x.velocity, acceleration))
        if self._bodies_rate.size:
            return np.concatenate((x.velocity, acceleration, state_rate, self._bodies_rate))
        return np.concatenate((x.velocity, acceleration, state_rate))

    def momentum_rate(self, t: float, y: Array) -> tuple[Array, Array]:
        """Return ṗ [N·m] and the rate of the controller's and the bodies' states."""
        x = self._plant_state(self.plant, y[: self.n], y[self.n : self._end])
        state_rate = np.concatenate((self._act(t, x, y), self._bodies_rate))
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
        assert self.sampled is not None
        states = slice(self._end, self._bodies_start)
        state = self.sampled.advance(y[states])
        if state.size:
            y = y.copy()
            y[states] = state
        x = self.plant_state(t, y)
        view, measured = self._shown(x)
        self.torque = self.sampled.step(t, view, state, measured)
        return y

    def plant_state(self, t: float, y: Array) -> MechanicalState:
        """Return the plant's state at y, with f_e brought up to date."""
        x = self._plant_state(self.plant, y[: self.n], y[self.n : self._end])
        if self._varies:
            self._disturb(t, x, y)
        return x

    def model_state(self, position: Array, velocity: Array) -> MechanicalState:
        """Return the state as the controller's model sees it."""
        return self._model_state(self.model, position, velocity)

    def _act(self, t: float, x: MechanicalState, y: Array) -> Array:
        """Bring torque and f_e up to date; return the rate of the controller's state."""
        if self.control_period is None:
            return self._control(t, x, y)
        if self._varies:
            self._disturb(t, x, y)
        return np.zeros(self._bodies_start - self._end)

    def _control(self, t: float, x: MechanicalState, y: Array) -> Array:
        if self._varies:
            self._disturb(t, x, y)
        view, measured = self._shown(x)
        torque, state_rate = self.controller.evaluate(t, view, y[self._end : self._bodies_start], measured)
        limit = self.torque_limit
        if limit is not None:
            torque = np.maximum(np.minimum(torque, limit), -limit)
        self.torque = torque
        return state_rate

    def _shown(self, x: MechanicalState) -> tuple[MechanicalState, Measured]:
        """Return the state as the controller's model sees it, and what it is shown beside."""
        view = x if self._same_model else self.model_state(x.position, x.velocity)
        measured = self.measured
        if measured is None:
            measured = self._truth
            if self._needs_total_force:
                measured = measured._replace(total_force=x.total_force(self.external_force))
        return view, measured

    def _disturb(self, t: float, x: MechanicalState, y: Array) -> None:
        """Bring f_e, and the rates of the bodies' states, up to date."""
        force = self._steady_force
        if self._disturbance is not None:
            force = self._disturbance(t, x)
            if type(force) is not np.ndarray or force.shape != (self.n,) or force.dtype != np.float64:
                force = vector("disturbance", force, self.n)
        if self.bodies:
            touches = [body.touch(x, part) for body, part in zip(self.bodies, self.body_states(y), strict=True)]
            force = force + sum(touch.force for touch in touches)
            self._bodies_rate = np.concatenate([touch.state_rate for touch in touches])
        if self.scene is not None:
            self._look(self.scene, x, y)
        self.external_force = force
        self._truth = Measured(force, features=self.features)

    def _look(self, scene: Scene, x: MechanicalState, y: Array) -> None:
        """Bring the features, and the rate of the scene's state, up to date."""
        state = y[y.size - self._scene_size :]
        self.features = scene.features(x, state)
        if self._scene_size:
            touched = self._bodies_rate[: y.size - self._scene_size - self._bodies_start]
            self._bodies_rate = np.concatenate((touched, scene.rate(x, state)))

    def body_states(self, y: Array) -> list[Array]:
        """Return each body's part of y."""
        parts, start = [], self._bodies_start
        for body in self.bodies:
            parts.append(y[start : start + body.state_size])
            start += body.state_size
        return parts
