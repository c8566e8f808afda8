"""When a sensor takes, shows and forgets what: each instant by itself, without a simulation around it."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

from phcontrol import CameraSensor, MechanicalSystem, ObservedObject, PinholeCamera, load_robot
from phcontrol.sensors.force_sensor import ForceSensor
from phcontrol.sensors.momentum_observer import MomentumObserver
from tests.conftest import make_system

SYSTEM = make_system("pera_shoulder_elbow")
CAMERA = PinholeCamera().mounted_on(SYSTEM.robot)
HOME = SYSTEM.robot.home
ZERO = np.zeros(3)
START = np.array([0.003, -0.002, 0.0014])
SCENE = ObservedObject.seen_as(CAMERA, START, SYSTEM.at(HOME))


class Frames:
    """Counts the frames, and shows the object in those that are told."""

    def __init__(self, seen=lambda number: True):
        self.count, self.seen = 0, seen

    def __call__(self, placement, generator):
        self.count += 1
        return SCENE.features_from(placement) if self.seen(self.count) else None


def shown_at(sensor, times, position=lambda t: HOME):
    """What the sensor shows after each of the times, updated at them alone."""
    state, shown = sensor.start(SYSTEM.at(position(0.0)), ZERO), []
    for t in times:
        state = sensor.update(state, t, SYSTEM.at(position(t)), ZERO, ZERO)
        shown.append(sensor.reading(state))
    return np.array(shown)


def seen_at(sensor, times):
    return np.isfinite(shown_at(sensor, times)).all(axis=1).tolist()


def test_a_frame_is_taken_when_its_time_has_come_but_for_rounding():
    for early, frames in [(1e-10, 3), (1e-8, 2)]:  # then the second is taken at 0.3, and the third not yet
        source = Frames()
        shown_at(CameraSensor(SCENE, rate=4.0, source=source), [0.1, 0.25 - early, 0.3, 0.5 - early])
        assert source.count == frames
    source = Frames()
    shown_at(CameraSensor(SCENE, rate=4.0, source=source), [0.0, 0.2])
    assert source.count == 1  # the one at the start


def test_a_frame_shows_when_its_latency_has_passed_but_for_rounding():
    for early, seen in [(1e-10, True), (1e-8, False)]:
        sensor = CameraSensor(SCENE, rate=4.0, latency=0.125, source=Frames(lambda number: number == 2))
        assert seen_at(sensor, [0.25, 0.3, 0.375 - early]) == [False, False, seen]


def test_an_object_is_shown_for_latency_patience_and_a_frame_after_it_was_seen():
    sensor = CameraSensor(SCENE, rate=4.0, latency=0.125, patience=0.5, source=Frames(lambda number: number == 1))
    assert seen_at(sensor, [0.0, 0.5, 0.875, 0.875001]) == [True, True, True, False]
    at_once = CameraSensor(SCENE, rate=4.0, latency=0.0, patience=0.0, source=Frames(lambda number: number == 2))
    assert seen_at(at_once, [0.125, 0.25, 0.375, 0.5, 0.501]) == [False, True, True, True, False]


def test_frames_that_overtake_none_show_the_newest_that_has_arrived():
    """Latency of more than a frame: several are on their way; each moves the point to where it saw the object."""
    elsewhere = [np.array([0.001 * k, 0.0, 0.002]) for k in range(5)]
    source = iter(elsewhere)
    sensor = CameraSensor(SCENE, rate=4.0, latency=0.625, source=lambda placement, generator: next(source))
    shown = shown_at(sensor, [0.25, 0.5, 0.75, 0.875, 1.125])
    expected = [elsewhere[0]] * 3 + [elsewhere[1], elsewhere[2]]
    np.testing.assert_allclose(shown, expected, atol=1e-12)
    source = iter(elsewhere)
    shown = shown_at(sensor, [0.25, 0.5, 1.2])  # two arrive together
    np.testing.assert_allclose(shown, [elsewhere[0], elsewhere[0], elsewhere[2]], atol=1e-12)


def test_a_camera_sees_what_is_in_its_image_alone():
    narrow = PinholeCamera(frame=CAMERA.frame, field_of_view=0.1)
    scene = ObservedObject.seen_as(narrow, START, SYSTEM.at(HOME))  # beside the image
    assert not seen_at(CameraSensor(scene, latency=0.0), [0.5])[0]
    centred = ObservedObject.seen_as(narrow, [0.0, 0.0, 0.002], SYSTEM.at(HOME))
    assert seen_at(CameraSensor(centred, latency=0.0), [0.5])[0]
    unnamed = CameraSensor(ObservedObject(PinholeCamera(), SCENE.position), latency=0.0)
    np.testing.assert_allclose(shown_at(unnamed, [0.0])[0], START, rtol=1e-12)


def test_noise_of_features_has_its_size_and_its_seed():
    def noise(seed):
        sensor = CameraSensor(SCENE, rate=100.0, latency=0.0, noise=2e-5, seed=seed)
        return shown_at(sensor, 0.01 * np.arange(1, 801)) - START

    np.testing.assert_allclose(noise(0).std(axis=0), 2e-5, rtol=0.1)
    np.testing.assert_array_equal(noise(3), noise(3))
    assert (noise(0) != noise(1)).all()
    sensor = CameraSensor(SCENE, latency=0.0, noise=2e-5)
    np.testing.assert_array_equal(
        shown_at(sensor, [0.1]), shown_at(CameraSensor(SCENE, latency=0.0, noise=2e-5, seed=0), [0.1])
    )


def test_the_usual_camera_is_the_one_of_the_documentation():
    sensor = CameraSensor(SCENE)
    assert (sensor.rate, sensor.latency, sensor.noise, sensor.patience, sensor.period) == (30.0, 1 / 30, 0.0, 0.3, None)
    assert all(p.kind is p.KEYWORD_ONLY for n, p in inspect.signature(CameraSensor).parameters.items() if n != "scene")


@pytest.mark.parametrize(("early", "shown"), [(1e-10, 1.0), (1e-8, 0.0)])
def test_a_force_shows_when_its_delay_has_passed_but_for_rounding(early, shown):
    sensor = ForceSensor(delay=0.25)
    state = sensor.start(SYSTEM.at(HOME), ZERO)
    for t, force in [(0.0, 1.0), (0.125, 2.0), (0.25 - early, 3.0)]:
        state = sensor.update(state, t, SYSTEM.at(HOME), np.full(3, force), ZERO)
    np.testing.assert_array_equal(sensor.reading(state), np.full(3, shown))


def test_a_force_sensor_keeps_only_what_is_on_its_way():
    sensor = ForceSensor(delay=0.04)
    state = sensor.start(SYSTEM.at(HOME), ZERO)
    for k in range(50):
        state = sensor.update(state, 0.01 * k, SYSTEM.at(HOME), np.full(3, float(k)), ZERO)
        assert len(state.times) == len(state.values) <= 4
    np.testing.assert_array_equal(sensor.reading(state), np.full(3, 45.0))


def test_a_wrench_that_a_joint_force_is_not_of_is_the_nearest(rng):
    """Three joints feel the least-squares wrench, of least size: 𝒥ᵀF is f_e where 𝒥ᵀ has full rank."""
    x, force = SYSTEM.at(HOME + 0.1), rng.normal(size=3)
    sensor = ForceSensor(frame="tool", saturation=[1e3, 1e3, 1e3, 1e-3, 1e3, 1e3])
    state = sensor.update(sensor.start(x, force), 0.0, x, force, ZERO)
    jacobian = x.frame_jacobian("tool", "local")
    wrench = np.linalg.pinv(jacobian.T) @ force
    wrench[3] = np.clip(wrench[3], -1e-3, 1e-3)
    np.testing.assert_allclose(sensor.reading(state), jacobian.T @ wrench, atol=1e-9)


def test_the_observer_explains_all_but_the_external_force():
    """One long step against the momentum's balance, written again: (p₁ − p₀)/T less mean modeled force and motors."""
    system = MechanicalSystem(load_robot("pera_shoulder"), input_matrix=np.diag([3.0, 0.5]))
    observer = MomentumObserver(system, gain=4.0)
    before, after = system.at([0.1, -0.2], [0.4, 0.3]), system.at([0.3, 0.1], [-0.2, 0.5])
    torque, elapsed = np.array([0.7, -1.1]), 0.25
    state = observer.start(before, np.zeros(2))
    assert not observer.reading(state).any()
    assert observer.update(state, 0.0, after, np.zeros(2), torque) is state
    unexplained = (after.momentum - before.momentum) / elapsed - [2.1, -0.55]
    unexplained -= (before.total_force(np.zeros(2)) + after.total_force(np.zeros(2))) / 2.0
    once = observer.update(state, elapsed, after, np.zeros(2), torque)
    np.testing.assert_allclose(observer.reading(once), (1.0 - np.exp(-1.0)) * unexplained, rtol=1e-12)
    twice = observer.update(once, 2.0 * elapsed, after, np.zeros(2), np.zeros(2))
    expected = np.exp(-1.0) * observer.reading(once) - (1.0 - np.exp(-1.0)) * after.total_force(np.zeros(2))
    np.testing.assert_allclose(observer.reading(twice), expected, rtol=1e-12)
    assert MomentumObserver(system).gain == 50.0
    assert MomentumObserver(system).period is None
    assert MomentumObserver(system, period=0.01).period == 0.01
