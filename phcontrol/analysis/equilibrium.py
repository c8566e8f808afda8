"""Where a closed loop comes to rest under a constant force, and what then plays the part of its energy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import root

from phcontrol._validation import Array, vector
from phcontrol.analysis.certify import require_certificate
from phcontrol.analysis.promise import Promise
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.target import MOMENTUM, Target
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import Measured
from phcontrol.simulation.log import Log

TOLERANCE = 1e-8
_SAMPLES = 500  # of states in which H_r is looked at
_BALANCED = 1e-9  # of its terms, to which (2.45) may be off in other states where H_r is a Lyapunov function


@dataclass(frozen=True)
class Equilibrium:
    """A state of rest of plant and controller under a constant external force (thesis section 2.4).

    Example:
        >>> from phcontrol import EnergyShaping, MechanicalSystem, equilibrium, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = EnergyShaping(system, goal=[0.3, 0.2], stiffness=20.0, damping=5.0)
        >>> rest = equilibrium(law, system, [2.0, 0.0])  # f_e [N·m]
        >>> (rest.position - law.goal).round(3)  # f_e / stiffness [rad]
        array([0.1, 0. ])
    """

    position: Array
    """q, shape (n,) [rad]."""
    controller_state: Array
    external_force: Array
    """[N·m]."""
    residual: float
    """Largest acceleration or rate of the controller's state that is left."""
    storage: float
    """H_d at the equilibrium [J]."""
    target: Target
    """The promised closed loop there: (J_d − R_d)∇H_d + port f_e = 0 (2.45)."""
    _controller: Controller

    imbalance: float
    """Largest |(J_d − R_d)∇H_d(x*) + port f_e| in other states, over its terms: 0 where the loop under f_e is
    ẋ = (J_d − R_d)∇H_r."""
    growth: float
    """Largest Ḣ_r under the promised motion in these states, over its terms; positive where H_r grows."""

    @property
    def is_lyapunov(self) -> bool:
        """Whether the shifted storage function H_r is a Lyapunov function: then Ḣ_r = −∇H_rᵀR_d∇H_r.

        It is where ∇H_d(x*) solves (2.45) in every state, not in x* alone: for energy shaping, classical impedance,
        tracking at rest, integral action, and force feedback that measures f_e, about springs on the joints. It is not
        for force feedback of modeled forces on an arm whose mass matrix depends on q (:func:`casimirs`).
        """
        return self.imbalance <= _BALANCED

    def shifted_storage(self, log: Log) -> Array:
        """Return H_r = H_d(x) − H_d(x*) − ∇H_d(x*)ᵀ(x − x*) along a run, shape (N,) [J].

        The Bregman form of the energy about the equilibrium x*: zero there, positive around it (H_d is
        convex in the coordinates x of the target). It is (2.56) with Casimir functions that are linear in x.

        Raises PHControlError where it is no Lyapunov function (``is_lyapunov``).
        """
        if not self.is_lyapunov:
            raise PHControlError(
                f"the shifted storage function of {self._controller.name} is no Lyapunov function here: (2.45) with "
                f"∇H_d(x*) is off by {self.imbalance:.2g} of its terms in other states, and in the sampled "
                f"states it {'grows' if self.growth > _BALANCED else 'was not seen to grow, which shows nothing'}. "
                "See casimirs()"
            )
        values = np.empty(len(log.time))
        for k, t in enumerate(log.time):
            x = self._controller.system.at(log.position[k], log.velocity[k])
            state = log.controller_state[k]
            away = self._controller.coordinates(t, x, state) - self.target.coordinates
            values[k] = self._controller.storage(t, x, state) - self.storage - self.target.gradient @ away
        return values


