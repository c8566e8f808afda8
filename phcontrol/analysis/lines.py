"""Straight lines through states: between those that are looked at, and into the state where a law rests."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from phcontrol._validation import Array
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.rest_point import RestPoint
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.analysis.state_sampler import FIRST_TIME, reference_velocity
from phcontrol.analysis.worst import Worst
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.robot import wrapped
from phcontrol.mechanics.system import MechanicalSystem

_CHORDS, _POINTS, _COMMANDS = 24, 33, 2  # between states, energies on each, and every so manieth command
_RAYS, _FOR_JOINTS, _DISTANCES = 3, 8, 25  # into the rest point for each of so many joints, and distances on each
_NEAREST = 1e-6  # of these, in natural units
_NEAREST_SEEN = 1e-4  # likewise, of a law with eyes: its features have fewer digits
_SUSPECTS = 3  # intervals that are looked at more closely
_PARTS, _NARROWINGS = 8, 16  # of an interval, and how often it is narrowed to three of them
_HALVINGS = 24  # of an interval with a bend in it, as long as rounding is less than the bend
_NOISE = 1e-13  # of the largest H_d: how much it may be off by rounding
_JUMP = 1e-5  # of the range of H_d on a chord: a smooth H_d changes by 10⁻⁸ of it over so short an interval
_NEAR_JUMP = 1e-4  # of how far H_d is from its value at rest, on a ray
_ROUNDING = 1e-10  # of the largest H_d, below which such a difference is not taken for one
_CLOSE, _ABOVE_NOISE = 1e-2, 10.0  # to rest, on a ray; and how far above rounding a jump there must be
_PLACES, _ROUGH = (0.5, 0.7, 1.0, 1.4, 2.0), 12  # about it, where roughness is looked at, and in how many points
_BEND = 1e-2  # of the largest slope of H_d on a chord: by so much it changes at once where there is no gradient
_STATES_OF_LINES = 32  # that are added to those at which matching is looked at


class Line:
    """States on a straight line, given by the share of the way; time, f_e and what is measured stay as at its start.

    On a chord the shares are evenly spaced. On a ray, which ends in the rest point at 0, they are spaced by ratios, and
    what is seen is compared with what is there at 0: a small ball about the goal shows like a large one.
    """

    def __init__(self, start: Seen, change: SampledState, shares: Array, *, into_rest: bool, name: str) -> None:
        self._start, self._change = start, change
        self.shares, self.into_rest, self.name = shares, into_rest, name
        self._seen = [self._at(share) for share in shares]
        self.energies: Array = np.array([seen.stored() for seen in self._seen])
        self._rest = self._at(0.0)

    def _at(self, share: float) -> Seen:
        at, change = self._start.at, self._change
        return self._start.elsewhere(
            time=at.time + share * change.time,
            position=at.position + share * change.position,
            velocity=at.velocity + share * change.velocity,
            state=at.state + share * change.state,
        )

    def energy(self, share: float) -> float:
        """Return H_d at a share of the way [J]."""
        return self._at(share).stored()

    def jump(self) -> tuple[float, float]:
        """Return the largest jump of H_d, relative to its range (on a ray: to how far it is from rest), and where."""
        values = self.energies
        extent = float(np.ptp(values))
        if not extent > 0.0:
            return 0.0, 0.0
        steps = np.diff(values)
        if self.into_rest:
            away = np.maximum(np.abs(values - self._rest.stored()), _ROUNDING * float(np.abs(values).max()))
            units, least = np.maximum(away[:-1], away[1:]), _NEAR_JUMP
            steps = np.log(np.maximum(np.abs(steps), 1e-300))  # smooth in the logarithm of the distance
        else:
            units, least = np.full(len(steps), extent), _JUMP
        suspicion = np.zeros(len(steps))
        suspicion[1:-1] = np.abs(np.diff(steps, 2))
        worst, where = 0.0, 0.0
        for interval in np.argsort(suspicion)[-_SUSPECTS:]:
            size, share = self._jump_in(int(interval), least * float(units[interval]))
            if self.into_rest and 0.0 < share < _CLOSE and size <= _ABOVE_NOISE * self._noise_about(share):
                continue
            if size > worst * float(units[interval]):
                worst, where = size / float(units[interval]), share
        return worst, where

    def _noise_about(self, share: float) -> float:
        """Return how rough H_d is by rounding on a ray about a share of the way [J].

        k(1 − cos e) or k log cosh e are differences of numbers of the size of k, however small e is: of steps as high
        as their last digit. A jump is in one or two of some places; such roughness is in all.
        """
        places = share * np.array(_PLACES)
        shares = places[:, None] * np.linspace(0.85, 1.15, _ROUGH)
        values = np.array([[self.energy(float(each)) for each in row] for row in shares])
        left = np.linspace(-1.0, 1.0, _ROUGH)
        powers = np.vander(left, 4)
        smooth = powers @ np.linalg.lstsq(powers, values.T, rcond=None)[0]
        return float(np.median(np.abs(values.T - smooth).max(axis=0)))

    def _jump_in(self, interval: int, least: float) -> tuple[float, float]:
        """Return what is left of a jump of H_d in an interval that is narrowed and narrowed, 0 below ``least``.

        Where H_d is smooth its changes over equal parts have second differences that vanish with the third power of the
        width; a jump stays in them, whatever changes smoothly beside it.
        """
        low, high = float(self.shares[interval]), float(self.shares[interval + 1])
        at_low, at_high = float(self.energies[interval]), float(self.energies[interval + 1])
        steps = np.zeros(1)
        for _ in range(_NARROWINGS):
            shares = np.linspace(low, high, _PARTS + 1)
            values = np.array([at_low, *(self.energy(share) for share in shares[1:-1]), at_high])
            steps = np.diff(values)
            odd = np.abs(np.diff(steps, 2))
            k = int(np.argmax(odd))
            if odd[k] < least:
                return 0.0, low
            low, high = float(shares[k]), float(shares[k + 3])
            at_low, at_high = float(values[k]), float(values[k + 3])
        return float(np.abs(steps - np.median(steps)).max()), low

    def kink(self) -> tuple[float, float]:
        """Return by how much the slope of H_d changes at once, relative to its largest on this chord, and where."""
        values, spacing = self.energies, float(self.shares[1] - self.shares[0])
        steepest = float(np.abs(np.diff(values)).max()) / spacing
        if self.into_rest or self._change.time or not steepest > 0.0:  # what leads may turn at once
            return 0.0, 0.0
        bends = np.diff(values, 2)
        odd = np.abs(np.diff(bends, 2, prepend=bends[0], append=bends[-1]))
        worst, where = 0.0, 0.0
        for k in np.argsort(odd)[-_SUSPECTS + 1 :] + 1:
            change, share = self._kink_at(float(self.shares[k]), spacing, values[k - 1 : k + 2], _BEND * steepest)
            if change > worst * steepest:
                worst, where = change / steepest, share
        return worst, where

    def _kink_at(self, middle: float, step: float, values: Array, least: float) -> tuple[float, float]:
        """Return what is left of the change of the slope in an interval that is halved, 0 below ``least``.

        Close to a singularity a smooth H_d bends within 10⁻⁵ of a chord: what halves with the interval is no kink.
        """
        before, here, after = map(float, values)
        change, noise = math.inf, _NOISE * float(np.abs(self.energies).max())
        for _ in range(_HALVINGS):
            step *= 0.5
            if noise > 0.1 * least * step:
                break
            left, right = self.energy(middle - step), self.energy(middle + step)
            thirds = ((before, left, here), (left, here, right), (here, right, after))
            bent = [abs(a - 2.0 * b + c) for a, b, c in thirds]
            which = int(np.argmax(bent))
            before, here, after = thirds[which]
            middle, change = middle + (which - 1) * step, bent[which] / step
            if change < least:
                return 0.0, middle
        return change, middle

    def oddest(self) -> tuple[float, list[SampledState]]:
        """Return how odd the command is where it is oddest on this line, and the two states where that is.

        It is smooth where a law is right, but for switches. Its fourth differences, relative to its range, show where
        it is another one at a single point, or on one side of it; a ray's are those of (u − u_rest) over the distance.
        """
        step = 1 if self.into_rest else _COMMANDS
        chosen = self._seen[::step]
        commands = np.stack([np.concatenate(seen.command()) for seen in chosen])
        if self.into_rest:
            commands = (commands - np.concatenate(self._rest.command())) / self.shares[:, None]
        extent = np.ptp(commands, axis=0)
        moving = extent > _ROUNDING * np.abs(commands).max(axis=0)
        if not moving.any():
            return 0.0, []
        odd = np.abs(np.diff(commands[:, moving] / extent[moving], 4, axis=0)).max(axis=1)
        order = np.argsort(odd)[::-1][:2]
        return float(odd[order[0]]), [chosen[k + 2].at._replace(stratum=f"oddest on {self.name}") for k in order]


def lines_of(
    law: Controller, plant: MechanicalSystem, units: NaturalUnits, rest: RestPoint, states: Sequence[SampledState]
) -> list[Line]:
    """Return chords between states, and rays into the rest point.

    Of a law that changes every second chord runs through time, within one phase; on a continuous joint they stay within
    half a turn of its goal, where its error wraps. Rays come from each joint alone, from two alone and from all; at
    rest, towards rest and away from it, and through it at some speed.
    """
    share = min(1.0, 10.0 / plant.n)
    chords, rays = max(4, int(_CHORDS * share)), _RAYS * min(plant.n, _FOR_JOINTS)
    pairs = zip(states[: 2 * chords : 2], states[1 : 2 * chords : 2], strict=False)
    return [
        *(_chord(law, plant, *pair, later=bool(k % 2)) for k, pair in enumerate(pairs)),
        *_rays(law, plant, units, rest, min(rays, len(states) // 4)),
    ]


def largest_jump(lines: Sequence[Line]) -> Worst:
    """Return the largest jump of H_d on lines, relative to its range there, and where.

    A law whose gains or goal switch keeps its promise on either side of every switch, and lets H_d jump at it.
    """
    return _worst((line, *line.jump()) for line in lines)


def largest_kink(lines: Sequence[Line]) -> Worst:
    """Return the largest change of H_d's slope at a point, relative to the largest slope on that line, and where.

    There H_d has no gradient and the torque jumps: as where an error is folded at half a turn of a joint that has ends.
    """
    return _worst((line, *line.kink()) for line in lines)


def odd_states(lines: Sequence[Line]) -> list[SampledState]:
    """Return states on lines at which the command is not smooth: what a law does wrong in a thin set is there."""
    found = sorted((line.oddest() for line in lines), key=lambda each: -each[0])
    return [at for _, states in found for at in states][: min(_STATES_OF_LINES, len(lines))]


def _worst(found: Iterator[tuple[Line, float, float]]) -> Worst:
    return Worst.of((size, f"{share:.3g} of the way {line.name}") for line, size, share in found)


def _chord(law: Controller, plant: MechanicalSystem, start: SampledState, end: SampledState, *, later: bool) -> Line:
    goal, continuous = law.rest_posture(start.time), plant.robot.continuous
    first = np.where(continuous, goal + 0.99 * wrapped(start.position - goal), start.position)
    last = np.where(continuous, goal + 0.99 * wrapped(end.position - goal), end.position)
    same_phase = bisect_right(law.phases, start.time) == bisect_right(law.phases, end.time)
    change = end._replace(
        time=end.time - start.time if later and same_phase and law.time_span else 0.0,
        position=last - first,
        velocity=end.velocity - start.velocity,
        state=end.state - start.state,
    )
    seen = Seen.of(law, plant, start._replace(position=first))
    name = f"from {start.stratum or 'anywhere'} to {end.stratum or 'anywhere'}"
    return Line(seen, change, np.linspace(0.0, 1.0, _POINTS), into_rest=False, name=name)


def _rays(law: Controller, plant: MechanicalSystem, units: NaturalUnits, rest: RestPoint, count: int) -> Iterator[Line]:
    n, generator = plant.n, np.random.default_rng(0)
    time, goal, still = rest.time, rest.position, rest.velocity
    if law.time_span:  # matching takes differences in time
        time = max(time, FIRST_TIME)
        goal, still = np.array(law.rest_posture(time)), reference_velocity(law, time)
    scene = law.rest_scene(law.system.at(goal))
    nearest, farthest = (_NEAREST, 1.0) if scene is None else (_NEAREST_SEEN, 1e-2)
    some = list(combinations(range(n), 2))
    generator.shuffle(some)
    for k in range(count):
        direction = generator.uniform(-1.0, 1.0, n)
        which = {0: (k // 3 % n,), 1: some[k // 3 % len(some)] if some else (0,)}.get(k % 3, tuple(range(n)))
        alone = np.isin(np.arange(n), which)
        direction = np.where(alone, np.copysign(np.maximum(np.abs(direction), 0.2), direction), 0.0)
        moving, through = (0.0, -1.0, 1.0, 0.3)[k % 4], k % 8 == 5
        aside = generator.uniform(-1.0, 1.0, n) if through else direction
        velocity = moving * units.speed * aside
        charged = (k % 2) * generator.uniform(-1.0, 1.0, units.state.size) * units.state
        begun = still + velocity if through else still
        at = SampledState(time, goal, begun, rest.state, rest.force, scene, "")
        change = at._replace(
            time=0.0,
            position=direction * units.position,
            velocity=np.zeros(n) if through else velocity,
            state=charged,
        )
        ratio = (farthest / nearest) ** (1.0 / (_DISTANCES - 1))
        shares = np.geomspace(nearest, farthest, _DISTANCES) / ratio ** (k / max(count, 1))  # none at the same distance
        joints = (
            "all joints"
            if len(which) == n
            else f"joint{'s' * (len(which) > 1)} " + " and ".join(str(j + 1) for j in sorted(which))
        )
        yield Line(Seen.of(law, plant, at), change, shares, into_rest=True, name=f"from the rest point, {joints} away")
