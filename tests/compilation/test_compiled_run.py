"""A run in C is the interpreted run: over the whole of it, not at its end, for a damped loop forgets its errors."""

from __future__ import annotations

import warnings

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import (
    INTEGRATORS,
    CompilationWarning,
    CompliantBody,
    EnergyShaping,
    ForceSensor,
    JointContact,
    JointSensor,
    Log,
    MechanicalSystem,
    MinimumJerk,
    MomentumObserver,
    Positive,
    Pulse,
    RigidBody,
    Sampled,
    SimulationError,
    Sine,
    SphereContact,
    Step,
    StribeckFriction,
    Wrench,
    compile_law,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.compilation.rigid_body import ArmPosture
from phcontrol.tanks import Action
from tests.conftest import make_system

pytestmark = pytest.mark.usefixtures("compiler")


def both(plant, law, **options):
    """Return the interpreted and the compiled run, and check that all recorded is the same."""
    options = {"duration": 0.4, "dt": 1e-3} | options
    plain = simulate(plant, law, **options)
    with warnings.catch_warnings():
        warnings.simplefilter("error", CompilationWarning)
        compiled = simulate(plant, law, compiled=True, **options)
    assert len(compiled) == len(plain)
    np.testing.assert_array_equal(compiled.time, plain.time)
    np.testing.assert_allclose(compiled.external_force, plain.external_force, rtol=0.0, atol=1e-10)
    assert compiled.measured.keys() == plain.measured.keys()
    for name, shown in plain.measured.items():
        np.testing.assert_allclose(compiled.measured[name], shown, rtol=0.0, atol=1e-10)
    for name in ("position", "velocity", "controller_state", "body_state"):
        np.testing.assert_allclose(getattr(compiled, name), getattr(plain, name), rtol=0.0, atol=1e-11, err_msg=name)
    np.testing.assert_allclose(compiled.torque, plain.torque, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(compiled.storage, plain.storage, rtol=1e-9, atol=1e-12)
    return compiled


CONTROL = {"continuous": {}, "sampled": {"control_period": 1e-3}, "slowly sampled": {"control_period": 4e-3}}


@pytest.mark.parametrize("control", list(CONTROL))
@pytest.mark.parametrize("integrator", list(INTEGRATORS))
def test_a_law_with_a_state_under_a_force(control, integrator, shoulder):
    law = make_controller("force_feedback_measured", shoulder, goal=[0.4, 0.6])
    log = both(shoulder, law, integrator=integrator, disturbance=[0.5, -1.0], **CONTROL[control])
    assert np.ptp(log.position, axis=0).max() > 0.05  # it moves


def test_the_measured_total_force_is_that_of_the_plant(shoulder):
    both(shoulder, make_controller("total_force_rejection", shoulder, goal=[0.4, 0.6]), disturbance=[0.5, -1.0])


def test_torques_are_clipped_and_a_reference_begins_and_ends(shoulder):
    robot = shoulder.robot
    way = MinimumJerk(robot.home, robot.home + 0.3, 0.2, start=0.1)
    law = make_controller("energy_shaping", shoulder, reference=way)
    log = both(shoulder, law, torque_limit=[1.0, 20.0], q0=robot.home + 0.1)
    assert log.saturated.any()


def test_a_plant_that_is_not_the_laws_model():
    model = make_system("pera_shoulder")
    plant = MechanicalSystem(
        load_robot("pera_shoulder", armature=0.05), friction=StribeckFriction(viscous=0.4, coulomb=0.2, static=0.3)
    )
    both(plant, make_controller("force_feedback", model, goal=[0.4, 0.6]))


SIGNALS = (
    2.0 * Sine([1.0, 0.5], 1.5, 0.3)
    + Step([0.3, 0.1], 0.1)
    + 0.5 * Pulse([1.0, 1.0], 0.15, 0.1)
    + Sampled([0.1, 0.2, 0.35], [[0.0, 1.0], [1.0, 0.0], [0.5, 0.5]])
    + Sampled([0.1, 0.2, 0.35], [[0.0, 1.0], [1.0, 0.0], [0.5, 0.5]], "hold")
)


@pytest.mark.parametrize("control", list(CONTROL))
def test_a_force_that_is_a_signal(control, shoulder):
    log = both(shoulder, make_controller("force_feedback_measured", shoulder), disturbance=SIGNALS, **CONTROL[control])
    assert np.ptp(log.external_force, axis=0).min() > 1.0


def test_a_force_at_a_frame_and_a_function_of_ones_own(shoulder):
    def own(t, x):
        return np.array([np.sin(3.0 * t), 0.1]) if t < 0.2 else np.array([0.1, x.velocity[0]])

    law = make_controller("force_feedback_measured", shoulder)
    both(shoulder, law, disturbance=SIGNALS + 0.5 * Wrench(shoulder.hand_frame, [1.0, 0.0, 2.0, 0.1, 0.0, 0.0]))
    both(shoulder, law, disturbance=own)


@pytest.mark.parametrize("control", list(CONTROL))
def test_a_momentum_observer_of_another_model(control, shoulder):
    model = MechanicalSystem(load_robot("pera_shoulder", armature=0.01))
    law = make_controller("force_feedback_measured", shoulder)
    for observer in (MomentumObserver(shoulder, 40.0), MomentumObserver(model, 40.0, period=4e-3)):
        log = both(shoulder, law, disturbance=SIGNALS, sensors=[observer], **CONTROL[control])
        assert np.ptp(log.measured["external_force"], axis=0).min() > 0.5


FAULTY = JointSensor(
    position_noise=[1e-3, 2e-3], position_bias=[0.01, -0.02], position_resolution=[0.0, 1e-4], velocity_noise=0.02,
    velocity_bias=0.01, velocity_resolution=1e-3, delay=2.5e-3, seed=4,
)  # fmt: skip


@pytest.mark.parametrize("late", [0.0, 3e-3, 1.0])
@pytest.mark.parametrize("integrator", list(INTEGRATORS))
def test_what_a_law_sees_of_the_joints_and_when_its_torque_acts(integrator, late, shoulder):
    law = make_controller("integral_action", shoulder, goal=[0.4, 0.6])
    options = {"control_period": 2e-3, "disturbance": [0.5, -1.0], "v0": [0.3, -0.2]}
    log = both(shoulder, law, integrator=integrator, joint_sensor=FAULTY, torque_delay=late, **options)
    assert np.abs(log.measured["position"] - log.position).max() > 0.01
    plain = simulate(shoulder, law, integrator=integrator, duration=0.4, **options)
    assert np.abs(plain.position - log.position).max() > 1e-3  # it counts


@pytest.mark.parametrize("name", ["force_feedback_measured", "total_force_rejection"])
def test_a_faulty_joint_sensor_beside_forces_that_are_shown(name, shoulder):
    """A momentum observer computes with what is shown, a force sensor and a total force are of the truth."""
    law, model = make_controller(name, shoulder), MechanicalSystem(load_robot("pera_shoulder", armature=0.01))
    kinds = [None]
    if name == "force_feedback_measured":
        kinds += [[MomentumObserver(model, 40.0, period=4e-3)], [ForceSensor(noise=0.1, delay=2e-3)]]
    for sensors in kinds:
        options = {"joint_sensor": FAULTY, "torque_delay": 5e-3, "control_period": 4e-3, "torque_limit": [2.0, 3.0]}
        log = both(shoulder, law, disturbance=SIGNALS, sensors=sensors, **options)
        assert log.saturated.any()


SENSORS = {
    "true": {},
    "noisy": {"noise": [0.1, 0.3], "seed": 7},
    "biased, late, slow": {"bias": 0.2, "delay": 6.5e-3, "period": 4e-3},
    "late, cut off": {"noise": 0.5, "delay": 3e-3, "saturation": [0.4, 0.9]},
    "too late for this run": {"delay": 10.0},
}


@pytest.mark.parametrize("sensor", SENSORS.values(), ids=list(SENSORS))
@pytest.mark.parametrize("control", list(CONTROL))
def test_a_force_sensor_with_its_faults(control, sensor, shoulder):
    law = make_controller("force_feedback_measured", shoulder)
    log = both(shoulder, law, disturbance=SIGNALS, sensors=[ForceSensor(**sensor)], **CONTROL[control])
    shown = np.ptp(log.measured["external_force"], axis=0).min()
    assert shown > 0.5 if sensor.get("delay") != 10.0 else shown == 0.0


@pytest.mark.parametrize("kind", ["rigid", "compliant"])
@pytest.mark.parametrize("control", list(CONTROL))
def test_a_body_in_the_way_of_a_joint(kind, control, shoulder):
    home = shoulder.robot.home
    wall = JointContact(shoulder.robot.joint_names[1], home[1] + 0.1, side="above")
    rigid = RigidBody(wall, stiffness=200.0, damping=2.0)
    body = rigid if kind == "rigid" else CompliantBody(wall, stiffness=100.0, damping=1.0, mass=0.05)
    law = make_controller("force_feedback_measured", shoulder, goal=home + 0.3)
    log = both(shoulder, law, bodies=[body], dt=5e-4, **CONTROL[control])
    assert log.contact_force.max() > 1.0


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("shape", ["plane", "sphere"])
def test_a_hand_that_slides_on_a_body(shape, friction, shoulder):
    frame, home = shoulder.hand_frame, shoulder.robot.home
    x = shoulder.at(home + np.array([0.2, 0.3]))
    ahead = x.frame_jacobian(frame, "local_world_aligned")[:3] @ [0.3, 0.5]
    ahead /= np.linalg.norm(ahead)
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), -ahead).toRotationMatrix()
    size, place = (None, 0.01) if shape == "plane" else (0.05, 0.05)
    geometry = SphereContact(
        frame, 0.02, shape, size=size, position=x.placement(frame).translation + place * ahead, rotation=turn
    )
    law = make_controller("energy_shaping", shoulder, goal=home + np.array([0.3, 0.5]))
    rigid = RigidBody(geometry, stiffness=2e3, damping=20.0, friction=friction)
    compliant = CompliantBody(geometry, stiffness=1e3, damping=5.0, mass=0.1, friction=friction)
    for body in (rigid, compliant):
        log = both(shoulder, law, bodies=[body], dt=2e-4, duration=0.6)
        assert log.contact_force.max() > 5.0


