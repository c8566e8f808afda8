"""External forces as functions of time, which can be added and scaled.

Each is called with the time [s] and the plant's state and returns f_e, shape (n,) [N·m].
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, choice, finite_array, number, positive, vector
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.robot import REFERENCES
from phcontrol.mechanics.state import MechanicalState


class Disturbance(ABC):
    """An external force f_e(t, x). Sums and multiples are disturbances too: ``2.0 * Step(...) + Sine(...)``.

    Example:
        >>> from phcontrol import MechanicalSystem, Pulse, Step, load_robot
        >>> push = Step([1.0, 0.0], start=0.5) + 2.0 * Pulse([0.0, 1.0], start=0.5, duration=0.1)
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> push(0.55, system.at(system.robot.home))  # [N·m]
        array([1., 2.])
    """

    @abstractmethod
    def __call__(self, t: float, x: MechanicalState) -> Array:
        """Return f_e at time t [s], shape (n,) [N·m]."""

    def __add__(self, other: Disturbance) -> Disturbance:
        if not isinstance(other, Disturbance):
            return NotImplemented
        return Sum(self, other)

    def __mul__(self, factor: float) -> Disturbance:
        return Multiple(number("factor", factor), self)

    __rmul__ = __mul__


class Sum(Disturbance):
    """Two disturbances at once; made by ``+``."""

    def __init__(self, first: Disturbance, second: Disturbance) -> None:
        self.parts = (first, second)

    def __call__(self, t: float, x: MechanicalState) -> Array:
        """Return f_e at time t."""
        return self.parts[0](t, x) + self.parts[1](t, x)


class Multiple(Disturbance):
    """A disturbance some times as strong; made by ``*``."""

    def __init__(self, factor: float, part: Disturbance) -> None:
        self.factor, self.part = factor, part

    def __call__(self, t: float, x: MechanicalState) -> Array:
        """Return f_e at time t."""
        return self.factor * self.part(t, x)


class _Shaped(Disturbance):
    """A constant direction times a function of time."""

    def __init__(self, force: ArrayLike) -> None:
        self.force = finite_array("force", force)
        if self.force.ndim != 1:
            raise InvalidArgumentError(
                "force", f"must be a vector, one entry a joint, but has shape {self.force.shape}"
            )
        self._nothing = np.zeros_like(self.force)


class Step(_Shaped):
    """``force`` [N·m] from ``start`` [s] on.

    Example:
        >>> from phcontrol import MechanicalSystem, Step, load_robot
        >>> Step([1.0], start=0.5)(0.6, MechanicalSystem(load_robot("pera_gripper")).at([0.0]))
        array([1.])
    """

    def __init__(self, force: ArrayLike, start: float = 0.0) -> None:
        super().__init__(force)
        self.start = number("start", start)

    def __call__(self, t: float, x: MechanicalState) -> Array:
        """Return f_e at time t."""
        return self.force if t >= self.start else self._nothing


class Pulse(_Shaped):
    """``force`` [N·m] from ``start`` for ``duration`` [s].

    Example:
        >>> from phcontrol import MechanicalSystem, Pulse, load_robot
        >>> Pulse([2.0], start=1.0, duration=0.5)(1.2, MechanicalSystem(load_robot("pera_gripper")).at([0.0]))
        array([2.])
    """

    def __init__(self, force: ArrayLike, start: float, duration: float) -> None:
        super().__init__(force)
        self.start, self.duration = number("start", start), positive("duration", duration)

    def __call__(self, t: float, x: MechanicalState) -> Array:
        """Return f_e at time t."""
        return self.force if self.start <= t < self.start + self.duration else self._nothing


class Sine(_Shaped):
    """``force``·sin(2π·``frequency``·t + ``phase``), with amplitude [N·m], frequency [Hz], phase [rad].

    Example:
        >>> from phcontrol import MechanicalSystem, Sine, load_robot
        >>> Sine([2.0], frequency=0.5)(0.5, MechanicalSystem(load_robot("pera_gripper")).at([0.0]))
        array([2.])
    """

    def __init__(self, force: ArrayLike, frequency: float, phase: float = 0.0) -> None:
        super().__init__(force)
        self.rate = 2.0 * math.pi * positive("frequency", frequency)
        self.phase = number("phase", phase)

    def __call__(self, t: float, x: MechanicalState) -> Array:
        """Return f_e at time t."""
        return self.force * math.sin(self.rate * t + self.phase)


class Sampled(Disturbance):
    """Forces from an array, shape (N, n) [N·m] at increasing ``times`` [s]; zero outside of them.

    ``interpolation`` is "linear" between samples, or "hold".

    Example:
        >>> from phcontrol import MechanicalSystem, Sampled, load_robot
        >>> push = Sampled([0.0, 1.0], [[0.0], [2.0]])  # [s], [N·m]
        >>> push(0.5, MechanicalSystem(load_robot("pera_gripper")).at([0.0]))
        array([1.])
    """

    def __init__(self, times: ArrayLike, forces: ArrayLike, interpolation: str = "linear") -> None:
        self.times, self.forces = finite_array("times", times), finite_array("forces", forces)
        if self.times.ndim != 1 or len(self.times) < 2 or (np.diff(self.times) <= 0.0).any():
            raise InvalidArgumentError("times", "must be an increasing vector of at least two times")
        if self.forces.ndim != 2 or len(self.forces) != len(self.times):
            raise InvalidArgumentError(
                "forces",
                f"must have one row for each of the {len(self.times)} times, but has shape {self.forces.shape}",
            )
        self.holds = choice("interpolation", interpolation, ("linear", "hold")) == "hold"

    def __call__(self, t: float, x: MechanicalState) -> Array:
        """Return f_e at time t."""
        times, forces = self.times, self.forces
        if not times[0] <= t <= times[-1]:
            return np.zeros(forces.shape[1])
        row = min(int(np.searchsorted(times, t, side="right")) - 1, len(times) - 2)
        if self.holds:
            held: Array = forces[row if t < times[-1] else -1]
            return held
        part = (t - times[row]) / (times[row + 1] - times[row])
        force: Array = (1.0 - part) * forces[row] + part * forces[row + 1]
        return force


class Wrench(Disturbance):
    """A wrench F = (force [N], moment [N·m]) at a frame: f_e = 𝒥ᵀF, thesis (2.5).

    Args:
        frame: where it acts.
        wrench: F, shape (6,), or a function of time [s] that returns it.
        reference: the axes F is given in: "local" (the frame's), "local_world_aligned" (the world's,
            acting at the frame's origin) or "world".

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, Wrench, load_robot
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> push = Wrench("tool", [0.0, 0.0, -5.0, 0.0, 0.0, 0.0])  # [N], [N·m], in the axes of the world
        >>> x = system.at(system.robot.home)
        >>> np.allclose(push(0.0, x), -5.0 * x.frame_jacobian("tool", "local_world_aligned")[2])
        True
    """

    def __init__(
        self,
        frame: str,
        wrench: ArrayLike | Callable[[float], ArrayLike],
        reference: str = "local_world_aligned",
    ) -> None:
        self.frame = frame
        self.reference = choice("frame of reference", reference, REFERENCES)
        self._function = wrench if callable(wrench) else None
        self._constant = np.zeros(6) if callable(wrench) else vector("wrench", wrench, 6)

    def wrench(self, t: float) -> Array:
        """Return F at time t, shape (6,)."""
        return self._constant if self._function is None else vector("wrench", self._function(t), 6)

    def world_force(self, t: float, x: MechanicalState) -> Array:
        """Return the force of F in the world's axes, shape (3,) [N]: to be drawn."""
        force = self.wrench(t)[:3]
        rotated: Array = x.placement(self.frame).rotation @ force if self.reference == "local" else force
        return rotated

    def __call__(self, t: float, x: MechanicalState) -> Array:
        """Return f_e = 𝒥ᵀF at time t."""
        force: Array = self.wrench(t).dot(x.frame_jacobian(self.frame, self.reference))
        return force


def wrenches_of(disturbance: Any) -> tuple[Wrench, ...]:
    """Return the wrenches at frames that a disturbance is, or is a sum of."""
    if isinstance(disturbance, Wrench):
        return (disturbance,)
    if isinstance(disturbance, Sum):
        return wrenches_of(disturbance.parts[0]) + wrenches_of(disturbance.parts[1])
    return ()
