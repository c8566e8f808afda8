"""A camera beside a control loop: prediction in between, frames that are late, wrong or missing, an arm that servos."""

from __future__ import annotations

import threading

import numpy as np
import pinocchio as pin
import pytest

import phcontrol as ph
from phcontrol import CameraThread, ControlLoop, InvalidArgumentError, LoopCamera, LoopMode, PHControlError, SeenFrame
from tests.conftest import make_system

SYSTEM = make_system("pera_shoulder_elbow")
CAMERA = ph.PinholeCamera(image_size=(320, 240), field_of_view=1.2).mounted_on(SYSTEM.robot)
START = [0.004, 0.002, 0.0025]
THING = ph.ObservedObject.seen_as(CAMERA, START, SYSTEM.at(SYSTEM.robot.home), (0.038, 0.015, 0.01))
PERIOD = 2e-3


class Frames:
    """Frames that a test puts in."""

    def __init__(self):
        self.waiting = []

    def frames(self):
        waiting, self.waiting = self.waiting, []
        return waiting


def moving(t):
    return SYSTEM.robot.home + np.array([0.03 * np.sin(2.0 * t), -0.03 * np.sin(3.0 * t), 0.02 * t])


def seen_at(t):
    return THING.features(SYSTEM.at(moving(t)))


def test_between_and_after_frames_the_features_are_those_of_now():
    source = Frames()
    camera = LoopCamera(source, CAMERA, SYSTEM.robot, THING.length, patience=0.2)
    late, rate = 0.045, 25.0
    sent, off = 0, []
    for k in range(500):
        t = 0.3 + k * PERIOD
        while sent / rate + 0.3 + late <= t:
            source.waiting.append(SeenFrame(sent / rate + 0.3, seen_at(sent / rate + 0.3)))
            sent += 1
        found = camera.features(t, moving(t))
        off.append(np.abs(found - seen_at(t)).max())
    assert np.isnan(off[: round(late / PERIOD) - 1]).all()  # nothing has come yet
    assert np.nanmax(off) < 2e-8  # [m]: what lies between two readings, of millimetres that it moved
    assert np.abs(seen_at(0.5) - seen_at(0.45)).max() > 5e-5
    # as if a frame were of the instant when it comes, it would be off by a thousand times more
    assert np.abs(seen_at(0.5) - seen_at(0.5 - late)).max() > 1000 * np.nanmax(off)


def test_after_the_patience_it_is_lost_and_then_found_again():
    source = Frames()
    camera = LoopCamera(source, CAMERA, SYSTEM.robot, THING.length, patience=0.1)
    home = SYSTEM.robot.home
    source.waiting = [SeenFrame(0.0, np.array(START))]
    shown = {}
    for k in range(200):
        t = k * PERIOD
        if k == 40:
            source.waiting = [SeenFrame(t, None)]  # does not show it: does not count
        if k == 150:
            source.waiting = [SeenFrame(t - 0.02, np.array(START))]
        shown[k] = camera.features(t, home)
    np.testing.assert_allclose(shown[50], START, atol=1e-12)
    assert np.isnan(shown[51]).all()
    assert np.isnan(shown[149]).all()
    np.testing.assert_allclose(shown[150], START, atol=1e-12)
    assert camera.counts == {"frames": 3, "seen": 2, "not used": 0}


@pytest.mark.parametrize(
    "frame",
    [
        SeenFrame(5.0, np.array(START)),  # of the future
        SeenFrame(-2.0, np.array(START)),  # from before anything is known
        SeenFrame(np.nan, np.array(START)),
        SeenFrame(0.1, np.array(START)),  # older than the last
        SeenFrame(0.2, np.array(START)),  # the same again
    ],
)
def test_frames_that_cannot_be_placed_are_not_used(frame):
    source = Frames()
    camera = LoopCamera(source, CAMERA, SYSTEM.robot, THING.length, patience=9.0)
    for k in range(200):
        camera.features(k * PERIOD, SYSTEM.robot.home)
        if k == 110:
            source.waiting = [SeenFrame(0.2, np.array([0.001, 0.0, 0.002]))]
    source.waiting = [frame]
    np.testing.assert_allclose(camera.features(0.4, SYSTEM.robot.home), [0.001, 0.0, 0.002], atol=1e-12)
    assert camera.counts["not used"] == 1


