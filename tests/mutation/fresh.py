"""Trials in which everything is imported anew: for what a mutant changes while modules are imported."""

from __future__ import annotations

import contextlib
import importlib
import multiprocessing
import os
from multiprocessing.connection import Connection
from pathlib import Path

from trial import forked, run_in_tree

LIBRARIES = (
    "coal", "pandas", "pinocchio", "proxsuite", "scipy.integrate", "scipy.linalg", "scipy.optimize", "tqdm",
    "typer.testing", "yourdfpy", "matplotlib.pyplot", "cv2", "pink", "trimesh", "meshcat", "tornado",
)  # fmt: skip


class FreshImports:
    """A process that has the libraries loaded, but nothing of phcontrol; forked once for each trial.

    Made before phcontrol is imported here.
    """

    def __init__(self, tree: Path) -> None:
        self.tree = tree
        self._connection, other = multiprocessing.Pipe()
        self._process = os.fork()
        if self._process == 0:
            with contextlib.suppress(EOFError, OSError, KeyboardInterrupt):
                self._connection.close()
                self._serve(other)
            os._exit(0)
        other.close()

    def run(self, module: str, text: str, usual: dict[str, float]) -> tuple[int, str]:
        """Run tests (with the times [s] they usually take) on a module's mutant; return exit code and failed test."""
        self._connection.send((module, text, usual))
        status, name = self._connection.recv()
        return status, name

    def close(self) -> None:
        """End the process."""
        self._connection.close()
        os.waitpid(self._process, 0)

    def _serve(self, connection: Connection) -> None:
        for library in LIBRARIES:
            with contextlib.suppress(ImportError):
                importlib.import_module(library)
        while True:
            module, text, usual = connection.recv()
            path = self.tree / module
            original, times = path.read_text(), path.stat()
            files = list(dict.fromkeys(name.split("::")[0] for name in usual))
            try:
                path.write_text(text)
                status, written = forked(lambda pipe, f=files, u=usual: run_in_tree(str(self.tree), f, u, pipe))
            finally:
                path.write_text(original)
                os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))  # compiled files stay valid
            connection.send((status, written.decode()))
