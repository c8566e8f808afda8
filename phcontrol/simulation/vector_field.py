"""The vector field of plant and controller."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from phcontrol._validation import Array, vector
from phcontrol.controllers.controller import Controller
from phcontrol.environments.body import Body
from phcontrol.environments.disturbances import wrenches_of
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.safety.clipping import clipped
from phcontrol.sensors.measured import Measured
from phcontrol.simulation.sampled_control import SampledControl
from phcontrol.vision.scene import Scene

ExternalForce = Callable[[float, MechanicalState], Array]
"""External force f_e(t, x) [N·m], shape (n,)."""

_EMPTY: Array = np.zeros(0)


class Held(NamedTuple):
    """What stays as it is during a step."""

    torque: Array | None = None
    """Of a sampled controller [N·m]; None for a continuous one, which is asked at every instant."""
    measured: Measured | None = None
    """What sensors show; None when the controller is shown the truth, at every instant."""


NOTHING_HELD = Held()


class Surroundings(NamedTuple):
    """What is around the arm at one state."""

    external_force: Array
    """f_e, disturbance and bodies, shape (n,) [N·m]."""
    state_rate: Array
    """Rates of the bodies' states, then of the scene's."""
    truth: Measured
    """What perfect sensors show of it."""


class Evaluation(NamedTuple):
    """A closed loop at one instant."""

    rate: Array
    """ẏ."""
    torque: Array
    """The applied torque u, shape (n,) [N·m]."""
    external_force: Array
    """f_e, shape (n,) [N·m]."""
    features: Array | None
    """What there is to see, shape (3,) [m]; None without a scene."""


class ClosedLoop:
    """The vector field of plant, controller, bodies and scene: pure functions of time, state and what is held.

    Its state is y = (q, q̇, controller state, bodies' states, scene's state).

    Args:
        plant: the arm.
        controller: the law.
        disturbance: f_e, constant [N·m] or a function of time and state; None for none.
        torque_limit: what the law's torques are clipped to [N·m]; None for nothing.
        bodies: what the arm can touch.
        scene: what there is to see.
    """

    def __init__(
        self,
        plant: MechanicalSystem,
        controller: Controller,
        disturbance: ExternalForce | Array | None = None,
        torque_limit: Array | None = None,
        bodies: Sequence[Body] = (),
        scene: Scene | None = None,
    ) -> None:
        self.plant, self.controller, self.model = plant, controller, controller.system
        self.n = plant.n
        self.torque_limit = torque_limit
        self.bodies = tuple(bodies)
        self.scene = scene
        self.wrenches = wrenches_of(disturbance)
        """The wrenches at frames that the disturbance is made of."""
        self._end = 2 * self.n
        self._bodies_start = self._end + controller.state_size
        self._plant_state = plant.state_type
        self._disturbance = disturbance if callable(disturbance) else None
        self._steady_force: Array = np.zeros(self.n)
        if disturbance is not None and not callable(disturbance):
            self._steady_force = disturbance
        self._is_free = disturbance is None and not self.bodies
        self._scene_size = 0 if scene is None else scene.state_size
        still = self._disturbance is None and not self.bodies and scene is None
        self._still = Surroundings(self._steady_force, _EMPTY, Measured(self._steady_force)) if still else None
        self._needs_total_force = "total_force" in controller.needs
        self._no_rate: Array = np.zeros(controller.state_size)
        self._limits = None if torque_limit is None else (-torque_limit, torque_limit)

    @property
    def disturbance(self) -> ExternalForce | Array:
        """The disturbance: a function of time and state, or what is constant, shape (n,) [N·m]."""
        return self._steady_force if self._disturbance is None else self._disturbance

    def evaluate(self, t: float, y: Array, held: Held = NOTHING_HELD) -> Evaluation:
        """Return ẏ, and the torque and the force that make it."""
        x = self._plant_state(self.plant, y[: self.n], y[self.n : self._end])
        around = self._still or self.surroundings(t, x, y)
        torque, state_rate = self._act(t, x, y, around, held)
        acceleration = x.acceleration(torque, None if self._is_free else around.external_force)
        if y.size == self._end:
            rate = np.concatenate((x.velocity, acceleration))
        else:
            rate = np.concatenate((x.velocity, acceleration, state_rate, around.state_rate))
        return Evaluation(rate, torque, around.external_force, around.truth.features)

    def during(self, held: Held) -> HeldLoop:
        """Return the loop as it is during a step, for an integrator."""
        return HeldLoop(self, held)

    def momentum_rate(self, t: float, y: Array, held: Held = NOTHING_HELD) -> tuple[Array, Array]:
        """Return ṗ [N·m] and the rate of the controller's and the bodies' states."""
        x = self.plant_state(y)
        around = self._still or self.surroundings(t, x, y)
        torque, state_rate = self._act(t, x, y, around, held)
        return x.momentum_rate(torque, around.external_force), np.concatenate((state_rate, around.state_rate))

    def momentum(self, y: Array) -> Array:
        """Return p = M(q)q̇ [N·m·s]."""
        return self.plant_state(y).momentum

    def velocity(self, position: Array, momentum: Array) -> Array:
        """Return q̇ = M(q)⁻¹p [rad/s]."""
        factor = self._plant_state(self.plant, position, momentum).factor
        solution: Array = lapack.dpotrs(factor, momentum, lower=1)[0]
        return solution

    def energy(self, position: Array, momentum: Array) -> float:
        """Return the arm's energy H(q, p) [J]."""
        x = self._plant_state(self.plant, position, self.velocity(position, momentum))
        return x.energy

    def energy_slope(self, y: Array) -> tuple[Array, Array]:
        """Return ∂H/∂q = ∂V/∂q − Cᵀq̇ at constant p [N·m], and D(q̇) [N·m·s/rad]."""
        x = self.plant_state(y)
        return x.potential_gradient - x.velocity.dot(x.coriolis_matrix), x.damping_matrix

    def torque(self, t: float, y: Array, held: Held = NOTHING_HELD) -> Array:
        """Return the applied torque, shape (n,) [N·m]."""
        if held.torque is not None:
            return held.torque
        x = self.plant_state(y)
        return self._act(t, x, y, self.surroundings(t, x, y), held)[0]

    def sample(
        self,
        sampled: SampledControl,
        t: float,
        y: Array,
        measured: Measured | None,
        seen: MechanicalState | None = None,
    ) -> tuple[Array, Array]:
        """Return y with the controller's state one period on, and the torque that the law orders [N·m].

        ``seen`` is the plant's state as a joint sensor shows it to the law; None for the truth.
        """
        states = slice(self._end, self._bodies_start)
        state = sampled.advance(y[states])
        x = self.plant_state(y)
        if measured is None:
            measured = self._truth(t, x, y)
        view = (x if seen is None else seen).seen_by(self.model)
        state = self.controller.jump(t, view, state, measured)
        if state.size:
            y = y.copy()
            y[states] = state
        return y, sampled.step(t, view, state, measured)

    def jump(self, t: float, y: Array, measured: Measured | None) -> Array:
        """Return y after what happens at once to the controller's state."""
        x = self.plant_state(y)
        after: Array = y.copy()
        states = slice(self._end, self._bodies_start)
        shown = self._truth(t, x, y) if measured is None else measured
        after[states] = self.controller.jump(t, x.seen_by(self.model), y[states], shown)
        return after

    def plant_state(self, y: Array) -> MechanicalState:
        """Return the plant's state at y, which begins with q and q̇."""
        return self._plant_state(self.plant, y[: self.n], y[self.n : self._end])

    def surroundings(self, t: float, x: MechanicalState, y: Array) -> Surroundings:
        """Return what is around the arm."""
        if self._still is not None:
            return self._still
        force, rates = self._steady_force, []
        if self._disturbance is not None:
            force = self._disturbance(t, x)
            if type(force) is not np.ndarray or force.shape != (self.n,) or force.dtype != np.float64:
                force = vector("disturbance", force, self.n)
        if self.bodies:
            parts = self.parts_of_bodies(y[self._bodies_start :])
            touches = [body.touch(x, part) for body, part in zip(self.bodies, parts, strict=True)]
            force = force + sum(touch.force for touch in touches)
            rates = [touch.state_rate for touch in touches]
        features = None
        if self.scene is not None:
            state = y[y.size - self._scene_size :]
            features = self.scene.features(x, state)
            if self._scene_size:
                rates.append(self.scene.rate(x, state))
        return Surroundings(force, np.concatenate(rates) if rates else _EMPTY, Measured(force, features=features))

    def parts_of_bodies(self, states: Array) -> list[Array]:
        """Return each body's own state, of an array that begins with all of them."""
        parts, start = [], 0
        for body in self.bodies:
            parts.append(states[start : start + body.state_size])
            start += body.state_size
        return parts

    def _act(self, t: float, x: MechanicalState, y: Array, around: Surroundings, held: Held) -> tuple[Array, Array]:
        """Return the applied torque and the rate of the controller's state."""
        if held.torque is not None:
            return held.torque, self._no_rate
        measured = held.measured
        if measured is None:
            measured = self._total(x, around) if self._needs_total_force else around.truth
        state = y[self._end : self._bodies_start]
        view = x.seen_by(self.model)
        desired, state_rate = self.controller.evaluate(t, view, state, measured)
        if self._limits is None:
            return desired, state_rate
        torque = clipped(desired, *self._limits)
        change = torque - desired
        if state.size and change.any():
            state_rate = self.controller.rate_under_limits(t, view, state, state_rate, change, measured)
        return torque, state_rate

    def _truth(self, t: float, x: MechanicalState, y: Array) -> Measured:
        """Return what perfect sensors show."""
        around = self.surroundings(t, x, y)
        return self._total(x, around) if self._needs_total_force else around.truth

    def _total(self, x: MechanicalState, around: Surroundings) -> Measured:
        """Return the truth with the total force in it."""
        return around.truth._replace(total_force=x.total_force(around.external_force))


class HeldLoop:
    """A closed loop during one step: with what is held in it."""

    def __init__(self, loop: ClosedLoop, held: Held) -> None:
        self._loop, self._held, self.n = loop, held, loop.n
        self.momentum, self.velocity = loop.momentum, loop.velocity
        self.energy, self.energy_slope = loop.energy, loop.energy_slope

    def rate(self, t: float, y: Array) -> Array:
        """Return ẏ."""
        return self._loop.evaluate(t, y, self._held).rate

    def momentum_rate(self, t: float, y: Array) -> tuple[Array, Array]:
        """Return ṗ and the rate of the controller's and the bodies' states."""
        return self._loop.momentum_rate(t, y, self._held)