@pytest.mark.parametrize(
    "features", [[np.nan] * 3, [0.0, 0.0, -1e-3], [0.0, 0.0, 0.0], [0.1, 0.0, 1e-3], [0.0, 0.0, np.inf]]
)
def test_features_that_are_none_count_as_not_seen(features):
    source = Frames()
    camera = LoopCamera(source, CAMERA, SYSTEM.robot, THING.length)
    source.waiting = [SeenFrame(0.0, np.array(features))]
    assert np.isnan(camera.features(0.0, SYSTEM.robot.home)).all()


@pytest.mark.parametrize("early", [0.0, 5e-10])
def test_a_frame_of_this_very_instant_was_taken_where_the_camera_is_now(early):
    """Rounding may put it behind the newest reading: it was taken at that one, not at the one before."""
    source = Frames()
    camera = LoopCamera(source, CAMERA, SYSTEM.robot, THING.length)
    for t in (0.1, 0.2):
        camera.features(t, moving(t))
    source.waiting = [SeenFrame(0.3 + early, seen_at(0.3))]
    np.testing.assert_allclose(camera.features(0.3, moving(0.3)), seen_at(0.3), atol=1e-12)
    assert np.abs(seen_at(0.3) - seen_at(0.2)).max() > 1e-5
    assert camera.counts == {"frames": 1, "seen": 1, "not used": 0}


def test_frames_are_taken_at_their_times_from_the_first_on_and_come_late():
    """At 100 frames a second and 15 ms late, in periods of 5 ms: taken at 0, 10, 20, ... ms."""
    box = ph.ControlBox(SYSTEM, period=5e-3)
    source = ph.SimulatedCamera(box, CAMERA, lambda placement, noise: np.array(START), rate=100.0, latency=0.015)
    came = []
    for _ in range(10):
        came.append([round(frame.taken, 9) for frame in source.frames()])
        box.advance()
    assert came == [[], [], [], [0.0], [], [0.01], [], [0.02], [], [0.03]]


class Blinking(ph.RenderedView):
    """A rendered view that is covered between two instants of its frames."""

    def __init__(self, covered, rate):
        super().__init__(ph.Renderer(THING, grey_noise=2.0))
        self.covered, self.rate, self.number = covered, rate, 0

    def __call__(self, placement, generator):
        t, self.number = self.number / self.rate, self.number + 1
        return None if self.covered[0] <= t < self.covered[1] else super().__call__(placement, generator)


def served(seconds, covered=(9.0, 9.0), view=None, rate=30.0, **options):
    """An arm in this process that servos by rendered images; the loop, its modes and features over time."""
    box = ph.ControlBox(SYSTEM, period=PERIOD)
    source = ph.SimulatedCamera(box, CAMERA, view or Blinking(covered, rate), rate=rate)
    camera = LoopCamera(source, CAMERA, SYSTEM.robot, THING.length, patience=0.15)
    law = ph.HamiltonianServo.tuned(SYSTEM, camera=CAMERA, object_length=THING.length, **({"lost": "hold"} | options))
    loop = ControlLoop(SYSTEM, law, PERIOD, camera=camera, clock=lambda: box.time, deadline=10.0)
    modes, features, speeds = [], [], []

    def note(t, reading, torque):
        modes.append(loop.mode)
        features.append(THING.features(SYSTEM.at(reading.position)))
        speeds.append(np.abs(reading.velocity).max())

    ph.drive(loop, ph.SimulatedArm(box), seconds, each_step=note)
    return loop, law, modes, np.array(features), np.array(speeds)


