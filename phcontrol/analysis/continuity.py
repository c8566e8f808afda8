"""Where H_d may jump, and whether it is lower beside its rest than there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.rest_point import RestPoint
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.analysis.state_sampler import some
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.system import MechanicalSystem

_FAR, _LOOKS = 1.5, 65  # from rest, in natural units, and how often on each line
_BESIDE = 1e-9  # a half turn [rad]
_SAME = 1e-6  # of H_d: what it changes by on that way without a jump
_HANDED_OVER, _LEAST_HANDED_OVER = 128, 4  # states at which laws hand over to the next, all and at each switch


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
