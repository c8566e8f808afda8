"""Friction and the gripper's spring against the thesis's formulas and integrals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from phcontrol import GripperSpring, InvalidArgumentError, StribeckFriction

THESIS = {"closing_stiffness": 0.21, "opening_stiffness": 0.06, "rest_angle": 0.30}  # figure 2.3


@given(st.floats(-10, 10))
def test_stribeck_friction_is_the_formula(velocity):
    friction = StribeckFriction(viscous=0.5, coulomb=0.5, static=0.9, stribeck_velocity=0.2, smoothing=1e-3)
    expected = (0.5 + 0.4 * np.exp(-abs(velocity) / 0.2)) / np.sqrt(1e-3 + velocity**2) + 0.5
    np.testing.assert_allclose(friction.coefficients(np.array([velocity])), [expected], rtol=1e-13)


def test_static_friction_wears_off_with_speed():
    """Errata E3: with exp(+|q̇|/q̇_s) as printed the friction torque would grow without bound."""
    friction = StribeckFriction(coulomb=0.5, static=0.9, stribeck_velocity=0.2, smoothing=1e-6)
    slow, fast = (friction.coefficients(np.array([v]))[0] * v for v in (0.02, 20.0))
    assert slow > 0.8
    assert fast == pytest.approx(0.5, rel=1e-3)


@given(st.floats(-1e3, 1e3), st.floats(0, 10), st.floats(0, 10), st.floats(0, 10))
def test_friction_always_dissipates(velocity, viscous, coulomb, excess):
    friction = StribeckFriction(viscous=viscous, coulomb=coulomb, static=coulomb + excess)
    assert friction.coefficients(np.array([velocity]))[0] >= 0.0


def test_scaled_friction_scales_the_torque():
    friction = StribeckFriction(viscous=[1.0, 2.0], coulomb=[0.5, 0.2], static=[0.7, 0.9])
    v = np.array([0.1, -2.0])
    np.testing.assert_allclose(friction.scaled(1.2).coefficients(v), 1.2 * friction.coefficients(v))


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"viscous": -1.0}, "viscous: must be >= 0"),
        ({"coulomb": 1.0, "static": 0.5}, "static: must not be below coulomb"),
        ({"smoothing": 0.0}, "smoothing: must be > 0"),
        ({"stribeck_velocity": 0.0}, "stribeck_velocity: must be > 0"),
        ({"viscous": np.eye(2)}, "viscous: must be a scalar or a vector"),
        ({"viscous": np.nan}, "viscous: must be finite"),
    ],
)
def test_bad_friction_is_refused(arguments, complaint):
    with pytest.raises(InvalidArgumentError, match=complaint):
        StribeckFriction(**arguments)


@given(st.floats(-2, 2), st.floats(1e-6, 1e-1))
def test_spring_energy_is_the_integral_of_its_torque(position, smoothing):
    """(2.17) and (2.18), with errata E4 and E5: V' = K_g(q)(q − c_g), and V(c_g) = 0."""
    spring = GripperSpring(**THESIS, smoothing=smoothing)
    expected, _ = quad(
        lambda q: spring.gradient(np.array([q]))[0], 0.30, position, epsabs=1e-13, epsrel=1e-12, limit=500
    )
    assert spring.energy(np.array([position])) == pytest.approx(expected, abs=1e-10)


def test_spring_is_stiff_when_closing_and_soft_when_opening():
    """(2.16): k_g1 = 0.21 for q ≤ c_g. The sign printed in (2.17) would exchange the two (E4)."""
    spring = GripperSpring(**THESIS, smoothing=1e-6)
    np.testing.assert_allclose(spring.stiffness(np.array([0.0, 0.6])), [0.21, 0.06], atol=1e-6)
    assert spring.stiffness(np.array([0.30]))[0] == pytest.approx(0.135)
