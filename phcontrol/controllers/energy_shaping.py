"""Energy shaping and damping injection (docs/theory.md)."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array
from phcontrol.controllers.damped_law import DampedLaw
from phcontrol.controllers.position_law import PositionLaw
from phcontrol.controllers.shaping import Shaping
from phcontrol.mechanics import kernels
from phcontrol.mechanics.state import MechanicalState
from phcontrol.potentials.joint_spring import JointSpring
from phcontrol.sensors.measured import Measured

_feedback = kernels.feedback


class EnergyShaping(PositionLaw, DampedLaw):
    """Hold a position or follow a motion: the arm's potential is replaced by another, and damping is injected.

        u = G⁻¹(∂V/∂q − ∂Ψ/∂q + M q̈_ref + C q̇_ref + D q̇_ref) − C Gᵀv_e,    v_e = q̇ − q̇_ref

    The closed loop is, with H_d = ½|p̄_e|² + Ψ, p̄_e = Tᵀv_e, and f_e entering the second row as T⁻¹f_e,

        d/dt (q̃, p̄_e) = [[0, T⁻ᵀ], [−T⁻¹, J̄₂ − D̄ − ḠCḠᵀ]] ∇H_d.

    The arm's friction stays in the loop. Thesis section 3.2.1 without the force feedback (A = 0). Of a spring a
    constant f_e shifts the rest position to q_d + K_p⁻¹f_e.

    Args:
        system: the model of the arm.
        goal: q_d [rad].
        stiffness: K_p, scalar, vector or matrix, positive definite [N·m/rad].
        potential: Ψ in place of these two.
        reference: along what, by default a goal at rest.
        damping: C, scalar, vector or matrix, positive definite [N·m·s/rad].
        interconnection: which J̄₂ the target is written with.

    Example:
        >>> import numpy as np
        >>> from phcontrol import EnergyShaping, MechanicalSystem, load_robot, simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = EnergyShaping(system, goal=[0.3, 0.2], stiffness=20.0, damping=5.0)
        >>> log = simulate(system, law, duration=3.0, dt=5e-3, q0=[0.0, 0.0])
        >>> log.position[-1].round(3), bool(np.diff(log.storage).max() < 1e-9)
        (array([0.3  , 0.199]), True)
    """

    name = "energy_shaping"

    def prepare(self) -> None:
        """See whether the whole force is to be had at once: about a spring on the joints, at rest or led by them."""
        super().prepare()
        led = self.interconnection == "coriolis" and self._trajectory is not None
        self._at_once = self._spring if led or self.reference is None else None
        self._rest: Array = np.zeros(self.system.n)

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State s = −q̇_ref and the effort −∂Ψ/∂q − G C Gᵀv_e; about a spring on the joints the whole force at once."""
        spring = self._at_once
        if spring is None:
            return super().shape(t, x, state, measured)
        known = self._measurement(measured, "external_force") if self.cancels_external_force else None
        return Shaping(self._spring_force(t, x, spring), cancelled_force=known, complete=True)

    def _spring_force(self, t: float, x: MechanicalState, spring: JointSpring) -> Array:
        """Return the whole force about a spring on the joints, without forming M or C [N·m]."""
        if self._trajectory is None:
            leading, position, velocity = x.potential_gradient, spring.goal, self._rest
        else:
            position, velocity, acceleration = self._trajectory.at(t)
            leading = x.feedforward(velocity, acceleration)
        error = x.position_error(position)
        return _feedback(leading, spring.stiffness, error, self.joint_damping(t, x), x.velocity, velocity)
