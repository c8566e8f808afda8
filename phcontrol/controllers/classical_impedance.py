"""Hogan's impedance control, the thesis's baseline."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array
from phcontrol.controllers.parameters import Flag
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.controllers.regulated_law import VIRTUAL_POSITION, RegulatedLaw
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.target import MOMENTUM, Target
from phcontrol.mechanics.state import MechanicalState
from phcontrol.sensors.measured import NOTHING, Measured


class ClassicalImpedance(RegulatedLaw):
    """A spring and a damper to a virtual position, with gravity and friction compensated (4.60), (4.61).

        u = G⁻¹(∂V/∂q + D q̇ − K(q − q_f) − K_d q̇  [− f_e])

    Its closed loop on (q − q_f, p̄), with H_d = ½|p̄|² + ½(q − q_f)ᵀK(q − q_f), is port-Hamiltonian too,

        [[0, T⁻ᵀ], [−T⁻¹, J̄₂ − T⁻¹K_dT⁻ᵀ]] ∇H_d;

    f_e enters as [0; T⁻¹] by (4.60), and not at all by (4.61), which then does not feel the object. N. Hogan,
    "Impedance control: an approach to manipulation", parts I to III, J. Dyn. Sys., Meas., Control 107, 1985.
    About another potential, or along a reference, it runs on the error state (:class:`Aim`).

    Args:
        system: the model of the arm.
        goal: q_f [rad]; where q_f starts, with ``regulation``.
        stiffness: K_Hp, positive definite [N·m/rad].
        potential: Ψ in place of these two.
        reference: along what q_f moves, by default it is at rest.
        damping: K_Hd, positive definite [N·m·s/rad].
        compensate_external_force: True for (4.61).
        regulation: the outer integrator that moves q_f, or None; not with compensation.
        interconnection: which J̄₂ the target is written with.

    Example:
        >>> from phcontrol import ClassicalImpedance, MechanicalSystem, load_robot, simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = ClassicalImpedance(system, goal=[0.3, 0.2], stiffness=20.0, damping=5.0)
        >>> log = simulate(system, law, duration=3.0, dt=5e-3, q0=[0.0, 0.0])
        >>> log.position[-1].round(3)
        array([0.304, 0.202])
    """

    name = "classical_impedance"

    compensate_external_force: Flag = Flag(default=False)

    @property
    def needs(self) -> tuple[str, ...]:
        """The external force, when it is compensated or regulated."""
        felt = self.compensate_external_force or self.regulation is not None
        return ("external_force",) if felt else ()

    def joint_damping(self, t: float, x: MechanicalState) -> Array:
        """Return K_d, which acts on the joints themselves."""
        return self.damping

    @property
    def injected_damping(self) -> Array | None:
        """C with G C Gᵀ = K_d, shape (n, n) [N·m·s/rad]; None where G depends on q, and C would."""
        if self.system.varying_input is not None:
            return None
        G = self.system.constant_input
        return self.damping if G is None else np.linalg.solve(G, np.linalg.solve(G, self.damping).T)

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State s = −q̇_ref, the effort D v_e − ∂Ψ/∂q − K_d v_e, and what is cancelled."""
        aim = self.aim_at_virtual_position(t, x, state)
        effort = -(aim.gradient + self.damping.dot(aim.velocity))
        if x.system.friction is not None:
            effort += x.resistance(aim.velocity)
        force = self._measurement(measured, "external_force") if self.needs else None
        law = Shaping(effort, *aim.shift(), cancelled_force=force if self.compensate_external_force else None)
        if self.regulation is None or force is None:
            return law
        return self.with_faster_goal(law._replace(state_rate=0.0 * state), self.regulation.rate(force))

    def spring_force(self, t: float, x: MechanicalState, state: Array) -> Array:
        """Return K(q − q_f) [N·m]."""
        return self.aim_at_virtual_position(t, x, state).gradient

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d = ½|p̄_e|² + Ψ [J]."""
        aim = self.aim_at_virtual_position(t, x, state)
        return float(0.5 * aim.momentum.dot(aim.momentum)) + aim.energy

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return Gᵀv_e, v_eᵀK_d v_e, and K_d v_e: friction is compensated."""
        velocity = self.aim(t, x).velocity
        return PassivePort.of(x, velocity, self.damping.dot(velocity))

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (q − q_f, p̄_e); a moving q_f drives its first row."""
        aim = self.aim_at_virtual_position(t, x, state)
        inverse = x.inverse_factor
        parts = {"error": aim.error, MOMENTUM: (aim.momentum, aim.momentum)}
        if self.regulation is not None:
            parts[VIRTUAL_POSITION] = (state, 0.0 * state)
        return Target.of(
            parts,
            lambda: {("error", MOMENTUM): aim.coupling, (MOMENTUM, MOMENTUM): x.interconnection(self.interconnection)},
            lambda: {(MOMENTUM, MOMENTUM): inverse @ self.damping @ inverse.T},
            lambda: {} if self.compensate_external_force else {MOMENTUM: inverse},
            self.drive(t, x, measured),
        )
