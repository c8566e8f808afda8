"""A camera at frame rate: frames, latency, prediction in between, and losing the object."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import CameraSensor, InvalidArgumentError, ObservedObject, PinholeCamera, make_controller, simulate
from tests.conftest import make_system

GOAL = np.array([0.0, 0.0, 0.002])
START = np.array([0.003, -0.002, 0.0014])


def setup(camera=None):
    system = make_system("pera_shoulder_elbow")
    camera = (camera or PinholeCamera()).mounted_on(system.robot)
    return system, ObservedObject.seen_as(camera, START, system.at(system.robot.home))


class Counting:
    """A source that notes when it was asked, and is blind after a while."""

    def __init__(self, scene, blind_after=10**9):
        self.scene, self.frames, self.blind_after = scene, 0, blind_after

    def __call__(self, placement, generator):
        self.frames += 1
        return None if self.frames > self.blind_after else self.scene.features_from(placement)


def run(system, scene, duration=0.5, lost="error", **options):
    law = make_controller("hamiltonian_servo", system, camera=scene.camera, lost=lost)
    sensor = CameraSensor(scene, **options)
    return simulate(system, law, duration=duration, dt=1e-3, control_period=1e-3, scene=scene, sensors=[sensor])


@pytest.mark.parametrize("latency", [None, 0.0, 0.1])
def test_the_prediction_is_exact_for_an_object_at_rest(latency):
    """From a frame that is late, over the arm's own motion, to now: no error is left but rounding."""
    system, scene = setup()
    log = run(system, scene, latency=latency)
    assert np.abs(log.features[-1] - log.features[0]).max() > 1e-3  # it moves
    np.testing.assert_allclose(log.measured["features"], log.features, atol=1e-12)


@pytest.mark.parametrize("rate", [30.0, 60.0, 100.0])
def test_frames_are_taken_at_their_rate(rate):
    system, scene = setup()
    source = Counting(scene)
    run(system, scene, rate=rate, source=source)
    assert source.frames == 1 + int(rate * 0.5)


def test_noise_is_held_from_frame_to_frame_and_moves_with_the_arm():
    """With noise each frame gives another point in space; between frames that point stays where it is."""
    system, scene = setup()
    log = run(system, scene, noise=2e-5, rate=20.0, latency=0.0)
    error = log.measured["features"] - log.features
    assert 1e-5 < error[::50].std() < 5e-5
    assert np.abs(np.diff(error[1:50], axis=0)).max() < 5e-7
    assert np.abs(np.diff(error, axis=0)).max() > 1e-5


def test_after_patience_a_lost_object_is_not_shown():
    system, scene = setup()
    log = run(system, scene, duration=1.0, source=Counting(scene, 5), rate=20.0, latency=0.0, patience=0.3, lost="hold")
    shown = np.isfinite(log.measured["features"]).all(axis=1)
    last = log.time[shown][-1]
    assert last == pytest.approx(0.2 + 0.3 + 0.05, abs=2e-3)  # the fifth frame, patience, one more frame's time
    assert not shown[log.time > last].any()


def test_a_frame_counts_from_when_it_was_taken_and_shows_from_when_it_arrives():
    system, scene = setup()
    law = make_controller("hamiltonian_servo", system, lost="hold")
    sensor = CameraSensor(scene, rate=10.0, latency=0.15, source=Blink(scene))
    log = simulate(system, law, duration=0.5, dt=1e-3, control_period=1e-3, scene=scene, sensors=[sensor])
    shown = np.isfinite(log.measured["features"]).all(axis=1)
    assert log.time[shown][0] == pytest.approx(0.25)  # the frame of 0.1 s is the first to show anything


class Blink:
    """Sees nothing in the first frame (at the start, twice asked: once to start, at 0)."""

    def __init__(self, scene):
        self.scene, self.first = scene, True

    def __call__(self, placement, generator):
        blind, self.first = self.first, False
        return None if blind else self.scene.features_from(placement)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"rate": 0.0}, "rate: must be > 0"),
        ({"latency": -0.1}, "latency: must be >= 0"),
        ({"noise": -1.0}, "noise: must be >= 0"),
        ({"patience": -1.0}, "patience: must be >= 0"),
    ],
)
def test_bad_cameras_are_refused(arguments, complaint):
    _, scene = setup()
    with pytest.raises(InvalidArgumentError, match=complaint):
        CameraSensor(scene, **arguments)
