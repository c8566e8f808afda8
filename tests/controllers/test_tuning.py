"""Default gains on every arm: what they make of a step, of a desired bandwidth, and of a torque that is held."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    EnergyShaping,
    InvalidArgumentError,
    MechanicalSystem,
    MinimumJerk,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.controllers.registry import CONTROLLERS
from phcontrol.controllers.visual_servo import VisualServo
from phcontrol.runs.position import PositionRun
from tests.controllers.arms import CATALOGUE, CHAINS, arm, chain

LAWS = [name for name, entry in CONTROLLERS.items() if not issubclass(entry.law, VisualServo)]
STEPPED = [name for name in CATALOGUE if name != "bravo7_no_ee"]  # its motors do not carry it: see below
HELD = [*CHAINS, "panda", "kinova", "xarm7"]


def far(robot):
    """Return a posture 1 rad from home in every joint (0.1 m in prismatic ones), to the side where there is room."""
    room = np.where(
        robot.upper - robot.home >= robot.home - robot.lower, robot.upper - robot.home, robot.lower - robot.home
    )
    longest = np.where(np.array(robot.prismatic or [False] * robot.n), 0.1, 1.0)
    return robot.home + np.sign(room) * np.minimum(longest, 0.9 * np.abs(room))


def overshoot(system, law, goal, duration=5.0):
    log = simulate(system, law, duration=duration, dt=1e-3)
    return PositionRun(log, None, goal, 1.0, system.robot).overshoot


@pytest.mark.parametrize("where", ["near", "far"])
@pytest.mark.parametrize("name", STEPPED)
def test_energy_shaping_overshoots_a_step_by_at_most_5_percent(name, where):
    system = arm(name)
    goal = system.robot.near_home() if where == "near" else far(system.robot)
    assert overshoot(system, make_controller("energy_shaping", system, goal), goal) <= 0.05


def test_gains_of_the_inertia_at_the_goal_alone_overshoot_a_far_step():
    """What the test above would say of them, so that it is not always content."""
    system = arm("panda")
    goal = far(system.robot)
    assert overshoot(system, make_controller("energy_shaping", system, goal, bandwidth=4.0), goal) > 0.1


def test_an_arm_that_its_motors_do_not_carry_is_left_out():
    system = arm("bravo7_no_ee")
    x = system.at(system.robot.home)
    assert (np.abs(x.gravity) > system.robot.effort_limit).any()


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("name", HELD)
def test_default_gains_are_stable_when_the_torque_is_held_for_a_millisecond(name, law):
    """On a step, which is the most they are asked for: the storage function stays below what it was at first."""
    system = arm(name)
    goal = system.robot.near_home()
    controller = make_controller(law, system, goal)
    log = simulate(system, controller, duration=1.0, dt=1e-3, control_period=1e-3, torque_limit=None)
    assert np.isfinite(log.velocity).all()
    floor = 0.1 if law.startswith("tracking") else 1e-6  # [J]: led, they start from nothing
    assert log.storage.max() <= 1.02 * log.storage[0] + floor


def test_a_diagonal_damping_of_a_long_chain_diverges_when_it_is_held():
    """Why the whole inertia is taken there: hM⁻¹C of a diagonal one has eigenvalues above 2."""
    system = chain(14)
    goal = system.robot.near_home()
    inertia = system.at(goal).mass_matrix.diagonal()
    law = EnergyShaping(system, goal=goal, stiffness=16.0 * inertia, damping=8.0 * inertia)
    with np.errstate(all="ignore"):
        try:
            log = simulate(system, law, duration=0.3, dt=1e-3, control_period=1e-3, torque_limit=None)
        except Exception as error:
            log = error.log
    assert log.storage.max() > 10.0 * log.storage[0]


@pytest.mark.parametrize("desired", [(10.0, 0.7), (3.0, 1.0), (25.0, 2.0)])
@pytest.mark.parametrize("name", ["pera", "panda", "ur5", "chain of 14"])
def test_the_modes_of_the_loop_at_the_goal_are_the_desired_ones(name, desired):
    """The linearised loop, by central differences of the accelerations: λ² + 2ζωλ + ω² = 0 for each mode."""
    frequency, ratio = desired
    system = MechanicalSystem(arm(name).robot, friction=None)
    goal, n = system.robot.near_home(), system.n
    law = make_controller("energy_shaping", system, goal, bandwidth=frequency, damping_ratio=ratio)

    def rate(state):
        x = system.at(state[:n], state[n:])
        return np.concatenate([x.velocity, x.acceleration(law.evaluate(0.0, x, np.zeros(0)).torque)])

    at = np.concatenate([goal, np.zeros(n)])
    h = 1e-5
    A = np.column_stack([(rate(at + h * e) - rate(at - h * e)) / (2.0 * h) for e in np.eye(2 * n)])
    # the modes are n-fold, which spreads computed eigenvalues: the polynomial that all of them solve does not
    polynomial = A @ A + 2.0 * ratio * frequency * A + frequency**2 * np.eye(2 * n)
    assert np.abs(polynomial).max() <= 1e-5 * max(1.0, np.abs(A @ A).max())


def test_either_of_both_alone_counts():
    system = arm("ur5")
    M = system.at(system.robot.home).mass_matrix
    law = make_controller("energy_shaping", system, bandwidth=5.0)
    np.testing.assert_allclose(law.stiffness, 25.0 * M)
    np.testing.assert_allclose(law.damping, 10.0 * M)
    law = make_controller("energy_shaping", system, damping_ratio=0.5)
    np.testing.assert_allclose(law.stiffness, 16.0 * M)
    np.testing.assert_allclose(law.damping, 4.0 * M)


@pytest.mark.parametrize("desired", [{"bandwidth": 0.0}, {"damping_ratio": -1.0}])
def test_what_is_desired_must_be_positive(desired):
    with pytest.raises(InvalidArgumentError, match=f"{next(iter(desired))}: must be > 0"):
        make_controller("energy_shaping", arm("ur5"), **desired)


def test_friction_limits_by_how_much_forces_are_amplified():
    """The torque holds A Y D q̇ for 1 ms too: A Y h λ_max(M⁻¹D) ≤ 1 wherever the arm is."""
    geared, bare = arm("xarm7"), MechanicalSystem(load_robot("xarm7"))
    for law, most in (("force_feedback", 0.25), ("force_control", 1.0)):
        at_ease, limited = (make_controller(law, system) for system in (geared, bare))
        np.testing.assert_allclose(at_ease.coupling @ at_ease.force_gain @ at_ease.coupling.T, most * np.eye(7))
        amplified = limited.coupling @ limited.force_gain @ limited.coupling.T
        x = bare.at(bare.robot.home)
        rates = np.linalg.eigvals(np.linalg.solve(x.mass_matrix, x.damping_matrix)).real
        assert amplified[0, 0] < 0.1 * most
        assert 0.1 < 1e-3 * amplified[0, 0] * rates.max() <= 1.0 + 1e-9


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_default_gains_are_those_of_twice_the_mean_inertia(name, rng):
    """Without friction: K_p = ω²M_d, C = 2ωM_d, diagonal; the mean is that of postures of our own."""
    system = MechanicalSystem(arm(name).robot, friction=None)
    law = make_controller("energy_shaping", system)
    mean = np.mean([system.at(system.robot.random_position(rng)).mass_matrix for _ in range(400)], axis=0)
    np.testing.assert_allclose(law.stiffness, np.diag(np.diag(law.stiffness)))
    np.testing.assert_allclose(np.diag(law.stiffness), 16.0 * 2.0 * np.diag(mean), rtol=0.2)
    np.testing.assert_allclose(law.damping, 2.0 / 4.0 * law.stiffness, rtol=1e-12)


@pytest.mark.parametrize("law", [n for n in LAWS if n != "force_control" and CONTROLLERS[n].law.run == "position"])
def test_a_law_that_is_led_starts_at_nothing_and_overshoots_nothing(law):
    """Its own states start in agreement with the reference: H_d(0) = 0, and nothing moves it from there."""
    system = arm("panda")
    robot, goal = system.robot, system.robot.near_home()
    way = {
        "trajectory" if law.startswith("tracking") else "reference": MinimumJerk.within_limits(robot, robot.home, goal)
    }
    controller = make_controller(law, system, goal, **way)
    log = simulate(system, controller, duration=2.0, dt=1e-3)
    assert log.storage[0] <= 1e-20
    assert log.storage.max() <= 1e-12
    assert PositionRun(log, None, goal, 1.0, robot).overshoot <= 1e-6
    assert (np.abs(log.velocity) <= 0.51 * robot.velocity_limit).all()
