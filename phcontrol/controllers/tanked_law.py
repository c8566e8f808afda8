"""Laws with actions that an energy tank pays for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from phcontrol._lazy import lazy
from phcontrol._validation import Array, sequence
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.parameters import Parameter
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.target import MOMENTUM, Drive, Target
from phcontrol.exceptions import InvalidArgumentError, NonFiniteTorqueError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import NOTHING, Measured
from phcontrol.tanks.action import Action
from phcontrol.tanks.energy_tank import EnergyTank, TankFlow

TANK = "tank"
"""Name of the state and part x_t − x_t(0)."""


def _actions(name: str, value: Any, system: MechanicalSystem) -> tuple[Action, ...]:
    actions = (value,) if isinstance(value, Action) else sequence(name, value, "actions")
    for action in actions:
        if not isinstance(action, Action):
            message = f"must be actions (ExternalAction(function), for instance), but one is {type(action).__name__}"
            raise InvalidArgumentError(name, message)
        action.check(system)
    return tuple(actions)


def _tank(name: str, value: Any, system: MechanicalSystem) -> EnergyTank:
    if not isinstance(value, EnergyTank):
        raise InvalidArgumentError(name, f"must be an EnergyTank, but is {type(value).__name__}")
    return value


class TankedLaw(Controller):
    """Any law with further torques that are not passive, which an energy tank pays for.

    The proof is in docs/cartesian-impedance.md.

    To a law with target (J_d, R_d) and p̂ among its coordinates it adds the torque G⁻¹ω a and one state x_t,

        ẋ_t = (−ω aᵀv̂ + σ v̂ᵀΔv̂ − lost)/x_t,   v̂ = T⁻ᵀp̂,

    with ω, σ and what is lost of :class:`EnergyTank`, Δ the law's injected damping. H_d + ½x_t² is the storage
    function of an exact port-Hamiltonian system: skew coupling of p̂ and x_t by the column
    (ωT⁻¹a − σT⁻¹Δv̂)/x_t; the part σT⁻¹ΔT⁻ᵀ of the damping moves from R_d to J_d, and lost/x_t² is in R_d.

    It goes before another law among the bases of a class, and asks that for its own part; ``with_tank`` makes such a
    class of any law. Without actions it is that law.

    Args:
        actions: what the tank pays for: an ``Action``, or several.
        tank: its bounds and its level at the start.

    Example:
        >>> from phcontrol import EnergyShaping, TankedLaw, with_tank
        >>> issubclass(with_tank(EnergyShaping), TankedLaw), with_tank(EnergyShaping).name
        (True, 'energy_shaping_with_tank')
    """

    actions: Parameter[Action | Sequence[Action], tuple[Action, ...]] = Parameter(
        "a", "N·m", default=(), check=_actions
    )
    tank: Parameter[EnergyTank, EnergyTank] = Parameter("x_t", "√J", default=EnergyTank(), check=_tank)

    @lazy
    def paid(self) -> tuple[Action, ...]:
        """Every action that the tank pays for."""
        return (*self.actions, *self.own_actions())

    def own_actions(self) -> tuple[Action, ...]:
        """Return actions that follow from the law's other arguments; none by default."""
        return ()

    @property
    def pays(self) -> bool:
        """Whether there is something that the tank pays for; without, there is no tank."""
        return bool(self.paid)

    @property
    def states(self) -> tuple[str, ...]:
        """Those of the law, and with something to pay for the tank's."""
        return (*super().states, TANK) if self.pays else super().states

    @property
    def state_parts(self) -> dict[str, int]:
        """The tank's part is one number."""
        parts = super().state_parts
        return parts | {TANK: 1} if self.pays else parts

    @property
    def caveat(self) -> str:
        """Say what the tank starts with."""
        return "; ".join(filter(None, (super().caveat, self._filled)))

    @property
    def _filled(self) -> str:
        return f"its tank starts with {self.tank.initial:g} J, which may reach the arm" if self.pays else ""

    @property
    def lacks_minimum(self) -> str:
        """Beside what the law lacks: a tank may stay empty."""
        kept = "an empty tank stays empty: no level of it is the one that it returns to" if self.pays else ""
        return "; ".join(filter(None, (super().lacks_minimum, kept)))

    @property
    def time_span(self) -> float:
        """The longest of law and actions [s]."""
        return max([super().time_span, *(action.duration for action in self.paid)])

    @property
    def longest_period(self) -> float:
        """With which an Euler step of x_t keeps the level above the tank's lower bound [s]."""
        return min(super().longest_period, self.tank.longest_period) if self.pays else super().longest_period

    def random_state(self, generator: np.random.Generator) -> Array:
        """Draw a state of the law, and of the tank where the law draws its own part alone."""
        drawn = super().random_state(generator)
        return drawn if drawn.size == self.state_size else np.append(drawn, generator.normal())

    def tank_level(self, state: Array) -> float | None:
        """Return the energy in the tank [J]."""
        return self.tank.level(float(state[-1])) if self.pays else super().tank_level(state)

    def calmest_state(self, t: float, x: MechanicalState, state: Array) -> Array:
        """Return that of the law, and the tank as it is."""
        if not self.pays:
            return super().calmest_state(t, x, state)
        return np.append(super().calmest_state(t, x, state[:-1]), state[-1])

    def rate_under_limits(
        self, t: float, x: MechanicalState, state: Array, rate: Array, change: Array, measured: Measured = NOTHING
    ) -> Array:
        """Let the tank pay for what a change of the torque δ puts in beyond what is lost, ŷᵀδ − ∇H_dᵀR_d∇H_d.

        H_d and tank together then grow by what f_e supplies, until the tank is empty or its largest power is reached.
        """
        charge = self.tank.charge(float(state[-1])) if self.pays else 0.0
        if not charge:
            return super().rate_under_limits(t, x, state, rate, change, measured)
        port = self.passive_port(t, x, state, measured)
        excess = float(port.output.dot(change)) - port.dissipated_power
        counted: Array = rate.copy()
        counted[-1] -= self.tank.spare(float(state[-1]), excess, -float(rate[-1]) * charge) / charge
        return counted

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d + ½x_t² [J]."""
        if not self.pays:
            return super().storage(t, x, state, measured)  # type: ignore[safe-super]  # of the law that comes after
        own = super().storage(t, x, state[:-1], measured)  # type: ignore[safe-super]
        return own + self.tank.level(float(state[-1]))

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """Add ω a to the law's effort, and the tank's rate to its state's."""
        if not self.pays:
            return super().shape(t, x, state, measured)
        law = super().shape(t, x, state[:-1], measured)
        torque, flow, _ = self._flow(t, x, self.port_velocity(t, x, state[:-1], measured), state)
        rate = np.empty(len(state))
        rate[:-1], rate[-1] = law.state_rate, flow.rate
        return Shaping(law.effort + flow.opening * torque, *law[1:-1], rate)

    def port_velocity(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Array:
        """Return v̂ = T⁻ᵀp̂ of the law without its tank, shape (n,) [rad/s]."""
        return self._velocity(x, super().passive_port(t, x, state, measured))

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return the law's port, less what the tank keeps of its damping, and with what it loses."""
        if not self.pays:
            return super().passive_port(t, x, state, measured)
        port = super().passive_port(t, x, state[:-1], measured)
        _, flow, damped = self._flow(t, x, self._velocity(x, port), state)
        kept = flow.refill * damped
        power = port.dissipated_power - float(self._velocity(x, port).dot(kept)) + flow.lost
        return PassivePort(port.output, power, port.resistance - kept)

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the law's promise with the tank beside it."""
        if not self.pays:
            return super().target(t, x, state, measured)  # type: ignore[safe-super]
        law = super().target(t, x, state[:-1], measured)  # type: ignore[safe-super]
        port = super().passive_port(t, x, state[:-1], measured)
        torque, flow, damped = self._flow(t, x, self._velocity(x, port), state)
        size, rows = len(law.coordinates), law.parts[MOMENTUM]

        def interconnection() -> Array:
            coupling = flow.per_charge(1.0) * x.solve_factor(flow.opening * torque - flow.refill * damped)
            matrix = _bordered(law.interconnection)
            matrix[rows, size], matrix[size, rows] = coupling, -coupling
            return matrix

        def dissipation() -> Array:
            matrix, damping = _bordered(law.dissipation), self.joint_damping(t, x)
            if damping is not None:
                matrix[rows, rows] -= flow.refill * x.transformed(damping)
            matrix[size, size] = flow.per_charge(flow.per_charge(flow.lost))
            return matrix

        drive = law.drive and Drive(np.vstack([law.drive.port, np.zeros_like(law.drive.port[:1])]), law.drive.signal)
        return Target(
            np.append(law.coordinates, state[-1]),
            interconnection,
            dissipation,
            np.append(law.gradient, flow.charge),
            lambda: np.vstack([law.port, np.zeros_like(law.port[:1])]),
            drive,
            dict(law.parts) | {TANK: slice(size, size + 1)},
        )

    def damping_force(self, t: float, x: MechanicalState, velocity: Array) -> Array:
        """Return Δ v, shape (n,) [N·m]."""
        damping = self.joint_damping(t, x)
        force: Array = np.zeros(x.system.n) if damping is None else damping.dot(velocity)
        return force

    def _flow(self, t: float, x: MechanicalState, velocity: Array, state: Array) -> tuple[Array, TankFlow, Array]:
        """Return a [N·m], what the valves let through, and Δv̂ [N·m]."""
        torque = np.zeros(x.system.n)
        for action in self.paid:
            torque += action.torque(t, x)
        damped = self.damping_force(t, x, velocity)
        power = float(torque.dot(velocity))
        if not math.isfinite(power):
            raise NonFiniteTorqueError(self.name, t, action=torque, power=power, velocity=velocity)
        flow = self.tank.flow(float(state[-1]), power, float(damped.dot(velocity)), self._part)
        return torque, flow, damped

    @property
    def _part(self) -> float:
        """Of the tank's largest power what the actions may use: all."""
        return 1.0

    def _velocity(self, x: MechanicalState, port: PassivePort) -> Array:
        """Return v̂ of ŷ = Gᵀv̂."""
        G = x.gears
        return port.output if G is None else np.linalg.solve(G.T, port.output)


def _bordered(matrix: Array) -> Array:
    """Return a square matrix with a row and a column of zeros more."""
    size = len(matrix)
    result: Array = np.zeros((size + 1, size + 1))
    result[:size, :size] = matrix
    return result
