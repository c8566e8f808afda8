"""The errors of phcontrol: one root, a few children, each with the evidence it was raised on.

Those that carry more than names and numbers stand beside what they carry: ``SimulationError`` and its log,
``UnreachableTargetError`` and its posture.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any


class PHControlError(Exception):
    """Root of every error that phcontrol raises on purpose.

    Example:
        >>> from phcontrol import PHControlError, load_robot
        >>> try:
        ...     load_robot("no_such_robot")
        ... except PHControlError as error:
        ...     print(type(error).__name__)
        UnknownNameError
    """

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
    """An argument is out of its domain. The message names it, what was wrong, and what would be right.

    Example:
        >>> from phcontrol import EnergyShaping, InvalidArgumentError, MechanicalSystem, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> try:
        ...     EnergyShaping(system, goal=[0.0, 0.0], stiffness=-1.0, damping=5.0)
        ... except InvalidArgumentError as error:
        ...     print(error.name)
        stiffness
    """

    def __init__(self, name: str, problem: str) -> None:
        super().__init__(f"{name}: {problem}")
        self.name = name


class AnswerError(InvalidArgumentError):
    """A method of a law answered with something else than it is asked for. The message names class and method.

    Example:
        >>> from phcontrol import AnswerError, EnergyShaping
        >>> error = AnswerError(EnergyShaping, "storage", "returned a list, expected a number [J]")
        >>> print(error)
        EnergyShaping.storage returned a list, expected a number [J]
    """

    def __init__(self, law: type, method: str, problem: str) -> None:
        PHControlError.__init__(self, f"{law.__name__}.{method} {problem}")
        self.name = method


def nearest(name: str, known: Iterable[str]) -> str | None:
    """Return the name that somebody may have meant, one written alike or one that holds this one; None for none."""
    names = sorted(known)
    close = difflib.get_close_matches(name, names, n=1)
    if close:
        return close[0]
    by_lower = {each.lower(): each for each in names}
    wanted = name.lower()
    close = difflib.get_close_matches(wanted, by_lower, n=1)
    holding = sorted((each for each in by_lower if wanted and wanted in each), key=lambda each: (len(each), each))
    found = [*close, *holding]
    return by_lower[found[0]] if found else None


class UnknownNameError(PHControlError, LookupError):
    """A robot, joint, frame, controller or option of that name does not exist. Lists those that do.

    Example:
        >>> from phcontrol import UnknownNameError, load_robot
        >>> try:
        ...     load_robot("pera_sholder")
        ... except UnknownNameError as error:
        ...     print(str(error)[:60])
        unknown robot 'pera_sholder'; a path to a URDF, xacro or MJC
    """

    def __init__(self, kind: str, name: str, known: Iterable[str], where: str = "") -> None:
        self.kind, self.name, self.known = kind, str(name), sorted(known)
        close = nearest(self.name, self.known)
        hint = f" Did you mean '{close}'?" if close else ""
        listing = ", ".join(self.known) or "none"
        super().__init__(f"unknown {kind} '{name}'{where}.{hint} Known: {listing}.")


class RobotDescriptionError(PHControlError):
    """A robot description cannot be read, or describes something that is not a fixed-base arm.

    Example:
        >>> from phcontrol import RobotDescriptionError, load_robot
        >>> try:
        ...     load_robot("talos")  # on legs
        ... except RobotDescriptionError as error:
        ...     print(error)
        talos: has a floating base; phcontrol controls fixed-base arms
    """


class RobotDescriptionWarning(UserWarning):
    """A robot description is used as it is, but says something that a user should know.

    Example:
        >>> import warnings
        >>> from phcontrol import load_robot
        >>> with warnings.catch_warnings(record=True) as said:
        ...     warnings.simplefilter("always")
        ...     robot = load_robot("alex_nub_hands")
        >>> {warning.category.__name__ for warning in said} <= {"RobotDescriptionWarning"}
        True
    """


class MissingMeasurementError(PHControlError):
    """A controller needs a measurement that it was not given.

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, MissingMeasurementError, load_robot, make_controller
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = make_controller("force_feedback_measured", system)
        >>> try:
        ...     law.evaluate(0.0, system.at([0.0, 0.0]), np.zeros(2))
        ... except MissingMeasurementError as error:
        ...     print(str(error)[:51])
        force_feedback needs the measurement 'external_forc
    """

    def __init__(self, controller: str, measurement: str) -> None:
        super().__init__(
            f"{controller} needs the measurement '{measurement}': "
            f"pass it as Measured({measurement}=...), or let simulate() provide it"
        )
        self.controller, self.measurement = controller, measurement


class NonFiniteTorqueError(PHControlError):
    """A law gave a torque that is not finite; it is not handed out. Carries time, state and torque.

    Example:
        >>> from phcontrol import NonFiniteTorqueError
        >>> try:
        ...     raise NonFiniteTorqueError("spring", 0.2, torque=[float("nan")])
        ... except NonFiniteTorqueError as error:
        ...     print(str(error)[:39])
        spring gave a torque that is not finite
    """

    def __init__(self, controller: str, time: float, **evidence: object) -> None:
        values = "; ".join(f"{key} = {value}" for key, value in evidence.items())
        super().__init__(f"{controller} gave a torque that is not finite at t = {time:g} s ({values})")
        self.time, self.evidence = time, evidence


class ObjectLostError(PHControlError):
    """The object that a servo law steers by is not seen; no torque is made of it. Carries time and features.

    Example:
        >>> import numpy as np
        >>> from phcontrol import HamiltonianServo, Measured, MechanicalSystem, ObjectLostError, PinholeCamera
        >>> from phcontrol import load_robot
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> servo = HamiltonianServo.tuned(system, [0.0, 0.0, 0.002], camera=PinholeCamera(), lost="error")
        >>> unseen = Measured(features=np.full(3, np.nan))
        >>> x = system.at(system.robot.home)
        >>> try:
        ...     servo.evaluate(0.5, x, servo.calmest_state(0.0, x, np.zeros(0)), unseen)
        ... except ObjectLostError as error:
        ...     print("lost at", error.time, "s")
        lost at 0.5 s
    """

    def __init__(self, controller: str, time: float, features: object, problem: str) -> None:
        super().__init__(
            f"{controller} lost its object at t = {time:g} s: {problem}. With lost='hold' the arm would stop and wait"
        )
        self.controller, self.time, self.features = controller, time, features


class DataFileError(PHControlError):
    """A file of phcontrol cannot be read or written.

    Example:
        >>> from phcontrol import DataFileError, Log
        >>> try:
        ...     Log.load("no_such_log.npz")
        ... except DataFileError as error:
        ...     print("refused:", "no_such_log.npz" in str(error))
        refused: True
    """
