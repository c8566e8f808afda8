"""What the valves of a tank let through, beside the formulas; what a stiffness that varies does, beside its energy."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import (
    Action,
    EnergyShaping,
    EnergyTank,
    ExternalAction,
    FrameSpring,
    InvalidArgumentError,
    Pose,
    Stiffness,
    with_tank,
)
from phcontrol.tanks import StiffnessAction
from tests.conftest import make_system
from tests.finite_differences import gradient, relative_error

TANK = EnergyTank(initial=1.0, lowest=0.5, highest=4.0, ramp=1.0, largest_power=20.0, leak=0.1)
LEVELS = [0.2, 0.5, 0.6, 1.0, 1.4, 1.5, 2.0, 3.0, 3.1, 3.7, 3.99, 4.0, 4.5]
POWERS = [-200.0, -20.0, -5.0, -1e-3, 0.0, 1e-3, 5.0, 20.0, 200.0]
PARTS = [1.0, 0.25]

every = pytest.mark.parametrize("part", PARTS)


def step(s):
    """3s² − 2s³ between 0 and 1."""
    s = min(1.0, max(0.0, s))
    return 3.0 * s**2 - 2.0 * s**3


def valves(level):
    """ω but for the largest power, and how full it is: 1 J above the lowest level, and 1 J below the highest."""
    return step(level - 0.5), step(level - 3.0)


@every
def test_what_flows_is_what_the_formulas_say(part):
    for level in LEVELS:
        valve, full = valves(level)
        for power in POWERS:
            for damping in (0.0, 3.0, 100.0):
                flow = TANK.flow(TANK.state(level), power, damping, part)
                opening = valve if power <= 20.0 * part else valve * 20.0 * part / power
                refill = 0.9 * (1.0 - full) * step(level / 0.5)
                if refill * damping > 20.0:
                    refill = 20.0 / damping
                returned = max(0.0, -opening * power)
                let_off = returned - (1.0 - full) * min(returned, 20.0 * part)
                lost = 2.0 * 0.1 * valve * level + let_off  # x_t fades with λ, and so ½x_t² with 2λ
                assert flow.opening == pytest.approx(opening, abs=1e-12)
                assert flow.refill == pytest.approx(refill, abs=1e-12)
                assert flow.lost == pytest.approx(lost, abs=1e-10)
                assert flow.charge == pytest.approx(math.sqrt(2.0 * level), rel=1e-12)
                net = refill * damping - opening * power - lost
                assert flow.rate * math.sqrt(2.0 * level) == pytest.approx(net, abs=1e-10)
                assert flow.per_charge(3.0) == pytest.approx(3.0 / math.sqrt(2.0 * level), rel=1e-12)
                if part == 1.0:
                    assert TANK.flow(TANK.state(level), power, damping) == flow


@every
def test_what_is_paid_is_what_the_formulas_say(part):
    for level in LEVELS:
        valve, full = valves(level)
        for power in POWERS:
            opening, share = TANK.payment(TANK.state(level), power, part)
            assert opening == pytest.approx(valve * min(1.0, 20.0 * part / max(power, 1e-9)), abs=1e-12)
            if power >= 0.0 or valve == 0.0:
                assert share == opening
            else:
                taken = (1.0 - full) * min(-valve * power, 20.0 * part)  # by the tank, of what is given to it
                assert -share * power == pytest.approx(taken, abs=1e-10)
            if part == 1.0:
                assert TANK.payment(TANK.state(level), power) == (opening, share)


def test_what_is_spared_is_what_is_left_of_the_largest_power():
    for level in LEVELS:
        most = valves(level)[0] * 20.0
        for power in POWERS:
            for spent in (-30.0, 0.0, 4.0, 0.9 * most, most, 30.0):
                given = TANK.spare(TANK.state(level), power, spent)
                assert given == pytest.approx(max(0.0, min(power, most - max(0.0, spent))), abs=1e-12)
                assert given >= 0.0


def test_levels_and_states_belong_together():
    for level in (0.0, 1e-6, *LEVELS):
        assert TANK.level(TANK.state(level)) == pytest.approx(level, abs=1e-14)
    assert TANK.state(1.0) == 0.0  # the level at the start
    assert TANK.flow(TANK.state(0.0), -5.0, 5.0).per_charge(1.0) == 0.0
    with pytest.raises(InvalidArgumentError, match="level: must be >= 0"):
        TANK.state(-1e-9)


def test_bounds_that_meet_are_refused_as_such():
    with pytest.raises(InvalidArgumentError, match="lowest: must be below highest, but they are 2 J and 2 J: swapped"):
        EnergyTank(lowest=2.0, highest=2.0, initial=2.0)
    for initial in (0.5, 4.0):  # on the bounds
        EnergyTank(initial=initial, lowest=0.5, highest=4.0, ramp=1.75)
    with pytest.raises(InvalidArgumentError, match="ramp: must be at most half"):
        EnergyTank(initial=1.0, lowest=0.5, highest=4.0, ramp=1.7500001)


def test_a_leak_empties_a_tank_that_nobody_uses_down_to_its_lowest_level():
    """d level/dt = −2λ ω level, far above the lower bound an exponential; integrated here with the tank's own rate."""
    state, dt = TANK.state(3.0), 1e-3
    for _ in range(2000):
        state += dt * TANK.flow(state, 0.0, 0.0).rate
    assert TANK.level(state) == pytest.approx(3.0 * math.exp(-2.0 * 0.1 * 2.0), rel=1e-4)
    assert TANK.flow(TANK.state(0.5), 0.0, 0.0).rate == 0.0