@pytest.mark.study
@pytest.mark.parametrize("arm", ["panda_with_fingers", "kinova", "pera_gripper"])
def test_mimic_continuous_and_sprung_joints(arm):
    system = make_system(arm)
    goal = system.robot.near_home()
    for name in ("energy_shaping", "integral_action"):
        both(system, make_controller(name, system, goal=goal), duration=0.2, dt=5e-4)


def test_a_compiled_law_is_taken_and_the_log_is_saved(shoulder, tmp_path):
    law = compile_law(make_controller("energy_shaping", shoulder, goal=[0.4, 0.6]))
    log = simulate(shoulder, law, duration=0.1, compiled=True)
    log.save(tmp_path / "run.npz")
    np.testing.assert_array_equal(Log.load(tmp_path / "run.npz").position, log.position)


def test_what_is_not_compiled_is_simulated_interpreted_and_says_so(shoulder, monkeypatch):
    law = make_controller("energy_shaping", shoulder, goal=[0.4, 0.6])
    box = RigidBody(SphereContact(shoulder.hand_frame, 0.01, "box", size=[0.1, 0.1, 0.1], position=[0.0, 0.0, -9.0]))
    for options, words in (
        (
            {"disturbance": lambda t, x: np.array([float(f"{t}"), 0.0])},
            r"what acts on the arm cannot be compiled: .*made a text here \(test_compiled_run.py:",
        ),
        ({"bodies": [box]}, "contact with a shape that is neither plane nor sphere: not compiled yet"),
        ({"sensors": [ForceSensor(frame=shoulder.hand_frame)]}, "sensors: not compiled yet"),
        ({"watch": lambda log: None}, "watch: not compiled yet"),
    ):
        with pytest.warns(CompilationWarning, match=f"the run is simulated interpreted: {words}"):
            found = simulate(shoulder, law, duration=0.02, compiled=True, **options)
        expected = simulate(shoulder, law, duration=0.02, **options)
        np.testing.assert_array_equal(found.position, expected.position)
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.warns(CompilationWarning, match="no C compiler was found"):
        simulate(shoulder, law, duration=0.02, compiled=True)


