"""What a promise may not depend on: the time, if the law says so; the force that it is a promise under; the drive."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from phcontrol._validation import Array
from phcontrol.analysis.promise import Promise
from phcontrol.analysis.purity import slowness
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen, largest_difference
from phcontrol.analysis.state_sampler import some
from phcontrol.analysis.worst import Worst
from phcontrol.controllers.answers import stored
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.system import MechanicalSystem

_STATES = 12
_TIMES = np.geomspace(1e-3, 1e5, 81)  # ten a decade: none is left out for long [s]
_WINDOWS = np.linspace(0.0, 60.0, 1501)  # the command alone, in the first minute every 40 ms [s]
_ASIDE = 1e-3  # of a force, by which it is changed for a law that may switch with it


def change_with_time(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> Worst:
    """Return by how much a law that says it does not change differs at other times, and where.

    Looked at are command, promise and postures at some states, and the command at one of them every 40 ms of a minute.
    """
    return Worst(0.0, "") if law.time_span else Worst.of(_changes_with_time(law, plant, states))


def _changes_with_time(
    law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]
) -> Iterator[tuple[float, str]]:
    chosen = some(states, _STATES, plant.n)
    times = [*(at.time for at in states), *_TIMES]
    for k, at in enumerate(chosen):
        here = Seen.of(law, plant, at)
        said = _everything(here)
        for time in times[k :: len(chosen)]:
            yield largest_difference(said, _everything(here, time)), f"t = {time:.4g} s against {at.time:.4g} s"
    at = chosen[0]
    here = Seen.of(law, plant, at)
    command = here.command()
    for time in _WINDOWS[:: slowness(law)]:
        difference = largest_difference(command, law.evaluate(float(time), here.view, at.state, here.measured))
        yield difference, f"t = {time:.4g} s against {at.time:.4g} s"


def change_with_force(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> Worst:
    """Return by how much J, R, ∇H_d, port, coordinates and H_d change with the measured force at the same state.

    f_e enters a promise through its port and nowhere else. A law that something drives may switch where there is
    contact; then only a small change of the force is tried.
    """
    generator = np.random.default_rng(0)

    def change(at: SampledState, other: SampledState) -> float:
        if law.driven_by:
            force = at.force + _ASIDE * np.abs(at.force).max() * generator.uniform(-1.0, 1.0, len(at.force))
        else:
            force = other.force
        moved = Seen.of(law, plant, at._replace(force=force))
        return largest_difference(_promised(Seen.of(law, plant, at)), _promised(moved))

    return Worst.of((change(at, other), at.stratum) for at, other in _pairs(states, plant.n))


def change_of_drive(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> Worst:
    """Return by how much what drives the law changes with what it must not depend on, and where.

    With time and measurements held, its signal does not change with the state of arm or controller. Its port may
    depend on q, as that of f_e does, and neither on q̇, nor on the controller's state, nor on the force: else any
    vector field could be called a drive. Where a force is felt a drive may end (``ForceControl`` in approach).
    """

    def change(at: SampledState, other: SampledState) -> float:
        here = Seen.of(law, plant, at)
        drive = here.promise()
        moving = here.elsewhere(velocity=other.velocity, state=other.state)
        anywhere = here.elsewhere(position=other.position, velocity=other.velocity, state=other.state).promise()
        felt = Seen.of(law, plant, at._replace(force=other.force)).promise()
        ports = [drive.drive_port], [felt.drive_port]
        return max(
            largest_difference(_drive(drive), _drive(moving.promise())),
            largest_difference([drive.signal], [anywhere.signal]),
            largest_difference(*ports) if drive.signal.size and felt.signal.size else 0.0,
        )

    return Worst.of((change(at, other), at.stratum) for at, other in _pairs(states, plant.n))


def _pairs(states: Sequence[SampledState], n: int) -> Iterator[tuple[SampledState, SampledState]]:
    """Return some states, each with another one."""
    return zip(some(states, _STATES, n), some(states[1:], _STATES, n), strict=False)


def _drive(promise: Promise) -> list[Array]:
    return [promise.drive_port, promise.signal]


def _promised(seen: Seen) -> list[Array]:
    target = seen.promise()
    return [np.array([seen.stored()]), target.coordinates, target.J, target.R, target.gradient, target.port]


def _everything(seen: Seen, time: float | None = None) -> list[Array]:
    """Return all that a law says at a state, or at another time with the same view of it."""
    law, at = seen.law, seen.at if time is None else seen.at._replace(time=time)
    asked = at.time, seen.view, at.state, seen.measured
    command, target = law.evaluate(*asked), Promise.of(law.target(*asked), seen.view.system.n)
    postures = law.rest_posture(at.time), law.target_posture(at.time), law.desired_posture(at.time, at.state)
    return [
        command.torque, command.state_rate, np.array([stored(law, *asked)]),
        target.coordinates, target.J, target.R, target.gradient, target.port,
        *(np.zeros(0) if posture is None else np.asarray(posture, dtype=float) for posture in postures),
    ]  # fmt: skip
