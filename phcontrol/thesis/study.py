"""A study's outcome: logs, figures and claims, and how they are written."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phcontrol._files import write_json
from phcontrol.simulation.log import Log
from phcontrol.thesis.claim import Claim

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Outcome:
    """What came of a study."""

    name: str
    title: str
    logs: dict[str, Log]
    claims: list[Claim]
    figures: dict[str, Callable[[], Figure]] = field(default_factory=dict)
    """Drawn only when written."""
    notes: tuple[str, ...] = ()

    def summary(self) -> str:
        """Return title, notes and claims, as text."""
        return "\n".join(
            [f"{self.name}: {self.title}", *(f"  note: {note}" for note in self.notes), *map(str, self.claims)]
        )

    def write(self, directory: str | os.PathLike[str]) -> list[Path]:
        """Write logs, figures and ``claims.json``; return where."""
        from phcontrol.visualization.plots import save_figure

        folder = Path(directory)
        paths = [log.save(folder / f"{name}.npz") for name, log in self.logs.items()]
        paths += [save_figure(draw(), folder / f"{name}.png") for name, draw in self.figures.items()]
        return [*paths, write_json(folder / "claims.json", self.to_dict())]

    def to_dict(self) -> dict[str, Any]:
        """Return title, notes and claims, for JSON."""
        return {
            "study": self.name,
            "title": self.title,
            "notes": list(self.notes),
            "claims": [claim.to_dict() for claim in self.claims],
        }
