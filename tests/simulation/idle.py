"""A law that applies no torque: for studies of the plant alone."""

from __future__ import annotations

import numpy as np

from phcontrol import NOTHING, Controller, Shaping, Target


class IdleLaw(Controller):
    name = "idle"

    def __init__(self, system):
        super().__init__(system, "coriolis")

    def shape(self, t, x, state, measured):
        return Shaping(-x.potential_gradient)  # what the matching formula adds is taken away

    def storage(self, t, x, state, measured=NOTHING):
        return x.energy

    def coordinates(self, t, x, state, measured=NOTHING):
        return np.concatenate([x.position, x.transformed_momentum])

    def target(self, t, x, state, measured=NOTHING):
        n = x.system.n
        zero, inverse = np.zeros((n, n)), x.solve_factor(np.eye(n))
        return Target(
            coordinates=self.coordinates(t, x, state),
            interconnection=np.block([[zero, inverse.T], [-inverse, x.coriolis_interconnection]]),
            dissipation=np.block([[zero, zero], [zero, x.transformed_damping]]),
            gradient=np.concatenate([x.potential_gradient, x.transformed_momentum]),
            port=np.vstack([zero, inverse]),
        )

    @classmethod
    def default_gains(cls, system, goal):
        return {}
