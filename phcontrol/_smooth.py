"""A smooth way from nothing to all."""


def smooth(share: float) -> float:
    """Return 3s² − 2s³ of a share s, held at 0 and 1."""
    held = min(max(share, 0.0), 1.0)
    return held * held * (3.0 - 2.0 * held)
