"""A law that applies no torque: for studies of the plant alone."""

from __future__ import annotations

from phcontrol import NOTHING, Controller, Shaping, Target


class IdleLaw(Controller):
    name = "idle"

    def shape(self, t, x, state, measured):
        return Shaping(-x.potential_gradient)  # what the matching formula adds is taken away

    def storage(self, t, x, state, measured=NOTHING):
        return x.energy

    def target(self, t, x, state, measured=NOTHING):
        momentum = x.transformed_momentum
        return Target.of(
            {"position": (x.position, x.potential_gradient), "momentum": (momentum, momentum)},
            {("position", "momentum"): x.inverse_factor.T, ("momentum", "momentum"): x.coriolis_interconnection},
            {("momentum", "momentum"): x.transformed_damping},
            {"momentum": x.inverse_factor},
        )
