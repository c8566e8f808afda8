"""Energy tanks: levels at random, what laws with a tank promise, and what the arm receives at most."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import (
    After,
    CartesianImpedance,
    Controller,
    ControlLoop,
    EnergyTank,
    EventSchedule,
    ExternalAction,
    ForceFeedback,
    IntegralAction,
    InvalidArgumentError,
    Measured,
    MechanicalSystem,
    NonFiniteTorqueError,
    Phase,
    Pose,
    PostureAction,
    Schedule,
    Stiffness,
    TankedLaw,
    TrajectoryTracking,
    Wrench,
    certify,
    load_robot,
    simulate,
    with_tank,
)
from tests.controllers.arms import arm


def stir(t, x):
    """A torque that puts energy in: along the velocity."""
    return 2.0 * x.velocity + np.cos(3.0 * x.position)


def swirl(t, x):
    return 0.3 * np.sin(2.0 * t) * np.ones(x.system.n)


@pytest.fixture(scope="module")
def shoulder():
    return MechanicalSystem(load_robot("pera_shoulder"))


# --- the tank alone ------------------------------------------------------------------------------------------


def test_ten_thousand_random_states_never_leave_the_bounds(rng):
    """One held step of 1 ms from each, under powers up to 10⁴ W either way: never below the lowest level.

    Never filled beyond the highest either: Euler's step of x_t itself adds ½ẋ_t²h².
    """
    tank, hold = EnergyTank(), 1e-3
    for _ in range(10_000):
        level = tank.lowest + (tank.highest - tank.lowest) * rng.choice([rng.random(), 10.0 ** rng.uniform(-9, 0)])
        power = rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-3, 4)
        damping_power = rng.choice([0.0, 10.0 ** rng.uniform(-3, 2)])
        state = tank.state(level)
        flow = tank.flow(state, power, damping_power)
        after = tank.level(state + hold * flow.rate)
        assert after >= tank.lowest * (1.0 - 1e-12)
        assert 0.0 <= flow.opening <= 1.0
        assert flow.opening * power <= tank.largest_power * (1.0 + 1e-12)
        assert flow.rate * flow.charge == pytest.approx(
            flow.refill * damping_power - flow.opening * power - flow.lost, abs=1e-9 * max(1.0, abs(power))
        )
        if level >= tank.highest:
            assert flow.rate <= 1e-12


def test_ten_thousand_random_states_with_all_that_a_tank_may_pay_for(rng):
    """An action, a regulated motion and what limits put in, at once: the level stays above its bound at 2.2 ms too."""
    tank, lowest = EnergyTank(), np.inf
    for _ in range(10_000):
        level = tank.lowest + (tank.highest - tank.lowest) * rng.choice([rng.random(), 10.0 ** rng.uniform(-9, 0)])
        powers = rng.choice([-1.0, 1.0], size=3) * 10.0 ** rng.uniform(-3, 4, size=3)
        state = tank.state(level)
        flow = tank.flow(state, powers[0], 0.0, 0.5)
        payment = tank.payment(state, powers[1], 0.5)
        assert 0.0 <= payment.share <= payment.opening <= 1.0
        assert payment.share == payment.opening or powers[1] < 0.0  # less only where it is given something
        rate = flow.rate - payment.share * powers[1] / flow.charge
        spared = tank.spare(state, powers[2], -rate * flow.charge)
        assert 0.0 <= spared <= max(0.0, powers[2])
        rate -= spared / flow.charge
        lowest = min(lowest, tank.level(state + tank.longest_period * rate))
    assert lowest >= tank.lowest * (1.0 - 1e-12)
    assert lowest < tank.lowest + 1e-6  # and it is looked at where it matters


def growth(log, supplied=None):
    own = log.storage - (0.0 if supplied is None else supplied)
    return float((own - np.minimum.accumulate(own)).max())


class Untold(TankedLaw, ForceFeedback):
    """Its tank does not hear of limits."""

    name = "untold"

    def rate_under_limits(self, t, x, state, rate, change, measured=None):
        return rate


@pytest.mark.parametrize("period", [None, 1e-3])
def test_damping_that_is_clipped_fills_no_tank(shoulder, period):
    """An arm thrown at 2 rad/s, whose motors can hardly brake: without friction H_d + tank can only fall.

    At 1 kHz but for the error of the hold, of some percent: halving the period halves it.
    """
    free = MechanicalSystem(shoulder.robot, friction=None)
    grown = {}
    for law in (Untold, with_tank(ForceFeedback)):
        made = law.tuned(free, actions=ExternalAction(lambda t, x: 0.05 * np.cos(x.position)))
        log = simulate(
            free, made, q0=made.goal, v0=[2.0, -2.0], duration=0.3, dt=5e-4, control_period=period, torque_limit=15.0
        )
        assert (np.abs(log.torque) >= 15.0 - 1e-9).any()
        grown[law.name] = growth(log)
        assert log.tank_level.min() >= made.tank.lowest
    assert grown["untold"] > 1.0, grown
    assert grown["force_feedback_with_tank"] < (1e-8 if period is None else 0.06), grown


def test_an_empty_tank_pays_for_no_clipping(shoulder):
    """Then H_d grows by what limits put in, as it would without a tank, and the level stays above its bound."""
    free = MechanicalSystem(shoulder.robot, friction=None)
    tank = EnergyTank(initial=0.05, lowest=0.02, ramp=0.1, largest_power=50.0)
    law = with_tank(ForceFeedback).tuned(free, actions=ExternalAction(lambda t, x: 0.0 * x.position), tank=tank)
    log = simulate(free, law, q0=law.goal, v0=[2.0, -2.0], duration=0.3, control_period=1e-3, torque_limit=1.0)
    assert log.tank_level.min() >= tank.lowest
    sample = [law.passive_port(t, free.at(q, v), s) for t, q, v, s in zip(
        log.time, log.position, log.velocity, log.controller_state, strict=True
    )]  # fmt: skip
    ordered = [law.evaluate(t, free.at(q, v), s).torque for t, q, v, s in zip(
        log.time, log.position, log.velocity, log.controller_state, strict=True
    )]  # fmt: skip
    put_in = [max(0.0, p.output @ (u - o) - p.dissipated_power) for p, u, o in zip(
        sample, log.torque, ordered, strict=True
    )]  # fmt: skip
    bound = float(np.sum(put_in) * 1e-3)
    assert 0.1 < growth(log) <= 1.05 * bound


@pytest.mark.parametrize("start", [0.02, 0.3, 4.9])
def test_levels_stay_between_the_bounds_for_a_thousand_steps(start, rng):
    tank = EnergyTank()
    state, levels = tank.state(start), []
    for _ in range(1000):
        state += 1e-3 * tank.flow(state, 200.0 * rng.normal(), 20.0 * rng.random()).rate
        levels.append(tank.level(state))
    assert min(levels) >= tank.lowest
    assert max(levels) <= tank.highest + 5e-3


def test_the_longest_period_is_the_longest():
    """With it no step of Euler's passes the lower bound, whatever the power; with 4 % more one does."""
    tank = EnergyTank()
    levels = tank.lowest + tank.ramp * np.linspace(0.0, 1.0, 2001)

    def lowest_after(period, tank):
        return min(
            tank.level(state + period * tank.flow(state, power, 0.0).rate)
            for state in map(tank.state, levels)
            for power in (tank.largest_power, 1e4)
        )

    assert lowest_after(tank.longest_period, tank) >= tank.lowest * (1.0 - 1e-12)
    wide = EnergyTank(initial=1000.0, lowest=1000.0, highest=1001.0, leak=1e-12)
    levels = wide.lowest + wide.ramp * np.linspace(0.0, 1.0, 2001)
    assert lowest_after(wide.longest_period, wide) >= wide.lowest * (1.0 - 1e-12)
    assert lowest_after(1.04 * wide.longest_period, wide) < wide.lowest  # the bound is sharp where x_t hardly changes


