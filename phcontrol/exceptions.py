"""The errors of phcontrol: one root, a few children, each with the evidence it was raised on.

Those that carry more than names and numbers stand beside what they carry: ``SimulationError`` and its log,
``UnreachableTargetError`` and its posture.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any


class PHControlError(Exception):
    """Root of every error that phcontrol raises on purpose."""

    exit_code = 2
    """With which the command line ends on it."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle message and evidence. Python would call the constructor with the message alone."""
        return _restored, (type(self), self.args, self.__dict__)


def _restored(kind: type[PHControlError], args: tuple[object, ...], evidence: dict[str, object]) -> PHControlError:
    error = kind.__new__(kind, *args)
    error.__dict__.update(evidence)
    return error


class InvalidArgumentError(PHControlError, ValueError):
    """An argument is out of its domain. The message names it, what was wrong, and what would be right."""

    def __init__(self, name: str, problem: str) -> None:
        super().__init__(f"{name}: {problem}")
        self.name = name


class AnswerError(InvalidArgumentError):
    """A method of a law answered with something else than it is asked for. The message names class and method."""

    def __init__(self, law: type, method: str, problem: str) -> None:
        PHControlError.__init__(self, f"{law.__name__}.{method} {problem}")
        self.name = method


class UnknownNameError(PHControlError, LookupError):
    """A robot, joint, frame, controller or option of that name does not exist. Lists those that do."""

    def __init__(self, kind: str, name: str, known: Iterable[str], where: str = "") -> None:
        self.kind, self.name, self.known = kind, str(name), sorted(known)
        close = difflib.get_close_matches(self.name, self.known, n=1)
        hint = f" Did you mean '{close[0]}'?" if close else ""
        listing = ", ".join(self.known) or "none"
        super().__init__(f"unknown {kind} '{name}'{where}.{hint} Known: {listing}.")


class RobotDescriptionError(PHControlError):
    """A robot description cannot be read, or describes something that is not a fixed-base arm."""


class RobotDescriptionWarning(UserWarning):
    """A robot description is used as it is, but says something that a user should know."""


class MissingMeasurementError(PHControlError):
    """A controller needs a measurement that it was not given."""

    def __init__(self, controller: str, measurement: str) -> None:
        super().__init__(
            f"{controller} needs the measurement '{measurement}': "
            f"pass it as Measured({measurement}=...), or let simulate() provide it"
        )
        self.controller, self.measurement = controller, measurement


class NonFiniteTorqueError(PHControlError):
    """A law gave a torque that is not finite; it is not handed out. Carries time, state and torque."""

    def __init__(self, controller: str, time: float, **evidence: object) -> None:
        values = "; ".join(f"{key} = {value}" for key, value in evidence.items())
        super().__init__(f"{controller} gave a torque that is not finite at t = {time:g} s ({values})")
        self.time, self.evidence = time, evidence


class ObjectLostError(PHControlError):
    """The object that a servo law steers by is not seen; no torque is made of it. Carries time and features."""

    def __init__(self, controller: str, time: float, features: object, problem: str) -> None:
        super().__init__(
            f"{controller} lost its object at t = {time:g} s: {problem}. With lost='hold' the arm would stop and wait"
        )
        self.controller, self.time, self.features = controller, time, features


class DataFileError(PHControlError):
    """A file of phcontrol cannot be read or written."""
