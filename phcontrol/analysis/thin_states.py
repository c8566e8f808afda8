"""States on thin sets, which no draw from a volume hits, and where arms often are."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations
from typing import Any

import numpy as np

from phcontrol._validation import Array
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.vision.scene import Scene

SLIDING = "p̂ = 0"
"""The stratum in which a law that is right may dissipate nothing for an instant."""
KINDS = 8
"""Of so many thin states four are on an axis, two on a block of joints, one on p̂ = 0, one at rest under a load."""
_LEAST, _MOST = 0.2, 1.0  # how far away is what alone is away, in natural units
_FASTEST, _STRONGEST = 2.0, 2.0  # likewise, the velocity and the force that may be needed to be on a set
_ATTEMPTS = 4  # to come near enough for that
_FARTHER = 1e3  # at most so many times nearer at the next attempt
_SMALLEST, _LARGEST = 1e-3, 1.0  # displacements of the states at rest under a load
_NEAREST, _DECADES = 1e-6, 6  # of the distances at which a rest is approached, in natural units
_GOLDEN = 0.5 * (5.0**0.5 - 1.0)  # of a decade, between one distance and the next in it
_PROBE = 0.05  # of a natural unit: the force by which an acceleration's slope is found


class ThinStates:
    """Makes states in which little is away from the law's rest point, or what is away balances.

    - On an axis: one joint's position, one velocity, one force or one of the controller's states is away from rest.
    - On a block: neighbouring joints alone (the wrist, say) are away from the goal, the others exactly at it; in half
      of the cases they move too.
    - On p̂ = 0, where laws slide: the velocity for which the momentum among the target's coordinates is 0.
    - At rest under a load: the external force that keeps the closed loop from accelerating, with the arm or the
      controller's state displaced.
    - Close to rest in all of them at once: at a distance of each decade from 1e-6 to 1, two joints or all away, on the
      way in, at rest, on the way out or aside.

    Axes, blocks and parts of the controller's state are gone through one after another; of more axes than can be
    looked at some, evenly, of more blocks those at the ends of the arm.

    Args:
        law: is asked for its coordinates and its torque.
        plant: whose accelerations are meant.
        units: of both.
        look: returns what there is to see from a position.
    """

    def __init__(
        self, law: Controller, plant: MechanicalSystem, units: NaturalUnits, look: Callable[[Array], Scene | None]
    ) -> None:
        self._law, self._plant, self._units, self._look = law, plant, units, look
        self._axes = list(_axes(plant.n, units.state.size))
        self._blocks = list(_blocks(plant.n))
        self._pairs = list(combinations(range(plant.n), 2)) if plant.n > 2 else []
        np.random.default_rng(0).shuffle(self._pairs)
        lengths = list(law.state_parts.values())
        self._parts = list(np.repeat(np.eye(len(lengths), dtype=bool), lengths, axis=1))

    def state(self, k: int, count: int, rest: SampledState, u: Array) -> SampledState:
        """Return the k-th of ``count`` states about ``rest``; ``u`` holds 2n + m numbers between 0 and 1."""
        turn, kind = divmod(k, KINDS)
        size = np.copysign(_LEAST + (_MOST - _LEAST) * np.abs(2.0 * u - 1.0), u - 0.5)
        if kind < 4:
            which, looks = 4 * turn + kind, 4 * -(-count // KINDS)  # turns, the last one begun
            return self._on_an_axis(rest, self._axes[_spread(which, looks, len(self._axes))], size)
        if kind < 6 and self._blocks:
            return self._on_a_block(rest, self._blocks[(2 * turn + kind - 4) % len(self._blocks)], size, kind == 5)
        return self._sliding(rest, size) if kind < 7 else self._loaded(rest, turn, float(u[0]), size)

    def approaching(self, k: int, rest: SampledState, u: Array) -> SampledState:
        """Return the k-th state close to ``rest``; ``u`` holds 2n + m numbers between 0 and 1."""
        n = self._plant.n
        where, aside, charged = np.split(2.0 * u - 1.0, [n, 2 * n])
        turn, alone = divmod(k, 2)
        decade = _DECADES - 1 - turn % (2 if alone else _DECADES)
        distance = _NEAREST * 10.0 ** (decade + _GOLDEN * k % 1.0)
        if alone and self._pairs:  # the others exactly at rest
            away = np.isin(np.arange(n), self._pairs[turn % len(self._pairs)])
            where = np.where(away, np.copysign(np.maximum(np.abs(where), _LEAST), where), 0.0)
        how = (turn + turn // _DECADES) % 4
        velocity = (-where, np.zeros(n), where, aside)[how]
        towards = ("on the way in", "at rest", "on the way out", "moving aside")[how]
        at = rest._replace(
            position=rest.position + distance * self._units.position * where,
            velocity=rest.velocity + distance * self._units.speed * velocity,
            state=rest.state + (distance if turn % 3 else 0.0) * self._units.state * charged,
            stratum=f"{distance:.1g} from rest, {towards}",
        )
        return self._seeing(at)

    def _on_an_axis(self, rest: SampledState, axis: tuple[str, int], size: Array) -> SampledState:
        field, entry = axis
        unit = {
            "position": self._units.position,
            "velocity": self._units.speed,
            "force": self._units.force,
            "state": self._units.state,
        }[field]
        moved = np.array(getattr(rest, field))
        moved[entry] += size[entry] * unit[entry]
        changed: dict[str, Any] = {field: moved, "stratum": f"at rest but for entry {entry + 1} of the {field}"}
        return self._seeing(rest._replace(**changed)) if field == "position" else rest._replace(**changed)

    def _on_a_block(self, rest: SampledState, block: slice, size: Array, moving: bool) -> SampledState:
        n = self._plant.n
        position, velocity = np.array(rest.position), np.array(rest.velocity)
        position[block] += (size[:n] * self._units.position)[block]
        if moving:
            velocity[block] += (size[n : 2 * n] * self._units.speed)[block]
        where = f"joints {block.start + 1} to {block.stop} alone away from the goal"
        return self._seeing(rest._replace(position=position, velocity=velocity, stratum=where))

    def _sliding(self, rest: SampledState, size: Array) -> SampledState:
        """Return a state with p̂ = 0; nearer to rest as long as that takes velocities of more than twice the limits."""
        n = self._plant.n
        away, charged = size[:n] * self._units.position, size[2 * n :] * self._units.state
        at = rest
        for _ in range(_ATTEMPTS):
            at = rest._replace(position=rest.position + away, state=rest.state + charged, stratum=SLIDING)
            at = self._seeing(at)
            at = at._replace(velocity=_unmoved(Seen.of(self._law, self._plant, at)))
            excess = float(np.abs(at.velocity / self._units.speed).max()) / _FASTEST
            if excess <= 1.0:
                break
            away, charged = away / (2.0 * excess), charged / (2.0 * excess)
        return at

    def _loaded(self, rest: SampledState, turn: int, share: float, size: Array) -> SampledState:
        """Return a state at rest under a force; nearer to rest as long as that takes twice the motors' limits."""
        n, far = self._plant.n, _SMALLEST * (_LARGEST / _SMALLEST) ** share
        away, charged = far * size[:n] * self._units.position, size[2 * n :] * self._units.state
        if turn % 2 and self._parts:  # a part of the controller's state bears the load
            charged[~self._parts[turn // 2 % len(self._parts)]] = 0.0
            away = np.zeros(n)
        else:
            charged = np.zeros(charged.size)
        at = rest
        for _ in range(_ATTEMPTS):
            at = rest._replace(position=rest.position + away, state=rest.state + charged)
            at = self._seeing(at._replace(stratum="at rest under a load"))
            force = self._balancing(at)
            excess = float(np.abs(force / self._units.force).max()) / _STRONGEST
            if excess <= 1.0:
                return at._replace(force=force)
            nearer = 2.0 * min(excess, _FARTHER) if np.isfinite(excess) else _FARTHER
            away, charged = away / nearer, charged / nearer
        return at

    def _seeing(self, at: SampledState) -> SampledState:
        return at if at.scene is None else at._replace(scene=self._look(at.position))

    def _balancing(self, at: SampledState) -> Array:
        """Return the f_e under which q̈ = 0; by one step of Newton's method where the law measures something."""
        if not self._law.needs:
            force: Array = at.force - self._plant.at(at.position).mass_matrix @ self._acceleration(at)
            return force
        probes = _PROBE * np.diag(self._units.force)
        start = at.force + probes.sum(axis=0)
        first = self._acceleration(at._replace(force=start))
        slope = [self._acceleration(at._replace(force=start + probe)) - first for probe in probes]
        steps = np.linalg.lstsq(np.stack(slope, axis=-1), first, rcond=1e-9)[0]
        balancing: Array = start - steps @ probes
        return balancing

    def _acceleration(self, at: SampledState) -> Array:
        torque = Seen.of(self._law, self._plant, at).command().torque
        return self._plant.at(at.position, at.velocity).acceleration(torque, at.force)


def _unmoved(seen: Seen) -> Array:
    """Return the velocity for which the coordinates that depend on it are 0; they are affine in it, as p̂ is."""
    n = seen.view.system.n
    start = seen.elsewhere(velocity=np.zeros(n)).coordinates()
    slope = np.stack([seen.elsewhere(velocity=axis).coordinates() - start for axis in np.eye(n)], axis=-1)
    sizes = np.abs(slope).max(axis=1, initial=0.0)
    rows = sizes > 1e-9 * sizes.max(initial=1e-300)
    return -np.linalg.lstsq(slope[rows], start[rows], rcond=1e-12)[0] if rows.any() else np.zeros(n)


def _axes(n: int, m: int) -> Iterator[tuple[str, int]]:
    """Return the axes, field by field in turn, so that a part of them has some of each."""
    for entry in range(max(n, m)):
        for field, length in (("position", n), ("velocity", n), ("force", n), ("state", m)):
            if entry < length:
                yield field, entry


def _blocks(n: int) -> Iterator[slice]:
    """Return the blocks of two joints or more, but not of all: the last joints, the first ones, those between."""
    for length in range(2, n):
        yield slice(n - length, n)
    for length in range(2, n):
        yield slice(0, length)
    for length in range(2, n - 1):
        for first in range(1, n - length):
            yield slice(first, first + length)


def _spread(k: int, count: int, things: int) -> int:
    """Return which thing the k-th of ``count`` looks is at: all in turn where they suffice, else some, evenly."""
    return k % things if count >= things else k * things // count
