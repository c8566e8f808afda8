"""Force control (theory section 5, Theorem 4.1.1)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, positive, sequence, vector
from phcontrol.controllers.controller import Shaping, Target, inertia_scaled_gains
from phcontrol.controllers.dynamic_extension import DynamicExtension
from phcontrol.controllers.task_potentials import JointForce, PointForce, TaskPotential
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import NOTHING, Measured


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

    Args:
        system: the model of the arm.
        force: f_d, one entry a joint [N·m]; or with ``frame`` the force on that frame's origin in the world, (3,) [N].
        frame: of a force in space.
        damping: C, positive definite [N·m·s/rad].
        coupling: A, invertible.
        force_gain: K_z, positive definite.
        holding: potentials U, see :class:`Holding`.
        feedforward: False for the thesis's law without −f_d in u.
        approach_speed: v_max [rad/s]: without contact the feedforward waits, and w is held when |T⁻ᵀA w|
            would grow beyond v_max; otherwise w winds up in free motion. Passivity of the switched law is
            not proved. None for no limit.
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
            self.wish: TaskPotential = JointForce(vector("force", force, system.n))
        else:
            system.frame_id(frame)
            self.wish = PointForce(frame, force)
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
        """Say what a law without feedforward or with an approach-speed limit does not claim."""
        if not self.feedforward:
            return "without feedforward f_d drives w from outside: no storage function but for constant T (errata E23)"
        if math.isfinite(self.approach_speed):
            return "passivity of the switched law (approach-speed limit) is not proved"
        return ""

    def _held(self, x: MechanicalState) -> Array:
        """Return −∂U/∂q [N·m]."""
        pull = np.zeros(x.system.n)
        for potential in self.holding:
            pull -= potential.gradient(x)
        return pull

    def pull(self, x: MechanicalState) -> Array:
        """Return −f_d − ∂U/∂q [N·m]."""
        return self._held(x) - self.wish.gradient(x)

    def potential(self, x: MechanicalState) -> float:
        """Return Ψ: of the wished force (with feedforward) and of what is held [J]."""
        energy: float = sum(potential.energy(x) for potential in self.holding)
        return energy + self.wish.energy(x) if self.feedforward else energy

    def position_coordinates(self, x: MechanicalState) -> Array:
        """Return q [rad]."""
        return x.position

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State ϑ = −A w, the rate of w, and the effort −f_d − ∂U/∂q − G C ŷ."""
        force = self._measurement(measured, "external_force")
        pull, leading = self.pull(x), x.solve_factor_transposed(self.coupling.dot(state))
        state_rate = x.transformed_rate(pull + force).dot(self._port)
        approaching = self._is_approaching(force)
        driving = pull if self.feedforward and not approaching else self._held(x)
        if approaching and self._is_too_fast(x, leading, state_rate):
            state_rate = np.zeros_like(state_rate)
        return Shaping(
            driving - x.injected_damping(self.damping, x.velocity - leading),
            offset_rate=self._negative_coupling.dot(state_rate),
            state_rate=state_rate,
        )

    def _is_approaching(self, force: Array) -> bool:
        """Whether the approach speed is limited and there is no contact yet."""
        return math.isfinite(self.approach_speed) and float(np.abs(force).max()) <= self.contact_threshold

    def _is_too_fast(self, x: MechanicalState, leading: Array, state_rate: Array) -> bool:
        """Whether w leads the arm at v_max and would lead it faster still."""
        if math.sqrt(leading.dot(leading)) < self.approach_speed:
            return False
        return bool(leading.dot(x.solve_factor_transposed(self.coupling.dot(state_rate))) > 0.0)

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (q, p̂, w); without feedforward f_d drives w as an input."""
        target = super().target(t, x, state, measured)
        if self.feedforward:
            return target
        n, wished = x.system.n, self.wish.gradient(x)
        gradient = target.gradient.copy()
        gradient[:n] -= wished
        drift = np.concatenate([np.zeros(2 * n), -self._port.T @ x.solve_factor(wished)])
        return Target(target.coordinates, target.interconnection, target.dissipation, gradient, target.port, drift)
