"""Holds a law's promise against the true motion of a plant."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from phcontrol._validation import count
from phcontrol.analysis.certificate import (
    CURVATURE_TOLERANCE,
    GRADIENT,
    GROWTH,
    INDEFINITENESS,
    MATCHING,
    MATCHING_TOLERANCE,
    PURITY_TOLERANCE,
    SKEWNESS,
    STRUCTURE_TOLERANCE,
    Certificate,
    Check,
)
from phcontrol.analysis.matching import Worst, described, examine, worst_power, worst_residual
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.promised import undetermined
from phcontrol.analysis.purity import largest_hidden_need, largest_impurity, signal_depends_on_state
from phcontrol.analysis.rest_point import ENVIRONMENT_FREQUENCY, MARGINAL, STABLE, UNSTABLE, RestPoint, find_rest
from phcontrol.analysis.state_sampler import SampledState, StateSampler
from phcontrol.controllers.controller import Controller, check_loop
from phcontrol.exceptions import PHControlError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.simulation.log import Log

SAMPLES = 256
"""How many states a certificate looks at by default."""


def certify(
    controller: Controller,
    system: MechanicalSystem | None = None,
    *,
    samples: int = SAMPLES,
    seed: int = 0,
    log: Log | None = None,
) -> Certificate:
    """Check a controller's promise against a plant's true motion, at states drawn where laws go wrong.

    At each state the plant's vector field is computed by forward dynamics under the law's torque, the rate of the
    target's coordinates is taken along it by finite differences, and compared with
    (J_d − R_d)∇H_d + port·f_e + drive, row by row in natural units. Nothing that the law computed is reused.
    :class:`~phcontrol.analysis.state_sampler.StateSampler` says how the states are drawn.

    Beside matching it demands that J_d is skew and R_d ⪰ 0, that H_d grows by no more than what is supplied, that the
    promised coordinates determine the velocities and every state of the law, that H_d has a strict minimum where the
    law rests (or that the law says what it has instead), that the linearised closed loop is asymptotically stable
    there, that the law gives the same command whenever it is asked, and that it needs no more than it says.

    A certificate samples; it is no proof. It says how large a part of what was sampled may still be wrong.

    Args:
        controller: the law; its own ``system`` is the model it computes with.
        system: the plant, by default the controller's own model. With another plant the certificate
            says what the law promises there, and fails by how much the model is wrong.
        samples: number of states.
        seed: of the sequence they are drawn from.
        log: a run under the law; then what its claim rests on (``Controller.conditions``) is checked at each
            sample of it too, not only at the goal.

    Example:
        >>> from phcontrol import MechanicalSystem, certify, load_robot, make_controller
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> certify(make_controller("energy_shaping", system)).verdict
        'PASSED'
    """
    check_loop(controller, controller.system if system is None and isinstance(controller, Controller) else system)
    count("samples", samples)
    plant = controller.system if system is None else system
    return _Examination(controller, plant, samples, seed).certificate(log)


def require_certificate(controller: Controller, system: MechanicalSystem, purpose: str, *, rest: bool = True) -> None:
    """Raise PHControlError unless a law is what it promises on a plant: for results that rest on the promise.

    Without ``rest`` it need not come to rest at its own goal, only be the port-Hamiltonian system that it says.
    """
    certificate = certify(controller, system)
    kept = certificate.matching_passed and certificate.structure_passed and certificate.storage_passed
    if not (certificate.passed if rest else kept):
        raise PHControlError(
            f"{purpose} rests on the promise of {controller.name}, which has no certificate here:\n{certificate}"
        )


class _Examination:
    """One law on one plant, looked at from all sides; stops at the first thing that the law cannot answer."""

    def __init__(self, law: Controller, plant: MechanicalSystem, samples: int, seed: int) -> None:
        self._law, self._plant, self._samples, self._seed = law, plant, samples, seed
        self._checks: list[Check] = []
        self._at: SampledState | None = None

    def certificate(self, log: Log | None) -> Certificate:
        law, error = self._law, ""
        rests: list[RestPoint] = []
        conditions: dict[str, float] = {}
        try:
            for time in law.phases:
                acting = law.active(time)
                units = NaturalUnits.of(acting, self._plant, time)
                rests.append(find_rest(acting, self._plant, units, time))
            states = self._draw(rests[0])
            self._checks += self._matching(states)
            self._checks += self._contract(states)
            self._checks += self._rest(rests)
            conditions = _conditions(law, log)
        except Exception as problem:
            place = f" at {described(self._at)}" if self._at else ""
            error = f"{type(problem).__name__}: {problem}{place}"
        slow = max((rest.slowest for rest in rests), default=math.inf)
        return Certificate(
            controller=law.name,
            robot=self._plant.robot.name,
            interconnection=law.interconnection,
            samples=self._samples,
            seed=self._seed,
            region=self._region(),
            checks=tuple(self._checks),
            stability=_stability(rests),
            slowest=slow,
            driven_by=law.driven_by,
            caveat=law.caveat,
            error=error,
            conditions=conditions,
        )

    def _draw(self, rest: RestPoint) -> list[SampledState]:
        law, plant = self._law, self._plant
        state = rest.state if law.active(0.0) is law else law.initial_state(plant.at(rest.position))
        units = NaturalUnits.of(law, plant, 0.0)
        sampler = StateSampler(law, plant, units, (rest.position, rest.velocity, state), rest.force)
        return sampler.draw(self._samples, self._seed)

    def _matching(self, states: list[SampledState]) -> Iterator[Check]:
        figures = []
        for state in states:
            self._at = state
            figures.append(examine(self._law, self._plant, state))
        self._at = None
        matching = worst_residual(states, figures)
        gradient = worst_power(states, figures, [each.slope_error for each in figures])
        growth = worst_power(states, figures, [each.growth for each in figures], -math.inf)
        yield Check.at_most(MATCHING, matching.value, MATCHING_TOLERANCE, matching.where)
        yield Check.at_most(GRADIENT, gradient.value, MATCHING_TOLERANCE, gradient.where)
        for name, values in (
            (SKEWNESS, [each.skewness for each in figures]),
            (INDEFINITENESS, [each.indefiniteness for each in figures]),
        ):
            worst = _largest(states, values)
            yield Check.at_most(name, worst.value, STRUCTURE_TOLERANCE, worst.where)
        yield Check.at_most(GROWTH, growth.value, MATCHING_TOLERANCE, growth.where)
        if not self._law.driven_by:
            undeclared = _largest(states, [each.drive for each in figures])
            if undeclared.value > 0.0:
                yield Check.at_most("drive that is not declared", undeclared.value, 0.0, undeclared.where)
        else:
            moved = _largest(states, [each.moves_momentum for each in figures])
            yield Check.at_most("drive in rows of a momentum", moved.value, 0.0, moved.where)

    def _contract(self, states: list[SampledState]) -> Iterator[Check]:
        law, plant = self._law, self._plant
        missing, where = undetermined(law, plant, states)
        yield Check.at_most("velocities and states not promised", missing, 0.0, where)
        impurity, where = largest_impurity(law, plant, states)
        yield Check.at_most("command that is not repeated", impurity, PURITY_TOLERANCE, where)
        hidden, where = largest_hidden_need(law, plant, states)
        yield Check.at_most("change by what is not needed", hidden, PURITY_TOLERANCE, where)
        if law.driven_by:
            dependent = float(signal_depends_on_state(law, plant, states))
            yield Check.at_most("drive that depends on the state", dependent, 0.0)

    def _rest(self, rests: list[RestPoint]) -> Iterator[Check]:
        for rest in rests:
            law = self._law.active(rest.time)
            phase = f" from {rest.time:g} s" if rest.time else ""
            place = f"q = {np.array2string(rest.position, precision=3)}"
            yield Check.at_most(f"no rest near the goal{phase}", 0.0 if rest.found else 1.0, 0.0, place)
            yield Check.at_most(f"motion where it should rest{phase}", rest.unrest, MATCHING_TOLERANCE, place)
            if not law.lacks_minimum:
                name = f"smallest curvature of H_d at rest{phase}"
                yield Check.more_than(name, rest.curvature, CURVATURE_TOLERANCE, place)
            fastest = float((rest.eigenvalues.real + (0 if law.lacks_minimum else 1) * rest.uncertainty).max())
            if rest.stability == UNSTABLE or not law.lacks_minimum:
                name = f"largest real part at rest{phase} [1/s]"
                good = rest.stability == STABLE or (rest.stability == MARGINAL and bool(law.lacks_minimum))
                yield Check(name, fastest, 0.0, good, place)

    def _region(self) -> str:
        robot, law = self._plant.robot, self._law
        limits = "joint limits" if np.isfinite(robot.lower).all() else "joint limits (or a turn)"
        times = f"t over {law.time_span:.3g} s and" if law.time_span else "t"
        return (
            f"{self._samples} states, seed {self._seed}: q at the goal, at and within and 10 % beyond {limits}; speeds "
            f"from rest to twice the velocity limits and beyond; f_e from 0 to twice the motors' limits; controller "
            f"states from 0 to {30} natural units; {times} up to 1e5 s"
        )


def _largest(states: list[SampledState], values: list[float]) -> Worst:
    worst = Worst(0.0, "")
    for state, value in zip(states, values, strict=True):
        if not value <= worst.value:
            worst = Worst(value if value == value else math.inf, described(state))
    return worst


def _stability(rests: list[RestPoint]) -> str:
    """Return the worst that was found, and in what environment."""
    found = {rest.stability for rest in rests}
    worst = next((name for name in (UNSTABLE, MARGINAL, STABLE) if name in found), "unknown")
    touched = f", on a spring that gives each joint {ENVIRONMENT_FREQUENCY:g} rad/s"
    return worst + (touched if any(rest.in_contact for rest in rests) else "")


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
