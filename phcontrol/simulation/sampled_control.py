"""One period of a controller, in simulation and on hardware alike."""

from __future__ import annotations

import math

import numpy as np

from phcontrol._validation import Array, positive, real_array
from phcontrol.controllers.command import Command
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.safety.clipping import clipped
from phcontrol.safety.torque_filter import FilteredTorque, TorqueFilter
from phcontrol.safety.torque_range import RobotShare, torque_range
from phcontrol.sensors.measured import Measured


class SampledControl:
    """Computes the torque of a law once a period, to be held until the next.

    The law's own state advances by one Euler step a period. The torque passes the torque filter, or is clipped
    to the torque limit. Where the filter had to give H_d more than the law was dissipating, the law's state is moved
    towards ``Controller.calmest_state`` until that energy is taken out again.

    Args:
        controller: the law.
        period: [s].
        torque_limit: what torques are clipped to [N·m]; None for nothing.
        torque_filter: for the same period; None for none.

    Raises:
        InvalidArgumentError: the period is longer than the law's ``longest_period``; the filter does not suit.
    """

    def __init__(
        self,
        controller: Controller,
        period: float,
        torque_limit: Array | None = None,
        torque_filter: TorqueFilter | None = None,
    ) -> None:
        longest = controller.longest_period
        if period > longest * (1.0 + 1e-9):
            message = (
                f"must be at most {longest:.3g} s for {controller.name}, but is {period:g} s: the level of its tank "
                "would pass the lower bound. A tank with less largest_power, or a wider ramp, allows a longer one"
            )
            raise InvalidArgumentError("period", message)
        self.controller, self.period, self.torque_limit, self.filter = controller, period, torque_limit, torque_filter
        if torque_filter is not None:
            check_filter(torque_filter, controller, period)
        self._held_rate: Array | None = None
        self.desired = np.zeros(controller.system.n)
        """The law's own torque in the last period [N·m]."""
        self.torque: Array | None = None
        """The torque of the last period [N·m]; None before the first."""
        self.share: RobotShare | None = None
        """What a robot adds itself to the torque it is sent, to be set before each step; None where it adds nothing."""
        self.filtered: FilteredTorque | None = None
        """What the filter said in the last period; None without one."""

    def advance(self, state: Array) -> Array:
        """Return the law's state one period after the last step (the same before the first)."""
        rate = self._held_rate
        return state if rate is None or not rate.size else state + self.period * rate

    def initial_state(self, x: MechanicalState) -> Array:
        """Return the law's state to start with, and advance from there.

        Raises PHControlError when it is not ``state_size`` finite numbers.
        """
        self._held_rate = None
        return self._checked("initial state", self.controller.initial_state(x), self.controller.state_size)

    def command(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Command:
        """Return what the law orders.

        Raises PHControlError when that is not finite real numbers, as many as joints and as the state has: a torque
        or a rate of another shape would be broadcast, and act.
        """
        torque, rate = self.controller.evaluate(t, x, state, measured)
        return Command(self._checked("torque", torque, x.system.n), self._checked("state rate", rate, state.size))

    def step(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Array:
        """Return the torque to hold from time t on [N·m]; ``x`` is the state as the law's model sees it."""
        self.desired, self._held_rate = self.command(t, x, state, measured)
        stores = self.filter is not None and self.filter.storage
        port = self.controller.passive_port(t, x, state, measured) if stores else None
        torque = self.limited(x, self.desired, measured, port)
        if state.size and (torque is not self.desired) and (change := torque - self.desired).any():
            self._held_rate = self.controller.rate_under_limits(t, x, state, self._held_rate, change, measured)
        if self.filtered is not None and self.filtered.storage_excess > 0.0 and state.size:
            # twice: what the state does about it comes a period late
            self._calm(t, x, state, measured, 2.0 * self.period * self.filtered.storage_excess)
        return torque

    def limited(self, x: MechanicalState, torque: Array, measured: Measured, port: PassivePort | None = None) -> Array:
        """Return a torque after filter and limits [N·m], which is remembered as the last one."""
        if self.filter is not None:
            view, force = x.seen_by(self.filter.system), measured.external_force
            self.filtered = self.filter.filter(
                view, torque, previous=self.torque, share=self.share, external_force=force, port=port
            )
            torque = self.filtered.torque
        limit = self.torque_limit
        if limit is not None:
            torque = clipped(torque, *torque_range(limit, limit, None, self.share))
        self.torque = torque
        return torque

    def hold_rate(self, state_rate: Array) -> None:
        """Let the law's state advance with a rate of one's own until the next step."""
        self._held_rate = state_rate

    def _checked(self, what: str, value: object, size: int) -> Array:
        """Return what the law gave as a read-only vector. Raises PHControlError when it is none."""
        vector = real_array(value, (size,))
        if vector is None:
            given = (
                f"{type(value).__name__} of shape {np.shape(value)}" if isinstance(value, np.ndarray) else repr(value)
            )
            raise PHControlError(
                f"{self.controller.name} gave a {what} that is not {size} finite numbers: {given[:80]}"
            )
        return vector

    def _calm(self, t: float, x: MechanicalState, state: Array, measured: Measured, energy: float) -> None:
        """Move the law's state towards its calmest, until H_d is smaller by an energy [J] or smallest.

        Along that line H_d is a parabola: a step λ of the way takes (2λ − λ²) of what can be taken.
        """
        law = self.controller
        calm = law.calmest_state(t, x, state)
        available = law.storage(t, x, state, measured) - law.storage(t, x, calm, measured)
        if available > 0.0:
            part = 1.0 - math.sqrt(1.0 - min(1.0, energy / available))
            assert self._held_rate is not None
            self._held_rate = self._held_rate + (part / self.period) * (calm - state)


def check_filter(torque_filter: TorqueFilter, controller: Controller, period: float | None) -> None:
    """Raise InvalidArgumentError unless a filter suits a law and a period (None for the filter's own)."""
    if not isinstance(torque_filter, TorqueFilter):
        raise InvalidArgumentError("torque_filter", f"must be a TorqueFilter, but is {type(torque_filter).__name__}")
    if torque_filter.system.n != controller.system.n:
        raise InvalidArgumentError(
            "torque_filter", f"is for {torque_filter.system.n} joints, the controller for {controller.system.n}"
        )
    if period is not None and abs(torque_filter.period - positive("control_period", period)) > 1e-9 * period:
        raise InvalidArgumentError(
            "torque_filter", f"works every {torque_filter.period:g} s, but the control period is {period:g} s"
        )
