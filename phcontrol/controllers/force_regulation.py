"""An outer integrator that moves a virtual position until the contact force is the desired one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array, positive, vector


class ForceRegulation:
    """q̇_f = κ(f_e − f_d), each entry limited to ±``rate_limit``.

    f_e and f_d are forces of the environment on the joints: too little force moves the virtual position
    further into the body.

    Args:
        force: f_d [N·m].
        gain: κ [rad/(N·m·s)].
        rate_limit: [rad/s].

    Example:
        >>> import numpy as np
        >>> from phcontrol import ForceRegulation
        >>> rule = ForceRegulation([2.0], gain=0.3, rate_limit=0.5)  # f_d [N·m], κ [rad/(s·N·m)], [rad/s]
        >>> rule.rate(np.array([1.0]))  # of the virtual position [rad/s]
        array([-0.3])
    """

    def __init__(self, force: ArrayLike, *, gain: float = 0.3, rate_limit: float = 0.5) -> None:
        desired = np.atleast_1d(finite_array("force", force))
        self.force = vector("force", desired, desired.size)
        self.gain = positive("gain", gain)
        self.rate_limit = positive("rate_limit", rate_limit)

    def rate(self, external_force: Array) -> Array:
        """Return q̇_f, shape (n,) [rad/s]."""
        rate: Array = self.gain * (external_force - self.force)
        return np.minimum(np.maximum(rate, -self.rate_limit), self.rate_limit)
