"""Impedance grasping by a virtual spring with a variable rest length (Theorem 4.2.3)."""

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
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import NOTHING, Measured


class ImpedanceGrasping(Controller):
    """Close on a virtual position q_f with a spring whose rest length gives way.

        e = q − q_f − q_rl,   p̂ = p̄ + TᵀK_p e,   ŷ = Ḡᵀp̂,   q̇_rl = −ŷ + K_p e − K_rl q_rl
        p̂̇ = −T⁻¹K_p e + (J̄₂ − D̄ − ḠCḠᵀ)p̂ + Ḡ(−K_p e + K_rl q_rl)

    Thesis (4.41) to (4.56) corrected: errata E15. The closed loop on (q − q_f, p̂, q_rl), with
    H_d = ½|p̂|² + ½eᵀK_p e + ½q_rlᵀK_rl q_rl, is

        [[−1, T⁻ᵀ, 0], [−T⁻¹, J̄₂ − D̄ − ḠCḠᵀ, Ḡ], [0, −Ḡᵀ, −1]] ∇H_d.

    Without ``regulation`` (*virtual*, the thesis's law) the measured f_e is cancelled: q → q_f whatever is in the way,
    and the contact force is whatever the object answers there; K_p q_f is the force of the virtual spring only.
    With ``regulation`` (*regulated*) f_e is not cancelled, it enters as [0; T⁻¹; 0], and q_f moves until the contact
    force is the wished one.

    Args:
        system: the model of the arm.
        goal: q_f [rad]; where q_f starts, with ``regulation``.
        stiffness: K_p, positive definite [N·m/rad].
        rest_stiffness: K_rl, positive definite [N·m/rad].
        damping: C, positive definite [N·m·s/rad].
        regulation: the outer integrator, or None.
        interconnection: "coriolis" or "canonical".
    """

    name = "impedance_grasping"

    def __init__(
        self,
        system: MechanicalSystem,
        *,
        goal: ArrayLike,
        stiffness: ArrayLike,
        rest_stiffness: ArrayLike,
        damping: ArrayLike,
        regulation: ForceRegulation | None = None,
        interconnection: str = "coriolis",
    ) -> None:
        super().__init__(system, interconnection)
        self.goal = vector("goal", goal, system.n)
        self.stiffness = gain("stiffness", stiffness, system.n)
        self.rest_stiffness = gain("rest_stiffness", rest_stiffness, system.n)
        self.damping = gain("damping", damping, system.n)
        self.regulation = check_regulation(regulation, system.n)

    @classmethod
    def default_gains(cls, system: MechanicalSystem, goal: Array) -> dict[str, Any]:
        """Return K_p = 1, K_rl = ½, and damping for 4 rad/s."""
        _, damping = inertia_scaled_gains(system, goal)
        return {"goal": goal, "stiffness": 1.0, "rest_stiffness": 0.5, "damping": damping}

    @property
    def needs(self) -> tuple[str, ...]:
        """The external force, to cancel or to regulate."""
        return ("external_force",)

    @property
    def state_parts(self) -> dict[str, int]:
        """The rest length; with regulation also how far q_f has moved."""
        n = self.system.n
        return {"rest_length": n} if self.regulation is None else {"rest_length": n, "virtual_position": n}

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

    def _split(self, x: MechanicalState, state: Array) -> tuple[Array, Array]:
        """Return q − q_f and q_rl."""
        n = self.system.n
        error = x.position_error(self.goal)
        return (error if self.regulation is None else error - state[n:]), state[:n]

    def _parts(self, x: MechanicalState, state: Array) -> tuple[Array, Array, Array]:
        """Return K_p e, K_rl q_rl, and q̇ + K_p e (which is T⁻ᵀp̂)."""
        error, rest = self._split(x, state)
        spring: Array = self.stiffness.dot(error - rest)
        return spring, self.rest_stiffness.dot(rest), x.velocity + spring

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State s = K_p e, its rate, the rate of the rest length (and of q_f), and the effort."""
        force = self._measurement(measured, "external_force")
        spring, rest_force, adapted = self._parts(x, state)
        G = x.input_matrix
        output = G.T.dot(adapted)
        rest_rate = -output + spring - rest_force
        goal_rate = np.zeros(self.system.n) if self.regulation is None else self.regulation.rate(force)
        regulated = self.regulation is not None
        return Shaping(
            effort=-spring + G.dot(rest_force - spring - self.damping.dot(output)),
            velocity=spring,
            acceleration=self.stiffness.dot(x.velocity - goal_rate - rest_rate),
            cancelled_force=None if regulated else force,
            state_rate=np.concatenate([rest_rate, goal_rate]) if regulated else rest_rate,
        )

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d = ½|p̂|² + ½eᵀK_p e + ½q_rlᵀK_rl q_rl [J]."""
        error, rest = self._split(x, state)
        spring, rest_force, adapted = self._parts(x, state)
        momentum = adapted.dot(x.factor)
        return float(0.5 * (momentum.dot(momentum) + spring.dot(error - rest) + rest.dot(rest_force)))

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return ŷ, |K_p e|² + |K_rl q_rl − K_p e|² + the losses by friction and damping, and the force of these."""
        spring, rest_force, adapted = self._parts(x, state)
        yielding = rest_force - spring
        injected = x.injected_damping(self.damping, adapted)
        return PassivePort.of(x, adapted, injected, adapted, spring.dot(spring) + yielding.dot(yielding))

    def calmest_state(self, t: float, x: MechanicalState, state: Array) -> Array:
        """Return the rest length where ½|p̂|² + ½eᵀK_p e + ½q_rlᵀK_rl q_rl is smallest."""
        error, _ = self._split(x, state)
        M, K = x.mass_matrix, self.stiffness
        # with p̂ = Tᵀ(q̇ + K(d − r)): −K M(q̇ + K(d − r)) − K(d − r) + K_rl r = 0
        left = K @ M @ K + K + self.rest_stiffness
        right = K.dot(M.dot(x.velocity + K.dot(error)) + error)
        return np.concatenate([np.linalg.solve(left, right), state[self.system.n :]])

    def coordinates(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Array:
        """Return (q − q_f, p̂, q_rl)."""
        error, rest = self._split(x, state)
        return np.concatenate([error, self._parts(x, state)[2].dot(x.factor), rest])

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (q − q_f, p̂, q_rl); a moving q_f drives its first row."""
        n = x.system.n
        zero, one, inverse, G = np.zeros((n, n)), np.eye(n), x.solve_factor(np.eye(n)), x.transformed_input
        spring, rest_force, adapted = self._parts(x, state)
        drive = None
        if self.regulation is not None and measured.external_force is not None:
            port = np.vstack([-one, zero, zero])
            drive = Drive(port, self.regulation.rate(measured.external_force))
        return Target(
            coordinates=self.coordinates(t, x, state),
            interconnection=np.block(
                [[zero, inverse.T, zero], [-inverse, x.interconnection(self.interconnection), G], [zero, -G.T, zero]]
            ),
            dissipation=np.block(
                [[one, zero, zero], [zero, self._injected_damping(x, self.damping), zero], [zero, zero, one]]
            ),
            gradient=np.concatenate([spring, adapted.dot(x.factor), rest_force - spring]),
            port=np.vstack([zero, zero if self.regulation is None else inverse, zero]),
            drive=drive,
        )
