"""A closed loop about the state where it rests, as linear equations from f_e to what the law promises."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize_scalar

from phcontrol._differences import jacobian
from phcontrol._validation import Array
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.rest_point import RestPoint, find_rest
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.controllers.controller import Controller
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.mechanics.system import MechanicalSystem

_STEP = 1e-4  # of the finite differences, in natural units
_DECADES, _POINTS = 3, 600  # how far beyond the eigenvalues frequencies are looked at, and how many


@dataclass(frozen=True)
class LinearLoop:
    """ẏ = A y + B f_e about the rest, with y = (q, q̇, controller state) in natural units.

    A and B are those of the true closed loop: forward dynamics of the plant under the law's torque. The outputs are the
    law's: port·∇H_d, which goes with f_e, ŷ = GᵀT⁻ᵀp̂, and what ∇H_dᵀR_d∇H_d is the square of.
    """

    rest: RestPoint
    A: Array = field(repr=False)
    B: Array = field(repr=False)
    """From f_e [1/(N·m·s)]."""
    force_output: Array = field(repr=False)
    """To portᵀ∇H_d [rad/s]."""
    passive_output: Array = field(repr=False)
    """To ŷ = GᵀT⁻ᵀp̂ [rad/s]."""
    losses: Array = field(repr=False)
    """To R_d^½∇H_d [√W]."""

    def gain(self, frequency: float) -> float:
        """Return the largest singular value from f_e to portᵀ∇H_d at a frequency [rad/s]."""
        inner = np.linalg.solve(1j * frequency * np.eye(len(self.A)) - self.A, self.B)
        return float(np.linalg.svd(self.force_output @ inner, compute_uv=False)[0])

    @property
    def norm(self) -> float:
        """The H∞ norm from f_e to portᵀ∇H_d: the largest gain of all frequencies; infinite for an unstable loop."""
        if (self.rest.eigenvalues.real - self.rest.uncertainty > 0.0).any():
            return np.inf
        sizes = np.abs(self.rest.eigenvalues)
        sizes = sizes[sizes > 1e-6 * sizes.max()]
        ends = np.log10(sizes.min()) - _DECADES, np.log10(sizes.max()) + _DECADES
        grid = np.unique(np.concatenate([np.linspace(*ends, _POINTS), np.log10(sizes)]))
        gains = [self.gain(10.0**each) for each in grid]
        best = int(np.argmax(gains))
        around = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
        refined = minimize_scalar(lambda each: -self.gain(10.0**each), bounds=around, method="bounded")
        return max(gains[best], -float(refined.fun))


def linearise(controller: Controller, system: MechanicalSystem) -> LinearLoop:
    """Linearise a closed loop about the state where it rests.

    Raises InvalidArgumentError for a law that goes on changing with time, and for one that rests in contact only;
    PHControlError when it does not rest near its goal.
    """
    if controller.time_span:
        raise InvalidArgumentError("controller", f"{controller.name} changes with time: it has no rest to look about")
    units = NaturalUnits.of(controller, system, 0.0)
    rest = find_rest(controller, system, units, 0.0)
    if rest.in_contact:
        raise InvalidArgumentError("controller", f"{controller.name} rests in contact only: give what it presses on")
    if not rest.found:
        raise PHControlError(f"{controller.name} does not rest near its goal")
    n, scale = system.n, units.motion
    scene = controller.rest_scene(controller.system.at(rest.position))
    here = np.concatenate([rest.position, rest.velocity, rest.state])

    def seen(y: Array, force: Array) -> Seen:
        at = SampledState(0.0, y[:n], y[n : 2 * n], y[2 * n :], force, scene, "")
        return Seen.of(controller, system, at)

    def rate(y: Array, force: Array) -> Array:
        return seen(y, force).rate(system) / scale

    nothing = np.zeros(n)
    promise = seen(here, nothing).promise()

    def gradient(y: Array) -> Array:
        return seen(y, nothing).promise().gradient

    def passive(y: Array) -> Array:
        there = seen(y, nothing)
        target = there.target()
        x = controller.promised_state(there.view)
        output: Array = x.input_matrix.T @ x.solve_factor_transposed(target.momentum)
        return output

    slope = jacobian(gradient, here, scale, _STEP)[0] * scale
    return LinearLoop(
        rest=rest,
        A=jacobian(lambda y: rate(y, nothing), here, scale, _STEP)[0] * scale,
        B=jacobian(lambda force: rate(here, force), nothing, units.force, _STEP)[0],
        force_output=promise.port.T @ slope,  # ∇H_d is 0 at rest: the port's own change does not count
        passive_output=jacobian(passive, here, scale, _STEP)[0] * scale,
        losses=promise.dissipation_root @ slope,
    )
