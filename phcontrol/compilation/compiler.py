"""The C compiler of this machine."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from phcontrol.compilation.errors import CompilationError

FLAGS = ("-O2", "-fPIC", "-shared", "-ffp-contract=off", "-std=c99")
"""No -ffast-math: a compiled law computes what the interpreted one does."""
_NAMES = ("cc", "gcc", "clang")
_LONGEST = 600.0  # that a compiler may take [s]


class Compiler(NamedTuple):
    """A compiler that was found."""

    path: str
    version: str
    """Its first line about itself."""

    def identity(self, native: bool) -> str:
        """Return what, beside the source, an object depends on."""
        machine = f"{sys.platform} {platform.machine()}"
        own = f" {platform.processor()} {_processor()}" if native else ""
        return f"{self.version} | {' '.join(flags(native))} | {machine}{own}"

    def compile(self, source: Path, target: Path, native: bool) -> None:
        """Make a shared object. Raises CompilationError with the compiler's first words when it fails."""
        command = [self.path, *flags(native), "-o", os.fspath(target), os.fspath(source), "-lm"]
        try:
            result = subprocess.run(
                command, capture_output=True, text=True, errors="replace", timeout=_LONGEST, check=False
            )
        except OSError as error:
            raise CompilationError(f"the compiler {self.path} could not be run: {error}") from error
        except subprocess.TimeoutExpired as error:
            message = f"the compiler {self.path} has not come to an end within {_LONGEST:g} s, and was stopped"
            raise CompilationError(message) from error
        if result.returncode or not target.exists():
            raise CompilationError(f"the compiler {self.path} failed: {_words(result)}")


def _words(result: subprocess.CompletedProcess[str]) -> str:
    """Return what a compiler that failed says: its first error, or how it ended where it says nothing."""
    lines = [line.strip() for line in (result.stderr + result.stdout).splitlines() if line.strip()]
    telling = [line for line in lines if not line.startswith("collect2:")]  # which says that the linker said something
    for line in telling:
        if "error" in line.lower():
            return line
    if telling:
        return telling[0]
    code = result.returncode
    return f"it was ended by signal {-code}" if code < 0 else f"it ended with code {code}, and says nothing"


def flags(native: bool) -> tuple[str, ...]:
    """Return the compiler's options."""
    return (*FLAGS, "-march=native") if native else FLAGS


def find_compiler() -> Compiler | None:
    """Return the C compiler that ``CC`` names, or else cc, gcc or clang; None where there is none that runs."""
    named = os.environ.get("CC", "").strip()
    for name in (named,) if named else _NAMES:
        path = shutil.which(name)
        version = _version(path) if path else ""
        if path and version:
            return Compiler(path, version)
    return None


@lru_cache
def _version(path: str) -> str:
    try:
        result = subprocess.run(
            [path, "--version"], capture_output=True, text=True, errors="replace", timeout=20.0, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    lines = result.stdout.splitlines()
    return lines[0].strip() if result.returncode == 0 and lines else ""


@lru_cache
def _processor() -> str:
    """Return what tells one processor from another, where the system says it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.node()
    return next((line for line in lines if line.startswith("flags")), "")
