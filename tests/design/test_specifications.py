"""What a specification asks for is what the loop then does, looked at in another way."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    DesiredBandwidth,
    DesiredGain,
    DesiredSettling,
    InvalidArgumentError,
    MechanicalSystem,
    MinimumJerk,
    PHControlError,
    SamplingBudget,
    TorqueBudget,
    design_gains,
    l2_gain,
    linearize,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.design.desired_settling import settling_of
from phcontrol.design.largest_bandwidth import largest_bandwidth


@pytest.fixture(scope="module")
def ur5():
    return MechanicalSystem(load_robot("ur5"))


# --- stiffness and settling time --------------------------------------------------------------------


@pytest.mark.parametrize("time", [0.28, 0.36, 1.2])
def test_the_hand_settles_in_time(ur5, time):
    """Every mode of the hand, simulated from a displacement along it: within 5 % from the time on."""
    goal, stiffness = ur5.robot.near_home(), 1500.0
    desired = DesiredSettling(stiffness, time, rotational_stiffness=150.0)
    found = design_gains("cartesian_impedance", ur5, desired, goal)
    np.testing.assert_array_equal(found.gains["translational_stiffness"], stiffness * np.eye(3))
    assert found.met
    x, law = ur5.at(goal), found.law
    jacobian = x.frame_jacobian(law.frame, "local_world_aligned")
    K = np.diag([1500.0] * 3 + [150.0] * 3)
    squares, modes = np.linalg.eig(jacobian @ np.linalg.solve(x.mass_matrix, jacobian.T) @ K)
    slowest = modes[:, np.argmin(squares.real)].real
    away = 0.01 * np.linalg.solve(jacobian, slowest / np.abs(slowest).max())
    log = simulate(ur5, law, q0=goal + away, duration=time + 0.3, dt=1e-3, torque_limit=None)
    way = (log.position - goal) @ jacobian.T @ K @ slowest
    outside = log.time[np.abs(way) > 0.055 * abs(way[0])]
    assert outside[-1] <= time * 1.02
    if time < 0.4:  # where time is short, all of it is used
        assert outside[-1] > 0.8 * time


def test_a_stiffness_that_is_too_soft_for_the_time_says_which_would_do(ur5):
    goal = ur5.robot.near_home()
    with pytest.raises(PHControlError, match="make the stiffness") as raised:
        design_gains("cartesian_impedance", ur5, DesiredSettling(200.0, 0.3, rotational_stiffness=20.0), goal)
    said = str(raised.value)
    slowest, soonest = (float(said.split(word)[1].split()[0]) for word in ("mode is at ", "settles in "))
    assert slowest * soonest == pytest.approx(2.87, rel=0.02)  # ω t of ζ = 0.69
    factor = 1.001 * float(str(raised.value).split("make the stiffness ")[1].split()[0])
    enough = DesiredSettling(200.0 * factor * 1.01, 0.3, rotational_stiffness=20.0 * factor * 1.01)
    assert design_gains("cartesian_impedance", ur5, enough, goal).gains["damping_ratio"] < 0.8


@pytest.mark.parametrize(("ratio", "known"), [(1.0, 4.744), (0.6902, 2.87), (0.5, 5.29), (2.0, 11.45)])
def test_the_settling_time_of_a_second_order_system(ratio, known):
    """Against tabulated values of ω t for 5 % (a displacement that is let go settles as a step does)."""
    t = np.linspace(0.0, 30.0, 300001)
    poles = np.roots([1.0, 2.0 * ratio, 1.0 + 1e-9]).astype(complex)
    way = ((poles[1] * np.exp(poles[0] * t) - poles[0] * np.exp(poles[1] * t)) / (poles[1] - poles[0])).real
    assert settling_of(ratio) == pytest.approx(t[np.abs(way) > 0.05][-1], abs=0.01)
    assert settling_of(ratio) == pytest.approx(known, rel=0.02)


# --- L₂ gain ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", ["energy_shaping", "force_feedback"])
def test_the_gain_is_kept_with_a_bandwidth_beside(ur5, law):
    goal = ur5.robot.near_home()
    alone = design_gains(law, ur5, DesiredGain(0.1), goal)
    assert l2_gain(alone.law, ur5, samples=8).bound == pytest.approx(0.1, rel=1e-6)
    both = design_gains(law, ur5, DesiredGain(0.1, bandwidth=5.0), goal)
    found = l2_gain(both.law, ur5, samples=8)
    assert found.bound <= 0.1 * (1.0 + 1e-6)
    assert found.linear_norm <= found.bound * (1.0 + 1e-4)
    assert "C is raised" in both.notes[-1]
    placed = design_gains(law, ur5, DesiredBandwidth(5.0, 0.7), goal)
    np.testing.assert_allclose(both.gains["stiffness"], placed.gains["stiffness"])
    loose = design_gains(law, ur5, DesiredGain(100.0, bandwidth=5.0), goal)
    np.testing.assert_allclose(loose.gains["damping"], placed.gains["damping"])


def test_laws_without_a_damping_of_the_joints_have_no_such_gain(ur5):
    with pytest.raises(InvalidArgumentError, match="has no damping C"):
        design_gains("cartesian_impedance", ur5, DesiredGain(0.1))
    with pytest.raises(InvalidArgumentError, match="measured"):
        design_gains("force_feedback_measured", ur5, DesiredGain(0.1))


# --- torques ------------------------------------------------------------------------------------------


def largest_torque(system, law, start):
    log = simulate(system, law, q0=start, duration=1.0, dt=1e-3, torque_limit=None)
    return float((np.abs(log.torque).max(axis=0) / system.robot.effort_limit).max())


def test_a_step_uses_the_torque_that_it_may_and_no_more(ur5):
    goal, start = ur5.robot.near_home(), ur5.robot.home
    found = design_gains("energy_shaping", ur5, TorqueBudget([start], share=0.8), goal)
    assert 0.79 < largest_torque(ur5, found.law, start) <= 0.8
    bandwidth = found.spectrum[0].frequency
    faster = design_gains("energy_shaping", ur5, DesiredBandwidth(1.1 * bandwidth, 0.7), goal)
    assert largest_torque(ur5, faster.law, start) > 0.8


def test_a_smooth_motion_leaves_room_for_more(ur5):
    goal = ur5.robot.near_home()
    way = MinimumJerk.within_limits(ur5.robot, ur5.robot.home, goal)
    found = design_gains("energy_shaping", ur5, TorqueBudget([way], fastest=30.0), goal)
    assert found.spectrum[0].frequency == pytest.approx(30.0, rel=1e-3)
    assert "where the search ended" in found.notes[-1]


def test_an_arm_that_its_motors_cannot_carry_has_no_bandwidth(ur5):
    with pytest.raises(PHControlError, match="times what it may"):
        design_gains("energy_shaping", ur5, TorqueBudget([ur5.robot.home], share=0.05, duration=0.05))
    with pytest.raises(InvalidArgumentError, match="motions: must be a list"):
        TorqueBudget([])
    assert TorqueBudget([ur5.robot.home]).duration == 1.0
    assert TorqueBudget([ur5.robot.home], fastest=1.0).fastest == 1.0  # twice what is looked at last
    with pytest.raises(InvalidArgumentError, match="fastest: must be"):
        TorqueBudget([ur5.robot.home], fastest=0.99)
    with pytest.raises(InvalidArgumentError, match="must be trajectories"):
        design_gains("tracking", ur5, TorqueBudget([ur5.robot.home]))


# --- sampling -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", ["energy_shaping", "force_feedback", "cartesian_impedance"])
def test_the_largest_gains_are_stable_with_the_margin_and_larger_ones_are_not(ur5, law):
    goal, period = ur5.robot.near_home(), 4e-3
    found = design_gains(law, ur5, SamplingBudget(period, 1, margin=2.0), goal)
    assert found.linear.sampled(2.0 * period, 1).stable
    bandwidth = float(found.notes[-1].split(" is ")[1].split()[0])
    beyond = design_gains(law, ur5, DesiredBandwidth(1.01 * bandwidth, 0.7), goal)
    assert not beyond.linear.sampled(2.0 * period, 1).stable
    assert found.linear.longest_period(1) == pytest.approx(2.0 * period, rel=0.02)


def test_the_largest_gains_hold_in_a_simulation(ur5):
    """Held for the period, not late: a small step fades, and with a third more period than the margin it grows."""
    goal, period = ur5.robot.near_home(), 10e-3
    found = design_gains("energy_shaping", ur5, SamplingBudget(period, 0, margin=1.0), goal)
    ends = []
    for held in (period, 1.3 * period):
        options = {"duration": 1.0, "dt": 1e-3, "torque_limit": None, "control_period": held}
        try:
            log = simulate(ur5, found.law, q0=goal + 1e-4, **options)
            ends.append(np.abs(log.position[-1] - goal).max())
        except Exception:
            ends.append(np.inf)
    assert ends[0] < 1e-4 < ends[1]


def test_a_search_from_above_finds_the_largest():
    assert largest_bandwidth(lambda w: w <= 7.3, 100.0) == pytest.approx(7.3, rel=3e-3)
    assert largest_bandwidth(lambda w: True, 100.0) == 100.0
    assert largest_bandwidth(lambda w: False, 100.0) == 0.0
    assert largest_bandwidth(lambda w: 2.0 < w < 9.0, 100.0) == pytest.approx(9.0, rel=3e-3)


# --- what comes of it ----------------------------------------------------------------------------------


def test_the_gains_are_those_of_make_controller(ur5):
    goal = ur5.robot.near_home()
    found = design_gains("integral_action", ur5, DesiredBandwidth(5.0, 0.7), goal)
    law = make_controller("integral_action", ur5, goal, **found.gains)
    for name in found.gains:
        np.testing.assert_array_equal(getattr(law, name), getattr(found.law, name))
    record = found.record()
    assert record["met"]
    assert set(record["gains"]) == set(found.gains)
    text = str(found)
    assert "6 × ω = 5 rad/s, ζ = 0.700" in text
    assert "stable up to a period of" in text


def test_gains_that_are_off_are_seen_to_be_off(ur5):
    """``met`` looks at the spectrum of the true loop and not at the design."""
    from dataclasses import replace

    found = design_gains("energy_shaping", ur5, DesiredBandwidth(5.0, 0.7))
    wrong = found.law.changed(stiffness=1.1 * found.law.stiffness)
    other = replace(found, law=wrong, linear=linearize(wrong, ur5, exact=False))
    assert found.met
    assert not other.met
    assert other.deviation > 0.02
