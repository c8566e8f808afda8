"""Whether a promise speaks about everything that moves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phcontrol._differences import jacobian
from phcontrol._validation import Array
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.analysis.state_sampler import some
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.system import MechanicalSystem

_STATES = 6  # that are looked at
_STEP = 1e-3
_DEPENDENT = 1e-9  # smallest singular value of normalised columns, below which one depends on the others


def undetermined(law: Controller, plant: MechanicalSystem, states: Sequence[SampledState]) -> tuple[int, str]:
    """Return how many of (q̇, controller state) the target's coordinates leave undetermined at a position, and where.

    It is the rank that ∂x/∂(q̇, state) lacks. A promise that leaves a velocity or a state of the law out says nothing
    about what it does.
    """
    worst, where = 0, ""
    for at in some(states, _STATES, plant.n):
        seen = Seen.of(law, plant, at)

        def coordinates(y: Array, seen: Seen = seen) -> Array:
            return seen.elsewhere(velocity=y[: plant.n], state=y[plant.n :]).coordinates()

        start = np.concatenate([at.velocity, at.state])
        slope, _ = jacobian(coordinates, start, np.ones(len(start)), _STEP)
        lengths = np.linalg.norm(slope, axis=0) if slope.size else np.zeros(len(start))
        held = np.zeros(len(start), dtype=bool)
        if law.active(at.time) is not law:  # a state that belongs to a law which does not act stays as it is
            held[plant.n :] = (lengths[plant.n :] == 0.0) & (seen.command().state_rate == 0.0)
        rank = int(held.sum())
        if slope.size and lengths.max() > 0.0:
            values = np.linalg.svd(slope / np.where(lengths > 0.0, lengths, 1.0), compute_uv=False)
            rank += int((values > _DEPENDENT).sum())
        if len(start) - rank > worst:
            worst, where = len(start) - rank, at.stratum
    return worst, where
