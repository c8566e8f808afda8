"""What a specification came to."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from phcontrol._validation import Array
from phcontrol.analysis.linearization import Linearization
from phcontrol.analysis.modes import Mode
from phcontrol.controllers.controller import Controller

_DIGITS = 7  # of gains on the command line
_NOTHING = 1e-9  # of the largest entry, below which one is rounding
_SAME = 1e-3  # by which modes that are printed as one may differ
MET = 0.02
"""By how much poles may be off what is desired, relatively."""


@dataclass(frozen=True)
class DesignedGains:
    """Gains for a specification, with what the loop about its rest then does.

    Example:
        >>> from phcontrol import DesiredBandwidth, MechanicalSystem, design_gains, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> found = design_gains("integral_action", system, DesiredBandwidth(9.0, 0.8))
        >>> found.met, found.stable, len(found.poles) == len(found.linear.eigenvalues)
        (True, True, True)
    """

    controller: str
    """Name of the law."""
    specification: str
    """What was desired, in words."""
    gains: dict[str, Any]
    """Keyword arguments of ``make_controller`` and of the law."""
    law: Controller = field(repr=False)
    """The law with these gains."""
    linear: Linearization | None = field(repr=False)
    """The loop about its rest; None for a law that follows something and has none."""
    poles: Array = field(repr=False)
    """Where poles should be, as far as the specification says; complex [1/s]."""
    exact: bool
    """Whether gains of the law can do that; the notes say what is in the way."""
    notes: tuple[str, ...]
    """What is to be known of it, in words."""

    @property
    def spectrum(self) -> tuple[Mode, ...]:
        """The modes that were achieved, slowest first."""
        return () if self.linear is None else self.linear.spectrum

    @property
    def stable(self) -> bool:
        """Whether no mode grows. Motions of a redundant arm that leave its hand alone may stay."""
        if self.linear is None:
            return True
        return not bool((self.linear.eigenvalues.real - self.linear.uncertainty > 0.0).any())

    @property
    def deviation(self) -> float:
        """By how much the poles are off what is desired, relatively, each against its own; NaN where nothing says."""
        if not self.poles.size or self.linear is None:
            return math.nan
        off = np.abs(self.poles[:, None] - self.linear.eigenvalues[None, :]) / np.abs(self.poles)[:, None]
        rows, columns = linear_sum_assignment(off)
        return float(off[rows, columns].max())

    @property
    def met(self) -> bool:
        """Whether the poles are within 2 % of those of the specification, as far as it says."""
        return self.exact and self.stable and not self.deviation > MET

    def command(self, robot: str | None = None) -> str:
        """Return the command that uses the gains, for an arm as it is given on the command line, with all its options.

        By default its name and what is locked of it.
        """
        arm = self.law.system.robot
        kind = "run position" if self.law.run == "position" and not self.law.time_span else "analyze"
        parts = [f"phcontrol {kind} --controller {self.controller} --robot"]
        parts.append(robot or " ".join([arm.name, *(f"--lock {joint}" for joint in arm.locked_joints)]))
        if self.law.interconnection != "coriolis":
            parts.append(f"--interconnection {self.law.interconnection}")
        goal = self.law.target_posture(0.0)
        if goal is not None and not self.law.time_span:
            parts.append("--goal=" + ",".join(f"{each:.{_DIGITS}g}" for each in goal))
        parts += [f"--set '{name}={text_of(value)}'" for name, value in self.gains.items() if value is not None]
        return " ".join(parts)

    def record(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {
            "controller": self.controller,
            "robot": self.law.system.robot.name,
            "specification": self.specification,
            "gains": {name: np.asarray(value).tolist() for name, value in self.gains.items() if value is not None},
            "stable": self.stable,
            "met": self.met,
            "deviation": self.deviation if math.isfinite(self.deviation) else None,
            "modes": [
                {
                    "eigenvalue": [mode.eigenvalue.real, mode.eigenvalue.imag],
                    "frequency": mode.frequency,
                    "damping_ratio": mode.damping_ratio if math.isfinite(mode.damping_ratio) else None,
                }
                for mode in self.spectrum
            ],
            "longest_period": None if self.linear is None else _finite(self.linear.longest_period(1)),
            "notes": list(self.notes),
        }

    def __str__(self) -> str:
        """Return the gains and what they achieve, as text."""
        lines = [f"{self.controller} on {self.law.system.robot.name}: {self.specification}"]
        lines += [f"  {name} = {_shown(value)}" for name, value in self.gains.items() if value is not None]
        if self.linear is None:
            lines.append("  it follows something: the errors' loop has these poles, and no rest to look about")
        else:
            lines.append("  about its rest: " + ("no mode grows" if self.stable else "UNSTABLE"))
            lines += [f"    {text}" for text in _distinct(self.spectrum)]
            if math.isfinite(self.deviation):
                lines.append(f"  poles off what is desired by at most {self.deviation:.2g}, relatively")
            period = self.linear.longest_period(1)
            held = f"{1e3 * period:.3g} ms" if math.isfinite(period) else "any length"
            lines.append(f"  torque held, and a period late: stable up to a period of {held}")
        lines += [f"  note: {note}" for note in self.notes]
        return "\n".join(lines)


def text_of(value: Any) -> str:
    """Return a gain as --set takes it: a number, a list of a diagonal, or rows."""
    array = np.array(value, dtype=float)
    array[np.abs(array) < _NOTHING * np.abs(array).max(initial=0.0)] = 0.0
    if array.ndim == 2 and not (array - np.diag(array.diagonal())).any():
        array = array.diagonal()
    if array.ndim == 1 and array.size and (array == array[0]).all():
        array = array[0]
    if array.ndim == 0:
        return f"{float(array):.{_DIGITS}g}"
    rows = array[None, :] if array.ndim == 1 else array
    return "; ".join(",".join(f"{each:.{_DIGITS}g}" for each in row) for row in rows)


def _shown(value: Any) -> str:
    array = np.asarray(value, dtype=float)
    if array.ndim < 2:
        return np.array2string(array, precision=4)
    return np.array2string(array, precision=4, suppress_small=True, max_line_width=110, prefix=" " * 6)


def _distinct(modes: tuple[Mode, ...]) -> list[str]:
    """Return the modes in words, those that are alike together."""
    groups: list[tuple[Mode, int]] = []
    for mode in modes:
        for k, (known, times) in enumerate(groups):
            if abs(known.eigenvalue - mode.eigenvalue) <= _SAME * known.frequency:
                groups[k] = known, times + 1
                break
        else:
            groups.append((mode, 1))
    return [
        f"{times} × ω = {mode.frequency:.4g} rad/s, " + (f"ζ = {mode.damping_ratio:.3f}" if mode.oscillates else "real")
        for mode, times in groups
    ]


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
