"""A linear loop whose torque is computed once a period and held."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import expm

from phcontrol._validation import Array
from phcontrol.compilation.loop_jacobian import LoopJacobian
from phcontrol.exceptions import PHControlError

if TYPE_CHECKING:
    import control

_MARGIN = 1e-9  # by which a spectral radius may pass 1: rounding of modes that stay


@dataclass(frozen=True)
class SampledLoop:
    """y⁺ = A y + B f_e over one period h, with f_e held too; y = (q, q̇, controller state, torques on their way).

    Between the samples the plant moves under the held torque, exactly: (Φ, Γ_u, Γ_f) by the matrix exponential. At a
    sample the law is asked, and its own state advances by one Euler step, as in ``simulate(control_period=h)`` and in a
    ``ControlLoop``. A delay of d periods applies the torque of d samples before.

    Example:
        >>> from phcontrol import EnergyShaping, MechanicalSystem, linearize, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> sampled = linearize(EnergyShaping.tuned(system), system, exact=False).sampled(1e-3)
        >>> sampled.stable, sampled.A.shape
        (True, (6, 6))
    """

    period: float
    """h [s]."""
    delay: int
    """In periods."""
    A: Array = field(repr=False)
    B: Array = field(repr=False)
    C: Array = field(repr=False)
    D: Array = field(repr=False)
    states: tuple[str, ...] = field(repr=False)
    inputs: tuple[str, ...] = field(repr=False)
    outputs: tuple[str, ...] = field(repr=False)

    @property
    def eigenvalues(self) -> Any:
        """Of one period, complex."""
        return np.asarray(np.linalg.eigvals(self.A))

    @property
    def radius(self) -> float:
        """The largest modulus of an eigenvalue: what a period leaves of the mode that fades least."""
        return float(np.abs(self.eigenvalues).max())

    @property
    def stable(self) -> bool:
        """Whether nothing grows from period to period."""
        return self.radius <= 1.0 + _MARGIN

    def to_control(self) -> control.StateSpace:
        """Return it as a discrete-time ``control.StateSpace`` (extra ``control``)."""
        return state_space(self, self.period)


def state_space(loop: Any, period: float) -> control.StateSpace:
    """Return a loop with A, B, C, D and names as python-control's. Raises PHControlError, with what to install."""
    try:
        import control
    except ImportError as error:
        raise PHControlError("a control.StateSpace needs python-control: pip install 'phcontrol[control]'") from error
    return control.StateSpace(
        loop.A, loop.B, loop.C, loop.D, period, states=list(loop.states), inputs=list(loop.inputs),
        outputs=list(loop.outputs), remove_useless_states=False,
    )  # fmt: skip


def sampled_matrices(loop: LoopJacobian, period: float, delay: int) -> tuple[Array, Array]:
    """Return A and B of one period."""
    n, size = loop.joints, 2 * loop.joints
    held = np.zeros((size + 2 * n, size + 2 * n))
    held[:n, n:size] = np.eye(n)
    held[n:size] = np.hstack([loop.plant, loop.plant_torque, loop.plant_force])
    moved = expm(period * held)
    flow, by_torque, by_force = np.split(moved[:size], [size, size + n], axis=1)
    command, felt = loop.command, loop.command_force
    states = command.shape[1]
    A, B = np.zeros((states + n * delay, states + n * delay)), np.zeros((states + n * delay, n))
    A[:size, :size], B[:size] = flow, by_force
    A[size:states, size:states] = np.eye(states - size)
    A[size:states, :states] += period * command[n:]
    B[size:states] = period * felt[n:]
    if delay == 0:
        A[:size, :states] += by_torque @ command[:n]
        B[:size] += by_torque @ felt[:n]
        return A, B
    A[:size, -n:] = by_torque
    A[states : states + n, :states], B[states : states + n] = command[:n], felt[:n]
    for k in range(1, delay):
        A[states + n * k : states + n * (k + 1), states + n * (k - 1) : states + n * k] = np.eye(n)
    return A, B


def radius(loop: LoopJacobian, period: float, delay: int) -> float:
    """Return the spectral radius of one period."""
    return float(np.abs(np.linalg.eigvals(sampled_matrices(loop, period, delay)[0])).max())


def longest_stable_period(loop: LoopJacobian, delay: int, first: float, last: float) -> float:
    """Return the period at which the sampled loop first becomes unstable [s]; 0 if it is at ``first``, inf if never.

    Looked for from ``first`` to ``last`` [s] in steps of 5 %, and bisected.
    """

    def stable(period: float) -> bool:
        return radius(loop, period, delay) <= 1.0 + _MARGIN

    if not stable(first):
        return 0.0
    low = first
    while low < last:
        high = 1.05 * low
        if not stable(high):
            for _ in range(50):
                middle = 0.5 * (low + high)
                low, high = (middle, high) if stable(middle) else (low, middle)
            return low
        low = high
    return np.inf
