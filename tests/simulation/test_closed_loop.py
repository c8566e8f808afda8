"""Closed loops: equilibria known in closed form, sampling, limits, failures that keep the log."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from phcontrol import (
    EnergyShaping,
    ForceFeedback,
    InvalidArgumentError,
    MechanicalSystem,
    SimulationError,
    SimulationInterrupted,
    UnknownNameError,
    certify,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.controllers.registry import CONTROLLERS, laws_for
from tests.conftest import make_system

THESIS = {"goal": [1.0, 0.5], "stiffness": 15.0, "damping": 10.0}  # section 3.4
EXTENSION = {"coupling": [0.5, 0.7], "force_gain": 2.0}


def holds_a_position(name):
    """Whether a law of the registry goes to a posture and stays there; the others have tests of their own."""
    law = make_controller(name, make_system("pera_shoulder"), [1.0, 0.5])
    return law.target_posture(0.0) is not None and not law.time_span


POSITION_LAWS = {
    name: {"stiffness": 60.0, "damping": 15.0} if "stiffness" in CONTROLLERS[name].law.parameters else {}
    for name in laws_for(make_system("pera_shoulder"))
    if holds_a_position(name)
}
POSITION_LAWS["impedance_grasping"] = {"stiffness": 3.0, "damping": 15.0, "rest_stiffness": 3.0}


@pytest.mark.parametrize("law", list(POSITION_LAWS))
def test_laws_bring_the_shoulder_to_its_goal_and_storage_never_grows(shoulder, law):
    # the integral settles with the time constant C = 15 N·m·s/rad over 1 N·m/rad, what a step is taken for as a body
    # with one of 4 s (its certificate says), all else within a second
    duration = {"integral_action": 20.0, "impedance_grasping": 20.0, "adaptive_payload": 40.0}.get(law, 6.0)
    controller = make_controller(law, shoulder, goal=[1.0, 0.5], **POSITION_LAWS[law])
    log = simulate(shoulder, controller, duration=duration, dt=2e-3)
    np.testing.assert_allclose(log.position[-1], [1.0, 0.5], atol=1e-4)
    assert np.diff(log.storage).max() <= 1e-12 * log.storage[0]


def test_a_constant_force_shifts_the_equilibrium_as_the_stiffness_says(shoulder):
    """Energy shaping and measured force feedback rest at q_d + K_p⁻¹f_e, (3.40); modeled feedback at q_d (E12)."""
    force = np.array([3.0, -3.0])
    shifted = np.array([1.0, 0.5]) + force / 15.0
    for controller, expected in [
        (EnergyShaping(shoulder, **THESIS), shifted),
        (ForceFeedback(shoulder, measured=True, **THESIS, **EXTENSION), shifted),
        (ForceFeedback(shoulder, measured=False, **THESIS, **EXTENSION), [1.0, 0.5]),
    ]:
        log = simulate(shoulder, controller, duration=25.0, dt=5e-3, disturbance=force)
        np.testing.assert_allclose(log.position[-1], expected, atol=1e-3)


@pytest.mark.parametrize("measured", [False, True])
def test_the_same_on_the_seven_joint_arm(pera, measured):
    force, stiffness = np.array([2.0, -2.0, 1.0, 1.0, -0.5, 0.2, 0.2]), np.array([30.0, 30, 20, 20, 15, 6, 6])
    goal = np.array([-0.3, 1.0, -0.3, -0.9, 0.3, -1.2, 0.2])
    controller = make_controller("force_feedback", pera, goal, measured=measured, stiffness=stiffness)
    log = simulate(pera, controller, duration=10.0, dt=5e-3, disturbance=force)
    np.testing.assert_allclose(log.position[-1], goal + measured * force / stiffness, atol=1e-3)


def test_modeled_feedback_takes_up_the_load_in_its_state(shoulder):
    """z∞ = −A⁻¹(ḠCḠᵀ)⁻¹B̄f_e (theory 4.2)."""
    force, A = np.array([3.0, -3.0]), np.diag([0.5, 0.7])
    controller = ForceFeedback(shoulder, **THESIS, **EXTENSION)
    log = simulate(shoulder, controller, duration=25.0, dt=5e-3, disturbance=force)
    x = shoulder.at(log.position[-1], log.velocity[-1])
    G = x.transformed_input
    expected = -np.linalg.solve(A, np.linalg.solve(10.0 * G @ G.T, x.solve_factor(force)))
    np.testing.assert_allclose(log.controller_state[-1], expected, rtol=1e-3)


def test_integral_action_holds_the_goal_and_finds_the_force(shoulder):
    """Theorem 3.2.5 with errata E13: q → q_d, ξ → f_e, with the time constant C/(1 N·m/rad) = 5 s."""
    force = np.array([3.0, -3.0])
    controller = make_controller("integral_action", shoulder, goal=[1.0, 0.5], stiffness=15.0, damping=5.0)
    log = simulate(shoulder, controller, duration=60.0, dt=1e-2, disturbance=force)
    np.testing.assert_allclose(log.position[-1], [1.0, 0.5], atol=1e-4)
    np.testing.assert_allclose(log.controller_state[-1, 2:], force, atol=1e-3)


def test_total_force_rejection_does_not_feel_the_force(shoulder):
    controller = make_controller("total_force_rejection", shoulder, **THESIS)
    pushed, free = (
        simulate(shoulder, controller, duration=1.0, dt=5e-3, disturbance=force) for force in ([3.0, -3.0], [0.0, 0.0])
    )
    np.testing.assert_allclose(pushed.position, free.position, atol=1e-10)


def test_sampled_control_converges_to_continuous_control_with_the_period(shoulder):
    controller = make_controller("force_feedback", shoulder, goal=[1.0, 0.5])
    reference = simulate(shoulder, controller, duration=0.5, dt=1e-3).position[-1]
    errors = [
        np.abs(simulate(shoulder, controller, duration=0.5, control_period=period).position[-1] - reference).max()
        for period in (8e-3, 4e-3, 2e-3)
    ]
    for slow, fast in itertools.pairwise(errors):
        assert slow / fast == pytest.approx(2.0, rel=0.2)  # a hold is of first order


def test_sampled_torque_is_held_between_samples(shoulder):
    log = simulate(shoulder, make_controller("energy_shaping", shoulder, **THESIS), duration=0.1, control_period=0.01)
    for start in range(0, 100, 10):
        assert (log.torque[start : start + 10] == log.torque[start]).all()
    assert len(np.unique(log.torque[:, 0])) == 11


def test_times_come_from_the_step_index(shoulder):
    log = simulate(shoulder, make_controller("energy_shaping", shoulder), duration=0.7, dt=1e-3)
    np.testing.assert_array_equal(log.time, np.arange(701) * 1e-3)


def test_torque_limits_are_applied_and_reported(shoulder):
    controller = make_controller("energy_shaping", shoulder, goal=[1.0, 0.5], stiffness=100.0)
    log = simulate(shoulder, controller, duration=0.5)
    assert np.abs(log.torque).max() == 40.0
    assert log.saturated[0]
    free = simulate(shoulder, controller, duration=0.5, torque_limit=None)
    assert np.abs(free.torque).max() > 99.0
    assert not free.saturated.any()
    tight = simulate(shoulder, controller, duration=0.1, torque_limit=[5.0, 3.0])
    np.testing.assert_array_equal(np.abs(tight.torque).max(axis=0), [5.0, 3.0])


def test_the_controller_may_compute_with_another_model_than_the_plant(shoulder):
    """With gravity too weak in the model, energy shaping sags by what is missing: K_p q̃ = −Δg."""
    model = MechanicalSystem(shoulder.robot, gravity=[0.0, 0.0, -9.0])
    log = simulate(shoulder, EnergyShaping(model, **THESIS), duration=20.0, dt=5e-3)
    x = shoulder.at(log.position[-1])
    missing = x.gravity * (1.0 - 9.0 / 9.81)
    np.testing.assert_allclose(log.position[-1], np.array([1.0, 0.5]) - missing / 15.0, atol=1e-4)


def test_a_diverging_run_stops_and_keeps_its_log(shoulder):
    controller = EnergyShaping(shoulder, goal=[1.0, 0.5], stiffness=1e7, damping=1.0)
    with pytest.raises(SimulationError, match=r"stopped at t = .*Try a smaller dt \(0.01 s\)") as caught:
        simulate(shoulder, controller, duration=10.0, dt=1e-2, torque_limit=None)
    log = caught.value.log
    assert 1 < len(log) < 1000
    assert np.isfinite(log.position).all()


def test_an_interrupted_run_keeps_its_log(shoulder):
    def impatient(t, x):
        if t > 0.1:
            raise KeyboardInterrupt
        return np.zeros(2)

    with pytest.raises(SimulationInterrupted) as caught:
        simulate(shoulder, make_controller("energy_shaping", shoulder), duration=1.0, disturbance=impatient)
    assert len(caught.value.log) == 101
    assert caught.value.log.storage.shape == (101,)


@pytest.mark.parametrize(
    ("arguments", "error", "complaint"),
    [
        ({"dt": 0.0}, InvalidArgumentError, "dt: must be > 0, but is 0"),
        ({"dt": -1e-3}, InvalidArgumentError, "dt: must be > 0"),
        ({"duration": np.nan}, InvalidArgumentError, "duration: must be finite"),
        ({"q0": [0.0] * 6}, InvalidArgumentError, r"q0: must have shape \(2,\), but has shape \(6,\)"),
        ({"v0": [np.inf, 0.0]}, InvalidArgumentError, "v0: must be finite"),
        ({"controller_state0": [1.0]}, InvalidArgumentError, r"controller_state0: must have shape \(0,\)"),
        ({"disturbance": [1.0]}, InvalidArgumentError, "disturbance: must have shape"),
        ({"disturbance": lambda t, x: np.zeros(3)}, SimulationError, "disturbance: must have shape"),
        ({"disturbance": lambda t, x: [np.nan, 0.0]}, SimulationError, "disturbance: must be finite"),
        ({"integrator": "euler"}, UnknownNameError, "unknown integrator 'euler'.*rk4"),
        ({"control_period": 2.5e-3}, InvalidArgumentError, "control_period: must be a whole multiple of dt"),
        ({"control_period": 0.0}, InvalidArgumentError, "control_period: must be > 0"),
        ({"torque_limit": -1.0}, InvalidArgumentError, "torque_limit: must be > 0"),
        ({"torque_limit": "none"}, UnknownNameError, "unknown torque limit"),
    ],
)
def test_bad_arguments_are_refused(shoulder, arguments, error, complaint):
    with pytest.raises(error, match=complaint):
        simulate(shoulder, make_controller("energy_shaping", shoulder), **({"duration": 0.01} | arguments))


def test_a_controller_for_another_arm_is_refused(shoulder):
    other = MechanicalSystem(load_robot("pera_gripper"))
    with pytest.raises(InvalidArgumentError, match="controller: is for 1 joints, the system has 2"):
        simulate(shoulder, make_controller("energy_shaping", other), duration=0.1)


def test_a_robot_in_place_of_a_system_is_named(shoulder):
    law = make_controller("energy_shaping", shoulder)
    with pytest.raises(InvalidArgumentError, match="system: must be a MechanicalSystem, but is Robot"):
        simulate(shoulder.robot, law, duration=0.1)
    with pytest.raises(InvalidArgumentError, match="controller: must be a Controller, but is MechanicalSystem"):
        simulate(law, shoulder, duration=0.1)
    with pytest.raises(InvalidArgumentError, match="controller: must be a Controller, but is MechanicalSystem"):
        certify(shoulder, law)
    with pytest.raises(InvalidArgumentError, match="system: must be a MechanicalSystem, but is Robot"):
        certify(law, shoulder.robot)
