"""Changing a run from its page: what is dragged arrives, and what makes no sense does not."""

from __future__ import annotations

import json
import threading

import numpy as np
import pytest

from phcontrol import EnergyShaping, InvalidArgumentError, LiveView, MechanicalSystem, load_robot, simulate
from phcontrol.potentials import FrameSpring
from phcontrol.setpoints import LiveFramePath, LiveTrajectory, LiveValue, Setpoint
from phcontrol.visualization.live_controls import LiveControls

FRAME = "panda_hand_tcp"


def setpoint_of(panda: MechanicalSystem) -> Setpoint:
    place = panda.at(panda.robot.home).placement(FRAME)
    stiffness = LiveValue([600.0, 600.0, 300.0], rate=1000.0, unit="N/m")
    return Setpoint(goal=LiveFramePath(FRAME, place), stiffness=stiffness, posture=LiveTrajectory(panda.robot))


def message(part, values) -> bytes:
    return json.dumps({"part": part, "values": values}).encode()


def test_sliders_are_what_can_be_asked_for():
    panda = MechanicalSystem(load_robot("panda"))
    setpoint = setpoint_of(panda)
    controls = LiveControls(setpoint)
    start = setpoint.parts["goal"].goal
    assert [slider["value"] for slider in controls.sliders[:3]] == pytest.approx(list(start.position))
    assert len(controls.sliders) == 6 + 3 + panda.n
    assert controls.take(message("goal", [*(start.position + 0.1), 0.0, 0.0, 0.5]))
    asked = setpoint.parts["goal"].goal
    turn = np.array([[np.cos(0.5), -np.sin(0.5), 0.0], [np.sin(0.5), np.cos(0.5), 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(asked.rotation, turn @ start.rotation, atol=1e-14)
    np.testing.assert_allclose(asked.position, start.position + 0.1)
    assert controls.take(message("stiffness", [900.0, 600.0, 300.0]))
    assert controls.take(message("posture", list(panda.robot.home)))
    setpoint.advance(0.0)
    np.testing.assert_allclose(setpoint.parts["stiffness"](9.0), [900.0, 600.0, 300.0])


@pytest.mark.parametrize(
    "hostile",
    [
        b"", b"\xff\xfe", b"null", b"[]", b"{}", b"[" * 4000, b'{"part": "goal"}', b'{"part": [], "values": [1]}',
        message("nothing", [1.0]), message("goal", [0.0] * 5), message("goal", "far"), message("goal", None),
        message("goal", [9.0, 0.0, 0.0, 0.0, 0.0, 0.0]), message("goal", [float("nan")] * 6),
        message("stiffness", [-1.0, 600.0, 300.0]), message("stiffness", [float("inf")] * 3),
        message("at", [1.0]), message("posture", [[0.0] * 7]), message("stiffness", {"a": 1}),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_not_passed_on(hostile):
    setpoint = setpoint_of(MechanicalSystem(load_robot("panda")))
    controls, before = LiveControls(setpoint), {name: part.goal for name, part in setpoint.parts.items()}
    assert not controls.take(hostile)
    assert controls.refused == 1
    for name, part in setpoint.parts.items():
        assert part.goal is before[name]


def test_ranges_must_hold_what_there_is():
    setpoint = setpoint_of(MechanicalSystem(load_robot("panda")))
    for ranges, words in (({"goal": (0.0, 1.0)}, "for values"), ({"stiffness": (700.0, 900.0)}, "must hold"),
                          ({"stiffness": (900.0, 100.0)}, "must hold")):  # fmt: skip
        with pytest.raises(InvalidArgumentError, match=words):
            LiveControls(setpoint, ranges=ranges)
    with pytest.raises(InvalidArgumentError, match="reach"):
        LiveControls(setpoint, reach=0.0)


@pytest.mark.browser
@pytest.mark.xdist_group("browser")
def test_a_hand_is_dragged_while_the_arm_runs(browser):
    """The handle is drawn where the hand is; the mouse moves it; the arm goes there, and stops where it was let go."""
    panda = MechanicalSystem(load_robot("panda"))
    place = panda.at(panda.robot.home).placement(FRAME)
    goal = LiveFramePath(FRAME, place, speed=0.5)
    spring = FrameSpring(FRAME, place, translational_stiffness=600.0, rotational_stiffness=30.0)
    law, setpoint = EnergyShaping.tuned(panda, potential=spring, reference=goal), Setpoint(goal=goal)
    done = threading.Event()
    with LiveView(port=0, real_time=False, controls=setpoint, announce=lambda server: None) as view:
        started = threading.Event()

        def watch(log):
            view(log)
            started.set()
            if done.is_set() and goal.has_arrived:
                raise KeyboardInterrupt  # as a user ends it

        def run():
            with pytest.raises(KeyboardInterrupt):
                simulate(panda, law, duration=3600.0, dt=2e-2, control_period=None, setpoint=setpoint, watch=watch)

        thread = threading.Thread(target=run)
        thread.start()
        try:
            assert started.wait(60.0)
            with browser.open(view.server.address) as page:
                x, y = page.evaluate("phcontrol.handle('goal')")
                page.mouse.move(x, y)
                page.mouse.down()
                page.mouse.move(x + 60, y - 40, steps=5)
                page.mouse.up()
                page.wait_for_timeout(500)
                asked = goal.goal.position
                assert 0.03 < np.linalg.norm(asked - place.translation) < 0.3
                assert asked[2] > place.translation[2]  # upwards
                slider = page.get_by_label("goal x")
                assert float(slider.input_value()) == pytest.approx(asked[0], abs=1e-3)
                assert page.problems == []
        finally:
            done.set()
            thread.join(120.0)
        assert not thread.is_alive()
        assert view.controls.refused == 0
    here = goal.at(setpoint.time).position
    np.testing.assert_allclose(here, asked, atol=1e-9)
