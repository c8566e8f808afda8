"""Numerical proof that a controller's closed loop is the port-Hamiltonian system it claims."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from phcontrol._differences import central_difference
from phcontrol._validation import Array, count
from phcontrol.controllers.controller import Controller, check_loop
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import Measured, measure_truly
from phcontrol.simulation.log import Log
from phcontrol.vision.scene import Scene

MATCHING_TOLERANCE = 1e-6
"""On the matching and gradient residuals: finite differences of fourth order leave about 1e-10."""
STRUCTURE_TOLERANCE = 1e-9
"""On skewness and semidefiniteness, relative to the size of the matrix: rounding leaves about 1e-15."""

_STEP = 2e-4  # of the finite differences [s]; made shorter where the arm moves fast


@dataclass(frozen=True)
class Certificate:
    """What was found at random states. ``passed`` when every figure is inside its tolerance.

    All residuals are relative: divided by the largest entry at the same state, at least by 1.
    """

    controller: str
    robot: str
    interconnection: str
    samples: int
    seed: int
    matching_residual: float
    """Largest |ẋ − ((J_d − R_d)∇H_d + port f_e)|, ẋ by finite differences along the true vector field."""
    gradient_residual: float
    """Largest |Ḣ_d − ∇H_dᵀẋ|, both by finite differences: is ∇H_d the gradient of the storage function?"""
    skewness: float
    """Largest |J_d + J_dᵀ|."""
    smallest_dissipation: float
    """Smallest eigenvalue of R_d, divided by its largest."""
    largest_storage_rate: float
    """Largest Ḣ_d with no external force, divided by the power that flows, should be ≤ 0."""
    caveat: str = ""
    """What the law itself does not claim; then a growing storage function is no failure, but is shown."""
    conditions: dict[str, float] = field(default_factory=dict)
    """What the law's claim rests on beside, at its goal and along a run if one was given: each must be positive."""

    @property
    def matching_passed(self) -> bool:
        """Whether the closed loop is the promised one."""
        return max(self.matching_residual, self.gradient_residual) <= MATCHING_TOLERANCE

    @property
    def structure_passed(self) -> bool:
        """Whether the promised system is port-Hamiltonian: J_d skew, R_d ⪰ 0."""
        return self.skewness <= STRUCTURE_TOLERANCE and self.smallest_dissipation >= -STRUCTURE_TOLERANCE

    @property
    def storage_passed(self) -> bool:
        """Whether the storage function never grew without an external force."""
        return self.largest_storage_rate <= MATCHING_TOLERANCE

    @property
    def conditions_passed(self) -> bool:
        """Whether what the law's claim rests on holds."""
        return all(value > 0.0 for value in self.conditions.values())

    @property
    def passed(self) -> bool:
        """Whether everything passed."""
        stores = self.storage_passed or bool(self.caveat)
        return self.matching_passed and self.structure_passed and stores and self.conditions_passed

    def to_dict(self) -> dict[str, Any]:
        """Return figures, tolerances and verdict, for JSON. What is not finite becomes None."""
        figures = {key: _finite_or_none(value) for key, value in asdict(self).items()}
        figures["conditions"] = {name: _finite_or_none(value) for name, value in self.conditions.items()}
        tolerances = {"matching_tolerance": MATCHING_TOLERANCE, "structure_tolerance": STRUCTURE_TOLERANCE}
        return figures | tolerances | {"passed": self.passed}

    def __str__(self) -> str:
        def row(label: str, value: float, relation: str, bound: float, good: bool) -> str:
            return f"  {label:<34}{value:>11.2e}  {relation} {bound:<8.0e} {'ok' if good else 'FAILED'}"

        return "\n".join(
            [
                f"certificate of {self.controller} ({self.interconnection}) on {self.robot}: "
                f"{'PASSED' if self.passed else 'FAILED'} at {self.samples} states",
                row("matching residual", self.matching_residual, "<=", MATCHING_TOLERANCE,
                    self.matching_residual <= MATCHING_TOLERANCE),
                row("gradient residual", self.gradient_residual, "<=", MATCHING_TOLERANCE,
                    self.gradient_residual <= MATCHING_TOLERANCE),
                row("skewness of J_d", self.skewness, "<=", STRUCTURE_TOLERANCE,
                    self.skewness <= STRUCTURE_TOLERANCE),
                row("smallest eigenvalue of R_d", self.smallest_dissipation, ">=", -STRUCTURE_TOLERANCE,
                    self.smallest_dissipation >= -STRUCTURE_TOLERANCE),
                row("largest storage rate, f_e = 0", self.largest_storage_rate, "<=", MATCHING_TOLERANCE,
                    self.storage_passed),
                *(f"  {name}: {value:.3g}, must be > 0 {'ok' if value > 0.0 else 'FAILED'}"
                  for name, value in self.conditions.items()),
                *([f"  not claimed: {self.caveat}"] if self.caveat else []),
            ]
        )  # fmt: skip


