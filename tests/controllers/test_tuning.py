"""Default gains on every arm: what they make of a step, of a desired bandwidth, and of a torque that is held."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigvals, expm, tanhm

from phcontrol import (
    EnergyShaping,
    InvalidArgumentError,
    MechanicalSystem,
    MinimumJerk,
    StribeckFriction,
    linearize,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.controllers.registry import CONTROLLERS
from phcontrol.controllers.tuning import Tuning
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


@pytest.mark.parametrize("law", ["force_feedback", "force_feedback_measured", "integral_action"])
@pytest.mark.parametrize("name", ["ur5", "pera"])
def test_a_bandwidth_places_the_poles_of_laws_with_states_of_their_own(name, law):
    """ω and ζ are in the spectrum of the true loop, once a joint, and every other pole is real and no slower than ω."""
    system = arm(name)
    controller = make_controller(law, system, system.robot.near_home(), bandwidth=6.0, damping_ratio=0.7)
    found = linearize(controller, system, exact=False)
    pairs = [mode for mode in found.spectrum if mode.oscillates]
    assert len(pairs) == system.n
    np.testing.assert_allclose([mode.frequency for mode in pairs], 6.0, rtol=0.02)
    np.testing.assert_allclose([mode.damping_ratio for mode in pairs], 0.7, rtol=0.02)
    assert min(mode.frequency for mode in found.spectrum) >= 6.0 * 0.98


def test_a_bandwidth_goes_with_no_gain_that_it_places():
    system = arm("ur5")
    for law, given in (("force_feedback", {"stiffness": 10.0}), ("integral_action", {"integral_gain": 2.0}),
                       ("force_feedback", {"coupling": 0.3})):  # fmt: skip
        with pytest.raises(InvalidArgumentError, match=f"{next(iter(given))}: is what a bandwidth places the poles"):
            make_controller(law, system, bandwidth=6.0, **given)
    for desired in ({"bandwidth": 6.0}, {"damping_ratio": 0.7}):
        with pytest.raises(InvalidArgumentError, match="is nothing that the gains of impedance_grasping are chosen by"):
            make_controller("impedance_grasping", system, **desired)


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
    """The torque holds A Y D q̇ for 1 ms too: h λ_max(A Y D̄) ≤ 1 wherever the arm is."""
    geared, bare = arm("xarm7"), MechanicalSystem(load_robot("xarm7"))
    generator = np.random.default_rng(5)
    for law, most in (("force_feedback", 0.25), ("force_control", 1.0)):
        at_ease, limited = (make_controller(law, system) for system in (geared, bare))
        np.testing.assert_allclose(at_ease.coupling @ at_ease.force_gain @ at_ease.coupling.T, most * np.eye(7))
        amplified = limited.coupling @ limited.force_gain @ limited.coupling.T
        assert amplified[-1, -1] < 0.1 * most  # the light wrist
        assert amplified[0, 0] > 10.0 * amplified[-1, -1]  # and not all joints with it
        for q in (bare.robot.home, *(bare.robot.random_position(generator) for _ in range(5))):
            x = bare.at(q)
            inverse = np.linalg.inv(np.linalg.cholesky(x.mass_matrix))
            rates = np.linalg.eigvals(amplified @ inverse @ x.damping_matrix @ inverse.T).real
            assert 1e-3 * rates.max() <= 1.1  # drawn postures need not be those that were looked at


def test_a_joint_that_friction_holds_is_so_stiff_that_an_error_goes_in_a_second_and_a_quarter():
    """d/K_p = 1.25 s where that is stiffer than 2ω² times the mean inertia; the others are as without friction."""
    robot, viscous = arm("ur5").robot, np.array([0.0, 800.0, 0.0, 0.0, 60.0, 10.0])
    held = make_controller("energy_shaping", MechanicalSystem(robot, friction=StribeckFriction(viscous=viscous)))
    free = make_controller("energy_shaping", MechanicalSystem(robot, friction=None))
    stiffness, usual = np.diag(held.stiffness), np.diag(free.stiffness)
    leans = viscous > 0.0
    assert (viscous[leans] / 1.25 > usual[leans]).all()
    np.testing.assert_allclose(stiffness[leans], viscous[leans] / 1.25, rtol=1e-12)
    np.testing.assert_allclose(stiffness[~leans], usual[~leans], rtol=1e-12)


@pytest.mark.parametrize(("name", "dry"), [("panda", 2.5), ("panda", 3.5)])
def test_no_joint_is_less_stiff_against_friction_than_a_held_torque_asks_for(name, dry):
    """A joint that was lowered cannot be raised again by a quarter: hM⁻¹C would then take more than it may.

    That is λ_max(hC, ½M X coth(X/2)) ≤ 1.2, X = hM⁻¹D of fast motion, at any of the postures.
    """
    system, h, most = MechanicalSystem(arm(name).robot, friction=StribeckFriction(coulomb=dry)), 1e-3, 1.2
    tuning = Tuning(system, system.robot.home, system.robot.home)
    mean = 2.0 * np.mean([seen.inertia for seen in tuning._everywhere], axis=0).diagonal()
    desired = np.maximum(16.0 * mean, 0.8 * np.diag(system.at(system.robot.home).damping_matrix))

    def taken(stiffness, left):
        """C = 2(K_pM_d)^½, less what is left to friction."""
        damping = np.diag(2.0 * np.sqrt(stiffness * mean) - left)
        return max(eigvals(h * damping, bearable).real.max() for bearable in bearables)

    bearables = [
        0.5 * h * seen.moving @ np.linalg.inv(tanhm(0.5 * h * np.linalg.solve(seen.inertia, seen.moving)))
        for seen in tuning._everywhere
    ]
    stiffness = np.diag(tuning.stiffness)
    left = 2.0 * np.sqrt(stiffness * mean) - np.diag(tuning.damping)
    lowered = np.flatnonzero(stiffness < desired * (1.0 - 1e-9))
    assert lowered.size
    assert taken(stiffness, left) <= most * (1.0 + 1e-9)
    for joint in lowered:
        raised = stiffness.copy()
        raised[joint] = min(raised[joint] / 0.8**2, desired[joint])
        assert taken(raised, left) > most


RESTING = ["energy_shaping", "force_feedback", "force_feedback_measured", "integral_action", "total_force_rejection",
           "impedance_grasping", "classical_impedance"]  # fmt: skip
"""Laws all of whose modes come to rest: no tank, no estimate, no motion that leaves a hand alone."""
SLOWEST = 3.0  # [s]


def slowest(system, law):
    """Return the slowest mode of the loop about its rest [s]."""
    return max(mode.time_constant for mode in linearize(make_controller(law, system), system, exact=False).spectrum)


@pytest.mark.study
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("law", RESTING)
@pytest.mark.parametrize("name", [*STEPPED, *(f"{name} without rotors" for name, given in CATALOGUE.items() if given)])
def test_no_default_gains_are_slower_than_3_s(name, law):
    bare = name.removesuffix(" without rotors")
    system = arm(name) if bare == name else MechanicalSystem(load_robot(bare))
    assert slowest(system, law) <= SLOWEST


@pytest.mark.parametrize("law", ["energy_shaping", "force_feedback", "integral_action"])
@pytest.mark.parametrize("name", ["z1", "xarm7"])
def test_light_joints_with_dry_friction_come_to_rest_in_3_s(name, law):
    """Their URDF files have friction and no rotors: one light joint used to make all as soft as itself."""
    assert slowest(MechanicalSystem(load_robot(name)), law) <= SLOWEST


@pytest.mark.parametrize("name", ["z1", "xarm7", "talos_arm"])
def test_gains_that_lean_on_friction_are_stable_when_they_are_held(name):
    """At rest, and with the friction of fast motion, where dry friction hardly counts, at h = 1 ms."""
    system = MechanicalSystem(load_robot(name))
    law = make_controller("energy_shaping", system)
    generator = np.random.default_rng(7)
    for q in (system.robot.home, *(system.robot.random_position(generator) for _ in range(10))):
        for v in (np.zeros(system.n), system.robot.velocity_limit):
            M, D = system.at(q).mass_matrix, system.at(q, v).damping_matrix
            n, h = system.n, 1e-3
            A = np.block([[np.zeros((n, n)), np.eye(n)], [np.zeros((n, n)), -np.linalg.solve(M, D)]])
            B = np.vstack([np.zeros((n, n)), np.linalg.inv(M)])
            step = expm(h * np.block([[A, B], [np.zeros((n, 3 * n))]]))
            closed = step[: 2 * n, : 2 * n] - step[: 2 * n, 2 * n :] @ np.hstack([law.stiffness, law.damping])
            assert np.abs(np.linalg.eigvals(closed)).max() < 1.0


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