def test_an_arm_servos_by_images_of_thirty_a_second():
    loop, law, modes, features, _ = served(5.0)
    assert loop.fault is None
    assert loop.counts == {"stale": 0, "implausible": 0, "measured": 0, "stops": 0, "lost": 0}
    assert modes[-1] == LoopMode.RUNNING
    off = np.abs(features - law.goal).max(axis=1)
    assert off[0] > 3e-3
    assert off[-1] < 3 * CAMERA.pixel_size  # what is found in pixels
    assert loop._camera.counts["frames"] == 150 - 1  # one of them still on its way


def test_while_it_sees_nothing_it_holds():
    loop, law, modes, features, speeds = served(4.0, covered=(0.5, 1.5))
    assert loop.fault is None
    t = np.arange(len(speeds)) * PERIOD
    assert speeds[(t > 0.3) & (t < 0.6)].max() > 0.05
    assert speeds[(t > 1.3) & (t < 1.5)].max() < 0.01
    assert np.abs(features - law.goal).max(axis=1)[-1] < 5 * CAMERA.pixel_size


def test_a_law_that_does_not_hold_stops_the_loop():
    loop, _, modes, _, speeds = served(2.0, covered=(0.5, 9.0), lost="error")
    assert isinstance(loop.fault, ph.ObjectLostError)
    assert modes[-1] == LoopMode.STOPPED
    assert speeds[-1] < 1e-2


def test_a_camera_that_fails_stops_the_loop():
    def failing(placement, generator):
        if np.linalg.norm(placement.translation - HOME.translation) > 1e-3:
            raise RuntimeError("cable pulled")
        return THING.features_from(placement)

    HOME = SYSTEM.robot.placement(CAMERA.frame, SYSTEM.robot.home)
    loop, _, modes, _, speeds = served(2.0, view=failing)
    assert "cable pulled" in loop.reason
    assert loop.mode == LoopMode.STOPPED
    assert speeds[-1] < 0.05


def test_a_thread_finds_the_object_in_images_and_keeps_nobody_waiting():
    image = ph.Renderer(THING).render(SYSTEM.robot.placement(CAMERA.frame, SYSTEM.robot.home))
    go, served_all = threading.Event(), threading.Event()
    times = iter([0.0, 0.1, 0.2])

    def grab():
        go.wait(5.0)
        t = next(times, None)
        if t is None:
            served_all.set()
            threading.Event().wait(0.01)
            return None
        return image, t

    with CameraThread(grab, ph.extract_features, CAMERA) as thread:
        assert thread.frames() == []
        go.set()
        assert served_all.wait(5.0)
        frames = thread.frames()
        assert thread.frames() == []
    assert [frame.taken for frame in frames] == [0.0, 0.1, 0.2]
    for frame in frames:
        np.testing.assert_allclose(frame.features, START, atol=2 * CAMERA.pixel_size)


@pytest.mark.parametrize(
    ("grab", "problem"),
    [
        (lambda: 1 / 0, "ZeroDivisionError"),
        (lambda: (np.zeros((3, 3), np.uint8), 0.0), "image: must be uint8"),
        (lambda: 5, "TypeError"),
    ],
)
def test_a_thread_that_ends_by_an_error_says_so(grab, problem):
    with CameraThread(grab, ph.extract_features, CAMERA) as thread:
        thread._thread.join(5.0)
        with pytest.raises(PHControlError, match=f"the camera's thread ended: .*{problem}"):
            thread.frames()


def test_what_is_no_camera_is_refused():
    with pytest.raises(InvalidArgumentError, match="must have frames"):
        LoopCamera(None, CAMERA, SYSTEM.robot, 0.03)
    with pytest.raises(InvalidArgumentError, match="object_length"):
        LoopCamera(Frames(), CAMERA, SYSTEM.robot, 0.0)
    law = ph.make_controller("energy_shaping", SYSTEM)
    with pytest.raises(InvalidArgumentError, match="must be a LoopCamera"):
        ControlLoop(SYSTEM, law, PERIOD, camera=CAMERA)
    assert isinstance(SYSTEM.robot.placement(CAMERA.frame, SYSTEM.robot.home), pin.SE3)
