"""Visual servoing: derivatives, the thesis's own formulas, singularities, posture, losing the object, convergence."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from phcontrol import (
    FeatureFlow,
    HamiltonianServo,
    InvalidArgumentError,
    Measured,
    MechanicalSystem,
    MissingMeasurementError,
    NonFiniteTorqueError,
    ObjectLostError,
    ObservedObject,
    PinholeCamera,
    ReductionServo,
    SimulationError,
    StribeckFriction,
    certify,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.controllers.registry import CONTROLLERS
from phcontrol.mechanics.derivatives import right_inverse
from phcontrol.mechanics.singular_damping import SingularDamping
from phcontrol.mechanics.state import INTERCONNECTIONS
from phcontrol.vision.interaction import back_project
from tests.conftest import make_system
from tests.finite_differences import derivative, gradient

ARMS = ("pera_shoulder_elbow", "pera", "panda")
LAWS = ("reduction_servo", "hamiltonian_servo")
GOAL = np.array([0.0, 0.0, 0.002])
THESIS = {"goal": GOAL, "rate": 1.0, "stiffness": 1.0, "damping": 0.5, "singular_damping": 0.0}


def draw(system, rng):
    """A state in motion and features in view."""
    x = system.at(system.robot.random_position(rng), rng.normal(size=system.n))
    return x, np.array([*rng.uniform(-0.005, 0.005, size=2), rng.uniform(1e-3, 4e-3)])


def relative(actual, expected):
    return float(np.abs(actual - expected).max() / np.abs(expected).max())


# --- ∂θ/∂q and ∂θ/∂τ -------------------------------------------------------------------------------

VARIANTS = {
    "plain": {"singular_damping": 0.0, "posture_gain": 0.0},
    "posture": {"singular_damping": 0.0, "posture_gain": 2.0},
    "damped": {"singular_damping": 2e-3, "singular_region": 2e-2, "posture_gain": 0.0},
    "damped-posture": {"singular_damping": 2e-3, "singular_region": 2e-2, "posture_gain": 2.0},
}


@pytest.mark.parametrize("variant", list(VARIANTS))
@pytest.mark.parametrize("arm", ARMS)
def test_derivatives_of_the_momentum(arm, variant, rng):
    """∂θ/∂q and ∂θ/∂τ of θ = Tᵀs against finite differences of θ."""
    system = make_system(arm)
    law = make_controller("hamiltonian_servo", system, rate=np.diag([2.0, 1.5, 1.0]), **VARIANTS[variant])

    def theta(position, features):
        x = system.at(position)
        return law.servo_velocity(x, features) @ x.factor

    active = 0
    for _ in range(4):
        x, features = draw(system, rng)
        B = law.view(x, features).image_jacobian
        active += law.damping_of_singularities.at(B @ B.T) is not None
        by_position, by_features = law.momentum_derivatives(x, features)
        numeric = gradient(lambda q, t=features: theta(q, t), x.position, 1e-4).T
        assert relative(by_position, numeric) < 1e-6
        numeric = gradient(lambda t, q=x.position: theta(q, t), features, 1e-6).T
        assert relative(by_features, numeric) < 1e-6
    assert active == (4 if "damped" in variant else 0)  # what is to be tested is switched on


@pytest.mark.parametrize("variant", list(VARIANTS))
@pytest.mark.parametrize("arm", ARMS)
def test_fast_and_full_derivatives_agree(arm, variant, rng):
    """ṡ along the flow from Δ̄̇, and from the full ∂θ/∂q and ∂θ/∂τ: the same closed loop."""
    system = make_system(arm)
    law = make_controller("hamiltonian_servo", system, **VARIANTS[variant])
    for _ in range(5):
        x, features = draw(system, rng)
        s, s_rate, _ = law._motion_along_flow(x, features)
        full, full_rate, view = law._motion_by_gradients(x, features)
        np.testing.assert_allclose(s, full, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(s_rate, full_rate, atol=1e-9 * np.abs(full_rate).max())
        np.testing.assert_allclose(s, law.servo_velocity(x, features), rtol=1e-9, atol=1e-12)


# --- the thesis's formulas -------------------------------------------------------------------------


def thesis_torque(law, x, features, sign):
    """(5.27) with (5.28) and (5.29) written out; ``sign`` of ∂θ/∂q in β₁: printed −1, corrected +1 (errata E19)."""
    T, J2 = x.factor, x.canonical_interconnection
    error, B = law.view(x, features)
    by_position, by_features = law.momentum_derivatives(x, features)
    inverse = right_inverse(B)
    theta = T.T @ inverse @ error
    momentum = x.transformed_momentum + theta
    to_velocity = x.solve_factor_transposed(np.eye(x.system.n))
    beta_1 = sign * by_position @ to_velocity + by_features @ B @ to_velocity + law.damping
    beta_2 = -by_position @ inverse - by_features
    desired = (
        x.solve_factor(x.potential_gradient)
        + (J2 - x.transformed_damping) @ theta
        - beta_1 @ momentum
        - beta_2 @ error
        - x.solve_factor(B.T @ error)
    )
    return T @ desired  # v = Ḡ⁻¹[...], Ḡ = T⁻¹


@pytest.mark.parametrize("arm", ARMS)
def test_the_canonical_law_is_the_thesis_law_corrected(arm, rng):
    system = make_system(arm)
    law = HamiltonianServo(system, **THESIS, interconnection="canonical")
    for _ in range(3):
        x, features = draw(system, rng)
        torque = law.evaluate(0.0, x, np.zeros(0), Measured(features=features)).torque
        corrected = thesis_torque(law, x, features, +1.0)
        assert np.abs(torque - corrected).max() < 1e-9 * np.abs(torque).max()
        assert np.abs(torque - thesis_torque(law, x, features, -1.0)).max() > 1e-3 * np.abs(torque).max()


class WithoutGravity(ReductionServo):
    """(5.21) as printed: gravity is not compensated (errata E18)."""

    def servo_motion(self, x, features):
        s, s_rate, effort = super().servo_motion(x, features)
        return s, s_rate, effort - x.gravity


class PrintedInteraction(HamiltonianServo):
    """(5.3) as printed: −l²/(fL) (errata E17)."""

    def _motion_along_flow(self, x, features):
        s, s_rate, view = super()._motion_along_flow(x, features)
        view.image_jacobian[2] -= 2.0 * features[2] ** 2 / (0.01 * 0.038) * x.frame_jacobian("camera", "local")[2]
        return s, s_rate, view


@pytest.mark.parametrize("law", [WithoutGravity, PrintedInteraction])
def test_the_printed_laws_get_no_certificate(pera, law):
    certificate = certify(law.tuned(pera), samples=5)
    assert not certificate.matching_passed


# --- gains -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", INTERCONNECTIONS)
@pytest.mark.parametrize("singular", [{}, {"singular_damping": 2e-3, "singular_region": 2e-2}])
def test_coupled_gains_keep_the_loop_port_hamiltonian(pera, form, singular):
    """Λ not even symmetric: the skew part of Γ = ΛK⁻¹ goes into J_d, near singularities too."""
    rate = np.array([[2.0, 0.5, 0.0], [-0.5, 1.0, 0.3], [0.0, -0.4, 1.5]])
    stiffness = np.array([[100.0, 20.0, 0.0], [20.0, 80.0, 5.0], [0.0, 5.0, 120.0]])
    law = make_controller(
        "hamiltonian_servo", pera, rate=rate, stiffness=stiffness, damping=np.arange(1.0, 8.0), interconnection=form,
        **singular,
    )  # fmt: skip
    certificate = certify(law, samples=20)
    assert certificate.passed, str(certificate)
    assert certificate.indefiniteness < 1e-12


@pytest.mark.parametrize(
    ("law", "options", "complaint"),
    [
        ("hamiltonian_servo", {"rate": -1.0}, "rate: KΛ \\+ ΛᵀK must be positive definite"),
        ("hamiltonian_servo", {"rate": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]}, "KΛ \\+ ΛᵀK must be positive definite"),
        ("hamiltonian_servo", {"stiffness": 0.0}, "stiffness: must be positive definite"),
        ("hamiltonian_servo", {"singular_damping": -1.0}, "singular_damping: must be >= 0"),
        ("hamiltonian_servo", {"singular_region": 0.0}, "singular_region: must be > 0"),
        ("reduction_servo", {"feature_gain": np.ones((3, 7))}, r"feature_gain: must have shape \(7, 3\)"),
        ("reduction_servo", {"damping": -1.0}, "damping: must be positive definite"),
        ("reduction_servo", {"posture_gain": -1.0}, "posture_gain: must be >= 0"),
        ("reduction_servo", {"object_length": 0.0}, "object_length: must be > 0"),
        ("reduction_servo", {"goal": [0.0, 0.0, 0.0]}, "goal: must have a length > 0"),
        ("hamiltonian_servo", {"goal": [0.0] * 7}, r"goal: must have shape \(3,\)"),
    ],
)
def test_bad_gains_are_refused(pera, law, options, complaint):
    with pytest.raises(InvalidArgumentError, match=complaint):
        make_controller(law, pera, **options)


@pytest.mark.parametrize("length", [1e-3, 2e-3, 4e-3])
def test_the_singular_region_is_what_a_lever_of_five_centimetres_moves_in_the_image(pera, length):
    """ε is 0.05 m times how fast the length in the image, fL/z, changes with the distance z, by differences."""
    law = make_controller("hamiltonian_servo", pera, goal=[0.0, 0.0, length])
    size = law.camera.focal_length * law.object_length
    distance = size / length
    rate = derivative(lambda step: np.array(size / (distance - step)), 1e-3 * distance)
    assert law.singular_region == pytest.approx(0.05 * rate, rel=1e-6)
    assert law.singular_damping == pytest.approx(0.6 * law.singular_region)


@pytest.mark.parametrize("law", LAWS)
def test_arms_with_too_few_joints_are_refused(shoulder, law):
    with pytest.raises(InvalidArgumentError, match=r"has 2 joints, but \w+_servo needs at least 3"):
        make_controller(law, shoulder)
    with pytest.raises(InvalidArgumentError, match="has 2 joints, but three features need"):
        CONTROLLERS[law].law.tuned(shoulder)


def test_a_singular_goal_is_refused_by_the_reduction_law():
    system = make_system("pera_shoulder_elbow")
    with pytest.raises(InvalidArgumentError, match="posture: the image Jacobian at the goal is singular"):
        ReductionServo(system, goal=GOAL, damping=1.0, posture=[0.0, 0.7, 0.0])  # the arm stretched


# --- positive stability -----------------------------------------------------------------------------


def test_the_certificate_says_whether_the_reduction_law_is_stable_at_its_goal():
    system = make_system("pera_shoulder_elbow")
    for rate in (1.0, 0.5):
        certificate = certify(make_controller("reduction_servo", system, rate=rate), samples=3)
        assert list(certificate.conditions.values()) == pytest.approx([rate])  # Δ̄K_τ = Λ there
        assert certificate.passed
    away = make_controller("reduction_servo", system, rate=[1.0, 1.0, -0.5])
    certificate = certify(away, samples=3)
    assert certificate.matching_passed
    assert certificate.structure_passed
    assert not certificate.conditions_passed
    assert not certificate.passed
    assert "smallest real part of Δ̄K_τ [1/s], at the goal: -0.5, must be > 0 FAILED" in str(certificate)
    assert certificate.to_dict()["conditions"]


def test_the_certificate_says_whether_it_is_along_a_run(pera):
    law, scene = reduction_on(pera)
    log = simulate(pera, law, duration=1.0, dt=5e-3, scene=scene)
    conditions = certify(law, samples=2, log=log).conditions
    along = [
        np.linalg.eigvals(law.view(pera.at(q), t).image_jacobian @ law.feature_gain).real.min()
        for q, t in zip(log.position, log.features, strict=True)
    ]
    assert conditions["smallest real part of Δ̄K_τ [1/s], along the run"] == pytest.approx(min(along))


def reduction_on(system, **options):
    law = make_controller("reduction_servo", system, **options)
    x = system.at(system.robot.home)
    return law, ObservedObject.seen_as(law.camera, [0.002, -0.001, 0.0024], x)


# --- what the loops do, in closed form ----------------------------------------------------------------


def test_on_the_invariant_manifold_the_reduction_law_is_first_order():
    """With p̂ = 0 at the start p̂ stays 0, and τ̄̇ = −Δ̄K_τ τ̄: near the goal τ̄ decays as exp(−Λt)."""
    system = MechanicalSystem(load_robot("pera_shoulder_elbow"))
    law, _ = reduction_on(system, rate=np.array([[1.0, 0.3, 0.0], [0.0, 0.7, 0.2], [0.0, 0.0, 1.5]]))
    x = system.at(law.posture)
    error = np.array([2e-6, -1e-6, 1e-6])
    scene = ObservedObject.seen_as(law.camera, GOAL + error, x)
    start = -law.servo_velocity(x, GOAL + error)
    log = simulate(system, law, duration=2.0, dt=2e-3, v0=start, scene=scene)
    assert log.storage.max() < 1e-20
    rate = np.array([[1.0, 0.3, 0.0], [0.0, 0.7, 0.2], [0.0, 0.0, 1.5]])
    for row in (250, 500, 1000):
        np.testing.assert_allclose(log.features[row] - GOAL, expm(-rate * log.time[row]) @ error, atol=2e-9)


@pytest.mark.parametrize("form", INTERCONNECTIONS)
def test_the_hamiltonian_storage_function_balances_along_a_run(form):
    """Ḣ_d = supplied − dissipated, by the log's own finite differences, with a force from outside."""
    # friction without kinks: the finite differences of the balance would show them
    system = MechanicalSystem(load_robot("pera_shoulder_elbow"), friction=StribeckFriction(viscous=[0.5, 0.5, 0.2]))
    law = make_controller("hamiltonian_servo", system, interconnection=form)
    scene = FeatureFlow(law.camera, [0.01, 0.005, 0.004], law.object_length)
    log = simulate(system, law, duration=1.0, scene=scene, disturbance=[0.5, -0.5, 0.2])
    balance = log.power_balance()
    assert balance.relative_residual < 1e-6
    free = simulate(system, law, duration=1.0, scene=scene)
    assert np.diff(free.storage).max() <= 0.0


