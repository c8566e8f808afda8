"""Poles are where the specification puts them: in the spectrum of the true loop, and in what it does."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh

from phcontrol import (
    DesiredBandwidth,
    InvalidArgumentError,
    MechanicalSystem,
    PHControlError,
    UnknownNameError,
    design_gains,
    linearize,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.poles.force_feedback_poles import ForceFeedbackPoles
from phcontrol.poles.integral_action_poles import IntegralActionPoles
from phcontrol.poles.second_order_poles import SecondOrderPoles
from tests.controllers.arms import chain

FINGERS = ["panda_finger_joint1", "panda_finger_joint2"]
ORDERS = {"energy_shaping": 2, "force_feedback": 3, "integral_action": 4}
"""Laws of the joints, and how many poles each direction has."""


def arm(name: str, friction="robot") -> MechanicalSystem:
    return MechanicalSystem(load_robot(name, locked_joints=FINGERS if name == "panda" else []), friction=friction)


ARMS = [("panda", "robot"), ("ur5", "robot"), ("pera", None)]


def poles_in(samples, step, order):
    """Return the exponents of a sum of ``order`` exponentials by linear prediction (G. R. de Prony, 1795)."""
    rows = np.column_stack([samples[k : len(samples) - order + k] for k in range(order)])
    found = np.linalg.lstsq(rows, samples[order:], rcond=None)[0]
    return np.log(np.roots([1.0, *-found[::-1]]).astype(complex)) / step


def oscillation(poles):
    """Return ω and ζ of the pair."""
    pole = poles[np.argmax(poles.imag)]
    return abs(pole), -pole.real / abs(pole)


@pytest.mark.parametrize(("name", "friction"), ARMS)
@pytest.mark.parametrize("law", ORDERS)
@pytest.mark.parametrize(("bandwidth", "ratio"), [(6.0, 0.7), (3.0, 0.5)])
def test_designed_modes_are_those_of_the_spectrum(name, friction, law, bandwidth, ratio):
    system = arm(name, friction)
    goal = system.robot.near_home()
    found = design_gains(law, system, DesiredBandwidth(bandwidth, ratio), goal)
    modes = linearize(make_controller(law, system, goal, **found.gains), system).spectrum
    pairs = [mode for mode in modes if mode.oscillates]
    assert len(pairs) == system.n
    for mode in pairs:
        assert mode.frequency == pytest.approx(bandwidth, rel=0.02)
        assert mode.damping_ratio == pytest.approx(ratio, rel=0.02)
    assert found.met
    assert found.deviation < 1e-6


@pytest.mark.parametrize(("name", "friction"), ARMS)
@pytest.mark.parametrize("law", ORDERS)
def test_designed_modes_are_those_of_the_simulated_step(name, friction, law):
    """Of a step of 0.05 rad in every joint: ω and ζ within 5 %."""
    system, step = arm(name, friction), 0.05
    goal = system.robot.near_home()
    found = design_gains(law, system, DesiredBandwidth(6.0, 0.6), goal)
    away = 0.05 * np.ones(system.n)
    log = simulate(system, found.law, q0=goal + away, duration=1.5, dt=1e-3, torque_limit=None)
    way = (log.position - goal) @ system.at(goal).mass_matrix @ away
    frequency, ratio = oscillation(poles_in(way[:: round(step / 1e-3)], step, ORDERS[law]))
    assert frequency == pytest.approx(6.0, rel=0.05)
    assert ratio == pytest.approx(0.6, rel=0.05)


@pytest.mark.parametrize(("name", "friction"), ARMS)
def test_the_hand_has_the_designed_modes_in_spectrum_and_step(name, friction):
    system, step, size = arm(name, friction), 0.05, 0.02
    goal = system.robot.near_home()
    found = design_gains("cartesian_impedance", system, DesiredBandwidth(6.0, 0.6), goal)
    pairs = [mode for mode in found.spectrum if mode.oscillates]
    assert len(pairs) == 6
    for mode in pairs:
        assert mode.damping_ratio == pytest.approx(0.6, rel=0.02)
    slow = [mode.frequency for mode in pairs if mode.frequency < 6.0 * 1.02]
    assert len(slow) >= 3
    np.testing.assert_allclose(slow, 6.0, rtol=0.02)
    assert min(mode.frequency for mode in pairs) == pytest.approx(6.0, rel=0.02)
    assert found.met
    # a step along the slowest mode of the hand, by the eigenproblem of its stiffness and its inertia
    x, law = system.at(goal), found.law
    jacobian = x.frame_jacobian(law.frame, "local_world_aligned")
    mobility = jacobian @ np.linalg.solve(x.mass_matrix, jacobian.T)
    turn = np.array(x.placement(law.frame).rotation)
    K = np.zeros((6, 6))
    K[:3, :3], K[3:, 3:] = law.translational_stiffness, turn @ law.rotational_stiffness @ turn.T
    values, vectors = eigh(K, np.linalg.inv(mobility))
    np.testing.assert_allclose(np.sqrt(values[:3]), 6.0, rtol=1e-6)
    mode = vectors[:, 0] / np.abs(vectors[:, 0]).max()
    away = size * np.linalg.solve(x.mass_matrix, jacobian.T) @ np.linalg.solve(mobility, mode)
    log = simulate(system, law, q0=goal + away, duration=1.5, dt=1e-3, torque_limit=None)
    way = (log.position - goal) @ jacobian.T @ K @ mode
    frequency, ratio = oscillation(poles_in(way[:: round(step / 1e-3)], step, 2))
    assert frequency == pytest.approx(6.0, rel=0.05)
    assert ratio == pytest.approx(0.6, rel=0.05)


@pytest.mark.parametrize("law", ["force_feedback", "integral_action"])
def test_poles_are_placed_against_a_friction_that_outweighs_the_arm(law):
    """The PERA's friction around rest damps with 22 to 152 1/s; energy shaping cannot take anything of that away."""
    system = arm("pera")
    found = design_gains(law, system, DesiredBandwidth(6.0, 0.7), system.robot.near_home())
    pairs = [mode for mode in found.spectrum if mode.oscillates and mode.frequency < 7.0]
    assert len(pairs) == system.n
    np.testing.assert_allclose([mode.frequency for mode in pairs], 6.0, rtol=1e-6)
    np.testing.assert_allclose([mode.damping_ratio for mode in pairs], 0.7, rtol=1e-6)
    assert found.met


