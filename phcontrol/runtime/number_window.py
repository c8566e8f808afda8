"""Which packets are newer than the last one."""

from __future__ import annotations

_AHEAD = 1000  # numbers that a packet may be ahead of the last
_FASTEST = 10.0  # further ones for each period of silence


class NumberWindow:
    """Believes packet numbers that grow, but not out of the reach of a sender of at most ten packets a period.

    So one packet with a wrong number keeps the sender out for at most a thousand packets, and a sender that went on
    counting through an outage is believed again.
    """

    def __init__(self) -> None:
        self.last = -1
        """The last number that was believed."""

    def accepts(self, number: int, silence: float) -> bool:
        """Believe a number after so many periods without one, or not; return whether."""
        if not self.last < number <= self.last + _AHEAD + _FASTEST * silence:
            return False
        self.last = number
        return True