class Late(EnergyShaping):
    """Takes a branch that none of the instants shows at which laws are traced."""

    name = "late"

    def shape(self, t, x, state, measured):
        shaping = super().shape(t, x, state, measured)
        return shaping._replace(effort=0.5 * shaping.effort) if t > 0.05 else shaping


def test_a_run_that_takes_a_branch_that_is_not_compiled_is_simulated_interpreted(shoulder):
    law = Late.tuned(shoulder, goal=[0.4, 0.6])
    with pytest.warns(CompilationWarning, match=r"at t = 0.05\d* s it takes a branch that is not compiled"):
        found = simulate(shoulder, law, duration=0.1, compiled=True)
    np.testing.assert_array_equal(found.position, simulate(shoulder, law, duration=0.1).position)


def test_a_plant_that_is_wrong_by_one_part_in_a_million_is_refused(monkeypatch):
    shoulder = make_system("pera_shoulder").twin()  # for which no loop was made before
    right = ArmPosture.inverse_dynamics

    def wrong(*arguments):
        return [entry * 1.000001 for entry in right(*arguments)]

    monkeypatch.setattr(ArmPosture, "inverse_dynamics", wrong)
    monkeypatch.setattr("phcontrol.simulation.compiled_run._LOOPS", [])
    law = make_controller("energy_shaping", shoulder, goal=[0.4, 0.6])
    with pytest.warns(CompilationWarning, match="the loop as compiled is refused: it differs from the interpreted"):
        found = simulate(shoulder, law, duration=0.02, compiled=True)
    np.testing.assert_array_equal(found.position, simulate(shoulder, law, duration=0.02).position)


