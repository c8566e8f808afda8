"""A target as plain numbers: what a law hands over is copied and checked before anything is made of it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from phcontrol._validation import Array
from phcontrol.controllers.target import Target
from phcontrol.exceptions import InvalidArgumentError


class Promise(NamedTuple):
    """What a law promises at one state: ẋ = (J − R)∇H_d + port·f_e + driven."""

    coordinates: Array
    J: Array
    R: Array
    gradient: Array
    port: Array
    drive_port: Array
    signal: Array

    @classmethod
    def of(cls, target: Target, n: int) -> Promise:
        """Return a target's numbers. Raises InvalidArgumentError where they have wrong shapes or are not finite."""
        coordinates = _numbers("coordinates", target.coordinates, None)
        size = coordinates.size
        drive = target.drive
        signal = np.zeros(0) if drive is None else _numbers("drive.signal", drive.signal, None)
        return cls(
            coordinates=_shaped("coordinates", coordinates, (size,)),
            J=_numbers("interconnection", target.interconnection, (size, size)),
            R=_numbers("dissipation", target.dissipation, (size, size)),
            gradient=_numbers("gradient", target.gradient, (size,)),
            port=_numbers("port", target.port, (size, n)),
            drive_port=np.zeros((size, 0))
            if drive is None
            else _numbers("drive.port", drive.port, (size, signal.size)),
            signal=signal,
        )

    @property
    def driven(self) -> Array:
        """The part of ẋ that the drive makes."""
        driven: Array = self.drive_port @ self.signal
        return driven

    @property
    def dissipation_root(self) -> Array:
        """R^½, symmetric: |R^½∇H_d|² is what is lost."""
        values, vectors = np.linalg.eigh(self.R)
        root: Array = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
        return root

    def rate(self, force: Array) -> Array:
        """Return ẋ as promised, under an external force [N·m]."""
        rate: Array = (self.J - self.R) @ self.gradient + self.port @ force + self.driven
        return rate


def _numbers(name: str, value: Any, shape: tuple[int, ...] | None) -> Array:
    """Return a plain copy of an array of real numbers."""
    if not isinstance(value, np.ndarray) or value.dtype != np.float64 or np.ma.isMaskedArray(value):
        kind = f"holds {value.dtype}" if isinstance(value, np.ndarray) else f"is {type(value).__name__}"
        raise InvalidArgumentError(f"target.{name}", f"must be an array of float64, but {kind}")
    copy = np.array(value, dtype=np.float64, subok=False)
    if not np.isfinite(copy).all():
        raise InvalidArgumentError(f"target.{name}", "must be finite")
    return copy if shape is None else _shaped(name, copy, shape)


def _shaped(name: str, value: Array, shape: tuple[int, ...]) -> Array:
    if value.shape != shape:
        raise InvalidArgumentError(f"target.{name}", f"must have shape {shape}, but has shape {value.shape}")
    return value
