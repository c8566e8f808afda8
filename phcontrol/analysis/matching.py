"""Promise against plant, state by state: residuals in natural units, and the structure of what is promised."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from phcontrol._validation import Array
from phcontrol.analysis.certificate import IDLE
from phcontrol.analysis.flow import Flow
from phcontrol.analysis.promise import Promise
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.analysis.state_sampler import reference_velocity
from phcontrol.analysis.worst import Worst
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.system import MechanicalSystem

_STRETCHES = (
    1.0,
    1.0 / 8.0,
    1.0 / 64.0,
    8.0,
    1.0 / 512.0,
)  # of the step: a law is wrong with every one, a bend within a step is not
_CLOSE_ENOUGH = 1e-8  # of a row's terms: then no other step is tried
_MOVING = 0.75  # quantile of a row's terms that is taken for what they are where things move
_SEEN = 1e7  # times the rounding of a rate, of which a millionth is seen
_LEAST_SCALE = 1e-3  # of these, below which a row's terms are not taken for its unit
_NOTHING = 1e-200  # of an entry of R that is no damping but a rounding
_SLOW = 1e-3  # below which a motion's losses are no more to be told from rounding [rad/s]
_SOON = (1e-2, 1e-1, 1.0)  # when a state of the law has begun to damp, of fast loops and of slow ones [s]
_ROUNDING = 1e-9  # of the largest term anywhere, the least unit of a row: a millionth of that is rounding


class StateFigures(NamedTuple):
    """What one state says. Rows are those of the target; their units come from all states together."""

    residual: Array
    """|ẋ − promise| per row, ẋ by finite differences along the flow."""
    terms: Array
    """Sum of the absolute terms of each row of the promise."""
    coordinates: Array
    """|x| per row."""
    slope_error: float
    """|Ḣ_d − ∇H_dᵀẋ − ∂H_d/∂t| [W], the last at the same coordinates."""
    growth: float
    """Ḣ_d − ∇H_dᵀ(port f_e + drive) [W]: what the storage function gains by itself."""
    aging: float
    """∂H_d/∂t at the same coordinates [W]: what it gains by the clock alone, of a law that changes with time."""
    power: float
    """Sum of the absolute terms of ∇H_dᵀẋ [W]."""
    skewness: float
    indefiniteness: float
    has_drive: bool
    """Whether the target has a drive."""
    drive: float
    """Largest entry of what it brings."""
    drive_power: float
    """∇H_dᵀ drive: what it brings in [W]."""
    stored: float
    """H_d [J]."""
    idleness: float
    """Share of the kinetic energy that is dissipated each second, ∇H_dᵀR_d∇H_d over it [1/s]; infinite at rest."""
    mislabelled: float
    """Largest difference of ``target().coordinates`` from ``coordinates()``."""
    moves_momentum: float
    """By how much what drives the law enters rows that depend on the velocity: as a torque, which it must not."""
    parts: Mapping[str, slice]
    """Where in the rows the target's parts are, by name."""


