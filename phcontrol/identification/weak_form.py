"""The equations of motion, averaged over windows: linear in the parameters, without accelerations.

With p = M q̇ the plant is ṗ = u + Cᵀq̇ − ∂V/∂q − D q̇. Times a smooth w(t) that is zero at both ends of a window, and
integrated by parts,

    ∫ w u dt = ∫ [−ẇ p + w (−Cᵀq̇ + ∂V/∂q + D q̇)] dt,

in which p, Cᵀq̇ and ∂V/∂q are linear in the bodies' parameters, and every integral is a sum over samples. It filters
both sides alike, and no velocity is differentiated. (Modulating functions: M. Shinbrot, 1957.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phcontrol._validation import Array
from phcontrol.identification.motion import Motion
from phcontrol.identification.parameters import Parameters, body_regressor, smooth_sign
from phcontrol.mechanics.system import MechanicalSystem

_STEP = 1e-4  # of the arm's motion, over which Yp is differentiated along q̇ [rad]
_TURNING = 0.05  # part of a joint's largest speed, below which it is about to turn round
_ORDER = 4  # of the window (1 − s²)^order, s from −1 to 1


@dataclass(frozen=True)
class Equations:
    """A row for each joint and window: ``matrix @ parameters = known``."""

    matrix: Array
    """Shape (windows, n, parameters)."""
    known: Array
    """Torque less what the model says of all that is not a parameter, shape (windows, n) [N·m], averaged."""
    torque: Array
    """Torque, likewise averaged."""
    torque_rate: Array
    """Its derivative, likewise averaged, times the samples' distance: what it changes in a period."""
    steady: NDArray[np.bool_]
    """Whether a joint turns one way through a window, shape (windows, n): where it turns round or stands still, dry
    friction is not told by its velocity."""
    time: Array
    """Middles of the windows, shape (windows,) [s]."""


class _Window:
    """w = (1 − s²)⁴, scaled to mean 1: weights of samples, and of torques that are held from sample to sample."""

    def __init__(self, length: int, period: float, held: bool) -> None:
        s = np.linspace(-1.0, 1.0, length + 1)
        half, norm = 0.5 * length * period, 1.0 / _antiderivative(np.array([1.0]))[0]
        self.samples = norm * (1.0 - s**2) ** _ORDER / (length / 2.0)
        self.rates = norm * -2.0 * _ORDER * s * (1.0 - s**2) ** (_ORDER - 1) / half / (length / 2.0)
        self.torques = self.samples
        if held:
            self.torques = np.append(norm * np.diff(_antiderivative(s)), 0.0)


def _antiderivative(s: Array) -> Array:
    """Return ∫ (1 − s²)⁴ from −1, an odd polynomial and a constant."""
    terms = np.polynomial.Polynomial([1.0, 0.0, -1.0]) ** _ORDER
    primitive = terms.integ()
    values: Array = primitive(s) - primitive(-1.0)
    return values