def test_where_friction_damps_more_than_is_desired_the_slower_pole_is_placed():
    system = arm("pera")
    found = design_gains("energy_shaping", system, DesiredBandwidth(6.0, 0.7), system.robot.near_home())
    slow = np.abs(found.linear.eigenvalues)[np.abs(found.linear.eigenvalues) < 7.0]
    np.testing.assert_allclose(slow, 6.0, rtol=1e-6)
    assert len(slow) == system.n
    assert not found.met
    assert "friction" in found.notes[0]
    x = system.at(system.robot.near_home())
    worst = eigh(x.damping_matrix, x.mass_matrix, eigvals_only=True)[-1]
    faster = design_gains("energy_shaping", system, DesiredBandwidth(0.8 * worst, 0.7), system.robot.near_home())
    assert faster.met


@pytest.mark.parametrize("kind", [SecondOrderPoles, ForceFeedbackPoles, IntegralActionPoles])
@pytest.mark.parametrize("friction", [0.0, 0.3, 4.0, 60.0])
@pytest.mark.parametrize("ratio", [0.3, 0.7, 1.0, 1.8])
def test_gains_of_one_direction_are_positive_and_give_their_poles(kind, friction, ratio):
    """The matrix of the direction, written down by hand from the law's equations."""
    poles = kind(5.0, ratio)
    placed = poles.place(friction)
    g, d = placed.gains, friction
    assert min(g.values()) > 0.0
    k, c, s = g["stiffness"], g["damping"], g.get("force_gain", 0.0)
    if kind is SecondOrderPoles:
        A = np.array([[0.0, 1.0], [-k, -d - c]])
    elif kind is ForceFeedbackPoles:
        A = np.array([[0.0, 1.0, 1.0], [-k, -d - c, -d], [-s * k, -s * d, -s * d]])
    else:
        i, kappa = g["integral_gain"], g["integral_stiffness"]
        A = np.array([[-i, 1, 1, 0], [-k, -d - c, -d, -1], [-s * k, -s * d, -s * d, 0], [0, kappa, 0, 0]])
    np.testing.assert_allclose(np.poly(A), np.poly(placed.poles).real, rtol=1e-9)
    if placed.exact:
        remainder = np.polydiv(np.poly(A), poles.pair)[1]
        np.testing.assert_allclose(remainder, 0.0, atol=1e-9 * np.abs(np.poly(A)).max())
    else:
        assert kind is SecondOrderPoles


