"""Defaults mean what the documentation says, and arguments that have names must be named."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

from phcontrol import (
    ClassicalImpedance,
    Controller,
    EnergyShaping,
    ForceControl,
    ForceRegulation,
    GripperSpring,
    Holding,
    IntegralAction,
    InvalidArgumentError,
    JointContact,
    Measured,
    MechanicalSystem,
    RigidBody,
    Schedule,
    StribeckFriction,
    check_canonical_transformation,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.controllers.dynamic_extension import DynamicExtension
from phcontrol.controllers.registry import CONTROLLERS
from phcontrol.controllers.shaping import EMPTY
from tests.finite_differences import gradient

POSITIONAL = {"self", "system", "frame", "reference", "normal", "force", "source", "transformation", "energy_change",
              "input_change", "joint", "position", "side", "geometry", "controller", "robot"}  # fmt: skip
CALLABLES = [entry.law for entry in CONTROLLERS.values()] + [
    Holding, ForceRegulation, GripperSpring, load_robot, check_canonical_transformation, MechanicalSystem, RigidBody,
    simulate, JointContact,
]  # fmt: skip


@pytest.mark.parametrize("function", CALLABLES, ids=lambda item: item.__name__)
def test_options_must_be_named(function):
    """A gain in the wrong place is an error, and nothing is positional only."""
    for name, parameter in inspect.signature(function).parameters.items():
        expected = "POSITIONAL_OR_KEYWORD" if name in POSITIONAL and name != "self" else "KEYWORD_ONLY"
        is_law = inspect.isclass(function) and issubclass(function, Controller)
        if (is_law and name != "system") or (function, name) == (Holding, "joint"):
            expected = "KEYWORD_ONLY"
        assert parameter.kind.name == expected, name


def drawn_inertia(system, posture):
    """Twice the mean of M at a posture, at home and at 48 drawn from the limits."""
    generator = np.random.default_rng(0)
    drawn = [system.robot.random_position(generator) for _ in range(48)]
    return 2.0 * np.mean([system.at(q).mass_matrix for q in (posture, system.robot.home, *drawn)], axis=0)


def test_default_gains_are_made_from_the_mean_inertia():
    system = MechanicalSystem(load_robot("pera"), friction=None)
    goal = system.robot.near_home()
    law = make_controller("energy_shaping", system, goal)
    inertia = drawn_inertia(system, goal).diagonal()
    np.testing.assert_allclose(law.stiffness, np.diag(16.0 * inertia))
    np.testing.assert_allclose(law.damping, np.diag(8.0 * inertia), atol=1e-12)  # 2 ω M_d


def test_friction_around_rest_makes_the_gains_stiffer(pera):
    goal = pera.robot.near_home()
    law, x, inertia = make_controller("energy_shaping", pera, goal), pera.at(goal), drawn_inertia(pera, goal).diagonal()
    expected = np.maximum(16.0 * inertia, 0.8 * x.damping)
    np.testing.assert_allclose(law.stiffness, np.diag(expected))
    np.testing.assert_allclose(law.damping, np.diag(2.0 * np.sqrt(expected * inertia)), atol=1e-12)
    assert (expected > 17.0 * inertia).any()


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        ("force_feedback", {"coupling": 0.5, "force_gain": 1.0}),
        ("integral_action", {"coupling": 0.5, "force_gain": 1.0, "integral_gain": 1.0}),
        ("impedance_grasping", {"stiffness": 1.0, "rest_stiffness": 1.0}),
        ("force_control", {"coupling": 1.0, "force_gain": 1.0}),
    ],
)
def test_default_gains(pera, law, expected):
    controller = make_controller(law, pera)
    for name, value in expected.items():
        np.testing.assert_array_equal(getattr(controller, name), value * np.eye(7))


def test_hogans_law_does_not_compensate_by_default(shoulder):
    law = ClassicalImpedance(shoulder, goal=[0, 0], stiffness=1.0, damping=1.0)
    assert law.needs == ()
    assert ClassicalImpedance(
        shoulder, goal=[0, 0], stiffness=1.0, damping=1.0, compensate_external_force=True
    ).needs == ("external_force",)


def test_a_regulation_is_limited_both_ways():
    regulation = ForceRegulation([1.0, 1.0, 1.0])
    np.testing.assert_allclose(regulation.rate(np.array([100.0, -100.0, 2.0])), [0.5, -0.5, 0.3])


def test_holding_has_the_stiffnesses_it_says(pera):
    reference, elbow = pera.at(pera.robot.home + 0.3), pera.robot.joint_names[3]
    holding = Holding("tool", reference, [0.0, 0.0, 3.0], joint=elbow)
    assert (holding.tangential_stiffness, holding.rotational_stiffness, holding.joint_stiffness) == (200.0, 5.0, 5.0)
    moved = pera.at(reference.position + 0.1 * np.arange(7) / 7)
    offset = moved.placement("tool").translation - reference.placement("tool").translation
    turn = reference.placement("tool").rotation.T @ moved.placement("tool").rotation
    along = 0.1 * 3 / 7
    expected = 100.0 * (offset[0] ** 2 + offset[1] ** 2) + 2.5 * (3.0 - np.trace(turn)) + 2.5 * along**2
    assert holding.energy(moved) == pytest.approx(expected, rel=1e-9)
    np.testing.assert_allclose(
        holding.gradient(moved), gradient(lambda q: holding.energy(pera.at(q)), moved.position), atol=1e-6
    )


@pytest.mark.parametrize("name", ["tangential_stiffness", "rotational_stiffness", "joint_stiffness"])
def test_holding_refuses_negative_stiffness_and_takes_none_at_all(pera, name):
    x = pera.at(pera.robot.home)
    with pytest.raises(InvalidArgumentError, match=f"{name}: must be >= 0"):
        Holding("tool", x, [1.0, 0.0, 0.0], **{name: -0.5})
    assert getattr(Holding("tool", x, [1.0, 0.0, 0.0], **{name: 0.0}), name) == 0.0


def test_without_a_joint_holding_leaves_the_joints_alone(pera):
    x = pera.at(pera.robot.home)
    holding = Holding("tool", x, [1.0, 0.0, 0.0], tangential_stiffness=0.0, rotational_stiffness=0.0)
    assert holding.energy(pera.at(pera.robot.home + 0.2)) == 0.0


def test_the_condition_on_the_integral_gain_is_sharp(shoulder):
    gains = {"goal": [0, 0], "stiffness": 1.0, "damping": 1.0, "coupling": 1.0, "force_gain": 1.0}
    IntegralAction(shoulder, integral_gain=np.diag([1e-6, 1.0]), **gains)
    for smallest in (0.0, -1e-6, -0.4):
        with pytest.raises(InvalidArgumentError, match="must be positive definite"):
            IntegralAction(shoulder, integral_gain=np.diag([smallest, 1.0]), **gains)


def test_the_approach_limit_holds_only_what_leads_and_grows(shoulder):
    """w is held at v_max when it would lead further, and let go when it would come back."""
    law = ForceControl(shoulder, force=[2.0, 0.0], damping=5.0, coupling=1.0, force_gain=1.0, approach_speed=0.2)
    x = shoulder.at([0.0, 0.0])
    leading = np.array([0.3, 0.0])
    state = x.factor.T @ leading
    back = -0.5 * state
    assert law._is_held(leading, state, state)
    assert law._is_held(leading, state, 1e-3 * state)
    assert not law._is_held(leading, state, back)
    assert not law._is_held(leading, state, 1e-3 * back)
    assert not law._is_held(0.5 * leading, state, state)
    assert law._approaches(Measured(external_force=np.zeros(2)))
    assert not law._approaches(Measured(external_force=np.array([0.0, 2e-3])))


def test_a_schedule_takes_the_interconnection_of_its_first_law(shoulder):
    gains = {"goal": [0, 0], "stiffness": 1.0, "damping": 1.0}
    first = EnergyShaping(shoulder, interconnection="canonical", **gains)
    second = EnergyShaping(shoulder, interconnection="coriolis", **gains)
    assert Schedule([(0.0, first), (1.0, second)]).interconnection == "canonical"
    assert Schedule([(0.0, second), (1.0, first)]).interconnection == "coriolis"


@pytest.mark.parametrize(
    ("base", "missing"),
    [(Controller, name) for name in ("storage", "target")] + [(DynamicExtension, "shaped")],
)
def test_a_law_must_state_everything(base, missing):
    names = {"storage", "target", "shaped"}
    body = {name: lambda self: None for name in names - {missing}}
    with pytest.raises(TypeError, match=missing):
        type("Incomplete", (base,), body)()


def test_properties_stay_properties(pera):
    """Used without a call everywhere, by users too."""
    for name in CONTROLLERS:
        law = make_controller(name, pera)
        assert isinstance(law.needs, tuple)
        assert isinstance(law.state_parts, dict)
        assert isinstance(law.state_size, int)
        assert isinstance(law.caveat, str)


def test_friction_is_viscous_alone_by_default():
    friction = StribeckFriction(viscous=[0.5, 1.0])
    np.testing.assert_allclose(friction.coefficients(np.array([0.0, 2.0])), [0.5, 1.0])


def test_the_law_is_asked_with_what_was_measured(shoulder):
    law = make_controller("force_feedback_measured", shoulder)
    x, state = shoulder.at([0.1, 0.2], [0.3, -0.1]), np.array([0.1, 0.2])
    quiet = law.evaluate(0.0, x, state, Measured(np.zeros(2))).state_rate
    pushed = law.evaluate(0.0, x, state, Measured(np.array([1.0, 0.0]))).state_rate
    np.testing.assert_allclose(pushed - quiet, (law.coupling @ law.force_gain).T @ x.solve_factor(np.array([1.0, 0.0])))


def test_the_shared_empty_state_rate_is_read_only():
    assert not EMPTY.flags.writeable
