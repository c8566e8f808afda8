"""What a network does to packets."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Sequence
from typing import Generic, TypeVar

import numpy as np

from phcontrol._validation import count, number, sequence
from phcontrol.exceptions import InvalidArgumentError

Packet = TypeVar("Packet")


class PacketFaults(Generic[Packet]):
    """Loses, delays, duplicates and reorders packets, and is silent at times; the same for the same seed.

    Args:
        loss: the share that is lost.
        delay: of every packet [s].
        jitter: of the delay, exponentially distributed with this mean [s]; packets overtake each other by it.
        duplicates: the share that arrives twice, the second time with another jitter.
        outages: (start, length) pairs in which everything is lost [s].
        seed: of the random numbers.

    Example:
        >>> from phcontrol import PacketFaults
        >>> network = PacketFaults(loss=0.0, delay=0.01)  # [s]
        >>> network.send(0.0, "first")
        >>> network.receive(0.005), network.receive(0.02)
        ([], ['first'])
    """

    def __init__(
        self,
        *,
        loss: float = 0.0,
        delay: float = 0.0,
        jitter: float = 0.0,
        duplicates: float = 0.0,
        outages: Sequence[tuple[float, float]] = (),
        seed: int = 0,
    ) -> None:
        self.loss = number("loss", loss, minimum=0.0, maximum=1.0)
        self.delay = number("delay", delay, minimum=0.0)
        self.jitter = number("jitter", jitter, minimum=0.0)
        self.duplicates = number("duplicates", duplicates, minimum=0.0, maximum=1.0)
        pairs = sequence("outages", outages, "pairs (start, length)", "__len__")
        if not all(len(pair) == 2 for pair in pairs):
            raise InvalidArgumentError("outages", "must hold pairs (start, length)")
        self.outages = tuple((number("outage", a), number("outage", b, minimum=0.0)) for a, b in map(tuple, pairs))
        self._generator = np.random.default_rng(count("seed", seed, minimum=0))
        self._under_way: list[tuple[float, int, Packet]] = []
        self._order = itertools.count()

    def send(self, t: float, packet: Packet) -> None:
        """Put a packet on its way at time t [s]."""
        if any(start <= t < start + length for start, length in self.outages) or self._happens(self.loss):
            return
        for _ in range(2 if self._happens(self.duplicates) else 1):
            late = self._generator.exponential(self.jitter) if self.jitter else 0.0
            heapq.heappush(self._under_way, (t + self.delay + late, next(self._order), packet))

    def receive(self, t: float) -> list[Packet]:
        """Return what has arrived by time t [s], in the order of arrival."""
        arrived = []
        while self._under_way and self._under_way[0][0] <= t:
            arrived.append(heapq.heappop(self._under_way)[2])
        return arrived

    def _happens(self, share: float) -> bool:
        return share > 0.0 and bool(self._generator.random() < share)
