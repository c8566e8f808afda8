"""Watching a run while it goes on."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from phcontrol._validation import flag, positive
from phcontrol.setpoints.setpoint import Setpoint
from phcontrol.simulation.log import Log
from phcontrol.visualization.live_controls import LiveControls
from phcontrol.visualization.page import page
from phcontrol.visualization.server import PageServer, announce_page
from phcontrol.visualization.shown_run import ShownRun
from phcontrol.visualization.stage import Stage


class LiveView:
    """Shows a run in a browser as it goes on: ``simulate(..., watch=LiveView())``.

    The page is served by another process. Between two frames watching costs the loop a look at the clock; at
    most ``rate`` times a second it computes one frame (well under a millisecond) and hands it over without
    waiting. Frames that the browser cannot take in time are dropped.

    Args:
        rate: frames a second at most [Hz].
        real_time: hold the run back to the pace of the clock, as an arm would go.
        port: to serve on; 0 for any free one; by default the first free one from 7000.
        controls: what may be changed on the page: a setpoint, the one that the run is given, or its ``LiveControls``.
        announce: called when the page is served, before the run goes on; by default opens a browser, or where
            there is none prints the address.

    Raises PHControlError when the port is taken.

    Example:
        >>> from phcontrol import LiveView
        >>> with LiveView(rate=10.0, real_time=False, announce=lambda server: None) as view:
        ...     view.period  # of its frames [s]; simulate(..., watch=view) shows a run
        0.1
    """

    def __init__(
        self,
        *,
        rate: float = 30.0,
        real_time: bool = True,
        port: int | None = None,
        controls: Setpoint | LiveControls | None = None,
        announce: Callable[[PageServer], None] | None = None,
    ) -> None:
        self.period = 1.0 / positive("rate", rate)
        self.real_time, self._announce = flag("real_time", real_time), announce or announce_page
        self.controls = LiveControls(controls) if isinstance(controls, Setpoint) else controls
        self.server = PageServer(port)
        self._stage: Stage | None = None
        self._start = self._next = 0.0
        self.shown = self.dropped = 0

    def __call__(self, log: Log) -> None:
        """Show the last sample, if it is time for a frame."""
        now = time.perf_counter()
        k = len(log) - 1
        if self._stage is None:
            self._begin(log, k)
            now = time.perf_counter()
            self._start = now - float(log.time[k])
        elif self.real_time:
            ahead = float(log.time[k]) - (now - self._start)
            if ahead > 2e-3:
                time.sleep(ahead)
                now = time.perf_counter()
        if now >= self._next:
            self._next = now + self.period
            if self.controls is not None:
                for message in self.server.received():
                    self.controls.take(message)
            self._show(log, k)

    def _show(self, log: Log, k: int) -> None:
        assert self._stage is not None
        frame = self._stage.frame(float(log.time[k]), log.position[k], log.derive(k))
        if self.server.send(frame.astype("<f4").tobytes()):
            self.shown += 1
        else:
            self.dropped += 1

    def _begin(self, log: Log, k: int) -> None:
        row = log.derive(k)
        self._stage = Stage.of(log, goal="goal" in row, tank="tank_level" in row)
        first = self._stage.frame(float(log.time[k]), log.position[k], row)
        self.server.publish(page([ShownRun(self._stage, np.array([first]))], live=True, controls=self.controls))
        self._announce(self.server)

    def finish(self, log: Log) -> None:
        """Show the last sample of a run that has ended, and tell the browser; it can then play the run again."""
        if self._stage is not None:
            self._show(log, len(log) - 1)
            self.server.end()

    def linger(self, log: Log) -> None:
        """Finish, and go on serving until interrupted from the keyboard."""
        self.finish(log)
        self.server.wait(f"the run can be played again at {self.server.address}; press Ctrl-C to stop")

    def close(self) -> None:
        """Stop serving the page."""
        self.server.close()

    def __enter__(self) -> LiveView:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