def test_an_action_does_not_change_with_time_unless_it_says_so():
    class Constant(Action):
        def torque(self, t, x):
            return np.zeros(x.system.n)

    def nothing(t, x):
        return np.zeros(x.system.n)

    assert Constant().duration == 0.0
    assert ExternalAction(nothing).duration == 0.0
    shoulder = make_system("pera_shoulder")
    for action in (Constant(), ExternalAction(nothing)):
        assert with_tank(EnergyShaping).tuned(shoulder, actions=[action]).time_span == 0.0


def stiffness(t):
    """Neither diagonal nor isotropic."""
    return np.array([[300.0, 40.0, 0.0], [40.0, 200.0, -30.0], [0.0, -30.0, 150.0 + 50.0 * t]])


@pytest.mark.parametrize("which", ["translational", "rotational", "both"])
def test_a_stiffness_that_varies_is_the_difference_of_two_springs(which, rng):
    """By their energies ½eᵀK_t e + tr(G(1 − R_e)), the difference of which has −a as its gradient at a time held."""
    system, frame, t = make_system("panda"), "panda_hand_tcp", 0.6
    goal = Pose(np.array([0.4, 0.1, 0.5]), pin.exp3(np.array([0.4, -0.3, 0.8])))
    held_t, held_r, turns = np.diag([100.0, 120.0, 90.0]), np.diag([8.0, 5.0, 6.0]), 0.05 * stiffness(t)
    functions = {"translational": stiffness, "rotational": lambda t: 0.05 * stiffness(t)}
    chosen = {name: function for name, function in functions.items() if which in {name, "both"}}
    now_t = stiffness(t) if "translational" in chosen else held_t
    now_r = turns if "rotational" in chosen else held_r
    action = StiffnessAction(frame, lambda t: goal, Stiffness(**chosen, duration=2.0), np.eye(3), (held_t, held_r))
    assert action.duration == 2.0
    x = system.at(system.robot.near_home() + 0.2, rng.normal(size=7))

    def energy(position, translational, rotational):
        hand = system.at(position).placement(frame)
        error = hand.translation - goal.translation
        G = 0.5 * np.trace(rotational) * np.eye(3) - rotational
        turned = np.eye(3) - goal.rotation.T @ hand.rotation
        return 0.5 * error @ translational @ error + np.trace(G @ turned)

    expected = -gradient(lambda q: np.array(energy(q, now_t, now_r) - energy(q, held_t, held_r)), x.position)
    assert np.abs(expected).max() > 0.1
    assert relative_error(action.torque(t, x), expected) < 1e-8
    springs = [
        FrameSpring(frame, goal, translational_stiffness=k_t, rotational_stiffness=k_r).gradient(x)
        for k_t, k_r in ((now_t, now_r), (held_t, held_r))
    ]
    np.testing.assert_allclose(action.torque(t, x), springs[1] - springs[0], atol=1e-10)


def test_what_changes_must_be_said_and_for_how_long():
    with pytest.raises(InvalidArgumentError, match="translational: or rotational must be given"):
        Stiffness(duration=1.0)
    for duration in (0.0, -1.0):
        with pytest.raises(InvalidArgumentError, match="duration: must be > 0"):
            Stiffness(lambda t: 5.0, duration=duration)
    turning = Stiffness(rotational=lambda t: 5.0 + t, duration=1.0)
    assert turning.translational(0.5) is None
    np.testing.assert_array_equal(turning.rotational(0.5), 5.5 * np.eye(3))


def test_an_external_action_is_a_function():
    with pytest.raises(InvalidArgumentError, match="function: must be callable with time and state, but is ndarray"):
        ExternalAction(np.zeros(2))
