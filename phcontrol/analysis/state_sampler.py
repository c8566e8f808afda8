"""At which states a certificate looks: stratified, low-discrepancy, reproducible."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from phcontrol._interrupts import uninterrupted
from phcontrol._validation import Array, number
from phcontrol.analysis.empty_scene import EmptyScene
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.analysis.thin_states import ThinStates
from phcontrol.controllers.aging import within_phase
from phcontrol.controllers.controller import Controller
from phcontrol.exceptions import ObjectLostError
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.vision.scene import Scene

CLOSEST = 1e-6
"""The smallest distance, speed, force and controller state that is drawn, in natural units."""
_FASTEST = 10.0  # at least this speed is tried [rad/s], and at least four times the limits
LARGEST_STATE = 30.0
"""Of the controller, in natural units."""
_LATEST = 1e5  # [s]
_SPANS, _LOOKS = 6.0, 96  # over how many spans, and how often, a law is looked at that may go on changing
_LATEST_SPANS = 200.0  # of a law that changes with time: later ones leave no digits for differences in time
_USUAL_SPAN = 60.0  # of the times for a law that does not change with time [s]
FIRST_TIME = 5e-3
"""At which a law that changes with time is looked at: differences in time need room on both sides [s]."""
_BESIDE_SWITCHES, _SWITCHES = (1e-3, 1e-4, 1e-5), 24  # from a time at which a law may change [s]; states there, at most
_TURNS = 3.0  # of a continuous joint
_FAR = 1.5  # from the goal, with other joints at it, in natural units
_AROUND = 0.1  # home, and the straight way from there to the goal, in natural units
_BEYOND = 0.1  # how far outside its limits a joint is tried, of its range
_SELECTORS = 12  # leading dimensions that choose the kind of state, and sizes
_THIN, _CLOSE = 4, 6  # a quarter as many states are added on thin sets, a sixth close to rest
_EVEN = ("at limits", "anywhere", "beyond limits", "speeds")  # strata with a sequence of their own
_TOGETHER = 0.93  # of the sizes, above which all joints are on a limit
_ALONE, _SOME = 0.25, 0.4  # of the vectors have one entry alone, and one or a few
_LARGEST = 0.6  # entries of a direction that are above this are some
_CALM = 0.25  # of the choices of a controller state, up to which, from 0.2, it is the calmest one
_UNSEEN = 0.1  # of the states of a law with eyes there is nothing to see


class StateSampler:
    """Draws states where laws work and where they go wrong: at rest, at the goal, at the limits, fast, far.

    Every field is drawn by itself from its own strata, so that all combinations occur:

    - positions: the law's goal itself, within 1e-6 to 1 rad of it, about home and the way from there to the goal, on
      the joint limits and a little to either side of them, anywhere within them (all joints alike, too), and beyond
      (several turns of a continuous joint);
    - velocities: rest, the reference's own, 1e-6 to once the velocity limits away from either, up to twice the limits,
      and up to 10 rad/s or more;
    - states of the controller: zero, the calmest one, 1e-6 to 30 natural units, one entry alone;
    - external forces: zero or the one under which the law rests, tiny to twice the motors' limits away from either, on
      one joint alone, or a force on the tool, in any direction, upright or level;
    - what is seen: an object as the law's ``random_scene`` draws it, or nothing (features that are NaN), where the law
      does not refuse that by ObjectLostError;
    - times: the start and the whole of each phase of the law (a minute if it does not change), and later ones: up to
      1e5 s, or 200 times its span.

    To them a quarter as many are added on thin sets (``ThinStates``), which those do not hit: with one coordinate alone
    away from rest, with neighbouring joints alone, with p̂ = 0, at rest under a load; and a sixth as many close to rest.

    The numbers are scrambled Sobol sequences (:mod:`scipy.stats.qmc`), which leave no gaps in any single coordinate:
    one that chooses, and one more for each stratum that fills a range of positions or speeds, since a part of a
    sequence has gaps. Seed and number of samples make them reproducible. The first state is the law's rest point.

    Args:
        law: gives the goal, the size of its state, and what there is to see.
        plant: gives limits.
        units: of both.
        rest: position, velocity and controller state at which the law rests at time 0.
        rest_force: the external force there [N·m].
    """

    def __init__(
        self,
        law: Controller,
        plant: MechanicalSystem,
        units: NaturalUnits,
        rest: tuple[Array, Array, Array],
        rest_force: Array,
    ) -> None:
        self._law, self._plant, self._units = law, plant, units
        self._rest, self._rest_force = rest, rest_force
        self._span = true_span(law)
        self._changes = self._span > 0.0
        self._generator = np.random.default_rng(0)
        self._even: dict[str, Iterator[Array]] = {}
        self._thin = ThinStates(law, plant, units, self._look)

    def draw(self, samples: int, seed: int) -> list[SampledState]:
        """Return a number of states, and those on thin sets after them."""
        from scipy.stats import qmc  # loads a third of SciPy: only when a certificate is made

        n, m = self._plant.n, self._units.state.size
        with uninterrupted():
            sequence = qmc.Sobol(_SELECTORS + 5 * n + m, seed=seed)
        power = math.ceil(math.log2(samples))
        points = sequence.random_base2(power)[:samples]
        for which, stratum in enumerate(_EVEN, start=1):
            self._even[stratum] = iter(qmc.Sobol(n, seed=np.random.default_rng([seed, which])).random_base2(power))
        states, thin = [], samples // _THIN
        for k, point in enumerate(points):
            self._generator = np.random.default_rng([seed, k])
            states.append(self._state(point))
        states += [self._thin_state(k, thin, point) for k, point in enumerate(points[:thin])]
        for k, point in enumerate(points[: samples // _CLOSE]):
            rest, numbers = self._about(point)
            states.append(self._thin.approaching(k, rest, numbers))
        position, velocity, state = self._rest
        scene = self._law.rest_scene(self._law.system.at(position))
        time = FIRST_TIME if self._changes else 0.0
        if not self._changes or not velocity.any():
            states[0] = SampledState(time, position, velocity, state, self._rest_force, scene, "the rest point")
        return states

    def _look(self, position: Array, spread: float = CLOSEST) -> Scene | None:
        """Return something to see from a position."""
        eyes = self._law.eyes
        return None if eyes is None else eyes.random_scene(self._law.system.at(position), self._generator, spread)

    def _thin_state(self, k: int, count: int, u: Array) -> SampledState:
        """Return one of a number of states on thin sets, about the rest posture of some time."""
        rest, numbers = self._about(u)
        return self._thin.state(k, count, rest, numbers)

    def _about(self, u: Array) -> tuple[SampledState, Array]:
        """Return the rest posture of some time, and numbers between 0 and 1 to go away from it by.

        For a law that does not change it is time 0, that of the rest point: so states about it differ from it in one
        argument alone, and what a law remembers under the others shows.
        """
        n = self._plant.n
        time = clear_of_switches(self._law, self._time(u[0], u[6])) if self._changes else 0.0
        goal = np.array(self._law.rest_posture(time)) if self._changes else self._rest[0]
        scene = self._law.rest_scene(self._law.system.at(goal))
        velocity = reference_velocity(self._law, time)
        rest = SampledState(time, goal, velocity, self._rest[2], self._rest_force, scene, "")
        return rest, np.delete(u[_SELECTORS:], np.s_[2 * n : 5 * n])

    def _state(self, u: Array) -> SampledState:
        n = self._plant.n
        kinds, sizes = u[:6], u[6:_SELECTORS]
        along, aside, across, speeds, forces, own = np.split(u[_SELECTORS:], [n, 2 * n, 3 * n, 4 * n, 5 * n])
        time = clear_of_switches(self._law, self._time(kinds[0], sizes[0]))
        position, where = self._position(kinds[1], sizes[1], time, along, aside, across)
        velocity, how_fast = self._velocity(kinds[2], sizes[2], time, speeds)
        state, how_charged = _drawn(kinds[3], sizes[3], own, self._units.state, LARGEST_STATE, "controller state")
        if state.size and 0.2 <= kinds[3] < _CALM:  # where filters lead it to
            moving = self._law.system.at(position, velocity)
            state, how_charged = np.array(self._law.calmest_state(time, moving, state)), "calmest controller state"
        force, how_pushed = _drawn(kinds[4], sizes[4], forces, self._units.force, 2.0, "f_e")
        if kinds[4] > 0.85:
            force = self._on_tool(position, force, sizes[5] * 6.0 if kinds[4] > 0.91 else None)
        elif kinds[5] < 0.5 and self._rest_force.any():
            force, how_pushed = force + self._rest_force, how_pushed and "f_e as at rest"
        scene = self._look(position, 1.0 if kinds[5] < 0.5 else _log_uniform(sizes[5], CLOSEST, 1.0))
        stratum = ", ".join(word for word in (where, how_fast, how_charged, how_pushed) if word)
        at = SampledState(time, position, velocity, state, force, scene, stratum)
        return at if scene is None or self._generator.uniform() >= _UNSEEN else self._blind(at)

    def _blind(self, at: SampledState) -> SampledState:
        """Return a state with nothing to see, or as it is where the law refuses that."""
        blind = at._replace(scene=EmptyScene(), stratum=f"{at.stratum}, nothing to see".removeprefix(", "))
        try:
            Seen.of(self._law, self._plant, blind).command()
        except ObjectLostError:
            return at
        return blind

    def _time(self, kind: float, size: float) -> float:
        """Return a time: the start of a phase, within a phase, or any, on a logarithmic scale."""
        starts, span = self._law.phases, self._span
        if not self._changes:
            return 0.0 if kind < 0.125 else size * _USUAL_SPAN if kind < 0.75 else _log_uniform(size, 1e-3, _LATEST)
        phase = min(int(size * len(starts)), len(starts) - 1)
        start, within = starts[phase], size * len(starts) - phase
        if kind < 0.125:
            return start
        if kind < 0.75:
            end = starts[phase + 1] if phase + 1 < len(starts) else max(1.25 * span, start + 1.0)
            return start + within * (end - start)
        return _log_uniform(size, FIRST_TIME, max(_LATEST_SPANS * span, 1.0))

    def _position(
        self, kind: float, size: float, time: float, along: Array, aside: Array, across: Array
    ) -> tuple[Array, str]:
        robot, unit = self._plant.robot, self._units.position
        goal = self._law.rest_posture(time) if self._changes else self._rest[0]
        low, high = _range(robot)
        if kind < 0.04:
            return np.array(goal), "at the goal"
        if kind < 0.18:
            return goal + _log_uniform(size, CLOSEST, 1.0) * unit * (2.0 * along - 1.0), "near the goal"
        if kind < 0.26:  # some joints, or one alone
            return goal + _FAR * unit * _thinned(2.0 * along - 1.0, size, aside), "some joints at the goal"
        if kind < 0.36:  # where arms start, and on their way
            start = robot.home if kind < 0.34 else np.zeros(along.size)
            share = size if kind < 0.3 else 0.0
            return start + share * (goal - start) + _AROUND * unit * (2.0 * along - 1.0), "near home"
        if kind < 0.6:
            between = low + (high - low) * next(self._even["at limits"])
            return self._at_limits(between, size, aside, across), "at joint limits"
        if kind < 0.88:
            return low + (high - low) * next(self._even["anywhere"]), ""
        if kind < 0.9:
            return low + (high - low) * size, "all joints alike"
        beyond = np.where(robot.continuous, _TURNS * 2.0 * np.pi * unit, _BEYOND * (high - low))
        return low - beyond + (high - low + 2.0 * beyond) * next(self._even["beyond limits"]), "beyond joint limits"

    def _on_tool(self, position: Array, force: Array, axis: float | None) -> Array:
        """Return 𝒥ᵀF of a force at the tool's origin that takes about as much of the motors as ``force`` does.

        Its direction is that of ``force``, or one of the world's axes: upright for an ``axis`` below 4, else level.
        """
        frame = self._plant.robot.tool_frame or self._plant.robot.frame_names[-1]
        jacobian = self._plant.at(position).frame_jacobian(frame, "local_world_aligned")
        lever = jacobian.reshape(6, position.size)[:3].T  # Pinocchio's of one joint is a vector
        if axis is None:
            along = lever @ (lever.T @ force)
        else:
            along = (-1.0) ** int(axis) * lever[:, 2 if axis < 4.0 else int(axis) - 4]
        size = float(np.abs(along / self._units.force).max())
        share = float(np.abs(force / self._units.force).max()) / size if size > 0.0 else 0.0
        result: Array = share * along
        return result

    def _at_limits(self, anywhere: Array, size: float, aside: Array, across: Array) -> Array:
        """Return positions with about half the joints on a limit, or close to it on either side."""
        robot = self._plant.robot
        limited = np.isfinite(robot.lower) & np.isfinite(robot.upper)
        if size > _TOGETHER:  # all that have one, on the same side
            return np.where(limited, robot.upper if aside[0] < 0.5 else robot.lower, anywhere)
        share = 0.15 + 0.7 * size
        moved = (aside < share) & limited
        # within a joint's own draw: which limit, which side of it, how far
        upper, rest = aside * (2.0 / share) % 2.0 >= 1.0, across * 3.0
        side, far = np.floor(rest) - 1.0, CLOSEST ** (1.0 - rest % 1.0)
        with np.errstate(invalid="ignore"):
            width = np.where(moved, robot.upper - robot.lower, 1.0)
        limit = np.where(upper, robot.upper, robot.lower)
        return np.where(moved, limit + side * 0.05 * far * width, anywhere)

    def _velocity(self, kind: float, size: float, time: float, u: Array) -> tuple[Array, str]:
        unit, direction = self._units.speed, 2.0 * u - 1.0
        reference = reference_velocity(self._law, time)
        if kind < 0.1:
            return np.zeros(u.size), "at rest"
        if kind < 0.2:
            return reference, "at rest" if not reference.any() else "with the reference"
        if kind < 0.55:
            start = reference if kind < 0.4 else 0.0
            return start + _log_uniform(size, CLOSEST, 1.0) * unit * _thinned(direction, kind * 20.0 % 1.0), "slow"
        if kind < 0.85:
            return 2.0 * unit * _thinned(2.0 * next(self._even["speeds"]) - 1.0, kind * 20.0 % 1.0), ""
        fastest = np.maximum(4.0 * unit, _FASTEST * self._units.position)
        return _log_uniform(size, 2.0, 1.0 + float((fastest / unit).max())) * unit * direction, "fast"


def some(states: Sequence[SampledState], count: int, n: int) -> Sequence[SampledState]:
    """Return about a number of the states, spread over them; fewer for an arm of more than ten joints."""
    share = max(1, int(count * min(1.0, 10.0 / n)))
    return states[:: max(1, len(states) // share)][:share]


def clear_of_switches(law: Controller, time: float) -> float:
    """Return a time at least 5 ms from where another law takes over, or in the middle between: for differences."""
    return within_phase(law.phases, time, FIRST_TIME if law.time_span else 0.0, FIRST_TIME)


def beside_switches(law: Controller, states: Sequence[SampledState]) -> list[SampledState]:
    """Return some of the states just before and just after every time at which the law says that it may change.

    Those are the start, the switches to other laws and the end of what changes; of many some, evenly.
    """
    if not law.time_span:
        return []
    turns = sorted({*law.phases, float(law.time_span)})
    gaps = np.diff([-math.inf, *turns, math.inf])
    times = [
        (turn + side * near, f"{1e3 * near:.3g} ms {'before' if side < 0.0 else 'after'} t = {turn:.4g} s")
        for turn, before, after in zip(turns, gaps[:-1], gaps[1:], strict=True)
        for near in _BESIDE_SWITCHES
        for side, room in ((-1.0, before), (1.0, after))
        if turn + side * near > 0.0 and near < 0.5 * room
    ]
    chosen = times[:: -(-len(times) // _SWITCHES)]
    step = max(1, len(states) // len(chosen))
    return [
        at._replace(time=time, stratum=f"{at.stratum}, {where}".removeprefix(", "))
        for (time, where), at in zip(chosen, states[::step], strict=False)
    ]


def true_span(law: Controller) -> float:
    """Return a law's time span, or a few where its rest posture neither stays nor goes on periodically after it."""
    span = number("time_span", law.time_span, minimum=0.0)
    if span == 0.0:
        return 0.0
    last = law.rest_posture(span)
    for time in span * np.linspace(1.0, _SPANS, _LOOKS):
        posture = law.rest_posture(time)
        changed = min(np.abs(posture - last).max(), np.abs(posture - law.rest_posture(time % span)).max())
        if changed > CLOSEST:
            return _SPANS * span
    return span


