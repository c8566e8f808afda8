"""How the torque filter found a torque."""

from __future__ import annotations

from enum import IntEnum


class FilterStatus(IntEnum):
    """How a torque was found.

    Example:
        >>> from phcontrol import EnergyShaping, FilterStatus, MechanicalSystem, TorqueFilter, load_robot
        >>> from phcontrol import simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> guard = TorqueFilter(system, period=1e-3)
        >>> law = EnergyShaping.tuned(system, system.robot.home)
        >>> log = simulate(system, law, duration=0.05, torque_filter=guard)  # at rest: nothing to be changed
        >>> {FilterStatus(status).name for status in log.filter_activity["status"]}
        {'PASSED'}
    """

    PASSED = 0
    """The law's torque, unchanged."""
    CLIPPED = 1
    """Its projection on effort and rate limits, in closed form; nothing else was in the way."""
    SOLVED = 2
    """The program's answer: every condition is met."""
    FEASIBLE = 3
    """Every condition is met, but the solver failed and a nearer torque may exist: the best of a search."""
    STORAGE_RELAXED = 4
    """The program's answer where the storage condition cannot be met with the limits."""
    FALLBACK = 5
    """The solver gave no answer that passed the check: braking torque, clipped."""
