"""Motions that tell the parameters of an arm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, count, instance, number, vector
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.identification.parameters import GROUPS, Parameters, parameters_of, torque_columns
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.safety.limits import Limits
from phcontrol.trajectories.fourier_series import FourierSeries
from phcontrol.trajectories.trajectory import Reference

_FINE = 400  # times of a period at which limits of position and speed are looked at
_COARSE = 60  # times at which torques and regressors are
_WIDE = 0.75 * math.pi  # how far a joint without limits goes from its start [rad]
_SHORTEST, _LONGEST = 0.1, 1e4  # duration [s]
_MOST_HARMONICS, _MOST_CANDIDATES = 20, 10**5
_SHORT = 10.0  # below which a motion is one period, not two [s]


@dataclass(frozen=True)
class ExcitingTrajectory:
    """A trajectory that tells parameters, and how well: a Fourier series that begins and ends at rest.

    Example:
        >>> from phcontrol import exciting_trajectory, load_robot
        >>> found = exciting_trajectory(load_robot("pera_shoulder"), what=("viscous",), duration=8.0, candidates=10)
        >>> found.duration, found.condition <= found.first_condition, max(found.used.values()) <= 0.8 + 1e-9
        (8.0, True, True)
    """

    series: FourierSeries
    duration: float
    """How long the motion was asked for [s]; the series goes on for ever."""
    condition: float
    """Condition number of the regressor, its parameters in their usual units: 1 is best, 1000 is poor."""
    first_condition: float
    """That of the first motion that was tried."""
    used: dict[str, float]
    """The largest part of each limit that is used, by name: "position", "velocity", "torque"."""

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.series.n

    def at(self, t: float) -> Reference:
        """Return position [rad], velocity [rad/s] and acceleration [rad/s²] at time t [s]."""
        return self.series.at(t)


def exciting_trajectory(
    robot: Robot | MechanicalSystem,
    limits: Limits | None = None,
    duration: float = 20.0,
    *,
    what: Sequence[str] = GROUPS,
    frame: str | None = None,
    start: ArrayLike | None = None,
    harmonics: int = 5,
    share: float = 0.8,
    candidates: int = 150,
    seed: int = 0,
) -> ExcitingTrajectory:
    """Return a motion in which parameters show: a Fourier series of least condition number inside the limits.

    All joints swing about ``start`` as far and as fast as ``share`` of the limits of position, velocity and torque
    allows, by the model of the arm. What stands around the arm, and whether its links touch, is not looked at: watch
    the motion first (``phcontrol view``).

    Args:
        robot: the arm, with what is known of it (a payload that is guessed makes the torques it will need right).
        limits: of the arm; by default those of its description.
        duration: of the motion [s]: two periods, one below 10 s.
        what: the groups of parameters that shall show.
        frame: what carries the payload; by default the tool frame.
        start: where it begins and ends, at rest [rad]; by default near home.
        harmonics: of the series.
        share: of the limits that is used.
        candidates: how many motions are tried; the best of them are varied further.
        seed: of what is tried.

    Raises:
        InvalidArgumentError: the start is outside the limits, or no motion stays inside them.

    Example:
        >>> from phcontrol import exciting_trajectory, load_robot
        >>> motion = exciting_trajectory(load_robot("pera_shoulder"), what=("viscous", "coulomb"), candidates=20)
        >>> motion.condition <= motion.first_condition, max(motion.used.values()) <= 0.8 + 1e-9
        (True, True)
    """
    system = robot if isinstance(robot, MechanicalSystem) else MechanicalSystem(robot)
    limits = Limits(system) if limits is None else instance("limits", limits, Limits)
    if limits.lower.shape != (system.n,):
        raise InvalidArgumentError(
            "limits", f"are of {limits.lower.size} joints, but {system.robot.name} has {system.n}"
        )
    count("seed", seed, minimum=0)
    parameters = parameters_of(system.robot, what, frame)
    duration = number("duration", duration, minimum=_SHORTEST, maximum=_LONGEST)
    count("candidates", candidates, maximum=_MOST_CANDIDATES)
    place = vector("start", system.robot.near_home() if start is None else start, system.n)
    if ((place < limits.lower) | (place > limits.upper)).any():
        raise InvalidArgumentError("start", f"is outside the limits of position: {place.tolist()}")
    search = _Search(
        system,
        limits,
        parameters,
        place,
        duration / 2.0 if duration >= _SHORT else duration,
        count("harmonics", harmonics, minimum=3, maximum=_MOST_HARMONICS),
        number("share", share, minimum=0.0, exclusive=True, maximum=1.0),
    )
    series, condition, first = search.best(candidates, np.random.default_rng(seed))
    return ExcitingTrajectory(series, duration, condition, first, search.used(series))


class _Search:
    """Motions of a kind, each as large as limits allow, and how well parameters show in them."""

    def __init__(
        self,
        system: MechanicalSystem,
        limits: Limits,
        parameters: Parameters,
        start: Array,
        period: float,
        harmonics: int,
        share: float,
    ) -> None:
        self.system, self.limits, self.parameters = system, limits, parameters
        self.start, self.period, self.share = start, period, share
        self.harmonics = harmonics
        numbers = np.arange(1.0, harmonics + 1.0)
        # from rest: Σ a = 0; without acceleration: Σ l b = 0
        self._still = np.eye(harmonics) - 1.0 / harmonics
        self._smooth = np.eye(harmonics) - np.outer(numbers, numbers) / (numbers @ numbers)
        low, high = np.maximum(limits.lower, start - _WIDE), np.minimum(limits.upper, start + _WIDE)
        self._room = share * (high - start), share * (start - low)
        if (np.minimum(*self._room) <= 0.0).any():
            raise InvalidArgumentError("start", f"is at a limit of position: {start.tolist()}")
        rows = limits.effort
        self._row_scale = 1.0 / np.where(np.isfinite(rows), rows, 1.0)

    def best(self, candidates: int, generator: np.random.Generator) -> tuple[FourierSeries, float, float]:
        """Return the best motion, its condition number, and that of the first."""
        shape = (2, self.system.n, self.harmonics)
        best: tuple[float, Array, FourierSeries] | None = None
        first, step = math.inf, 1.0
        for k in range(candidates):
            explores = best is None or k < candidates // 3
            raw = generator.normal(size=shape)
            if not explores and best is not None:
                raw = best[1] + step * raw
            series = self._inside(raw)
            if series is None:
                continue
            condition = self._condition(series)
            first = condition if math.isinf(first) else first
            if best is None or condition < best[0]:
                best, step = (condition, raw, series), min(1.0, 1.3 * step)
            elif not explores:
                step = max(0.05, 0.93 * step)
        if best is None:
            raise InvalidArgumentError(
                "limits", f"leave no room for a motion about {self.start.tolist()}: holding the arm there asks for "
                f"{np.abs(self.system.at(self.start).potential_gradient).tolist()} N·m"
            )  # fmt: skip
        return best[2], best[0], first

    def _inside(self, raw: Array) -> FourierSeries | None:
        """Return the largest motion of these proportions inside the limits; None when weight alone is too much."""
        cosine, sine = raw[0] @ self._still, raw[1] @ self._smooth
        unit = FourierSeries(np.zeros(self.system.n), cosine, sine, self.period)
        times = np.linspace(0.0, self.period, _FINE, endpoint=False)
        moments = [unit.at(t) for t in times]
        position, velocity = (np.array([moment[i] for moment in moments]) for i in (0, 1))
        with np.errstate(divide="ignore"):
            ahead, behind = np.maximum(position, 0.0).max(axis=0), np.maximum(-position, 0.0).max(axis=0)
            scale = np.minimum(self._room[0] / ahead, self._room[1] / behind)
            scale = np.minimum(scale, self.share * self.limits.velocity / np.abs(velocity).max(axis=0))
        scale = scale[:, None]
        for _ in range(20):
            series = FourierSeries(self.start, scale * cosine, scale * sine, self.period)
            if self._torque(series) <= self.share:
                return series
            scale = 0.85 * scale
        return None

    def _moments(self, series: FourierSeries) -> list[Reference]:
        return [series.at(t) for t in np.linspace(0.0, self.period, _COARSE, endpoint=False)]

    def _torque(self, series: FourierSeries) -> float:
        """Return the largest part of an effort limit that a motion needs."""
        parts = []
        for q, v, a in self._moments(series):
            parts.append(np.abs(self.system.at(q, v).feedforward(v, a)) / self.limits.effort)
        return float(np.max(parts))

    def _condition(self, series: FourierSeries) -> float:
        rows = [self._row_scale[:, None] * torque_columns(self.system, self.parameters, *moment)
                for moment in self._moments(series)]  # fmt: skip
        values = np.linalg.svd(np.vstack(rows) * self.parameters.scales, compute_uv=False)
        return float(values[0] / max(values[-1], 1e-300))

    def used(self, series: FourierSeries) -> dict[str, float]:
        """Return the largest part of the limits that a motion uses."""
        moments = [series.at(t) for t in np.linspace(0.0, self.period, _FINE, endpoint=False)]
        offset = np.array([moment.position for moment in moments]) - self.start
        room = np.where(offset > 0.0, self._room[0], self._room[1]) / self.share
        velocity = np.array([moment.velocity for moment in moments])
        return {
            "position": float(np.max(np.abs(offset) / room)),
            "velocity": float(np.max(np.abs(velocity) / self.limits.velocity)),
            "torque": self._torque(series),
        }
