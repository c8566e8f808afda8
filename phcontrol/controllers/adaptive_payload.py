"""Position control and tracking that find out what the hand carries (docs/theory.md)."""

from __future__ import annotations

from typing import Any

import numpy as np

from phcontrol._lazy import lazy
from phcontrol._validation import Array, gain, text
from phcontrol.controllers.aim import Aim
from phcontrol.controllers.parameters import Gain, Parameter
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.controllers.position_law import PositionLaw
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.target import MOMENTUM, Target
from phcontrol.controllers.tuning import Tuning
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.body_torques import PARAMETERS, body_at, body_torques
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import NOTHING, Measured

_SCALES = np.array([1.0, *(0.1,) * 3, *(0.02,) * 6])  # of a usual body: [kg], [kg m], [kg m²]
_SPEED = 20.0  # of default estimates of the mass, where its weight is felt most [1/s]
_ERROR_RATE = 1.0  # Λ of default gains [1/s]
_POSTURES = 16  # at which the weight of a body is looked at, beside the goal and home
_LEAST = 1e-9  # of what a kilogramme asks for, below which it is not felt


def _frame(name: str, value: Any, system: MechanicalSystem) -> str:
    index = system.frame_id(text(name, value))
    if system.model.frames[index].parentJoint == 0:
        raise InvalidArgumentError(name, f"'{value}' is fixed to the base: nothing moves it")
    return str(value)


def _hand(system: MechanicalSystem) -> str:
    """Return the hand's frame, or where that does not move the last one that does."""
    model, robot = system.model, system.robot
    moved = [name for name in robot.frame_names if model.frames[robot.frame_id(name)].parentJoint > 0]
    return system.hand_frame if system.hand_frame in moved else moved[-1]


def _adaptation(name: str, value: Any, system: MechanicalSystem) -> Array:
    return gain(name, value, PARAMETERS)


def _actual(name: str, value: Any, system: MechanicalSystem) -> MechanicalSystem:
    plant = MechanicalSystem(value) if isinstance(value, Robot) else value
    if not isinstance(plant, MechanicalSystem):
        raise InvalidArgumentError(name, f"must be a Robot or a MechanicalSystem, but is {type(value).__name__}")
    if plant.robot.joint_names != system.robot.joint_names:
        raise InvalidArgumentError(name, f"must have the joints of the model, {', '.join(system.robot.joint_names)}")
    return plant


def _usual_adaptation(tuning: Tuning) -> Array:
    """Return Γ with which the weight of a mass at the hand is found at about _SPEED, other parameters in proportion."""
    system, generator = tuning.system, np.random.default_rng(0)
    robot, frame, nothing = system.robot, _hand(system), np.zeros(system.n)
    postures = [tuning.posture, robot.home, *(robot.random_position(generator) for _ in range(_POSTURES))]
    felt = 0.0
    for posture in postures:  # where weight is felt most: elsewhere it is found more slowly
        torques = body_torques(system.at(posture), frame, nothing, nothing) * _SCALES
        felt = max(felt, float(np.max(np.einsum("ij,ij->j", torques, np.linalg.solve(tuning.damping, torques)))))
    adaptation: Array = np.diag((_SPEED / felt if felt > _LEAST else 1.0) * _SCALES**2)
    return adaptation


