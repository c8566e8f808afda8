"""States along the law's own motion: where arms really are."""

from __future__ import annotations

from typing import Any

import numpy as np

from phcontrol._validation import Array
from phcontrol.analysis.certificate import RUN_TOLERANCE
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.rest_point import RestPoint
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.state_sampler import clear_of_switches
from phcontrol.controllers.controller import Controller
from phcontrol.exceptions import ObjectLostError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.simulation.closed_loop import simulate
from phcontrol.simulation.log import Log
from phcontrol.simulation.simulation_error import SimulationError
from phcontrol.vision.scene import Scene

STATES = 12
"""That are taken from each run."""
_STEPS = 96
_REFINEMENTS = (1, 8, 64)  # of a step that is too long
_WILD = 30.0  # times the velocity limits
_HALF_TURN = 3.0  # but for the room of a step [rad]
_LEAST = 8  # samples of a run that is worth looking at
_LONGEST_STEP = 5e-3  # [s]
_STIFF = 0.5  # of the inverse of the fastest eigenvalue, for one step of the fourth-order method
_WAY = 0.5  # of a natural unit, at most, for the run from home
_AWAY = 0.3  # of a natural unit, for the run of one joint alone
_IN_VIEW = 0.02  # of a natural unit: how far a law with eyes is taken away from its goal, and loaded
_LITTLE = 1e-9  # of the motors' work over a natural unit: changes of H_d below that are rounding
_LOAD = 0.25  # of the motors' limits, for the run under load


def run_states(
    law: Controller, plant: MechanicalSystem, units: NaturalUnits, rest: RestPoint
) -> tuple[list[SampledState], list[Log]]:
    """Return states along short runs of the true closed loop, and the runs.

    From home (or near it, for a law whose goal is there) towards the goal; from the goal with the last joint alone
    away from it; and from the rest point under a constant load, or where the law is to rest under a force, under that.
    """
    fastest = float(np.abs(rest.eigenvalues).max(initial=0.0))
    dt = min(_LONGEST_STEP, _STIFF / max(fastest, 1e-300))
    goal = rest.position
    home, alone = plant.robot.home, goal.copy()
    scene = law.rest_scene(law.system.at(goal))
    if scene is None:
        away = home if np.abs(home - goal).max() > 0.05 else plant.robot.near_home()
        near = goal + np.clip(away - goal, -_WAY * units.position, _WAY * units.position)
        start = np.where(plant.robot.continuous, near, away)  # which of them all the way would wrap
        alone[-1] += _AWAY * units.position[-1]
    else:
        start = goal + _IN_VIEW * units.position
        alone[-1] += _IN_VIEW * units.position[-1]
    load = rest.force if rest.in_contact else (_LOAD if scene is None else _IN_VIEW) * units.force
    states, logs = [], []
    for name, position, force in (
        ("on the way from home", start, rest.force),
        ("the last joint on its way alone", alone, rest.force),
        ("under a load", goal, load),
    ):
        log = _run(law, plant, units, _STEPS, dt, position, rest.velocity, force, scene)
        logs.append(log)
        for k in np.linspace(0, len(log) - 1, STATES).astype(int):
            if (np.abs(log.velocity[k]) > _WILD * units.speed).any():
                break  # faster than any arm: nothing to be told there
            time = clear_of_switches(law, float(log.time[k]))
            states.append(
                SampledState(time, log.position[k], log.velocity[k], log.controller_state[k], force, scene, name)
            )
    return states, logs


def _run(
    law: Controller,
    plant: MechanicalSystem,
    units: NaturalUnits,
    steps: int,
    dt: float,
    position: Array,
    velocity: Array,
    force: Array,
    scene: Scene | None,
) -> Log:
    """Return a run; in shorter steps where the loop is faster on its way than where it rests.

    A law with eyes may lose its object: then the run up to there.
    """
    options: dict[str, Any] = {"disturbance": force, "scene": scene, "torque_limit": None, "progress": False}
    for refinement in _REFINEMENTS:
        last = refinement == _REFINEMENTS[-1]
        try:
            log = simulate(
                plant, law, duration=steps * dt, dt=dt / refinement, q0=position, v0=velocity, **options
            )  # fmt: skip
        except SimulationError as error:
            log = error.log
            if last and not (isinstance(error.__cause__, ObjectLostError) and len(log) > _LEAST):
                raise
            if not last:
                continue
        if last or balance_error(log, law, units) <= RUN_TOLERANCE:
            return log
    raise AssertionError


def balance_error(log: Log, law: Controller, units: NaturalUnits) -> float:
    """Return the largest |ΔH_d − ∫(supplied − dissipated + ∂H_d/∂t)dt| over two steps, over what flows and changes.

    The integral is Simpson's; a jump of H_d shows whole. ∂H_d/∂t, of a law that changes with time, is looked at where
    the rest does not balance without it. Up to where a continuous joint is half a turn from its goal,
    where its error wraps.
    """
    robot, goal = law.system.robot, law.rest_posture(float(log.time[0]))
    wraps = np.logical_and(np.abs(log.position - goal) > _HALF_TURN, robot.continuous)
    end = int(np.argmax(wraps.any(axis=1))) if wraps.any() else len(log)
    if end <= _LEAST:
        return 0.0
    error = _imbalance(log, (log.supplied_power - log.dissipated_power)[:end], units)
    if law.time_span and error > RUN_TOLERANCE:
        by_clock = 0.0 if log.aging_power is None else log.aging_power
        error = _imbalance(log, (log.supplied_power - log.dissipated_power + by_clock)[:end], units)
    return error


def _imbalance(log: Log, power: Array, units: NaturalUnits) -> float:
    """Return the largest |ΔH_d − ∫power dt| over two steps, over what flows and changes."""
    end = len(power)
    stored = log.storage[:end]
    step = float(log.time[1] - log.time[0])
    work = step / 3.0 * (power[:-2] + 4.0 * power[1:-1] + power[2:])
    error = np.abs(stored[2:] - stored[:-2] - work)
    flow = np.abs(log.supplied_power[:end]) + np.abs(log.dissipated_power[:end])
    floor = _LITTLE * float((units.force * units.position).max())
    return float(error.max() / max(float(np.ptp(stored)), 2.0 * step * float(flow.max()), floor))
