"""From camera to grasp: where objects are, how the hand gets there, and what is said when it goes wrong."""

from __future__ import annotations

import inspect
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from phcontrol import MarkerDetector, MechanicalSystem, Renderer, check_limits, load_robot
from phcontrol.cli import app
from phcontrol.cli.run_pick import pick as command
from phcontrol.controllers.event_schedule import STOP, HandOver
from phcontrol.runs.pick import FORCE, START, pick_schedule, run_pick
from phcontrol.runs.pick_reach import way_in_image
from phcontrol.runs.pick_scene import FEATURES, MARKER, WatchedView, length_of, pick_camera, random_object
from phcontrol.simulation.closed_loop import simulate
from phcontrol.vision.marker_print import MarkerPrint
from tests.vision.markers import marker_image

SYSTEM = MechanicalSystem(load_robot("pera_with_gripper"))
CAMERA = pick_camera().mounted_on(SYSTEM.robot)
POSES = [random_object(CAMERA, SYSTEM.at(START), np.random.default_rng([7, k])) for k in range(12)]


@pytest.mark.parametrize("features", FEATURES)
def test_objects_are_seen_where_they_are(features):
    """Through a lens that bends, tilted by up to 9 degrees: to a pixel, and a length to 4 %."""
    x = SYSTEM.at(START)
    for number in range(12):
        thing = random_object(CAMERA, x, np.random.default_rng([7, number]), features)
        found = WatchedView(thing, features)(x.placement("camera"), np.random.default_rng(number))
        assert thing.length == length_of(features)
        assert np.abs(found - thing.features(x))[:2].max() < CAMERA.pixel_size
        assert found[2] == pytest.approx(thing.features(x)[2], rel=0.04)


def test_a_printed_marker_is_what_rays_of_light_show():
    """The renderer's image against one that is made ray by ray, in the middle of the marker's face."""
    x, thing = SYSTEM.at(START), POSES[0]
    detector = MarkerDetector(MARKER, dictionary="4X4_50")
    drawn = Renderer(thing, blur=0.0, printed=MarkerPrint(detector)).render(x.placement("camera"))
    pose = x.placement("camera").actInv(_pose(thing))
    cast = marker_image(CAMERA, pose, MARKER, 0, "4X4_50", fineness=4)
    column, row = np.round(CAMERA.to_pixels(thing.features(x))[:2]).astype(int)
    middle = np.s_[row - 10 : row + 11, column - 10 : column + 11]
    difference = np.abs(drawn[middle].astype(int) - cast[middle].astype(int))
    assert cast[middle].std() > 80  # black and white
    assert difference.mean() < 8
    assert np.abs(drawn[middle].astype(int) - np.roll(cast, 1, axis=1)[middle]).mean() > 3 * difference.mean()


def _pose(thing):
    import pinocchio as pin

    return pin.SE3(np.array(thing.rotation), np.array(thing.position))


def test_the_way_is_straight_in_the_image_within_the_limits_and_at_rest_at_its_ends():
    schedule = pick_schedule(SYSTEM, CAMERA, MARKER)
    goal = np.array([0.0, -0.05, MARKER]) * CAMERA.focal_length / 0.11
    np.testing.assert_allclose(schedule.eyes.goal, goal, atol=1e-12)  # the grip point, 5 cm beside and 11 cm before it
    for thing in POSES[:4]:
        way = way_in_image(SYSTEM, thing, np.array(START), goal)
        first = thing.features(SYSTEM.at(START))
        np.testing.assert_allclose(way.at(0.0).position, START, atol=1e-12)
        np.testing.assert_allclose(way.at(0.0).velocity, 0.0, atol=1e-9)
        np.testing.assert_allclose(way.at(way.duration).velocity, 0.0, atol=1e-9)
        last = thing.features(SYSTEM.at(way.at(way.duration).position))
        np.testing.assert_allclose(last, goal, atol=1e-9)
        for t in np.linspace(0.0, way.duration, 40):
            seen = thing.features(SYSTEM.at(way.at(float(t)).position))
            share = (seen - first) @ (goal - first) / ((goal - first) @ (goal - first))
            assert np.abs(seen - first - share * (goal - first)).max() < 1e-4  # [m] beside the line
        report = check_limits(way, SYSTEM)
        assert not [peak for peak in report.violations if peak.quantity == "velocity"]


@pytest.fixture
def phases(monkeypatch):
    monkeypatch.setattr("phcontrol.runs.pick.EventSchedule", list)
    return {phase.name: phase for phase in pick_schedule(SYSTEM, CAMERA, MARKER)}


def test_the_hand_is_led_to_what_is_seen_and_stays_where_nothing_is(phases):
    goal, start = np.array([0.0, -0.05, MARKER]) * CAMERA.focal_length / 0.11, np.array(START)
    above = [thing for thing in POSES if thing.features(SYSTEM.at(START))[1] < 0.0]
    below = [thing for thing in POSES if thing.features(SYSTEM.at(START))[1] > 0.0]
    for thing in (above[0], below[0]):
        way = phases["reach"].law(HandOver(start, start, thing.features(SYSTEM.at(START)))).reference
        np.testing.assert_allclose(thing.features(SYSTEM.at(way.at(way.duration).position)), goal, atol=1e-9)
        assert np.abs(way.at(way.duration).position - start).max() > 0.1
    way = phases["reach"].law(HandOver(start, start, np.zeros(3))).reference
    np.testing.assert_allclose(way.at(way.duration).position, start, atol=1e-6)


