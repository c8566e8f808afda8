"""What goes wrong when a law is compiled."""

from __future__ import annotations

from phcontrol.exceptions import PHControlError


class CompilationError(PHControlError):
    """A law cannot be compiled, or what was compiled of it is not used: says why, in one line.

    Example:
        >>> from phcontrol import CompilationError, NotTraceableError, PHControlError
        >>> issubclass(NotTraceableError, CompilationError), issubclass(CompilationError, PHControlError)
        (True, True)
    """


class NotTraceableError(CompilationError):
    """A law does what cannot be written down as C. Names the line.

    Example:
        >>> from phcontrol import CompilationError, NotTraceableError
        >>> issubclass(NotTraceableError, CompilationError)
        True
    """


class CompilationWarning(UserWarning):
    """A law runs interpreted where compiled was asked for, or a file of the cache was refused.

    Example:
        >>> import warnings
        >>> from phcontrol import CompilationWarning
        >>> with warnings.catch_warnings(record=True) as said:
        ...     warnings.simplefilter("always")
        ...     warnings.warn("runs interpreted: no C compiler was found", CompilationWarning, stacklevel=1)
        >>> said[0].category.__name__
        'CompilationWarning'
    """
