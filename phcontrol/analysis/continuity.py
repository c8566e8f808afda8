"""Whether H_d jumps somewhere between the states that are looked at."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence

import numpy as np

from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.rest_point import RestPoint
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.analysis.state_sampler import some
from phcontrol.analysis.worst import Worst
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.robot import wrapped
from phcontrol.mechanics.system import MechanicalSystem

_FAR, _LOOKS = 1.5, 65  # from rest, in natural units, and how often on each line
_CHORDS = 24
_BESIDE = 1e-9  # a half turn [rad]
_SAME = 1e-6  # of H_d: what it changes by on that way without a jump
_HANDED_OVER, _LEAST_HANDED_OVER = 128, 4  # states at which laws hand over to the next, all and at each switch
_POINTS = 33  # on a chord
_SUSPECTS = 3  # intervals that are looked at more closely
_HALVINGS = 24
_JUMP = 1e-5  # of the range of H_d on the chord: a smooth H_d changes by 10⁻⁸ of it over so short an interval


def largest_jump(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> Worst:
    """Return the largest jump of H_d on straight lines between states, relative to its range there, and where.

    A law whose gains or goal switch keeps its promise on either side of every switch, and lets H_d jump at it. Lines
    run through positions, velocities, controller states and time, within one phase of the law and under one force; on
    a continuous joint they stay within half a turn of its goal, where its error wraps.
    """

    def jump(start: SampledState, end: SampledState) -> tuple[float, str]:
        size, share = _jump_on(_along(law, plant, start, end))
        return size, f"{share:.3f} of the way from {start.stratum} to {end.stratum}"

    return Worst.of(map(jump, states[: 2 * _CHORDS : 2], states[1 : 2 * _CHORDS : 2]))


def jump_at_switches(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> float | None:
    """Return the largest |change of H_d| where another law takes over, at some of the states [J]; None without one.

    The new law acts from its start on, the old one until just before it, in the same state of arm and controller.
    """
    if len(law.phases) < 2:
        return None
    changes = []
    switches = law.phases[1:]
    for at in some(states, max(_LEAST_HANDED_OVER, _HANDED_OVER // len(switches)), plant.n):
        here = Seen.of(law, plant, at)
        for start in switches:
            before = here.elsewhere(time=float(np.nextafter(start, 0.0)))
            changes.append(abs(here.elsewhere(time=start).stored() - before.stored()))
    return max(changes)


def jump_at_half_turns(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> float | None:
    """Return the largest jump of H_d where a continuous joint is half a turn from its goal [J]; None for none.

    Errors are wrapped to (−π, π] there. A spring that couples such a joint with others stores more on one side.
    """
    if not plant.robot.continuous.any():
        return None
    jumps = [0.0]
    for at in some(states, _HANDED_OVER, plant.n):
        here, goal = Seen.of(law, plant, at), law.rest_posture(at.time)
        for joint in np.flatnonzero(plant.robot.continuous):
            sides = []
            for side in (-1.0, 1.0):
                position = np.array(at.position)
                position[joint] = goal[joint] + side * (np.pi - _BESIDE)
                sides.append(here.elsewhere(position=position).stored())
            if abs(sides[1] - sides[0]) > _SAME * max(abs(sides[0]), abs(sides[1])):
                jumps.append(abs(sides[1] - sides[0]))
    return max(jumps) or None


def depth_around(law: Controller, plant: MechanicalSystem, units: NaturalUnits, rest: RestPoint) -> float:
    """Return by how much H_d lies below its value at rest somewhere near, with the arm at rest too [J]; it must not.

    Looked at are lines through the rest point along each joint and in other directions, 1.5 rad far.
    """
    scene = law.rest_scene(law.system.at(rest.position))
    at = SampledState(rest.time, rest.position, rest.velocity, rest.state, rest.force, scene, "")
    here, generator, n = Seen.of(law, plant, at), np.random.default_rng(0), plant.n
    directions = [*np.eye(n), *generator.uniform(-1.0, 1.0, size=(n, n))]
    lowest = min(
        here.elsewhere(position=rest.position + share * units.position * direction).stored()
        for direction in directions
        for share in np.linspace(-_FAR, _FAR, _LOOKS)
    )
    return here.stored() - lowest


def _along(
    law: Controller, plant: MechanicalSystem, start: SampledState, end: SampledState
) -> Callable[[float], float]:
    """Return H_d as a function of the share of the way from one state to another."""
    goal = law.rest_posture(start.time)
    continuous = plant.robot.continuous
    first = np.where(continuous, goal + 0.99 * wrapped(start.position - goal), start.position)
    last = np.where(continuous, goal + 0.99 * wrapped(end.position - goal), end.position)
    same_phase = bisect_right(law.phases, start.time) == bisect_right(law.phases, end.time)
    later = end.time if same_phase and law.time_span else start.time
    seen = Seen.of(law, plant, start._replace(position=first))

    def energy(share: float) -> float:
        return seen.elsewhere(
            time=start.time + share * (later - start.time),
            position=first + share * (last - first),
            velocity=start.velocity + share * (end.velocity - start.velocity),
            state=start.state + share * (end.state - start.state),
        ).stored()

    return energy


def _jump_on(energy: Callable[[float], float]) -> tuple[float, float]:
    """Return the largest jump of a function on [0, 1] relative to its range, and where: by halving suspects."""
    shares = np.linspace(0.0, 1.0, _POINTS)
    values = np.array([energy(share) for share in shares])
    extent = float(values.max() - values.min())
    if not extent > 0.0:
        return 0.0, 0.0
    bends = np.abs(np.diff(np.diff(values), prepend=0.0, append=0.0))
    suspicion = np.maximum(bends[:-1], bends[1:])
    worst, where = 0.0, 0.0
    for interval in np.argsort(suspicion)[-_SUSPECTS:]:
        low, high = float(shares[interval]), float(shares[interval + 1])
        at_low, at_high = float(values[interval]), float(values[interval + 1])
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            at_middle = energy(middle)
            if abs(at_middle - at_low) > abs(at_high - at_middle):
                high, at_high = middle, at_middle
            else:
                low, at_low = middle, at_middle
            if abs(at_high - at_low) < _JUMP * extent:
                break
        jump = abs(at_high - at_low) / extent
        if jump >= _JUMP and jump > worst:
            worst, where = jump, low
    return worst, where
