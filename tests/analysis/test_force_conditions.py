"""The epsilon of Theorem 4.1.1 against a closed form and against the certified closed loop."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    ForceControl,
    InvalidArgumentError,
    MechanicalSystem,
    StribeckFriction,
    force_control_conditions,
    load_robot,
    make_controller,
)
from tests.conftest import make_system


def gripper_law(system, coupling=1.0, force_gain=1.0):
    return ForceControl(system, force=[3.5], damping=5.0, coupling=coupling, force_gain=force_gain)


@pytest.mark.parametrize(("a", "k"), [(1.0, 1.0), (0.5, 2.0), (2.0, 0.3)])
def test_one_joint_has_a_closed_form(a, k):
    system = MechanicalSystem(load_robot("pera_gripper"), friction=StribeckFriction(viscous=0.1))
    mass = system.at(system.robot.home).mass_matrix.item()
    friction, injected = 0.1 / mass, 5.0 / mass
    # det [[D̄ + C̄ + εakD̄, aD̄ + ½ε(D̄ + C̄ + a²kD̄)], [·, a²D̄ + εaD̄]] = 0, a quadratic in ε
    corner = np.polynomial.Polynomial([friction + injected, a * k * friction])
    side = np.polynomial.Polynomial([a * friction, 0.5 * (friction + injected + a**2 * k * friction)])
    end = np.polynomial.Polynomial([a**2 * friction, a * friction])
    expected = min(root.real for root in (corner * end - side**2).roots() if root.real > 0.0)
    conditions = force_control_conditions(gripper_law(system, a, k), system, samples=3)
    assert conditions.decreasing == pytest.approx(expected, rel=1e-9)
    assert conditions.positive == pytest.approx(1.0 / np.sqrt(k))


def test_the_printed_conditions_do_not_suffice():
    """With the thesis's gains and its damping of 0.1 they allow every ε below 1; from 0.3 on H_ε grows."""
    system = MechanicalSystem(load_robot("pera_gripper"))
    conditions = force_control_conditions(gripper_law(system), system)
    assert min(conditions.printed) > 0.9
    assert 0.0 < conditions.largest < 0.35


@pytest.mark.parametrize("interconnection", ["coriolis", "canonical"])
@pytest.mark.parametrize("robot", ["pera_shoulder", "pera"])
def test_the_bound_is_that_of_the_certified_closed_loop(robot, interconnection):
    system, samples, speed = make_system(robot), 20, 0.7
    law = make_controller("force_control", system, interconnection=interconnection)
    low, high = system.robot.lower * 0.5, system.robot.upper * 0.5
    found = force_control_conditions(law, system, lower=low, upper=high, speed=speed, samples=samples, seed=3)
    generator, n = np.random.default_rng(3), system.n
    states = [system.at(generator.uniform(low, high), generator.uniform(-speed, speed, n)) for _ in range(samples)]

    def greatest_rate(epsilon):
        """Return the greatest of Ḣ_ε over |(p̂, w)| = 1, by the target's own matrices."""
        worst = -np.inf
        for x in states:
            target = law.target(0.0, x, np.zeros(n))
            flow = (target.interconnection - target.dissipation)[n:, n:]
            inverse = np.linalg.inv(law.force_gain)
            flow = flow @ np.block([[np.eye(n), np.zeros((n, n))], [np.zeros((n, n)), inverse]])
            form = np.block([[np.eye(n), epsilon * np.eye(n)], [epsilon * np.eye(n), inverse]]) @ flow
            worst = max(worst, np.linalg.eigvalsh(form + form.T)[-1])
        return worst

    assert greatest_rate(0.999 * found.decreasing) < 0.0 < greatest_rate(1.001 * found.decreasing)


def test_without_friction_there_is_no_epsilon():
    system = MechanicalSystem(load_robot("pera_shoulder"), friction=None)
    conditions = force_control_conditions(make_controller("force_control", system), system, samples=5)
    assert conditions.decreasing == 0.0
    assert not conditions.passed


def test_bad_input_is_refused():
    system = make_system("pera_shoulder")
    law = make_controller("force_control", system)
    with pytest.raises(InvalidArgumentError, match="ForceControl"):
        force_control_conditions(make_controller("energy_shaping", system), system)
    with pytest.raises(InvalidArgumentError, match="above"):
        force_control_conditions(law, system, lower=[1.0, 1.0], upper=[0.0, 0.0])
    with pytest.raises(InvalidArgumentError, match="speed"):
        force_control_conditions(law, system, speed=0.0)
