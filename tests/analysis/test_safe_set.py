"""Safe sets: what starts in one reaches no limit, each bound is what it says, and what is not proved is refused."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    EnergyShaping,
    ForceRegulation,
    InvalidArgumentError,
    JointForce,
    JointSpring,
    Limits,
    MechanicalSystem,
    MinimumJerk,
    PHControlError,
    UnknownNameError,
    load_robot,
    make_controller,
    safe_set,
    simulate,
    simulate_many,
)

FINGERS = ["panda_finger_joint1", "panda_finger_joint2"]
LAWS = {
    "energy_shaping": ("position", "velocity", "effort"),
    "force_feedback": ("position", "velocity"),
    "integral_action": ("position", "velocity"),
    "impedance_grasping": ("position", "velocity"),
    "total_force_rejection": ("position", "velocity"),
    "classical_impedance": ("position", "velocity"),
}


def arm(name: str) -> MechanicalSystem:
    return MechanicalSystem(load_robot(name, locked_joints=FINGERS if name == "panda" else []))


def used(log, law):
    """Return how much of each kind of limit a run used: 1 is the limit."""
    robot, away = law.system.robot, log.position - law.goal
    way = np.where(away > 0.0, robot.upper - law.goal, law.goal - robot.lower)
    return {
        "position": float(np.max(np.abs(away) / way)),
        "velocity": float(np.max(np.abs(log.velocity) / robot.velocity_limit)),
        "effort": float(np.max(np.abs(log.torque) / robot.effort_limit)),
    }


@pytest.mark.parametrize("name", ["panda", "pera"])
@pytest.mark.parametrize("law", list(LAWS))
def test_no_start_on_the_border_reaches_a_limit(name, law):
    system = arm(name)
    made = make_controller(law, system, system.robot.near_home())
    found = safe_set(made, keep=LAWS[law])
    starts = found.border(12)
    for q, v, z in zip(*starts, strict=True):
        assert found.storage(q, v, z) == pytest.approx(found.level, rel=1e-6)
        assert found.contains(q, v, z)
        log = simulate(system, made, q0=q, v0=v, controller_state0=z, duration=0.6, dt=2e-3, torque_limit=None)
        assert max(used(log, made)[kind] for kind in LAWS[law]) < 1.0
        assert np.diff(log.storage).max() <= 1e-9


def test_many_more_starts_and_how_much_larger_the_true_set_is():
    """512 at once; the bound is careful, but not without end: eight times the energy is too much."""
    system = arm("pera")
    law = make_controller("energy_shaping", system, system.robot.near_home())
    found = safe_set(law)
    most = []
    for factor in (1.0, 8.0):
        q, v, z = found.border(512, level=factor * found.level)
        outcomes = simulate_many(
            system, law, q0=q, v0=v, controller_state0=z, duration=0.3, dt=2e-3, torque_limit=None, progress=False
        )
        assert not any(outcome.error for outcome in outcomes)
        most.append(max(max(used(outcome.value, law).values()) for outcome in outcomes))
    assert most[0] < 1.0 < most[1]


def test_the_position_level_is_exact_for_a_spring():
    """The least Ψ on the face of a limit, by a search over the face; and a push through it."""
    system = MechanicalSystem(load_robot("pera_shoulder"))
    law = EnergyShaping(system, goal=[0.1, 0.4], stiffness=[[20.0, 9.0], [9.0, 12.0]], damping=1.0)
    found = safe_set(law, keep="position")
    robot = system.robot
    for i, joint in enumerate(robot.joint_names):
        for end, limit in (("lower", robot.lower[i]), ("upper", robot.upper[i])):
            others = np.linspace(-6.0, 6.0, 200001)
            away = np.zeros((len(others), 2))
            away[:, i], away[:, 1 - i] = limit - law.goal[i], others
            least = float((0.5 * np.einsum("ki,ij,kj->k", away, law.stiffness, away)).min())
            assert found.levels[f"{end} position of {joint}"] == pytest.approx(least, rel=1e-7)
    assert found.level == min(found.levels.values())
    assert found.levels[found.binding] == found.level


def test_the_velocity_level_is_that_of_one_joint_by_hand():
    """M is one number: ½ M v_max², times 1/(1 + A Y) with force feedback."""
    from tests.controllers.arms import chain

    system = chain(1)
    M = float(system.at([0.0]).mass_matrix[0, 0])
    limits = Limits(system, velocity=[2.0], effort=[100.0], lower=[-3.0], upper=[3.0], braking_acceleration=[1.0])
    plain = make_controller("energy_shaping", system, stiffness=1e3, damping=1.0)
    assert safe_set(plain, limits, keep="velocity").level == pytest.approx(0.5 * M * 4.0)
    fed = make_controller("force_feedback", system, stiffness=1e3, damping=1.0, coupling=1.0, force_gain=3.0)
    assert safe_set(fed, limits, keep="velocity").level == pytest.approx(0.5 * M * 4.0 / 4.0)
    summed = make_controller(
        "integral_action", system, stiffness=1e3, damping=1.0, coupling=1.0, force_gain=3.0, integral_gain=5.0
    )
    expected = 2.0**2 / (2.0 * (4.0 / M + 25.0 / 1e3))
    assert safe_set(summed, limits, keep="velocity").level == pytest.approx(expected)
    # attained: the start in which all of c is in the joint's motion
    level = safe_set(fed, limits, keep="velocity").level
    q, v, z = safe_set(fed, limits, keep="velocity").border(4000)
    assert 0.98 < np.abs(v).max() / 2.0 <= 1.0
    assert level > 0.0


def test_the_velocity_level_follows_from_bounds_that_hold_everywhere():
    system = arm("panda")
    law = make_controller("energy_shaping", system, system.robot.near_home())
    certified = safe_set(law, keep=("position", "velocity"))
    sampled = safe_set(law, keep=("position", "velocity"), inertia="sampled")
    assert certified.certified
    assert not sampled.certified
    assert certified.level < sampled.level
    assert "proved" in str(certified)
    assert "prove nothing" in str(sampled)


def test_torques_stay_below_their_bound():
    """The level of each motor, against the largest torque on the border of a set that only that level limits."""
    system = arm("ur5")
    law = make_controller("energy_shaping", system, system.robot.near_home())
    found = safe_set(law, keep="effort")
    q, v, _ = found.border(300)
    asked = np.array(
        [np.abs(law.evaluate(0.0, system.at(a, b), np.zeros(0)).torque) for a, b in zip(q, v, strict=True)]
    )
    assert (asked.max(axis=0) <= system.robot.effort_limit).all()
    assert (asked.max(axis=0) / system.robot.effort_limit).max() > 0.4  # not without end
    with pytest.raises(InvalidArgumentError, match="no bound is proved of the torque of force_feedback"):
        safe_set(make_controller("force_feedback", system))


def test_a_posture_spring_makes_cartesian_impedance_safe():
    system = arm("pera")
    law = make_controller("cartesian_impedance", system, posture="spring")
    found = safe_set(law, keep=("position", "velocity"))
    for q, v, _ in zip(*found.border(6), strict=True):
        assert found.contains(q, v)
        log = simulate(system, law, q0=q, v0=v, duration=0.4, dt=2e-3, torque_limit=None)
        assert (np.abs(log.velocity) < system.robot.velocity_limit).all()
        assert ((log.position > system.robot.lower) & (log.position < system.robot.upper)).all()
    with pytest.raises(InvalidArgumentError, match='0 springs on the joints.*posture="spring"'):
        safe_set(make_controller("cartesian_impedance", system), keep="position")


def test_energy_from_outside_is_what_the_margin_allows():
    """A push of less than the margin reaches no limit; its energy is that of the log."""
    system = arm("pera")
    law = make_controller("energy_shaping", system, system.robot.near_home())
    found = safe_set(law)
    assert found.margin(law.goal) == found.level
    push = np.zeros(system.n)
    push[3] = 0.05
    log = simulate(system, law, q0=law.goal, duration=0.5, dt=1e-3, disturbance=push, torque_limit=None)
    supplied = np.cumsum(np.einsum("ki,ki->k", log.velocity, log.external_force))[-1] * 1e-3
    assert 0.0 < supplied < found.level
    assert log.storage.max() <= supplied * 1.05
    assert max(used(log, law).values()) < 1.0


def test_what_is_not_proved_is_refused():
    system = MechanicalSystem(load_robot("pera_shoulder"))
    goal = system.robot.near_home()
    law = make_controller("energy_shaping", system, goal)
    with pytest.raises(UnknownNameError, match="unknown keep 'speed'"):
        safe_set(law, keep=("speed",))
    with pytest.raises(InvalidArgumentError, match="keep: is empty"):
        safe_set(law, keep=())
    with pytest.raises(InvalidArgumentError, match="controller: must be a Controller"):
        safe_set("energy_shaping")
    with pytest.raises(InvalidArgumentError, match="limits: must be Limits"):
        safe_set(law, 3.0)
    with pytest.raises(InvalidArgumentError, match="force_control"):
        safe_set(make_controller("force_control", system))
    led = make_controller("energy_shaping", system, reference=MinimumJerk(system.robot.home, goal, 2.0))
    with pytest.raises(InvalidArgumentError, match="is led"):
        safe_set(led)
    with pytest.raises(InvalidArgumentError, match="moves its goal"):
        safe_set(make_controller("impedance_grasping", system, regulation=ForceRegulation([0.1, 0.1])))
    pulled = JointSpring(goal, 20.0) + JointForce([1.0, 0.0])
    with pytest.raises(InvalidArgumentError, match="shapes JointForce, of which no least value is known"):
        safe_set(make_controller("energy_shaping", system, potential=pulled))
    outside = EnergyShaping(system, goal=system.robot.upper + 0.1, stiffness=10.0, damping=1.0)
    with pytest.raises(PHControlError, match="no set is safe: the upper limit"):
        safe_set(outside, keep="position")
