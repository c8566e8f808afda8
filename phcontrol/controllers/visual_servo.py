"""What the two laws of visual servoing share: features, image Jacobian, default gains, losing the object."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, choice, vector
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.parameters import Gain, NonNegative, Parameter, Positive
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.target import MOMENTUM, Target
from phcontrol.controllers.tuning import Tuning
from phcontrol.exceptions import InvalidArgumentError, ObjectLostError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import NOTHING, Measured
from phcontrol.vision.interaction import back_project, interaction_matrix
from phcontrol.vision.observed_object import ObservedObject
from phcontrol.vision.pinhole_camera import PinholeCamera
from phcontrol.vision.scene import Scene

_SINGULAR = 1e-6  # ratio of singular values of the image Jacobian below which it is singular

LOST = ("error", "hold")
FEATURE_GOAL = (0.0, 0.0, 0.002)
"""τ_d by default [m]: in the middle of the image, 2 mm long (thesis section 5.4)."""
OBJECT_LENGTH = 0.038
"""L by default [m] (thesis section 5.4)."""


def _camera(name: str, value: object, system: MechanicalSystem) -> PinholeCamera:
    if not isinstance(value, PinholeCamera):
        raise InvalidArgumentError(name, f"must be a PinholeCamera, but is {type(value).__name__}")
    return value


class View(NamedTuple):
    """What a law makes of its features at one state."""

    error: Array
    """τ̄ = τ − τ_d, shape (3,) [m]."""
    image_jacobian: Array
    """Δ̄ = Δ(τ)𝒥(q), shape (3, n): τ̇ = Δ̄q̇ [m/rad]."""


class VisualServo(Controller):
    """Laws with p̂ = p̄ + Tᵀs(q, τ) that bring image features τ to τ_d (thesis chapter 5).

    The features are measured (``Measured.features``), with a camera in the arm's hand; τ̇ = Δ̄q̇ for an object at rest.
    When the object is not seen (features not finite, l <= 0, outside the image) no torque is made of them:
    with ``lost="error"`` ObjectLostError is raised; with ``lost="hold"`` the arm is braked and rests where it is,
    with gravity compensated, until the object is seen again:

        s = 0,   p̄̇ = (J̄₂ − D̄ − C)p̄,   H_d = ½|p̄|².

    A law that takes over again starts with a jump of torque; stability of the switched loop is not claimed.
    """

    run = "servo"

    goal: Parameter[ArrayLike, Array] = Parameter(
        "τ_d", "m", check=lambda name, value, system: _features(value), tuned=lambda tuning: tuning.goal
    )
    damping: Gain = Gain("C", "1/s", tuned=lambda tuning: 5.0)
    posture: Parameter[ArrayLike | None, Array] = Parameter(
        "q_r", "rad", default=None, check=lambda name, value, system: vector(name, value, system.n)
    )
    posture_gain: NonNegative = NonNegative(
        "k_n", "1/s", default=0.0, tuned=lambda tuning: 2.0 if tuning.system.n > 3 else 0.0
    )
    camera: Parameter[PinholeCamera | None, PinholeCamera] = Parameter(default=None, check=_camera)
    frame: Parameter[str | None, str] = Parameter(default=None, check=lambda name, value, system: value)
    object_length: Positive = Positive("L", "m", default=OBJECT_LENGTH)
    lost: Parameter[str, str] = Parameter(default=LOST[0], check=lambda name, value, system: choice(name, value, LOST))

    def prepare(self) -> None:
        """Mount the camera, and see whether the posture can be held."""
        system = self.system
        if system.n < 3:
            raise InvalidArgumentError(
                "system", f"has {system.n} joints, but three features need an arm of at least three ({self.name})"
            )
        if self.posture is None:
            self.posture = system.robot.home
        self.camera = (PinholeCamera() if self.camera is None else self.camera).mounted_on(system.robot, self.frame)
        self.frame = str(self.camera.frame)
        self._focal_length = self.camera.focal_length
        self._holds_posture = self.posture_gain > 0.0 and system.n > 3
        self._check_regular()
        even = np.allclose(self.damping, self.damping[0, 0] * np.eye(system.n), rtol=1e-14, atol=0.0)
        self._even_damping = float(self.damping[0, 0]) if even else None

    def _check_regular(self) -> None:
        """Refuse a posture at which three features do not follow from how the joints move: it would not rest there."""
        values = np.linalg.svd(self.view(self.system.at(self.posture), self.goal).image_jacobian, compute_uv=False)
        if values[-1] < _SINGULAR * values[0]:
            raise InvalidArgumentError(
                "posture", f"the image Jacobian at the goal is singular there: name another one than {self.posture}"
            )

    @classmethod
    def check_goal(cls, system: MechanicalSystem, goal: ArrayLike | None) -> Array:
        """Return τ_d = (μ, ν, l) [m], by default in the middle of the image and 2 mm long."""
        return _features(FEATURE_GOAL if goal is None else goal)

    @classmethod
    def tuning(cls, system: MechanicalSystem, goal: Array, **desired: float | None) -> Tuning:
        """Return what the default gains are made from; they do not depend on the posture."""
        return Tuning(system, goal, system.robot.home, **desired)

    @property
    def needs(self) -> tuple[str, ...]:
        """The image features."""
        return ("features",)

    def target_posture(self, t: float) -> Array | None:
        """Return the posture that the null space is held at; None where the features alone decide."""
        return self.posture if self._holds_posture else None

    def desired_posture(self, t: float, state: Array) -> Array | None:
        """Return None: the features decide where the arm goes, and q_r only what they leave free."""
        return None

    # --- what a law of this kind states --------------------------------------------------------------

    @abstractmethod
    def servo_motion(self, x: MechanicalState, features: Array) -> tuple[Array, Array, Array]:
        """Return s, ṡ along q̇ (shape (n,) each) and τ̄-dependent effort beside the damping, shape (n,) [N·m]."""

    @abstractmethod
    def servo_velocity(self, x: MechanicalState, features: Array) -> Array:
        """Return s(q, τ), shape (n,) [rad/s]."""

    # --- the law -------------------------------------------------------------------------------------

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State s, ṡ and the effort −T C p̂ plus what the law adds; when the object is not seen, error or hold."""
        features = self._measurement(measured, "features")
        if not self.camera.sees(features):
            if self.lost == "error":
                raise ObjectLostError(self.name, t, features, self.camera.why_not_seen(features))
            return Shaping(self._braking(x, x.velocity))
        s, s_rate, effort = self.servo_motion(x, features)
        return Shaping(effort + self._braking(x, x.velocity + s), s, s_rate)

    def _braking(self, x: MechanicalState, velocity: Array) -> Array:
        """Return −T C Tᵀv [N·m]."""
        if self._even_damping is not None:
            force: Array = x.mass_matrix.dot(velocity)
            force *= -self._even_damping
            return force
        force = x.factor.dot(self.damping.dot(velocity.dot(x.factor)))
        return -force

    def view(self, x: MechanicalState, features: Array) -> View:
        """Return τ̄ and Δ̄ at a state."""
        delta = interaction_matrix(features, self._focal_length, self.object_length)
        return View(features - self.goal, delta.dot(x.frame_jacobian(self.frame, "local")))

    def seen(self, measured: Measured) -> Array | None:
        """Return the measured features, or None when no object is seen."""
        features = self._measurement(measured, "features")
        return features if self.camera.sees(features) else None

    def adapted_momentum(self, x: MechanicalState, measured: Measured) -> Array:
        """Return p̂ = p̄ + Tᵀs, shape (n,); p̄ when no object is seen."""
        features = self.seen(measured)
        s = 0.0 if features is None else self.servo_velocity(x, features)
        momentum: Array = (x.velocity + s).dot(x.factor)
        return momentum

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d = ½|p̂|², to which a law may add [J]."""
        momentum = self.adapted_momentum(x, measured)
        return float(0.5 * momentum.dot(momentum))

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return Gᵀv, p̂ᵀ(D̄ + C)p̂, and (D + T C Tᵀ)v, v = T⁻ᵀp̂ = q̇ + s."""
        features = self.seen(measured)
        motion = x.velocity if features is None else x.velocity + self.servo_velocity(x, features)
        return PassivePort.of(x, motion, x.factor.dot(self.damping.dot(motion.dot(x.factor))), motion)

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return p̂̇ = (J̄₂ − D̄ − C)p̂ + T⁻¹f_e, to which a law may add."""
        momentum = self.adapted_momentum(x, measured)
        return Target.of(
            {MOMENTUM: (momentum, momentum)},
            lambda: {(MOMENTUM, MOMENTUM): x.interconnection(self.interconnection)},
            lambda: {(MOMENTUM, MOMENTUM): x.transformed_damping + self.damping},
            lambda: {MOMENTUM: x.inverse_factor},
        )

    # --- what checks look at ----------------------------------------------------------------------------

    @property
    def eyes(self) -> VisualServo:
        """The law itself."""
        return self

    def rest_posture(self, t: float) -> Array:
        """Return q_r, where Δ̄(goal) is taken."""
        return self.posture

    def rest_scene(self, x: MechanicalState) -> Scene:
        """Return an object whose features are the desired ones."""
        return self._object_seen_as(x, self.goal)

    def random_scene(self, x: MechanicalState, generator: np.random.Generator, spread: float = 1.0) -> Scene:
        """Draw an object in view, up to 27° from the axis, half to twice as far away as at the goal.

        With a smaller ``spread`` its features are closer to the goal. A law that holds when it sees nothing is now and
        then shown an object behind the camera, or beside the image of one that has an edge.
        """
        reach = [min(0.5 * self._focal_length, half) for half in self.camera.half_size]
        drawn = np.array(
            [generator.uniform(-reach[0], reach[0]), generator.uniform(-reach[1], reach[1]), 0.0]
        )  # fmt: skip
        drawn[2] = self.goal[2] * math.exp(generator.uniform(-math.log(2.0), math.log(2.0)))
        if self.lost == "hold" and generator.uniform() < 0.125:
            half = np.array(self.camera.half_size)
            if np.isfinite(half).all() and generator.uniform() < 0.5:
                drawn[:2] = np.where(drawn[:2] < 0.0, -1.0, 1.0) * half * generator.uniform(1.5, 3.0)
            else:
                drawn[2] = -drawn[2]
            return self._object_seen_as(x, drawn)
        return self._object_seen_as(x, self.goal + spread * (drawn - self.goal))

    def _object_seen_as(self, x: MechanicalState, features: Array) -> ObservedObject:
        point = back_project(features, self._focal_length, self.object_length)
        size = (self.object_length, 0.2 * self.object_length, 0.2 * self.object_length)
        return ObservedObject(self.camera, x.placement(self.frame).act(point), size)

    def measured_along(self, x: MechanicalState, measured: Measured, step: float) -> Measured:
        """Return the features of the same object, seen ``step`` seconds on."""
        features = self.seen(measured)
        if features is None:
            return measured
        there = x.system.at(x.position + step * x.velocity)
        point = x.placement(self.frame).act(back_project(features, self._focal_length, self.object_length))
        return measured._replace(features=self._projected(there.placement(self.frame).actInv(point)))

    def _projected(self, point: Array) -> Array:
        """Return (μ, ν, l) of a point in the camera's frame [m]."""
        scale = self._focal_length / point[2]
        return np.array([scale * point[0], scale * point[1], scale * self.object_length])


def _features(value: ArrayLike) -> Array:
    features = vector("goal", value, 3)
    if features[2] <= 0.0:
        raise InvalidArgumentError("goal", f"must have a length > 0 in the image, but has {features[2]:g} m")
    return features