def equations_of(
    system: MechanicalSystem, parameters: Parameters, motion: Motion, window: float, smoothing: float
) -> Equations:
    """Return the averaged equations of a motion; ``window`` is how long each average is [s], half of it apart.

    Of the model what is asked for as friction or rotor is left out: those parameters are whole values. A payload is
    beside what the model has.
    """
    length = max(4, 2 * round(0.5 * window / motion.period))
    starts = range(0, len(motion.time) - length, length // 2)
    weights = _Window(length, motion.period, motion.held)
    momentum, force = _terms(system, parameters, motion, smoothing)
    slow = np.abs(motion.velocity) < _TURNING * np.abs(motion.velocity).max(axis=0)
    rows, torques, rates, steady, times = [], [], [], [], []
    for first in starts:
        part = slice(first, first + length + 1)
        rows.append(
            np.tensordot(weights.samples, force[part], axes=1) - np.tensordot(weights.rates, momentum[part], axes=1)
        )
        torques.append(weights.torques @ motion.torque[part])
        rates.append(-motion.period * (weights.rates @ motion.torque[part]))
        steady.append(~slow[part].any(axis=0))
        times.append(motion.time[first] + 0.5 * length * motion.period)
    if not rows:
        empty = np.zeros((0, system.n))
        nothing = np.zeros((0, system.n), dtype=bool)
        return Equations(np.zeros((0, system.n, len(parameters.names))), empty, empty, empty, nothing, np.zeros(0))
    whole, torque = np.array(rows), np.array(torques)
    return Equations(
        whole[..., :-1], torque - whole[..., -1], torque, np.array(rates), np.array(steady), np.array(times)
    )


def _terms(system: MechanicalSystem, parameters: Parameters, motion: Motion, smoothing: float) -> tuple[Array, Array]:
    """Return momenta, and −Cᵀq̇ + ∂V/∂q + D q̇, of each parameter and in the last column of the model."""
    n, samples = system.n, len(motion.time)
    bodies, nominal = body_regressor(system), _nominal(system)
    model, weightless = system.model, system.weightless_model
    first = 10 * (parameters.joint - 1)
    width = len(parameters.names) + 1
    momentum, force = np.zeros((samples, n, width)), np.zeros((samples, n, width))
    armature = _armature(system)
    rest, groups = np.zeros(n), parameters.groups
    for k in range(samples):
        q, v = motion.position[k], motion.velocity[k]
        p = bodies(weightless, q, rest, v)
        h = _STEP / max(1.0, float(np.abs(v).max()))
        ahead, behind = (bodies(weightless, q + step * v, rest, v) for step in (h, -h))
        rate = (ahead - behind) / (2.0 * h)  # of M along q̇, times q̇: C q̇ + Cᵀq̇
        f = bodies(model, q, v, rest) - rate  # C q̇ + ∂V/∂q − Ṁ q̇ = −Cᵀq̇ + ∂V/∂q
        momentum[k, :, -1], force[k, :, -1] = p @ nominal, f @ nominal
        if parameters.joint:
            columns = parameters.columns("payload")
            momentum[k, :, columns], force[k, :, columns] = p[:, first : first + 10], f[:, first : first + 10]
        for potential in system.potentials:
            force[k, :, -1] += potential.gradient(q)
        force[k, :, -1] += _known_friction(system, groups, q, v, smoothing)
    diagonal = np.arange(n)
    if "armature" in groups:
        momentum[:, diagonal, diagonal + parameters.columns("armature").start] = motion.velocity
    else:
        momentum[:, :, -1] += armature * motion.velocity
    values: dict[str, Array | float] = {
        "coulomb": smooth_sign(motion.velocity, smoothing),
        "viscous": motion.velocity,
        "offset": 1.0,
    }
    for group, value in values.items():
        if group in groups:
            force[:, diagonal, diagonal + parameters.columns(group).start] = value
    return momentum, force


def _nominal(system: MechanicalSystem) -> Array:
    """Return the parameters of all bodies of the model, ten each."""
    inertias = [system.model.inertias[i] for i in range(1, system.model.njoints)]
    return np.concatenate([np.asarray(inertia.toDynamicParameters()) for inertia in inertias])


def _armature(system: MechanicalSystem) -> Array:
    """Return the rotors of the model in the independent joints, shape (n,)."""
    rotors = np.asarray(system.model.armature)
    if system.coupling is None:
        return np.array(rotors)
    values: Array = np.diag(system.coupling.matrix.T @ np.diag(rotors) @ system.coupling.matrix).copy()
    return values


def _known_friction(
    system: MechanicalSystem, groups: tuple[str, ...], q: Array, v: Array, smoothing: float
) -> Array | float:
    """Return D q̇ of the model, without the parts that are parameters."""
    if system.friction is None or ("viscous" in groups and "coulomb" in groups):
        return 0.0
    torque = system.at(q, v).friction_torque
    for group, value in (("viscous", v), ("coulomb", smooth_sign(v, smoothing))):
        if group in groups:
            torque = torque - np.asarray(getattr(system.friction, group)) * value
    return torque