@pytest.mark.parametrize("in_schedule", [False, True])
def test_periods_that_a_tank_cannot_keep_up_with_are_refused(shoulder, in_schedule):
    law = with_tank(ForceFeedback).tuned(shoulder, actions=ExternalAction(stir))
    if in_schedule:
        law = Schedule([(0.0, ForceFeedback.tuned(shoulder)), (0.5, law)])
    with pytest.raises(InvalidArgumentError, match=r"^period: must be at most 0.0022 s"):
        simulate(shoulder, law, duration=0.1, control_period=5e-3)
    with pytest.raises(InvalidArgumentError, match=r"^period: must be at most 0.0022 s"):
        ControlLoop(shoulder, law, 5e-3)
    assert ControlLoop(shoulder, law, 2e-3).period == 2e-3
    assert ControlLoop(shoulder, ForceFeedback.tuned(shoulder), 5e-3).period == 5e-3


def test_laws_that_share_a_tank_start_it_alike(shoulder):
    """The state is x_t − x_t(0): with another start the level would jump at the switch."""
    tuned = with_tank(ForceFeedback).tuned
    laws = [tuned(shoulder, actions=ExternalAction(stir), tank=EnergyTank(initial=level)) for level in (2.0, 4.9, 2.0)]
    with pytest.raises(InvalidArgumentError, match="same initial level, but do at 2 and 4.9 J"):
        Schedule([(0.0, laws[0]), (1.0, laws[1])])
    with pytest.raises(InvalidArgumentError, match="same initial level, but do at 2 and 4.9 J"):
        EventSchedule([Phase("a", laws[0], [(After(0.5), "b")], within=9.0), Phase("b", laws[1])])
    assert Schedule([(0.0, laws[0]), (1.0, laws[2])]).state_parts["tank"] == 1


