"""What was identified: values with their uncertainty, how well they predict, and the arm that has them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phcontrol._validation import Array, choice
from phcontrol.mechanics.payload import Payload
from phcontrol.mechanics.robot import Robot

WORSE = 2.0
"""Times that of the fit, beyond which an error of prediction on data kept back is doubted."""
_NOTHING = 1e-4
"""Part of the torque, below which an error of prediction is none: sums over samples are as exact as that."""


@dataclass(frozen=True)
class Prediction:
    """Torques, averaged over windows: measured, by the model as it was, and by the identified one."""

    time: Array
    """Middles of the windows [s], shape (windows,); logs one after another."""
    measured: Array
    """Shape (windows, n) [N·m]."""
    before: Array
    """By the model as it was."""
    after: Array
    """By the identified one."""
    kept_back: NDArray[np.bool_]
    """Whether a window was kept back from the fit, shape (windows,)."""

    def error(self, which: str, *, kept_back: bool) -> Array:
        """Return the root mean square of "before" or "after" less measured, a joint each, shape (n,) [N·m].

        NaN where there are no such windows.
        """
        choice("prediction", which, ("before", "after"))
        predicted = self.before if which == "before" else self.after
        rows = self.kept_back if kept_back else ~self.kept_back
        if not rows.any():
            return np.full(self.measured.shape[1], np.nan)
        error: Array = np.sqrt(np.mean((predicted[rows] - self.measured[rows]) ** 2, axis=0))
        return error


@dataclass(frozen=True)
class Identification:
    """The result of :func:`identify`. ``robot`` goes wherever an arm does; ``str()`` is a report.

    Example:
        >>> from phcontrol import MechanicalSystem, exciting_trajectory, identify, load_robot, make_controller
        >>> from phcontrol import simulate
        >>> robot = load_robot("pera_shoulder")
        >>> system = MechanicalSystem(robot)
        >>> motion = exciting_trajectory(robot, what=("viscous",), duration=8.0, candidates=10)
        >>> law = make_controller("tracking", system, trajectory=motion)
        >>> log = simulate(system, law, duration=8.0, dt=4e-3)
        >>> found = identify([log], ["viscous"], model=system)
        >>> bool(abs(found.robot.friction.viscous - robot.friction.viscous).max() < 1e-3)  # [N·m·s/rad]
        True
    """

    robot: Robot
    """The arm with what was identified: payload, friction, rotors and offsets."""
    names: tuple[str, ...]
    """Of the parameters."""
    units: tuple[str, ...]
    values: Array
    """Of the parameters, those that bodies and joints can have."""
    deviations: Array
    """Standard deviations of the least-squares estimate."""
    covariance: Array
    """Of the estimate, shape (parameters, parameters)."""
    untold: tuple[str, ...]
    """Parameters that the data do not tell: their values are those of the model."""
    corrected: tuple[str, ...]
    """What least squares alone made impossible, so that the nearest possible values were taken."""
    payload: Payload | None
    """The body at its frame; None when it was not asked for."""
    prediction: Prediction
    doubts: tuple[str, ...] = ()
    """What speaks against the logs themselves; with any of these nothing is confirmed."""

    def __getitem__(self, name: str) -> float:
        """Return a parameter's value by its name. Raises UnknownNameError, listing them."""
        return float(self.values[self.names.index(choice("parameter", name, self.names))])

    def deviation(self, name: str) -> float:
        """Return a parameter's standard deviation by its name."""
        return float(self.deviations[self.names.index(choice("parameter", name, self.names))])

    @property
    def passed(self) -> bool:
        """Whether data kept back confirm it, and nothing speaks against the logs.

        The model must not predict worse than before, and no more than twice worse than where it was fitted; errors
        below 1e-4 of the torque are none.
        """
        if self.doubts or not self.prediction.kept_back.any():
            return False
        fitted, kept, before = (
            float(np.linalg.norm(self.prediction.error(which, kept_back=back)))
            for which, back in (("after", False), ("after", True), ("before", True))
        )
        measured = self.prediction.measured[self.prediction.kept_back]
        nothing = _NOTHING * float(np.sqrt(np.mean(np.sum(measured**2, axis=1))))
        return kept <= before + nothing and kept <= WORSE * fitted + 1e-3 * before + nothing

    @property
    def verdict(self) -> str:
        """What the data kept back say, in words."""
        if not self.prediction.kept_back.any():
            return "none kept back: NOT confirmed by any"
        kept = int(self.prediction.kept_back.sum())
        return f"{kept} kept back: " + ("confirmed by these" if self.passed else "NOT confirmed")

    def to_dict(self) -> dict[str, Any]:
        """Return values, deviations and errors of prediction, for JSON."""
        prediction = self.prediction
        return {
            "robot": self.robot.label,
            "parameters": {
                name: {
                    "value": float(value),
                    "deviation": float(deviation),
                    "unit": unit,
                    "told": name not in self.untold,
                }
                for name, value, deviation, unit in zip(
                    self.names, self.values, self.deviations, self.units, strict=True
                )
            },
            "payload": None if self.payload is None else self.payload.record(),
            "corrected": list(self.corrected),
            "doubts": list(self.doubts),
            "error_before": _numbers(prediction.error("before", kept_back=True)),
            "error_after": _numbers(prediction.error("after", kept_back=True)),
            "error_fitted": _numbers(prediction.error("after", kept_back=False)),
            "passed": self.passed,
        }

    def __str__(self) -> str:
        kept = int(self.prediction.kept_back.sum())
        lines = [
            f"identified {len(self.names) - len(self.untold)} parameters of {self.robot.name} from "
            f"{len(self.prediction.time) - kept} windows, {self.verdict}",
            *(f"  doubted: {doubt}" for doubt in self.doubts),
        ]
        if self.payload is not None:
            com = ", ".join(f"{x:.4g}" for x in self.payload.com)
            lines.append(f"  payload: {self.payload}, centre of mass at ({com}) m")
        for name, value, deviation, unit in zip(self.names, self.values, self.deviations, self.units, strict=True):
            note = "  not told by the data" if name in self.untold else ""
            lines.append(f"  {name:<34}{value:>11.5f} ± {deviation:.1e} {unit}{note}")
        lines += [f"  made possible: {name}" for name in self.corrected]
        if not kept:
            return "\n".join(lines)
        lines.append("  error of predicted torque on data kept back, before and after [N·m]:")
        errors = (self.prediction.error(which, kept_back=True) for which in ("before", "after"))
        for name, before, after in zip(self.robot.joint_names, *errors, strict=True):
            lines.append(f"    {name:<32}{before:>11.4f}{after:>11.4f}")
        return "\n".join(lines)


def _numbers(values: Array) -> list[float | None]:
    """Return numbers for JSON, which has no NaN."""
    return [float(value) if np.isfinite(value) else None for value in values]
