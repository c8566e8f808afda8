"""What section 4.2 prints of its figures."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Printed:
    """The thesis's numbers for one body."""

    contact: tuple[float, float | None]
    """Of the rest-length law and the classical ones [s]."""
    impact: tuple[float, float, float]
    """In the order of ``LAWS`` [N·m]."""
    settled: tuple[float, float | None, float | None]
    """When f_d is there, likewise [s]: "at t > 0.90 s", "(4.60) and (4.61) take t > 2 s, and t > 2.5 s"."""


PRINTED = {
    ("rigid", False): Printed((0.60, 0.80), (0.10, 0.40, 0.60), (0.90, 2.5, 2.0)),
    ("compliant", False): Printed((0.80, 1.30), (0.00, 0.20, 0.30), (0.90, 2.5, 2.0)),
    ("rigid", True): Printed((0.55, None), (0.05, 0.25, 0.40), (0.70, None, None)),
    ("compliant", True): Printed((0.78, None), (0.00, 0.05, 0.15), (1.20, None, None)),
}
