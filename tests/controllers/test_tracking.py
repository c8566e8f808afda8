"""Trajectory tracking against laws written by hand, the thesis's partial differential equation, and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import (
    InvalidArgumentError,
    MechanicalSystem,
    MinimumJerk,
    MissingMeasurementError,
    MomentumObserver,
    Schedule,
    Sine,
    Sinusoid,
    Step,
    StribeckFriction,
    TrajectoryTracking,
    certify,
    check_canonical_transformation,
    equilibrium,
    l2_gain,
    load_robot,
    make_controller,
    measured_l2_gain,
    simulate,
)
from phcontrol.controllers.controller import Controller
from phcontrol.sensors.measured import Measured
from tests.conftest import ARMS, make_system

AMPLITUDE = 2.0 * math.pi / 9.0
THESIS = {
    "trajectory": Sinusoid([AMPLITUDE, 0.0], 1 / 30, offset=[AMPLITUDE, 0.0]),
    "stiffness": 45.0,
    "damping": 10.0,
}  # section 6.2
EMPTY = np.zeros(0)


def wandering(n):
    """A trajectory in which no two joints do the same."""
    k = np.arange(n)
    return Sinusoid(0.4, 0.3 + 0.05 * k, phase=0.7 * k, offset=0.1)


def errors(log, controller):
    return np.array([q - controller.trajectory.at(t).position for t, q in zip(log.time, log.position, strict=True)])


@pytest.mark.parametrize("arm", list(ARMS))
def test_the_coriolis_form_is_pd_plus_written_by_hand(arm, rng):
    """u = M q̈_d + C q̇_d + D q̇_d + g − K q̃ − C_d q̃̇ from Pinocchio's matrices, not from recursive passes."""
    system = make_system(arm)
    trajectory, n = wandering(system.n), system.n
    law = TrajectoryTracking(system, trajectory=trajectory, stiffness=7.0, damping=3.0)
    E = np.eye(n) if system.coupling is None else system.coupling.matrix
    for t in rng.uniform(0.0, 10.0, size=3):
        q, v = system.robot.random_position(rng), rng.normal(size=n)
        x, goal, data = system.at(q, v), trajectory.at(t), system.model.createData()
        full = system.robot.full_position(q)
        M = E.T @ pin.crba(system.model, data, full) @ E
        C = E.T @ pin.computeCoriolisMatrix(system.model, data, full, E @ v) @ E
        g = E.T @ pin.computeGeneralizedGravity(system.model, data, full)
        g = g + sum(potential.gradient(q) for potential in system.potentials)
        d = np.zeros(n) if system.friction is None else system.friction.coefficients(v)
        error = np.where(system.robot.continuous, np.angle(np.exp(1j * (q - goal.position))), q - goal.position)
        expected = (
            M @ goal.acceleration + C @ goal.velocity + d * goal.velocity + g - 7.0 * error - 3.0 * (v - goal.velocity)
        )
        actual = law.evaluate(t, x, EMPTY).torque
        np.testing.assert_allclose(actual, expected, atol=1e-12 * max(1.0, np.abs(expected).max()))
        generic = Controller.evaluate(law, t, system.at(q, v), EMPTY).torque  # what `shape` states, by the one formula
        np.testing.assert_allclose(actual, generic, atol=1e-12 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("arm", list(ARMS))
def test_the_thesis_transformation_solves_its_equation(arm):
    """(2.25) is zero for Φ, U and β of chapter 6, corrected by errata E22, gravity, friction and springs included."""
    system = make_system(arm)
    law = TrajectoryTracking(system, trajectory=wandering(system.n), stiffness=20.0, damping=5.0)
    change = law.transformation
    check = check_canonical_transformation(
        change.coordinates, change.energy_change, change.input_change, system, samples=4
    )
    assert check.residual < 1e-7, check
    assert check.passed


def test_the_transformation_as_printed_does_not():
    """(6.6) without −V + ½q̃ᵀK_t q̃, and (6.14) with the whole of ∂(q̇_dᵀMq̇_d)/∂q: errata E22."""
    system = make_system("pera_shoulder_elbow")
    law = TrajectoryTracking(system, trajectory=wandering(3), stiffness=20.0, damping=5.0)
    change = law.transformation

    def printed_energy(q, p, t):
        x, goal = system.at(q), change.trajectory.at(t)
        return -p @ goal.velocity + 0.5 * goal.velocity @ x.mass_matrix @ goal.velocity

    def printed_input(q, p, t):
        x, goal = system.at(q), change.trajectory.at(t)
        extra = 0.5 * np.einsum("i,kij,j->k", goal.velocity, x.mass_matrix_derivative, goal.velocity)
        return change.input_change(q, p, t) + extra

    for energy, force in ((printed_energy, change.input_change), (change.energy_change, printed_input)):
        assert not check_canonical_transformation(change.coordinates, energy, force, system, samples=4).passed


def test_the_transformed_form_is_the_law_of_the_theorem(rng):
    """u = −β − C(y + α) − G⁻¹f_e with gears: G not the identity."""
    gears = np.eye(3) + 0.3 * rng.normal(size=(3, 3))
    system = MechanicalSystem(load_robot("pera_shoulder_elbow"), input_matrix=gears)
    damping = np.diag([1.0, 2.0, 3.0])
    law = TrajectoryTracking(
        system, trajectory=wandering(3), stiffness=9.0, damping=damping, measured=True, interconnection="transformed"
    )
    x, force, t = system.at(rng.normal(size=3), rng.normal(size=3)), rng.normal(size=3), 1.3
    change = law.transformation
    beta = change.input_change(x.position, x.momentum, t)
    alpha = change.output_change(x.position, x.momentum, t)
    expected = -beta - damping @ (x.output + alpha) - np.linalg.solve(gears, force)
    np.testing.assert_allclose(law.evaluate(t, x, EMPTY, Measured(force)).torque, expected, atol=1e-12)


def test_the_forms_differ_off_the_trajectory_and_agree_on_it(pera, rng):
    trajectory = wandering(7)
    laws = [
        TrajectoryTracking(pera, trajectory=trajectory, stiffness=20.0, damping=5.0, interconnection=form)
        for form in TrajectoryTracking.forms
    ]
    goal = trajectory.at(0.4)
    on = [law.evaluate(0.4, pera.at(goal.position, goal.velocity), EMPTY).torque for law in laws]
    away = pera.at(goal.position + 0.3, goal.velocity + rng.normal(size=7))
    off = [law.evaluate(0.4, away, EMPTY).torque for law in laws]
    for i, j in ((0, 1), (0, 2), (1, 2)):
        np.testing.assert_allclose(on[i], on[j], atol=1e-12)
        assert np.abs(off[i] - off[j]).max() > 1e-3


@pytest.mark.parametrize("form", TrajectoryTracking.forms)
def test_the_thesis_shoulder_converges(shoulder, form):
    """From 0.36 rad: below 2e-4 rad at 10 s; H_d never grows although the goal moves."""
    law = TrajectoryTracking(shoulder, **THESIS, interconnection=form)
    log = simulate(shoulder, law, duration=10.0, dt=5e-3, q0=[0.3, 0.2])
    assert np.linalg.norm(errors(log, law)[0]) == pytest.approx(0.36, abs=1e-3)
    assert np.linalg.norm(errors(log, law)[-1]) <= 2e-4
    assert np.diff(log.storage).max() <= 1e-12 * log.storage[0]
    # the smoothed friction has a kink at rest, through which q̇₂ goes
    assert log.power_balance("storage").energy_drift <= 1e-6 * log.storage[0]


def test_every_arm_with_continuous_and_mimic_joints_converges():
    """The wrapped error takes the shorter way: from three turns off, in a continuous joint."""
    for arm in ("kinova", "panda_with_fingers"):
        system = make_system(arm)
        law = make_controller("tracking", system)
        turned = law.trajectory.at(0.0).position + np.where(system.robot.continuous, 6.0 * np.pi, 0.0) + 0.01
        log = simulate(system, law, duration=6.0, dt=2e-3, q0=turned, torque_limit=None)
        x = system.at(log.position[-1])
        assert np.abs(x.position_error(law.trajectory.at(log.time[-1]).position)).max() < 1e-4
        wound = np.abs(log.position[-1] - turned)[system.robot.continuous]
        assert (wound < np.pi).all()


def test_a_constant_force_shifts_it_unless_it_is_measured(shoulder):
    """An unmeasured f_e settles at q̃ = K_t⁻¹f_e (3 N·m over 45: 67 mrad); measured or observed it does nothing."""
    force = np.array([3.0, -3.0])
    start = THESIS["trajectory"].at(0.0).position
    final = {}
    for name, options, sensors in (
        ("unmeasured", {}, None),
        ("measured", {"measured": True}, None),
        ("observed", {"measured": True}, [MomentumObserver(shoulder, gain=50.0)]),
    ):
        law = TrajectoryTracking(shoulder, **THESIS, **options)
        log = simulate(shoulder, law, duration=6.0, dt=5e-3, q0=start, disturbance=Step(force, 0.5), sensors=sensors)
        final[name] = errors(log, law)
    np.testing.assert_allclose(final["unmeasured"][-1], force / 45.0, atol=1e-5)
    assert np.abs(final["measured"]).max() < 1e-10
    assert np.abs(final["observed"][-1]).max() < 1e-6
    assert np.abs(final["observed"]).max() < 5e-3  # while the estimate lags


def test_the_measurement_must_be_there(shoulder):
    law = TrajectoryTracking(shoulder, **THESIS, measured=True)
    assert law.needs == ("external_force",)
    for form in TrajectoryTracking.forms:
        law = TrajectoryTracking(shoulder, **THESIS, measured=True, interconnection=form)
        with pytest.raises(MissingMeasurementError, match="tracking needs the measurement 'external_force'"):
            law.evaluate(0.0, shoulder.at([0.0, 0.0]), EMPTY)


def test_a_left_out_viscous_friction_gives_the_thesis_error(shoulder):
    """The error is F_v A ω/K_t = 13.38 mrad: inertia and the other joint add next to nothing at 1/30 Hz."""
    true = shoulder.friction
    model = MechanicalSystem(
        shoulder.robot,
        friction=StribeckFriction(
            coulomb=true.coulomb,
            static=true.static,
            stribeck_velocity=true.stribeck_velocity,
            smoothing=true.smoothing,
        ),
    )
    law = TrajectoryTracking(model, **THESIS)
    log = simulate(shoulder, law, duration=15.0, dt=5e-3, q0=[0.0, 0.0])
    expected = true.viscous[0] * AMPLITUDE * 2.0 * math.pi / 30.0 / 45.0
    assert expected == pytest.approx(13.38e-3, abs=1e-5)
    assert np.abs(errors(log, law)[:, 0]).max() == pytest.approx(expected, rel=0.01)


def test_the_hold_is_made_up_for(pera):
    """A held torque is h/2 late: an error of first order in h; computed for the middle of the hold, of second."""
    trajectory = Sinusoid(0.3, 0.2, offset=pera.robot.near_home())
    largest = {}
    for compensated in (False, True):
        for period in (4e-3, 8e-3):
            hold = period if compensated else 0.0
            law = TrajectoryTracking(pera, trajectory=trajectory, stiffness=20.0, damping=3.0, hold=hold)
            log = simulate(pera, law, duration=4.0, dt=4e-3, control_period=period, q0=trajectory.at(0.0).position)
            largest[compensated, period] = np.abs(errors(log, law)[500:]).max()
    assert largest[False, 8e-3] / largest[False, 4e-3] == pytest.approx(2.0, rel=0.1)
    assert largest[True, 8e-3] / largest[True, 4e-3] == pytest.approx(4.0, rel=0.2)
    assert largest[True, 4e-3] < 0.1 * largest[False, 4e-3]


def test_a_held_law_is_not_certified_as_the_continuous_one(shoulder):
    assert not certify(TrajectoryTracking(shoulder, **THESIS, hold=0.01), samples=5).passed


def test_the_default_trajectory_goes_to_the_goal_or_swings(shoulder):
    """A goal is gone to by minimum jerk; without one, or at home, the arm swings, so that a certificate sees motion."""
    going = make_controller("tracking", shoulder, goal=[1.0, 0.5]).trajectory
    assert isinstance(going, MinimumJerk)
    np.testing.assert_allclose(going.at(going.duration).position, [1.0, 0.5], atol=1e-12)
    swinging = make_controller("tracking", shoulder).trajectory
    np.testing.assert_allclose(swinging.at(0.0).position, shoulder.robot.home, atol=1e-12)
    speeds = [np.abs(swinging.at(t).velocity).max() for t in np.linspace(0.0, swinging.duration, 50)]
    assert 0.1 < max(speeds) <= 1.0  # half the limit of 2 rad/s


class NoAcceleration(TrajectoryTracking):
    """M q̈_d is forgotten."""

    def evaluate(self, t, x, state, measured=None):
        command = super().evaluate(t, x, state, measured)
        return command._replace(torque=command.torque - x.mass_matrix @ self.trajectory.at(t).acceleration)


class FullSlope(TrajectoryTracking):
    """∂(q̇_dᵀMq̇_d)/∂q without the half, as (6.14) has it (errata E22)."""

    def evaluate(self, t, x, state, measured=None):
        command, v = super().evaluate(t, x, state, measured), self.trajectory.at(t).velocity
        extra = 0.5 * np.einsum("i,kij,j->k", v, x.mass_matrix_derivative, v)
        return command._replace(torque=command.torque - extra)


class TimeStandsStill(TrajectoryTracking):
    """A storage function that does not know that its goal moves."""

    def storage(self, t, x, state, measured=None):
        return super().storage(1.0, x, state)


@pytest.mark.parametrize("law", [NoAcceleration, FullSlope, TimeStandsStill], ids=lambda law: law.__name__)
def test_broken_tracking_gets_no_certificate(pera, law):
    broken = law(pera, trajectory=wandering(7), stiffness=20.0, damping=5.0, interconnection="transformed")
    certificate = certify(broken, samples=10)
    assert not certificate.matching_passed, str(certificate)


def test_the_gain_from_force_to_output_is_bounded_as_it_is_for_a_law_at_rest(pera):
    """γ = 1/λ_min(C_d), while the goal moves: the measured ratio of a run from the trajectory stays below it."""
    trajectory = wandering(7)
    law = TrajectoryTracking(pera, trajectory=trajectory, stiffness=20.0, damping=[8.0, 8, 6, 6, 5, 4, 4])
    bound = l2_gain(law, pera)
    assert bound.passed
    assert bound.bound == pytest.approx(0.25)
    start = trajectory.at(0.0)
    log = simulate(
        pera, law, duration=4.0, dt=4e-3, q0=start.position, v0=start.velocity, disturbance=Sine(np.ones(7), 0.8)
    )
    assert 0.01 < measured_l2_gain(log) <= 0.25


def test_a_moving_law_has_no_equilibrium(shoulder):
    with pytest.raises(InvalidArgumentError, match="controller: changes with time"):
        equilibrium(TrajectoryTracking(shoulder, **THESIS), shoulder, [1.0, 0.0])


def test_it_takes_its_turn_in_a_schedule(shoulder):
    """Reach by minimum jerk, then hold by energy shaping: each with its own form of the interconnection."""
    reach = make_controller("tracking", shoulder, goal=[0.6, 0.2], interconnection="transformed")
    hold = make_controller("energy_shaping", shoulder, goal=[0.6, 0.2])
    log = simulate(shoulder, Schedule([(0.0, reach), (3.0, hold)]), duration=4.0, dt=4e-3)
    np.testing.assert_allclose(log.position[-1], [0.6, 0.2], atol=1e-4)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"stiffness": -1.0}, "stiffness: must be positive definite"),
        ({"damping": [1.0, 2.0, 3.0]}, "damping: must be a scalar"),
        ({"trajectory": Sinusoid(1.0, [0.1, 0.2, 0.3])}, "trajectory: must be for 2 joints, but is for 3"),
        ({"trajectory": [0.0, 1.0]}, "trajectory: must be a trajectory"),
        ({"measured": 1}, "measured: must be True or False"),
        ({"hold": -1e-3}, "hold: must be >= 0"),
    ],
)
def test_bad_arguments_are_refused(shoulder, options, complaint):
    with pytest.raises(InvalidArgumentError, match=complaint):
        TrajectoryTracking(shoulder, **(THESIS | options))
