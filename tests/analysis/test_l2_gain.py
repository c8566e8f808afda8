"""The L₂ bound against simulated disturbances and the H∞ norm of the linearised loop."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import InvalidArgumentError, MechanicalSystem, PHControlError, make_controller, simulate
from phcontrol.analysis.l2_gain import damping_for_gain, l2_gain, measured_l2_gain
from phcontrol.environments.disturbances import Pulse, Sine, Step
from tests.conftest import make_system

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


@pytest.mark.parametrize("arm", ["pera", "panda", "ur5"])
def test_the_inequality_holds_at_random_states(arm):
    system = make_system(arm)
    for law in ("energy_shaping", "force_feedback", "integral_action"):
        assert l2_gain(make_controller(law, system), system).passed


def test_the_inequality_fails_for_a_smaller_gain(shoulder):
    """λ_min(C)/1.5 in place of λ_min(C): the check is able to fail."""
    frictionless = MechanicalSystem(shoulder.robot, friction=None)
    controller = make_controller("energy_shaping", frictionless, **(THESIS | {"damping": 10.0 / 1.5}))
    wrong = make_controller("energy_shaping", frictionless, **THESIS)
    for part in ("target", "evaluate", "passive_port", "shape"):  # says C = 10, has and promises C = 6.7
        setattr(wrong, part, getattr(controller, part))
    assert not l2_gain(wrong, frictionless).passed


def test_damping_for_a_wished_gain(shoulder):
    controller = make_controller("force_feedback", shoulder, damping=damping_for_gain(0.05, 2))
    assert l2_gain(controller, shoulder).bound == pytest.approx(0.05)
    with pytest.raises(InvalidArgumentError, match="gain: must be > 0"):
        damping_for_gain(0.0, 2)


def test_laws_without_the_theorem_are_refused(shoulder):
    for law in ("force_feedback_measured", "total_force_rejection"):
        with pytest.raises(InvalidArgumentError, match="the theorem is for modeled forces"):
            l2_gain(make_controller(law, shoulder), shoulder)
    geared = MechanicalSystem(shoulder.robot, input_matrix=2.0)
    with pytest.raises(InvalidArgumentError, match="the bound is for G = I"):
        l2_gain(make_controller("energy_shaping", geared), geared)


def test_runs_without_a_gain_are_refused(shoulder):
    controller = make_controller("energy_shaping", shoulder, **THESIS)
    with pytest.raises(PHControlError, match="no external force"):
        measured_l2_gain(simulate(shoulder, controller, duration=0.01, q0=HOME))
    with pytest.raises(PHControlError, match="must start at the goal at rest"):
        measured_l2_gain(simulate(shoulder, controller, duration=0.01, disturbance=[1.0, 0.0]))
