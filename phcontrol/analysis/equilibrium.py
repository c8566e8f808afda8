"""Where a closed loop comes to rest under a constant force, and what then plays the part of its energy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import root

from phcontrol._validation import Array, vector
from phcontrol.analysis.certify import require_certificate
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.target import Target
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import Measured
from phcontrol.simulation.log import Log

TOLERANCE = 1e-8


@dataclass(frozen=True)
class Equilibrium:
    """A state of rest of plant and controller under a constant external force (thesis section 2.4)."""

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

    def shifted_storage(self, log: Log) -> Array:
        """Return H_r = H_d(x) − H_d(x*) − ∇H_d(x*)ᵀ(x − x*) along a run, shape (N,) [J].

        The Bregman form of the energy about the equilibrium x*: zero there, positive around it (H_d is
        convex in the coordinates x of the target). It takes the place of (2.56) where the Casimir functions of
        Theorem 2.4.1 do not integrate.
        """
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
    """
    if controller.time_span:
        raise InvalidArgumentError("controller", "changes with time: it comes to no rest that could be found")
    require_certificate(controller, controller.system, "what is said of the equilibrium", rest=False)
    n, size = system.n, controller.state_size
    force = vector("external_force", external_force, n)
    start = controller.rest_posture(0.0) if guess is None else vector("guess", guess, n)
    solution = root(
        _rest_condition(controller, system, force), np.concatenate([start, np.zeros(size)]), method="hybr", tol=1e-13
    )
    residual = float(np.abs(_rest_condition(controller, system, force)(solution.x)).max())
    if not residual <= TOLERANCE:
        raise PHControlError(
            f"found no equilibrium of {controller.name} under {force}: a rate of {residual:.2g} is left"
        )
    position, state = solution.x[:n], solution.x[n:]
    x = controller.system.at(position)
    measured = Measured(external_force=force)
    return Equilibrium(
        position,
        state,
        force,
        residual,
        controller.storage(0.0, x, state, measured),
        controller.target(0.0, x, state, measured),
        controller,
    )


def _rest_condition(controller: Controller, system: MechanicalSystem, force: Array) -> Callable[[Array], Array]:
    def rates(unknown: Array) -> Array:
        position, state = unknown[: system.n], unknown[system.n :]
        at = SampledState(0.0, position, np.zeros(system.n), state, force, None, "")
        command = Seen.of(controller, system, at, Measured._fields).command()
        return np.concatenate([system.at(position).acceleration(command.torque, force), command.state_rate])

    return rates
