"""What ends a run on an arm."""

from __future__ import annotations

from phcontrol.exceptions import PHControlError


class ArmError(PHControlError):
    """An arm does not answer, is not ready, or stopped by itself. The message says why, and what to do.

    Example:
        >>> from phcontrol import ArmError, PHControlError
        >>> issubclass(ArmError, PHControlError)
        True
    """
