"""Force control (theory section 5, Theorem 4.1.1)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, positive, sequence, vector
from phcontrol.controllers.controller import Drive, PassivePort, Shaping, Target, inertia_scaled_gains
from phcontrol.controllers.dynamic_extension import DynamicExtension
from phcontrol.controllers.task_potentials import Holding, JointForce, PointForce, TaskPotential
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import NOTHING, Measured

_SURFACE = 1e4  # stiffness of a surface that is pressed [N/m]


class ForceControl(DynamicExtension):
    """Bring the force of the environment on the arm to f_d, with the measured f_e in a dynamic extension.

        p̂ = p̄ − A w,   ẇ = Yᵀ[(J̄₂ − D̄)p̄ + T⁻¹(f_e − f_d) − T⁻¹∂U/∂q],   Y = A K_z
        u = G⁻¹(∂V/∂q − f_d − ∂U/∂q + T A ẇ) − C ŷ,   ŷ = Ḡᵀp̂

    U holds what the force leaves free. Thesis (4.1) to (4.9), (4.17), corrected: errata E14 (sign and T⁻¹) and
    E23 (the feedforward −f_d, without which the loop rests at p̂ ≠ 0). w stands for ẑ − z_d, each of which
    grows without bound. Sign: f_d is the force of the environment **on the arm**; a positive one presses a
    gripper that closes with decreasing q.

    The closed loop has the blocks of force feedback (measured) on (q, p̂, w), with Ψ = f_dᵀq (or Fᵀr(q)) + U in
    place of the spring: H_d = ½|p̂|² + Ψ + ½wᵀK_z⁻¹w. Alone it has no minimum, together with the environment's
    own potential it has one where f_e = f_d.

    Without feedforward, and while the arm approaches under a speed limit, Ψ = U, and f_d drives w from outside by
    −YᵀT⁻¹f_d. Holding w takes ẇ and with it the power wᵀK_z⁻¹ẇ > 0 out: the promise has it as the dissipation
    ẇẇᵀ/(wᵀK_z⁻¹ẇ) of w. At the contact H_d jumps by f_dᵀq.

    Args:
        system: the model of the arm.
        force: f_d, one entry a joint [N·m]; or with ``frame`` the force on that frame's origin in the world, (3,) [N].
        frame: of a force in space.
        damping: C, positive definite [N·m·s/rad].
        coupling: A, invertible.
        force_gain: K_z, positive definite.
        holding: potentials U, see :class:`Holding`.
        feedforward: False for the thesis's law without −f_d in u.
        approach_speed: v_max [rad/s]: without contact the feedforward waits, and w is held where |T⁻ᵀA w|
            has reached v_max and ½wᵀK_z⁻¹w would grow; otherwise w winds up in free motion. None for no limit.
        contact_threshold: |f_e| from which there is contact [N·m].
        interconnection: which J̄₂ the target is written with.
    """

    name = "force_control"

    def __init__(
        self,
        system: MechanicalSystem,
        *,
        force: ArrayLike,
        damping: ArrayLike,
        coupling: ArrayLike,
        force_gain: ArrayLike,
        frame: str | None = None,
        holding: Sequence[TaskPotential] = (),
        feedforward: bool = True,
        approach_speed: float | None = None,
        contact_threshold: float = 1e-3,
        interconnection: str = "coriolis",
    ) -> None:
        super().__init__(
            system,
            damping=damping,
            coupling=coupling,
            force_gain=force_gain,
            measured=True,
            interconnection=interconnection,
        )
        if frame is None:
            self.desired: JointForce | PointForce = JointForce(vector("force", force, system.n))
        else:
            system.frame_id(frame)
            self.desired = PointForce(frame, force)
        self.holding = sequence("holding", holding, "potentials", "gradient", "energy")
        if not isinstance(feedforward, bool):
            raise InvalidArgumentError("feedforward", f"must be True or False, but is {feedforward!r}")
        self.feedforward = feedforward
        self.approach_speed = math.inf if approach_speed is None else positive("approach_speed", approach_speed)
        self.contact_threshold = positive("contact_threshold", contact_threshold)

    @classmethod
    def default_gains(cls, system: MechanicalSystem, goal: Array) -> dict[str, Any]:
        """Return no force, damping for 4 rad/s, and A K_z Aᵀ = 1."""
        _, damping = inertia_scaled_gains(system, goal)
        return {"force": np.zeros(system.n), "damping": damping, "coupling": 1.0, "force_gain": 1.0}

    @property
    def caveat(self) -> str:
        """Say that a law with an approach-speed limit is switched."""
        return "passivity across the contact: H_d jumps there" if math.isfinite(self.approach_speed) else ""

    @property
    def driven_by(self) -> str:
        """Without feedforward, and until there is contact under a speed limit, the desired force."""
        if not self.feedforward:
            return "f_d, which moves w: no storage function but for constant T (errata E23)"
        return "f_d until there is contact, which moves w" if math.isfinite(self.approach_speed) else ""

    @property
    def lacks_minimum(self) -> str:
        """The law rests in contact only."""
        return "stability in contact: Ψ has a minimum only with the potential of what is pressed"

    def rest_posture(self, t: float) -> Array:
        """Return the posture that is held, or the arm's home [rad]."""
        held = [potential.posture for potential in self.holding if isinstance(potential, Holding)]
        return held[0] if held else super().rest_posture(t)

    def contact_stiffness(self, x: MechanicalState) -> Array | None:
        """Return the stiffness of what a frame presses on, 10⁴ N/m."""
        if isinstance(self.desired, JointForce):
            return None
        lever = self.desired.lever(x)
        stiffness: Array = _SURFACE * lever @ lever.T
        return stiffness

    def rest_force(self, x: MechanicalState) -> Array:
        """Return f_d [N·m]."""
        return self.desired.gradient(x)

    def _held(self, x: MechanicalState) -> Array:
        """Return −∂U/∂q [N·m]."""
        pull = np.zeros(x.system.n)
        for potential in self.holding:
            pull -= potential.gradient(x)
        return pull

    def pull(self, x: MechanicalState) -> Array:
        """Return −f_d − ∂U/∂q [N·m]."""
        return self._held(x) - self.desired.gradient(x)

    def potential(self, x: MechanicalState) -> float:
        """Return Ψ: of the desired force (with feedforward) and of what is held [J]."""
        energy: float = sum(potential.energy(x) for potential in self.holding)
        return energy + self.desired.energy(x) if self.feedforward else energy

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d = ½|p̂|² + Ψ + ½wᵀK_z⁻¹w [J], Ψ = U while the arm approaches."""
        energy = super().storage(t, x, state, measured)
        return energy - self.desired.energy(x) if self.feedforward and self._approaches(measured) else energy

    def position_coordinates(self, x: MechanicalState) -> Array:
        """Return q [rad]."""
        return x.position

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State ϑ = −A w, the rate of w, and the effort −f_d − ∂U/∂q − G C ŷ."""
        leading = x.solve_factor_transposed(self.coupling.dot(state))
        approaching = self._approaches(measured)
        state_rate = self._free_rate(x, measured)
        if approaching and self._is_held(leading, state, state_rate):
            state_rate = np.zeros_like(state_rate)
        driving = self.pull(x) if self.feedforward and not approaching else self._held(x)
        return Shaping(
            driving - x.injected_damping(self.damping, x.velocity - leading),
            offset_rate=self._negative_coupling.dot(state_rate),
            state_rate=state_rate,
        )

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return the port of the dynamic extension; holding w takes wᵀK_z⁻¹ẇ beside."""
        port = super().passive_port(t, x, state, measured)
        if not self._approaches(measured):
            return port
        leading, rate = x.solve_factor_transposed(self.coupling.dot(state)), self._free_rate(x, measured)
        if not self._is_held(leading, state, rate):
            return port
        taken = float(state.dot(self._storage_gain.dot(rate)))
        return port._replace(dissipated_power=port.dissipated_power + taken)

    def _free_rate(self, x: MechanicalState, measured: Measured) -> Array:
        """Return ẇ where w is not held; in approach what is measured is below the threshold, and no force."""
        force = self._measurement(measured, "external_force")
        if self._approaches(measured):
            force = np.zeros_like(force)
        rate: Array = x.transformed_rate(self.pull(x) + force).dot(self._port)
        return rate

    def _approaches(self, measured: Measured) -> bool:
        """Whether the approach speed is limited and there is no contact yet."""
        if math.isinf(self.approach_speed) or measured.external_force is None:
            return False
        return float(np.abs(measured.external_force).max()) <= self.contact_threshold

    def _is_held(self, leading: Array, state: Array, state_rate: Array) -> bool:
        """Whether w leads the arm at v_max and would store more still."""
        if math.sqrt(leading.dot(leading)) < self.approach_speed:
            return False
        return bool(state.dot(self._storage_gain.dot(state_rate)) > 0.0)

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (q, p̂, w); without feedforward, or in approach, f_d drives w as an input."""
        target = super().target(t, x, state, measured)
        approaching = self._approaches(measured)
        if self.feedforward and not approaching:
            return target
        n, lever = x.system.n, self.desired.lever(x)
        gradient, dissipation, felt = target.gradient.copy(), target.dissipation, target.port
        gradient[:n] -= self.desired.gradient(x)
        port = np.vstack([np.zeros((2 * n, lever.shape[1])), -self._port.T @ x.solve_factor(lever)])
        if approaching:
            felt = target.port.copy()
            felt[2 * n :] = 0.0
            leading = x.solve_factor_transposed(self.coupling.dot(state))
            rate = self._free_rate(x, measured)
            if self._is_held(leading, state, rate):
                dissipation = dissipation.copy()
                dissipation[2 * n :, 2 * n :] += np.outer(rate, rate) / state.dot(self._storage_gain.dot(rate))
        drive = Drive(port, self.desired.force)
        return Target(target.coordinates, target.interconnection, dissipation, gradient, felt, drive)
