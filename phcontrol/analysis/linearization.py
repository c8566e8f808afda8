"""A closed loop about the state where it rests, as linear equations with named states, inputs and outputs."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm
from scipy.optimize import minimize_scalar, root

from phcontrol._validation import Array, count, number, positive, vector
from phcontrol.analysis.equilibrium import rest_condition
from phcontrol.analysis.loop_differences import best_jacobian, differenced_loop
from phcontrol.analysis.modes import Mode, modes_of
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.neighbourhood import spectrum_of
from phcontrol.analysis.rest_point import find_rest
from phcontrol.analysis.sampled_loop import SampledLoop, longest_stable_period, sampled_matrices, state_space
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.compilation.errors import CompilationError
from phcontrol.compilation.loop_derivatives import LoopDerivatives
from phcontrol.compilation.loop_jacobian import LoopJacobian
from phcontrol.controllers.controller import Controller, check_loop
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.vision.scene import Scene

if TYPE_CHECKING:
    import control

ACCURACY = 1e-4
"""The largest error of finite differences, over the largest entry of what is differentiated."""
_LEFT = 1e-8  # rates that an equilibrium under load may leave
_MOST_DELAY = 1000  # periods
_DECADES, _POINTS = 3, 600  # how far beyond the eigenvalues frequencies are looked at, and how many
_FASTEST, _SLOWEST = 1e-2, 10.0  # periods that are looked at, over the fastest and the slowest time constant
_LONGEST = 1e3  # [s]
_ROUNDING = 1e-14  # of the largest entry of exact derivatives


@dataclass(frozen=True)
class Linearization:
    """ẏ = A y + B f_e, outputs = C y + D f_e about an equilibrium, in SI units; y = (q, q̇, controller state).

    The loop is the true one: the forward dynamics of the plant under the law's torque. y and f_e are what they differ
    by from the equilibrium. Outputs are q, q̇ and the law's ŷ = GᵀT⁻ᵀp̂.

    Example:
        >>> from phcontrol import EnergyShaping, MechanicalSystem, linearize, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> linear = linearize(EnergyShaping.tuned(system), system, exact=False)
        >>> linear.A.shape, bool((linear.eigenvalues.real < 0.0).all())
        ((4, 4), True)
    """

    position: Array
    """q at the equilibrium, shape (n,) [rad]."""
    state: Array
    """The law's own."""
    force: Array
    """f_e there, shape (n,) [N·m]."""
    states: tuple[str, ...] = field(repr=False)
    """Names of y: ``q[joint]``, ``v[joint]``, and of the law's own states."""
    inputs: tuple[str, ...] = field(repr=False)
    """Names of f_e: ``f[joint]``."""
    outputs: tuple[str, ...] = field(repr=False)
    """``q[joint]``, ``v[joint]``, ``y[joint]``."""
    exact: bool
    """Whether A and B are exact; else they are finite differences."""
    accuracy: float
    """The largest estimated error of the finite differences, over the largest entry; 0 where exact."""
    A: Array = field(repr=False)
    B: Array = field(repr=False)
    C: Array = field(repr=False)
    D: Array = field(repr=False)
    eigenvalues: Array = field(repr=False)
    """Of A, complex [1/s]."""
    uncertainty: Array = field(repr=False)
    """Of each eigenvalue, to first order, of rounding or of the differences [1/s]."""
    jacobian: LoopJacobian = field(repr=False)
    """A and B in their parts."""
    scale: Array = field(repr=False)
    """Natural units of y."""
    force_output: Array = field(repr=False)
    """From y to portᵀ∇H_d, which goes with f_e [rad/s]."""
    passive_output: Array = field(repr=False)
    """From y to ŷ [rad/s]."""
    losses: Array = field(repr=False)
    """From y to R_d^½∇H_d [√W]."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(name[2:-1] for name in self.inputs)

    @property
    def natural_A(self) -> Array:
        """A for y in natural units of the arm and of the law [1/s]."""
        return self.scaled(self.A) / self.scale[:, None]

    def scaled(self, outputs: Array) -> Array:
        """Return a matrix of outputs of y for y in natural units."""
        return outputs * self.scale

    @property
    def spectrum(self) -> tuple[Mode, ...]:
        """The modes, slowest first: those that do not fade come before all others."""
        return modes_of(self.natural_A, self.joints, self.eigenvalues, self.uncertainty)

    @property
    def stable(self) -> bool:
        """Whether every mode fades, beyond what is uncertain."""
        return bool((self.eigenvalues.real + self.uncertainty < 0.0).all())

    def response(self, frequency: float) -> Array:
        """Return C(jω − A)⁻¹B + D at a frequency ω [rad/s], shape (3n, n), complex."""
        inner = np.linalg.solve(1j * number("frequency", frequency) * np.eye(len(self.A)) - self.A, self.B)
        found: Array = self.C @ inner + self.D
        return found

    def step_response(self, duration: float, samples: int = 400) -> tuple[Array, Array]:
        """Return times, shape (N,) [s], and the outputs after a step of 1 N·m in each input, shape (N, 3n, n)."""
        time = np.linspace(0.0, positive("duration", duration), count("samples", samples, maximum=10**6))
        size, inputs = self.B.shape
        held = np.zeros((size + inputs, size + inputs))
        held[:size] = np.hstack([self.A, self.B])
        onwards = expm(held * (time[1] - time[0] if samples > 1 else 0.0))
        y, found = np.vstack([np.zeros((size, inputs)), np.eye(inputs)]), []
        for _ in time:
            found.append(self.C @ y[:size] + self.D @ y[size:])
            y = onwards @ y
        return time, np.stack(found)

    def gain(self, frequency: float) -> float:
        """Return the largest singular value from f_e to portᵀ∇H_d at a frequency [rad/s]."""
        inner = np.linalg.solve(1j * number("frequency", frequency) * np.eye(len(self.A)) - self.A, self.B)
        return float(np.linalg.svd(self.force_output @ inner, compute_uv=False)[0])

    @property
    def norm(self) -> float:
        """The H∞ norm from f_e to portᵀ∇H_d: the largest gain of all frequencies; infinite for an unstable loop."""
        if (self.eigenvalues.real - self.uncertainty > 0.0).any():
            return np.inf
        sizes = np.abs(self.eigenvalues)
        sizes = sizes[sizes > 1e-6 * sizes.max()]
        ends = np.log10(sizes.min()) - _DECADES, np.log10(sizes.max()) + _DECADES
        grid = np.unique(np.concatenate([np.linspace(*ends, _POINTS), np.log10(sizes)]))
        gains = [self.gain(10.0**each) for each in grid]
        best = int(np.argmax(gains))
        around = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
        refined = minimize_scalar(lambda each: -self.gain(10.0**each), bounds=around, method="bounded")
        return max(gains[best], -float(refined.fun))

    def sampled(self, period: float, delay: int = 1) -> SampledLoop:
        """Return the loop whose torque is computed once a period [s], held, and applied ``delay`` periods later."""
        h, d = positive("period", period), count("delay", delay, minimum=0, maximum=_MOST_DELAY)
        A, B = sampled_matrices(self.jacobian, h, d)
        waiting = len(A) - len(self.A)
        names = tuple(f"u{k + 1}[{joint}]" for k in range(d) for joint in self.joints)
        C = np.hstack([self.C, np.zeros((len(self.C), waiting))])
        return SampledLoop(h, d, A, B, C, self.D, (*self.states, *names), self.inputs, self.outputs)

    def longest_period(self, delay: int = 1) -> float:
        """Return the largest period up to which the sampled loop is stable [s]: 0 for none, inf for no bound.

        That is the first at which an eigenvalue leaves the unit circle, looked for in steps of 5 %.
        """
        rates = np.abs(self.eigenvalues)
        slowest = float(rates[rates > 1e-9 * rates.max()].min())
        last = min(_SLOWEST / slowest, _LONGEST)
        return longest_stable_period(
            self.jacobian, count("delay", delay, minimum=0, maximum=_MOST_DELAY), _FASTEST / float(rates.max()), last
        )

    def to_control(self) -> control.StateSpace:
        """Return it as a ``control.StateSpace`` with the same names, for Bode, Nyquist and H∞ (extra ``control``)."""
        return state_space(self, 0.0)


def linearize(
    controller: Controller,
    system: MechanicalSystem,
    *,
    at: ArrayLike | None = None,
    force: ArrayLike | None = None,
    exact: bool | None = None,
) -> Linearization:
    """Linearise a closed loop about an equilibrium, which is found first.

    Args:
        controller: the law.
        system: the plant.
        at: a posture near which the equilibrium is looked for [rad]; the law's own goal if not given.
        force: a constant f_e under which it rests [N·m]; none if not given.
        exact: True for derivatives of the traced loop (:class:`LoopDerivatives`, needs casadi), False for finite
            differences of fourth order, None for exact ones where they are to be had.

    Raises:
        InvalidArgumentError: the law goes on changing with time, or rests in contact only.
        PHControlError: there is no equilibrium near by, or finite differences are not accurate there.
        CompilationError: exact derivatives were asked for, and there are none.

    Example:
        >>> from phcontrol import MechanicalSystem, linearize, load_robot, make_controller
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> found = linearize(make_controller("energy_shaping", system), system, exact=False)
        >>> found.A.shape, found.stable, found.states[0]
        ((4, 4), True, 'q[shoulder_pitch]')
    """
    check_loop(controller, system)
    if controller.time_span:
        raise InvalidArgumentError("controller", f"{controller.name} changes with time: it has no rest to look about")
    n, units = system.n, NaturalUnits.of(controller, system, 0.0)
    given = at is not None or force is not None
    outside = np.zeros(n) if force is None else np.array(vector("force", force, n))
    values = uncertainty = None
    if given:
        position, state = _loaded(controller, system, at, outside)
    else:
        rest = find_rest(controller, system, units, 0.0)
        if rest.in_contact:
            raise InvalidArgumentError(
                "controller", f"{controller.name} rests in contact only: give what it presses on"
            )
        if not rest.found:
            raise PHControlError(f"{controller.name} does not rest near its goal")
        position, state = rest.position, rest.state
        values, uncertainty = rest.eigenvalues, rest.uncertainty
    y = np.concatenate([position, np.zeros(n), state])
    scene = controller.rest_scene(controller.system.at(position))
    found = None if exact is False else _exactly(controller, system, scene, y, outside, exact is True)
    accuracy = 0.0
    if found is None:
        found, accuracy = differenced_loop(controller, system, scene, y, outside, units)
        if not accuracy <= ACCURACY:
            raise PHControlError(
                f"the finite differences of {controller.name} about its equilibrium are off by up to {accuracy:.1e} of "
                "their largest entry: it has no derivative there, or a stiff one"
            )
    scale, A = units.motion, found.state
    if accuracy == 0.0 or values is None or uncertainty is None:
        scaled = A * scale / scale[:, None]
        values, uncertainty = spectrum_of(scaled, np.full(A.shape, (accuracy + _ROUNDING) * np.abs(scaled).max()))
    promised = _Promised(controller, system, scene, y, outside, scale)
    joints = tuple(system.robot.joint_names)
    names = tuple(f"{kind}[{joint}]" for kind in "qv" for joint in joints)
    moving = np.eye(2 * n, len(y))
    return Linearization(
        position=position,
        state=state,
        force=outside,
        states=(*names, *_own_names(controller, joints)),
        inputs=tuple(f"f[{joint}]" for joint in joints),
        outputs=(*names, *(f"y[{joint}]" for joint in joints)),
        exact=accuracy == 0.0,
        accuracy=accuracy,
        A=A,
        B=found.force,
        C=np.vstack([moving, promised.passive_output]),
        D=np.zeros((3 * n, n)),
        eigenvalues=values,
        uncertainty=uncertainty,
        jacobian=found,
        scale=scale,
        force_output=promised.force_output,
        passive_output=promised.passive_output,
        losses=promised.losses,
    )


def _exactly(
    law: Controller, plant: MechanicalSystem, scene: Scene | None, y: Array, force: Array, asked: bool
) -> LoopJacobian | None:
    """Return the exact derivatives; None where there are none and none were asked for."""
    if not asked and importlib.util.find_spec("casadi") is None:
        return None
    n = plant.n
    try:
        return LoopDerivatives(law, plant, scene).at(0.0, y[:n], y[n : 2 * n], y[2 * n :], force)
    except CompilationError:
        if asked:
            raise
        return None


def _loaded(law: Controller, plant: MechanicalSystem, at: ArrayLike | None, force: Array) -> tuple[Array, Array]:
    """Return the posture and the law's state at which nothing changes under a force."""
    start = np.array(law.rest_posture(0.0)) if at is None else np.array(vector("at", at, plant.n))
    rates = rest_condition(law, plant, force)
    own = law.initial_state(law.system.at(start))
    solution = root(rates, np.concatenate([start, own]), method="hybr", tol=1e-13)
    left = float(np.abs(rates(solution.x)).max())
    if not left <= _LEFT:
        raise PHControlError(f"found no equilibrium of {law.name} near {start}: a rate of {left:.2g} is left")
    return solution.x[: plant.n], solution.x[plant.n :]