@pytest.mark.parametrize("law", LAWS)
def test_they_reach_the_goal_on_seven_joints(pera, law):
    controller, scene = reduction_on(pera) if law == "reduction_servo" else (None, reduction_on(pera)[1])
    controller = controller or make_controller(law, pera)
    log = simulate(pera, controller, duration=8.0, dt=5e-3, scene=scene)
    np.testing.assert_allclose(log.features[-1], GOAL, atol=5e-6)
    assert np.diff(log.storage).max() <= 1e-9 * log.storage[0]


def test_the_posture_is_held_in_what_the_features_leave_free(pera):
    """N(q − q_r) goes to zero with the posture term, and stays where it was without."""
    left = {}
    for posture_gain in (0.0, 2.0):
        law = make_controller("hamiltonian_servo", pera, posture_gain=posture_gain)
        turned = pera.robot.home + np.array([0.0, 0.0, 0.3, -0.3, 0.3, 0.0, 0.0])
        scene = ObservedObject.seen_as(law.camera, GOAL, pera.at(turned))
        log = simulate(pera, law, duration=8.0, dt=5e-3, q0=turned, scene=scene)
        np.testing.assert_allclose(log.features[-1], GOAL, atol=1e-6)
        B = law.view(pera.at(log.position[-1]), log.features[-1]).image_jacobian
        away = log.position[-1] - law.posture
        left[posture_gain] = np.linalg.norm(away - right_inverse(B) @ (B @ away))
    assert left[2.0] < 1e-3
    assert left[0.0] > 0.1