def reference_velocity(law: Controller, time: float, position: Array | None = None) -> Array:
    """Return the velocity that a law leads the arm along with, by default where it rests, shape (n,) [rad/s]."""
    if not law.time_span:
        return np.zeros(law.system.n)
    return law.reference_velocity(time, law.system.at(law.rest_posture(time) if position is None else position))


def _drawn(kind: float, size: float, u: Array, unit: Array, largest: float, name: str) -> tuple[Array, str]:
    """Return a vector up to ``largest`` units: zero, tiny to large, or anywhere; one entry alone now and then."""
    if u.size == 0:
        return np.zeros(0), ""
    if kind < 0.2:
        return np.zeros(u.size), f"{name} = 0"
    direction = _thinned(2.0 * u - 1.0, kind * 20.0 % 1.0)
    if kind < 0.6:
        return _log_uniform(size, CLOSEST, largest) * unit * direction, ""
    return min(largest, 2.0) * unit * direction, ""


def _thinned(direction: Array, choice: float, others: Array | None = None) -> Array:
    """Return the direction with one entry alone, with some (those of ``others``, or the largest), or as it is."""
    if choice < _ALONE:
        alone = np.zeros(direction.size)
        entry = min(int(choice / _ALONE * direction.size), direction.size - 1)
        alone[entry] = direction[entry]
        return alone
    if others is not None:
        return np.where(others < 0.4, direction, 0.0)
    return np.where(np.abs(direction) > _LARGEST, direction, 0.0) if choice < _SOME else direction


def _range(robot: Robot) -> tuple[Array, Array]:
    """Return the joints' limits; where there are none a turn about zero, or a metre."""
    half = np.where(np.array(robot.prismatic or [False] * robot.n), 0.5, np.pi)
    bounded = np.isfinite(robot.lower) & np.isfinite(robot.upper)
    return np.where(bounded, robot.lower, -half), np.where(bounded, robot.upper, half)


def _log_uniform(u: float, low: float, high: float) -> float:
    return float(low * (high / low) ** u)
