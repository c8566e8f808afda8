"""The references that benchmarks compare with: what a roboticist writes by hand on Pinocchio."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin


def slotine_li(model: pin.Model, goal: np.ndarray, gain: np.ndarray, slope: float) -> Callable[..., np.ndarray]:
    """Return the law of Slotine and Li for a constant goal, u = M q̈_r + C q̇_r + g − K(q̇ − q̇_r)."""
    data = model.createData()

    def law(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        error = q - goal
        reference_velocity = -slope * error
        reference_acceleration = -slope * v
        mass = pin.crba(model, data, q)
        coriolis = pin.computeCoriolisMatrix(model, data, q, v)
        gravity = pin.computeGeneralizedGravity(model, data, q)
        sliding = v - reference_velocity
        torque: np.ndarray = mass @ reference_acceleration + coriolis @ reference_velocity + gravity - gain @ sliding
        return torque

    return law


def energy_shaping(
    model: pin.Model, goal: np.ndarray, stiffness: np.ndarray, damping: np.ndarray
) -> Callable[..., np.ndarray]:
    """Return u = g − K_p(q − q_d) − C q̇."""
    data = model.createData()

    def law(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        torque: np.ndarray = pin.computeGeneralizedGravity(model, data, q) - stiffness @ (q - goal) - damping @ v
        return torque

    return law


def closed_loop(
    model: pin.Model,
    law: Callable[..., np.ndarray],
    q: np.ndarray,
    v: np.ndarray,
    dt: float,
    steps: int,
    sampled: bool,
) -> dict[str, np.ndarray]:
    """Run the law with pin.aba and RK4, continuously or held over each step, logging what a user would."""
    data, n = model.createData(), model.nv
    log = {name: np.zeros((steps + 1, n)) for name in ("q", "v", "torque")}

    def rate(y: np.ndarray, torque: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        position, velocity = y[:n], y[n:]
        if torque is None:
            torque = law(position, velocity)
        return np.concatenate([velocity, pin.aba(model, data, position, velocity, torque)]), torque

    y = np.concatenate([q, v])
    for k in range(steps + 1):
        held = law(y[:n], y[n:]) if sampled else None
        k1, torque = rate(y, held)
        log["q"][k], log["v"][k], log["torque"][k] = y[:n], y[n:], torque
        k2, _ = rate(y + 0.5 * dt * k1, held)
        k3, _ = rate(y + 0.5 * dt * k2, held)
        k4, _ = rate(y + dt * k3, held)
        y = y + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return log