def examine(law: Controller, plant: MechanicalSystem, at: SampledState) -> StateFigures:
    """Return the figures of one state."""
    flow = Flow(law, plant, at)
    seen = flow.start
    stated = seen.target()
    target = Promise.of(stated, plant.n)
    promised, driven = target.rate(at.force), target.driven
    terms = np.abs(target.J - target.R) @ np.abs(target.gradient) + np.abs(target.port) @ np.abs(at.force)
    terms += np.abs(driven)
    residual, rate, slope_error = np.full(promised.shape, np.inf), promised, np.inf
    storage_rate, power, aging = 0.0, 0.0, 0.0
    ages = False  # looked at where H_d does not follow its gradient without it
    within = [stretch for stretch in _STRETCHES if flow.stays(stretch)]
    for stretch in within or _STRETCHES[-1:]:
        rates = flow.derivative(flow.followed, stretch)
        slope, actual = float(rates[0]), rates[1:]
        residual = np.fmin(residual, np.abs(actual - promised))
        products = target.gradient * actual
        error = abs(slope - float(products.sum()))
        ages = ages or bool(law.time_span and error > _CLOSE_ENOUGH * np.abs(products).sum())
        by_clock = flow.aging(stretch) if ages else 0.0
        error = abs(slope - float(products.sum()) - by_clock)
        if not error >= slope_error:
            slope_error, storage_rate, rate, aging = error, slope, actual, by_clock
            power = float(np.abs(products).sum())
        if (residual <= _CLOSE_ENOUGH * terms).all() and slope_error <= _CLOSE_ENOUGH * power:
            break
    supplied = float(target.gradient @ (target.port @ at.force + driven))
    # a coordinate that stands at its largest, as an entry of a rotation, has a rate that is rounding
    terms = np.maximum(np.maximum(terms, np.abs(rate)), _SEEN * flow.rounding * np.abs(target.coordinates))
    return StateFigures(
        residual=residual,
        terms=terms,
        coordinates=np.abs(target.coordinates),
        slope_error=slope_error,
        growth=storage_rate - supplied,
        aging=aging,
        power=power + abs(supplied),
        skewness=_skewness(target.J, target.R),
        indefiniteness=indefiniteness(target.R),
        has_drive=bool(target.signal.size),
        drive=float(np.abs(driven).max(initial=0.0)),
        stored=seen.stored(),
        idleness=_idleness_soon(seen, target),
        mislabelled=_relative(np.abs(seen.coordinates() - target.coordinates), np.abs(target.coordinates)),
        drive_power=float(target.gradient @ driven),
        moves_momentum=_momentum_driven(seen, target),
        parts=stated.parts,
    )


def worst_residual(states: Sequence[SampledState], figures: Sequence[StateFigures]) -> Worst:
    """Return the largest matching residual: each row relative to its own terms.

    A row's unit is the sum of its terms at that state, or a thousandth of what that is where things move (the upper
    quartile of the states) where little does; so a light joint is not hidden by a heavy one, nor an error at rest by
    fast motion.
    """
    largest = max((float(each.terms.max(initial=0.0)) for each in figures), default=0.0)
    sizes = {len(each.residual) for each in figures}
    unit = {size: np.maximum(_usual(figures, size), _ROUNDING * largest) for size in sizes}
    relative = [each.residual / np.maximum(each.terms, unit[len(each.residual)]) for each in figures]
    values = [float(np.where(np.isnan(rows), np.inf, rows).max(initial=0.0)) for rows in relative]

    def where(k: int) -> str:
        return f"{_largest_row(relative[k], figures[k].parts)}, {described(states[k])}"

    return Worst.among(values, where)


def _largest_row(relative: Array, parts: Mapping[str, slice]) -> str:
    row = int(np.argmax(np.where(np.isnan(relative), np.inf, relative)))
    named = (
        f" ('{name}', entry {row - part.start + 1})" for name, part in parts.items() if part.start <= row < part.stop
    )
    return f"row {row + 1} of {len(relative)}{next(named, '')}"


def worst_power(
    states: Sequence[SampledState], figures: Sequence[StateFigures], errors: Sequence[float], lowest: float = 0.0
) -> Worst:
    """Return the largest of some powers, relative to the power that flows, with the same units as for rows."""
    powers = [each.power for each in figures]
    usual = max(_LEAST_SCALE * float(np.quantile(powers, _MOVING)), _ROUNDING * max(powers))
    relative = [error / max(each.power, usual, 1e-300) for each, error in zip(figures, errors, strict=True)]
    return Worst.among(relative, lambda k: described(states[k]), lowest)


def described(state: SampledState) -> str:
    """Return in words where a state lies."""
    words = f"{state.stratum}; " if state.stratum else ""
    return f"{words}t = {state.time:.4g} s, q = {np.array2string(state.position, precision=3, max_line_width=1000)}"