def equilibrium(
    controller: Controller,
    system: MechanicalSystem,
    external_force: ArrayLike,
    *,
    guess: ArrayLike | None = None,
) -> Equilibrium:
    """Find where a closed loop rests under a constant external force, numerically.

    Solves q̈ = 0 and the controller's rate = 0 at q̇ = 0, from the law's goal (or home) or ``guess`` [rad].
    Raises PHControlError when there is no such state near by: for example with integral action while f_e
    is felt only through a sensor, or when the law is not what it promises on its own model: what is said of its
    storage function rests on that. Raises InvalidArgumentError for a law that follows a trajectory.

    Example:
        >>> from phcontrol import EnergyShaping, MechanicalSystem, equilibrium, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = EnergyShaping(system, goal=[0.3, 0.2], stiffness=20.0, damping=5.0)
        >>> (equilibrium(law, system, [2.0, 0.0]).position - law.goal).round(3)  # f_e / stiffness [rad]
        array([0.1, 0. ])
    """
    if controller.time_span:
        raise InvalidArgumentError("controller", "changes with time: it comes to no rest that could be found")
    require_certificate(controller, controller.system, "what is said of the equilibrium", rest=False)
    n, size = system.n, controller.state_size
    force = vector("external_force", external_force, n)
    start = controller.rest_posture(0.0) if guess is None else vector("guess", guess, n)
    solution = root(
        rest_condition(controller, system, force), np.concatenate([start, np.zeros(size)]), method="hybr", tol=1e-13
    )
    residual = float(np.abs(rest_condition(controller, system, force)(solution.x)).max())
    if not residual <= TOLERANCE:
        raise PHControlError(
            f"found no equilibrium of {controller.name} under {force}: a rate of {residual:.2g} is left"
        )
    position, state = solution.x[:n], solution.x[n:]
    x = controller.system.at(position)
    measured = Measured(external_force=force)
    target = controller.target(0.0, x, state, measured)
    stored = controller.storage(0.0, x, state, measured)
    found = _elsewhere(controller, system, force, target, state)
    return Equilibrium(position, state, force, residual, stored, target, controller, *found)


def _elsewhere(
    controller: Controller, system: MechanicalSystem, force: Array, target: Target, state: Array
) -> tuple[float, float]:
    """Return how far ∇H_d(x*) is from (2.45) in other states, and how much H_r grows there."""
    generator, imbalance, growth, n = np.random.default_rng(0), 0.0, -np.inf, system.n
    resting = target.gradient

    def seen(position: Array, velocity: Array, state: Array) -> Seen:
        at = SampledState(0.0, position, velocity, state, force, None, "")
        return Seen.of(controller, system, at, Measured._fields)

    def grown(promise: Promise) -> float:
        away, rate = promise.gradient - resting, promise.rate(force)
        return float(away @ rate) / max(float(np.abs(away) @ np.abs(rate)), 1e-300)

    for _ in range(_SAMPLES):
        position, velocity = system.robot.random_position(generator), generator.normal(size=n)
        promise = seen(position, velocity, controller.random_state(generator)).promise()
        terms = np.abs(promise.J - promise.R) @ np.abs(resting) + np.abs(promise.port) @ np.abs(force)
        left = (promise.J - promise.R) @ resting + promise.port @ force
        imbalance = max(imbalance, float(np.abs(left).max()) / max(float(terms.max()), 1e-300))
        # about p̂ = p̂* the loss is of second order in p̂, what is left of (2.45) of first: there it grows, if anywhere
        still = seen(position, np.zeros(n), state)
        momentum = target.momentum - still.target().momentum
        part = target.parts[MOMENTUM]
        pushed = 0.1 * np.linalg.lstsq(promise.R[part, part], left[part], rcond=1e-9)[0]
        x = controller.promised_state(still.view)
        near = seen(position, x.solve_factor_transposed(momentum + pushed), state)
        growth = max(growth, grown(promise), grown(near.promise()))
    return imbalance, growth


def rest_condition(controller: Controller, system: MechanicalSystem, force: Array) -> Callable[[Array], Array]:
    """Return the function of (q, controller state) at rest that is 0 at an equilibrium: q̈ and the state's rate."""

    def rates(unknown: Array) -> Array:
        position, state = unknown[: system.n], unknown[system.n :]
        at = SampledState(0.0, position, np.zeros(system.n), state, force, None, "")
        command = Seen.of(controller, system, at, Measured._fields).command()
        return np.concatenate([system.at(position).acceleration(command.torque, force), command.state_rate])

    return rates