def certify(
    controller: Controller,
    system: MechanicalSystem | None = None,
    *,
    samples: int = 50,
    seed: int = 0,
    log: Log | None = None,
) -> Certificate:
    """Check a controller's promise at random states of a plant.

    At each state (q inside the joint limits; velocities [rad/s], controller states, time and external
    forces drawn at random) the plant's true vector field is computed by forward dynamics under the law's
    torque, the rate of the target's coordinates is taken along it by finite differences, and compared
    with (J_d − R_d)∇H_d + port·f_e. Nothing that the law computed is reused.

    Args:
        controller: the law; its own ``system`` is the model it computes with.
        system: the plant, by default the controller's own model. With another plant the certificate
            says what the law promises there, and fails by how much the model is wrong.
        samples: number of states.
        seed: of the random numbers.
        log: a run under the law; then what its claim rests on (``Controller.conditions``) is checked at each
            sample of it too, not only at the goal.
    """
    check_loop(controller, controller.system if system is None and isinstance(controller, Controller) else system)
    count("samples", samples)
    plant = controller.system if system is None else system
    generator = np.random.default_rng(seed)
    worst = np.full(5, -np.inf)
    for _ in range(samples):
        worst = np.fmax(worst, _check_state(controller, plant, generator))
    return Certificate(
        controller=controller.name,
        robot=plant.robot.name,
        interconnection=controller.interconnection,
        samples=samples,
        seed=seed,
        matching_residual=float(worst[0]),
        gradient_residual=float(worst[1]),
        skewness=float(worst[2]),
        smallest_dissipation=float(-worst[3]),
        largest_storage_rate=float(worst[4]),
        caveat=controller.caveat,
        conditions=_conditions(controller, log),
    )


def _conditions(controller: Controller, log: Log | None) -> dict[str, float]:
    """Return the smallest value of each condition, at the goal and along a run."""
    conditions = {f"{name}, at the goal": value for name, value in controller.goal_conditions().items()}
    for k in range(0 if log is None else len(log)):
        assert log is not None
        x = controller.system.at(log.position[k], log.velocity[k])
        for name, value in controller.conditions(x, log.true_measurement(k)).items():
            label = f"{name}, along the run"
            conditions[label] = min(value, conditions.get(label, np.inf))
    return conditions


