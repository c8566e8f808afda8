"""What others trust of a law: the output that goes with f_e, the passive port, the calmest state."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phcontrol._validation import Array
from phcontrol.analysis.promise import Promise
from phcontrol.analysis.state_sampler import SampledState, reference_velocity, some
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import measure_truly

_STATES = 4
_MOVING = 0.05  # [rad/s]


def port_error(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> tuple[float, str]:
    """Return how far the output that goes with f_e is from one that moves with q̇, or from none.

    Power enters through f_e at the arm's own velocity. So y = portᵀ∇H_d is q̇ plus what does not depend on it, or 0
    where the law cancels f_e: ∂y/∂q̇ is 1 or 0. Passive from f_e to anything else is no passivity in contact.
    """
    worst, where, n = 0.0, "", plant.n
    for at in _moving(law, states):
        measured = measure_truly(plant.at(at.position, at.velocity), at.force, law.needs, at.scene)

        def output(velocity: Array, at: SampledState = at, measured=measured) -> Array:  # type: ignore[no-untyped-def]
            view = law.system.at(at.position, velocity)
            target = Promise.of(law.target(at.time, view, at.state, measured), n)
            result: Array = target.port.T @ target.gradient
            return result

        # y is affine in q̇ where ports do not depend on it
        slope = np.stack([0.5 * (output(at.velocity + e) - output(at.velocity - e)) for e in np.eye(n)], axis=-1)
        error = float(min(np.abs(slope - np.eye(n)).max(), np.abs(slope).max()))
        if not error <= worst:
            worst, where = error, at.stratum
    return worst, where


def passive_port_error(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> tuple[float, str]:
    """Return how far ``passive_port`` is from what target and storage function say, relative to its own terms."""
    worst, where = 0.0, ""
    for at in _moving(law, states):
        acting, state = law.active(at.time), at.state
        if acting is not law:
            continue
        measured = measure_truly(plant.at(at.position, at.velocity), at.force, law.needs, at.scene)
        view = law.system.at(at.position, at.velocity)
        given = law.passive_port(at.time, view, state, measured)
        derived = Controller.passive_port(law, at.time, view, state, measured)
        for own, true in zip(given, derived, strict=True):
            expected = np.asarray(true, dtype=float)
            scale = max(float(np.abs(expected).max()), 1e-9 * float(np.abs(derived.resistance).max()), 1e-300)
            error = float(np.abs(np.asarray(own, dtype=float) - expected).max()) / scale
            if not error <= worst:
                worst, where = error, at.stratum
    return worst, where


def calming_gain(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> tuple[float, str]:
    """Return by how much moving to ``calmest_state`` raises H_d, relative to H_d; it must not."""
    worst, where = 0.0, ""
    for at in _moving(law, states):
        measured = measure_truly(plant.at(at.position, at.velocity), at.force, law.needs, at.scene)
        view = law.system.at(at.position, at.velocity)
        before = law.storage(at.time, view, at.state, measured)
        after = law.storage(at.time, view, law.calmest_state(at.time, view, at.state), measured)
        gain = (after - before) / max(abs(before), abs(after), 1e-300)
        if not gain <= worst:
            worst, where = gain, at.stratum
    return worst, where


def _moving(law: Controller, states: Sequence[SampledState]) -> list[SampledState]:
    """Return a few states in which the arm moves away from its reference."""
    moving = [
        at for at in states if np.abs(at.velocity - reference_velocity(law, at.time, at.position)).max() > _MOVING
    ]
    return list(some(moving, _STATES, law.system.n))
