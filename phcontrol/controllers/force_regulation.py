"""An outer integrator that moves a virtual position until the contact force is the wished one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array, positive, vector
from phcontrol.exceptions import InvalidArgumentError

OUTER_LOOP_CAVEAT = "the moving virtual position supplies energy; it is an outer loop"
"""What no law claims whose virtual position a regulation moves."""
DRIVEN_BY = "f_e − f_d, which moves the virtual position"
"""What drives a law whose virtual position a regulation moves."""
RESTS_IN_CONTACT = "stability in contact: it rests where the body it touches answers with f_d"
"""What such a law has instead of a minimum of H_d."""


class ForceRegulation:
    """q̇_f = κ(f_e − f_d), each entry limited to ±``rate_limit``.

    f_e and f_d are forces of the environment on the joints: too little force moves the virtual position
    further into the body.

    Args:
        force: f_d [N·m].
        gain: κ [rad/(N·m·s)].
        rate_limit: [rad/s].
    """

    def __init__(self, force: ArrayLike, *, gain: float = 0.3, rate_limit: float = 0.5) -> None:
        wished = np.atleast_1d(finite_array("force", force))
        self.force = vector("force", wished, wished.size)
        self.gain = positive("gain", gain)
        self.rate_limit = positive("rate_limit", rate_limit)

    def rate(self, external_force: Array) -> Array:
        """Return q̇_f, shape (n,) [rad/s]."""
        rate: Array = self.gain * (external_force - self.force)
        return np.minimum(np.maximum(rate, -self.rate_limit), self.rate_limit)


def check_regulation(regulation: Any, n: int) -> ForceRegulation | None:
    """Return the regulation when it fits n joints; raise InvalidArgumentError when not."""
    if regulation is None:
        return None
    if not isinstance(regulation, ForceRegulation):
        raise InvalidArgumentError("regulation", f"must be a ForceRegulation, but is {type(regulation).__name__}")
    if regulation.force.size != n:
        raise InvalidArgumentError("regulation", f"is for {regulation.force.size} joints, the system has {n}")
    return regulation
