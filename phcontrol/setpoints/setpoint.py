"""What a user asks of an arm while it runs."""

from __future__ import annotations

import heapq
import math
from itertools import count
from typing import Any

from phcontrol._validation import number
from phcontrol.exceptions import InvalidArgumentError, UnknownNameError
from phcontrol.setpoints.live_motion import LiveMotion


class Setpoint:
    """Live parts by name, which ``ControlLoop`` and ``simulate`` bring up to date before each step.

    The laws that follow them stay what they are: pure functions of time. ``change`` may be called from any thread.

    Args:
        parts: by name, for instance ``goal=LiveFramePath(…), stiffness=LiveValue(…)``; give the same objects to the
            law, as its reference and the like.

    Raises:
        InvalidArgumentError: no parts, or one that is not live.

    Example:
        >>> from phcontrol import EnergyShaping, MechanicalSystem, load_robot, simulate
        >>> from phcontrol.setpoints import LiveTrajectory, Setpoint
        >>> arm = MechanicalSystem(load_robot("pera_shoulder"))
        >>> goal = LiveTrajectory(arm.robot, [0.0, 0.0])
        >>> law = EnergyShaping.tuned(arm, reference=goal)
        >>> setpoint = Setpoint(goal=goal)
        >>> setpoint.change(goal=[0.4, 0.2], at=0.5)
        >>> log = simulate(arm, law, duration=3.0, q0=[0.0, 0.0], setpoint=setpoint)
        >>> bool(abs(log.position[-1] - [0.4, 0.2]).max() < 1e-6)
        True
    """

    def __init__(self, **parts: LiveMotion[Any]) -> None:
        if not parts:
            raise InvalidArgumentError("parts", "must name what can be changed, for instance goal=LiveTrajectory(...)")
        if "at" in parts:
            raise InvalidArgumentError("at", "is the time of a change, and no name for a part: call it otherwise")
        for name, part in parts.items():
            if not isinstance(part, LiveMotion):
                message = f"must be live, for instance a LiveFramePath or LiveValue, but is {type(part).__name__}"
                raise InvalidArgumentError(name, message)
        self.parts = parts
        self._order = count()
        self._later: list[tuple[float, int, str, Any]] = []
        self._time = -math.inf

    @property
    def time(self) -> float:
        """That of the loop, as of its last step [s]; −inf before the first."""
        return self._time

    @classmethod
    def check(cls, value: Any) -> None:
        """Raise InvalidArgumentError, naming ``setpoint``, for what is neither one nor None."""
        if value is not None and not isinstance(value, cls):
            raise InvalidArgumentError("setpoint", f"must be a Setpoint, but is {type(value).__name__}")

    def change(self, *, at: float | None = None, **goals: Any) -> None:
        """Ask for new goals, by the names of the parts.

        Args:
            at: from which time of the loop on [s]; by default from the next step. Changes for later are for scripted
                runs, and must be asked for before the run starts.
            goals: one for each part that shall change.

        Raises:
            UnknownNameError: there is no such part.
            InvalidArgumentError: what one refuses; then none has changed.
        """
        for name in goals:
            if name not in self.parts:
                raise UnknownNameError("part of the setpoint", name, list(self.parts))
        checked = {name: self.parts[name].checked(goal) for name, goal in goals.items()}
        later = None if at is None else number("at", at, minimum=self._time)
        for name, goal in checked.items():
            if later is None:
                self.parts[name].ask(goal)
            else:
                heapq.heappush(self._later, (later, next(self._order), name, goal))
            self.parts[name].announce(goal)

    def advance(self, t: float) -> None:
        """Take up what was asked for until time t [s]; called by the loop."""
        while self._later and self._later[0][0] <= t:
            _, _, name, goal = heapq.heappop(self._later)
            self.parts[name].ask(goal)
        for part in self.parts.values():
            part.advance(t)
        self._time = t
