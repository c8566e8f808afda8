"""The true motion of an arm under a law, against the closed loop that the law is said to make.

The motion is that of Pinocchio's forward dynamics; rates are central differences along it. Nothing of a law's own
algebra is used on both sides.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from phcontrol import MechanicalSystem, StribeckFriction, load_robot
from phcontrol.mechanics.state import MechanicalState
from tests.finite_differences import derivative

Array = np.ndarray
EXACT = 1e-8  # of the largest rate: what central differences of fourth order leave
FORCE = np.array([3.0, -2.0, 1.0])
GOAL = np.array([0.3, 0.4, -1.0])


@cache
def arm() -> MechanicalSystem:
    """Return the three-joint PERA of section 5.4, with Stribeck friction and an input matrix that is not 1."""
    friction = StribeckFriction(viscous=[0.5, 0.5, 0.2], coulomb=0.5, static=0.9, stribeck_velocity=0.2, smoothing=0.1)
    mixing = [[1.0, 0.2, 0.0], [0.0, 0.8, 0.3], [-0.1, 0.0, 1.2]]
    return MechanicalSystem(load_robot("pera_shoulder_elbow"), friction=friction, input_matrix=mixing)


def states(system: MechanicalSystem, size: int, count: int = 5) -> list[tuple[MechanicalState, Array]]:
    """Draw states of the arm, and of a law with ``size`` numbers."""
    draw = np.random.default_rng(20150424)
    return [
        (system.at(draw.uniform(-1.5, 1.5, system.n), draw.normal(size=system.n)), draw.normal(size=size))
        for _ in range(count)
    ]


def along(
    coordinates: Callable[[MechanicalState, Array], Array],
    x: MechanicalState,
    state: Array,
    torque: Array,
    state_rate: Array,
    force: Array | None = None,
) -> Array:
    """Return the rate of some coordinates along the true motion."""
    acceleration = x.acceleration(torque, force)

    def moved(h: float) -> Array:
        later = x.system.at(x.position + h * x.velocity, x.velocity + h * acceleration)
        return np.asarray(coordinates(later, state + h * state_rate))

    return derivative(moved, 2e-4)


def mismatch(
    law: Callable[[MechanicalState, Array], tuple[Array, Array]],
    coordinates: Callable[[MechanicalState, Array], Array],
    promise: Callable[[MechanicalState, Array], Array],
    size: int = 0,
    force: Array | None = None,
    system: MechanicalSystem | None = None,
) -> float:
    """Return the largest |true rate − promised rate| over the largest promised one, at random states."""
    worst = 0.0
    for x, state in states(arm() if system is None else system, size):
        promised = promise(x, state)
        actual = along(coordinates, x, state, *law(x, state), force)
        worst = max(worst, float(np.abs(actual - promised).max() / np.abs(promised).max()))
    return worst
