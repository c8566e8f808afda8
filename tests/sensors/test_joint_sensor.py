"""What a sampled law sees of q and q̇, and when its torque acts: each fault alone, and against loops by hand."""

from __future__ import annotations

import warnings

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import fsolve

from phcontrol import (
    CompilationWarning,
    EnergyShaping,
    ForceSensor,
    IntegralAction,
    InvalidArgumentError,
    JointSensor,
    Log,
    MechanicalSystem,
    MomentumObserver,
    TorqueFilter,
    linearize,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.compilation.compiler import find_compiler
from tests.conftest import make_system

Q, V = np.array([0.3, -0.2]), np.array([1.0, -0.5])


def readings(sensor, positions, velocities=None, period=0.01):
    """Show the sensor a posture at each instant and return what it shows after each."""
    velocities = np.zeros_like(positions) if velocities is None else velocities
    state, shown = sensor.start(positions[0], velocities[0]), []
    for k, (position, velocity) in enumerate(zip(positions, velocities, strict=True)):
        state = sensor.update(state, k * period, position, velocity)
        shown.append(np.concatenate(sensor.reading(state)))
    return np.split(np.array(shown), 2, axis=1)


def test_a_perfect_sensor_shows_the_truth():
    q, v = np.outer(np.arange(1.0, 4.0), Q), np.outer(np.arange(3.0), V)
    shown = readings(JointSensor(), q, v)
    np.testing.assert_array_equal(shown[0], q)
    np.testing.assert_array_equal(shown[1], v)


def test_bias_and_resolution_of_each():
    q, v = np.tile(Q, (2, 1)), np.tile(V, (2, 1))
    sensor = JointSensor(position_bias=[0.1, 0.0], velocity_bias=-0.25)
    np.testing.assert_allclose(readings(sensor, q, v), [np.add(q, [0.1, 0.0]), v - 0.25])
    sensor = JointSensor(position_resolution=[0.25, 0.0], velocity_resolution=0.3)
    np.testing.assert_allclose(readings(sensor, q, v), [q * 0.0 + [0.25, -0.2], v * 0.0 + [0.9, -0.6]])
    counts = 2.0 * np.pi / 4096
    fine = readings(JointSensor(position_resolution=counts), np.linspace([0.0, 0.0], [1.0, 2.0], 500))[0]
    np.testing.assert_allclose(fine / counts, np.rint(fine / counts), atol=1e-9)
    assert 0.45 * counts < np.abs(fine - np.linspace([0.0, 0.0], [1.0, 2.0], 500)).max() <= 0.5 * counts + 1e-12


@pytest.mark.parametrize(("delay", "behind"), [(0.0, 0), (0.01, 1), (0.03, 3), (0.025, 3), (9.0, 8)])
def test_delay_shows_what_was_read_then(delay, behind):
    q = np.outer(np.arange(8.0), Q)
    sensor = JointSensor(delay=delay, position_bias=0.5)
    np.testing.assert_allclose(readings(sensor, q)[0], 0.5 + q[np.maximum(np.arange(8) - behind, 0)], atol=1e-15)


def test_noise_has_its_size_and_its_seed():
    q, v = np.tile(Q, (4000, 1)), np.tile(V, (4000, 1))
    sensor = JointSensor(position_noise=[0.01, 0.0], velocity_noise=[0.2, 0.4])
    of_q, of_v = readings(sensor, q, v)
    np.testing.assert_allclose(np.std(of_q - q, axis=0), [0.01, 0.0], rtol=0.05)
    np.testing.assert_allclose(np.std(of_v - v, axis=0), [0.2, 0.4], rtol=0.05)
    assert np.abs(np.corrcoef(np.hstack([of_q[:, :1], of_v]).T) - np.eye(3)).max() < 0.07
    np.testing.assert_array_equal(of_q, readings(sensor, q, v)[0])
    assert (readings(JointSensor(velocity_noise=0.2, seed=1), q, v)[1] != of_v).all()
    # a force sensor of the same seed has other noise
    force = ForceSensor(noise=1.0).start(make_system("pera_shoulder").at(Q), V).noise.standard_normal(1000)
    ours = JointSensor().noise_source().standard_normal(1000)
    assert abs(np.corrcoef(force, ours)[0, 1]) < 0.15


# --- loops by hand ----------------------------------------------------------------------------------

GOAL, STIFFNESS, DAMPING = np.array([0.4, 0.6]), np.array([20.0, 15.0]), np.array([4.0, 3.0])
FORCE = np.array([0.5, -0.3])


def by_hand(model, q, v, steps, dt, stride, late, faults, behind, limit):
    """Integrate ABA by the semi-implicit Euler method, with everything between arm and law written out.

    ``faults(k, z)`` is what is read of z = (q, q̇) at step k.
    """
    data, n = model.createData(), model.nv
    read, ordered, rows = [], {}, []
    for k in range(steps + 1):
        read.append(faults(k, np.concatenate([q, v])))
        shown = read[max(0, k - behind)]
        gravity = pin.computeGeneralizedGravity(model, data, shown[:n].copy())
        if k == 0:
            acting = np.clip(gravity, -limit, limit)
        if k % stride == 0:
            desired = gravity - STIFFNESS * (shown[:n] - GOAL) - DAMPING * shown[n:]
            ordered[k] = np.clip(desired, -limit, limit)
        acting = ordered.get(k - late, acting)
        rows.append((q.copy(), v.copy(), acting.copy(), shown.copy()))
        v = v + dt * pin.aba(model, data, q, v, acting + FORCE)
        q = q + dt * v
    return [np.array(column) for column in zip(*rows, strict=True)]


@pytest.mark.parametrize("compiled", [False, True], ids=["interpreted", "compiled"])
@pytest.mark.parametrize(("stride", "late", "behind"), [(1, 0, 2), (2, 1, 0), (2, 4, 3), (3, 7, 1), (4, 1000, 0)])
def test_a_loop_by_hand_is_the_same(stride, late, behind, compiled):
    if compiled and find_compiler() is None:
        pytest.skip("no C compiler: loops cannot be compiled here")
    robot = load_robot("pera_shoulder")
    arm = MechanicalSystem(robot, friction=None)
    law = EnergyShaping(arm, goal=GOAL, stiffness=STIFFNESS, damping=DAMPING)
    dt, steps, limit = 2e-3, 150, np.array([4.0, 9.0])
    bias, sigma = np.array([0.02, -0.01, 0.03, 0.0]), np.array([1e-3, 2e-3, 0.02, 0.0])
    step = np.array([1e-3, 0.0, 0.0, 5e-3])
    noise = np.random.default_rng(np.random.SeedSequence(3, spawn_key=(1,))).standard_normal((steps + 1, 4))

    def faults(k, z):
        value = z + bias + sigma * noise[k]
        return np.where(step > 0.0, step * np.round(value / np.where(step > 0.0, step, 1.0)), value)

    sensor = JointSensor(
        position_noise=sigma[:2], position_bias=bias[:2], position_resolution=step[:2], velocity_noise=sigma[2:],
        velocity_bias=bias[2:], velocity_resolution=step[2:], delay=behind * dt, seed=3,
    )  # fmt: skip
    q0, v0 = np.array([0.1, 0.3]), np.array([0.4, -0.2])
    with warnings.catch_warnings():
        warnings.simplefilter("error", CompilationWarning)
        log = simulate(
            arm, law, duration=steps * dt, dt=dt, q0=q0, v0=v0, integrator="semi_implicit_euler", disturbance=FORCE,
            control_period=stride * dt, torque_limit=limit, joint_sensor=sensor, torque_delay=late * dt,
            compiled=compiled,
        )  # fmt: skip
    q, v, torque, shown = by_hand(robot.model, q0, v0, steps, dt, stride, late, faults, behind, limit)
    np.testing.assert_allclose(log.position, q, atol=1e-10)
    np.testing.assert_allclose(log.velocity, v, atol=1e-10)
    np.testing.assert_allclose(log.torque, torque, atol=1e-9)
    np.testing.assert_allclose(np.hstack([log.measured["position"], log.measured["velocity"]]), shown, atol=1e-10)
    if late < steps:
        assert np.ptp(torque, axis=0).min() > 1.0  # it does something
        assert log.saturated.any()


# --- what a delay does ------------------------------------------------------------------------------


def one_joint():
    """Return an arm of one joint without weight and friction, a double integrator, and its inertia."""
    robot = load_robot("pera_shoulder", locked_joints=["shoulder_roll"])
    arm = MechanicalSystem(robot, friction=None, gravity=[0.0, 0.0, 0.0])
    return arm, float(pin.crba(robot.model, robot.model.createData(), np.zeros(1))[0, 0])


def recursion(inertia, stiffness, damping, period, delay):
    """Return the matrix of a double integrator whose torque −k q − c q̇ is held and comes so many periods late."""
    matrix = np.zeros((2 + delay, 2 + delay))
    matrix[:2, :2] = [[1.0, period], [0.0, 1.0]]
    act, law = np.array([0.5 * period**2, period]) / inertia, -np.array([stiffness, damping])
    if delay == 0:
        matrix[:2, :2] += np.outer(act, law)
        return matrix
    matrix[:2, -1], matrix[2, :2] = act, law
    for k in range(1, delay):
        matrix[2 + k, 1 + k] = 1.0
    return matrix


def test_the_longest_delay_of_a_double_integrator():
    """Its run is the recursion; it diverges from the first delay on at which that has a growing eigenvalue."""
    arm, inertia = one_joint()
    period, rate, ratio = 5e-3, 12.0, 0.7
    stiffness, damping = inertia * rate**2, 2.0 * ratio * inertia * rate
    law = EnergyShaping(arm, goal=[0.0], stiffness=stiffness, damping=damping)
    radii = [np.abs(np.linalg.eigvals(recursion(inertia, stiffness, damping, period, d))).max() for d in range(40)]
    longest = next(d for d, radius in enumerate(radii) if radius > 1.0) - 1
    assert 8 < longest < 30
    ends = {}
    for delay in (0, 1, 5, longest, longest + 1):
        log = simulate(
            arm, law, duration=1000 * period, dt=period, control_period=period, q0=[1e-3], torque_limit=None,
            torque_delay=delay * period,
        )  # fmt: skip
        matrix, z = recursion(inertia, stiffness, damping, period, delay), np.zeros(2 + delay)
        z[0] = 1e-3
        for k in range(1001):
            np.testing.assert_allclose([log.position[k, 0], log.velocity[k, 0]], z[:2], rtol=1e-6, atol=1e-12)
            z = matrix @ z
        size = np.abs(log.position[:, 0])
        ends[delay] = size[-200:].max() / size[200:400].max()
    assert all(ends[delay] < 0.9 for delay in (0, 1, 5, longest))
    assert ends[longest + 1] > 1.1


def test_a_delay_makes_the_arm_as_unstable_as_the_linear_view_says(shoulder):
    """With gravity, coupling and friction: what a period leaves of a deviation is the spectral radius."""
    arm = MechanicalSystem(load_robot("pera_shoulder"), friction=None)
    law = EnergyShaping(arm, goal=[0.3, 0.5], stiffness=30.0, damping=3.0)
    linear, period = linearize(law, arm), 4e-3
    radii = [linear.sampled(period, delay=delay).radius for delay in range(40)]
    longest = next(delay for delay, radius in enumerate(radii) if radius > 1.0) - 1
    assert longest > 2
    for delay in (longest, longest + 1):
        log = simulate(
            arm, law, duration=600 * period, dt=period, control_period=period, q0=linear.position + 1e-7,
            torque_limit=None, torque_delay=delay * period,
        )  # fmt: skip
        size = np.linalg.norm(log.position - linear.position, axis=1)
        blocks = size[100:600].reshape(2, 250).max(axis=1)
        assert (blocks[1] > blocks[0]) == (radii[delay] > 1.0), (delay, radii[delay], blocks)
        np.testing.assert_allclose((blocks[1] / blocks[0]) ** (1 / 250), radii[delay], atol=2e-3)


# --- what a bias does -------------------------------------------------------------------------------


def test_an_arm_without_weight_rests_off_by_the_bias():
    arm = MechanicalSystem(load_robot("pera_shoulder"), gravity=[0.0, 0.0, 0.0])
    law = EnergyShaping(arm, goal=GOAL, stiffness=20.0, damping=5.0)
    bias = np.array([0.03, -0.05])
    log = simulate(arm, law, duration=8.0, dt=4e-3, control_period=4e-3, joint_sensor=JointSensor(position_bias=bias))
    np.testing.assert_allclose(log.position[-1], GOAL - bias, atol=1e-6)
    np.testing.assert_allclose(log.measured["position"][-1], GOAL, atol=1e-6)
    log = simulate(
        arm, law, duration=8.0, dt=4e-3, control_period=4e-3, joint_sensor=JointSensor(velocity_bias=[0.1, 0.2])
    )
    np.testing.assert_allclose(log.position[-1], GOAL - 5.0 * np.array([0.1, 0.2]) / 20.0, atol=1e-6)  # −K_p⁻¹C b


def test_under_gravity_it_rests_where_the_wrong_compensation_meets_the_spring():
    """∂V/∂q(q) = ∂V/∂q(q + b) − K_p(q + b − q_d), solved on its own."""
    robot, bias = load_robot("pera_shoulder"), np.array([0.03, -0.05])
    arm, data = MechanicalSystem(robot), robot.model.createData()
    law = EnergyShaping(arm, goal=GOAL, stiffness=20.0, damping=5.0)
    log = simulate(arm, law, duration=8.0, dt=4e-3, control_period=4e-3, joint_sensor=JointSensor(position_bias=bias))

    def gravity(q):
        return pin.computeGeneralizedGravity(robot.model, data, q)

    rest = fsolve(lambda q: gravity(q + bias) - gravity(q) - 20.0 * (q + bias - GOAL), GOAL, xtol=1e-12)
    assert np.abs(rest - (GOAL - bias)).max() > 1e-3  # gravity counts
    np.testing.assert_allclose(log.position[-1], rest, atol=1e-6)


# --- what else is shown -----------------------------------------------------------------------------


def test_a_law_starts_from_what_it_is_shown(shoulder):
    class Beginning(IntegralAction):
        def initial_state(self, x):
            return np.concatenate([x.position, x.velocity])

    law, sensor = Beginning.tuned(shoulder, GOAL), JointSensor(position_bias=[0.1, 0.0])
    log = simulate(shoulder, law, duration=0.01, control_period=1e-3, q0=Q, joint_sensor=sensor)
    expected = law.initial_state(shoulder.at(np.add(Q, [0.1, 0.0])))
    np.testing.assert_array_equal(log.controller_state[0], expected)


def test_a_momentum_observer_computes_with_what_is_shown_and_a_force_sensor_feels_the_truth(shoulder):
    law = make_controller("force_feedback_measured", shoulder, goal=GOAL)
    noisy, options = JointSensor(velocity_noise=0.05, seed=2), {"duration": 0.2, "control_period": 1e-3}

    class Noting(MomentumObserver):
        def update(self, state, t, x, external_force, torque):
            self.seen = x.velocity
            return super().update(state, t, x, external_force, torque)

    observer = Noting(shoulder, 40.0)
    log = simulate(shoulder, law, sensors=[observer], joint_sensor=noisy, disturbance=FORCE, **options)
    np.testing.assert_array_equal(observer.seen, log.measured["velocity"][-1])
    assert np.std(log.measured["external_force"][50:, 0]) > 0.01
    felt = simulate(shoulder, law, sensors=[ForceSensor()], joint_sensor=noisy, disturbance=FORCE, **options)
    np.testing.assert_array_equal(felt.measured["external_force"], np.tile(FORCE, (201, 1)))


def test_a_filter_sees_what_the_law_sees(shoulder):
    law, torque_filter = EnergyShaping.tuned(shoulder, GOAL), TorqueFilter(shoulder, period=1e-3)
    log = simulate(
        shoulder, law, duration=0.05, torque_filter=torque_filter, joint_sensor=JointSensor(position_bias=0.05),
        torque_delay=2e-3,
    )  # fmt: skip
    compensated = law.evaluate(0.0, shoulder.at(log.measured["position"][5], log.measured["velocity"][5]), []).torque
    np.testing.assert_allclose(log.filter_activity["desired_torque"][5], compensated)
    np.testing.assert_allclose(log.torque[7], compensated)


def test_the_file_of_a_log_has_what_was_shown(shoulder, tmp_path):
    sensor = JointSensor(position_noise=1e-3, seed=11)
    options = {"duration": 0.05, "control_period": 1e-3, "joint_sensor": sensor, "torque_delay": 3e-3}
    log = simulate(shoulder, EnergyShaping.tuned(shoulder, GOAL), **options)
    again = Log.load(log.save(tmp_path / "run.npz"))
    for name in ("position", "velocity"):
        np.testing.assert_array_equal(again.measured[name], log.measured[name])
    assert again.metadata["torque_delay"] == 3e-3
    assert again.metadata["seeds"] == {"joints": 11}


# --- wrong input ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"position_noise": -1e-3}, "position_noise: must be >= 0"),
        ({"velocity_noise": [0.1, -0.1]}, "velocity_noise: must be >= 0"),
        ({"position_resolution": -1e-3}, "position_resolution: must be >= 0"),
        ({"velocity_resolution": -1e-3}, "velocity_resolution: must be >= 0"),
        ({"position_bias": np.nan}, "position_bias: .*finite"),
        ({"velocity_bias": "fast"}, "velocity_bias"),
        ({"delay": -1e-3}, "delay: must be >= 0"),
        ({"seed": -1}, "seed: must be an integer >= 0"),
        ({"seed": 0.5}, "seed: must be an integer >= 0"),
    ],
)
def test_a_sensor_that_cannot_be(given, words):
    with pytest.raises(InvalidArgumentError, match=words):
        JointSensor(**given)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (
            {"joint_sensor": JointSensor(), "control_period": None},
            "joint_sensor: is of a sampled law: give control_per",
        ),
        ({"torque_delay": 1e-3, "control_period": None}, "torque_delay: is of a sampled law: give control_period"),
        ({"torque_delay": 1.5e-3}, "torque_delay: must be a whole multiple of dt = 0.001 s, but is 0.0015"),
        ({"torque_delay": -1e-3}, "torque_delay: must be >= 0"),
        ({"torque_delay": "late"}, "torque_delay: must be a number"),
        ({"joint_sensor": ForceSensor()}, "joint_sensor: must be a JointSensor, but is ForceSensor"),
        ({"joint_sensor": JointSensor(position_bias=[0.1] * 3)}, r"position_bias: must have shape \(2,\)"),
        ({"joint_sensor": JointSensor(velocity_noise=[0.1] * 3)}, r"velocity_noise: must have shape \(2,\)"),
    ],
)
def test_a_run_that_cannot_be(given, words, shoulder):
    with pytest.raises(InvalidArgumentError, match=words):
        simulate(shoulder, EnergyShaping.tuned(shoulder), **({"duration": 0.1, "control_period": 1e-3} | given))
