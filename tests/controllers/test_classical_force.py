"""The classical force law: its certificate, its rest, and the closed form of its stability."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    ClassicalForceControl,
    InvalidArgumentError,
    JointContact,
    Measured,
    MechanicalSystem,
    RigidBody,
    StribeckFriction,
    certify,
    simulate,
)
from tests.conftest import make_system
from tests.finite_differences import gradient


@pytest.mark.parametrize("interconnection", ["coriolis", "canonical"])
@pytest.mark.parametrize("arm", ["pera_gripper", "pera_shoulder_elbow"])
def test_it_is_what_it_promises_but_driven(arm, interconnection):
    system = make_system(arm)
    law = ClassicalForceControl.tuned(system, force=np.full(system.n, 0.7), interconnection=interconnection)
    assert certify(law, samples=96).verdict == "PASSED AS DRIVEN"


def test_a_wrong_sign_of_its_integral_has_no_certificate():
    class Reversed(ClassicalForceControl):
        def shape(self, t, x, state, measured):
            command = super().shape(t, x, state, measured)
            return command._replace(state_rate=-command.state_rate)

    system = make_system("pera_gripper")
    certificate = certify(Reversed(system, force=[0.7], damping=1.0, integral_rate=0.5), samples=64)
    assert certificate.verdict == "FAILED"
    assert not certificate.matching_passed


@pytest.mark.parametrize(("share", "stable"), [(0.97, True), (1.03, False)])
@pytest.mark.parametrize("stiffness", [5.0, 500.0])
def test_one_joint_on_a_spring_is_stable_below_c_over_m(share, stable, stiffness):
    system = MechanicalSystem(make_system("pera_gripper").robot, friction=None)
    mass = system.at([0.3]).mass_matrix[0, 0]
    law = ClassicalForceControl(system, force=[0.4], damping=2.0, integral_rate=share * 2.0 / mass)

    def rate(y):
        x, force = system.at(y[:1], y[1:2]), -stiffness * (y[:1] - 0.2)
        command = law.evaluate(0.0, x, y[2:], Measured(external_force=force))
        return np.concatenate([y[1:2], x.acceleration(command.torque, force), command.state_rate])

    slope = gradient(rate, np.array([0.2 - 0.4 / stiffness, 0.0, 0.0])).T
    assert bool(np.linalg.eigvals(slope).real.max() < 0.0) is stable
    # m s³ + C s² + k s + K_I k
    roots = np.roots([mass, 2.0, stiffness, law.integral_rate[0, 0] * stiffness])
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(slope)), np.sort_complex(roots), rtol=1e-5, atol=1e-5)


def test_the_gripper_presses_with_the_desired_force():
    system = MechanicalSystem(make_system("pera_gripper").robot, friction=StribeckFriction(viscous=0.1))
    law = ClassicalForceControl(system, force=[3.5], damping=5.0, integral_rate=2.0)
    ball = RigidBody(JointContact("gripper", 0.2), stiffness=20.0, damping=0.5)
    log = simulate(system, law, duration=6.0, dt=1e-3, q0=[0.21], bodies=[ball])
    assert log.external_force[-1, 0] == pytest.approx(3.5, rel=1e-3)


def test_bad_input_is_refused():
    system = make_system("pera_shoulder")
    with pytest.raises(InvalidArgumentError, match="force: must have shape"):
        ClassicalForceControl(system, force=[1.0], damping=1.0, integral_rate=1.0)
    with pytest.raises(InvalidArgumentError, match="integral_rate"):
        ClassicalForceControl(system, force=[1.0, 0.0], damping=1.0, integral_rate=-1.0)