@pytest.mark.parametrize(("gripper", "closed_to"), [(0.9, 0.44), (0.3, 0.3)])
def test_only_the_fingers_close_and_never_open(phases, gripper, closed_to):
    position = np.array([*START[:-1], gripper])
    way = phases["close"].law(HandOver(position, np.zeros(8), np.zeros(3))).reference
    np.testing.assert_allclose(way.at(0.0).position, position, atol=1e-12)
    np.testing.assert_allclose(way.at(way.duration).position, [*START[:-1], closed_to], atol=1e-12)


def test_objects_are_turned_to_both_sides_of_across():
    seen = SYSTEM.at(START).placement("camera").rotation.T
    turned = [np.arctan2(*(seen @ thing.rotation)[1, :2]) - 0.5 * np.pi for thing in POSES]
    assert np.abs(turned).max() < 0.6
    assert min(turned) < -0.1
    assert max(turned) > 0.1


def test_the_command_has_the_defaults_of_the_function():
    ours, theirs = (inspect.signature(function).parameters for function in (run_pick, command))
    shared = ours.keys() & theirs.keys()
    assert {"objects", "seed", "duration"} <= shared
    for name in shared - {"camera"}:
        assert ours[name].default == theirs[name].default, name


def test_what_is_not_in_view_is_waited_for_and_then_the_chain_stops():
    """The object is behind the arm: nothing moves, and the schedule says what did not come."""
    schedule = pick_schedule(SYSTEM, CAMERA, MARKER)
    unseen = np.full(3, np.nan)

    class Blind:
        quantity, period = "features", None

        def start(self, x, external_force):
            return None

        def update(self, state, t, x, external_force, torque):
            return None

        def reading(self, state):
            return unseen

    from phcontrol import ForceSensor

    log = simulate(SYSTEM, schedule, duration=3.2, dt=4e-3, q0=START, control_period=4e-3,
                   sensors=[Blind(), ForceSensor()])  # fmt: skip
    assert schedule.phase(log.controller_state[-1]) == STOP
    assert "STOPPED since 3.00 s, out of 'look': nothing of 'seen' within 3 s" in schedule.report(
        log.controller_state[-1]
    )
    np.testing.assert_allclose(log.position[-1], START, atol=1e-3)


@pytest.fixture(scope="module")
def one():
    return run_pick(objects=1, seed=3, samples=16)


@pytest.mark.study
def test_one_object_is_seen_reached_and_held(one):
    (pick,) = one.picks
    assert pick.held
    assert pick.in_view
    assert [switch.entering for switch in pick.switches] == ["reach", "servo", "close", "grasp", "hold"]
    assert abs(one.log.contact_force[-250:].mean() - FORCE) < 0.02 * FORCE
    assert pick.distance < 0.003
    assert pick.departures == ()
    assert pick.switches[0].torque_jump < 1e-9  # led from where it rests
    assert max(switch.torque_jump for switch in pick.switches) < 10.0  # [N·m]; 69 if the servo began at once
    assert one.passed
    # the fingers do not touch before they close
    close = next(switch.time for switch in pick.switches if switch.entering == "close")
    assert (one.log.contact_force[one.log.time < close] == 0.0).all()


@pytest.mark.study
def test_an_orange_object_is_seen_reached_and_held():
    """By its colour, whose length in the image depends on the tilt: less near than by a marker."""
    (pick,) = run_pick(objects=1, seed=3, samples=0, features="colour").picks
    assert pick.held
    assert pick.in_view
    assert pick.distance < 0.012


@pytest.mark.study
def test_its_files_and_its_summary(one, tmp_path):
    files = one.write(tmp_path)
    assert {file.name for file in files} == {"log.npz", "picks.json", "certificates.json", "pick.png"}
    (record,) = json.loads((tmp_path / "picks.json").read_text())
    assert record["held"] is True
    assert [switch["entering"] for switch in record["switches"]][-1] == "hold"
    assert "in view in every image: 1 of 1" in one.summary()
    assert "held with 0.5 N·m within 2 %: 1 of 1" in one.summary()


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--objects", "0"], "greater than or equal to 1"),
        (["--features", "smell"], "unknown features 'smell'"),
        (["--duration", "-1"], "duration"),
        (["--camera", "no.yaml"], "cannot read the calibration no.yaml"),
    ],
)
def test_the_command_refuses_what_makes_no_sense(tmp_path, monkeypatch, arguments, problem):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["run", "pick", *arguments])
    assert result.exit_code == 2
    assert problem in " ".join(result.output.replace("│", " ").split())
    assert list(tmp_path.iterdir()) == []  # refused before anything is made


@pytest.mark.study
def test_one_that_is_not_done_in_time_is_no_success(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["run", "pick", "--objects", "1", "--duration", "2", "--samples", "0"])
    assert result.exit_code == 1
    assert "NOT HELD: in 'reach' since 0.10 s" in result.output
