"""Statements of chapters 5 and 6: how features move, power balances of the servo laws, the tracking transformation."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.optimize import root

from phcontrol._differences import central_difference
from phcontrol._validation import Array
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.hamiltonian_servo import HamiltonianServo
from phcontrol.controllers.reduction_servo import ReductionServo
from phcontrol.controllers.visual_servo import OBJECT_LENGTH
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.mechanics.transformations import check_canonical_transformation
from phcontrol.sensors.measured import Measured
from phcontrol.simulation.closed_loop import simulate
from phcontrol.thesis.claim import Claim
from phcontrol.thesis.exact import exact, off, rate, slope
from phcontrol.thesis.fig_5_3 import GOAL, POSTURE, PRINTED_DAMPING, PRINTED_GAIN, START
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.origin import Origin
from phcontrol.thesis.statements_plant import SAMPLES, SEED, shoulder
from phcontrol.thesis.tracking import GAINS, sinusoid
from phcontrol.trajectories.tracking_transformation import TrackingTransformation
from phcontrol.vision.feature_flow import FeatureFlow
from phcontrol.vision.goal_posture import goal_posture
from phcontrol.vision.interaction import back_project, interaction_matrix, project
from phcontrol.vision.observed_object import ObservedObject
from phcontrol.vision.pinhole_camera import PinholeCamera

FOCAL = PinholeCamera().focal_length  # [m]
SERVO_TIME, STARTS = 20.0, 100  # [s]; starts of the inverse kinematics


def vision_claims() -> list[Claim]:
    """Return the claims of chapter 5 that no figure shows."""
    return [*_features(), _posture(), *_balances(), _reached()]


def tracking_claims() -> list[Claim]:
    """Return the claims of chapter 6 that no figure shows."""
    return [_transformation()]


def _features() -> list[Claim]:
    generator = np.random.default_rng(SEED)
    errors = dict.fromkeys(("point printed", "point", "camera printed", "camera"), 0.0)
    for _ in range(SAMPLES):
        seen = np.array([*generator.uniform(-2e-3, 2e-3, 2), generator.uniform(1e-3, 3e-3)])
        point = back_project(seen, FOCAL, OBJECT_LENGTH)
        velocity, twist = generator.normal(size=3), generator.normal(size=6)
        Z = point[2]
        moved = central_difference(partial(_moved, point, velocity), 1e-4)
        for name, last in (("point printed", FOCAL / Z), ("point", -seen[2] / Z)):
            rows = np.array([[FOCAL / Z, 0.0, -seen[0] / Z], [0.0, FOCAL / Z, -seen[1] / Z], [0.0, 0.0, last]])
            errors[name] = max(errors[name], off(rows @ velocity, moved))
        shown = central_difference(partial(_shown, point, twist), 1e-4)
        delta = interaction_matrix(seen, FOCAL, OBJECT_LENGTH)
        printed = delta.copy()
        printed[2, 2] *= -1.0
        errors["camera printed"] = max(errors["camera printed"], off(printed @ twist, shown))
        errors["camera"] = max(errors["camera"], off(delta @ twist, shown))
    return [
        exact("features-of-a-point", "the features of a point that moves obey (5.2)", "section 5.1, (5.1), (5.2)",
              errors["point printed"], errors["point"], "E16"),
        exact("features-of-a-camera", "with the velocity of the camera they obey (5.3)", "section 5.1, (5.3)",
              errors["camera printed"], errors["camera"], "E17", "the velocity in the camera's own axes"),
    ]  # fmt: skip


def _moved(point: Array, velocity: Array, h: float) -> Array:
    """Return the features of a point that moves, after a time h."""
    return project(point + h * velocity, FOCAL, OBJECT_LENGTH)


def _shown(point: Array, twist: Array, h: float) -> Array:
    """Return the features of a point at rest, of a camera that moves, after a time h."""
    return project(pin.exp6(h * twist).actInv(point), FOCAL, OBJECT_LENGTH)


def _scene() -> tuple[MechanicalSystem, PinholeCamera, ObservedObject]:
    system = MechanicalSystem(load_robot("pera_shoulder_elbow"))
    camera = PinholeCamera().mounted_on(system.robot)
    return system, camera, ObservedObject.seen_as(camera, START, system.at(system.robot.home))


def _posture() -> Claim:
    """Hold where the arm ends to the postures that (5.1) and inverse kinematics give for the desired features."""
    system, camera, thing = _scene()
    law = HamiltonianServo(
        system, goal=GOAL, damping=PRINTED_DAMPING, rate=1.0, stiffness=1.0, singular_damping=0.0
    )  # gains of section 5.4.2
    scene = FeatureFlow(camera, START, OBJECT_LENGTH)
    end = simulate(system, law, duration=SERVO_TIME, dt=5e-3, scene=scene, torque_limit=None).position[-1]
    seen_at = np.array([GOAL[0], GOAL[1], FOCAL]) * OBJECT_LENGTH / GOAL[2]  # (X, Y, Z) of (5.1)

    def missing(q: Array) -> Array:
        place = system.robot.placement(str(camera.frame), q).act(seen_at)
        return np.asarray(place - thing.position)

    postures: list[Array] = []
    for start in np.random.default_rng(SEED).uniform(-np.pi, np.pi, size=(STARTS, 3)):
        found = root(missing, start, tol=1e-12).x
        if np.abs(missing(found)).max() < 1e-9 and all(_apart(found, other) > 1e-3 for other in postures):
            postures.append(found)
    nearest, *others = sorted(_apart(posture, end) for posture in postures) or [np.inf]
    return Claim(
        "posture-of-the-features", "the arm ends where (5.1) and inverse kinematics say, given τ_d: largest error of a "
        "joint", Origin.TEXT, "remark 5.2.1, (5.1)", (0.0,), "rad", 1e-3,
        [Finding((nearest,), "E16, E17, E19", chosen=f"{POSTURE}; the Hamiltonian law, after {SERVO_TIME:g} s")],
        reason=f"of {1 + len(others)} postures that inverse kinematics finds from {STARTS} random ones, it is the "
        "nearest: τ_d alone does not say which" + (f" (the next is {others[0]:.2g} rad away)" if others else ""),
    )  # fmt: skip


def _apart(one: Array, other: Array) -> float:
    """Return how far apart two postures are, in the joint that differs most, whole turns aside [rad]."""
    return float(np.abs(np.remainder(one - other + np.pi, 2.0 * np.pi) - np.pi).max())


def _balances() -> list[Claim]:
    system, _, thing = _scene()
    posture = goal_posture(system, thing, GOAL)
    options: dict[str, Any] = {"goal": GOAL, "damping": PRINTED_DAMPING}
    reduction = ReductionServo(system, **options, feature_gain=PRINTED_GAIN, posture=posture)
    hamiltonian = HamiltonianServo(system, **options, rate=1.0, stiffness=1.0, singular_damping=0.0)
    reduced = balanced = 0.0
    generator = np.random.default_rng(SEED)
    for _ in range(SAMPLES):
        q = system.robot.home + generator.uniform(-0.1, 0.1, 3)
        x = system.at(q, generator.normal(size=3))
        error = thing.features(x) - GOAL
        for law in (reduction, hamiltonian):
            target = law.target(0.0, x, np.zeros(law.state_size), Measured(features=thing.features(x)))
            hatted = target.momentum
            lost = hatted @ (x.transformed_damping + PRINTED_DAMPING * np.eye(3)) @ hatted
            grown = _grown(law, x, thing.features, half_momentum=law is reduction)
            if law is reduction:
                reduced = max(reduced, off(-lost, grown))
            else:
                balanced = max(balanced, off(-lost - error @ error, grown))
    return [
        exact("balance-reduction", "the rate of ½|p̂|² under the reduction law is (5.19)",
              "Theorem 5.2.2, (5.18), (5.19)", reduced, already="E16 to E18"),
        exact("balance-hamiltonian", "the rate of H̃ under the Hamiltonian law is (5.47)",
              "Theorem 5.2.3, (5.39), (5.47)", balanced, already="E16, E17, E19"),
    ]  # fmt: skip


def _grown(
    law: Controller, x: MechanicalState, features: Callable[[MechanicalState], Array], *, half_momentum: bool
) -> float:
    """Return the rate of ½|p̂|², or of the storage function, along the true motion of arm and features [W]."""
    command = law.evaluate(0.0, x, np.zeros(law.state_size), Measured(features=features(x)))

    def stored(there: MechanicalState, own: Array) -> float:
        seen = Measured(features=features(there))
        if not half_momentum:
            return law.storage(0.0, there, own, seen)
        momentum = law.target(0.0, there, own, seen).momentum
        return 0.5 * float(momentum @ momentum)

    return float(rate(stored, x, x.acceleration(command.torque), np.zeros(law.state_size), np.zeros(law.state_size)))


def _reached() -> Claim:
    """Measure how far the camera is from the object where its features are the desired ones."""
    system, camera, thing = _scene()
    pose = system.robot.placement(str(camera.frame), goal_posture(system, thing, GOAL))
    away = float(np.linalg.norm(pose.translation - thing.position))
    return Claim(
        "camera-at-object", "where the features are the desired ones, the camera is at the object: distance",
        Origin.TEXT, "section 5.4.2", (0.0,), "mm", 10.0, [Finding((1e3 * away,), chosen="L = 38 mm")],
        reason=f"an object of 38 mm that is 2 mm long in the image is f L/l_d = "
        f"{1e3 * FOCAL * OBJECT_LENGTH / GOAL[2]:.0f} mm away; for L = 7.2 or 10 mm it would be 36 or 50 mm. Whatever "
        f"f and L are, the camera ends l(0)/l_d = {START[2] / GOAL[2]:.0f} times as far from the object as it began: "
        "by (5.1) it goes away from it. What does go to zero is the object's distance from the camera's axis",
    )  # fmt: skip


def _transformation() -> Claim:
    system, trajectory = shoulder(), sinusoid(1 / 30)
    stiffness = GAINS["stiffness"] * np.eye(2)
    corrected = TrackingTransformation(system, trajectory, stiffness)

    def kinetic(q: Array, v: Array) -> float:
        return float(v @ system.at(q).mass_matrix @ v)

    def printed_energy(q: Array, p: Array, t: float) -> float:
        """Return U of (6.6): without the potential."""
        v = trajectory.at(t).velocity
        return float(-p @ v) + 0.5 * kinetic(q, v)

    def printed_input(q: Array, p: Array, t: float) -> Array:
        """Return β of (6.14): with all of ∂(q̇_dᵀMq̇_d)/∂q, and without ∂(−V + ½q̃ᵀK_t q̃)/∂q."""
        goal, x = trajectory.at(t), system.at(q)
        shaped = stiffness @ x.position_error(goal.position) - x.potential_gradient
        kept: Array = corrected.input_change(q, p, t) - shaped
        return kept + 0.5 * slope(lambda y: kinetic(y, goal.velocity), q)

    def residual(energy: Any, change: Any) -> float:
        return check_canonical_transformation(corrected.coordinates, energy, change, system, samples=SAMPLES).residual

    return exact(
        "tracking-transformation", "U of (6.6) and β of (6.14) make a generalised canonical transformation of (6.2)",
        "section 6.1, (6.2), (6.6), (6.11) to (6.14)", residual(printed_energy, printed_input),
        residual(corrected.energy_change, corrected.input_change), "E22", origin=Origin.THEOREM,
    )  # fmt: skip
