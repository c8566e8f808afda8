"""Every registered integrator: its measured order, and the energy of the symplectic one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from phcontrol import INTEGRATORS, MechanicalSystem, StribeckFriction, load_robot, make_controller, simulate
from phcontrol.simulation.vector_field import NOTHING_HELD, ClosedLoop
from tests.simulation.idle import IdleLaw

DURATION = 0.5


@pytest.fixture(scope="module")
def smooth_loop():
    """A loop without kinks: viscous friction only, a law with a state, a force that varies in time."""
    system = MechanicalSystem(load_robot("pera_shoulder_elbow"), friction=StribeckFriction(viscous=0.5))
    controller = make_controller("force_feedback", system, goal=[0.4, -0.3, 0.5])

    def force(t, x):
        return np.array([np.sin(3.0 * t), 1.0, -np.cos(t)])

    loop = ClosedLoop(system, controller, force).during(NOTHING_HELD)
    y0 = np.concatenate([system.robot.home, [0.5, -0.5, 1.0], np.zeros(3)])
    exact = solve_ivp(loop.rate, (0.0, DURATION), y0, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return system, controller, force, exact


def error(smooth_loop, name, dt):
    system, controller, force, exact = smooth_loop
    log = simulate(
        system, controller, duration=DURATION, dt=dt, v0=[0.5, -0.5, 1.0], disturbance=force, integrator=name,
        torque_limit=None,
    )  # fmt: skip
    final = np.concatenate([log.position[-1], log.velocity[-1], log.controller_state[-1]])
    return np.abs(final - exact).max()


@pytest.mark.parametrize("name", list(INTEGRATORS))
def test_measured_order_is_the_declared_one(smooth_loop, name):
    """Against SciPy's DOP853 at 1e-12: halving the step divides the error by 2^order."""
    coarse, fine = error(smooth_loop, name, 5e-3), error(smooth_loop, name, 2.5e-3)
    assert np.log2(coarse / fine) == pytest.approx(INTEGRATORS[name].order, abs=0.15)


def test_implicit_midpoint_keeps_the_energy_of_the_frictionless_pera():
    """Free swing for 10 s: the error of the energy stays bounded (no trend), and falls with dt²."""
    system = MechanicalSystem(load_robot("pera"), friction=None)

    def energy_error(dt, duration):
        log = simulate(
            system, IdleLaw(system), duration=duration, dt=dt, v0=np.full(7, 0.5), integrator="implicit_midpoint"
        )
        total = log.kinetic_energy + log.potential_energy
        return np.abs(total - total[0])

    error = energy_error(2e-3, 10.0)
    first, second = error[: len(error) // 2].max(), error[len(error) // 2 :].max()
    assert second <= 1.5 * first
    assert error.max() <= 2e-3  # [J], of some 10 J that swing
    assert energy_error(1e-3, 1.0).max() == pytest.approx(energy_error(2e-3, 1.0).max() / 4.0, rel=0.1)


def test_implicit_midpoint_solves_stiff_steps():
    """Friction so steep around rest that the fixed-point iteration does not contract at this step."""
    friction = StribeckFriction(coulomb=5.0, viscous=0.5, smoothing=1e-6)
    system = MechanicalSystem(load_robot("pera_shoulder"), friction=friction)
    controller = make_controller("energy_shaping", system, goal=[1.0, 0.5], stiffness=40.0, damping=10.0)
    log = simulate(system, controller, duration=0.2, dt=1e-2, integrator="implicit_midpoint")
    reference = simulate(system, controller, duration=0.2, dt=1e-4, integrator="rk4")
    np.testing.assert_allclose(log.position[-1], reference.position[-1], atol=2e-3)


@pytest.mark.parametrize("dt", [1e-3, 5e-3, 1e-2])
@pytest.mark.parametrize("viscous", [0.0, 0.4])
def test_the_discrete_gradient_balances_energy_exactly(dt, viscous):
    """H⁺ − H = uᵀΔq − dt v̄ᵀDv̄ with v̄ = Δq/dt, to rounding at any step; the midpoint rule a thousand times worse."""
    friction = StribeckFriction(viscous=viscous) if viscous else None
    system = MechanicalSystem(load_robot("pera"), friction=friction)
    force = np.full(7, 0.5)

    def balance(name):
        law = IdleLaw(system)
        log = simulate(
            system, law, duration=2.0, dt=dt, v0=np.full(7, 0.5), integrator=name, disturbance=force, torque_limit=None
        )
        energy, moved = log.kinetic_energy + log.potential_energy, np.diff(log.position, axis=0)
        lost = viscous * (moved**2).sum(axis=1) / dt
        return np.abs(np.diff(energy) - (moved @ force - lost)).max()

    exact = balance("discrete_gradient")
    assert exact < 1e-12
    assert balance("implicit_midpoint") > 1e3 * exact