def test_valves_open_and_close_smoothly():
    """No jump of opening or refill on the way from an empty tank to a full one, nor of its rate at 0."""
    tank = EnergyTank()
    levels = np.linspace(0.0, 6.0, 60_001)
    flows = [tank.flow(tank.state(level), 30.0, 5.0) for level in levels]
    for values in ([flow.opening for flow in flows], [flow.refill for flow in flows]):
        assert np.abs(np.diff(values)).max() < 0.01
    assert flows[0].rate == 0.0
    assert tank.flow(tank.state(tank.lowest), 30.0, 0.0).opening == 0.0
    assert tank.flow(tank.state(tank.highest), 0.0, 5.0).refill == 0.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"lowest": 5.0, "highest": 0.02}, "swapped"),
        ({"initial": 6.0}, "must be between lowest, 0.02 J, and highest, 5 J"),
        ({"initial": 0.01}, "must be between"),
        ({"lowest": 0.0}, "lowest"),
        ({"ramp": 3.0}, "half"),
        ({"largest_power": -1.0}, "largest_power"),
        ({"initial": float("nan")}, "initial"),
        ({"leak": 5000.0}, "leak: must be <= 1"),
    ],
)
def test_bad_bounds_are_refused(options, message):
    with pytest.raises(InvalidArgumentError, match=message):
        EnergyTank(**options)


# --- laws with one -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["coriolis", "canonical"])
@pytest.mark.parametrize("law", [ForceFeedback, IntegralAction, TrajectoryTracking])
def test_any_law_pays_for_any_function(shoulder, law, form):
    made = with_tank(law).tuned(shoulder, actions=ExternalAction(stir), interconnection=form)
    certificate = certify(made, samples=64)
    assert certificate.verdict == "PASSED", str(certificate)
    assert "its tank starts with 2 J" in certificate.caveat


def test_several_actions_and_time(shoulder):
    actions = [ExternalAction(stir), ExternalAction(swirl, duration=np.pi)]
    law = with_tank(ForceFeedback).tuned(shoulder, actions=actions)
    assert certify(law, samples=64).verdict == "PASSED"
    undeclared = with_tank(ForceFeedback).tuned(shoulder, actions=ExternalAction(swirl))
    assert not certify(undeclared, samples=16).passed


class Unpaid(TankedLaw, ForceFeedback):
    """Takes the torque and does not pay."""

    name = "unpaid"

    def shape(self, t, x, state, measured):
        law = super().shape(t, x, state, measured)
        rate = np.array(law.state_rate)
        rate[-1] = 0.0
        return law._replace(state_rate=rate)


class Greedy(TankedLaw, ForceFeedback):
    """Keeps all of the damping and leaves it in R_d too."""

    name = "greedy"

    def joint_damping(self, t, x):
        return 1.5 * super().joint_damping(t, x)