def _check_state(controller: Controller, plant: MechanicalSystem, generator: np.random.Generator) -> Array:
    """Return the five figures at one random state; semidefiniteness with its sign changed."""
    n = plant.n
    position, velocity = plant.robot.random_position(generator), generator.normal(size=n)
    state = controller.random_state(generator)
    time, force = float(generator.uniform(0.0, 10.0)), generator.normal(scale=5.0, size=n)
    scene = controller.random_scene(plant.at(position, velocity), generator)
    flow = _Flow(controller, plant, time, position, velocity, state, force, scene)
    target = controller.target(time, flow.model_state(0.0), state, flow.measured(0.0))
    matching, actual, step = _matching_residual(flow, target.rate(force))

    storage_rate = float(flow.derivative(flow.storage, step))
    products = target.gradient * actual
    power = max(1.0, float(np.abs(products).sum()))
    gradient = abs(storage_rate - float(products.sum())) / power

    size = max(1.0, float(np.abs(target.interconnection).max()))
    skewness = float(np.abs(target.interconnection + target.interconnection.T).max()) / size
    asymmetry = float(np.abs(target.dissipation - target.dissipation.T).max())
    values = np.linalg.eigvalsh(target.dissipation)
    indefiniteness = max(-float(values[0]), asymmetry) / max(1e-300, float(np.abs(values).max()))

    free = _Flow(controller, plant, time, position, velocity, state, np.zeros(n), scene)
    free_power = max(1.0, float(np.abs(target.gradient * free.derivative(free.coordinates)).sum()))
    growth = float(free.derivative(free.storage)) / free_power
    figures = np.array([matching, gradient, skewness, indefiniteness, growth])
    return np.where(np.isnan(figures), np.inf, figures)


def _matching_residual(flow: _Flow, promised: Array) -> tuple[float, Array, float]:
    """Return the residual, ẋ by finite differences, and their step: the longer or, where that errs, the shorter.

    Near singularities of a law ẋ bends within a step; a wrong law shows with every step.
    """
    best, rate, chosen = np.inf, promised, _STEP
    for step in (_STEP, _STEP / 8.0):
        actual = flow.derivative(flow.coordinates, step)
        residual = float(np.abs(actual - promised).max()) / max(1.0, float(np.abs(actual).max()))
        if residual < best or np.isnan(residual):
            best, rate, chosen = residual, actual, step
        if not best > 1e-3 * MATCHING_TOLERANCE:
            break
    return best, rate, chosen


class _Flow:
    """The plant's straight-line flow from one state, whose derivative at 0 is that of the closed loop."""

    def __init__(
        self,
        controller: Controller,
        plant: MechanicalSystem,
        time: float,
        position: Array,
        velocity: Array,
        state: Array,
        force: Array,
        scene: Scene | None,
    ) -> None:
        self.controller, self.plant, self.time, self.state = controller, plant, time, state
        self.position, self.velocity, self.scene = position, velocity, scene
        x = plant.at(position, velocity)
        self.at_start = measure_truly(x, force, Measured._fields, scene)
        command = controller.evaluate(time, controller.system.at(position, velocity), state, self.at_start)
        self.state_rate = command.state_rate
        self.acceleration = x.acceleration(command.torque, force)

    def measured(self, shift: float) -> Measured:
        """Return what sensors show ``shift`` seconds along the flow: the same forces, and where the object then is."""
        if self.scene is None:
            return self.at_start
        x = self.plant.at(self.position + shift * self.velocity)
        return self.at_start._replace(features=self.scene.features(x, self.scene.initial_state()))

    def model_state(self, shift: float) -> Any:
        """Return the controller's view of the plant ``shift`` seconds along the flow."""
        return self.controller.system.at(
            self.position + shift * self.velocity, self.velocity + shift * self.acceleration
        )

    def coordinates(self, shift: float) -> Array:
        state = self.state + shift * self.state_rate
        return self.controller.coordinates(self.time + shift, self.model_state(shift), state, self.measured(shift))

    def storage(self, shift: float) -> float:
        state = self.state + shift * self.state_rate
        return self.controller.storage(self.time + shift, self.model_state(shift), state, self.measured(shift))

    def derivative(self, function: Any, step: float = _STEP) -> Any:
        """Return the rate of a function along the flow by central differences of fourth order."""
        return central_difference(function, step / max(1.0, float(np.abs(self.velocity).max())))


def _finite_or_none(value: Any) -> Any:
    return None if isinstance(value, float) and not np.isfinite(value) else value