def _usual(figures: Sequence[StateFigures], size: int) -> Array:
    """Return a thousandth of each row's usual terms; where a row never moves, of its coordinate per 1000 s."""
    terms = np.array([each.terms for each in figures if len(each.residual) == size])
    places = np.array([each.coordinates for each in figures if len(each.residual) == size])
    usual = np.maximum(np.quantile(terms, _MOVING, axis=0), _LEAST_SCALE * np.median(places, axis=0))
    result: Array = np.maximum(_LEAST_SCALE * usual, 1e-300)
    return result


def _skewness(J: Array, R: Array) -> float:
    """Return max |J + Jᵀ|, each entry relative to the largest ones of J and R in its row and column."""
    if not J.size:
        return 0.0
    row = np.maximum(np.abs(J), np.abs(R)).max(axis=1)
    return _relative(np.abs(J + J.T), np.sqrt(np.outer(row, row)))


def indefiniteness(R: Array) -> float:
    """Return how far a matrix is from symmetric positive semidefinite: 0 for R ⪰ 0, but for rounding.

    Scaled to a diagonal of ±1, so that a small negative damping in one joint is seen beside dampings of any size in
    others. Beside a zero on the diagonal nothing may stand, since |R_ij|² ≤ R_ii R_jj.
    """
    R = np.where(np.abs(R) < _NOTHING, 0.0, R)
    diagonal = np.diag(R)
    size = np.sqrt(np.abs(diagonal))
    worst = _relative(np.abs(R - R.T), np.maximum(np.outer(size, size), 1e-9 * np.abs(R)))
    live = size > 0.0
    if (R[~live] != 0.0).any() or (R[:, ~live] != 0.0).any():
        return np.inf
    scaled = (0.5 * (R + R.T))[np.ix_(live, live)] / np.outer(size[live], size[live])
    return max(worst, -float(np.linalg.eigvalsh(scaled)[0]) if scaled.size else 0.0)


def _relative(error: Array, scale: Array) -> float:
    """Return the largest error over its scale; infinite where there is one and no scale."""
    with np.errstate(divide="ignore"):
        return float((error[error > 0.0] / scale[error > 0.0]).max(initial=0.0))


def _idleness_soon(seen: Seen, target: Promise) -> float:
    """Return the idleness at the state itself; of a law that damps by a state of its own what it is a little later.

    Such a state may stand, for an instant, where it damps nothing: as a spring and a damper in a row do.
    """
    idleness = _idleness(seen, target)
    if idleness > IDLE or not seen.law.state_size or seen.law.eyes is not None:
        return idleness
    at, state_rate = seen.at, seen.command().state_rate
    for shift in _SOON:  # at the same velocity: a large f_e would hide what is lost in what it brings
        later = seen.elsewhere(position=at.position + shift * at.velocity, state=at.state + shift * state_rate)
        idleness = max(idleness, _idleness(later, later.promise()))
        if idleness > IDLE:
            break
    return idleness


def _idleness(seen: Seen, target: Promise) -> float:
    """Return what is dissipated each second of the kinetic energy along the reference; infinite without motion."""
    velocity = seen.at.velocity
    slip = velocity - reference_velocity(seen.law, seen.at.time, seen.at.position)
    if np.abs(slip).max() < _SLOW:
        return np.inf
    kinetic = 0.5 * float(slip @ seen.view.mass_matrix @ slip)
    if kinetic <= 1e-12 * float(velocity @ velocity):
        return np.inf
    return float(target.gradient @ target.R @ target.gradient) / kinetic


def _momentum_driven(seen: Seen, target: Promise) -> float:
    """Return the largest entry of the drive in rows that depend on q̇."""
    if not target.drive_port.size:
        return 0.0
    velocity, worst = seen.at.velocity, 0.0
    for axis in np.eye(len(velocity)):
        change = np.abs(seen.elsewhere(velocity=velocity + axis).coordinates() - target.coordinates)
        rows = change > 1e-9 * max(float(change.max()), 1e-300)
        worst = max(worst, float(np.abs(target.drive_port[rows]).max(initial=0.0)))
    return worst
