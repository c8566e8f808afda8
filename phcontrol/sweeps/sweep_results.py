"""The results of a sweep, read back."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from phcontrol._validation import Array, choice
from phcontrol.exceptions import DataFileError
from phcontrol.sweeps.statement import Statement
from phcontrol.sweeps.sweep_folder import PARTS, need_pyarrow, read_manifest

INDEPENDENT = ("random", "latin_hypercube", "sobol")
"""Methods of sampling that draw, so that a sample speaks for what was not drawn."""


class SweepResults:
    """What there is of a sweep: a column for each quantity and each measure, a row for each run.

    Made by ``Sweep.run``, or by ``read``.

    Example:
        >>> import tempfile
        >>> from phcontrol import Sweep, SweepResults
        >>> sweep = Sweep(
        ...     arm={"robot": "pera_shoulder"}, law={"name": "energy_shaping"}, run={"duration": 0.2},
        ...     vary={"mass_factor": {"uniform": [0.9, 1.1]}}, sampling={"method": "sobol", "runs": 2},
        ...     measures=["final_error"],
        ... )
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     found = sweep.run(folder + "/sweep", progress=False)
        ...     again = SweepResults.read(folder + "/sweep")
        >>> again.parameters, again.measures, len(again)
        (['mass_factor'], ['final_error'], 2)
    """

    def __init__(self, folder: Path, manifest: dict[str, Any], table: Any) -> None:
        self.folder, self.manifest = folder, manifest
        self.table = table
        """All of it as a ``pyarrow.Table``; ``.to_pandas()`` makes a frame of it."""

    @classmethod
    def read(cls, directory: str | os.PathLike[str]) -> SweepResults:
        """Read the folder of a sweep, also of one that is not finished.

        Raises DataFileError where it is none, or has no results yet.
        """
        need_pyarrow()
        import pyarrow as arrow
        from pyarrow import parquet

        folder = Path(directory)
        manifest = read_manifest(folder)
        parts = sorted((folder / PARTS).glob("runs-*.parquet"))
        if not parts:
            raise DataFileError(f"{folder} has no results yet")
        try:
            table = arrow.concat_tables([parquet.read_table(part) for part in parts])
        except (arrow.ArrowException, OSError) as error:
            raise DataFileError(f"cannot read the results in {folder}: {error}") from error
        missing = [name for name in manifest["columns"] if name not in table.column_names]
        if missing:
            raise DataFileError(f"the results in {folder} have no column {missing[0]}")
        return cls(folder, manifest, table.sort_by("run"))

    def __len__(self) -> int:
        return int(self.table.num_rows)

    def __repr__(self) -> str:
        return f"<SweepResults in {self.folder}: {len(self)} of {self.manifest['sweep']['runs']} runs>"

    @property
    def finished(self) -> bool:
        """Whether all runs are there."""
        return bool(len(self) == self.manifest["sweep"]["runs"])

    @property
    def parameters(self) -> list[str]:
        """The quantities that vary."""
        names = list(self.manifest["columns"])
        return names[1 : -2 - len(self.measures)]

    @property
    def measures(self) -> list[str]:
        """What was measured."""
        return [one["name"] for one in self.manifest["sweep"]["measures"]]

    @property
    def failed(self) -> Any:
        """Which runs failed, shape (runs,), True or False."""
        return self.column("error") != ""

    def column(self, name: str) -> Any:
        """Return a column as an array. Raises UnknownNameError, listing the columns."""
        return self.table.column(choice("column", name, self.table.column_names)).to_numpy()

    def good(self) -> Any:
        """Return which runs finished and kept all that ``require`` asks, shape (runs,), True or False."""
        good = ~self.failed
        for name, limit in self.manifest["sweep"]["require"].items():
            good &= self.column(name) <= float(limit)
        return good

    def statement(self, confidence: float = 0.95) -> Statement:
        """Return what the sample supports about all that could be drawn."""
        good = self.good()
        return Statement(int(good.sum()), len(good), confidence)

    def sentence(self, confidence: float = 0.95) -> str:
        """Return that in words, or of a grid or list how many were good."""
        sweep = self.manifest["sweep"]
        required = [f"{name} ≤ {float(limit):g}" for name, limit in sweep["require"].items()]
        kept = "finish" + (f" with {', '.join(required)}" if required else "")
        found = self.statement(confidence)
        if sweep["sampling"].get("method", "random") not in INDEPENDENT:
            return f"{found.good} of {found.runs} {kept}; they were chosen, not drawn: that says nothing of others"
        even = {"latin_hypercube": "a Latin hypercube", "sobol": "a Sobol sequence"}
        method = sweep["sampling"].get("method", "random")
        caution = f"; exact for independent draws, for {even[method]} not proved" if method in even else ""
        return found.text(f"of the arms drawn {kept}") + caution

    def summary(self, confidence: float = 0.95) -> str:
        """Return what there is, what it supports, and quantiles, in a few lines."""
        sweep, failed = self.manifest["sweep"], int(self.failed.sum())
        head = f"{len(self)} of {sweep['runs']} runs, {failed} failed, {int(self.column('compiled').sum())} compiled"
        lines = [head, self.sentence(confidence), f"{'':<24}{'median':>12}{'90 %':>12}{'99 %':>12}{'largest':>12}"]
        for name in self.measures:
            unit = self.manifest["columns"][name]
            shown = "".join(f"{value:>12.4g}" for value in self.quantiles(name))
            lines.append(f"{name + (f' [{unit}]' if unit else ''):<24}{shown}")
        if failed:
            lines.append(f"the first that failed: run {self.column('run')[self.failed][0]}: "
                         f"{self.column('error')[self.failed][0]}")  # fmt: skip
        return "\n".join(lines)

    def quantiles(self, measure: str, parts: tuple[float, ...] = (0.5, 0.9, 0.99, 1.0)) -> Array:
        """Return quantiles of a measure over the runs that did not fail, shape (parts,); not a number without any."""
        values = self.column(choice("measure", measure, self.measures))[~self.failed]
        if not len(values):
            return np.full(len(parts), np.nan)
        found: Array = np.quantile(values, parts, method="inverted_cdf")  # an infinite value stays one
        return found

    def worst(self, measure: str, count: int = 5) -> list[int]:
        """Return the runs with the largest values of a measure, the worst first; those that failed before them."""
        values = np.where(self.failed, np.inf, self.column(choice("measure", measure, self.measures)))
        order = np.lexsort((-self.failed.astype(float), -values))
        return [int(self.column("run")[k]) for k in order[:count]]
