"""Friction between a fingertip and a surface: Coulomb's law, its power, and where it acts."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    CartesianImpedance,
    CompliantBody,
    InvalidArgumentError,
    JointContact,
    MechanicalSystem,
    Pose,
    RigidBody,
    SphereContact,
    Wrench,
    simulate,
)
from phcontrol.environments.contact_friction import ContactFriction
from tests.controllers.arms import arm
from tests.finite_differences import derivative


def touching(system, x, tilt=None, kind=RigidBody, **options):
    """Return a plane that a fingertip of 2 cm sinks 1 mm into."""
    turn = np.eye(3) if tilt is None else tilt
    tip = x.placement(system.hand_frame).translation
    contact = SphereContact(system.hand_frame, 0.02, "plane", position=tip - 0.019 * turn[:, 2], rotation=turn)
    return kind(contact, **options)


def tilted():
    a, b = 0.4, -0.3
    about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    return about_x @ about_y


def test_it_is_coulombs_law_for_fast_sliding():
    force, power = ContactFriction(0.4, 1e-3).force(10.0, np.array([0.3, -0.4, 0.0]))
    np.testing.assert_allclose(force, [-2.4, 3.2, 0.0], rtol=1e-5)
    assert power == pytest.approx(4.0 * 0.5, rel=1e-5)
    assert ContactFriction(0.4, 1e-3).force(10.0, np.zeros(3))[1] == 0.0
    half = ContactFriction(0.4, 1e-3).force(10.0, np.array([1e-3, 0.0, 0.0]))[0]
    assert half[0] == pytest.approx(-4.0 / np.sqrt(2.0))


def test_slip_is_the_velocity_of_the_touching_point(rng):
    """The point of the sphere below its centre, as a point of the hand, moved; its part along the plane."""
    system, turn = arm("panda"), tilted()
    x = system.at(system.robot.near_home(), rng.normal(size=7))
    body = touching(system, x, turn, friction=0.4)
    normal = turn[:, 2]
    hand = x.placement(system.hand_frame)
    at = hand.rotation.T @ (-0.02 * normal)  # the touching point, fixed in the hand

    def point(step):
        moved = system.at(x.position + step * x.velocity).placement(system.hand_frame)
        return moved.translation + moved.rotation @ at

    velocity = derivative(point)
    expected = velocity - normal * (normal @ velocity)
    np.testing.assert_allclose(body.geometry.slip(x) @ x.velocity, expected, atol=1e-8)


def compliant(contact, **options):
    return CompliantBody(contact, stiffness=5e3, damping=50.0, mass=0.5, **options)


@pytest.mark.parametrize("kind", [RigidBody, compliant])
def test_it_never_gives_energy_and_opposes_what_slides(kind, rng):
    system, turn = arm("panda"), tilted()
    x0 = system.at(system.robot.near_home())
    smooth, rough = touching(system, x0, turn, kind), touching(system, x0, turn, kind, friction=0.4)
    state = smooth.initial_state()
    for _ in range(100):
        x = system.at(x0.position, rng.normal(size=7) * 10.0 ** rng.uniform(-6, 1))
        without, with_ = smooth.touch(x, state), rough.touch(x, state)
        taken = float((without.force - with_.force) @ x.velocity)
        assert taken >= 0.0
        assert with_.dissipated - without.dissipated == pytest.approx(taken, rel=1e-6, abs=1e-15)
        assert with_.magnitude == without.magnitude


@pytest.mark.parametrize("kind", ["rigid", "compliant"])
def test_the_power_of_arm_and_table_balances(kind):
    """Pushed aside while it presses the hand slides, and what friction takes is in the balance."""
    system = MechanicalSystem(arm("panda").robot, friction=None)
    start = system.robot.near_home()
    hand = system.at(start).placement(system.hand_frame)
    goal = Pose(np.array(hand.translation), np.array(hand.rotation))
    plane = SphereContact(system.hand_frame, 0.01, "plane", position=hand.translation - [0.0, 0.0, 0.0101])
    rough = {"friction": 0.4, "slip_speed": 0.01}
    table = (
        RigidBody(plane, stiffness=1e4, damping=100.0, **rough)
        if kind == "rigid"
        else CompliantBody(plane, stiffness=5e3, damping=50.0, mass=0.5, **rough)
    )
    law = CartesianImpedance(
        system, goal=goal, translational_stiffness=200.0, rotational_stiffness=20.0, wrench=[0, 0, -10.0, 0, 0, 0],
        preferred_posture=start,
    )  # fmt: skip
    push = Wrench(system.hand_frame, [12.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    log = simulate(system, law, q0=start, duration=0.6, dt=2.5e-4, bodies=[table], disturbance=push)
    moved = log.frame(system.hand_frame).position
    assert moved[-1, 0] - moved[0, 0] > 0.01
    assert np.sum(log.contact_power) * 2.5e-4 > 0.03
    assert log.power_balance("all").energy_drift < 1e-4


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RigidBody(JointContact("elbow", 0.1), friction=0.4), "surface to slide on"),
        (lambda: RigidBody(SphereContact("tool", 0.01, "plane"), friction=-0.1), "friction"),
        (lambda: RigidBody(SphereContact("tool", 0.01, "plane"), slip_speed=0.0), "slip_speed"),
    ],
)
def test_bad_input_is_refused(make, message):
    with pytest.raises(InvalidArgumentError, match=message):
        make()
