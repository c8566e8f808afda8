"""What a sweep is about: the loop, what varies of it, and what is measured."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from phcontrol._validation import Array, count, number, whole_multiple
from phcontrol.exceptions import InvalidArgumentError, UnknownNameError
from phcontrol.simulation.log import Log
from phcontrol.sweeps.distribution import KINDS, Distribution
from phcontrol.sweeps.measure import Measure, all_of, check_measures, measures_of, record_of
from phcontrol.sweeps.nominal import SECTIONS, Nominal
from phcontrol.sweeps.space import Space
from phcontrol.sweeps.variable import expanded, variable_of

SAMPLING = ("method", "runs", "seed", "chunk")
TABLES = (*SECTIONS, "vary", "sampling", "require")
"""What a specification has beside its measures."""
_LARGEST_CHUNK, _PARTS = 256, 16


class Scenarios:
    """The definition of a sweep, with which any process can do any of its runs. Arguments: those of :class:`Sweep`."""

    def __init__(
        self,
        *,
        vary: Mapping[str, Any],
        measures: Sequence[str | Callable[[Log], float]] | Mapping[str, Callable[[Log], float] | str],
        sampling: Mapping[str, Any],
        require: Mapping[str, float] | None = None,
        **parts: Mapping[str, Any],
    ) -> None:
        for name in parts:
            if name not in SECTIONS:
                raise UnknownNameError("part", name, ["measures", *TABLES])
        for name in sampling:
            if name not in SAMPLING:
                raise UnknownNameError("entry", name, SAMPLING, " of [sampling]")
        self._described = {"vary": vary, "sampling": dict(sampling), "require": dict(require or {}), **parts}
        self.given: dict[str, Any] = self._described | {"measures": measures}
        """The arguments, of which other processes make the same."""
        self.measures: dict[str, Measure] = measures_of(measures)
        self.require = {
            name: number(f"require.{self._known_measure(name)}", limit) for name, limit in (require or {}).items()
        }
        """By measure, what it must not exceed."""
        self.nominal = Nominal(parts)
        self.space = Space(self._axes(vary), **{k: v for k, v in sampling.items() if k != "chunk"})
        """Which numbers each run has."""
        self.chunk = count("chunk", sampling.get("chunk", max(1, min(_LARGEST_CHUNK, -(-self.runs // _PARTS)))))
        """Runs of a task, and of a part of the results."""
        self.nominal.check(set(self.space.names))
        check_measures(self.measures, self.nominal)
        self.nominal.arguments(self.scenario(0))

    def __repr__(self) -> str:
        return f"<Sweep of {self.nominal.law.name} on {self.nominal.robot.name}: {self.runs} runs>"

    @property
    def runs(self) -> int:
        """How many runs there are."""
        return self.space.runs

    @cached_property
    def record(self) -> dict[str, Any]:
        """All that the numbers of the runs depend on, for JSON."""
        measures = [record_of(name, measure) for name, measure in self.measures.items()]
        found: dict[str, Any] = _plain(self._described | {"measures": measures})
        files = self.nominal.files
        found |= {"files": files} if files else {}
        return found | {"chunk": self.chunk, "runs": self.runs}

    @cached_property
    def hash(self) -> str:
        """SHA-256 of ``record``: two sweeps with the same one have the same runs."""
        text = json.dumps(self.record | {"require": {}}, sort_keys=True, allow_nan=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def scenario(self, run: int) -> dict[str, float]:
        """Return what a run has of the quantities that vary, by name."""
        place = self._place(run)
        return self.named(self.space.rows(place, place + 1)[0])

    def named(self, row: Array) -> dict[str, float]:
        """Return the numbers of a run by the names of what they are."""
        return dict(zip(self.space.names, map(float, row), strict=True))

    def loop(self, run: int) -> dict[str, Any]:
        """Return a run as the arguments of :func:`simulate`."""
        return self.loop_of(self._place(run), self.scenario(run))

    def loop_of(self, run: int, scenario: Mapping[str, float]) -> dict[str, Any]:
        """Return that of a run whose scenario is known."""
        return self.nominal.arguments(scenario, self.space.noise_seed(run))

    def measured(self, log: Log, run: int) -> dict[str, float | str]:
        """Return what is measured of a run, of its log; the text of what a measure raised."""
        return all_of(self.measures, log, self.nominal, self.loop(run))

    @property
    def columns(self) -> dict[str, str]:
        """The columns of the results and their units."""
        units = {name: variable_of(name, type(self.nominal.law), self.nominal.robot).unit for name in self.space.names}
        return {"run": "", **units, **{name: one.unit for name, one in self.measures.items()}, "error": "",
                "compiled": ""}  # fmt: skip

    def _axes(self, vary: Mapping[str, Any]) -> dict[str, Distribution]:
        if not isinstance(vary, Mapping):
            raise InvalidArgumentError("vary", f"must be quantities by name, but is {vary!r}")
        law, robot = type(self.nominal.law), self.nominal.robot
        axes: dict[str, Distribution] = {}
        for name, given in _dotted(vary).items():
            variable = variable_of(name, law, robot)
            for one in expanded(name, robot):
                if one in axes:
                    raise InvalidArgumentError(one, "is varied twice")
                axes[one] = Distribution(one, given)
                variable.check(axes[one])
                if variable.listed:
                    self._check_whole(one, axes[one].values)
        return axes

    def _check_whole(self, name: str, times: Array | None) -> None:
        """Raise InvalidArgumentError unless times [s] are whole multiples of dt; 0 is one."""
        for time in () if times is None else times:
            if time != 0.0:
                whole_multiple(name, time, self.nominal.run["dt"])

    def _known_measure(self, name: str) -> str:
        if name not in self.measures:
            raise UnknownNameError("measure", name, self.measures, " in [require]: it must be measured, too")
        return name

    def _place(self, run: int) -> int:
        if count("run", run, minimum=0) >= self.runs:
            raise InvalidArgumentError("run", f"must be below {self.runs}, the number of runs, but is {run}")
        return int(run)

    def _end(self, first: int) -> int:
        return min(first + self.chunk, self.runs)


def _dotted(vary: Mapping[str, Any]) -> dict[str, Any]:
    """Return tables of tables as dotted names: TOML reads ``gain.stiffness = …`` so."""
    flat: dict[str, Any] = {}
    for name, given in vary.items():
        nested = (
            isinstance(given, Mapping) and given and all(isinstance(one, (Mapping, list)) for one in given.values())
        )
        if nested and not set(KINDS) & set(given):
            flat |= {f"{name}.{key}": one for key, one in given.items()}
        else:
            flat[str(name)] = given
    return flat


def _plain(value: Any) -> Any:
    """Return lists, dictionaries, numbers and texts alone."""
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(one) for one in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, (str, int, float, bool)):
        return value
    raise InvalidArgumentError("sweep", f"cannot be written down: it has a {type(value).__name__}")
