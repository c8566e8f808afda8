"""A smooth way from nothing to all, and a shortcut past nothing."""


def smooth(share: float) -> float:
    """Return 3s² − 2s³ of a share s, held at 0 and 1."""
    held = min(max(share, 0.0), 1.0)
    return held * held * (3.0 - 2.0 * held)


def vanishes(part: float) -> bool:
    """Return whether a part is 0, so that what it is multiplied with need not be computed.

    Of a number that a trace does not know it is not asked: there no branch is taken, and 0 must give what the shortcut
    gives.
    """
    return part == 0.0


def exceeds(part: float, least: float) -> float:
    """Return 1 where a part is larger than something, else 0: no branch of a trace."""
    return 1.0 if part > least else 0.0
