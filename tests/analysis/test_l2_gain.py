"""The L₂ bound against simulated disturbances and the H∞ norm of the linearised loop."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    InvalidArgumentError,
    Measured,
    MechanicalSystem,
    PHControlError,
    StribeckFriction,
    make_controller,
    simulate,
)
from phcontrol.analysis.l2_gain import damping_for_gain, l2_gain, measured_l2_gain
from phcontrol.environments.disturbances import Pulse, Sine, Step
from tests.conftest import make_system
from tests.finite_differences import gradient

HOME = [1.0, 0.5]
THESIS = {"goal": HOME, "stiffness": 15.0, "damping": 10.0}
FAMILY = {
    "step": Step([3.0, -3.0]),
    "pulse": Pulse([3.0, 3.0], 0.0, 1.0),
    "slow sine": Sine([0.0, 1.0], 0.05),
    "resonant sine": Sine([1.0, 1.0], 0.5),
    "fast sine": Sine([1.0, -1.0], 3.0),
    "mixture": Sine([1.0, 0.3], 0.2) + Pulse([0.0, 4.0], 3.0, 2.0),
}


@pytest.mark.parametrize("name", list(FAMILY))
@pytest.mark.parametrize("law", ["energy_shaping", "force_feedback", "integral_action"])
def test_no_simulated_ratio_exceeds_the_bound(shoulder, law, name):
    controller = make_controller(law, shoulder, **THESIS)
    log = simulate(shoulder, controller, duration=15.0, dt=1e-2, q0=HOME, disturbance=FAMILY[name])
    assert measured_l2_gain(log) <= l2_gain(controller, shoulder).bound


def test_the_bound_is_tight(shoulder):
    """The worst of the family comes within 2 % of γ = 0.1."""
    controller = make_controller("force_feedback", shoulder, coupling=[0.5, 0.7], force_gain=2.0, **THESIS)
    worst = max(
        measured_l2_gain(simulate(shoulder, controller, duration=30.0, dt=1e-2, q0=HOME, disturbance=disturbance))
        for disturbance in FAMILY.values()
    )
    assert 0.098 <= worst <= l2_gain(controller, shoulder).bound == 0.1


def test_the_bound_is_the_h_infinity_norm_of_the_linearised_loop(shoulder):
    """ẋ = (J − R)∂²H x + g f at the goal, y = gᵀ∂²H x: largest singular value over frequencies is 1/λ_min(C)."""
    controller = make_controller("force_feedback", shoulder, coupling=[0.5, 0.7], force_gain=2.0, **THESIS)
    target = controller.target(0.0, shoulder.at(HOME), np.zeros(2))
    hessian = np.diag([15.0, 15.0, 1.0, 1.0, 0.5, 0.5])
    A = (target.interconnection - target.dissipation) @ hessian
    B, C = target.port, target.port.T @ hessian
    norms = [
        np.linalg.svd(C @ np.linalg.solve(1j * w * np.eye(6) - A, B), compute_uv=False)[0]
        for w in np.geomspace(1e-4, 1e3, 400)
    ]
    assert max(norms) == pytest.approx(l2_gain(controller, shoulder).bound, rel=1e-3)


@pytest.mark.parametrize("arm", ["pera", "panda"])
def test_the_inequality_holds_at_random_states(arm):
    system = make_system(arm)
    for law in ("energy_shaping", "force_feedback", "integral_action"):
        found = l2_gain(make_controller(law, system), system)
        assert found.passed
        assert found.source == "injected damping"


MIXED = [[1.0, 0.3], [-0.2, 0.8]]


def h_infinity(law, system, goal, output):
    """Return the H∞ norm from f_e to an output of (q, q̇, state), everything by finite differences of the true loop."""
    n, m = system.n, law.state_size

    def rate(y, force):
        x = system.at(y[:n], y[n : 2 * n])
        measured = Measured(external_force=force, total_force=x.total_force(force))
        command = law.evaluate(0.0, x, y[2 * n :], measured)
        return np.concatenate([y[n : 2 * n], x.acceleration(command.torque, force), command.state_rate])

    rest, nothing = np.concatenate([goal, np.zeros(n + m)]), np.zeros(n)
    A = gradient(lambda y: rate(y, nothing), rest, 1e-5).T
    B = gradient(lambda force: rate(rest, force), nothing, 1e-3).T
    C = gradient(lambda y: output(system.at(y[:n], y[n : 2 * n]), y[2 * n :]), rest, 1e-5).T
    frequencies = np.geomspace(1e-4, 1e3, 2000)
    return max(np.linalg.svd(C @ np.linalg.solve(1j * w * np.eye(len(A)) - A, B))[1][0] for w in frequencies)


@pytest.mark.parametrize("law", ["energy_shaping", "force_feedback", "classical_impedance"])
@pytest.mark.parametrize("friction", [None, StribeckFriction(viscous=[1.0, 2.0])])
def test_the_norm_of_the_true_loop_is_below_the_bound_with_an_input_matrix(shoulder, law, friction):
    system = MechanicalSystem(shoulder.robot, friction=friction, input_matrix=MIXED)
    controller = make_controller(law, system, goal=HOME, stiffness=15.0, damping=[4.0, 6.0])

    def output(x, state):
        target = controller.target(0.0, x, state)
        return target.port.T @ target.gradient

    found = l2_gain(controller, system)
    norm = h_infinity(controller, system, np.array(HOME), output)
    assert found.passed
    assert found.linear_norm == pytest.approx(norm, rel=1e-3)
    assert norm <= found.bound * (1.0 + 1e-4)
    if law == "force_feedback":  # friction never helps it, so that the bound is reached
        assert norm == pytest.approx(found.bound, rel=1e-2)
        assert found.bound == pytest.approx(
            1.0 / np.linalg.eigvalsh(MIXED @ np.diag([4.0, 6.0]) @ np.transpose(MIXED))[0]
        )


def test_feedback_of_the_measured_force_is_bounded_by_friction_alone(shoulder):
    """y = q̇, and where z moves along C takes nothing: 1/F_v, and without friction no bound."""
    viscous = MechanicalSystem(shoulder.robot, friction=StribeckFriction(viscous=[1.0, 2.0]))
    controller = make_controller("force_feedback_measured", viscous, **THESIS)
    found = l2_gain(controller, viscous)
    assert found.passed
    assert (found.bound, found.source) == (1.0, "viscous friction")
    norm = h_infinity(controller, viscous, np.array(HOME), lambda x, state: x.velocity)
    assert found.linear_norm == pytest.approx(norm, rel=1e-3)
    assert 0.1 < norm < found.bound
    free = MechanicalSystem(shoulder.robot, friction=None)
    with pytest.raises(PHControlError, match="no finite L₂ gain"):
        l2_gain(make_controller("force_feedback_measured", free, **THESIS), free)


def test_a_law_that_cancels_the_force_has_no_gain(shoulder):
    for law in ("total_force_rejection", "impedance_grasping"):
        found = l2_gain(make_controller(law, shoulder), shoulder)
        assert found.passed
        assert (found.bound, found.linear_norm) == (0.0, 0.0)


def test_another_plant_is_refused(shoulder):
    """A plant with half the friction and another weight is not the one of the promise."""
    plant = MechanicalSystem(shoulder.robot, friction=shoulder.friction.scaled(0.5), gravity=[0.0, 0.0, -9.0])
    with pytest.raises(PHControlError, match="rests on the promise"):
        l2_gain(make_controller("force_feedback", shoulder), plant)


def test_a_gain_that_is_too_small_is_not_passed(shoulder, monkeypatch):
    """1/1.5 of the bound: both checks of the true loop see it. A law that overstates its damping is not certified."""
    frictionless = MechanicalSystem(shoulder.robot, friction=None)
    controller = make_controller("energy_shaping", frictionless, **THESIS)
    overstated = make_controller("energy_shaping", frictionless, **(THESIS | {"damping": 10.0 / 1.5}))
    monkeypatch.setattr(type(controller), "injected_damping", property(lambda law: 10.0 * np.eye(2)))
    with pytest.raises(PHControlError, match="damping that is not dissipated .* FAILED"):
        l2_gain(overstated, frictionless)
    monkeypatch.setattr("phcontrol.analysis.l2_gain._bound", lambda *_: (0.1 / 1.5, "injected damping"))
    found = l2_gain(controller, frictionless)
    assert not found.passed
    assert found.largest_residual > 0.1
    assert found.linear_norm == pytest.approx(0.1, rel=1e-3)


def test_damping_for_a_desired_gain(shoulder):
    controller = make_controller("force_feedback", shoulder, damping=damping_for_gain(0.05, 2))
    assert l2_gain(controller, shoulder).bound == pytest.approx(0.05)
    geared = MechanicalSystem(shoulder.robot, input_matrix=MIXED)
    desired = damping_for_gain(0.05, 2, input_matrix=MIXED)
    assert l2_gain(make_controller("force_feedback", geared, damping=desired), geared).bound == pytest.approx(0.05)
    with pytest.raises(InvalidArgumentError, match="gain: must be > 0"):
        damping_for_gain(0.0, 2)


def test_laws_without_the_theorem_are_refused(shoulder):
    with pytest.raises(InvalidArgumentError, match="is driven by"):
        l2_gain(make_controller("force_control", shoulder, feedforward=False), shoulder)


def test_runs_without_a_gain_are_refused(shoulder):
    controller = make_controller("energy_shaping", shoulder, **THESIS)
    with pytest.raises(PHControlError, match="no external force"):
        measured_l2_gain(simulate(shoulder, controller, duration=0.01, q0=HOME))
    with pytest.raises(PHControlError, match="must start at the goal at rest"):
        measured_l2_gain(simulate(shoulder, controller, duration=0.01, disturbance=[1.0, 0.0]))
