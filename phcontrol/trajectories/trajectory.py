"""What a trajectory is: a desired position, velocity and acceleration at every time."""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from phcontrol._validation import Array, number
from phcontrol.exceptions import InvalidArgumentError


class Reference(NamedTuple):
    """What a trajectory asks for at one time.

    Example:
        >>> from phcontrol import Sinusoid
        >>> reference = Sinusoid([0.5], [1.0]).at(0.0)
        >>> reference.position, reference.velocity.round(9)
        (array([-0.5]), array([0.]))
    """

    position: Array
    """q_d, shape (n,) [rad]."""
    velocity: Array
    """q̇_d, shape (n,) [rad/s]."""
    acceleration: Array
    """q̈_d, shape (n,) [rad/s²]."""


@runtime_checkable
class Trajectory(Protocol):
    """A motion q_d(t) of n joints, twice differentiable. Anything with these three members is one.

    ``at`` is a pure function of time, defined for every t; what a trajectory does before it starts and
    after it ends it says itself.

    Example:
        >>> from phcontrol import Sinusoid, Trajectory
        >>> isinstance(Sinusoid([0.5], [1.0]), Trajectory), Sinusoid([0.5], [1.0]).n
        (True, 1)
    """

    @property
    def n(self) -> int:
        """Number of joints."""
        ...

    @property
    def duration(self) -> float:
        """When the motion has ended, or the length of one period if it never does [s]."""
        ...

    def at(self, t: float) -> Reference:
        """Return position [rad], velocity [rad/s] and acceleration [rad/s²] at time t [s]."""
        ...


def check_trajectory(name: str, value: Trajectory, size: int) -> Trajectory:
    """Return ``value`` when it is a trajectory of ``size`` joints with finite values at its start and end."""
    if not isinstance(value, Trajectory):
        raise InvalidArgumentError(name, f"must be a trajectory (n, duration, at), but is {type(value).__name__}")
    if value.n != size:
        raise InvalidArgumentError(name, f"must be for {size} joints, but is for {value.n}")
    for t in (0.0, number("duration", value.duration, minimum=0.0)):
        reference = value.at(t)
        if not isinstance(reference, Reference):
            raise InvalidArgumentError(name, f"must give a Reference at {t:g} s, but gives {type(reference).__name__}")
        for quantity, array in reference._asdict().items():
            is_vector = isinstance(array, np.ndarray) and array.dtype == np.float64 and array.shape == (size,)
            if not is_vector or not np.isfinite(array).all():
                message = f"must give arrays of {size} finite numbers, but its {quantity} at {t:g} s is {array}"
                raise InvalidArgumentError(name, message)
    return value
