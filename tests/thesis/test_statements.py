"""What the study of statements measures with, and the coupling that it runs as printed."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import JointContact, MechanicalSystem, load_robot, simulate
from phcontrol.thesis import appendix_a
from phcontrol.thesis.exact import EXACT, exact, largest_real_part, negative, off, positive, rate, slope
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.grasping_runs import make_laws
from phcontrol.thesis.printed_coupling import PrintedCoupling
from phcontrol.thesis.verdict import Verdict


def test_residuals_say_which_form_holds():
    assert exact("a", "b", "(1.1)", 1e-12).verdict is Verdict.AS_PRINTED
    assert exact("a", "b", "(1.1)", 0.1, 1e-12, "E6").verdict is Verdict.CORRECTED
    assert exact("a", "b", "(1.1)", 1e-12, already="E16").verdict is Verdict.CORRECTED
    assert exact("a", "b", "(1.1)", 0.1, 2.0 * EXACT, "E6", "why").verdict is Verdict.NOT_REPRODUCED
    for make, sign in ((positive, 1.0), (negative, -1.0)):
        assert make("a", "b", "(1.1)", [Finding((sign,))], "").verdict is Verdict.AS_PRINTED
        assert make("a", "b", "(1.1)", [Finding((-sign,))], "why").verdict is Verdict.NOT_REPRODUCED


def test_slopes_and_rates_are_derivatives():
    point = np.array([0.3, -0.7])
    np.testing.assert_allclose(slope(lambda y: np.array([y[0] * y[1], np.sin(y[1])]), point).T,
                               [[-0.7, 0.3], [0.0, np.cos(-0.7)]], atol=1e-10)  # fmt: skip
    system = MechanicalSystem(load_robot("pera_shoulder"))
    x = system.at([0.2, 0.4], [1.0, -2.0])
    moved = rate(lambda y, own: np.concatenate([y.position, y.velocity, own]), x, np.array([3.0, 4.0]),
                 np.array([5.0]), np.array([6.0]))  # fmt: skip
    np.testing.assert_allclose(moved, [1.0, -2.0, 3.0, 4.0, 6.0], atol=1e-9)
    assert off([1.0, 2.2], [1.0, 2.0]) == pytest.approx(0.1)
    A = np.array([[-1.0, 5.0], [0.0, -0.2]])
    assert largest_real_part(lambda y: A @ y, np.zeros(2)) == pytest.approx(-0.2)


def test_appendix_a_as_printed_differs_in_its_first_entry_alone():
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, 7)
    difference = appendix_a.mass_matrix(q, printed=True) - appendix_a.mass_matrix(q)
    assert abs(difference[0, 0]) > 1e-4
    difference[0, 0] = 0.0
    assert not difference.any()


def coupled(mass=0.5):
    return PrintedCoupling(JointContact("gripper", 0.2), stiffness=0.1, damping=0.1, mass=mass)


def test_the_printed_coupling_sets_each_force_equal_to_the_others_velocity():
    system, body = MechanicalSystem(load_robot("pera_gripper")), coupled()
    state, v = np.array([0.03, 0.2]), -0.7
    inside, outside = (body.touch(system.at([q], [v]), state) for q in (0.1, 0.25))
    assert inside.force == pytest.approx([-0.2 / 0.5])  # f_e = −y_c
    assert inside.state_rate == pytest.approx([0.4, v - 0.1 * 0.03 - 0.1 * 0.4])  # u_c = y_g
    assert outside.force == pytest.approx([0.0])
    assert outside.state_rate == pytest.approx([0.4, -0.1 * 0.03 - 0.1 * 0.4])


@pytest.mark.parametrize("law", ["grasping", "classical-compensated", "classical"])
def test_the_printed_coupling_holds_nothing_at_rest(law):
    """The arm goes where its law leads it, the virtual position 0, and no force is left there."""
    system = MechanicalSystem(load_robot("pera_gripper"))
    made = make_laws(system, "compliant", "R1")[law]
    log = simulate(system, made, duration=60.0, dt=5e-3, q0=[0.3], bodies=[coupled()], torque_limit=None)
    assert abs(log.position[-1, 0]) < 2e-3
    assert abs(log.contact_force[-1]) < 2e-3
    assert log.contact_force.max() > 0.05
