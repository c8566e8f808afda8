"""Force control (docs/theory.md, Theorem 4.1.1)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array, positive, sequence, vector
from phcontrol.controllers.aim import Aim
from phcontrol.controllers.dynamic_extension import DynamicExtension, invertible
from phcontrol.controllers.parameters import Flag, Gain, Parameter, Positive
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.target import MOMENTUM, DrivenParts, Target, joined
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.potentials.joint_force import JointForce
from phcontrol.potentials.point_force import PointForce
from phcontrol.potentials.potential import Potential, Sum
from phcontrol.sensors.measured import NOTHING, Measured

_SURFACE = 1e4  # stiffness of a surface that is pressed [N/m]


def _potentials(name: str, value: Any, system: MechanicalSystem) -> tuple[Potential, ...]:
    items: tuple[Potential, ...] = sequence(name, value, "potentials", "gradient", "energy", "coordinates")
    for item in items:
        item.check(system)
    return items


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

    Example:
        >>> from phcontrol import ForceControl, JointContact, MechanicalSystem, RigidBody, load_robot, simulate
        >>> gripper = MechanicalSystem(load_robot("pera_gripper"))
        >>> ball = RigidBody(JointContact("gripper", 0.20), stiffness=20.0, damping=0.5)
        >>> law = ForceControl(gripper, force=[3.5], damping=5.0, coupling=1.0, force_gain=1.0, approach_speed=0.2)
        >>> log = simulate(gripper, law, duration=4.0, dt=2e-3, bodies=[ball])
        >>> log.contact_force[-1:].round(2)  # [N·m]
        array([3.5])
    """

    name = "force_control"

    force: Parameter[ArrayLike, Array] = Parameter(
        "f_d", "N·m", check=lambda name, value, system: finite_array(name, value), tuned=lambda t: np.zeros(t.system.n)
    )
    frame: Parameter[str | None, str | None] = Parameter(
        default=None, check=lambda name, value, system: (system.frame_id(value), value)[1]
    )
    coupling: Parameter[ArrayLike, Array] = Parameter("A", check=invertible, tuned=lambda tuning: 1.0)
    force_gain: Gain = Gain("K_z", tuned=lambda tuning: tuning.amplification(1.0))
    holding: Parameter[Sequence[Potential], tuple[Potential, ...]] = Parameter("U", default=(), check=_potentials)
    feedforward: Flag = Flag(default=True)
    approach_speed: Parameter[float | None, float] = Parameter(
        "v_max", "rad/s", default=None, check=lambda name, value, system: positive(name, value)
    )
    contact_threshold: Positive = Positive("", "N·m", default=1e-3)

    def prepare(self) -> None:
        """Make the potential of the desired force."""
        if self.approach_speed is None:
            self.approach_speed = math.inf
        if self.frame is None:
            self.desired: JointForce | PointForce = JointForce(vector("force", self.force, self.system.n))
        else:
            self.desired = PointForce(self.frame, self.force)
        self._held = Sum(*self.holding)
        super().prepare()

    def shaped(self) -> Potential:
        """Return f_dᵀq, or Fᵀr(q), plus U: Ψ where f_d acts."""
        return self.desired + self._held

    @property
    def _feels(self) -> bool:
        return True

    @property
    def caveat(self) -> str:
        """Say that a law with an approach-speed limit is switched."""
        return "passivity across the contact: H_d jumps there" if math.isfinite(self.approach_speed) else ""

    @property
    def driven_by(self) -> str:
        """Without feedforward, and until there is contact under a speed limit, the desired force; and a path."""
        own = "f_d until there is contact, which moves w" if math.isfinite(self.approach_speed) else ""
        if not self.feedforward:
            own = "f_d, which moves w: no storage function but for constant T (errata E23)"
        return "; ".join(filter(None, (own, super().driven_by)))

    @property
    def lacks_minimum(self) -> str:
        """The law rests in contact only."""
        return "stability in contact: Ψ has a minimum only with the potential of what is pressed"

    def target_posture(self, t: float) -> Array | None:
        """Return None: where the arm rests is for the body to say that it presses on."""
        return None

    def rest_posture(self, t: float) -> Array:
        """Return where U is smallest: that of the reference, the posture that is held, or one near home [rad]."""
        if self._trajectory is not None:
            return self._trajectory.at(t).position
        held = self._held.posture
        return super().rest_posture(t) if held is None or self._path is not None else held

    @property
    def _least_at_rest(self) -> Potential:
        """U: in contact f_d is what the environment answers with."""
        return self._held

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

    def _acts(self, measured: Measured) -> bool:
        """Whether f_d acts: as feedforward and part of Ψ; else it drives w alone."""
        return self.feedforward and not self._approaches(measured)

    def _aim(self, t: float, x: MechanicalState, measured: Measured) -> Aim:
        return self.aim(t, x, self.potential if self._acts(measured) else self._held)

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d = ½|p̂|² + Ψ + ½wᵀK_z⁻¹w [J], Ψ = U without feedforward and while the arm approaches."""
        return self._stored(self._aim(t, x, measured), state)

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State ϑ = −A w, the rate of w, and the effort −f_d − ∂U/∂q − G C ŷ."""
        aim = self._aim(t, x, measured)
        leading = x.solve_factor_transposed(self.coupling.dot(state))
        rate = self._rate(aim, measured)
        if self._approaches(measured) and self._is_held(leading, state, rate):
            rate = np.zeros_like(rate)
        return Shaping(
            -(aim.gradient + x.injected_damping(self.damping, aim.velocity - leading)),
            *aim.shift(),
            offset_rate=self._negative_coupling.dot(rate),
            state_rate=rate,
        )

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return the port of the dynamic extension; holding w takes wᵀK_z⁻¹ẇ beside."""
        port = super().passive_port(t, x, state, measured)
        if not self._approaches(measured):
            return port
        rate = self._rate(self._aim(t, x, measured), measured)
        if not self._is_held(x.solve_factor_transposed(self.coupling.dot(state)), state, rate):
            return port
        taken = float(state.dot(self._storage_gain.dot(rate)))
        return port._replace(dissipated_power=port.dissipated_power + taken)

    def _rate(self, aim: Aim, measured: Measured) -> Array:
        """Return ẇ where w is not held; in approach what is measured is below the threshold, and no force."""
        force = self._measurement(measured, "external_force")
        driving = -aim.gradient if self._approaches(measured) else force - aim.gradient
        if not self._acts(measured):
            driving -= self.desired.gradient(aim.x)
        rate: Array = self._motion_rate(aim.x, aim.velocity, driving).dot(self._port)
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
        """Return the closed loop on (position coordinates, p̂, w); where f_d does not act it drives w as an input."""
        aim, along = self.aim(t, x), super().drive(t, x, measured)
        momentum = aim.momentum - self.coupling.dot(state)
        if self._acts(measured):
            return self._extended(aim, aim.error, momentum, state, drive=along)
        coordinates, gradient = aim.error
        gradient[: len(self.desired.coordinates(x))] = 0.0
        approaching, inverse = self._approaches(measured), x.inverse_factor
        lost = {}
        if approaching:
            rate = self._rate(self._aim(t, x, measured), measured)
            if self._is_held(x.solve_factor_transposed(self.coupling.dot(state)), state, rate):
                lost = {("force", "force"): np.outer(rate, rate) / state.dot(self._storage_gain.dot(rate))}
        drive: DrivenParts = {"force": -self._port.T @ x.solve_factor(self.desired.lever(x))}, self.desired.force
        if along is not None:
            drive = joined(drive, along)
        port = {MOMENTUM: inverse} if approaching else {MOMENTUM: inverse, "force": self._port.T @ inverse}
        return self._extended(aim, (coordinates, gradient), momentum, state, port, lost, drive)
