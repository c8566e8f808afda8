"""The hand on a spring: which way it is led, what is said of its error, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import InvalidArgumentError
from phcontrol.runs.cartesian import RADIUS, TRAVEL_TIME, WAY, _path, run_cartesian
from tests.conftest import make_system


def test_the_line_goes_along_y_and_the_circle_is_upright_and_closed():
    arm = make_system("pera")
    start = arm.robot.near_home()
    hand = arm.at(start).placement("tool").translation
    way = _path(arm, "tool", start, "line")
    np.testing.assert_allclose(way.at(0.0).position, hand, atol=1e-12)
    np.testing.assert_allclose(way.at(TRAVEL_TIME).position, hand + np.array([0.0, WAY, 0.0]), atol=1e-12)
    way = _path(arm, "tool", start, "circle")
    points = np.array([way.at(t).position for t in np.linspace(0.0, TRAVEL_TIME, 9)]) - hand
    np.testing.assert_allclose(points[[0, -1]], 0.0, atol=1e-12)
    np.testing.assert_allclose(points[4], [0.0, 0.0, -2.0 * RADIUS], atol=1e-12)
    np.testing.assert_allclose(points[:, 0], 0.0, atol=1e-12)  # round the world's x
    np.testing.assert_allclose(np.linalg.norm(points - [0.0, 0.0, -RADIUS], axis=1), RADIUS, atol=1e-12)


def test_what_is_said_is_the_error_at_the_end():
    arm, push = make_system("pera"), np.array([4.0, 0.0, -3.0, 0.2, 0.0, 0.0])
    run = run_cartesian(arm, push=push, stiffness=[300.0] * 3 + [20.0] * 3, duration=0.5, dt=5e-3, samples=1)
    motion, law_goal = run.log.frame(run.frame), arm.at(arm.robot.near_home()).placement(run.frame)
    off = np.linalg.norm(motion.position[-1] - law_goal.translation)
    between = motion.rotation[-1] @ law_goal.rotation.T
    turn = np.arccos(0.5 * (np.trace(between) - 1.0))
    assert run.final_error == pytest.approx(off, rel=1e-9)
    assert run.to_dict()["final_turn"] == pytest.approx(turn, rel=1e-6)
    assert turn > 1e-3
    assert run.outcome == f"{1e3 * off:.3g} mm and {1e3 * turn:.3g} mrad of the hand ({run.frame})"


def test_numbers_are_three_or_six():
    arm = make_system("pera")
    for name in ("push", "stiffness"):
        for wrong in ([1.0, 2.0], [1.0] * 4, [[1.0] * 3]):
            with pytest.raises(InvalidArgumentError, match=f"{name}: must be"):
                run_cartesian(arm, **{name: wrong})
