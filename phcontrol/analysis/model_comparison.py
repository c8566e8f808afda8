"""Where two models of an arm differ: joints, inertia, weight, friction, input, limits, frames."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array, count, number
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.friction import Friction, StribeckFriction
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.stop_velocity import StopVelocity
from phcontrol.mechanics.system import MechanicalSystem

_ROUNDING = 1e-12  # part of the largest number of a kind, below which a difference is rounding
_SPEEDS = np.array([0.01, 0.1, 0.5, 1.0, 2.0])  # at which friction is compared [rad/s]
SEEN_OTHERWISE = {
    "name": "in the report's head",
    "joint_names": "as joints that only one has, and as their order",
    "model": "in M, gravity, armature and frames",
    "potentials": "in gravity",
    "coupling": "in M, gravity and frames",
    "payloads": "in M and gravity",
    "rotors": "as armature",
    "locked_joints": "as joints that only one has, and in M, gravity and frames",
    "friction": "of the system",
    "description": "where a model comes from is not what it is",
    "path": "likewise",
    "package_directories": "likewise",
}
"""Fields of a Robot that are not compared as they stand, and where their differences show; all others are."""
_QUANTITIES = {
    "lower": ("lower limit", "rad"), "upper": ("upper limit", "rad"), "velocity_limit": ("velocity limit", "rad/s"),
    "effort_limit": ("effort limit", "N·m"), "home": ("home", "rad"), "offset": ("stop velocity offset", "rad/s"),
    "deceleration": ("stop velocity deceleration", "rad/s²"),
}  # fmt: skip


@dataclass(frozen=True)
class Difference:
    """One thing that is not the same in both models: a number, or a word."""

    quantity: str
    """What differs: "M", "gravity", "armature", "viscous friction", "lower limit", "tool frame" and so on."""
    where: str
    """A joint, or two for an entry of a matrix, or a frame; empty for what there is one of."""
    first: float | str
    second: float | str
    unit: str

    @property
    def change(self) -> float:
        """Second minus first; infinite where one is, and of words."""
        if isinstance(self.first, str) or isinstance(self.second, str):
            return 0.0 if self.first == self.second else math.inf
        return self.second - self.first if self.second != self.first else 0.0

    def __str__(self) -> str:
        values = " and ".join(one if isinstance(one, str) else f"{one:.6g}" for one in (self.first, self.second))
        where = f" of {self.where}" if self.where else ""
        return f"{self.quantity}{where}: {values} {self.unit}".rstrip()


class _Pair(NamedTuple):
    """Two plants, the joints that both have, and their places in each."""

    first: MechanicalSystem
    second: MechanicalSystem
    shared: tuple[str, ...]
    places: tuple[list[int], list[int]]


@dataclass(frozen=True)
class ModelComparison:
    """What ``compare_models`` found. ``str()`` is a report; ``same`` says that there is nothing in it.

    Example:
        >>> from phcontrol import Payload, compare_models, load_robot
        >>> plain, loaded = load_robot("pera_shoulder"), load_robot("pera_shoulder", payload=Payload(0.5))
        >>> found = compare_models(plain, loaded)
        >>> found.same, found.same_order, "M" in {difference.quantity for difference in found.differences}
        (False, True, True)
    """

    names: tuple[str, str]
    only_first: tuple[str, ...]
    """Joints that the second model has not."""
    only_second: tuple[str, ...]
    order: tuple[tuple[str, ...], tuple[str, ...]]
    """The joints that both have, in the order of each."""
    differences: tuple[Difference, ...]
    """Of each joint and kind the largest over the sampled positions."""
    samples: int

    @property
    def same_order(self) -> bool:
        """Whether a torque of one model means the same joints in the other."""
        return self.order[0] == self.order[1] and not (self.only_first or self.only_second)

    @property
    def same(self) -> bool:
        """Whether nothing differs."""
        return self.same_order and not self.differences

    def of(self, quantity: str) -> tuple[Difference, ...]:
        """Return the differences of one kind, such as "M", "gravity", "armature" or "viscous friction"."""
        return tuple(item for item in self.differences if item.quantity == quantity)

    def largest(self, quantity: str) -> float:
        """Return the largest |change| of a kind, 0 for none."""
        return max((abs(item.change) for item in self.of(quantity)), default=0.0)

    def __str__(self) -> str:
        first, second = self.names
        if self.same:
            return f"{first} and {second}: no difference at {self.samples} positions"
        lines = [f"{first} (first) and {second} (second), at home and {self.samples} more positions:"]
        for names, missing in ((self.only_first, second), (self.only_second, first)):
            if names:
                lines.append(f"  joints that {missing} has not: {', '.join(names)}")
        if self.order[0] != self.order[1]:
            lines += [f"  order of joints: {', '.join(order)}" for order in self.order]
        lines += [f"  {item}" for item in self.differences]
        return "\n".join(lines)


def compare_models(first: Robot | MechanicalSystem, second: Robot | MechanicalSystem, *, samples: int = 50,
                   tolerance: float = 1e-9) -> ModelComparison:  # fmt: skip
    """Say where two models of an arm differ: in all that a Robot and a MechanicalSystem carry.

    That is M, gravity (with springs), friction with all its parameters, rotors, the input matrix, limits of position,
    velocity (near the stops too) and effort, kinds and order of joints, home, and the frames: which there are, where
    they are, and which are tool and camera. Joints and frames are the same when their names are; joints that only one
    model has stay at its home. What depends on q is compared at home and at positions drawn inside the limits of the
    first (seed 0), and the largest difference of each joint (pair, frame) is reported.

    Args:
        first: an arm, or a plant with its own friction and gravity.
        second: the other.
        samples: how many positions beside home.
        tolerance: what is left out, relative to the largest number of its kind.

    Example:
        >>> from phcontrol import Payload, compare_models, load_robot
        >>> plain, loaded = load_robot("pera"), load_robot("pera", payload=Payload(1.0, frame="forearm"))
        >>> report = compare_models(plain, loaded)
        >>> report.same, report.same_order, {item.quantity for item in report.differences} == {"M", "gravity"}
        (False, True, True)
    """
    a, b = _system("first", first), _system("second", second)
    samples, tolerance = count("samples", samples, maximum=10**5), number("tolerance", tolerance, minimum=_ROUNDING)
    names_a, names_b = a.robot.joint_names, b.robot.joint_names
    shared = tuple(name for name in names_a if name in names_b)
    if not shared:
        raise InvalidArgumentError(
            "second", f"shares no joint with the first: {', '.join(names_b)} against {', '.join(names_a)}"
        )
    index_a, index_b = ([names.index(name) for name in shared] for names in (names_a, names_b))
    pair = _Pair(a, b, shared, (index_a, index_b))
    found = [*_carried(pair), *_rotors(pair), *_friction(pair, samples)]
    found += _dynamics(pair, samples, tolerance)
    found += _frames(pair, samples, tolerance)
    return ModelComparison(
        (a.robot.label, b.robot.label),
        tuple(name for name in names_a if name not in names_b),
        tuple(name for name in names_b if name not in names_a),
        (shared, tuple(name for name in names_b if name in names_a)),
        tuple(found),
        samples,
    )


def _system(name: str, value: Any) -> MechanicalSystem:
    if isinstance(value, MechanicalSystem):
        return value
    if isinstance(value, Robot):
        return MechanicalSystem(value)
    raise InvalidArgumentError(name, f"must be a Robot or a MechanicalSystem, but is {type(value).__name__}")


def _carried(pair: _Pair) -> Iterator[Difference]:
    """Yield what differs of the fields of both robots, whatever fields a Robot has."""
    a, b, shared, index = pair.first.robot, pair.second.robot, pair.shared, pair.places
    for field in fields(Robot):
        if field.name in SEEN_OTHERWISE:
            continue
        x, y = getattr(a, field.name), getattr(b, field.name)
        if isinstance(x, StopVelocity) or isinstance(y, StopVelocity):
            one, other = _near_stops(x, a.n), _near_stops(y, b.n)
            for part in fields(StopVelocity):
                yield from _each_joint(part.name, getattr(one, part.name), getattr(other, part.name), shared, index)
        elif np.shape(x) == (a.n,) and np.shape(y) == (b.n,):
            yield from _each_joint(field.name, x, y, shared, index)
        elif x != y:
            yield Difference(field.name.replace("_", " "), "", _word(x), _word(y), "")


def _near_stops(limit: StopVelocity | None, n: int) -> StopVelocity:
    """Return a limit with a number for each joint; the offset of a joint without a limit means nothing."""
    limit = limit or StopVelocity(0.0, math.inf)
    deceleration = np.broadcast_to(limit.deceleration, n)
    return StopVelocity(np.where(np.isfinite(deceleration), limit.offset, 0.0), deceleration)


def _each_joint(
    name: str, x: Any, y: Any, shared: tuple[str, ...], index: tuple[list[int], list[int]]
) -> Iterator[Difference]:
    quantity, unit = _QUANTITIES.get(name, (name.replace("_", " "), ""))
    for joint, i, j in zip(shared, *index, strict=True):
        if x[i] != y[j]:
            one, other = (
                _word(value) if isinstance(value, (bool, np.bool_)) else float(value) for value in (x[i], y[j])
            )
            yield Difference(quantity, joint, one, other, unit)


def _word(value: Any) -> str:
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    return "none" if value is None else str(value)


def _rotors(pair: _Pair) -> Iterator[Difference]:
    for name in pair.shared:
        models = pair.first.robot.model, pair.second.robot.model
        x, y = (float(model.armature[model.joints[model.getJointId(name)].idx_v]) for model in models)
        if x != y:
            yield Difference("armature", name, x, y, "kg·m²")


def _friction(pair: _Pair, samples: int) -> Iterator[Difference]:
    a, b, shared, index = pair
    both = [system.friction for system in (a, b)]
    if not all(friction is None or isinstance(friction, StribeckFriction) for friction in both):
        yield from _friction_torques(pair, samples)
        return
    found = {
        name: [_parameter(one, name, system.n)[places] for one, system, places in zip(both, (a, b), index, strict=True)]
        for name in ("viscous", "coulomb", "static", "stribeck_velocity", "smoothing")
    }
    units = {"viscous": "N·m·s/rad", "coulomb": "N·m", "static": "N·m"}
    for name, unit in units.items():
        yield from _unequal(f"{name} friction", found[name], shared, unit)
    # these two do something where there is dry friction, and where it falls with speed
    dry = np.logical_and(*(values > 0.0 for values in found["static"]))
    falls = np.logical_and(*(s > c for s, c in zip(found["static"], found["coulomb"], strict=True)))
    for name, counts, quantity, unit in (
        ("stribeck_velocity", falls, "Stribeck velocity of friction", "rad/s"),
        ("smoothing", dry, "smoothing of friction", "rad²/s²"),
    ):
        yield from (item for item in _unequal(quantity, found[name], shared, unit) if counts[shared.index(item.where)])


def _unequal(quantity: str, values: list[Array], shared: tuple[str, ...], unit: str) -> Iterator[Difference]:
    pairs = zip(*values, shared, strict=True)
    yield from (Difference(quantity, name, float(p), float(q), unit) for p, q, name in pairs if p != q)


def _friction_torques(pair: _Pair, samples: int) -> Iterator[Difference]:
    """Yield where friction differs by what it does: each joint at some speeds, and all at once."""
    a, b, shared, index = pair
    worst = {name: Difference("friction", name, 0.0, 0.0, "") for name in shared}
    motions = [
        (np.eye(len(shared))[k] * speed, f"{shared[k]} at {speed:g} rad/s")
        for k in range(len(shared))
        for speed in _SPEEDS
    ]
    motions += [(v, "all joints moving") for v in np.random.default_rng(1).normal(size=(3, len(shared)))]
    for positions in _positions(pair, min(samples, 5)):
        for velocity, said in motions:
            torques = []
            for system, places, position in zip((a, b), index, positions, strict=True):
                whole = np.zeros(system.n)
                whole[places] = velocity
                torques.append(system.at(position, whole).friction_torque[places])
            for name, one, other in zip(shared, *torques, strict=True):
                item = Difference("friction", name, float(one), float(other), f"N·m with {said}")
                worst[name] = max(worst[name], item, key=lambda difference: abs(difference.change))
    yield from (item for item in worst.values() if item.change)


def _parameter(friction: Friction | None, name: str, n: int) -> Array:
    value = 0.0 if friction is None else getattr(friction, name)
    values: Array = np.broadcast_to(np.asarray(value, dtype=float), (n,))
    return values


def _positions(pair: _Pair, samples: int) -> Iterator[tuple[Array, Array]]:
    """Yield positions of both that are the same for the joints that both have: home of the first, and drawn ones."""
    a, b, _, index = pair
    generator = np.random.default_rng(0)
    for sample in range(samples + 1):
        q = a.robot.random_position(generator) if sample else np.array(a.robot.home)
        first, second = (np.array(system.robot.home) for system in (a, b))
        first[index[0]] = second[index[1]] = q[index[0]]
        yield first, second


def _dynamics(pair: _Pair, samples: int, tolerance: float) -> Iterator[Difference]:
    a, b, shared, index = pair
    matrices: tuple[list[Array], list[Array]] = ([], [])
    gradients: tuple[list[Array], list[Array]] = ([], [])
    inputs: tuple[list[Array], list[Array]] = ([], [])
    for positions in _positions(pair, samples):
        for which, (system, places, position) in enumerate(zip((a, b), index, positions, strict=True)):
            x = system.at(position)
            matrices[which].append(x.mass_matrix[np.ix_(places, places)])
            gradients[which].append(x.potential_gradient[places])
            inputs[which].append(x.input_matrix[np.ix_(places, places)])
    yield from _worst("M", matrices, shared, tolerance, "kg·m²", symmetric=True)
    yield from _worst("gravity", gradients, shared, tolerance, "N·m")
    yield from _worst("input matrix", inputs, shared, tolerance, "")
    for axis, one, other in zip("xyz", a.model.gravity.linear, b.model.gravity.linear, strict=True):
        if one != other:
            yield Difference("gravity acceleration", axis, float(one), float(other), "m/s²")


def _frames(pair: _Pair, samples: int, tolerance: float) -> Iterator[Difference]:
    """Yield frames that only one has, and how far those of one name are apart."""
    a, b, _, _ = pair
    names = [system.robot.frame_names for system in (a, b)]
    for name in dict.fromkeys((*names[0], *names[1])):
        if not (name in names[0] and name in names[1]):
            first, second = ("there" if name in known else "missing" for known in names)
            yield Difference("frame", name, first, second, "")
    both = [name for name in names[0] if name in names[1]]
    apart = {name: [0.0, 0.0] for name in both}
    for positions in _positions(pair, min(samples, 10)):
        states = [system.at(position) for system, position in zip((a, b), positions, strict=True)]
        for name in both:
            one, other = (x.placement(name) for x in states)
            turn = float(np.linalg.norm(pin.log3(one.rotation.T @ other.rotation)))
            way = float(np.linalg.norm(one.translation - other.translation))
            apart[name] = [max(pair) for pair in zip(apart[name], (way, turn), strict=True)]
    for name, (way, turn) in apart.items():
        for quantity, value, unit in (("frame position", way, "m apart"), ("frame orientation", turn, "rad apart")):
            if value > max(tolerance, 1e-9):
                yield Difference(quantity, name, 0.0, value, unit)


def _worst(
    quantity: str,
    values: tuple[list[Array], list[Array]],
    shared: tuple[str, ...],
    tolerance: float,
    unit: str,
    symmetric: bool = False,
) -> Iterator[Difference]:
    """Yield for each entry the sample at which it differs most."""
    first, second = np.array(values[0]), np.array(values[1])
    change = np.abs(second - first)
    bound = tolerance * max(float(np.abs(first).max()), float(np.abs(second).max()), 1e-3)
    for place in np.argwhere(change.max(axis=0) > bound):
        entry = tuple(int(i) for i in place)
        if symmetric and list(entry) != sorted(entry):
            continue
        one, other, difference = (np.array([sample[entry] for sample in kind]) for kind in (first, second, change))
        k = int(np.argmax(difference))
        where = ", ".join(dict.fromkeys(shared[i] for i in entry))
        yield Difference(quantity, where, float(one[k]), float(other[k]), unit)
