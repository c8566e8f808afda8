"""A body that an arm carries beside what its description says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array, number, text, vector
from phcontrol.exceptions import InvalidArgumentError

HEAVIEST = 1e6
"""Mass [kg] beyond which a payload is refused."""
ROUNDING = 1e-9
"""Part of the largest principal moment by which rounding may contradict the laws of rigid bodies."""


class Payload:
    """A rigid body that is fixed to a frame of an arm: a tool, a gripper, what the hand holds.

    It adds its inertia to the link of that frame, as a link on a fixed joint would: M(q), C(q, q̇) and g(q) of the arm
    contain it everywhere. Of the principal moments I₁ ≤ I₂ ≤ I₃ about the centre of mass none may be negative, and
    I₃ ≤ I₁ + I₂, as in every rigid body.

    Args:
        mass: [kg], not negative.
        com: centre of mass in the frame's axes, from its origin, shape (3,) [m].
        inertia: moments about the centre of mass in the frame's axes [kg m²]: a symmetric (3, 3) matrix, or its
            diagonal (3,). By default zero: a point mass.
        frame: the frame (a link's name) that it is fixed to; by default the robot's tool frame.

    Raises InvalidArgumentError, which names the argument.

    Example:
        >>> from phcontrol import Payload, load_robot
        >>> load_robot("panda", payload=Payload(1.0, com=(0.0, 0.0, 0.05), frame="panda_hand")).label
        'panda with 1 kg at panda_hand'
    """

    def __init__(
        self,
        mass: float,
        com: ArrayLike = (0.0, 0.0, 0.0),
        inertia: ArrayLike = (0.0, 0.0, 0.0),
        frame: str | None = None,
    ) -> None:
        self.mass = number("payload.mass", mass, minimum=0.0, maximum=HEAVIEST)
        """[kg]."""
        self.com: Array = vector("payload.com", com, 3)
        """Centre of mass in the frame, shape (3,) [m]."""
        self.inertia: Array = _moments(inertia, self.mass)
        """Moments about the centre of mass, shape (3, 3) [kg m²]."""
        self.frame = None if frame is None else text("payload.frame", frame)
        """The frame that carries it; None for the robot's tool frame."""

    def __repr__(self) -> str:
        return f"<Payload: {self}>"

    def __str__(self) -> str:
        return f"{self.mass:.4g} kg at {self.frame or 'the tool frame'}"

    @property
    def spatial(self) -> pin.Inertia:
        """The body as an inertia of Pinocchio, in the frame's axes."""
        return pin.Inertia(self.mass, np.array(self.com), np.array(self.inertia))

    def record(self) -> dict[str, Any]:
        """Return, for JSON, what :meth:`from_record` makes it of again."""
        return {"mass": self.mass, "com": self.com.tolist(), "inertia": self.inertia.tolist(), "frame": self.frame}

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Payload:
        """Return the payload of which :meth:`record` was kept. Raises KeyError or InvalidArgumentError."""
        return cls(record["mass"], record["com"], record["inertia"], record["frame"])


def _moments(value: ArrayLike, mass: float) -> Array:
    """Return moments of inertia that a rigid body of this mass can have, shape (3, 3)."""
    name = "payload.inertia"
    array = finite_array(name, value)
    if array.shape == (3,):
        array = np.diag(array)
    if array.shape != (3, 3):
        raise InvalidArgumentError(
            name, f"must be a (3, 3) matrix or its diagonal (3,) [kg m²], but has shape {array.shape}"
        )
    largest = float(np.abs(array).max())
    if np.abs(array - array.T).max() > ROUNDING * largest:
        raise InvalidArgumentError(name, f"must be symmetric, but is {array.tolist()}")
    small, middle, large = (float(moment) for moment in np.linalg.eigvalsh(array))
    listed = f"has the principal moments {small:g}, {middle:g} and {large:g} kg m² about the centre of mass"
    if small < -ROUNDING * largest:
        raise InvalidArgumentError(name, f"{listed}; none may be negative")
    if large - middle - small > ROUNDING * large:
        raise InvalidArgumentError(name, f"{listed}; in a rigid body the largest is at most the sum of the others")
    if mass == 0.0 and large > 0.0:
        raise InvalidArgumentError(name, f"{listed}, but no mass; give the mass, or no moments")
    moments: Array = 0.5 * (array + array.T)
    moments.flags.writeable = False
    return moments


def check_payloads(value: Any) -> tuple[Payload, ...]:
    """Return one payload, several or none as a tuple. Raises InvalidArgumentError for anything else."""
    if value is None:
        return ()
    payloads = (value,) if isinstance(value, Payload) else value
    if not isinstance(payloads, (list, tuple)) or not all(isinstance(item, Payload) for item in payloads):
        raise InvalidArgumentError("payload", f"must be a Payload, or a list of them, but is {value!r}")
    return tuple(payloads)
