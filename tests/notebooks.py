"""Executing notebooks as a reader does: a new kernel, from top to bottom."""

from __future__ import annotations

from pathlib import Path

import pytest


def execute(path: Path, folder: Path) -> str:
    """Return all that a notebook prints and shows as text, executed in a folder. Raises when a cell fails."""
    nbformat = pytest.importorskip("nbformat", reason="needs the extra 'test'")
    nbclient = pytest.importorskip("nbclient", reason="needs the extra 'test'")
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(folder)}}).execute()
    said = []
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            said.append(output.get("text") or output.get("data", {}).get("text/plain", ""))
    return "\n".join(said)
