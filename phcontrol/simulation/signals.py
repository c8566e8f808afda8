"""Signals over time, for other programs: MCAP (Foxglove, ROS 2), Rerun and xarray."""

from __future__ import annotations

import json
import os
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from phcontrol._files import write_atomically, write_whole
from phcontrol._validation import Array, finite_array
from phcontrol._version import __version__
from phcontrol.exceptions import InvalidArgumentError, PHControlError

_LATEST = 1e10  # time in nanoseconds that fits a file's 64 bits [s]


class Signal(NamedTuple):
    """One quantity over time."""

    values: Array
    """Shape (k,) of one number, or (k, m)."""
    unit: str
    labels: tuple[str, ...] = ()
    """Of the m components, the joints' names; none of one number."""


class Signals(NamedTuple):
    """Quantities at the same instants."""

    time: Array
    """Shape (k,) [s]."""
    quantities: Mapping[str, Signal]
    """By their names."""
    attributes: Mapping[str, Any]
    """What else is known of them; texts and numbers."""

    def to_xarray(self) -> Any:
        """Return them as an ``xarray.Dataset`` over time, with units; joints are a coordinate.

        Raises PHControlError where xarray is not installed.
        """
        xarray = _load("xarray", "xarray")
        variables = {}
        axes: dict[str, tuple[str, ...]] = {}
        for name, signal in self.quantities.items():
            dimensions = ["time"]
            if signal.values.ndim == 2:
                axis = "joint" if signal.labels else f"{name}_component"
                axes[axis] = signal.labels or tuple(map(str, range(signal.values.shape[1])))
                dimensions.append(axis)
            variables[name] = (dimensions, signal.values, {"units": signal.unit})
        coordinates = {"time": ("time", self.time, {"units": "s"}), **{axis: list(of) for axis, of in axes.items()}}
        return xarray.Dataset(variables, coordinates, {name: _plain(value) for name, value in self.attributes.items()})

    def to_mcap(self, path: str | os.PathLike[str]) -> Path:
        """Write them as an MCAP file, atomically: a channel each, JSON messages of their components by name.

        Returns the path. Times are nanoseconds since the run began. NaN is written as null. Raises PHControlError where
        mcap is not installed.
        """
        _load("mcap", "mcap")
        self._check()
        from mcap.writer import Writer

        def write(file: IO[bytes]) -> None:
            writer = Writer(file)
            writer.start(profile="", library=f"phcontrol {__version__}")
            channels = {name: self._channel(writer, name, signal) for name, signal in self.quantities.items()}
            stamps = np.round(1e9 * np.asarray(self.time)).astype(np.int64).tolist()
            for k, stamp in enumerate(stamps):
                for name, signal in self.quantities.items():
                    message = json.dumps(_message(signal, k)).encode()
                    writer.add_message(channels[name], log_time=stamp, publish_time=stamp, data=message, sequence=k)
            writer.add_metadata("phcontrol", {name: str(_plain(value)) for name, value in self.attributes.items()})
            writer.finish()

        return write_atomically(path, write)

    def to_rerun(self, path: str | os.PathLike[str], name: str = "phcontrol") -> Path:
        """Write them as a Rerun recording (.rrd), atomically: a curve for each component; return the path.

        Raises PHControlError where rerun is not installed.
        """
        rerun = _load("rerun", "rerun")
        self._check()
        return write_whole(path, lambda fresh: self._record(rerun, fresh, name))

    def _record(self, rerun: Any, file: Path, name: str) -> None:
        stream = rerun.RecordingStream(name)
        stream.save(os.fspath(file))
        times = rerun.TimeColumn("time", duration=np.asarray(self.time))
        for quantity, signal in self.quantities.items():
            columns = signal.values.T if signal.values.ndim == 2 else [signal.values]
            labels = signal.labels or tuple(map(str, range(len(columns))))
            for label, values in zip(labels if signal.values.ndim == 2 else ("",), columns, strict=True):
                place = f"{quantity}/{label}" if label else quantity
                stream.log(place, rerun.SeriesLines(names=f"{label or quantity} [{signal.unit}]"), static=True)
                stream.send_columns(place, indexes=[times], columns=rerun.Scalars.columns(scalars=np.array(values)))
        stream.flush()
        stream.disconnect()

    def _check(self) -> None:
        """Raise InvalidArgumentError where times are none that a file can have, or are not of as many samples."""
        times = finite_array("time", self.time)
        if times.ndim != 1 or (times < 0.0).any() or (times > _LATEST).any():
            raise InvalidArgumentError("time", f"must be numbers of seconds from 0 to {_LATEST:g}, one a sample")
        for name, signal in self.quantities.items():
            if len(signal.values) != len(times):
                raise InvalidArgumentError(name, f"has {len(signal.values)} samples, but there are {len(times)} times")

    def _channel(self, writer: Any, name: str, signal: Signal) -> int:
        properties = {label: {"type": ["number", "null"]} for label in _labels(signal)}
        schema = {"type": "object", "title": name, "description": f"[{signal.unit}]", "properties": properties}
        number = writer.register_schema(
            name=f"phcontrol.{name}", encoding="jsonschema", data=json.dumps(schema).encode()
        )
        channel: int = writer.register_channel(
            topic=f"/{name}", message_encoding="json", schema_id=number, metadata={"unit": signal.unit}
        )
        return channel


class Exported(ABC):
    """What can be given to other programs, as its signals."""

    @property
    @abstractmethod
    def signals(self) -> Signals:
        """All quantities over time; ``attributes`` name the robot."""

    def to_xarray(self) -> Any:
        """Return it as an ``xarray.Dataset``; see :meth:`Signals.to_xarray`."""
        return self.signals.to_xarray()

    def to_mcap(self, path: str | os.PathLike[str]) -> Path:
        """Write it as an MCAP file; see :meth:`Signals.to_mcap`."""
        return self.signals.to_mcap(path)

    def to_rerun(self, path: str | os.PathLike[str]) -> Path:
        """Write it as a Rerun recording; see :meth:`Signals.to_rerun`."""
        signals = self.signals
        return signals.to_rerun(path, str(signals.attributes["robot"]))


def _labels(signal: Signal) -> tuple[str, ...]:
    if signal.values.ndim == 1:
        return ("value",)
    return signal.labels or tuple(map(str, range(signal.values.shape[1])))


def _message(signal: Signal, k: int) -> dict[str, float | None]:
    row = np.atleast_1d(signal.values[k]).tolist()
    return {label: value if np.isfinite(value) else None for label, value in zip(_labels(signal), row, strict=True)}


def _plain(value: Any) -> Any:
    return value if isinstance(value, (str, int, float)) else json.dumps(value, default=str)


def _load(module: str, extra: str) -> Any:
    """Return a module. Raises PHControlError, saying how to install it."""
    try:
        return __import__(module)
    except ImportError as error:
        raise PHControlError(f"this needs {module}: pip install 'phcontrol[{extra}]'") from error
