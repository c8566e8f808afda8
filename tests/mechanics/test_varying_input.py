"""An input matrix that depends on q, as (2.2) has it: in the plant, in every law, refused where it must be constant."""

from __future__ import annotations

import numpy as np
import pytest

import phcontrol as ph
from phcontrol import InvalidArgumentError, MechanicalSystem, certify, load_robot, make_controller, simulate
from phcontrol.analysis.l2_gain import l2_gain
from phcontrol.controllers.registry import CONTROLLERS
from phcontrol.mechanics.transformations import check_canonical_transformation
from phcontrol.simulation.plant_record import plant_record

CLOSE = {"rtol": 1e-12, "atol": 1e-12}


def crank(q):
    """Return the G(q) of an arm whose second joint is driven by a crank, and whose third by a tendon over both."""
    return np.array(
        [[1.0, 0.3 * np.sin(q[1]), 0.0], [0.0, 0.8 + 0.3 * np.cos(q[1]), 0.2], [0.1 * np.sin(q[0] - q[2]), 0.0, 1.2]]
    )


@pytest.fixture(scope="module")
def system():
    return MechanicalSystem(load_robot("pera_shoulder_elbow"), input_matrix=crank)


def states(system, count=5):
    draw = np.random.default_rng(3)
    return [system.at(*draw.normal(size=(2, system.n))) for _ in range(count)]


def test_motors_act_on_the_joints_through_it(system):
    plain, draw = MechanicalSystem(system.robot), np.random.default_rng(4)
    for x in states(system):
        torque, G, y = draw.normal(size=3), crank(x.position), plain.at(x.position, x.velocity)
        np.testing.assert_allclose(x.acceleration(torque), y.acceleration(G @ torque), **CLOSE)
        np.testing.assert_allclose(x.momentum_rate(torque), y.momentum_rate(G @ torque), **CLOSE)
        np.testing.assert_allclose(x.output, G.T @ x.velocity, **CLOSE)
        np.testing.assert_allclose(G @ x.motor_torque(torque), torque, **CLOSE)
        np.testing.assert_allclose(x.transformed_input, np.linalg.solve(x.factor, G), **CLOSE)
        np.testing.assert_allclose(x.injected_damping(np.diag(torque), y.velocity), G @ (torque * x.output), **CLOSE)


@pytest.mark.parametrize("law", CONTROLLERS)
def test_every_law_keeps_its_promise_with_it(system, law):
    """The certificate's rates are finite differences along the true motion, on which G(q) turns."""
    for form in CONTROLLERS[law].law.forms:
        try:
            controller = make_controller(law, system, interconnection=form)
        except InvalidArgumentError as error:
            if "input_matrix" in str(error):
                raise
            continue  # not for this arm, whatever its motors
        found = certify(controller, system, samples=20)
        assert found.passed, found


@pytest.mark.parametrize(
    "law", ["energy_shaping", "force_feedback", "impedance_grasping", "tracking", "total_force_rejection"]
)
def test_a_law_that_takes_it_for_constant_fails(system, law):
    frozen = MechanicalSystem(system.robot, input_matrix=crank(system.robot.home))
    assert not certify(make_controller(law, frozen), system, samples=20).passed


def test_a_tank_pays_through_it(system):
    stir = ph.ExternalAction(lambda t, x: 0.3 * np.cos(x.position))
    assert certify(ph.with_tank(ph.ForceFeedback).tuned(system, actions=stir), samples=20).passed


def test_a_run_keeps_its_power_balance(system):
    """To the error of its integrator, which falls with the step."""
    law = make_controller("force_feedback", system)
    left = []
    for dt in (2e-3, 1e-3):
        log = simulate(system, law, duration=0.3, dt=dt, q0=[0.3, 0.2, -0.4], torque_limit=None)
        assert log.storage[-1] < log.storage[0]
        left.append(log.power_balance().relative_residual)
    assert left[1] < 1e-5
    assert left[1] < left[0] / 3.0


def test_energy_shaping_is_a_canonical_transformation_with_it(system):
    """Theorem 2.2.1 with G(q): U = ½q̃ᵀK_p q̃ − V and G(q)β = ∂U/∂q."""
    goal, K = np.array([0.2, 0.1, -0.3]), np.diag([10.0, 8.0, 6.0])

    def energy(q, p, t):
        return 0.5 * (q - goal) @ K @ (q - goal) - system.at(q).potential_energy

    def change(q, p, t, G=crank):
        return np.linalg.solve(G(q), K @ (q - goal) - system.at(q).potential_gradient)

    def coordinates(q, p, t):
        return np.concatenate([q - goal, system.at(q).solve_factor(p)])

    def residual(beta):
        return check_canonical_transformation(coordinates, energy, beta, system, samples=5).residual

    assert residual(change) < 1e-6
    assert residual(lambda q, p, t: change(q, p, t, lambda _: crank(system.robot.home))) > 1e-2


def test_the_gain_is_found_without_a_damping_that_is_the_same_everywhere(system):
    law = make_controller("energy_shaping", system)
    found = l2_gain(law, system, samples=20)
    least = min(
        np.linalg.eigvalsh(crank(q) @ law.damping @ crank(q).T)[0]
        for q in np.random.default_rng(0).normal(size=(50, 3))
    )
    assert found.bound > 0.0
    assert found.bound == pytest.approx(1.0 / least, rel=0.5)


@pytest.mark.parametrize(
    "make",
    [
        lambda system: ph.TorqueFilter(system, period=1e-3),
        lambda system: ph.Limits(system),
        lambda system: ph.MomentumObserver(system),
        lambda system: ph.ControlLoop(system, make_controller("energy_shaping", system), 1e-3),
        lambda system: system.input_matrix,
        lambda system: system.motor_torque(np.zeros(3)),
    ],
)
def test_what_needs_a_constant_one_refuses(system, make):
    with pytest.raises(InvalidArgumentError, match="input_matrix: depends on q"):
        make(system)


def test_it_is_not_compiled(system):
    with pytest.raises(ph.NotTraceableError, match="energy_shaping cannot be compiled"):
        ph.compile_law(make_controller("energy_shaping", system))


def test_a_log_says_that_it_cannot_describe_it(system):
    assert plant_record(system)["unknown"] == ["an input matrix that depends on q"]


@pytest.mark.parametrize(
    ("function", "problem"),
    [
        (lambda q: np.eye(2), "3 × 3 finite numbers"),
        (lambda q: np.full((3, 3), np.nan), "3 × 3 finite numbers"),
        (lambda q: np.ones((3, 3)), "must be invertible"),
    ],
)
def test_functions_that_give_none_are_refused(function, problem):
    with pytest.raises(InvalidArgumentError, match=f"input_matrix: .*{problem}"):
        MechanicalSystem(load_robot("pera_shoulder_elbow"), input_matrix=function)


def test_where_it_is_singular_there_is_an_error_and_no_torque():
    system = MechanicalSystem(load_robot("pera_shoulder"), input_matrix=lambda q: np.diag([1.0, np.cos(q[1])]))
    law = make_controller("energy_shaping", system)
    assert np.isfinite(law.evaluate(0.0, system.at([0.0, 0.3]), np.zeros(0)).torque).all()
    with pytest.raises(InvalidArgumentError, match="must be invertible, but is not at"):
        law.evaluate(0.0, system.at([0.0, np.pi / 2]), np.zeros(0))


def test_functions_cannot_write_to_the_position():
    def careless(q):
        q[0] = 0.0
        return np.eye(2)

    with pytest.raises(ValueError, match="read-only"):
        MechanicalSystem(load_robot("pera_shoulder"), input_matrix=careless)