class _Promised:
    """What the law promises about the equilibrium, as outputs of y."""

    def __init__(
        self, law: Controller, plant: MechanicalSystem, scene: Scene | None, y: Array, force: Array, scale: Array
    ) -> None:
        n = plant.n

        def seen(there: Array) -> Seen:
            at = SampledState(0.0, there[:n], there[n : 2 * n], there[2 * n :], force, scene, "")
            return Seen.of(law, plant, at)

        def passive(there: Array) -> Array:
            look = seen(there)
            x = law.promised_state(look.view)
            output: Array = x.input_matrix.T @ x.solve_factor_transposed(look.target().momentum)
            return output

        promise = seen(y).promise()
        slope = best_jacobian(lambda there: seen(there).promise().gradient, y, scale)[0]
        self.force_output: Array = promise.port.T @ slope  # at rest ∇H_d is 0: the port's own change does not count
        self.losses: Array = promise.dissipation_root @ slope
        self.passive_output: Array = best_jacobian(passive, y, scale)[0]


def _own_names(law: Controller, joints: tuple[str, ...]) -> tuple[str, ...]:
    """Return names of the entries of a law's own state."""
    parts, size = law.states, law.state_size
    if not size:
        return ()
    if parts and size == len(parts) * len(joints):
        return tuple(f"{part}[{joint}]" for part in parts for joint in joints)
    return tuple(f"state[{k}]" for k in range(size))
