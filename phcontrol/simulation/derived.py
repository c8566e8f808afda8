"""What follows from a run: each quantity by its name, and how one sample of it is computed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from phcontrol._lazy import lazy
from phcontrol._validation import Array
from phcontrol.controllers.aging import aging
from phcontrol.controllers.answers import stored
from phcontrol.controllers.target import Target
from phcontrol.environments.body import Touch
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import Measured
from phcontrol.simulation.vector_field import ClosedLoop

JOINTS = -1
"""In a shape: one for each joint."""


class Sample:
    """Sample k of a run, and what several quantities follow from, each computed on first use and once."""

    def __init__(self, data: Mapping[str, Array], k: int, plant: MechanicalSystem, loop: ClosedLoop | None) -> None:
        self._data, self._k, self._plant, self._loop = data, k, plant, loop

    @property
    def loop(self) -> ClosedLoop:
        """The closed loop; only what follows from the arm alone does without it."""
        assert self._loop is not None
        return self._loop

    @lazy
    def time(self) -> float:
        """T [s]."""
        return float(self._data["time"][self._k])

    @lazy
    def x(self) -> MechanicalState:
        """The plant's state."""
        position, velocity = self._data["position"][self._k], self._data["velocity"][self._k]
        return self._plant.state_type(self._plant, position, velocity)

    @lazy
    def torque(self) -> Array:
        """U [N·m]."""
        return self._data["torque"][self._k]  # type: ignore[no-any-return]

    @lazy
    def external_force(self) -> Array:
        """f_e [N·m]."""
        return self._data["external_force"][self._k]  # type: ignore[no-any-return]

    @lazy
    def measured(self) -> Measured:
        """What perfect sensors of f_e and of the image features show."""
        return true_measurement(self._data, self._k)

    @lazy
    def arguments(self) -> tuple[float, MechanicalState, Array, Measured]:
        """What a law's storage function and target are evaluated at: t, x, the law's state, what is measured."""
        view = self.x.seen_by(self.loop.model)
        return self.time, view, self._data["controller_state"][self._k], self.measured

    @lazy
    def target(self) -> Target:
        """The promised closed loop."""
        return self.loop.controller.target(*self.arguments)

    @lazy
    def body_states(self) -> list[Array]:
        """Each body's own state."""
        return self.loop.parts_of_bodies(self._data["body_state"][self._k])

    @lazy
    def touches(self) -> list[Touch]:
        """What each body does to the arm."""
        return [body.touch(self.x, part) for body, part in zip(self.loop.bodies, self.body_states, strict=True)]


class Quantity(NamedTuple):
    """A quantity that follows from the samples."""

    part: str
    """Quantities of one part share what they are computed from, and are computed together."""
    shape: tuple[int | None, ...]
    """Of one sample: JOINTS for one each joint, None for any number."""
    compute: Callable[[Sample], Any]
    """None for a run that has no such thing."""


def _friction_power(sample: Sample) -> float:
    x = sample.x
    return 0.0 if x.system.friction is None else float(x.velocity.dot(x.friction_torque))


def _storage(sample: Sample) -> float:
    return stored(sample.loop.controller, *sample.arguments)


def _dissipated_power(sample: Sample) -> float:
    gradient = sample.target.gradient
    return float(gradient.dot(sample.target.dissipation.dot(gradient)))


def _supplied_power(sample: Sample) -> float:
    target = sample.target
    return float(target.gradient.dot(target.port.dot(sample.external_force) + target.driven()))


def _aging_power(sample: Sample) -> float | None:
    law = sample.loop.controller
    if not law.time_span:
        return None
    time, x, state, measured = sample.arguments
    return aging(law, time, x, state, measured, sample.target.gradient)


def _contact_work(sample: Sample) -> float:
    return sum((float(touch.force.dot(sample.x.velocity)) for touch in sample.touches), 0.0)


def _contact_depths(sample: Sample) -> list[float]:
    return [body.displacement(part) for body, part in zip(sample.loop.bodies, sample.body_states, strict=True)]


def _tank_level(sample: Sample) -> float | None:
    return sample.loop.controller.tank_level(sample.arguments[2])


def _wrench_forces(sample: Sample) -> list[Array] | None:
    return [wrench.world_force(sample.time, sample.x) for wrench in sample.loop.wrenches] or None


DERIVED: dict[str, Quantity] = {
    "kinetic_energy": Quantity("arm", (), lambda sample: sample.x.kinetic_energy),
    "potential_energy": Quantity("arm", (), lambda sample: sample.x.potential_energy),
    "friction_power": Quantity("arm", (), _friction_power),
    "control_power": Quantity("arm", (), lambda sample: sample.x.output.dot(sample.torque)),
    "external_power": Quantity("arm", (), lambda sample: sample.x.velocity.dot(sample.external_force)),
    "storage": Quantity("storage", (), _storage),
    "dissipated_power": Quantity("promise", (), _dissipated_power),
    "supplied_power": Quantity("promise", (), _supplied_power),
    "aging_power": Quantity("aging", (), _aging_power),
    "force_output": Quantity("promise", (JOINTS,), lambda sample: sample.target.gradient.dot(sample.target.port)),
    "contact_force": Quantity("contact", (), lambda sample: sum((touch.magnitude for touch in sample.touches), 0.0)),
    "contact_energy": Quantity("contact", (), lambda sample: sum((touch.stored for touch in sample.touches), 0.0)),
    "contact_power": Quantity("contact", (), lambda sample: sum((touch.dissipated for touch in sample.touches), 0.0)),
    "contact_work": Quantity("contact", (), _contact_work),
    "contact_forces": Quantity("contact", (None,), lambda sample: [touch.magnitude for touch in sample.touches]),
    "contact_depths": Quantity("contact", (None,), _contact_depths),
    "goal": Quantity("goal", (JOINTS,), lambda sample: sample.loop.controller.target_posture(sample.time)),
    "tank_level": Quantity("tank", (), _tank_level),
    "wrench_forces": Quantity("wrenches", (None, 3), _wrench_forces),
}
"""Every quantity by its name: the properties of a log, its file and the browser's view take them from here."""
OPTIONAL = ("aging_power", "goal", "tank_level", "wrench_forces")
"""Those that a run need not have."""
PARTS = frozenset(quantity.part for quantity in DERIVED.values())


def names_of(*parts: str) -> list[str]:
    """Return the quantities of some parts; of all without an argument."""
    return [name for name, quantity in DERIVED.items() if not parts or quantity.part in parts]


def derive(samples: Iterable[Sample], names: Sequence[str]) -> dict[str, Array]:
    """Return quantities over samples, each sample looked at once; those that a run does not have are left out."""
    rules = [DERIVED[name].compute for name in names]
    rows = [[rule(sample) for rule in rules] for sample in samples]
    columns = zip(names, zip(*rows, strict=True), strict=True)
    return {name: np.array(column) for name, column in columns if not any(value is None for value in column)}


def true_measurement(data: Mapping[str, Array], k: int) -> Measured:
    """Return what perfect sensors of f_e and of the image features would have shown at sample k."""
    return Measured(data["external_force"][k], features=data["features"][k] if "features" in data else None)
