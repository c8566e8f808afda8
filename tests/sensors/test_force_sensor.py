"""Each fault of the sensor, seen alone."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import InvalidArgumentError, PinholeCamera, UnknownNameError, make_controller, simulate
from phcontrol.environments.disturbances import Step, Wrench
from phcontrol.sensors.force_sensor import ForceSensor
from phcontrol.sensors.measured import measure_truly
from phcontrol.vision.feature_flow import FeatureFlow
from tests.conftest import make_system

FORCE = np.array([3.0, -1.0])
ZERO = np.zeros(2)


def readings(sensor, forces, period=0.01):
    """Feed the sensor a force at each instant and return what it shows after each."""
    x = make_system("pera_shoulder").at([0.3, 0.2], [0.5, -1.0])
    state, shown = sensor.start(x, ZERO), []
    for k, force in enumerate(forces):
        state = sensor.update(state, k * period, x, np.asarray(force), ZERO)
        shown.append(sensor.reading(state))
    return np.array(shown)


def test_a_perfect_sensor_shows_the_truth():
    np.testing.assert_array_equal(readings(ForceSensor(), [ZERO, FORCE, 2 * FORCE]), [ZERO, FORCE, 2 * FORCE])


def test_total_force_is_all_but_the_motors(rng):
    """f of (3.52): what ṗ is when the motors are off, by finite differences of the momentum."""
    system = make_system("pera")
    x = system.at(system.robot.random_position(rng), rng.normal(size=7))
    force = rng.normal(size=7)
    acceleration, h = x.acceleration(np.zeros(7), force), 1e-5

    def momentum(t):
        return system.at(x.position + t * x.velocity, x.velocity + t * acceleration).momentum

    sensor = ForceSensor("total_force")
    shown = sensor.reading(sensor.update(sensor.start(x, force), 0.0, x, force, np.zeros(7)))
    np.testing.assert_allclose(shown, (momentum(h) - momentum(-h)) / (2 * h), rtol=1e-6, atol=1e-6)


def test_what_perfect_sensors_of_some_quantities_show(rng):
    system = make_system("pera_shoulder_elbow")
    x, force = system.at(system.robot.home, rng.normal(size=3)), rng.normal(size=3)
    scene = FeatureFlow(PinholeCamera(), [1e-3, 2e-3, 3e-3], 0.038)
    shown = measure_truly(x, force, ("external_force",), scene)
    assert shown.external_force is force
    assert shown.total_force is shown.features is None
    shown = measure_truly(x, force, ("total_force", "features"), scene)
    np.testing.assert_array_equal(shown.total_force, x.total_force(force))
    np.testing.assert_array_equal(shown.features, [1e-3, 2e-3, 3e-3])
    assert shown.external_force is None
    state = np.array([4e-3, 5e-3, 6e-3])
    np.testing.assert_array_equal(measure_truly(x, force, ("features",), scene, state).features, state)
    assert measure_truly(x, force, ("features",)).features is None


def test_bias_and_saturation():
    np.testing.assert_allclose(readings(ForceSensor(bias=[0.5, 0.0]), [FORCE])[0], [3.5, -1.0])
    np.testing.assert_allclose(readings(ForceSensor(saturation=2.0), [FORCE])[0], [2.0, -1.0])
    np.testing.assert_allclose(readings(ForceSensor(saturation=2.0, bias=[0, -5.0]), [FORCE])[0], [2.0, -2.0])


@pytest.mark.parametrize(("delay", "behind"), [(0.01, 1), (0.03, 3), (0.025, 3)])
def test_delay_shows_what_was_true_then(delay, behind):
    forces = [k * FORCE for k in range(8)]
    expected = [ZERO] * behind + forces[:-behind]
    np.testing.assert_array_equal(readings(ForceSensor(delay=delay), forces), expected)


def test_noise_has_its_size_and_its_seed():
    noisy = readings(ForceSensor(noise=[0.3, 0.0]), [FORCE] * 4000) - FORCE
    assert np.std(noisy[:, 0]) == pytest.approx(0.3, rel=0.05)
    assert np.abs(noisy[:, 0].mean()) < 4 * 0.3 / np.sqrt(4000)
    assert (noisy[:, 1] == 0.0).all()
    same, other = (readings(ForceSensor(noise=0.3, seed=seed), [FORCE] * 5) for seed in (0, 1))
    np.testing.assert_array_equal(same, readings(ForceSensor(noise=0.3, seed=0), [FORCE] * 5))
    assert (same != other).all()
    np.testing.assert_array_equal(same, readings(ForceSensor(noise=0.3), [FORCE] * 5))


def test_a_wrench_sensor_shows_a_wrench_at_its_frame_exactly(rng):
    system = make_system("pera")
    x = system.at(system.robot.random_position(rng), rng.normal(size=7))
    force = Wrench("tool", rng.normal(size=6), reference="local")(0.0, x)
    sensor = ForceSensor(frame="tool")
    state = sensor.update(sensor.start(x, force), 0.0, x, force, np.zeros(7))
    np.testing.assert_allclose(sensor.reading(state), force, atol=1e-9)
    biased = ForceSensor(frame="tool", bias=[1.0, 0, 0, 0, 0, 0])
    state = biased.update(biased.start(x, force), 0.0, x, force, np.zeros(7))
    np.testing.assert_allclose(biased.reading(state) - force, x.frame_jacobian("tool", "local")[0], atol=1e-9)


def test_a_sampled_sensor_holds_in_a_simulation(shoulder):
    controller = make_controller("force_feedback_measured", shoulder, goal=[1.0, 0.5])
    log = simulate(
        shoulder,
        controller,
        duration=0.1,
        disturbance=lambda t, x: np.array([t, 0.0]),
        sensors=[ForceSensor(period=0.02, delay=0.01)],
    )
    shown = log.measured["external_force"][:, 0]
    assert (shown[20:40] == log.external_force[0, 0]).all()
    assert (shown[60:80] == log.external_force[40, 0]).all()


def test_a_law_on_a_real_sensor_still_settles(shoulder):
    """Noise of 0.1 N·m, 5 ms delay, 10 ms sampling: the measured law rests at q_d + K_p⁻¹f_e within its noise."""
    controller = make_controller("force_feedback_measured", shoulder, goal=[1.0, 0.5], stiffness=15.0, damping=10.0)
    sensor = ForceSensor(noise=0.1, delay=5e-3, period=1e-2)
    log = simulate(shoulder, controller, duration=15.0, dt=5e-3, disturbance=Step(FORCE), sensors=[sensor])
    np.testing.assert_allclose(log.position[-1], np.array([1.0, 0.5]) + FORCE / 15.0, atol=0.1 / 15.0)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"noise": -1.0}, "noise: must be >= 0"),
        ({"bias": np.nan}, "bias: must be finite"),
        ({"delay": -0.1}, "delay: must be >= 0"),
        ({"period": 0.0}, "period: must be > 0"),
        ({"saturation": 0.0}, "saturation: must be > 0"),
        ({"quantity": "total_force", "frame": "tool"}, "a wrench sensor at a frame shows external_force"),
    ],
)
def test_bad_sensors_are_refused(arguments, complaint):
    with pytest.raises(InvalidArgumentError, match=complaint):
        ForceSensor(**arguments)


def test_sensors_that_do_not_fit_the_arm_are_refused(shoulder):
    controller = make_controller("force_feedback_measured", shoulder)
    for sensor, error, complaint in [
        (ForceSensor(noise=[1.0, 1.0, 1.0]), InvalidArgumentError, r"noise: must be a scalar or have shape \(2,\)"),
        (ForceSensor(frame="tool", bias=[1.0, 1.0]), InvalidArgumentError, r"have shape \(6,\)"),
        (ForceSensor(frame="hand"), UnknownNameError, "unknown frame 'hand'"),
        (ForceSensor(period=0.0015), InvalidArgumentError, "period: must be a whole multiple of dt"),
    ]:
        with pytest.raises(Exception, match=complaint) as caught:
            simulate(shoulder, controller, duration=0.01, sensors=[sensor])
        assert error is type(caught.value) or isinstance(caught.value.__cause__, error)
    with pytest.raises(UnknownNameError, match="unknown quantity 'torque'"):
        ForceSensor("torque")
    with pytest.raises(InvalidArgumentError, match="must not have two for the same quantity"):
        simulate(shoulder, controller, duration=0.01, sensors=[ForceSensor(), ForceSensor()])


def test_a_law_without_its_sensor_says_which(shoulder):
    controller = make_controller("total_force_rejection", shoulder)
    with pytest.raises(Exception, match="needs the measurement 'total_force'"):
        simulate(shoulder, controller, duration=0.01, sensors=[ForceSensor()])