# --- near singularities --------------------------------------------------------------------------------


def singular_scene(law, x, distance):
    """An object at a distance from the line of the upper arm, on which det Δ̄ = 0 (theory: the singular set)."""
    shoulder, elbow = (x.placement(name).translation for name in ("shoulder", "forearm"))
    along = (elbow - shoulder) / np.linalg.norm(elbow - shoulder)
    camera = x.placement(law.frame)
    # on the line, in front of the camera; away from it in the arm's plane
    candidates = [shoulder + reach * along for reach in np.linspace(-3.0, 3.0, 601)]
    depths = np.array([(camera.rotation.T @ (point - camera.translation))[2] for point in candidates])
    point = candidates[int(np.argmin(np.abs(depths - 0.2)))]
    normal = x.frame_jacobian("forearm", "world")[3:, 1]
    return ObservedObject(law.camera, point + distance * np.cross(normal, along))


def test_the_singular_set_of_three_joints_is_exact(rng):
    """det Δ̄ = −(f³L/Z⁴)·a₂·(P·e_r)·d, d the distance of P, in the arm's plane, from the line of the upper arm."""
    system = make_system("pera_shoulder_elbow")
    law = make_controller("hamiltonian_servo", system)
    ratios = []
    for _ in range(6):
        x = system.at(system.robot.random_position(rng))
        features = np.array([*rng.uniform(-0.005, 0.005, size=2), rng.uniform(1e-3, 4e-3)])
        B = law.view(x, features).image_jacobian
        point = back_project(features, 0.01, 0.038)
        world = x.placement(law.frame).act(point)
        shoulder, elbow = (x.placement(name).translation for name in ("shoulder", "forearm"))
        axis = x.frame_jacobian("forearm", "world")[3:, 0]  # of the first joint
        normal = x.frame_jacobian("forearm", "world")[3:, 1]  # of the arm's plane
        radial = np.cross(normal, axis)  # e_r(q₁)
        line = (elbow - shoulder) / 0.32
        distance = np.dot(world - shoulder, np.cross(normal, line))
        formula = (0.01**3 * 0.038 / point[2] ** 4) * 0.32 * np.dot(world - shoulder, radial) * distance
        ratios.append(np.linalg.det(B) / formula)
    np.testing.assert_allclose(np.abs(ratios), 1.0, rtol=1e-9)
    assert len(set(np.sign(ratios))) == 1


