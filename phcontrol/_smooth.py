"""A smooth way from nothing to all."""


def smooth(share: float) -> float:
    """Return 3s² − 2s³ of a share s, held at 0 and 1."""
    if share <= 0.0:
        return 0.0
    return 1.0 if share >= 1.0 else share * share * (3.0 - 2.0 * share)
