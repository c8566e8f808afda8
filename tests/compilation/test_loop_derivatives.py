"""Exact derivatives of closed loops against differences of the interpreted loop, and against formulas by hand."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import (
    CompilationError,
    InvalidArgumentError,
    LoopDerivatives,
    MechanicalSystem,
    PHControlError,
    StribeckFriction,
    UnknownNameError,
    linearize,
    make_controller,
)
from phcontrol.controllers.energy_shaping import EnergyShaping
from tests.conftest import make_system
from tests.controllers.arms import chain

CASES = [
    ("pera", "force_feedback_measured", "coriolis"),  # Stribeck friction, measured forces
    ("panda", "total_force_rejection", "coriolis"),  # the total force is measured
    ("panda_with_fingers", "energy_shaping", "coriolis"),  # a mimic joint, prismatic ones
    ("kinova", "integral_action", "coriolis"),  # continuous joints
    ("pera_shoulder", "tracking", "canonical"),
    ("panda", "hamiltonian_servo", "coriolis"),  # looks at a scene
]


def richardson(function, point, step=2e-3):
    """Return ∂f/∂x by central differences, extrapolated twice: an error of the order of step⁶."""
    columns = []
    for axis in np.eye(len(point)):
        first, second, third = (
            (function(point + h * axis) - function(point - h * axis)) / (2.0 * h) for h in (step, step / 2, step / 4)
        )
        better, best = (4.0 * second - first) / 3.0, (4.0 * third - second) / 3.0
        columns.append((16.0 * best - better) / 15.0)
    return np.stack(columns, axis=-1)


def off(found, expected):
    """Return the largest difference, each row relative to its largest entry."""
    size = np.abs(expected).max(axis=1, keepdims=True)
    return float((np.abs(found - expected) / np.maximum(size, 1e-3 * max(1.0, size.max()))).max())


def at_random(name, law_name, form, rng):
    system = make_system(name)
    law = make_controller(law_name, system, interconnection=form)
    rest = law.rest_posture(0.0)
    scene = law.rest_scene(system.at(rest))
    q, v = rest + 0.05 * rng.normal(size=system.n), 0.3 * rng.normal(size=system.n)
    force = rng.normal(size=system.n)
    return system, law, scene, (0.3, q, v, law.random_state(rng), force)


@pytest.mark.parametrize(("name", "law_name", "form"), CASES)
def test_derivatives_are_those_of_the_interpreted_loop(name, law_name, form, rng):
    system, law, scene, (t, q, v, z, force) = at_random(name, law_name, form, rng)
    derivatives = LoopDerivatives(law, system, scene)
    found = derivatives.at(t, q, v, z, force)
    y = np.concatenate([q, v, z])
    assert off(found.state, richardson(lambda there: derivatives.rate(t, there, force), y)) < 1e-7
    assert off(found.force, richardson(lambda there: derivatives.rate(t, y, there), force)) < 1e-7
    by_time = richardson(lambda there: derivatives.rate(float(there[0]), y, force), np.array([t]))
    assert np.abs(found.time - by_time[:, 0]).max() < 1e-7 * max(1.0, np.abs(by_time).max())


def test_a_wrong_derivative_is_seen(rng):
    """What the comparison above says of one that is off by 1e-6."""
    system, law, scene, (t, q, v, z, force) = at_random("panda", "force_feedback", "coriolis", rng)
    derivatives = LoopDerivatives(law, system, scene)
    y = np.concatenate([q, v, z])
    expected = richardson(lambda there: derivatives.rate(t, there, force), y)
    assert off((1.0 + 1e-6) * derivatives.at(t, q, v, z, force).state, expected) > 5e-7


def test_the_derivative_with_respect_to_gains_is_that_of_a_law_with_others(rng):
    system, law, _, (t, q, v, z, force) = at_random("panda", "integral_action", "coriolis", rng)
    derivatives = LoopDerivatives(law, system)
    found, y = derivatives.at(t, q, v, z, force, parameters=True), np.concatenate([q, v, z])
    for gain in ("stiffness", "damping", "integral_gain", "goal"):
        value = getattr(law, gain)
        slope = found.numbers @ derivatives.number_slope(gain)

        def rate(share, gain=gain, value=value):
            other = law.changed(**{gain: value * (1.0 + share[0])})
            return LoopDerivatives(other, system).rate(t, y, force)

        expected = richardson(rate, np.zeros(1))[:, 0]
        assert np.abs(expected).max() > 0.1
        assert np.abs(slope - expected).max() < 1e-7 * np.abs(expected).max()


def test_the_derivative_with_respect_to_inertias_is_that_of_another_plant(rng):
    system, law, _, (t, q, v, z, force) = at_random("panda", "total_force_rejection", "coriolis", rng)
    found = LoopDerivatives(law, system).at(t, q, v, z, force, parameters=True)
    y, joint = np.concatenate([q, v, z]), 5  # of the model, counted from 1

    def rate(change):
        other = system.twin()
        body = other.model.inertias[joint]
        a, b, c, d, e, f = change[4:]
        moments = body.inertia + np.array([[a, b, c], [b, d, e], [c, e, f]])
        other.model.inertias[joint] = pin.Inertia(body.mass + change[0], body.lever + change[1:4], moments)
        other.data = other.model.createData()
        return LoopDerivatives(law, other).rate(t, y, force)

    expected = richardson(rate, np.zeros(10), step=1e-3)
    columns = slice(10 * (joint - 1), 10 * joint)
    assert off(found.inertias[:, columns], expected) < 1e-7


def test_one_joint_by_hand():
    """M = I + m l², V = m g l cos q: everything about a pendulum that stands on its end, under another model of it."""
    model = chain(1)
    plant = model.twin()
    body = plant.model.inertias[1]
    m, own, g, K, C, goal = 1.5, 0.002, 9.81, 30.0, 4.0, 0.4
    plant.model.inertias[1] = pin.Inertia(m, body.lever, body.inertia)
    plant.data = plant.model.createData()
    length, known = 0.05, 1.0
    M = own + m * length**2
    q, v, f = 0.9, -0.7, 0.3
    law = EnergyShaping(model, goal=[goal], stiffness=K, damping=C)
    derivatives = LoopDerivatives(law, plant)
    found = derivatives.at(0.0, [q], [v], None, [f], parameters=True)
    weight = (m - known) * g * length * np.cos(q)
    np.testing.assert_allclose(found.state, [[0.0, 1.0], [(weight - K) / M, -C / M]], rtol=1e-13)
    np.testing.assert_allclose(found.force, [[0.0], [1.0 / M]], rtol=1e-13)
    np.testing.assert_allclose(found.time, [0.0, 0.0])
    a = (-K * (q - goal) - C * v + f + (m - known) * g * length * np.sin(q)) / M
    np.testing.assert_allclose(derivatives.rate(0.0, np.array([q, v]), np.array([f])), [v, a], rtol=1e-13)
    np.testing.assert_allclose(found.inertias[1, 0], (g * length * np.sin(q) - length**2 * a) / M, rtol=1e-12)
    np.testing.assert_allclose(found.numbers @ derivatives.number_slope("stiffness", 1.0), [0.0, -(q - goal) / M])
    np.testing.assert_allclose(found.numbers @ derivatives.number_slope("damping", 1.0), [0.0, -v / M])
    np.testing.assert_allclose(found.numbers @ derivatives.number_slope("goal", 1.0), [0.0, K / M])


def test_each_branch_has_its_own_derivative(rng):
    """Before, along and after a minimum-jerk reference: the guards say which of them holds."""
    from phcontrol import MinimumJerk

    system = make_system("pera_shoulder")
    reference = MinimumJerk([0.0, 0.4], [0.5, 0.9], 2.0)
    law = make_controller("energy_shaping", system, reference=reference)
    derivatives = LoopDerivatives(law, system)
    q, v, nothing = np.array([0.2, 0.6]), np.array([0.3, -0.1]), np.zeros(2)
    slopes = []
    for t in (-0.5, 1.0, 2.5, 1.1):
        slopes.append(derivatives.at(t, q, v).time)
        expected = richardson(
            lambda there: derivatives.rate(float(there[0]), np.concatenate([q, v]), nothing), np.array([t])
        )
        np.testing.assert_allclose(slopes[-1], expected[:, 0], rtol=1e-7, atol=1e-9)
    assert np.abs(slopes[1]).max() > 1.0
    assert not slopes[0].any()
    assert not slopes[2].any()


class Kinked(EnergyShaping):
    """Energy shaping whose effort bends at the goal."""

    name = "kinked"

    def shape(self, t, x, state, measured):
        from phcontrol.controllers.shaping import Shaping

        away = x.position - self.goal
        return Shaping(effort=-self.stiffness @ np.abs(away) - self.damping @ x.velocity)


def test_where_there_is_no_derivative_it_is_refused():
    system = make_system("pera_shoulder")
    law = Kinked(system, goal=[0.2, 0.5], stiffness=10.0, damping=2.0)
    assert LoopDerivatives(law).at(0.0, [0.3, 0.7]).state.shape == (4, 4)
    with pytest.raises(CompilationError, match="has no derivative there"):
        LoopDerivatives(law).at(0.0, [0.2, 0.5])
    for exact in (None, False):  # central differences of an even bend see a slope of 0
        with pytest.raises(PHControlError, match="has no derivative there"):
            linearize(law, system, at=[0.2, 0.5], exact=exact)


def test_what_is_asked_for_is_checked():
    system = make_system("pera_shoulder")
    law = make_controller("force_feedback", system)
    derivatives = LoopDerivatives(law)
    with pytest.raises(InvalidArgumentError, match="position"):
        derivatives.at(0.0, [0.1])
    with pytest.raises(InvalidArgumentError, match="state"):
        derivatives.at(0.0, [0.1, 0.2], None, [0.0])
    with pytest.raises(UnknownNameError, match="stifness"):
        derivatives.number_slope("stifness")


def test_friction_of_every_kind_is_followed(rng):
    robot = make_system("pera").robot
    friction = StribeckFriction(viscous=0.4, coulomb=0.3, static=0.5, stribeck_velocity=0.1)
    plant = MechanicalSystem(robot, friction=friction)
    law = make_controller("force_feedback", make_system("pera"))  # with another friction in its model
    derivatives = LoopDerivatives(law, plant)
    y = np.concatenate([law.rest_posture(0.0), 0.2 * rng.normal(size=7), np.zeros(7)])
    found = derivatives.at(0.0, y[:7], y[7:14], y[14:])
    expected = richardson(lambda there: derivatives.rate(0.0, there, np.zeros(7)), y, step=5e-4)
    assert off(found.state, expected) < 1e-7
