"""Where two models of an arm differ: joints, inertia, weight, friction, limits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from phcontrol._validation import Array, count, number
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.friction import Friction, StribeckFriction
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.system import MechanicalSystem

_ROUNDING = 1e-12  # part of the largest number of a kind, below which a difference is rounding
_SPEEDS = np.array([0.01, 0.1, 0.5, 1.0, 2.0])  # at which friction is compared [rad/s]


@dataclass(frozen=True)
class Difference:
    """One number that is not the same in both models."""

    quantity: str
    """What differs: "M", "gravity", "armature", "viscous friction", "lower limit" and so on."""
    where: str
    """A joint, or two for an entry of M."""
    first: float
    second: float
    unit: str

    @property
    def change(self) -> float:
        """Second minus first; infinite where one is."""
        return self.second - self.first if self.second != self.first else 0.0

    def __str__(self) -> str:
        return f"{self.quantity} of {self.where}: {self.first:.6g} and {self.second:.6g} {self.unit}".rstrip()


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
    """Say where two models of an arm differ: M, gravity, friction, rotors, limits, and the order of joints.

    Joints are the same when their names are; those that only one model has stay at its home. M(q) and ∂V/∂q are
    compared at home and at positions drawn inside the limits of both (seed 0); of each joint (of each pair, for M) the
    largest difference is reported.

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
    samples, tolerance = count("samples", samples), number("tolerance", tolerance, minimum=_ROUNDING)
    names_a, names_b = a.robot.joint_names, b.robot.joint_names
    shared = tuple(name for name in names_a if name in names_b)
    if not shared:
        raise InvalidArgumentError(
            "second", f"shares no joint with the first: {', '.join(names_b)} against {', '.join(names_a)}"
        )
    index_a, index_b = ([names.index(name) for name in shared] for names in (names_a, names_b))
    found = [*_limits(a.robot, b.robot, shared, index_a, index_b)]
    found += _rotors(a.robot, b.robot, shared)
    found += _friction(a, b, shared, index_a, index_b)
    found += _dynamics(a, b, shared, index_a, index_b, samples, tolerance)
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


def _limits(
    a: Robot, b: Robot, shared: tuple[str, ...], index_a: list[int], index_b: list[int]
) -> Iterator[Difference]:
    units = {"lower": "rad", "upper": "rad", "velocity_limit": "rad/s", "effort_limit": "N·m"}
    for attribute, unit in units.items():
        quantity = f"{attribute} limit" if attribute in ("lower", "upper") else attribute.replace("_", " ")
        values = zip(getattr(a, attribute)[index_a], getattr(b, attribute)[index_b], shared, strict=True)
        yield from (Difference(quantity, name, float(x), float(y), unit) for x, y, name in values if x != y)


def _rotors(a: Robot, b: Robot, shared: tuple[str, ...]) -> Iterator[Difference]:
    for name in shared:
        x, y = (float(r.model.armature[r.model.joints[r.model.getJointId(name)].idx_v]) for r in (a, b))
        if x != y:
            yield Difference("armature", name, x, y, "kg·m²")


def _friction(
    a: MechanicalSystem, b: MechanicalSystem, shared: tuple[str, ...], index_a: list[int], index_b: list[int]
) -> Iterator[Difference]:
    both = [system.friction for system in (a, b)]
    if all(friction is None or isinstance(friction, StribeckFriction) for friction in both):
        for what, unit in (("viscous", "N·m·s/rad"), ("coulomb", "N·m"), ("static", "N·m")):
            x, y = (_parameter(friction, what, system.n) for friction, system in zip(both, (a, b), strict=True))
            pairs = zip(x[index_a], y[index_b], shared, strict=True)
            yield from (Difference(f"{what} friction", name, p, q, unit) for p, q, name in pairs if p != q)
        return
    for k, name in enumerate(shared):
        worst = Difference("friction", name, 0.0, 0.0, "")
        for speed in _SPEEDS:
            torques = []
            for system, index in ((a, index_a), (b, index_b)):
                state = system.at(system.robot.home, np.eye(system.n)[index[k]] * speed)
                torques.append(float(state.friction_torque[index[k]]))
            item = Difference("friction", name, torques[0], torques[1], f"N·m at {speed:g} rad/s")
            worst = max(worst, item, key=lambda difference: abs(difference.change))
        if worst.change:
            yield worst


def _parameter(friction: Friction | None, name: str, n: int) -> Array:
    value = 0.0 if friction is None else getattr(friction, name)
    values: Array = np.broadcast_to(np.asarray(value, dtype=float), (n,))
    return values


def _dynamics(
    a: MechanicalSystem,
    b: MechanicalSystem,
    shared: tuple[str, ...],
    index_a: list[int],
    index_b: list[int],
    samples: int,
    tolerance: float,
) -> Iterator[Difference]:
    generator = np.random.default_rng(0)
    matrices: tuple[list[Array], list[Array]] = ([], [])
    gradients: tuple[list[Array], list[Array]] = ([], [])
    for sample in range(samples + 1):
        q = np.array(a.robot.home)
        if sample:
            q = a.robot.random_position(generator)
        for which, (system, index) in enumerate(((a, index_a), (b, index_b))):
            position = np.array(system.robot.home)
            position[index] = q[index_a]
            x = system.at(position)
            matrices[which].append(x.mass_matrix[np.ix_(index, index)])
            gradients[which].append(x.potential_gradient[index])
    yield from _worst("M", np.array(matrices[0]), np.array(matrices[1]), shared, tolerance, "kg·m²")
    yield from _worst("gravity", np.array(gradients[0]), np.array(gradients[1]), shared, tolerance, "N·m")


def _worst(
    quantity: str, first: Array, second: Array, shared: tuple[str, ...], tolerance: float, unit: str
) -> Iterator[Difference]:
    """Yield for each entry the sample at which it differs most."""
    change = np.abs(second - first)
    bound = tolerance * max(float(np.abs(first).max()), float(np.abs(second).max()), 1e-3)
    for place in np.argwhere(change.max(axis=0) > bound):
        entry = tuple(int(i) for i in place)
        if list(entry) != sorted(entry):
            continue  # M is symmetric
        one, other, difference = (np.array([sample[entry] for sample in values]) for values in (first, second, change))
        k = int(np.argmax(difference))
        where = ", ".join(dict.fromkeys(shared[i] for i in entry))
        yield Difference(quantity, where, float(one[k]), float(other[k]), unit)
