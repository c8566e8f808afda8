"""Force regulation that an energy tank pays for: passive where it was driven."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    ClassicalImpedance,
    EnergyTank,
    ExternalAction,
    ForceRegulation,
    ImpedanceGrasping,
    JointContact,
    Measured,
    MechanicalSystem,
    RigidBody,
    certify,
    load_robot,
    simulate,
    with_tank,
)
from phcontrol.controllers.tanked_regulation import TankedRegulation

LAWS = [ImpedanceGrasping, ClassicalImpedance]


@pytest.fixture(scope="module")
def shoulder():
    return MechanicalSystem(load_robot("pera_shoulder"))


def regulated(law, system, force=0.3, **options):
    return law.tuned(system, regulation=ForceRegulation(np.full(system.n, force)), **options)


@pytest.mark.parametrize("form", ["coriolis", "canonical"])
@pytest.mark.parametrize("law", LAWS)
def test_regulation_with_a_tank_is_passive(shoulder, law, form):
    """Not "AS DRIVEN": what drives the law without a tank comes out of it."""
    assert certify(regulated(law, shoulder), samples=64).verdict == "PASSED AS DRIVEN"
    certificate = certify(regulated(with_tank(law), shoulder, interconnection=form), samples=64)
    assert certificate.verdict == "PASSED", str(certificate)
    assert certificate.matching_residual < 1e-7
    assert certificate.driven_by == ""
    assert certificate.caveat == "its tank starts with 2 J, which may reach the arm"
    assert certificate["drive that is not declared"].value < 1e-14


@pytest.mark.parametrize("law", LAWS)
def test_what_drives_it_comes_out_of_the_tank(shoulder, law):
    plain, paid = regulated(law, shoulder), regulated(with_tank(law), shoulder)
    assert plain.driven_by != "" == paid.driven_by
    assert with_tank(law).tuned(shoulder).driven_by == law.tuned(shoulder).driven_by


@pytest.mark.parametrize("law", LAWS)
def test_a_tank_pays_for_regulation_and_action_at_once(shoulder, law):
    made = regulated(with_tank(law), shoulder, actions=ExternalAction(lambda t, x: 0.3 * x.velocity))
    certificate = certify(made, samples=64)
    assert certificate.verdict == "PASSED", str(certificate)


@pytest.mark.parametrize("law", LAWS)
def test_with_a_full_tank_it_moves_as_without_one(shoulder, law, rng):
    x = shoulder.at(0.2 * rng.normal(size=2), rng.normal(size=2))
    plain, paid = regulated(law, shoulder), regulated(with_tank(law), shoulder)
    state, measured = rng.normal(size=plain.state_size), Measured(external_force=rng.normal(size=2))
    expected = plain.evaluate(0.0, x, state, measured)
    found = paid.evaluate(0.0, x, np.append(state, 0.0), measured)
    np.testing.assert_allclose(found.torque, expected.torque, rtol=1e-12)
    np.testing.assert_allclose(found.state_rate[:-1], expected.state_rate, rtol=1e-12)
    empty = np.append(state, paid.tank.state(paid.tank.lowest))
    assert np.abs(paid.evaluate(0.0, x, empty, measured).state_rate[-3:-1]).max() == 0.0  # q_f stands
    np.testing.assert_array_equal(paid.desired_posture(0.0, np.append(state, 0.7)), plain.desired_posture(0.0, state))


class Gift(TankedRegulation, ImpedanceGrasping):
    """Promises and does that q_f moves, and the tank gives nothing for it."""

    name = "gift"
    share = 0.0

    def _paid_rate(self, t, x, state, measured):
        rate, payment, power = super()._paid_rate(t, x, state, measured)
        return rate, payment._replace(share=self.share * payment.share), power


class WrongSign(Gift):
    """The tank is filled where it should pay."""

    name = "wrong_sign"
    share = -1.0


class Generous(Gift):
    """Nine tenths are paid for."""

    name = "generous"
    share = 0.9


class Unpaid(TankedRegulation, ImpedanceGrasping):
    """Promises that the tank pays, and it does not."""

    name = "unpaid"

    def shape(self, t, x, state, measured):
        law = super().shape(t, x, state, measured)
        law.state_rate[-1] = 0.0
        return law


class AllAtOnce(TankedRegulation, ImpedanceGrasping):
    """Moves q_f by all of r however empty the tank is, and says that the valve is closed."""

    name = "all_at_once"

    def with_faster_goal(self, law, rate):
        return super().with_faster_goal(law, np.abs(rate))


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        (Gift, "drive that is not declared"),
        (WrongSign, "drive that is not declared"),
        (Generous, "drive that is not declared"),
        (Unpaid, "matching residual"),
        (AllAtOnce, "matching residual"),
    ],
)
def test_a_tank_that_makes_energy_gets_no_certificate(shoulder, wrong, line):
    certificate = certify(regulated(wrong, shoulder), samples=64)
    assert not certificate.passed, str(certificate)
    assert not certificate[line].passed, str(certificate)


def supply(law, log, k):
    """Return what f_e brings into H_d [W]."""
    x = law.system.at(log.position[k], log.velocity[k])
    target = law.target(log.time[k], x, log.controller_state[k], log.true_measurement(k))
    return float(target.gradient @ target.port @ log.external_force[k])


@pytest.mark.parametrize("law", LAWS)
def test_pressing_takes_no_more_than_the_tank_holds(law):
    """A gripper closes on a body until it presses with 1 N·m: H_d grows by itself; with the tank it does not."""
    gripper = MechanicalSystem(load_robot("pera_gripper"))
    body = RigidBody(JointContact(gripper.robot.joint_names[0], 0.3, "below"), stiffness=200.0, damping=2.0)
    excess, pressed = {}, {}
    for made in (law, with_tank(law)):
        tuned = made.tuned(gripper, goal=[0.35], stiffness=5.0, regulation=ForceRegulation([1.0]))
        log = simulate(gripper, tuned, q0=[0.5], duration=6.0, bodies=[body], dt=2e-3)
        power = np.array([supply(tuned, log, k) for k in range(len(log))])
        supplied = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(log.time))])
        own = log.storage - supplied
        excess[made is law] = float((own - np.minimum.accumulate(own)).max())
        pressed[made is law] = float(log.external_force[-1, 0])
    assert pressed[True] == pytest.approx(1.0, rel=3e-2)  # it still settles
    assert pressed[False] == pytest.approx(pressed[True], rel=1e-6)
    assert excess[True] > 1e-3, excess
    assert excess[False] < 1e-6, excess


def test_an_empty_tank_does_not_press(shoulder):
    """Where nothing is left and nothing comes, q_f stands: the level is never below the bound."""
    tank = EnergyTank(initial=0.03, ramp=0.2)
    free = MechanicalSystem(shoulder.robot, friction=None)
    law = regulated(with_tank(ImpedanceGrasping), free, force=40.0, tank=tank)
    log = simulate(free, law, q0=[0.0, 0.0], duration=3.0, control_period=1e-3, torque_limit=None)
    assert log.tank_level.min() >= tank.lowest * (1.0 - 1e-12)
    assert log.storage.max() <= log.storage[0] * (1.0 + 1e-3)
