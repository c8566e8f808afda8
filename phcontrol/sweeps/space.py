"""Which numbers a run has: drawn by its number, the same whoever asks."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from scipy.stats import qmc

from phcontrol._interrupts import uninterrupted
from phcontrol._validation import Array, choice, count
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.sweeps.distribution import Distribution

METHODS = ("random", "latin_hypercube", "sobol", "grid", "list")
"""Independent draws; draws that fill each quantity's range evenly (SciPy's ``qmc``), or all of them together (Sobol);
every combination of lists; lists in step."""
_POINTS, _NOISE = 0, 1  # what a run's random numbers are for
_LARGEST = 2**31  # numbers of a Latin hypercube, which is drawn as a whole


class Space:
    """The scenarios of a sweep as numbers, a row for each run.

    Row k follows from ``seed`` and k alone, so that results do not depend on who did what, nor in which order.

    Args:
        axes: how each quantity is drawn, by name.
        method: one of ``METHODS``.
        runs: how many; None for what a grid or lists have.
        seed: of all random numbers.

    Raises:
        InvalidArgumentError: lists that differ in length, a grid of what has no list, no number of runs.

    Example:
        >>> from phcontrol.sweeps.distribution import Distribution
        >>> from phcontrol.sweeps.space import Space
        >>> load = {"payload_mass": Distribution("payload_mass", {"uniform": [0.0, 2.0]})}
        >>> space = Space(load, "sobol", 4, seed=1)
        >>> bool((space.rows(2, 4) == space.rows(0, 4)[2:]).all())
        True
    """

    def __init__(
        self, axes: dict[str, Distribution], method: str = "random", runs: int | None = None, seed: int = 0
    ) -> None:
        self.names = tuple(axes)
        self._axes = list(axes.values())
        self.method = choice("method", method, METHODS)
        self.seed = count("seed", seed, minimum=0)
        if not axes:
            raise InvalidArgumentError("vary", "names nothing that is varied")
        if method in ("grid", "list"):
            self.runs = self._listed_runs(runs)
        elif runs is None:
            raise InvalidArgumentError("runs", f"must be given: {method} draws as many as are asked for")
        else:
            self.runs = count("runs", runs)
        if method == "latin_hypercube" and self.runs * len(axes) > _LARGEST:
            raise InvalidArgumentError(
                "method", f"a Latin hypercube of {self.runs} runs is drawn as a whole, and too large: take sobol"
            )

    def rows(self, first: int, last: int) -> Array:
        """Return the numbers of runs first to last (without it), shape (last − first, quantities)."""
        if self.method in ("grid", "list"):
            return self._listed(np.arange(first, last))
        parts = self._parts(first, last)
        return np.column_stack([axis.at(part) for axis, part in zip(self._axes, parts.T, strict=True)])

    def noise_seed(self, run: int) -> int:
        """Return the seed of the sensors' noise in a run."""
        return int(self._sequence(run, _NOISE).generate_state(1, np.uint64)[0] >> np.uint64(1))

    def _sequence(self, run: int, purpose: int) -> np.random.SeedSequence:
        return np.random.SeedSequence(self.seed, spawn_key=(run, purpose))

    def _parts(self, first: int, last: int) -> Array:
        """Return points in the unit cube."""
        size = len(self._axes)
        if self.method == "random":
            return np.stack(
                [np.random.default_rng(self._sequence(k, _POINTS)).random(size) for k in range(first, last)]
            )
        if self.method == "latin_hypercube":
            return self._hypercube[first:last]
        bits = min(64, max(30, math.ceil(math.log2(self.runs)) + 1))
        with uninterrupted():
            sobol = qmc.Sobol(size, scramble=True, bits=bits, seed=self._generator)
        if first:
            sobol.fast_forward(first)
        with warnings.catch_warnings():  # that the first few should be a power of two
            warnings.simplefilter("ignore", UserWarning)
            points: Array = sobol.random(last - first)
        return points

    @cached_property
    def _hypercube(self) -> Array:
        points: Array = qmc.LatinHypercube(len(self._axes), seed=self._generator).random(self.runs)
        return points

    @property
    def _generator(self) -> np.random.Generator:
        return np.random.default_rng(np.random.SeedSequence(self.seed))

    def _listed_runs(self, runs: int | None) -> int:
        drawn = [axis.name for axis in self._axes if axis.values is None]
        if drawn:
            raise InvalidArgumentError(drawn[0], f"must have values or a grid: the method is {self.method}")
        lengths = self._lengths
        if self.method == "list" and len(set(lengths)) > 1:
            named = ", ".join(f"{axis.name} {length}" for axis, length in zip(self._axes, lengths, strict=True))
            raise InvalidArgumentError("values", f"must be lists of one length: {named}")
        total = math.prod(lengths) if self.method == "grid" else lengths[0]
        if runs is not None and runs != total:
            raise InvalidArgumentError("runs", f"is {runs}, but the {self.method} has {total}: leave it out")
        return total

    @property
    def _lengths(self) -> Sequence[int]:
        return [len(axis.values) for axis in self._axes if axis.values is not None]

    def _listed(self, runs: Any) -> Array:
        places = np.unravel_index(runs, self._lengths) if self.method == "grid" else [runs] * len(self._axes)
        columns = [
            axis.values[place] for axis, place in zip(self._axes, places, strict=True) if axis.values is not None
        ]
        return np.column_stack(columns)
