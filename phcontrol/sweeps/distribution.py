"""How one quantity of a sweep is drawn."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy import stats

from phcontrol._validation import Array, choice, count, finite_array, number
from phcontrol.exceptions import InvalidArgumentError, UnknownNameError

_NAMES = sorted(
    name for name in dir(stats) if isinstance(getattr(stats, name), (stats.rv_continuous, stats.rv_discrete))
)
KINDS = ("values", "grid", "uniform", "distribution")
"""What a quantity can be given by: a list, equal steps, equally likely between two numbers, a distribution of SciPy."""


class Distribution:
    """A distribution of one number, given by one of four.

    - ``values``: a list; drawn, each is equally likely,
    - ``grid = {from, to, count}``: so many values in equal steps,
    - ``uniform = [low, high]``,
    - ``distribution``: a name of ``scipy.stats``, beside its parameters as they are called there (``loc``, ``scale``,
      ``s``, …) and, where wanted, ``minimum`` and ``maximum``, between which it is cut off and scaled up.

    Args:
        name: of the quantity, for messages.
        given: one of these, or a number for what is always the same.

    Raises:
        InvalidArgumentError: what is given is none of these.
        UnknownNameError: no distribution, or no parameter of one, has that name; lists those that exist.

    Example:
        >>> from phcontrol.sweeps.distribution import Distribution
        >>> load = Distribution("payload_mass", {"distribution": "norm", "loc": 1.0, "scale": 0.5, "minimum": 0.0})
        >>> load.support
        (0.0, inf)
        >>> Distribution("payload_mass", {"uniform": [0.0, 2.0]}).at([0.25, 0.5])
        array([0.5, 1. ])
    """

    def __init__(self, name: str, given: Any) -> None:
        self.name = name
        self.values: Array | None = None
        """The values of a list or a grid; None for what is drawn from a continuum."""
        self._frozen: Any = None
        self._between = (0.0, 1.0)
        self._cut = (-math.inf, math.inf)
        if not isinstance(given, Mapping):
            given = {"values": given if isinstance(given, (list, tuple, np.ndarray)) else [given]}
        kinds = [kind for kind in KINDS if kind in given]
        if len(kinds) != 1:
            has = f"has {' and '.join(kinds)}" if kinds else f"is {dict(given)!r}"
            raise InvalidArgumentError(name, f"must be a number, or have one of {', '.join(KINDS)}, but {has}")
        self.kind = kinds[0]
        rest = {key: value for key, value in given.items() if key != self.kind}
        value = given[self.kind]
        if self.kind != "distribution" and rest:
            raise UnknownNameError("entry", next(iter(rest)), [self.kind], f" of {name}")
        if self.kind == "values":
            self.values = self._listed(value)
        elif self.kind == "grid":
            self.values = self._grid(value)
        elif self.kind == "uniform":
            low, high = self._pair(value)
            self._frozen = stats.uniform(loc=low, scale=high - low)
        else:
            self._frozen, self._between = self._of_scipy(value, rest)
        self.support = self._support()
        """The least and the largest number that it gives."""

    def at(self, parts: Any) -> Array:
        """Return what lies at parts of the way through the distribution (0 to 1), an array of the same shape."""
        share = np.clip(np.asarray(parts, dtype=float), 2.0**-53, 1.0 - 2.0**-53)
        if self.values is not None:
            listed: Array = self.values[np.minimum((share * len(self.values)).astype(int), len(self.values) - 1)]
            return listed
        low, high = self._between
        found: Array = np.asarray(self._frozen.ppf(low + share * (high - low)), dtype=float)
        bounded: Array = np.clip(found, *self.support)
        return bounded

    def _listed(self, value: Any) -> Array:
        values = finite_array(self.name, value)
        if values.ndim != 1 or not values.size:
            raise InvalidArgumentError(self.name, f"needs a list of numbers, but its values are {value!r}")
        return values

    def _grid(self, value: Any) -> Array:
        wanted = {"from", "to", "count"}
        if not isinstance(value, Mapping) or set(value) != wanted:
            raise InvalidArgumentError(self.name, f"needs a grid like {{from = 0, to = 1, count = 5}}, not {value!r}")
        low, high = number(f"{self.name}.grid.from", value["from"]), number(f"{self.name}.grid.to", value["to"])
        return finite_array(self.name, np.linspace(low, high, count(f"{self.name}.grid.count", value["count"])))

    def _pair(self, value: Any) -> tuple[float, float]:
        pair = finite_array(f"{self.name}.uniform", value)
        if pair.shape != (2,) or not pair[0] < pair[1]:
            raise InvalidArgumentError(
                f"{self.name}.uniform", f"must be two numbers, the smaller first, but is {value!r}"
            )
        return float(pair[0]), float(pair[1])

    def _of_scipy(self, kind: Any, rest: dict[str, Any]) -> tuple[Any, tuple[float, float]]:
        family = getattr(stats, choice("distribution", kind, _NAMES))
        discrete = isinstance(family, stats.rv_discrete)
        shapes = [shape.strip() for shape in family.shapes.split(",")] if family.shapes else []
        known = [*shapes, "loc", *([] if discrete else ["scale"]), "minimum", "maximum"]
        for key in rest:
            if key not in known:
                raise UnknownNameError("parameter", key, known, f" of the distribution {kind} of {self.name}")
        numbers = {key: number(f"{self.name}.{key}", value) for key, value in rest.items()}
        minimum, maximum = numbers.pop("minimum", -math.inf), numbers.pop("maximum", math.inf)
        for shape in shapes:
            if shape not in numbers:
                raise InvalidArgumentError(f"{self.name}.{shape}", f"must be given: {kind} needs {', '.join(shapes)}")
        frozen = family(**numbers)
        if math.isnan(frozen.support()[0]) or numbers.get("scale", 1.0) <= 0.0:
            raise InvalidArgumentError(self.name, f"{kind} is no distribution with {numbers}")
        # what is cut off goes by its share; of a discrete one the minimum itself stays
        first = float(frozen.cdf(minimum - 1.0 if discrete else minimum)) if minimum > -math.inf else 0.0
        last = float(frozen.cdf(maximum)) if maximum < math.inf else 1.0
        if not first < last:
            raise InvalidArgumentError(self.name, f"nothing of {kind} is left between {minimum:g} and {maximum:g}")
        self._cut = minimum, maximum
        return frozen, (first, last)

    def _support(self) -> tuple[float, float]:
        if self.values is not None:
            return float(self.values.min()), float(self.values.max())
        low, high = self._frozen.support()
        return max(float(low), self._cut[0]), min(float(high), self._cut[1])