def test_a_loop_that_was_never_compared_is_refused(monkeypatch):
    """All instants at which it is looked at take branches that are not compiled: nothing says that it is right."""
    shoulder = make_system("pera_shoulder").twin()  # for which no loop was made before
    monkeypatch.setattr("phcontrol.simulation.compiled_run._instants", lambda arrangement: iter(()))
    monkeypatch.setattr("phcontrol.simulation.compiled_run._LOOPS", [])
    law = make_controller("energy_shaping", shoulder, goal=[0.4, 0.6])
    with pytest.warns(CompilationWarning, match="the loop as compiled is refused: it differs from the interpreted"):
        simulate(shoulder, law, duration=0.02, compiled=True)


def test_a_step_that_iteration_does_not_find_is_left_to_the_interpreted_run(shoulder):
    wall = JointContact(shoulder.robot.joint_names[1], shoulder.robot.home[1] + 0.05, side="above")
    body = CompliantBody(wall, stiffness=100.0, damping=1.0, mass=0.05)
    law = make_controller("force_feedback", shoulder, goal=shoulder.robot.home + 0.3)
    options = {"bodies": [body], "duration": 0.4, "integrator": "implicit_midpoint"}
    with pytest.warns(CompilationWarning, match="the implicit step is not found by iteration"):
        found = simulate(shoulder, law, compiled=True, **options)
    np.testing.assert_array_equal(found.position, simulate(shoulder, law, **options).position)


def test_a_run_that_diverges_says_so_as_the_interpreted_one(shoulder):
    law = make_controller("energy_shaping", shoulder, goal=[0.4, 0.6], damping=5e4)
    ends = []
    for compiled in (False, True):
        with pytest.raises(SimulationError) as caught:
            simulate(shoulder, law, duration=1.0, compiled=compiled, torque_limit=None)
        ends.append(str(caught.value))
    assert ends[0] == ends[1]


def test_a_sweep_of_gains_needs_one_trace(shoulder, monkeypatch):
    law = make_controller("force_feedback", shoulder, goal=[0.4, 0.6])
    simulate(shoulder, law, duration=0.02, compiled=True)
    monkeypatch.setattr("phcontrol.compilation.compiled_loop.trace_law", lambda *_: pytest.fail("traced again"))
    for stiffness in (10.0, 40.0):
        both(shoulder, law.changed(stiffness=stiffness), duration=0.1)
    both(shoulder, law, duration=0.1)


class Scaled(EnergyShaping):
    name = "scaled"
    factor: Positive = Positive("c", "", default=1.0)

    def shape(self, t, x, state, measured):
        shaping = super().shape(t, x, state, measured)
        return shaping._replace(effort=(self.factor if self.factor > 0.5 else 0.5) * shaping.effort)


def test_a_number_that_decides_a_branch_otherwise_is_compiled_anew(shoulder):
    law = Scaled.tuned(shoulder, goal=[0.4, 0.6])
    for factor in (1.0, 0.8, 0.2, 0.1, 1.0):
        both(shoulder, law.changed(factor=factor), duration=0.05)


class Jumping(EnergyShaping):
    name = "jumping"
    jumps = True


def test_a_law_whose_state_jumps_is_simulated_interpreted(shoulder):
    law = Jumping.tuned(shoulder, goal=[0.4, 0.6])
    with pytest.warns(CompilationWarning, match="interpreted: a law whose state jumps: not compiled yet"):
        simulate(shoulder, law, duration=0.02, compiled=True)


class Tabled(EnergyShaping):
    name = "tabled"

    def prepare(self):
        super().prepare()
        self.boost, self.table = 1.0, np.array([1.0, 2.0])

    def shape(self, t, x, state, measured):
        shaping = super().shape(t, x, state, measured)
        return shaping._replace(effort=self.boost * self.table * shaping.effort)


@pytest.mark.parametrize("name", ["boost", "table"])
def test_a_law_that_was_changed_in_place_is_compiled_anew(name, shoulder):
    law = Tabled.tuned(shoulder, goal=[0.4, 0.6])
    before = both(shoulder, law, duration=0.1)
    if name == "boost":
        law.boost = 4.0
    else:
        law.table[:] = 9.0
    after = both(shoulder, law, duration=0.1)
    assert np.abs(after.torque - before.torque).max() > 1.0


class Push(Action):
    """What pushes a moving arm on."""

    def torque(self, t, x):
        return 0.3 * x.velocity
