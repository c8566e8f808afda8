"""What a control loop is doing."""

from __future__ import annotations

from enum import IntEnum


class LoopMode(IntEnum):
    """What a control loop is doing.

    Example:
        >>> from phcontrol import ControlLoop, EnergyShaping, LoopMode, MechanicalSystem, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> loop = ControlLoop(system, EnergyShaping.tuned(system), 1e-3)
        >>> loop.mode is LoopMode.WAITING, [mode.name for mode in LoopMode]
        (True, ['WAITING', 'STARTING', 'RUNNING', 'STOPPING', 'STOPPED'])
    """

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
