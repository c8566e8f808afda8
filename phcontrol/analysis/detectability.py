"""LaSalle's invariance principle for a closed loop: the largest invariant set in which nothing is lost."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from phcontrol._differences import jacobian
from phcontrol._validation import Array, count
from phcontrol.analysis.certify import require_certificate
from phcontrol.analysis.linearization import Linearization, linearize
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.promise import Promise
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.simulation.integrators import runge_kutta_step

_RANK = 1e-7  # of the largest singular value, below which one is 0
_STEP = 1e-4  # of the finite differences, in natural units
_ITERATIONS = 12
_SMALL = 0.3  # natural units from rest at which states without loss are looked for
_STEPS = 40  # of a short motion out of one, each half the fastest time constant
_ON_IT = 1e-12  # of H_d per fastest time constant: a loss that is none
_LEFT = 1e-9  # of H_d, that a motion must have lost to have left the set


@dataclass(frozen=True)
class InvariantSet:
    """The largest invariant set in {Ḣ_d = 0} about the rest: {rest} where LaSalle gives asymptotic stability.

    Example:
        >>> from phcontrol import EnergyShaping, MechanicalSystem, invariant_set, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> found = invariant_set(EnergyShaping.tuned(system), system)
        >>> found.dimension, found.detectable
        (0, True)
    """

    states: int
    """How many numbers (q, q̇, controller state) there are."""
    dimension: int
    """Of the set, by the rank of observability of R_d^½∇H_d along the linear loop: 0 for the rest alone."""
    marginal: int
    """How many eigenvalues have a real part that cannot be told from 0: the same number, found without R_d."""
    hidden: int
    """Dimension of what stays where ŷ = GᵀT⁻ᵀp̂ = 0."""
    detectable: bool
    """Whether what stays there fades: the system is zero-state detectable from ŷ, as Theorem 4.2.3 assumes."""
    directions: Array = field(repr=False)
    """A basis of the set, shape (states, dimension), in natural units of (q, q̇, controller state)."""
    least_loss: float
    """Least share of H_d that a short true motion loses out of sampled states in which nothing is lost at first; NaN
    where there are none but the rest."""

    @property
    def only_rest(self) -> bool:
        """Whether the rest is all of it, by the rank, by the spectrum, and in the sampled states away from it."""
        departs = not self.least_loss <= _LEFT  # NaN: nothing to depart from
        return self.dimension == 0 and self.marginal == 0 and departs


def invariant_set(controller: Controller, system: MechanicalSystem, *, samples: int = 8, seed: int = 0) -> InvariantSet:
    """Find the largest invariant set in which the storage function of a closed loop does not fall.

    Every proof of the thesis ends with LaSalle's principle; this looks whether it applies. The true closed loop is
    linearised about its rest. What R_d^½∇H_d does not see of it, N = {y: R_d^½∇H_d(Aᵏy) = 0 for all k}, is the set to
    first order; eigenvalues on the imaginary axis must be as many. Away from the rest, states with Ḣ_d = 0 are searched
    by Gauss-Newton steps, half of them from N where that is more than the rest, and the true motion out of each must
    lose something.

    Args:
        controller: the law.
        system: the plant.
        samples: how many states without loss are looked for.
        seed: of where the search begins.

    Raises InvalidArgumentError for a law that changes with time or rests in contact only, PHControlError for one that
    is not what it promises on this system, or does not rest near its goal.

    Example:
        >>> from phcontrol import EnergyShaping, MechanicalSystem, invariant_set, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> invariant_set(EnergyShaping.tuned(system), system).dimension  # 0: it comes to rest at its goal alone
        0
    """
    count("samples", samples)
    require_certificate(controller, system, "LaSalle's principle", rest=False)
    loop = linearize(controller, system, exact=False)
    A = loop.natural_A
    directions = _unseen(loop.scaled(loop.losses), A)
    hidden = _unseen(loop.scaled(loop.passive_output), A)
    within = np.linalg.eigvals(hidden.T @ A @ hidden) if hidden.shape[1] else np.zeros(0)
    uncertainty = float(loop.uncertainty.max(initial=0.0))
    return InvariantSet(
        states=len(A),
        dimension=directions.shape[1],
        marginal=int((np.abs(loop.eigenvalues.real) <= loop.uncertainty).sum()),
        hidden=hidden.shape[1],
        detectable=bool((within.real < -uncertainty).all()),
        directions=directions,
        least_loss=_least_loss(controller, system, loop, directions, samples, seed),
    )


def _unseen(output: Array, A: Array) -> Array:
    """Return an orthonormal basis of the largest A-invariant subspace on which the output is 0, shape (N, d)."""
    A = A / max(float(np.abs(A).max()), 1e-300)
    basis = _kernel(output / max(float(np.abs(output).max()), 1e-300))
    while basis.shape[1]:
        outside = A @ basis
        outside -= basis @ (basis.T @ outside)
        inner = _kernel(outside)
        if inner.shape[1] == basis.shape[1]:
            break
        basis = basis @ inner
    return basis


def _kernel(matrix: Array) -> Array:
    """Return an orthonormal basis of the kernel of a matrix whose entries are of order 1."""
    _, values, right = np.linalg.svd(matrix)
    rank = int((values > _RANK).sum())
    kernel: Array = right[rank:].T
    return kernel


def _least_loss(
    controller: Controller, system: MechanicalSystem, loop: Linearization, directions: Array, samples: int, seed: int
) -> float:
    """Return the least share of H_d that short motions lose out of states in which nothing is lost."""
    generator, n = np.random.default_rng(seed), system.n
    units = NaturalUnits.of(controller, system, 0.0).motion
    scene = controller.rest_scene(controller.system.at(loop.position))
    rest, least = np.concatenate([loop.position, np.zeros(n), loop.state]), np.nan
    nothing, fastest = np.zeros(n), float(np.abs(loop.eigenvalues).max())

    def seen(y: Array) -> Seen:
        at = SampledState(0.0, y[:n], y[n : 2 * n], y[2 * n :], nothing, scene, "")
        return Seen.of(controller, system, at)

    def rate(t: float, y: Array) -> Array:
        return seen(y).rate(system)

    def stored(y: Array) -> float:
        return seen(y).stored() - seen(rest).stored()

    for k in range(samples):
        away = generator.uniform(-1.0, 1.0, len(rest))
        if k % 2:
            away = directions @ (directions.T @ away)
        y = rest + _SMALL * units * away
        for _ in range(_ITERATIONS):
            left = _losses(seen(y).promise())
            slope, _ = jacobian(lambda there: _losses(seen(there).promise()), y, units, _STEP)
            y = y - units * np.linalg.lstsq(slope * units, left, rcond=1e-9)[0]
        energy = stored(y)
        if (
            energy <= _ON_IT * abs(stored(rest + _SMALL * units))
            or _power(seen(y).promise()) > _ON_IT * energy * fastest
        ):
            continue  # back at the rest, or none was found
        h, there, lost = 0.5 / fastest, y, 0.0  # summed: what the integrator itself loses does not count
        for _ in range(_STEPS):
            there = runge_kutta_step(rate, 0.0, there, h, rate(0.0, there))
            lost += h * _power(seen(there).promise())
        least = float(np.fmin(least, lost / energy))
    return least


def _losses(promise: Promise) -> Array:
    """Return R_d^½∇H_d [√W]."""
    return promise.dissipation_root @ promise.gradient


def _power(promise: Promise) -> float:
    return float(promise.gradient @ promise.R @ promise.gradient)
