"""Hogan's impedance control, the thesis's baseline."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, gain, vector
from phcontrol.controllers.controller import Controller, Drive, PassivePort, Shaping, Target, inertia_scaled_gains
from phcontrol.controllers.force_regulation import (
    DRIVEN_BY,
    OUTER_LOOP_CAVEAT,
    RESTS_IN_CONTACT,
    ForceRegulation,
    check_regulation,
)
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import NOTHING, Measured


class ClassicalImpedance(Controller):
    """A spring and a damper to a virtual position, with gravity and friction compensated (4.60), (4.61).

        u = G⁻¹(∂V/∂q + D q̇ − K(q − q_f) − K_d q̇  [− f_e])

    Its closed loop on (q − q_f, p̄), with H_d = ½|p̄|² + ½(q − q_f)ᵀK(q − q_f), is port-Hamiltonian too,

        [[0, T⁻ᵀ], [−T⁻¹, J̄₂ − T⁻¹K_dT⁻ᵀ]] ∇H_d;

    f_e enters as [0; T⁻¹] by (4.60), and not at all by (4.61), which then does not feel the object. N. Hogan,
    "Impedance control: an approach to manipulation", parts I to III, J. Dyn. Sys., Meas., Control 107, 1985.

    Args:
        system: the model of the arm.
        goal: q_f [rad]; where q_f starts, with ``regulation``.
        stiffness: K_Hp, positive definite [N·m/rad].
        damping: K_Hd, positive definite [N·m·s/rad].
        compensate_external_force: True for (4.61).
        regulation: the outer integrator that moves q_f, or None; not with compensation.
        interconnection: which J̄₂ the target is written with.
    """

    name = "classical_impedance"

    def __init__(
        self,
        system: MechanicalSystem,
        *,
        goal: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike,
        compensate_external_force: bool = False,
        regulation: ForceRegulation | None = None,
        interconnection: str = "coriolis",
    ) -> None:
        super().__init__(system, interconnection)
        self.goal = vector("goal", goal, system.n)
        self.stiffness = gain("stiffness", stiffness, system.n)
        self.damping = gain("damping", damping, system.n)
        if not isinstance(compensate_external_force, bool):
            raise InvalidArgumentError("compensate_external_force", "must be True or False")
        self.compensates = compensate_external_force
        self.regulation = check_regulation(regulation, system.n)

    @classmethod
    def default_gains(cls, system: MechanicalSystem, goal: Array) -> dict[str, Any]:
        """Return gains critically damped at 4 rad/s or faster."""
        stiffness, damping = inertia_scaled_gains(system, goal)
        return {"goal": goal, "stiffness": stiffness, "damping": damping}

    @property
    def needs(self) -> tuple[str, ...]:
        """The external force, when it is compensated or regulated."""
        return ("external_force",) if self.compensates or self.regulation is not None else ()

    @property
    def state_parts(self) -> dict[str, int]:
        """With regulation, how far q_f has moved."""
        return {} if self.regulation is None else {"virtual_position": self.system.n}

    @property
    def caveat(self) -> str:
        """Say that regulation puts energy in."""
        return "" if self.regulation is None else OUTER_LOOP_CAVEAT

    @property
    def driven_by(self) -> str:
        """With regulation, the error of the contact force."""
        return "" if self.regulation is None else DRIVEN_BY

    @property
    def lacks_minimum(self) -> str:
        """With regulation the law rests in contact only."""
        return "" if self.regulation is None else RESTS_IN_CONTACT

    def rest_force(self, x: MechanicalState) -> Array | None:
        """Return f_d, with regulation."""
        return None if self.regulation is None else self.regulation.force

    def _error(self, x: MechanicalState, state: Array) -> Array:
        error = x.position_error(self.goal)
        return error if self.regulation is None else error - state

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State the effort D q̇ − K(q − q_f) − K_d q̇, and what is cancelled."""
        effort = x.friction_torque - self.stiffness.dot(self._error(x, state)) - self.damping.dot(x.velocity)
        law = Shaping(effort)
        if self.compensates:
            law = law._replace(cancelled_force=self._measurement(measured, "external_force"))
        if self.regulation is not None:
            law = law._replace(state_rate=self.regulation.rate(self._measurement(measured, "external_force")))
        return law

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d = ½|p̄|² + ½(q − q_f)ᵀK(q − q_f) [J]."""
        error = self._error(x, state)
        return x.kinetic_energy + float(0.5 * error.dot(self.stiffness.dot(error)))

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return y, q̇ᵀK_d q̇, and K_d q̇: friction is cancelled."""
        return PassivePort.of(x, x.velocity, self.damping.dot(x.velocity))

    def coordinates(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Array:
        """Return (q − q_f, p̄)."""
        return np.concatenate([self._error(x, state), x.transformed_momentum])

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (q − q_f, p̄); a moving q_f drives its first row."""
        zero, inverse = np.zeros((x.system.n, x.system.n)), x.solve_factor(np.eye(x.system.n))
        drive = None
        if self.regulation is not None and measured.external_force is not None:
            port = np.vstack([-np.eye(x.system.n), zero])
            drive = Drive(port, self.regulation.rate(measured.external_force))
        return Target(
            coordinates=self.coordinates(t, x, state),
            interconnection=np.block([[zero, inverse.T], [-inverse, x.interconnection(self.interconnection)]]),
            dissipation=np.block([[zero, zero], [zero, inverse @ self.damping @ inverse.T]]),
            gradient=np.concatenate([self.stiffness.dot(self._error(x, state)), x.transformed_momentum]),
            port=np.vstack([zero, zero if self.compensates else inverse]),
            drive=drive,
        )
