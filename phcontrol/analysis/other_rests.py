"""Where else than at its goal an arm may come to rest: other minima of H_d."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from phcontrol._validation import Array
from phcontrol.analysis.natural_units import NaturalUnits, is_prismatic
from phcontrol.analysis.rest_point import RestPoint
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.robot import wrapped
from phcontrol.mechanics.system import MechanicalSystem

DESCENTS = 8
"""From so many postures H_d is followed downhill."""
_BEND = 1e-2  # of a natural unit, over which curvatures at rest are taken
_STEP = 1e-5  # likewise, slopes on the way down
_STEPS = 60  # of a descent, at most
_APART = 1e-2  # of a natural unit: as near as that it is the same rest
_BEYOND = 0.1  # of its range, by how much a joint may be outside its limits
_HALF_TURN = 3.0  # natural units: where a joint has no limits
_FLAT = 1e-9  # of the largest curvature, below which a joint has none


class OtherRest(NamedTuple):
    """A posture at which H_d is smallest with the arm at rest, and is not the goal."""

    position: Array
    height: float
    """By how much H_d is higher than at the goal [J]."""


def other_rests(
    law: Controller, plant: MechanicalSystem, units: NaturalUnits, rest: RestPoint, seed: int
) -> list[OtherRest]:
    """Return other minima of H_d about the joint range, of a law whose goal is a posture, the deepest first.

    H_d of an arm at rest is followed downhill from a few postures all over the range, and looked at a turn away from
    the goal in each joint that is not continuous. What is narrow, or far from all of those, is not found; nor is a rest
    that friction or a limit makes, which H_d does not know.
    """
    from scipy.optimize import minimize  # loaded when it is needed

    at = SampledState(rest.time, rest.position, rest.velocity, rest.state, rest.force, None, "")
    seen = Seen.of(law, plant, at)

    def energy(position: Array) -> float:
        return seen.elsewhere(position=position).stored()

    goal, here, unit = rest.position, seen.stored(), units.position
    scale = _scales(energy, goal, here, unit)
    if not np.isfinite(scale).all():
        return []  # a storage function that is flat has no rest to compare with others
    low, high = _bounds(plant, goal, unit)
    steps = _STEP * np.diag(unit)

    def scaled(y: Array) -> tuple[float, Array]:
        position = goal + scale * y
        slopes = [(energy(position + step) - energy(position - step)) / (2.0 * _STEP) for step in steps]
        return energy(position) - here, scale / unit * np.array(slopes)

    limits = list(zip((low - goal) / scale, (high - goal) / scale, strict=True))
    found: list[OtherRest] = []
    for start in _starts(plant.n, low, high, seed):
        result = minimize(
            scaled, (start - goal) / scale, jac=True, method="L-BFGS-B", bounds=limits, options={"maxiter": _STEPS}
        )
        found.append(OtherRest(goal + scale * result.x, float(result.fun)))
    found += [OtherRest(turned, energy(turned) - here) for turned in _turned(plant, goal, low, high)]
    distinct: list[OtherRest] = []
    for each in sorted(found, key=lambda each: each.height):
        known = [goal, *(other.position for other in distinct)]
        if all(_apart(plant, each.position, other, unit) for other in known) and _is_lowest(
            energy, each.position, unit
        ):
            distinct.append(each)
    return distinct


def _scales(energy: Callable[[Array], float], goal: Array, here: float, unit: Array) -> Array:
    """Return by how much each joint moves for what H_d bends most there: so all joints' curvatures are 1 [√J]."""
    bends = _BEND * np.diag(unit)
    curvature = np.array([energy(goal + bend) + energy(goal - bend) - 2.0 * here for bend in bends]) / _BEND**2
    largest = float(np.abs(curvature).max())
    return unit / np.sqrt(np.maximum(curvature, _FLAT * largest)) if largest else np.full_like(unit, np.inf)


def _bounds(plant: MechanicalSystem, goal: Array, unit: Array) -> tuple[Array, Array]:
    """Return where to look: a little beyond the limits; where there are none half a turn about the goal."""
    robot = plant.robot
    limited = np.isfinite(robot.lower) & np.isfinite(robot.upper) & np.logical_not(robot.continuous)
    width = np.where(limited, robot.upper - robot.lower, 0.0)
    low = np.where(limited, robot.lower - _BEYOND * width, goal - _HALF_TURN * unit)
    high = np.where(limited, robot.upper + _BEYOND * width, goal + _HALF_TURN * unit)
    return np.minimum(low, goal), np.maximum(high, goal)


def _starts(n: int, low: Array, high: Array, seed: int) -> Array:
    """Return postures of which each joint's are spread evenly over its range, shape (DESCENTS, n)."""
    generator = np.random.default_rng(seed)
    places = np.stack([generator.permutation(DESCENTS) for _ in range(n)], axis=-1)
    starts: Array = low + (high - low) * (places + generator.uniform(size=places.shape)) / DESCENTS
    return starts


def _turned(plant: MechanicalSystem, goal: Array, low: Array, high: Array) -> Iterator[Array]:
    """Return the goal with one joint a whole turn on, where that is another posture and in the range."""
    for joint in np.flatnonzero(~np.logical_or(plant.robot.continuous, is_prismatic(plant.robot))):
        for turn in (-2.0 * np.pi, 2.0 * np.pi):
            if low[joint] <= goal[joint] + turn <= high[joint]:
                posture = goal.copy()
                posture[joint] += turn
                yield posture


def _apart(plant: MechanicalSystem, position: Array, other: Array, unit: Array) -> bool:
    away = np.where(plant.robot.continuous, wrapped(position - other), position - other)
    return bool(np.abs(away / unit).max() > _APART)


def _is_lowest(energy: Callable[[Array], float], position: Array, unit: Array) -> bool:
    """Return whether H_d is higher to either side in each joint: not where a limit alone ends the descent."""
    here = energy(position)
    return all(energy(position + side * bend) > here for bend in _APART * np.diag(unit) for side in (-1.0, 1.0))
