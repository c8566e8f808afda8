"""Classical force control: the baseline that the thesis compares itself with in words."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.parameters import Gain, Vector
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.target import MOMENTUM, Target
from phcontrol.mechanics.state import MechanicalState
from phcontrol.sensors.measured import NOTHING, Measured

_RATE = 0.25  # of the integral [1/s], far below C/m of the default damping


class ClassicalForceControl(Controller):
    """Integral force control with a feedforward and a damper: what force control is without an adapted momentum.

        u = G⁻¹(∂V/∂q − f_d + K_I σ) − C Gᵀq̇,   σ̇ = f_e − f_d

    The thesis names D. Gorinevsky, A. Formalsky and A. Schneider, "Force control of robotics systems", 1997, its
    reference [21], as the classical strategy, without a formula; this is the integral law of that school (also B.
    Siciliano and L. Villani, "Robot force control", 1999). Sign as for ``ForceControl``: f_d is the force of the
    environment **on the arm**.

    The integral moves the arm by a force that is no gradient of the arm's position alone. In the promise it is a
    parameter of the potential (f_d − K_Iσ)ᵀ(q − q₀), q₀ the arm's home, that f_e − f_d drives from outside: exactly
    port-Hamiltonian, but driven, so that passivity is not claimed. On an elastic contact of any stiffness one joint of
    inertia m is stable for K_I < C/m: m s³ + C s² + k s + K_I k has the roots of a stable motion.

    Args:
        system: the model of the arm.
        force: f_d [N·m].
        damping: C, positive definite [N·m·s/rad].
        integral_rate: K_I, positive definite [1/s].
        interconnection: which J̄₂ the target is written with.

    Example:
        >>> from phcontrol import ClassicalForceControl, MechanicalSystem, load_robot
        >>> gripper = MechanicalSystem(load_robot("pera_gripper"))
        >>> ClassicalForceControl(gripper, force=[3.5], damping=5.0, integral_rate=2.0).force  # [N·m]
        array([3.5])
    """

    name = "classical_force_control"

    force: Vector = Vector("f_d", "N·m", tuned=lambda tuning: np.zeros(tuning.system.n))
    damping: Gain = Gain("C", "N·m·s/rad", tuned=lambda tuning: tuning.damping)
    integral_rate: Gain = Gain("K_I", "1/s", tuned=lambda tuning: _RATE)

    @property
    def states(self) -> tuple[str, ...]:
        """The integral σ of the force error [N·m·s]."""
        return ("integral",)

    @property
    def needs(self) -> tuple[str, ...]:
        """The external force."""
        return ("external_force",)

    @property
    def driven_by(self) -> str:
        """The error of the contact force."""
        return "f_e − f_d, which moves the integral"

    @property
    def lacks_minimum(self) -> str:
        """The law rests in contact only."""
        return "stability in contact: it rests where the body it touches answers with f_d"

    def rest_force(self, x: MechanicalState) -> Array:
        """Return f_d [N·m]."""
        return self.force

    @property
    def injected_damping(self) -> Array:
        """C."""
        return self.damping

    def _pull(self, state: Array) -> Array:
        """Return f_d − K_I σ [N·m]."""
        pull: Array = self.force - self.integral_rate.dot(state)
        return pull

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State the effort −f_d + K_I σ − G C Gᵀq̇ and the rate of σ."""
        error = self._measurement(measured, "external_force") - self.force
        return Shaping(-(self._pull(state) + x.injected_damping(self.damping, x.velocity)), state_rate=error)

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d = ½|p̄|² + (f_d − K_Iσ)ᵀ(q − q₀) [J]."""
        return x.kinetic_energy + float(self._pull(state).dot(x.position - self.system.robot.home))

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return Gᵀq̇, q̇ᵀ(D + GCGᵀ)q̇, and (D + GCGᵀ)q̇."""
        return PassivePort.of(x, x.velocity, x.injected_damping(self.damping, x.velocity), x.velocity)

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (q − q₀, p̄, σ), σ driven by f_e − f_d."""
        away, inverse = x.position - self.system.robot.home, x.inverse_factor
        momentum = x.transformed_momentum
        felt = measured.external_force
        drive = None if felt is None else ({"integral": np.eye(self.system.n)}, felt - self.force)
        return Target.of(
            {
                "error": (away, self._pull(state)),
                MOMENTUM: (momentum, momentum),
                "integral": (state, -self.integral_rate.dot(away)),
            },
            lambda: {("error", MOMENTUM): inverse.T, (MOMENTUM, MOMENTUM): x.interconnection(self.interconnection)},
            lambda: {(MOMENTUM, MOMENTUM): x.transformed_damping + x.transformed_injection(self.damping)},
            lambda: {MOMENTUM: inverse},
            drive,
        )
