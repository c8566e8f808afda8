"""What a design says of itself, read back, and what the hand's gains are by their closed forms."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import eigh, sqrtm

from phcontrol import (
    DesiredBandwidth,
    DesiredGain,
    DesiredSettling,
    MechanicalSystem,
    MinimumJerk,
    design_gains,
    load_robot,
    tune,
)
from phcontrol.design.designed_gains import text_of
from phcontrol.design.desired_settling import settling_of
from tests.conftest import make_system


@pytest.fixture(scope="module")
def ur5():
    return MechanicalSystem(load_robot("ur5"))


@pytest.fixture(scope="module")
def placed(ur5):
    return design_gains("energy_shaping", ur5, DesiredBandwidth(5.0, 0.7), ur5.robot.near_home())


def read(text):
    """Rows of numbers, as --set reads them."""
    return np.array([[float(each) for each in row.split(",")] for row in text.split(";")])


def test_gains_are_told_as_they_are_set(rng):
    full = rng.normal(size=(3, 3))
    np.testing.assert_allclose(read(text_of(full)), full, rtol=1e-6)
    assert text_of(np.diag([1.0, 2.5, 3.0])) == "1,2.5,3"
    assert text_of([1.0, 2.5, 3.0]) == "1,2.5,3"
    assert text_of(7.0 * np.eye(3)) == text_of([7.0, 7.0]) == text_of(7.0) == "7"
    assert text_of([7.0, 7.0, 7.1]) == "7,7,7.1"
    assert text_of(np.diag([2.0, 3.0]) + 1e-12) == "2,3"  # rounding beside the diagonal
    assert text_of([[2.0, 1e-6], [1e-6, 3.0]]) == "2,1e-06; 1e-06,3"
    assert text_of(0.0) == "0"
    assert text_of(np.zeros((2, 2))) == "0"


def test_a_design_shows_its_gains_and_what_they_do(ur5, placed):
    text = str(placed)
    assert "about its rest: no mode grows" in text
    rows = text.split("stiffness = ")[1].split("\n  damping")[0]
    shown = np.array([float(each) for each in re.findall(r"-?\d+\.?\d*", rows)]).reshape(6, 6)
    np.testing.assert_allclose(shown, placed.gains["stiffness"], atol=5.1e-5)  # to four digits
    hand = design_gains(
        "cartesian_impedance", ur5, DesiredBandwidth(8.0, 1.2345678), ur5.robot.near_home(), rotational_stiffness=None
    )
    assert "rotational_stiffness" not in str(hand)
    assert f"{hand.gains['damping_ratio']:.4f}" == "1.2346"
    assert "damping_ratio = 1.2346" in str(hand)
    follows = design_gains("tracking", ur5, DesiredBandwidth(6.0, 0.7))
    assert "no rest to look about" in str(follows)
    assert "about its rest" not in str(follows)
    assert follows.linear is None


@pytest.mark.parametrize(("real", "uncertainty", "stable"), [(0.5, 0.0, False), (0.5, 0.6, True), (-0.5, 0.0, True)])
def test_a_mode_that_grows_is_said(placed, real, uncertainty, stable):
    """By eigenvalues written down here: all where they should be, but for one that leads away from rest."""
    eigenvalues = np.append(placed.poles, real)
    loop = SimpleNamespace(
        eigenvalues=eigenvalues, uncertainty=np.full(eigenvalues.size, uncertainty), spectrum=placed.spectrum,
        longest_period=lambda late: math.inf,
    )  # fmt: skip
    found = replace(placed, linear=loop)
    assert found.deviation == pytest.approx(0.0, abs=1e-15)
    assert found.stable == stable
    assert found.met == stable
    assert ("UNSTABLE" in str(found)) == (not stable)
    assert "any length" in str(found)
    assert not replace(placed, exact=False).met


def test_modes_that_are_alike_are_counted_together(placed):
    first = placed.spectrum[0]
    apart = [
        first,
        replace(first, eigenvalue=first.eigenvalue * (1.0 + 2e-4)),
        replace(first, eigenvalue=first.eigenvalue * 1.01),
    ]
    loop = SimpleNamespace(
        eigenvalues=placed.poles, uncertainty=np.zeros(placed.poles.size), spectrum=tuple(apart),
        longest_period=lambda late: 0.01,
    )  # fmt: skip
    text = str(replace(placed, linear=loop))
    assert "2 × ω = 5 rad/s, ζ = 0.700" in text
    assert "1 × ω = 5.05 rad/s" in text
    assert "up to a period of 10 ms" in text


@pytest.mark.parametrize("goes", [True, False])
def test_a_goal_is_part_of_the_command_where_the_law_rests(ur5, placed, goes):
    if goes:
        command = placed.command()
        goal = [float(each) for each in command.split("--goal=")[1].split(" --")[0].split(",")]
        np.testing.assert_allclose(goal, ur5.robot.near_home(), rtol=1e-6, atol=1e-6)
        assert command.startswith("phcontrol run position --controller energy_shaping --robot ur5")
    else:
        law = placed.law.changed(goal=None, reference=MinimumJerk(ur5.robot.home, ur5.robot.near_home(), 2.0))
        command = replace(placed, law=law).command()
        assert "--goal" not in command
        assert command.startswith("phcontrol analyze ")


def test_the_hands_gains_are_their_closed_forms():
    """B K has its eigenvalues in pairs about ω²: three there, three at ω²(1 + ρ)/(1 − ρ), as the note says."""
    system, omega = make_system("panda"), 6.0
    found = design_gains("cartesian_impedance", system, DesiredBandwidth(omega, 0.7), system.robot.near_home())
    x, law = system.at(system.robot.near_home()), found.law
    J = x.frame_jacobian(law.frame, "local_world_aligned")
    B = J @ np.linalg.solve(x.mass_matrix, J.T)
    turn = np.array(x.placement(law.frame).rotation)
    K = np.zeros((6, 6))
    K[:3, :3] = found.gains["translational_stiffness"]
    K[3:, 3:] = turn @ found.gains["rotational_stiffness"] @ turn.T
    squares = eigh(K, np.linalg.inv(B), eigvals_only=True)
    still, turned = np.linalg.inv(sqrtm(B[:3, :3])), np.linalg.inv(sqrtm(B[3:, 3:]))
    rho = np.linalg.svd(still @ B[:3, 3:] @ turned, compute_uv=False)
    expected = omega**2 * np.concatenate([np.ones(3), (1.0 + rho) / (1.0 - rho)])
    np.testing.assert_allclose(squares, np.sort(expected), rtol=1e-7)
    assert rho[0] > 1.1 * rho[-1]
    fastest = float(re.search(r"up to ([0-9.]+) ω", found.notes[0])[1])
    assert fastest == pytest.approx(math.sqrt(squares[-1]) / omega, rel=5e-3)
    assert found.gains["nullspace_damping"] == omega
    assert (
        design_gains(
            "cartesian_impedance", make_system("ur5"), DesiredBandwidth(omega), make_system("ur5").robot.near_home()
        )
        .gains.keys()
        .isdisjoint({"nullspace_damping"})
    )


@pytest.mark.parametrize(("time", "fade"), [(3.0, 4.0), (0.5, math.log(20.0) / 0.5)])
def test_what_leaves_the_hand_alone_fades_in_that_time_too(time, fade):
    """Self-motions decay as exp(−c t): to 5 % within the time, and at 4 1/s at least."""
    system = make_system("panda")
    found = design_gains(
        "cartesian_impedance",
        system,
        DesiredSettling(3000.0, time, rotational_stiffness=300.0),
        system.robot.near_home(),
    )
    assert found.gains["nullspace_damping"] == pytest.approx(fade, rel=1e-12)
    frequencies = np.sort(np.abs(found.poles))
    ratio = found.gains.get("damping_ratio", 1.0)
    for w in frequencies:
        assert np.abs(np.polyval([1.0, 2.0 * ratio * w, w**2], found.poles)).min() < 1e-6 * w**2


def test_a_mode_settles_soonest_where_its_overshoot_is_five_percent():
    """exp(−πζ/√(1 − ζ²)) = 0.05, ζ = 0.6901; with a little less it has to come back once more."""
    ratio = brink = 0.690107
    assert math.exp(-math.pi * brink / math.sqrt(1.0 - brink**2)) == pytest.approx(0.05, rel=1e-5)
    assert settling_of(ratio - 1e-3) > 1.5 * settling_of(ratio + 1e-3)
    for other in (0.6925, 0.72, 0.85, 0.95, 1.0, 1.3, 2.5):
        assert settling_of(other) >= settling_of(ratio + 1e-4)
        t = settling_of(other)
        way = _displaced(other, t)
        assert abs(way) == pytest.approx(0.05, abs=0.02)
    assert settling_of(1.0 - 1e-5) == pytest.approx(settling_of(1.0), abs=0.01)
    assert settling_of(1.0 + 1e-5) == pytest.approx(settling_of(1.0), abs=0.01)


def _displaced(ratio, t):
    """The displacement at ωt of λ² + 2ζλ + 1 let go at 1, by the exponential of its matrix."""
    values, vectors = np.linalg.eig(np.array([[0.0, 1.0], [-1.0, -2.0 * ratio - 1e-9]]))
    return float((vectors @ np.diag(np.exp(values * t)) @ np.linalg.inv(vectors))[0, 0].real)


def test_a_gain_raises_the_damping_only_as_far_as_it_must(ur5):
    """GᵀC G ≥ 1/γ: eigenvalues below are lifted to it, those above stay, in the same directions."""
    goal = ur5.robot.near_home()
    plain = design_gains("energy_shaping", ur5, DesiredBandwidth(5.0, 0.7), goal).gains["damping"]
    for gain in (0.1, 1.0):
        both = design_gains("energy_shaping", ur5, DesiredGain(gain, bandwidth=5.0, damping_ratio=0.7), goal)
        values, vectors = np.linalg.eigh(plain)
        expected = vectors @ np.diag(np.maximum(values, 1.0 / gain)) @ vectors.T
        np.testing.assert_allclose(both.gains["damping"], expected, rtol=1e-9, atol=1e-9)
        raised = int((values < 1.0 / gain).sum())
        assert 0 < raised <= 6
        assert f"C is raised in {raised} directions" in both.notes[-1]


def test_where_friction_is_in_the_way_the_directions_are_counted():
    """By the eigenvalues of (D, M): those above 2ζω, of which a tenth is always injected."""
    system = make_system("pera")
    x = system.at(system.robot.near_home())
    damps = eigh(x.damping_matrix, x.mass_matrix, eigvals_only=True)
    omega = 0.5 * float(np.median(damps))
    found = design_gains("energy_shaping", system, DesiredBandwidth(omega, 0.7), system.robot.near_home())
    beyond = int((damps > 0.9 * 2.0 * 0.7 * omega).sum())
    assert 0 < beyond < system.n
    assert found.notes[-1].startswith(f"in {beyond} of {system.n} directions the friction around rest alone damps more")


def test_tuning_says_what_it_began_with_and_where_it_ended():
    system = make_system("pera_shoulder")
    begun = None

    def run(law, scenario):
        nonlocal begun
        begun = law.stiffness[0, 0] if begun is None else begun
        return abs(math.log(law.stiffness[0, 0] / begun / 2.0))

    found = tune("energy_shaping", float, [0], system=system, run=run, gains=["stiffness"], evaluations=30)
    assert found.start_value == pytest.approx(math.log(2.0), rel=1e-12)
    assert found.history[0].value == found.start_value
    assert found.factors["stiffness"][0] == pytest.approx(2.0, rel=0.05)
    assert f"{found.start_value:.4g} -> {found.value:.4g} in {len(found.history)} evaluations (0 refused)" in str(found)
    with pytest.raises(AttributeError):
        found.value = 0.0
