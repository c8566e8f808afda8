"""Impedance grasping as (4.59) prints it: for a constant mass, without the canonical transformation."""

from __future__ import annotations

from phcontrol._validation import Array
from phcontrol.controllers.impedance_grasping import ImpedanceGrasping
from phcontrol.controllers.parameters import Flag
from phcontrol.controllers.shaping import Shaping
from phcontrol.mechanics.state import MechanicalState
from phcontrol.sensors.measured import NOTHING, Measured


class ConstantMassGrasping(ImpedanceGrasping):
    """The law that the thesis simulates, with T = 1 as in remark 3.1.2.

        e = q − q_f − q_rl,   ŷ = M q̇ + K_p e,   q̇_rl = −ŷ + K_p e − K_rl q_rl
        u = ∂V/∂q − D K_p e − K_p(q̇ − q̇_rl) + K_rl q_rl − C ŷ − f_e

    For M = 1 it is the general law. For another mass it is not: (4.59) lacks factors of M (errata E28), so that its
    closed loop is not (4.56), and its certificate fails. It is here to draw the thesis's figures with.

    Args:
        cancels_force: whether −f_e is in it, as printed.
        printed_sign: q̇_rl = −ŷ − K_p e − K_rl q_rl as (4.44) has it, which errata E15 corrects.
    """

    name = "constant_mass_grasping"

    cancels_force: Flag = Flag(default=True)
    printed_sign: Flag = Flag(default=False)

    def _output(self, x: MechanicalState, force: Array) -> Array:
        output: Array = x.mass_matrix.dot(x.velocity) + force
        return output

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State (4.59) as an effort, and the rate of the rest length."""
        at = self._stretched(t, x, state)
        output = self._output(x, at.force)
        rest_rate = (-at.force if self.printed_sign else at.force) - output - at.rest_force
        effort = (
            at.rest_force
            - x.damping * at.force
            - self._stiffness.dot(x.velocity - rest_rate)
            - self.damping.dot(output)
        )
        external = self._measurement(measured, "external_force") if self.cancels_force else None
        return Shaping(effort, cancelled_force=external, state_rate=rest_rate)

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return ½p̂ᵀM⁻¹p̂ + ½eᵀK_p e + ½q_rlᵀK_rl q_rl with p̂ = M q̇ + K_p e, remark 3.1.2's counterpart of (4.55)."""
        at = self._stretched(t, x, state)
        momentum = x.solve_factor(self._output(x, at.force))
        return float(0.5 * (momentum.dot(momentum) + at.force.dot(at.error - at.rest) + at.rest.dot(at.rest_force)))
