"""The momentum observer against the filter it is, and laws fed by it."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import InvalidArgumentError, make_controller, simulate
from phcontrol.environments.disturbances import Sine, Step
from phcontrol.sensors.momentum_observer import MomentumObserver
from tests.conftest import make_system


@pytest.mark.parametrize("arm", ["pera", "pera_shoulder", "panda_with_fingers"])
@pytest.mark.parametrize("control_period", [None, 1e-3])
def test_it_is_a_first_order_filter_of_the_true_force(arm, control_period):
    """While the arm moves and friction acts: r(t) = (1 − exp(−K_o t))f_e under a constant f_e, within 1 %."""
    system = make_system(arm)
    force = np.linspace(1.0, 0.2, system.n)
    controller = make_controller("force_feedback", system, goal=system.robot.home + 0.05)
    log = simulate(
        system,
        controller,
        duration=0.5,
        disturbance=force,
        control_period=control_period,
        sensors=[MomentumObserver(system, gain=20.0)],
        torque_limit=None,
    )
    estimate = log.measured["external_force"]
    expected = np.outer(1.0 - np.exp(-20.0 * log.time), force)
    np.testing.assert_allclose(estimate[50:], expected[50:], atol=0.02)
    np.testing.assert_allclose(estimate[-1], force, rtol=1e-2)


def test_it_follows_a_varying_force_with_its_lag(shoulder):
    """A sine of 0.5 Hz through 1/(1 + s/K_o): amplitude and phase of the filter."""
    gain, rate = 20.0, np.pi
    log = simulate(
        shoulder,
        make_controller("energy_shaping", shoulder),
        duration=4.0,
        disturbance=Sine([1.0, 0.0], 0.5),
        sensors=[MomentumObserver(shoulder, gain)],
    )
    response = 1.0 / (1.0 + 1j * rate / gain)
    expected = np.imag(response * np.exp(1j * rate * log.time[2000:]))
    np.testing.assert_allclose(log.measured["external_force"][2000:, 0], expected, atol=2e-3)


def test_a_law_fed_by_it_still_settles(shoulder):
    """The measured law rests at q_d + K_p⁻¹f_e, with the observer in the place of the sensor."""
    force = np.array([3.0, -3.0])
    controller = make_controller("force_feedback_measured", shoulder, goal=[1.0, 0.5], stiffness=15.0, damping=10.0)
    log = simulate(
        shoulder, controller, duration=15.0, dt=2e-3, disturbance=Step(force), sensors=[MomentumObserver(shoulder)]
    )
    np.testing.assert_allclose(log.position[-1], [1.2, 0.3], atol=1e-3)
    np.testing.assert_allclose(log.measured["external_force"][-1], force, rtol=1e-2)


def test_it_may_run_slower_than_the_loop(shoulder):
    force = np.array([2.0, -1.0])
    log = simulate(
        shoulder,
        make_controller("energy_shaping", shoulder),
        duration=1.0,
        disturbance=force,
        sensors=[MomentumObserver(shoulder, gain=20.0, period=0.01)],
    )
    np.testing.assert_allclose(log.measured["external_force"][-1], force, rtol=1e-2)


def test_unknown_friction_is_taken_for_a_force(shoulder):
    """What its model does not have shows in the estimate: stated, so tested."""
    from phcontrol import MechanicalSystem

    blind = MechanicalSystem(shoulder.robot, friction=None)
    log = simulate(
        shoulder,
        make_controller("energy_shaping", shoulder, goal=[1.0, 0.5]),
        duration=0.5,
        sensors=[MomentumObserver(blind, gain=200.0)],
    )
    x = shoulder.at(log.position[-1], log.velocity[-1])
    np.testing.assert_allclose(log.measured["external_force"][-1], -x.friction_torque, rtol=0.1)


def test_bad_arguments_are_refused(shoulder):
    with pytest.raises(InvalidArgumentError, match="gain: must be > 0"):
        MomentumObserver(shoulder, gain=0.0)
    with pytest.raises(InvalidArgumentError, match="system: must be a MechanicalSystem"):
        MomentumObserver(shoulder.robot)