@pytest.mark.parametrize("form", INTERCONNECTIONS)
@pytest.mark.parametrize("distance", [1e-2, 1e-3, 1e-5, 1e-8, 0.0])
def test_near_the_singular_set_the_damped_law_stays_finite_and_certified(distance, form):
    system = make_system("pera_shoulder_elbow")

    class Near(HamiltonianServo):
        def random_scene(self, x, generator, spread=1.0):
            scene = singular_scene(self, x, distance)
            return scene if self.camera.sees(scene.features(x)) else super().random_scene(x, generator, spread)

    certificate = certify(Near.tuned(system, interconnection=form), samples=10)
    assert certificate.passed, str(certificate)
    law = Near.tuned(system, interconnection=form)
    x = system.at(system.robot.home, np.array([0.3, -0.2, 0.1]))
    features = singular_scene(law, x, distance).features(x)
    damped = law.evaluate(0.0, x, np.zeros(0), Measured(features=features)).torque
    assert np.abs(damped).max() < 2e3  # bounded by 1/λ₀, whatever the distance
    undamped = Near.tuned(system, singular_damping=0.0, interconnection=form)
    if distance == 1e-8:
        assert np.abs(undamped.evaluate(0.0, x, np.zeros(0), Measured(features=features)).torque).max() > 1e5


