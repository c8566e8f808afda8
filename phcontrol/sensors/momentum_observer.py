"""The external force from generalised momentum, for arms without force sensors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from phcontrol._validation import Array, positive
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem, check_system


@dataclass(frozen=True)
class _State:
    """Time, momentum and modeled force rate at the last update, and the estimate."""

    time: float
    momentum: Array
    modeled: Array
    estimate: Array


class MomentumObserver:
    """Estimates f_e from q, q̇ and the applied torque, without accelerations or a force sensor.

    The momentum obeys ṗ = G u + Cᵀq̇ − ∂V/∂q − D q̇ + f_e. What ṗ has over the modeled part is f_e; a
    first-order filter of rate K_o makes the estimate r of it, ṙ = K_o(f_e − r). Between two updates the
    modeled forces are averaged (trapezoid), the torque is the one held, and the filter is advanced
    exactly, so that every K_o is stable at every period. What the model does not know, friction
    above all, is taken for an external force.

    After A. De Luca and R. Mattone, "Actuator failure detection and isolation using generalized
    momenta", ICRA 2003; A. De Luca, A. Albu-Schäffer, S. Haddadin and G. Hirzinger, "Collision detection
    and safe reaction with the DLR-III lightweight manipulator arm", IROS 2006.

    Args:
        system: the model it computes with.
        gain: K_o [1/s]; the estimate lags by 1/K_o.
        period: time between updates [s]; None for every step of the loop.

    Example:
        >>> from phcontrol import MechanicalSystem, MomentumObserver, load_robot, make_controller, simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law, push = make_controller("force_feedback_measured", system), [1.0, 0.0]  # [N·m]
        >>> observer = MomentumObserver(system, gain=50.0)  # [1/s]
        >>> log = simulate(system, law, duration=0.5, dt=2e-3, disturbance=push, sensors=[observer])
        >>> bool(abs(log.measured["external_force"][-1] - push).max() < 0.05)
        True
    """

    quantity = "external_force"
    reads_joints = True

    def __init__(self, system: MechanicalSystem, gain: float = 50.0, *, period: float | None = None) -> None:
        check_system(system)
        self.system = system
        self._input = system.input_matrix
        self.gain = positive("gain", gain)
        self.period = None if period is None else positive("period", period)

    def start(self, x: MechanicalState, external_force: Array) -> _State:
        """Return the state at time 0: the estimate is zero."""
        view = x.seen_by(self.system)
        return _State(0.0, view.momentum, view.total_force(), np.zeros(self.system.n))

    def update(self, state: _State, t: float, x: MechanicalState, external_force: Array, torque: Array) -> _State:
        """Advance the estimate to time t, under the ``torque`` applied since the last update."""
        elapsed = t - state.time
        if elapsed <= 0.0:
            return state
        view = x.seen_by(self.system)
        modeled = view.total_force()
        motors = torque if self._input is None else self._input.dot(torque)
        unexplained = (view.momentum - state.momentum) / elapsed - 0.5 * (modeled + state.modeled) - motors
        fading = math.exp(-self.gain * elapsed)
        estimate: Array = fading * state.estimate + (1.0 - fading) * unexplained
        return _State(t, view.momentum, modeled, estimate)

    def reading(self, state: _State) -> Array:
        """Return the estimate of f_e, shape (n,) [N·m]."""
        return state.estimate
