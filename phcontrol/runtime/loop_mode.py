"""What a control loop is doing."""

from __future__ import annotations

from enum import IntEnum


class LoopMode(IntEnum):
    """What a control loop is doing."""

    WAITING = 0
    """No reading yet: no torque."""
    STARTING = 1
    """From holding to the law, within ``start_time``."""
    RUNNING = 2
    """The law's torque."""
    STOPPING = 3
    """From the last torque to holding, within ``stop_time``."""
    STOPPED = 4
    """Holding: gravity is compensated, motion damped."""

    @property
    def is_active(self) -> bool:
        """Whether the law acts."""
        return self in (LoopMode.STARTING, LoopMode.RUNNING)