def test_a_start_near_the_singular_set_needs_the_damping():
    """From one of a scan of random starts: without damping the first step throws the arm about, with it all is well."""
    system = MechanicalSystem(load_robot("pera_shoulder_elbow"))
    scene = ObservedObject(PinholeCamera(), [-0.555, -0.056, 1.392])
    run = {"duration": 5.0, "dt": 5e-3, "q0": [-2.65, 2.30, 2.36], "scene": scene, "torque_limit": None}
    undamped = make_controller("hamiltonian_servo", system, stiffness=1e3, singular_damping=0.0)
    with pytest.raises(SimulationError, match="lost its object"):
        simulate(system, undamped, **run)
    log = simulate(system, make_controller("hamiltonian_servo", system, stiffness=1e3), **run)
    np.testing.assert_allclose(log.features[-1], GOAL, atol=2e-6)
    assert np.abs(log.velocity).max() < 10.0


@pytest.mark.parametrize("form", INTERCONNECTIONS)
def test_near_singularities_of_a_redundant_arm_the_posture_term_fades(form):
    """Features of an object on the arm's own axes: the certificate holds with the posture term too."""
    system = make_system("pera")

    class Stretched(HamiltonianServo):
        def random_scene(self, x, generator, spread=1.0):
            return ObservedObject.seen_as(self.camera, [1e-7, 2e-7, 1e-5], x)  # far away: l² is next to nothing

    law = Stretched.tuned(system, interconnection=form)
    x = system.at(system.robot.home, np.full(7, 0.1))
    B = law.view(x, np.array([1e-7, 2e-7, 1e-5])).image_jacobian
    assert law.damping_of_singularities.at(B @ B.T) is not None
    certificate = certify(law, samples=10)
    assert certificate.passed, str(certificate)


