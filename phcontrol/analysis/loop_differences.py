"""Derivatives of a closed loop by finite differences, in the same parts as the exact ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phcontrol._differences import BEND, TINY, jacobian, slope_change
from phcontrol._validation import Array
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.compilation.loop_jacobian import LoopJacobian
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import Measured, measure_truly
from phcontrol.vision.scene import Scene

STEPS = (1e-4, 1e-5, 1e-6)
"""Of the differences, in natural units; for each column the best is taken."""
_ROUNDING = 1e-12  # of what is differentiated
_ACCURATE = 1e-8  # of the largest entry: an error below which no other step is tried


def best_jacobian(function: Callable[[Array], Array], point: Array, units: Array) -> tuple[Array, Array]:
    """Return ∂f/∂x at a point and the error of its entries, column by column that of the best step."""
    best, error = jacobian(function, point, units, STEPS[0])
    for step in STEPS[1:]:
        if error.max(initial=0.0) <= _ACCURATE * np.abs(best).max(initial=0.0):
            break
        now, difference = jacobian(function, point, units, step)
        nearer = difference.max(axis=0) < error.max(axis=0)
        best, error = np.where(nearer, now, best), np.where(nearer, difference, error)
    return best, error


def _bend(function: Callable[[Array], Array], point: Array, units: Array) -> float:
    """Return by how much slopes ahead and behind differ at most, beyond rounding."""
    natural = max(float(np.abs(function(there)).max(initial=0.0)) for there in (point, point + units))
    worst = 0.0
    for axis in np.diag(units):

        def along(h: float, axis: Array = axis) -> Array:
            return function(point + h * axis)

        change = slope_change(along, TINY)
        apart = float(np.abs(change).max(initial=0.0)) - _ROUNDING * natural / TINY
        worst = max(worst, apart / float(axis.max()))
    return worst


def differenced_loop(
    law: Controller, plant: MechanicalSystem, scene: Scene | None, y: Array, force: Array, units: NaturalUnits
) -> tuple[LoopJacobian, float]:
    """Return the derivatives of a closed loop at t = 0, and their largest error over the largest entry, part by part.

    Args:
        law: the law.
        plant: the arm.
        scene: what there is to see.
        y: (q, q̇, controller state).
        force: f_e [N·m].
        units: over which what is differentiated changes.
    """
    n, errors = plant.n, [0.0]

    def slope(function: Callable[[Array], Array], point: Array, scale: Array) -> Array:
        if not point.size:
            return np.zeros((len(function(point)), 0))
        found, error = best_jacobian(function, point, scale)
        largest = max(float(np.abs(found).max(initial=0.0)), 1e-12)
        errors.append(float(error.max(initial=0.0)) / largest)
        bend = _bend(function, point, scale)
        if bend > BEND * largest:  # a kink, of which central differences see nothing where it is even
            errors.append(bend / largest)
        return found

    def shown(moving: Array, outside: Array) -> Array:
        parts = measure_truly(plant.at(moving[:n], moving[n:]), outside, law.needs, scene)
        return np.concatenate([np.zeros(0), *(np.asarray(part) for part in parts if part is not None)])

    there = measure_truly(plant.at(y[:n], y[n : 2 * n]), force, law.needs, scene)
    sizes = [(name, np.size(part)) for name, part in zip(Measured._fields, there, strict=True) if part is not None]

    def command(own: Array, seen: Array) -> Array:
        ends = np.cumsum([size for _, size in sizes])[:-1]
        parts = np.split(seen, ends) if sizes else []
        measured = Measured(**dict(zip((name for name, _ in sizes), parts, strict=True)))
        torque, rate = law.evaluate(0.0, law.system.at(own[:n], own[n : 2 * n]), own[2 * n :], measured)
        return np.concatenate([torque, rate])

    moving, m = y[: 2 * n], shown(y[: 2 * n], force)
    torque = command(y, m)[:n]
    seen_units = {"features": np.ones(3)}
    m_units = np.concatenate([np.zeros(0), *(seen_units.get(name, units.force) for name, _ in sizes)])

    def acceleration(moving: Array, torque: Array, outside: Array) -> Array:
        return plant.at(moving[:n], moving[n:]).acceleration(torque, outside)

    scale, nothing = units.motion, np.zeros((n + y.size - 2 * n, 0))
    found = LoopJacobian(
        plant=slope(lambda there: acceleration(there, torque, force), moving, scale[: 2 * n]),
        plant_torque=slope(lambda there: acceleration(moving, there, force), torque, units.force),
        plant_force=slope(lambda there: acceleration(moving, torque, there), force, units.force),
        measured=slope(lambda there: shown(there, force), moving, scale[: 2 * n]),
        measured_force=slope(lambda there: shown(moving, there), force, units.force),
        law=slope(lambda there: command(there, m), y, scale),
        law_measured=slope(lambda there: command(y, there), m, m_units),
        law_time=np.zeros(len(nothing)),
        law_numbers=nothing,
        plant_inertias=np.zeros((n, 0)),
        measured_inertias=np.zeros((m.size, 0)),
    )
    return found, max(errors)