@pytest.mark.parametrize("wrong", [Unpaid, Greedy])
def test_laws_that_cheat_fail(shoulder, wrong):
    assert not certify(wrong.tuned(shoulder, actions=ExternalAction(stir)), samples=32).passed


def test_a_stirring_torque_gives_no_more_than_the_tank_holds(shoulder):
    """Without friction, from rest at the goal: the law's own H_d never exceeds what the tank has given."""
    free = MechanicalSystem(shoulder.robot, friction=None)
    law = with_tank(ForceFeedback).tuned(free, actions=ExternalAction(lambda t, x: 60.0 * (x.velocity + 0.01)))
    log = simulate(free, law, duration=4.0, q0=law.goal, dt=5e-4, torque_limit=None)
    levels = np.array([law.tank_level(state) for state in log.controller_state])
    own = log.storage - levels
    assert levels.min() < 1.0  # it was used
    assert levels.min() >= law.tank.lowest - 1e-9
    assert own.max() > 0.1
    assert log.storage.max() <= log.storage[0] + 1e-9
    np.testing.assert_allclose(log.tank_level, levels)
    assert np.isfinite(log.position).all()


def test_a_sequence_shows_the_tank_of_its_laws(shoulder):
    """Held while a law acts that has none, in log and viewer."""
    stirred = with_tank(ForceFeedback).tuned(shoulder, actions=ExternalAction(stir))
    law = Schedule([(0.0, ForceFeedback.tuned(shoulder)), (0.1, stirred), (0.3, ForceFeedback.tuned(shoulder))])
    log = simulate(shoulder, law, q0=law.laws[0].goal + 0.3, duration=0.4)
    levels = log.tank_level
    assert levels is not None
    np.testing.assert_allclose(levels, [stirred.tank.level(s) for s in log.controller_state[:, law.state_size - 1]])
    held = log.time < 0.1
    assert np.ptp(levels[held]) == 0.0
    assert np.ptp(levels) > 1e-3
    assert Schedule([(0.0, ForceFeedback.tuned(shoulder))]).tank_level(np.zeros(2)) is None


def test_a_law_without_actions_has_no_tank(shoulder):
    law = with_tank(ForceFeedback).tuned(shoulder)
    assert law.states == ("force",)
    assert law.tank_level(np.zeros(2)) is None
    log = simulate(shoulder, law, duration=0.01)
    assert log.tank_level is None


# --- posture, stiffness --------------------------------------------------------------------------------------


def _held(mode):
    system = arm("panda")
    start = system.robot.near_home()
    desired = start + np.array([0.3, -0.2, 0.4, 0.3, -0.3, 0.3, 0.4])
    placement = system.at(start).placement(system.hand_frame)
    goal = Pose(np.array(placement.translation), np.array(placement.rotation))
    law = CartesianImpedance(
        system, goal=goal, translational_stiffness=[600.0, 600.0, 200.0], rotational_stiffness=30.0, posture=mode,
        preferred_posture=desired, posture_stiffness=10.0,
    )  # fmt: skip
    log = simulate(system, law, q0=start, duration=15.0, dt=2e-3)
    hand = system.at(log.position[-1]).placement(system.hand_frame)
    distance = np.linalg.norm(hand.translation - goal.translation)
    angle = np.arccos(min(1.0, 0.5 * (np.trace(goal.rotation.T @ hand.rotation) - 1.0)))
    return law, log, distance, angle, np.linalg.norm(log.position[-1] - desired), np.linalg.norm(start - desired)


@pytest.mark.study
def test_a_posture_paid_for_leaves_the_hand_alone():
    """Where a spring on the joints pulls it off by centimetres, and says so."""
    law, log, distance, angle, away, before = _held("tank")
    assert distance <= 1e-5
    assert angle <= 1e-5
    assert away < before
    assert log.storage.max() <= log.storage[0] + 1e-9
    spring, _, distance, angle, _, _ = _held("spring")
    assert distance > 0.02
    assert angle > 0.1
    assert spring.pull_off.distance == pytest.approx(distance, rel=1e-3)
    assert f"{spring.pull_off.distance:.2g} m" in spring.caveat