@pytest.mark.parametrize("law", ["energy_shaping", "force_feedback", "integral_action"])
def test_diagonal_gains_put_the_slowest_mode_there(law):
    system = arm("ur5")
    found = design_gains(law, system, DesiredBandwidth(5.0, 0.8, diagonal=True), system.robot.near_home())
    for name, value in found.gains.items():
        assert not (np.atleast_2d(value) - np.diag(np.atleast_2d(value).diagonal())).any(), name
    assert found.deviation < 1e-6
    assert found.stable
    x = system.at(system.robot.near_home())
    if law == "energy_shaping":  # its modes are those of the generalised eigenproblem (K, M)
        squares = eigh(found.law.stiffness, x.mass_matrix, eigvals_only=True)
        assert np.sqrt(squares[0]) == pytest.approx(5.0)
        assert min(mode.frequency for mode in found.spectrum if mode.oscillates) == pytest.approx(5.0, rel=1e-6)


def test_the_input_matrix_is_reckoned_with():
    """Gears: C acts as G C Gᵀ on the joints."""
    robot = load_robot("pera_shoulder")
    system = MechanicalSystem(robot, friction=None, input_matrix=[[2.0, 0.3], [0.1, 1.5]])
    for law in ORDERS:
        found = design_gains(law, system, DesiredBandwidth(6.0, 0.7))
        assert found.deviation < 1e-6, law


@pytest.mark.parametrize("law", ["total_force_rejection", "classical_impedance"])
def test_laws_that_cancel_friction_are_placed_without_it(law):
    system = arm("pera")
    found = design_gains(law, system, DesiredBandwidth(6.0, 0.7), system.robot.near_home())
    assert found.met
    assert found.deviation < 1e-6


def test_a_law_that_follows_has_the_poles_of_its_error():
    system = arm("ur5")
    goal = system.robot.near_home()
    found = design_gains("tracking", system, DesiredBandwidth(6.0, 0.7), goal)
    at_rest = design_gains("energy_shaping", system, DesiredBandwidth(6.0, 0.7), goal)
    np.testing.assert_allclose(found.gains["stiffness"], at_rest.gains["stiffness"], atol=1e-12)
    np.testing.assert_allclose(found.gains["damping"], at_rest.gains["damping"], atol=1e-12)
    assert found.linear is None
    assert "no rest" in str(found)


def test_a_point_of_the_hand_gets_the_bandwidth_exactly():
    system = arm("ur5")
    found = design_gains(
        "cartesian_impedance", system, DesiredBandwidth(8.0, 0.7), system.robot.near_home(), rotational_stiffness=None
    )
    pairs = [mode for mode in found.spectrum if mode.oscillates]
    np.testing.assert_allclose([mode.frequency for mode in pairs], 8.0, rtol=1e-4)
    assert len(pairs) == 3


def test_axes_of_the_tool():
    system = arm("ur5")
    goal = system.robot.near_home()
    world, tool = (
        design_gains("cartesian_impedance", system, DesiredBandwidth(8.0, 0.7), goal, axes=axes)
        for axes in ("world", "tool")
    )
    np.testing.assert_allclose(
        sorted(mode.frequency for mode in tool.spectrum), sorted(mode.frequency for mode in world.spectrum), rtol=1e-5
    )
    assert np.abs(tool.gains["translational_stiffness"] - world.gains["translational_stiffness"]).max() > 1.0


def test_what_cannot_be_designed_is_refused():
    system = arm("ur5")
    desired = DesiredBandwidth(5.0)
    with pytest.raises(InvalidArgumentError, match="impedance_grasping.*tune"):
        design_gains("impedance_grasping", system, desired)
    with pytest.raises(InvalidArgumentError, match="stiffness: is what the poles"):
        design_gains("energy_shaping", system, desired, stiffness=3.0)
    with pytest.raises(InvalidArgumentError, match="specification: must be one like"):
        design_gains("energy_shaping", system, 5.0)
    with pytest.raises(UnknownNameError, match="unknown option 'stifness'"):
        design_gains("energy_shaping", system, desired, stifness=3.0)
    with pytest.raises(UnknownNameError, match="energy_shapin"):
        design_gains("energy_shapin", system, desired)
    with pytest.raises(InvalidArgumentError, match="diagonal: is of the joints"):
        design_gains("cartesian_impedance", system, DesiredBandwidth(5.0, diagonal=True))
    with pytest.raises(InvalidArgumentError, match="bandwidth: must be > 0"):
        DesiredBandwidth(0.0)
    straight = np.zeros(6)  # the UR5 stretched out: a singular posture
    with pytest.raises(PHControlError, match="singular posture"):
        design_gains("cartesian_impedance", system, desired, straight)


def test_a_long_chain_is_placed_too():
    system = chain(9)
    found = design_gains("force_feedback", system, DesiredBandwidth(5.0, 0.7), system.robot.near_home())
    assert found.met
    assert found.deviation < 1e-3