@pytest.mark.parametrize("form", INTERCONNECTIONS)
@pytest.mark.parametrize("arm", ["pera_shoulder_elbow", "pera"])
def test_an_exactly_singular_undamped_law_gives_no_torque(arm, form):
    """An object so far away that its length no longer moves: the third row of Δ̄ is zero."""
    system = make_system(arm)
    measured = Measured(features=np.array([0.0, 0.0, 1e-170]))
    x = system.at(system.robot.home, np.full(system.n, 0.1))
    undamped = make_controller("hamiltonian_servo", system, singular_damping=0.0, interconnection=form)
    with pytest.raises(NonFiniteTorqueError):
        undamped.evaluate(0.0, x, np.zeros(0), measured)
    damped = make_controller("hamiltonian_servo", system, interconnection=form)
    assert np.isfinite(damped.evaluate(0.0, x, np.zeros(0), measured).torque).all()


def test_the_damping_is_smooth_and_its_slope_right(rng):
    """λ²(Δ̄Δ̄ᵀ) against its definition and its slope against finite differences; the quick test misses nothing."""
    weight = np.diag([1.0, 0.5, 0.8])
    damping = SingularDamping(3e-4, 5e-4, weight)
    root = np.diag(np.diag(weight) ** -0.5)
    inside = 0
    for _ in range(300):
        B = rng.normal(size=(3, 5)) * np.array([[1e-2], [1e-2], [10.0 ** rng.uniform(-5.0, -2.0)]])
        sigma = np.linalg.svd(root @ B, compute_uv=False)[-1]
        found = damping.at(B @ B.T)
        expected = 3e-4**2 * (1.0 - (sigma / 5e-4) ** 2) ** 2 if sigma < 5e-4 else 0.0
        assert (0.0 if found is None else found[0]) == pytest.approx(expected, rel=1e-6, abs=1e-16)
        if found is not None and sigma < 4e-4:
            inside += 1
            change = rng.normal(size=(3, 5)) * 1e-3

            def moved(h, B=B, change=change):
                return damping.at((B + h * change) @ (B + h * change).T)[0]

            numeric = derivative(moved, 1e-4)
            square_change = change @ B.T + B @ change.T
            assert np.vdot(found[1], square_change) == pytest.approx(numeric, rel=1e-5, abs=1e-12)
    assert inside > 50


# --- losing the object -----------------------------------------------------------------------------------

CAMERA = PinholeCamera(image_size=(640, 480), field_of_view=np.deg2rad(60.0))
UNSEEN = {
    "outside the image": ([0.006, 0.0, 0.002], "left the image"),
    "behind the camera": ([0.0, 0.0, -0.002], "Z <= 0"),
    "no length": ([0.0, 0.0, 0.0], "Z <= 0"),
    "not found": ([np.nan, np.nan, np.nan], "no object is found"),
    "half found": ([0.0, np.nan, 0.002], "no object is found"),
}


