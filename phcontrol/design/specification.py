"""What a specification must state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np

from phcontrol._validation import Array
from phcontrol.design.design_problem import DesignProblem


class Choice(NamedTuple):
    """The gains that a specification comes to."""

    gains: dict[str, Any]
    """Arguments of the law by name."""
    poles: Array = np.zeros(0, dtype=complex)
    """Where its poles should be, as far as the specification says; complex [1/s]."""
    exact: bool = True
    """Whether they do what is desired; else the notes say what is in the way."""
    notes: tuple[str, ...] = ()
    """What is to be known of it, in words."""


class Specification(ABC):
    """What a closed loop should do, from which ``design_gains`` makes the gains of a law.

    Example:
        >>> from phcontrol import DesiredBandwidth, Specification
        >>> isinstance(DesiredBandwidth(6.0, 0.7), Specification), str(DesiredBandwidth(6.0, 0.7))
        (True, 'bandwidth 6 rad/s, damping ratio 0.7')
    """

    @abstractmethod
    def choose(self, problem: DesignProblem) -> Choice:
        """Return the gains. Raises InvalidArgumentError or PHControlError where no gains of the law do that."""

    @abstractmethod
    def __str__(self) -> str:
        """Return it in words."""