def test_a_posture_action_does_not_accelerate_the_hand(rng):
    system = arm("panda")
    x = system.at(system.robot.near_home())
    action = PostureAction(system, system.hand_frame, system.robot.home, 10.0)
    J, M = x.frame_jacobian(system.hand_frame, "local_world_aligned"), x.mass_matrix
    inertia = np.linalg.inv(J @ np.linalg.solve(M, J.T))
    N = np.eye(7) - np.linalg.solve(M, J.T @ inertia @ J)
    expected = -N.T @ (10.0 * (x.position - system.robot.home))
    np.testing.assert_allclose(action.torque(0.0, x), expected, atol=1e-10)
    assert np.abs(J @ np.linalg.solve(M, action.torque(0.0, x))).max() < 1e-10
    assert np.abs(expected).max() > 0.1


class Varied(CartesianImpedance):
    """A stiffness that varies and nobody pays for; H_d = ½|p̄|² + Ψ(t)."""

    name = "varied"

    def shape(self, t, x, state, measured):
        law = super().shape(t, x, state, measured)
        return law._replace(effort=law.effort + ACTIONS[0].torque(t, x))


def varied(t):
    """100 → 2000 → 100 N/m at 2 Hz."""
    return 1050.0 - 950.0 * np.cos(4.0 * np.pi * t)


ACTIONS: list = []


@pytest.mark.study
def test_stiffness_that_varies_while_pushed():
    """Unpaid, the energy of spring and motion grows beyond what the push supplied; paid, H_d + tank never does."""
    system = MechanicalSystem(arm("panda").robot, friction=None)
    start = system.robot.near_home()
    placement = system.at(start).placement(system.hand_frame)
    goal = Pose(np.array(placement.translation), np.array(placement.rotation))
    gains = {
        "goal": goal, "translational_stiffness": 100.0, "rotational_stiffness": 30.0, "damping_ratio": 0.05,
        "preferred_posture": start,
    }  # fmt: skip
    push = Wrench(system.hand_frame, [0.0, 0.0, -10.0, 0, 0, 0])
    paid = CartesianImpedance(system, variation=Stiffness(varied, duration=0.5), **gains)
    ACTIONS[:] = paid.paid
    unpaid = Varied(system, **gains)

    excess = {}
    for law in (paid, unpaid):
        log = simulate(system, law, q0=start, duration=4.0, disturbance=push, torque_limit=None)
        energy = log.storage
        if law is unpaid:
            hands = np.array([system.at(q).placement(system.hand_frame).translation for q in log.position])
            errors = ((hands - goal.translation) ** 2).sum(axis=1)
            energy = energy + 0.5 * (varied(log.time) - 100.0) * errors
        power = log.external_power
        supplied = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(log.time))])
        excess[law.name] = float((energy - energy[0] - supplied).max())
    assert excess["varied"] > 0.1
    assert excess["cartesian_impedance"] < 1e-6


