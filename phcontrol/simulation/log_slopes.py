"""How a number that is measured of a run changes with its samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phcontrol._validation import Array
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.simulation.log import Log


class LogSlopes(NamedTuple):
    """The derivative of a number with respect to each sample of a log; None for those that it does not depend on.

    An objective with a method ``slopes(log)`` that returns this is tuned by its gradient (:func:`tune`).

    Example:
        >>> import numpy as np
        >>> from phcontrol import LogSlopes, MechanicalSystem, load_robot, make_controller, simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> log = simulate(system, make_controller("energy_shaping", system), duration=0.1, dt=1e-2)
        >>> last = np.zeros((len(log), 2))
        >>> last[-1] = 2.0 * log.position[-1]  # of |q|² at the end
        >>> LogSlopes(position=last).weights(log).shape
        (11, 6)
    """

    position: Array | None = None
    """With respect to q, shape (N, n)."""
    velocity: Array | None = None
    """With respect to q̇, shape (N, n)."""
    torque: Array | None = None
    """With respect to the applied torque u, shape (N, n)."""
    controller_state: Array | None = None
    """With respect to the law's own state, shape (N, size)."""

    def weights(self, log: Log) -> Array:
        """Return all of it side by side, as (q, q̇, law's state, bodies' states, u), shape (N, y + n).

        Raises InvalidArgumentError where one does not have the shape of what it is a derivative of.
        """
        parts = []
        for name, samples in (
            ("position", log.position), ("velocity", log.velocity), ("controller_state", log.controller_state),
            ("body_state", log.body_state), ("torque", log.torque),
        ):  # fmt: skip
            slope = getattr(self, name, None)
            slope = np.zeros(samples.shape) if slope is None else np.asarray(slope, dtype=np.float64)
            if slope.shape != samples.shape or not np.isfinite(slope).all():
                raise InvalidArgumentError(
                    f"slopes.{name}", f"must be finite and have shape {samples.shape}, but has shape {slope.shape}"
                )
            parts.append(slope)
        return np.hstack(parts)