@pytest.mark.parametrize("case", list(UNSEEN))
@pytest.mark.parametrize("law", LAWS)
def test_no_torque_is_made_of_features_that_are_not_seen(pera, law, case):
    features, why = UNSEEN[case]
    measured = Measured(features=np.array(features))
    x = pera.at(pera.robot.home, np.linspace(-0.3, 0.3, 7))
    with pytest.raises(ObjectLostError, match=f"{law} lost its object at t = 1.5 s.*{why}") as caught:
        make_controller(law, pera, camera=CAMERA).evaluate(1.5, x, np.zeros(0), measured)
    np.testing.assert_array_equal(caught.value.features, features)
    hold = make_controller(law, pera, camera=CAMERA, lost="hold", damping=4.0)
    torque = hold.evaluate(1.5, x, np.zeros(0), measured).torque
    np.testing.assert_allclose(torque, x.gravity - 4.0 * x.mass_matrix @ x.velocity, rtol=1e-12, atol=1e-12)
    assert hold.storage(0.0, x, np.zeros(0), measured) == pytest.approx(x.kinetic_energy)


@pytest.mark.parametrize("law", LAWS)
def test_a_missing_measurement_is_named(pera, law):
    with pytest.raises(MissingMeasurementError, match=f"{law} needs the measurement 'features'"):
        make_controller(law, pera).evaluate(0.0, pera.at(pera.robot.home), np.zeros(0))


@pytest.mark.parametrize("law", LAWS)
def test_the_held_arm_has_a_certificate_too(pera, law):
    """p̄̇ = (J̄₂ − D̄ − C)p̄ while no object is seen."""
    kind = type(make_controller(law, pera))

    class Blind(kind):
        def random_scene(self, x, generator, spread=1.0):
            return ObservedObject.seen_as(self.camera, [0.02, 0.0, 0.002], x)

    for form in INTERCONNECTIONS:
        certificate = certify(Blind.tuned(pera, camera=CAMERA, lost="hold", interconnection=form), samples=10)
        assert certificate.passed, str(certificate)


def test_a_run_stops_with_its_log_or_holds_and_goes_on():
    """The camera is covered from 0.5 s to 1.5 s."""
    system = MechanicalSystem(load_robot("pera_shoulder_elbow"))
    camera = CAMERA.mounted_on(system.robot)
    box = ObservedObject.seen_as(camera, [0.004, 0.003, 0.0028], system.at(system.robot.home))

    class Covered:
        state_size = 0

        def __init__(self):
            self.clock = FeatureFlow(camera, [0.0, 0.0, 1.0], 1.0)

        def initial_state(self):
            return np.zeros(0)

        def rate(self, x, state):
            return np.zeros(0)

        def features(self, x, state):
            return box.features(x) if not covered() else np.full(3, np.nan)

    now = {"t": 0.0}

    def covered():
        return 0.5 <= now["t"] < 1.5

    def watch(t, x):
        now["t"] = t
        return np.zeros(3)

    stopping = make_controller("hamiltonian_servo", system, camera=camera)
    with pytest.raises(SimulationError, match=r"stopped at t = 0\.49\d* s: hamiltonian_servo lost its") as caught:
        simulate(system, stopping, duration=3.0, dt=2e-3, scene=Covered(), disturbance=watch)
    assert "smaller dt" not in str(caught.value)
    assert caught.value.log.time[-1] == pytest.approx(0.498)
    now["t"] = 0.0
    holding = make_controller("hamiltonian_servo", system, camera=camera, lost="hold")
    log = simulate(system, holding, duration=6.0, dt=2e-3, scene=Covered(), disturbance=watch)
    assert np.abs(log.velocity[log.time > 1.4][0]).max() < 1e-3  # it waits
    np.testing.assert_allclose(log.features[-1], GOAL, atol=1e-5)
