"""Bodies that an arm can touch, and the one-sided spring and damper between surfaces."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from phcontrol._validation import Array, number, positive
from phcontrol.environments.contact_friction import ContactFriction
from phcontrol.environments.contact_geometry import ContactGeometry
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState


class Touch(NamedTuple):
    """What a body does at one state of arm and body."""

    force: Array
    """f_e of the body on the joints, shape (n,) [N·m]."""
    state_rate: Array
    """Rate of the body's own state."""
    magnitude: float
    """The contact force, ≥ 0 [N, or N·m for a joint]."""
    stored: float
    """Energy in the body and the contact [J]."""
    dissipated: float
    """Power lost in them, ≥ 0 [W]."""


class Body(ABC):
    """Something in the way of an arm. Without hidden state: its state is integrated with the loop.

    Example:
        >>> from phcontrol.environments.body import Touch
        >>> import numpy as np
        >>> from phcontrol import Body, JointContact, MechanicalSystem, load_robot
        >>> class Wall(Body):  # a spring [N·m/rad] without losses, and without a state of its own
        ...     def initial_state(self):
        ...         return np.zeros(0)
        ...     def touch(self, x, state):
        ...         gap = self.geometry.gap(x)
        ...         depth = max(0.0, -gap.distance)
        ...         return Touch(20.0 * depth * gap.slope, np.zeros(0), 20.0 * depth, 10.0 * depth**2, 0.0)
        ...     def fastest_rate(self, x):
        ...         return 10.0
        >>> wall = Wall(JointContact("gripper", 0.2))
        >>> wall.touch(MechanicalSystem(load_robot("pera_gripper")).at([0.1]), wall.initial_state()).force  # [N·m]
        array([2.])
    """

    def __init__(self, geometry: ContactGeometry) -> None:
        self.geometry = geometry

    @property
    def state_size(self) -> int:
        """Length of the body's own state."""
        return 0

    @abstractmethod
    def initial_state(self) -> Array:
        """Return the body's state at rest."""

    @abstractmethod
    def touch(self, x: MechanicalState, state: Array) -> Touch:
        """Return forces, rates, energy and losses at a state of the arm and of the body."""

    def displacement(self, state: Array) -> float:
        """Return how far the body's surface is pushed in along the gap [m or rad]."""
        return 0.0

    def record(self) -> dict[str, Any]:
        """Return what it is and where, for logs; with it, a viewer draws the body again."""
        describe = getattr(self.geometry, "record", None)
        return {"kind": type(self).__name__, "geometry": {"kind": "other"} if describe is None else describe()}

    @abstractmethod
    def fastest_rate(self, x: MechanicalState) -> float:
        """Return the fastest rate [1/s] at which contact reacts at a state: sets the largest stable step."""


@runtime_checkable
class SlidingGeometry(ContactGeometry, Protocol):
    """A geometry on which what touches can slide."""

    def slip(self, x: MechanicalState) -> Array:
        """Return S, shape (3, n): S q̇ is how fast the touching points slide on each other [m/s]."""
        ...


class Rubbing:
    """The friction of a body's surface, as far as it has any.

    Args:
        geometry: where it is touched.
        friction: μ; 0 for none.
        slip_speed: v₀ [m/s], see :class:`ContactFriction`.

    Raises:
        InvalidArgumentError: friction where nothing slides, as at a joint.
    """

    def __init__(self, geometry: ContactGeometry, friction: float, slip_speed: float) -> None:
        self.friction = ContactFriction(friction, slip_speed)
        self._geometry = geometry if isinstance(geometry, SlidingGeometry) else None
        if self.friction.coefficient and self._geometry is None:
            message = f"needs a surface to slide on (SphereContact), but is given for a {type(geometry).__name__}"
            raise InvalidArgumentError("friction", message)

    def force(self, x: MechanicalState, normal_force: float) -> tuple[Array | float, float]:
        """Return the friction's force on the joints, shape (n,) [N·m] or 0, and the power it takes [W]."""
        if not self.friction.coefficient or normal_force <= 0.0 or self._geometry is None:
            return 0.0, 0.0
        slip = self._geometry.slip(x)
        force, power = self.friction.force(normal_force, slip @ x.velocity)
        return force @ slip, power


class Surface:
    """A one-sided spring and damper: F = max(0, k δ + d φ(δ) δ̇), φ = min(1, δ/δ₀), for a depth δ > 0.

    The damper sets in over the depth δ₀, so that F is continuous at first touch; F never pulls. What it
    takes from the motion is never less than what it stores: F δ̇ − d/dt ½kδ² ≥ 0 always.

    Args:
        stiffness: k [N/m or N·m/rad].
        damping: d [N·s/m or N·m·s/rad].
        onset: δ₀ [m or rad].
    """

    def __init__(self, stiffness: float, damping: float, onset: float) -> None:
        self.stiffness = positive("stiffness", stiffness)
        self.damping = number("damping", damping, minimum=0.0)
        self.onset = positive("onset", onset)

    def push(self, depth: float, speed: float) -> tuple[float, float, float]:
        """Return force F, stored energy and dissipated power at a depth δ and its rate δ̇."""
        depth = float(np.maximum(depth, 0.0))
        elastic = self.stiffness * depth
        force = float(np.maximum(0.0, elastic + self.damping * np.minimum(1.0, depth / self.onset) * speed))
        return force, 0.5 * elastic * depth, (force - elastic) * speed

    def fastest_rate(self, mass: float) -> float:
        """Return the magnitude of the fastest pole of a mass on the surface [1/s]."""
        if math.isinf(mass):
            return 0.0
        half, square = 0.5 * self.damping / mass, self.stiffness / mass
        return half + math.sqrt(half * half - square) if half * half > square else math.sqrt(square)
