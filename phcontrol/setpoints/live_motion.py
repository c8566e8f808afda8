"""What may be changed while an arm runs."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import numpy as np

from phcontrol._validation import number
from phcontrol.exceptions import InvalidArgumentError, PHControlError

Place = TypeVar("Place")
"""What is reached: a posture, a pose, numbers."""


class LiveMotion(ABC, Generic[Place]):
    """A course that is changed while it is followed, smoothly: the base of live goals.

    ``request`` may be called from any thread; ``advance`` by one alone, that of the loop. A request that comes before
    the last one was taken up replaces it. What the course has been up to the last ``advance`` does not change: so a
    law that follows it stays a pure function of time.

    Args:
        origin: where it stands at first.
    """

    def __init__(self, origin: Place) -> None:
        self._origin, self._asked, self._taken = origin, origin, origin
        self._waiting: deque[Place] = deque(maxlen=1)  # appending replaces; both ends are safe from any thread
        self._now = -math.inf
        self._listener: Callable[[Place], object] | None = None
        self._unheard = [origin]

    @property
    @abstractmethod
    def duration(self) -> float:
        """When the course so far ends [s]; 0 before the first change."""

    @property
    def goal(self) -> Place:
        """What was last asked for, reached or not."""
        return self._asked

    @property
    def has_arrived(self) -> bool:
        """Whether it stood at its goal at the last ``advance``."""
        return not self._waiting and self._now >= self.duration

    def request(self, goal: Any) -> None:
        """Ask for a new goal, from any thread; it is taken up at the next ``advance``.

        Raises InvalidArgumentError for what is none; then the last goal stays.
        """
        place = self.checked(goal)
        self.ask(place)
        self.announce(place)

    def ask(self, place: Place) -> None:
        """Ask for a goal that ``checked`` returned."""
        self._asked = place
        self._waiting.append(place)

    def announce(self, place: Place) -> None:
        """Tell the law that follows of a goal that is asked for, now or for later, on the thread that asks."""
        if self._listener is None:
            self._unheard.append(place)
        else:
            self._listener(place)

    def heard_by(self, listener: Callable[[Place], object]) -> None:
        """Call a function with each goal that is asked for: at once with those that nobody has heard of yet.

        The last listener alone is told: that of the law that was made last.
        """
        self._listener = listener
        unheard, self._unheard = self._unheard, []
        for place in unheard:
            listener(place)

    def advance(self, t: float) -> None:
        """Take up what was asked for, from time t on [s]; called before the course is asked for at t.

        Raises InvalidArgumentError when time goes backwards, PHControlError when there is no way to what was asked for
        within the limits: then the course goes on to the last goal.
        """
        now = number("t", t)
        if now < self._now:
            raise InvalidArgumentError("t", f"must not go backwards, but {now:g} s comes after {self._now:g} s")
        self._now = now
        if self._waiting and self._is_free(now):
            goal = self._waiting.popleft()
            try:
                self._redirect(now, goal)
            except PHControlError:
                if not self._waiting:
                    self._asked = self._taken
                raise
            self._taken = goal

    @staticmethod
    def plain(t: float) -> float:
        """Return a time that is a number [s]. Raises InvalidArgumentError for any other, such as a compiler's symbol.

        A course knows its future only when it is there: what is compiled of it would stay what it is now.
        """
        if not isinstance(t, (float, int, np.floating, np.integer)):
            message = f"must be a number, but is {type(t).__name__}: a course that changes as it goes is not compiled"
            raise InvalidArgumentError("t", message)
        return t

    def _is_free(self, t: float) -> bool:
        """Whether a change can be taken up at time t; else it waits."""
        return True

    @abstractmethod
    def checked(self, goal: Any) -> Place:
        """Return a goal as it is kept. Raises InvalidArgumentError."""

    @abstractmethod
    def _redirect(self, t: float, goal: Place) -> None:
        """Let the course go to a goal, from time t on [s]."""