class AdaptivePayload(PositionLaw):
    """Hold a position or follow a motion with a body in the hand that the model does not know, and find it out.

        s = Γ_e∂Ψ/∂q,   q̇_r = q̇_ref − s,   p̂ = Tᵀ(q̇ − q̇_r),   π̂̇ = −ΓYᵀ(q̇ − q̇_r)
        u = G⁻¹(M₀q̈_r + C₀q̇_r + ∂V₀/∂q + D q̇_r + Yπ̂ − ∂Ψ/∂q) − C Gᵀ(q̇ − q̇_r)

    Index 0 is the model; the true arm has a body π more, ten parameters, at ``frame``, and Y(q, q̇, q̇_r, q̈_r)π is what
    it adds (``body_torques``). With π̃ = π̂ − π the closed loop on (error, p̂, π̃), T, J̄₂ and D̄ being those of the true
    arm, is

        [[−AΓ_eAᵀ, A T⁻ᵀ, 0], [−T⁻¹Aᵀ, J̄₂ − D̄ − ḠCḠᵀ, T⁻¹YΓ], [0, −ΓYᵀT⁻ᵀ, 0]] ∇H_d,
        H_d = ½|p̂|² + Ψ + ½π̃ᵀΓ⁻¹π̃,

    and f_e enters as [0; T⁻¹; 0]. The structure is that of J.-J. Slotine and W. Li, "On the adaptive control of robot
    manipulators", Int. J. Robotics Research 6(3), 1987.

    The error goes to zero. The estimate goes to π as far as the motion tells it: at rest its weight alone. What pushes
    at the hand for long is taken for a body.

    A law does not know π; its promise must. ``actual`` is the arm with its body, on which a certificate is made and
    H_d computed; the torque does not use it. Without it the promise is that of an arm without a body, π = 0.

    Args:
        system: the model of the arm, without the body.
        goal: q_d [rad].
        stiffness: K_p, scalar, vector or matrix, positive definite [N·m/rad].
        potential: Ψ in place of these two.
        reference: along what, by default a goal at rest.
        damping: C, scalar, vector or matrix, positive definite [N·m·s/rad].
        compliance: Γ_e, likewise [rad/(N·m·s)]; Γ_eK_p is the rate at which errors of a spring fade.
        adaptation: Γ, scalar, vector or (10, 10) matrix, positive definite, in units of parameters squared a joule.
        frame: that carries the body, by default the tool frame or the hand.
        actual: the arm as it is, a Robot or a MechanicalSystem.

    Example:
        >>> from phcontrol import AdaptivePayload, MechanicalSystem, Payload, certify, load_robot
        >>> model = MechanicalSystem(load_robot("pera"))
        >>> arm = MechanicalSystem(load_robot("pera", payload=Payload(0.5, frame=model.hand_frame)))
        >>> certify(AdaptivePayload.tuned(model, actual=arm), arm, samples=8).verdict
        'PASSED'
    """

    name = "adaptive_payload"
    forms = ("coriolis",)

    compliance: Gain = Gain("Γ_e", "rad/(N·m·s)", tuned=lambda tuning: _ERROR_RATE * np.linalg.inv(tuning.stiffness))
    adaptation: Parameter[Any, Array] = Parameter("Γ", "kg²/J", check=_adaptation, tuned=_usual_adaptation)
    frame: Parameter[str | None, str] = Parameter(default=None, check=_frame, tuned=lambda tuning: _hand(tuning.system))
    actual: Parameter[Any, MechanicalSystem | None] = Parameter(default=None, check=_actual)

    def prepare(self) -> None:
        """Compute what the promise needs: Γ⁻¹, and the body that the true arm carries."""
        super().prepare()
        if self.frame is None:
            self.frame = _hand(self.system)
        self._inverse_adaptation: Array = np.array(np.linalg.inv(self.adaptation), dtype=float)
        self._plant: MechanicalSystem = self.system if self.actual is None else self.actual

    @lazy
    def body(self) -> Array:
        """π, the ten parameters that the true arm has more at the frame; zero without ``actual``."""
        if self.actual is None:
            return np.zeros(PARAMETERS)
        carrying, bare = body_at(self.actual.robot, self.frame), body_at(self.system.robot, self.frame)
        return carrying - bare

    @property
    def states(self) -> tuple[str, ...]:
        """The estimate π̂."""
        return ("parameter",)

    @property
    def state_parts(self) -> dict[str, int]:
        """Ten parameters."""
        return {"parameter": PARAMETERS}

    @property
    def lacks_minimum(self) -> str:
        """The estimate may rest elsewhere than at the truth."""
        return "a minimum of H_d at the true body, beside which estimates rest that the motion does not tell from it"

    @property
    def caveat(self) -> str:
        """What is not estimated."""
        return "that the estimate goes to the true body: it does as far as the motion tells it"

    def estimate(self, state: Array) -> tuple[float, Array]:
        """Return the estimated mass [kg] and first moment m·c in the frame's axes, shape (3,) [kg m]."""
        return float(state[0]), np.array(state[1:4])

    def random_state(self, generator: np.random.Generator) -> Array:
        """Draw an estimate."""
        state: Array = generator.normal(size=PARAMETERS) * _SCALES
        return state

    def promised_state(self, x: MechanicalState) -> MechanicalState:
        """Return the state as the arm with the body has it."""
        return x.seen_by(self._plant)

    def _led(self, aim: Aim) -> tuple[Array, Array, Array]:
        """Return q̇ − q̇_r, q̇_r and q̈_r."""
        s, s_rate = aim.shift(self.compliance.dot(aim.gradient), self.compliance.dot(aim.gradient_rate()))
        assert s is not None
        assert s_rate is not None
        return aim.x.velocity + s, -s, -s_rate

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State s = −q̇_r, the effort Yπ̂ − ∂Ψ/∂q − G C ŷ, and π̂̇."""
        aim = self.aim(t, x)
        slip, velocity, acceleration = self._led(aim)
        torques = body_torques(x, self.frame, velocity, acceleration)
        return Shaping(
            torques.dot(state) - aim.gradient - self.joint_damping(t, x).dot(slip),
            -velocity,
            -acceleration,
            state_rate=-self.adaptation.dot(torques.T.dot(slip)),
        )

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d = ½|p̂|² + Ψ + ½π̃ᵀΓ⁻¹π̃ [J]."""
        y = self.promised_state(x)
        aim = self.aim(t, y)
        momentum, error = self._led(aim)[0].dot(y.factor), state - self.body
        return float(0.5 * (momentum.dot(momentum) + error.dot(self._inverse_adaptation.dot(error)))) + aim.energy

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return Gᵀv, vᵀ(D + GCGᵀ)v + (∂Ψ/∂q)ᵀΓ_e∂Ψ/∂q and (D + GCGᵀ)v with v = q̇ − q̇_r."""
        aim = self.aim(t, x)
        slip = self._led(aim)[0]
        losses = aim.gradient.dot(self.compliance.dot(aim.gradient))
        return PassivePort.of(x, slip, self.joint_damping(t, x).dot(slip), slip, float(losses))

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (error, p̂, π̃)."""
        y = self.promised_state(x)
        aim = self.aim(t, y)
        slip, velocity, acceleration = self._led(aim)
        momentum, error = slip.dot(y.factor), state - self.body
        A = aim.coordinate_map

        def coupling() -> Array:
            torques = body_torques(y, self.frame, velocity, acceleration)
            result: Array = y.solve_factor(torques.dot(self.adaptation))
            return result

        return Target.of(
            {
                "error": aim.error,
                MOMENTUM: (momentum, momentum),
                "parameter": (error, self._inverse_adaptation.dot(error)),
            },
            lambda: {
                ("error", MOMENTUM): aim.coupling,
                (MOMENTUM, MOMENTUM): y.interconnection(self.interconnection),
                (MOMENTUM, "parameter"): coupling(),
            },
            lambda: {
                ("error", "error"): A @ self.compliance @ A.T,
                (MOMENTUM, MOMENTUM): y.transformed_damping + y.transformed(self.joint_damping(t, y)),
            },
            lambda: {MOMENTUM: y.inverse_factor},
            self.drive(t, x, measured),
        )
