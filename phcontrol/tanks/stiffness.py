"""A stiffness that changes with time."""

from __future__ import annotations

from collections.abc import Callable

from numpy.typing import ArrayLike

from phcontrol._validation import Array, gain, number
from phcontrol.exceptions import InvalidArgumentError

StiffnessFunction = Callable[[float], ArrayLike]
"""K(t): a scalar, three numbers or a (3, 3) matrix."""


class Stiffness:
    """The stiffness of a hand as a function of time: the whole of it, K(t), not what is added.

    Args:
        translational: t -> K_t [N/m]; None where it stays as it is.
        rotational: t -> K_r [N·m/rad]; likewise.
        duration: how long it goes on changing [s]; of one that never ends, the length of a period.

    Raises:
        InvalidArgumentError: nothing changes, or what a function returns is no positive definite matrix of three: at
            time 0 at once, at later times when a law asks for it.

    Example:
        >>> import numpy as np
        >>> from phcontrol import Stiffness
        >>> Stiffness(lambda t: 500.0 + 100.0 * np.sin(t), duration=6.28).translational(0.0)[0]
        array([500.,   0.,   0.])
    """

    def __init__(
        self,
        translational: StiffnessFunction | None = None,
        *,
        rotational: StiffnessFunction | None = None,
        duration: float,
    ) -> None:
        if translational is None and rotational is None:
            raise InvalidArgumentError("translational", "or rotational must be given: nothing changes")
        self._functions = {"translational": translational, "rotational": rotational}
        self.duration = number("duration", duration, minimum=0.0, exclusive=True)
        for name, function in self._functions.items():
            if function is None:
                continue
            if not callable(function):
                message = f"must be a function of time, but is {type(function).__name__}: a constant is the law's own"
                raise InvalidArgumentError(name, message)
            self._value(name, 0.0)

    def translational(self, t: float) -> Array | None:
        """Return K_t at time t [s], shape (3, 3) [N/m]; None where it does not change."""
        return self._value("translational", t)

    def rotational(self, t: float) -> Array | None:
        """Return K_r at time t [s], shape (3, 3) [N·m/rad]; None where it does not change."""
        return self._value("rotational", t)

    def _value(self, name: str, t: float) -> Array | None:
        function = self._functions[name]
        if function is None:
            return None
        name = f"variation: {name}"
        try:
            return gain(name, function(t), 3)
        except InvalidArgumentError as error:
            raise InvalidArgumentError(f"{name} at {t:g} s", str(error).removeprefix(f"{name}: ")) from error