@pytest.mark.parametrize("free", [None, [1.0, 1.0, 0.0]])
def test_a_variation_is_in_the_axes_of_the_stiffness(free):
    """K(t) = K_t of the tool's axes changes nothing; in those of the world it did."""
    system = arm("panda")
    start = system.robot.near_home()
    hand = system.at(start).placement(system.hand_frame).translation
    goal = Pose(np.array(hand), pin.exp3(np.array([0.3, -0.5, 0.4])))
    gains = {
        "goal": goal, "translational_stiffness": [900.0, 300.0, 100.0], "rotational_stiffness": 10.0, "axes": "tool",
        "free_direction": free,
    }  # fmt: skip
    same = CartesianImpedance(system, variation=Stiffness(lambda t: [900.0, 300.0, 100.0], duration=1.0), **gains)
    x = system.at(start + 0.2, np.ones(7))
    assert np.abs(same.paid[0].torque(0.3, x)).max() < 1e-10
    half = CartesianImpedance(system, variation=Stiffness(lambda t: [450.0, 150.0, 50.0], duration=1.0), **gains)
    wrench = half.hand_spring.wrench(x.frame_kinematics(system.hand_frame), goal)[:3]
    expected = 0.5 * wrench @ x.frame_kinematics(system.hand_frame).jacobian[:3]
    np.testing.assert_allclose(half.paid[0].torque(0.3, x), expected, atol=1e-10)
    assert np.abs(expected).max() > 1.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ExternalAction(3.0), "callable"),
        (lambda: ExternalAction(stir, duration=-1.0), "duration"),
        (lambda: Stiffness(duration=1.0), "nothing changes"),
        (lambda: Stiffness(500.0, duration=1.0), "function of time"),
        (lambda: Stiffness(lambda t: [1.0, 2.0], duration=1.0), "length 3"),
        (lambda: Stiffness(lambda t: 500.0, duration=0.0), "duration"),
        (lambda: Stiffness(lambda t: -500.0, duration=1.0), "variation: translational at 0 s: must be positive"),
        (lambda: Stiffness(lambda t: 500.0 - t, duration=1.0).translational(501.0), "at 501 s: must be positive"),
        (lambda: Stiffness(rotational=lambda t: [1.0] * (3 + int(t)), duration=1.0).rotational(2.0), "at 2 s"),
        (lambda: Stiffness(lambda t: np.inf if t else 1.0, duration=1.0).translational(1.0), "at 1 s: must be finite"),
        (lambda: with_tank(Controller.__mro__[-1]), "class of a law"),
    ],
)
def test_bad_actions_are_refused(make, message):
    with pytest.raises(InvalidArgumentError, match=message):
        make()


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_power_beyond_all_numbers_ends_in_an_error(shoulder, direction):
    """Not in a valve that is closed, a torque that is finite, and a tank's rate that is none."""
    law = with_tank(ForceFeedback).tuned(shoulder, actions=ExternalAction(lambda t, x: np.full(2, 1e308)))
    x = shoulder.at([0.0, 0.0], [direction, direction])
    with pytest.raises(NonFiniteTorqueError, match="power = -?inf"), np.errstate(over="ignore"):
        law.evaluate(0.0, x, np.zeros(3), Measured(external_force=np.zeros(2)))


@pytest.mark.parametrize(
    "quantity",
    ["position", "velocity", "mass_matrix", "potential_gradient", "coriolis_matrix", "input_matrix", "factor"],
)
def test_an_action_that_writes_to_the_state_is_refused(quantity):
    """The state is the plant's own: a law that wrote to it would steer a simulation, not an arm."""
    system = arm("panda")

    def careless(t, x):
        value = getattr(x, quantity)
        value -= 1.0
        return np.zeros(7)

    with pytest.raises(InvalidArgumentError, match="careless' of an ExternalAction writes to the state"):
        with_tank(ForceFeedback).tuned(system, actions=ExternalAction(careless))


@pytest.mark.parametrize("name", ["panda", "panda_with_fingers"])
def test_an_action_sees_every_quantity_of_the_state(name):
    """What its read-only state computes is what the plant's own does, of arms with mimic joints too."""
    system = MechanicalSystem(load_robot("panda")) if name == "panda_with_fingers" else arm(name)
    position = system.robot.near_home()
    x, seen = system.at(position, np.ones(system.n)), []
    ExternalAction(lambda t, view: seen.append(view) or np.zeros(system.n)).torque(0.0, x)
    (view,) = seen
    for quantity in ("mass_matrix", "coriolis_matrix", "factor", "factor_rate", "gravity", "momentum", "damping"):
        np.testing.assert_array_equal(getattr(view, quantity), getattr(x, quantity))
    hand = system.hand_frame
    np.testing.assert_array_equal(view.frame_kinematics(hand).jacobian, x.frame_kinematics(hand).jacobian)
    np.testing.assert_array_equal(view.task_space(hand).mobility, x.task_space(hand).mobility)
    np.testing.assert_array_equal(view.canonical_interconnection, x.canonical_interconnection)
    assert view.energy == x.energy


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"actions": 3.0}, "actions"),
        ({"actions": [stir]}, "ExternalAction"),
        ({"actions": ExternalAction(lambda t, x: [1.0, 2.0, 3.0])}, "shape"),
        ({"actions": ExternalAction(lambda t, x: [np.nan, 2.0])}, "finite"),
        ({"tank": 2.0}, "EnergyTank"),
    ],
)
def test_laws_refuse_what_is_no_action_or_tank(shoulder, options, message):
    with pytest.raises(InvalidArgumentError, match=message):
        with_tank(ForceFeedback).tuned(shoulder, **options)
