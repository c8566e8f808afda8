"""Random instants at which a law is traced, and at which what was compiled of it is checked."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from phcontrol._validation import Array
from phcontrol.compilation.trace import Instant
from phcontrol.controllers.command import Command
from phcontrol.controllers.controller import Controller
from phcontrol.exceptions import PHControlError
from phcontrol.sensors.measured import Measured

_TRIES = 8  # for each instant: laws may refuse a state, as when they see no object


def instants(law: Controller, count: int, seed: int) -> Iterator[tuple[Instant, Command]]:
    """Draw instants and what the interpreted law orders there: slow and fast, in contact and free, early and late."""
    generator = np.random.default_rng(seed)
    found = 0
    for kind in range(_TRIES * count):
        instant = _drawn(law, generator, kind)
        try:
            x = law.system.at(instant.position, instant.velocity)
            command = law.evaluate(instant.time, x, instant.state, instant.measured)
        except PHControlError:
            continue
        yield instant, command
        found += 1
        if found == count:
            return


def _drawn(law: Controller, generator: np.random.Generator, kind: int) -> Instant:
    system, span = law.system, law.time_span
    x = system.at(
        system.robot.random_position(generator), generator.normal(size=system.n) * (0.02 if kind % 4 == 3 else 1.0)
    )
    force: Array = np.zeros(system.n) if kind % 3 == 2 else 5.0 * generator.normal(size=system.n)
    ends = (0.0, -0.1 * span, 1.1 * span, *law.phases)
    time = float(ends[kind // 5 % len(ends)] if kind % 5 == 0 else generator.uniform(0.0, span))
    features = None
    if law.eyes is not None and "features" in law.needs:
        scene = law.eyes.random_scene(x, generator, 0.5 if kind % 2 else 1.0)
        features = scene.features(x, scene.initial_state())
    measured = Measured(force, x.total_force(force), features)
    needed = measured._replace(**{name: None for name in Measured._fields if name not in law.needs})
    return Instant(time, x.position, x.velocity, law.random_state(generator), needed)
