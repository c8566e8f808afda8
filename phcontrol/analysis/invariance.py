"""What a promise may not depend on: the time, if the law says so; the force that it is a promise under; the drive."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phcontrol._validation import Array
from phcontrol.analysis.promise import Promise
from phcontrol.analysis.state_sampler import SampledState, some
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import Measured, measure_truly

_STATES = 12
_ASIDE = 1e-3  # of a force, by which it is changed for a law that may switch with it


def change_with_time(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> tuple[float, str]:
    """Return by how much command and promise of a law that says it does not change differ at other states' times."""
    if law.time_span:
        return 0.0, ""
    chosen = some(states, _STATES, plant.n)
    times = [at.time for at in states]
    worst, where = 0.0, ""
    for k, at in enumerate(chosen):
        here = _everything(law, plant, at, at.time)
        for time in times[k :: len(chosen)]:
            difference = _difference(here, _everything(law, plant, at, time))
            if not difference <= worst:
                worst, where = difference, f"t = {time:.4g} s against {at.time:.4g} s"
    return worst, where


def change_with_force(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> tuple[float, str]:
    """Return by how much J, R, ∇H_d, port, coordinates and H_d change with the measured force at the same state.

    f_e enters a promise through its port and nowhere else. A law that something drives may switch where there is
    contact; then only a small change of the force is tried.
    """
    worst, where = 0.0, ""
    generator = np.random.default_rng(0)
    for at, other in zip(some(states, _STATES, plant.n), some(states[1:], _STATES, plant.n), strict=False):
        if law.driven_by:
            force = at.force + _ASIDE * np.abs(at.force).max() * generator.uniform(-1.0, 1.0, len(at.force))
        else:
            force = other.force
        moved = at._replace(force=force)
        difference = _difference(_promised(law, plant, at), _promised(law, plant, moved))
        if not difference <= worst:
            worst, where = difference, at.stratum
    return worst, where


def signal_depends_on_state(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> bool:
    """Return whether what drives the law changes with the state of arm or controller, time and measurements held."""
    for here, there in zip(some(states, _STATES, plant.n), some(states[1:], _STATES, plant.n), strict=False):
        measured = _measured(law, plant, here)
        own = law.target(here.time, law.system.at(here.position, here.velocity), here.state, measured)
        other = law.target(here.time, law.system.at(there.position, there.velocity), there.state, measured)
        if not np.array_equal(Promise.of(own, plant.n).signal, Promise.of(other, plant.n).signal):
            return True
    return False


def _measured(law: Controller, plant: MechanicalSystem, at: SampledState) -> Measured:
    return measure_truly(plant.at(at.position, at.velocity), at.force, law.needs, at.scene)


def _promised(law: Controller, plant: MechanicalSystem, at: SampledState) -> list[Array]:
    view, measured = law.system.at(at.position, at.velocity), _measured(law, plant, at)
    target = Promise.of(law.target(at.time, view, at.state, measured), plant.n)
    storage = law.storage(at.time, view, at.state, measured)
    return [np.array([storage]), target.coordinates, target.J, target.R, target.gradient, target.port]


def _everything(law: Controller, plant: MechanicalSystem, at: SampledState, time: float) -> list[Array]:
    command = law.evaluate(time, law.system.at(at.position, at.velocity), at.state, _measured(law, plant, at))
    return [command.torque, command.state_rate, *_promised(law, plant, at._replace(time=time))]


def _difference(before: Sequence[Array], after: Sequence[Array]) -> float:
    """Return the largest difference of two lists of arrays, each relative to its own size."""
    worst = 0.0
    for a, b in zip(before, after, strict=True):
        if a.shape != b.shape:
            return np.inf
        scale = float(np.abs(a).max(initial=0.0)) or 1.0
        difference = float(np.abs(b - a).max(initial=0.0)) / scale
        worst = max(worst, np.inf if np.isnan(difference) else difference)
    return worst
