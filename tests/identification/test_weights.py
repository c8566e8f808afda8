"""The windows of the weak form beside integrals, and bodies beside point masses; motions at their border."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import quad

from phcontrol import InvalidArgumentError, MechanicalSystem, Motion, identify, load_robot
from phcontrol.identification.consistency import body_of, consistent_values, inconsistent, pseudo_inertia
from phcontrol.identification.parameters import parameters_of
from phcontrol.identification.weak_form import _Window, equations_of
from tests.finite_differences import derivative


def weight(t, length, period):
    """(1 − s²)⁴ of mean 1 over its window: ∫(1 − s²)⁴ds = 256/315 from −1 to 1."""
    half = 0.5 * length * period
    s = t / half - 1.0
    return 315.0 / 256.0 * (1.0 - s**2) ** 4 / half


@pytest.mark.parametrize(("length", "period"), [(4, 0.1), (10, 2e-3), (40, 1e-3)])
@pytest.mark.parametrize("held", [True, False])
def test_a_window_averages(length, period, held):
    """Weights of samples, of rates and of held torques: the function, its derivative, its integral over each hold."""
    window, times = _Window(length, period, held), period * np.arange(length + 1)
    np.testing.assert_allclose(window.samples, period * weight(times, length, period), atol=1e-14)
    slope = np.array([derivative(lambda h, t=t: weight(t + h, length, period), 1e-3 * period) for t in times])
    np.testing.assert_allclose(window.rates, period * slope, atol=1e-6 * np.abs(window.rates).max())
    if not held:
        assert window.torques is window.samples
        return
    holds = [quad(weight, t, t + period, args=(length, period))[0] for t in times[:-1]]
    np.testing.assert_allclose(window.torques, [*holds, 0.0], atol=1e-13)
    assert window.torques.sum() == pytest.approx(1.0, abs=1e-14)
    if length >= 10:  # the trapezoidal rule, of a function that is flat at both ends
        assert window.samples.sum() == pytest.approx(1.0, abs=2e-5)
        assert window.rates @ times == pytest.approx(-1.0, abs=30.0 / length**4)  # by parts


def test_the_pseudo_inertia_is_that_of_point_masses(rng):
    """Σ m (r, 1)(r, 1)ᵀ; the ten parameters by Pinocchio, which adds the inertias of the points."""
    masses, places = rng.uniform(0.1, 2.0, size=6), rng.normal(size=(6, 3))
    ends = np.column_stack([places, np.ones(6)])
    expected = np.einsum("k,ki,kj->ij", masses, ends, ends)
    total = pin.Inertia(masses[0], places[0], np.zeros((3, 3)))
    for mass, place in zip(masses[1:], places[1:], strict=True):
        total = total + pin.Inertia(mass, place, np.zeros((3, 3)))
    parameters = np.asarray(total.toDynamicParameters())
    np.testing.assert_allclose(pseudo_inertia(parameters), expected, atol=1e-12)
    np.testing.assert_allclose(body_of(expected), parameters, atol=1e-12)


def test_what_may_be_zero_is_possible_and_what_is_negative_is_not():
    parameters = parameters_of(load_robot("pera_shoulder"), ["coulomb", "viscous", "armature", "offset"], None)
    assert inconsistent(parameters, np.zeros(8)) == ()
    for k, name in enumerate(parameters.names[:6]):
        values = np.ones(8)
        values[k] = -1e-15
        assert inconsistent(parameters, values) == (f"{name} (negative)",)
    assert inconsistent(parameters, np.array([1.0] * 6 + [-5.0, -5.0])) == ()  # an offset may be either


def test_a_body_slightly_beyond_the_edge_is_told():
    """By its smallest eigenvalue in units of 0.1 m and 1 kg: rounding is let pass, a millionth is not."""
    parameters = parameters_of(load_robot("pera"), ["payload"], "tool")
    point = np.array([1.0, 0.0, 0.0, 0.1, 0.01, 0.0, 0.01, 0.0, 0.0, 0.0])  # 1 kg at 0.1 m: on the edge
    assert inconsistent(parameters, point) == ()
    for change, possible in ((1e-12, True), (1e-8, False), (1e-6, False), (-1e-6, True)):
        body = point.copy()
        body[9] -= change  # Σ = ½tr(I)1 − I: its first two entries fall with I_zz, its third grows
        body[6] += max(0.0, -change)
        body[4] += max(0.0, -change)
        assert (inconsistent(parameters, body) == ()) == possible, change
    for mass in (0.5, 1e-6):
        assert inconsistent(parameters, np.array([-mass, *np.zeros(9)])) != ()


def test_values_without_a_payload_are_bounded_least_squares(rng):
    """One that would be negative becomes 0, and the others are those of least squares without it."""
    parameters = parameters_of(load_robot("pera_shoulder"), ["coulomb", "viscous"], None)
    matrix = rng.normal(size=(60, 4))
    truth = np.array([0.5, -0.3, 0.2, 0.1])
    values = consistent_values(parameters, matrix, matrix @ truth, truth)
    others = [0, 2, 3]
    expected = np.zeros(4)
    expected[others] = np.linalg.lstsq(matrix[:, others], matrix @ truth, rcond=None)[0]
    assert (expected[others] > 0.0).all()
    np.testing.assert_allclose(values, expected, atol=1e-7)
    assert values[1] >= 0.0


def test_three_samples_are_a_motion_and_two_are_none():
    still = np.zeros((3, 2))
    motion = Motion.of([0.0, 0.1, 0.2], still, still, still)
    assert motion.period == pytest.approx(0.1, rel=1e-14)
    with pytest.raises(InvalidArgumentError, match=r"time: must hold the times of at least 3 samples, .* \(2,\)"):
        Motion.of([0.0, 0.1], *[still[:2]] * 3)
    with pytest.raises(InvalidArgumentError, match=r"at least 3 samples, but has shape \(3, 1\)"):
        Motion.of([[0.0], [0.1], [0.2]], *[still] * 3)
    with pytest.raises(InvalidArgumentError, match="must grow in equal steps"):
        Motion.of([0.0, 0.1, 0.1], *[still] * 3)


@pytest.mark.parametrize(("off", "even"), [(4e-4, True), (6e-4, False), (1e-2, False)])
def test_samples_may_be_off_by_a_thousandth_of_a_period(off, even):
    """One sample late: a step longer and the next one shorter by as much, twice that apart."""
    time, still = np.linspace(0.0, 1.0, 11), np.zeros((11, 2))
    time[5] += 0.1 * off
    if even:
        assert Motion.of(time, still, still, still).period == pytest.approx(0.1)
    else:
        with pytest.raises(InvalidArgumentError, match="must grow in equal steps"):
            Motion.of(time, still, still, still)


def rubbing(period=1e-2, duration=6.0):
    """Two joints that swing: their torques by inverse dynamics, and viscous friction beside."""
    system = MechanicalSystem(replace(load_robot("pera_shoulder"), friction=None))
    time, rate = np.arange(0.0, duration, period), np.array([1.3, 2.1])
    turn = np.outer(time, rate)
    q, v, a = 0.4 * np.sin(turn), 0.4 * rate * np.cos(turn), -0.4 * rate**2 * np.sin(turn)
    torque = np.array([system.at(x, y).feedforward(y, z) for x, y, z in zip(q, v, a, strict=True)])
    return system, Motion.of(time, q, v, torque + v * [0.5, 0.3], held=False)


def test_equations_are_of_the_middles_of_their_windows():
    """Every second half overlaps: of windows of 0.2 s a middle each 0.1 s, and the torque there is their mean."""
    system, motion = rubbing()
    found = equations_of(system, parameters_of(system.robot, ("viscous",), None), motion, 0.2, 1e-6)
    np.testing.assert_allclose(found.time, motion.time[0] + 0.1 * np.arange(1, len(found.time) + 1), atol=1e-12)
    there = np.array([np.interp(found.time, motion.time, column) for column in motion.torque.T]).T
    np.testing.assert_allclose(found.torque, there, atol=0.02 * np.abs(there).max())


def test_what_was_found_is_recorded_with_the_payload_or_without():
    system, motion = rubbing()
    plain = identify(motion, ("viscous",), model=system)
    np.testing.assert_allclose(plain.values, [0.5, 0.3], atol=2e-3)
    assert plain.to_dict()["payload"] is None
    loaded = identify(motion, ("payload", "viscous"), model=system, untold="keep")
    assert loaded.to_dict()["payload"] == loaded.payload.record()
    assert loaded.to_dict()["payload"] is not None
