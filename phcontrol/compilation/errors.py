"""What goes wrong when a law is compiled."""

from __future__ import annotations

from phcontrol.exceptions import PHControlError


class CompilationError(PHControlError):
    """A law cannot be compiled, or what was compiled of it is not used: says why, in one line."""


class NotTraceableError(CompilationError):
    """A law does what cannot be written down as C. Names the line."""


class CompilationWarning(UserWarning):
    """A law runs interpreted where compiled was asked for, or a file of the cache was refused."""
