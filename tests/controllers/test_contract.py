"""What the framework asks of laws beside their torque: ports, postures, scenes, gains."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    NOTHING,
    Controller,
    EnergyShaping,
    Gain,
    HamiltonianServo,
    InvalidArgumentError,
    MechanicalSystem,
    ObservedObject,
    PinholeCamera,
    ReductionServo,
    Schedule,
    Target,
    Vector,
    load_robot,
    make_controller,
)
from phcontrol.controllers.registry import CONTROLLERS, laws_for
from phcontrol.sensors.measured import Measured, measure_truly
from tests.conftest import make_system
from tests.finite_differences import derivative


class Spring(Controller):
    """The shortest law: a promise and nothing else."""

    name = "spring"
    goal: Vector = Vector("q_d", "rad")
    stiffness: Gain = Gain("K_p", "N·m/rad")
    damping: Gain = Gain("C", "N·m·s/rad")

    def storage(self, t, x, state, measured=NOTHING):
        error = x.position_error(self.goal)
        return x.kinetic_energy + 0.5 * error @ self.stiffness @ error

    def target(self, t, x, state, measured=NOTHING):
        error = x.position_error(self.goal)
        return Target.mechanical(
            x, self.interconnection, error=error, gradient=self.stiffness @ error, damping=self.damping
        )


AT_REST = ["energy_shaping", "force_feedback", "integral_action", "total_force_rejection", "impedance_grasping",
           "classical_impedance", "reduction_servo", "hamiltonian_servo"]  # fmt: skip


@pytest.mark.parametrize("geared", [False, True])
@pytest.mark.parametrize("name", AT_REST)
def test_storage_changes_by_what_is_dissipated_and_what_comes_in_at_the_port(name, geared, rng):
    """Ḣ_d = −dissipated + ŷᵀw under the law's torque plus w, by finite differences along the plant's motion."""
    options = {"input_matrix": np.diag(rng.uniform(0.5, 2.0, size=7))} if geared else {}
    system, zero = MechanicalSystem(load_robot("pera"), **options), np.zeros(7)
    for form in CONTROLLERS[name].law.forms:
        law = make_controller(name, system, interconnection=form)
        x = system.at(system.robot.near_home(), 0.5 * rng.normal(size=7))
        scene = None if law.eyes is None else law.eyes.random_scene(x, rng)
        state, extra = 0.3 * law.random_state(rng), rng.normal(size=7)
        command = law.evaluate(0.0, x, state, measure_truly(x, zero, law.needs, scene))
        acceleration = x.acceleration(command.torque + extra)

        def stored(h, law=law, x=x, scene=scene, state=state, command=command, acceleration=acceleration):
            moved = system.at(x.position + h * x.velocity + 0.5 * h**2 * acceleration, x.velocity + h * acceleration)
            measured = measure_truly(moved, zero, law.needs, scene)
            return np.array(law.storage(0.0, moved, state + h * command.state_rate, measured))

        port = law.passive_port(0.0, x, state, measure_truly(x, zero, law.needs, scene))
        expected = port.output @ extra - port.dissipated_power
        scale = abs(port.output @ extra) + port.dissipated_power
        assert float(derivative(stored, 1e-4)) == pytest.approx(expected, abs=1e-6 * max(1.0, scale))
        assert port.dissipated_power >= 0.0


@pytest.mark.parametrize("damping", [4.0, np.linspace(1.0, 5.0, 7)])
def test_a_servo_that_holds_brakes(damping, rng):
    """Without an object in sight: H_d = ½q̇ᵀM q̇ falls by friction and by the injected damping."""
    system = make_system("pera")
    law = make_controller("hamiltonian_servo", system, damping=damping, lost="hold")
    x, blind = system.at(system.robot.home, rng.normal(size=7)), Measured(features=np.full(3, np.nan))
    torque = law.evaluate(0.0, x, np.zeros(0), blind).torque
    T, matrix = np.linalg.cholesky(x.mass_matrix), np.diag(np.broadcast_to(damping, 7))
    np.testing.assert_allclose(torque, x.potential_gradient - T @ matrix @ T.T @ x.velocity, atol=1e-9)
    port = law.passive_port(0.0, x, np.zeros(0), blind)
    np.testing.assert_allclose(port.output, x.velocity, atol=1e-12)
    losses = x.velocity @ (T @ matrix @ T.T + x.damping_matrix) @ x.velocity
    assert port.dissipated_power == pytest.approx(losses)
    assert law.storage(0.0, x, np.zeros(0), blind) == pytest.approx(x.kinetic_energy)
    seen = law.passive_port(0.0, x, np.zeros(0), Measured(features=np.array([1e-3, 0.0, 2e-3])))
    assert np.abs(seen.output - x.velocity).max() > 1e-3


def test_laws_of_features_need_three_joints_and_those_of_poses_six():
    servos = {"reduction_servo", "hamiltonian_servo"}
    hands = {name for name in CONTROLLERS if name.startswith("cartesian_")}
    assert len(hands) == 3
    assert set(laws_for(make_system("pera_shoulder"))) == set(CONTROLLERS) - servos - hands
    assert set(laws_for(make_system("pera_gripper"))) == set(CONTROLLERS) - servos - hands
    assert set(laws_for(make_system("pera_shoulder_elbow"))) == set(CONTROLLERS) - hands
    assert laws_for(make_system("pera")) == list(CONTROLLERS)


def test_the_posture_that_a_law_goes_to():
    """Features are none, though on three joints they are as many as the joints."""
    three, seven = make_system("pera_shoulder_elbow"), make_system("pera")
    law = make_controller("energy_shaping", three, goal=[0.1, 0.2, 0.3])
    np.testing.assert_array_equal(law.target_posture(0.0), [0.1, 0.2, 0.3])
    servo = make_controller("hamiltonian_servo", three)
    assert servo.target_posture(0.0) is None
    redundant = make_controller("hamiltonian_servo", seven)
    np.testing.assert_array_equal(redundant.target_posture(0.0), seven.robot.home)
    assert make_controller("hamiltonian_servo", seven, posture_gain=0.0).target_posture(0.0) is None
    assert make_controller("hamiltonian_servo", seven, posture_gain=0.1).target_posture(0.0) is not None
    schedule = Schedule([(0.0, servo), (1.0, law)])
    np.testing.assert_array_equal(schedule.target_posture(0.0), law.goal)  # the first that another law has
    assert Schedule([(0.0, servo)]).target_posture(0.0) is None
    own = Spring(three, goal=[0.1, 0.2, 0.3], stiffness=1.0, damping=1.0)
    np.testing.assert_array_equal(own.target_posture(0.0), own.goal)
    own.__dict__["goal"] = "home"
    assert own.target_posture(0.0) is None
    own.__dict__["goal"] = np.zeros(2)
    assert own.target_posture(0.0) is None


def test_the_usual_gains_of_servos():
    for name in ("reduction_servo", "hamiltonian_servo"):
        seven, three = (make_controller(name, make_system(arm)) for arm in ("pera", "pera_shoulder_elbow"))
        assert (seven.posture_gain, three.posture_gain) == (2.0, 0.0)
        np.testing.assert_array_equal(seven.damping, 5.0 * np.eye(7))
        np.testing.assert_array_equal(seven.goal, [0.0, 0.0, 0.002])


def test_a_schedule_and_a_law_without_gains_cannot_be_tuned(shoulder):
    with pytest.raises(InvalidArgumentError, match=r"make it of laws: Schedule\(\["):
        Schedule.tuned(shoulder)
    with pytest.raises(InvalidArgumentError, match="make it of laws"):
        Schedule.default_gains(shoulder, np.zeros(2))
    assert set(EnergyShaping.default_gains(shoulder, np.zeros(2))) == {"goal", "stiffness", "damping"}


def test_the_rate_of_a_servo_must_make_its_storage_fall():
    """KΛ + ΛᵀK > 0: its smallest eigenvalue counts."""
    system = make_system("pera_shoulder_elbow")
    for rate in (np.diag([1.0, 2.0, -0.1]), np.diag([-0.1, 1.0, 2.0]), np.zeros((3, 3)), np.diag([1.0, 0.0, 1.0])):
        with pytest.raises(InvalidArgumentError, match="rate: KΛ . ΛᵀK must be positive definite"):
            make_controller("hamiltonian_servo", system, rate=rate)
    law = make_controller("hamiltonian_servo", system, rate=[1.0, 2.0, 0.1])
    assert isinstance(law, HamiltonianServo)


def test_the_feature_gain_of_the_reduction_is_square_on_three_joints_alone():
    three, seven = make_system("pera_shoulder_elbow"), make_system("pera")
    law = make_controller("reduction_servo", three, feature_gain=2.0)
    np.testing.assert_array_equal(law.feature_gain, 2.0 * np.eye(3))
    given = np.arange(21.0).reshape(7, 3)
    np.testing.assert_array_equal(make_controller("reduction_servo", seven, feature_gain=given).feature_gain, given)
    for value in (2.0, np.eye(3), given.T):
        with pytest.raises(InvalidArgumentError, match=r"feature_gain: must have shape \(7, 3\)"):
            make_controller("reduction_servo", seven, feature_gain=value)
    assert isinstance(law, ReductionServo)


def test_objects_that_a_servo_shall_lose_are_behind_the_camera_or_beside_its_image(rng):
    """One in eight; in an image that is wide, each direction has its own reach."""
    system = make_system("pera")
    camera = PinholeCamera(0.01, field_of_view=0.4, image_size=(640, 320))
    law = make_controller("hamiltonian_servo", system, camera=camera, goal=[0.0, 0.0, 0.003], lost="hold")
    x, half = system.at(system.robot.near_home()), 0.01 * np.tan(0.2) * np.array([1.0, 0.5])
    scenes = [law.random_scene(x, rng) for _ in range(800)]
    placed = np.array([x.placement(law.frame).actInv(np.asarray(scene.position)) for scene in scenes])
    shares = 0.01 * placed[:, :2] / placed[:, 2:] / half
    behind = placed[:, 2] < 0.0
    beside = ~behind & (np.abs(shares) > 1.0 + 1e-9).any(axis=1)
    assert behind.mean() == pytest.approx(1.0 / 16.0, abs=0.025)
    assert beside.mean() == pytest.approx(1.0 / 16.0, abs=0.025)
    assert 1.5 <= np.abs(shares[beside]).min() < 1.8
    assert 2.6 < np.abs(shares[beside]).max() <= 3.0
    assert (shares[beside] > 0.0).any(axis=0).all()
    assert (shares[beside] < 0.0).any(axis=0).all()
    np.testing.assert_allclose(np.abs(shares[~beside & ~behind]).max(axis=0), 1.0, atol=0.03)


@pytest.mark.parametrize("field_of_view", [None, 0.4])
def test_scenes_that_a_servo_is_tried_on_are_in_view(field_of_view, rng):
    """Up to half a focal length from the axis and inside the image, half to twice as far as at the goal."""
    system = make_system("pera")
    camera = PinholeCamera(0.01, field_of_view=field_of_view)
    law = make_controller("hamiltonian_servo", system, camera=camera, goal=[0.0, 0.0, 0.003], object_length=0.05)
    x = system.at(system.robot.near_home())
    scenes = [law.random_scene(x, rng) for _ in range(400)]
    features = np.array([scene.features(x) for scene in scenes])
    reach = 0.005 if field_of_view is None else 0.01 * np.tan(0.2)
    for column in features[:, :2].T:
        assert -reach <= column.min() < -0.9 * reach
        assert 0.9 * reach < column.max() <= reach
    distances = 0.01 * 0.05 / features[:, 2]
    usual = 0.01 * 0.05 / 0.003
    assert 0.5 * usual * (1.0 - 1e-9) <= distances.min() < 0.55 * usual
    assert 1.8 * usual < distances.max() <= 2.0 * usual * (1.0 + 1e-9)
    assert isinstance(scenes[0], ObservedObject)
    assert scenes[0].size.tolist() == pytest.approx([0.05, 0.01, 0.01])
    assert Schedule([(0.0, make_controller("energy_shaping", system)), (1.0, law)]).eyes is law
    assert make_controller("energy_shaping", system).eyes is None
