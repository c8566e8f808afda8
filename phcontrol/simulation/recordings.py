"""Room for what runs in C record, used again."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phcontrol._validation import Array

if TYPE_CHECKING:
    from phcontrol.compilation.compiled_loop import CompiledLoop, Record


class Recording(NamedTuple):
    """What the runs of a block record."""

    record: Record
    """As the loop in C writes it: lanes last."""
    by_lane: list[Array]
    """The same with lanes first, where that is asked for."""

    def sort(self) -> None:
        """Copy the record so that the samples of a lane lie together. The interpreter's lock is free meanwhile."""
        for own, part in zip(self.by_lane, self.record, strict=True):
            np.copyto(own, np.moveaxis(part, -1, 0))


class Recordings:
    """Recordings that are not in use: a megabyte a run, which the system would have to clear, page by page, each time.

    A recording that is taken again holds what an earlier block wrote: rows beyond the last sample mean nothing.
    """

    def __init__(self) -> None:
        self._free: list[Recording] = []

    def take(
        self, loop: CompiledLoop, rows: int, lanes: int, observed: bool, joints: bool, sorted_too: bool
    ) -> Recording:
        """Return room for so many samples, with lanes first too where ``sorted_too``; any thread may call it."""
        from phcontrol.compilation.compiled_loop import Record

        shapes = [(*size, lanes) for size in Record.sizes(loop, rows, observed, joints)]
        for _ in range(len(self._free)):
            try:
                found = self._free.pop()
            except IndexError:  # another thread has taken the last
                break
            if [part.shape for part in found.record] == shapes and bool(found.by_lane) == sorted_too:
                return found
        record = Record.empty(loop, rows, lanes, observed, joints)
        return Recording(record, [np.empty((lanes, *part.shape[:-1])) for part in record] if sorted_too else [])

    def give_back(self, recording: Recording) -> None:
        """Say that nothing looks at a recording any more."""
        self._free.append(recording)
