"""Holds a law's promise against the true motion of a plant."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from phcontrol._validation import count
from phcontrol.analysis.certificate import (
    CURVATURE_TOLERANCE,
    GRADIENT,
    GROWTH,
    IDLE,
    INDEFINITENESS,
    MATCHING,
    MATCHING_TOLERANCE,
    PURITY_TOLERANCE,
    RUN_TOLERANCE,
    SKEWNESS,
    STRUCTURE_TOLERANCE,
    Certificate,
    Check,
)
from phcontrol.analysis.continuity import depth_around, jump_at_half_turns, jump_at_switches
from phcontrol.analysis.empty_scene import EmptyScene
from phcontrol.analysis.invariance import change_of_drive, change_with_force, change_with_time
from phcontrol.analysis.lines import largest_jump, largest_kink, lines_of, odd_states
from phcontrol.analysis.matching import StateFigures, described, examine, worst_power, worst_residual
from phcontrol.analysis.memory import (
    difference_after_marching,
    difference_after_methods,
    difference_in_walks,
    untouched,
)
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.other_rests import OtherRest, other_rests
from phcontrol.analysis.ports import (
    calming_gain,
    claimed_damping,
    jumping_gain,
    limited_gain,
    passive_port_error,
    port_error,
    starting_gain,
)
from phcontrol.analysis.promised import undetermined
from phcontrol.analysis.purity import largest_hidden_need, largest_impurity
from phcontrol.analysis.pushed_loop import fastest_when_pushed
from phcontrol.analysis.rest_point import (
    ENVIRONMENT_FREQUENCIES,
    MARGINAL,
    STABLE,
    TOUCH_FREQUENCIES,
    UNSTABLE,
    RestPoint,
    find_rest,
)
from phcontrol.analysis.runs import balance_error, run_states
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.analysis.state_sampler import LARGEST_STATE, StateSampler, beside_switches
from phcontrol.analysis.thin_states import SLIDING
from phcontrol.analysis.well_formed import check_well_formed
from phcontrol.analysis.worst import Worst
from phcontrol.controllers.controller import Controller, check_loop
from phcontrol.controllers.law_error import place_of
from phcontrol.exceptions import PHControlError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.simulation.log import Log
from phcontrol.simulation.simulation_error import SimulationError

SAMPLES = 256
"""How many states a certificate looks at by default."""
_LATE = 20.0  # spans of a law that changes with time: what it tends to must be at rest too
FEW = 16
"""Below so many no runs are made: such a certificate is for a quick look."""


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
    The states are drawn by strata (``StateSampler``): at and near the goal, about home, at the joint limits and beyond
    them, at rest to twice the velocity limits, with forces and controller states from zero to large; and along runs.

    Beside matching it demands that J_d is skew and R_d ⪰ 0, that H_d grows by no more than what is supplied and does
    not jump between states, that the promise does not depend on the force it is a promise under, that its coordinates
    determine the velocities and every state of the law, that H_d has a strict minimum where the law rests (or that the
    law says what it has instead), that the linearised closed loop is asymptotically stable there, that the law gives
    the same command whenever it is asked, also along a motion, and that it needs no more than it says. With fewer than
    16 samples no runs are made.

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
        # what a law does to the plant it was made with must not happen to the one that judges it
        self._law, self._plant, self._samples, self._seed = law, plant.twin(), samples, seed
        self._fresh = untouched(law)
        self._checks: list[Check] = []
        self._at: SampledState | None = None
        self._switching: float | None = None
        self._turning: float | None = None
        self._brought: float | None = None
        self._others: list[OtherRest] = []

    def certificate(self, log: Log | None) -> Certificate:
        law, error = self._law, ""
        rests: list[RestPoint] = []
        conditions: dict[str, float] = {}
        try:
            check_well_formed(law, self._plant)
            for time in _times(law) if self._samples >= FEW else law.phases:
                acting = law.active(time)
                units = NaturalUnits.of(acting, self._plant, time)
                rests += [find_rest(acting, self._plant, units, *where) for where in _places(acting, self._plant, time)]
            states = self._draw(rests[0])
            for checks in (
                self._matching(states, rests), self._contract(states), self._rest(rests), self._pushed(rests)
            ):  # fmt: skip
                for check in checks:  # one by one: those before an error are kept
                    self._checks.append(check)
            conditions = _conditions(law, log)
        except Exception as problem:
            where = f" at {described(self._at)}" if self._at else ""
            line = place_of(problem, type(law))
            error = f"{type(problem).__name__}: {problem}{f' ({line})' if line else ''}{where}"
        return Certificate(
            controller=law.name,
            robot=self._plant.robot.label,
            interconnection=law.interconnection,
            samples=self._samples,
            seed=self._seed,
            region=self._region(),
            checks=tuple(self._checks),
            stability=_stability(rests),
            slowest=max((rest.slowest for rest in rests if not rest.touched), default=math.inf),
            driven_by=law.driven_by,
            caveat=law.caveat,
            drive_power=self._brought,
            other_rests=tuple((each.position.tolist(), each.height) for each in self._others),
            jump_at_switches=self._switching,
            jump_at_half_turns=self._turning,
            error=error,
            conditions=conditions,
        )

    def _draw(self, rest: RestPoint) -> list[SampledState]:
        law, plant = self._law, self._plant
        self._units = NaturalUnits.of(law, plant, 0.0)
        state = rest.state if law.active(0.0) is law else law.initial_state(plant.at(rest.position))
        sampler = StateSampler(law, plant, self._units, (rest.position, rest.velocity, state), rest.force)
        self._rest_point = replace(rest, state=state)  # of a sequence all states, not those of the law that acts then
        states = sampler.draw(self._samples, self._seed)
        self._drawn = len(states)
        return states

    def _matching(self, states: list[SampledState], rests: list[RestPoint]) -> Iterator[Check]:
        law, plant, rest = self._law, self._plant, rests[0]
        followed: list[SampledState] = []
        logs: list[Log] = []
        broken = None
        try:
            if self._samples >= FEW:
                followed, logs = run_states(law, plant, self._units, rest)
        except SimulationError as error:  # what the states say comes first
            broken = error
        lines = lines_of(law, plant, self._units, self._rest_point, states)
        figures = []
        odd = odd_states(lines) if law.eyes is None else []
        looked_at = [*states, *beside_switches(law, states), *followed, *odd]
        for state in looked_at:
            self._at = state
            figures.append(examine(law, plant, state))
        self._at = None
        matching = worst_residual(looked_at, figures)
        gradient = worst_power(looked_at, figures, [each.slope_error for each in figures])
        growth = worst_power(looked_at, figures, [each.growth for each in figures], -math.inf)
        yield Check.at_most(MATCHING, matching.value, MATCHING_TOLERANCE, matching.where)
        yield Check.at_most(GRADIENT, gradient.value, MATCHING_TOLERANCE, gradient.where)
        for name, values in (
            (SKEWNESS, [each.skewness for each in figures]),
            (INDEFINITENESS, [each.indefiniteness for each in figures]),
        ):
            worst = _largest(looked_at, values)
            yield Check.at_most(name, worst.value, STRUCTURE_TOLERANCE, worst.where)
        if broken is not None:
            raise broken
        yield Check.at_most(GROWTH, growth.value, MATCHING_TOLERANCE, growth.where)
        if law.time_span:
            aging = worst_power(looked_at, figures, [each.aging for each in figures], -math.inf)
            yield Check.at_most("growth of H_d with time alone", aging.value, MATCHING_TOLERANCE, aging.where)
        jump, where = largest_jump(lines)
        yield Check.at_most("jump of H_d between states", jump, 0.0, where)
        kink, where = largest_kink(lines if law.eyes is None else [])  # of one with eyes features stay on a line
        yield Check.at_most("kink of H_d between states", kink, 0.0, where)
        self._switching = jump_at_switches(law, plant, states)
        self._turning = jump_at_half_turns(law, plant, states)
        if logs and len(law.phases) == 1 and "features" not in law.needs:  # which near a loss are no smooth run
            yield Check.at_most(
                "balance of H_d along runs", max(balance_error(run, law, self._units) for run in logs), RUN_TOLERANCE
            )
        labels = _largest(looked_at, [each.mislabelled for each in figures])
        yield Check.at_most("target's coordinates are others", labels.value, PURITY_TOLERANCE, labels.where)
        if not law.lacks_minimum:
            # on p̂ = 0 nothing may be lost for an instant
            moving = [state.stratum != SLIDING for state in looked_at]
            losses = [each.idleness if here else math.inf for each, here in zip(figures, moving, strict=True)]
            idle = _largest(looked_at, [-each for each in losses], -math.inf)
            yield Check.more_than("least dissipation in motion [1/s]", -idle.value, IDLE, idle.where)
        blind = [isinstance(state.scene, EmptyScene) for state in looked_at]
        if any(blind):
            losses = [each.idleness if here else math.inf for each, here in zip(figures, blind, strict=True)]
            idle = _largest(looked_at, [-each for each in losses], -math.inf)
            yield Check.more_than("least dissipation with nothing to see [1/s]", -idle.value, IDLE, idle.where)
        energy = [each.stored for each in figures]
        usual = float(np.quantile(np.abs(energy), 0.75))
        if self._switching is not None and not law.caveat:
            jump = self._switching / max(usual, 1e-300)
            yield Check.at_most("jump of H_d at switches, untold", jump, MATCHING_TOLERANCE)
        if not rest.in_contact and not law.driven_by:
            yield from self._depth(looked_at, energy, usual, rests)
        started = starting_gain(law, plant, states, usual)
        yield Check.at_most("energy that it starts with", started.value, MATCHING_TOLERANCE, started.where)
        yield from self._drive(looked_at, figures)

    def _depth(
        self, states: list[SampledState], energy: list[float], usual: float, rests: list[RestPoint]
    ) -> Iterator[Check]:
        """Yield whether H_d is lower elsewhere than where the law rests: of all states, and about each rest point."""
        law, changes = self._law, bool(self._law.time_span)
        unit = max(usual, 1e-300)
        # energy[0] is that of the rest point, of a law that does not change
        deeper = Worst(0.0, "") if changes else _largest(states, [(energy[0] - each) / unit for each in energy])
        for rest in rests if changes else rests[:1]:
            acting = law.active(rest.time)
            if acting is law or changes:
                below = depth_around(acting, self._plant, self._units, rest) / unit
                deeper = (
                    deeper if deeper.value >= below else Worst(below, f"rest beside the goal, t = {rest.time:.4g} s")
                )
        yield Check.at_most("depth of H_d below its rest", deeper.value, MATCHING_TOLERANCE, deeper.where)
        if law.target_posture(0.0) is not None and not law.lacks_minimum and not changes and len(law.phases) == 1:
            self._others = other_rests(law, self._plant, self._units, rests[0], self._seed)
            as_deep = [each for each in self._others if each.height <= MATCHING_TOLERANCE * unit]
            place = "q = " + np.array2string(as_deep[0].position, precision=3, max_line_width=1000) if as_deep else ""
            if not law.other_rests:
                yield Check.at_most("other rests as deep as the goal", len(as_deep), 0.0, place)
        if not law.lacks_minimum and not changes:
            start = self._start_energy(states[0]) / unit
            yield Check.at_most("energy of the law's initial state", start, MATCHING_TOLERANCE)

    def _start_energy(self, rest: SampledState) -> float:
        """Return by how much H_d is higher at the law's rest with its initial state than with that of the rest [J]."""
        seen = Seen.of(self._law, self._plant, rest)
        return seen.elsewhere(state=self._law.initial_state(seen.view)).stored() - seen.stored()

    def _drive(self, states: list[SampledState], figures: list[StateFigures]) -> Iterator[Check]:
        if not (self._law.driven_by or any(each.has_drive for each in figures)):
            return
        moved = _largest(states, [each.moves_momentum for each in figures])
        yield Check.at_most("drive in rows of a momentum", moved.value, 0.0, moved.where)
        if not self._law.driven_by:  # one that brings nothing in is like J_d, and what it takes is lost as by R_d
            brought = worst_power(states, figures, [each.drive_power for each in figures])
            yield Check.at_most("drive that is not declared", brought.value, STRUCTURE_TOLERANCE, brought.where)
            return
        declared = sum(each.has_drive for each in figures)
        yield Check.more_than("states with the drive that is declared", declared, 0.0)
        dependent = change_of_drive(self._law, self._plant, states)
        yield Check.at_most("drive that depends on the state", dependent.value, PURITY_TOLERANCE, dependent.where)
        self._brought = max(0.0, *(each.drive_power for each in figures[: self._drawn]))

    def _contract(self, states: list[SampledState]) -> Iterator[Check]:
        law, plant = self._law, self._plant
        missing, where = undetermined(law, plant, states)
        yield Check.at_most("velocities and states not promised", missing, 0.0, where)
        impurity, where = largest_impurity(law, plant, states)
        yield Check.at_most("command that is not repeated", impurity, PURITY_TOLERANCE, where)
        if self._samples >= FEW:
            walked = difference_in_walks(law, self._fresh, plant, self._units, self._rest_point)
            marched = difference_after_marching(law, plant, self._units, self._rest_point)
            remembered, where = max(walked, marched, key=lambda each: each.value)
            yield Check.at_most("command that remembers the motion", remembered, PURITY_TOLERANCE, where)
        changed, where = difference_after_methods(law, self._fresh, plant, states)
        yield Check.at_most("command that other methods change", changed, PURITY_TOLERANCE, where)
        for name, figure in (
            ("change by what is not needed", largest_hidden_need),
            ("change with time that is not declared", change_with_time),
            ("change of the promise with f_e", change_with_force),
        ):
            value, where = figure(law, plant, states)
            yield Check.at_most(name, value, PURITY_TOLERANCE, where)
        for name, figure in (
            ("output of f_e that is no velocity", port_error),
            ("passive port that is another", passive_port_error),
            ("damping that is not dissipated", claimed_damping),
            ("rise of H_d to the calmest state", calming_gain),
            ("rise of H_d by a jump", jumping_gain),
            ("rise of H_d under limits", limited_gain),
        ):
            value, where = figure(law, plant, states)
            yield Check.at_most(name, value, MATCHING_TOLERANCE, where)

    def _rest(self, rests: list[RestPoint]) -> Iterator[Check]:
        """Yield the worst of all rest points for each line; a line that failed before one that did not."""
        worst: dict[str, Check] = {}
        for rest in rests:
            for check in self._at_rest(rest):
                before = worst.get(check.name)
                if before is None or (before.passed and not check.passed):
                    worst[check.name] = check
        yield from worst.values()

    def _pushed(self, rests: list[RestPoint]) -> Iterator[Check]:
        """Yield what a law that f_e drives does under large forces, with what it touches."""
        found = Worst(-math.inf, "")
        for rest in rests:
            law = self._law.active(rest.time)
            if rest.touched or not _felt(law):
                continue
            springs = ENVIRONMENT_FREQUENCIES if rest.in_contact else TOUCH_FREQUENCIES
            worst = fastest_when_pushed(law, self._plant, NaturalUnits.of(law, self._plant, rest.time), rest, springs)
            found = worst if worst.value > found.value else found
        if found.where:
            yield Check.at_most("largest real part when it is pushed [1/s]", found.value, 0.0, found.where)

    def _at_rest(self, rest: RestPoint) -> Iterator[Check]:
        law = self._law.active(rest.time)
        if rest.touched:
            fastest = float((rest.eigenvalues.real - rest.uncertainty).max())
            yield Check.at_most("largest real part when it is touched [1/s]", fastest, 0.0)
            return
        place = f"t = {rest.time:.4g} s, q = {np.array2string(rest.position, precision=3, max_line_width=1000)}"
        yield Check.at_most("no rest near the goal", 0.0 if rest.found else 1.0, 0.0, place)
        yield Check.at_most("motion where it should rest", rest.unrest, MATCHING_TOLERANCE, place)
        goal = law.rest_posture(rest.time) if rest.in_contact else law.target_posture(rest.time)
        if goal is not None:
            away = float(np.abs(self._plant.robot.difference(rest.position, goal)).max())
            yield Check.at_most("distance from its goal at rest", away, MATCHING_TOLERANCE, place)
        desired = law.desired_posture(rest.time, law.initial_state(self._plant.at(rest.position)))
        if goal is not None and desired is not None:
            apart = float(np.abs(self._plant.robot.difference(desired, goal)).max())
            yield Check.at_most("desired posture that is another", apart, MATCHING_TOLERANCE, place)
        if not law.lacks_minimum:
            yield Check.more_than("smallest curvature of H_d at rest", rest.curvature, CURVATURE_TOLERANCE, place)
            yield Check.at_most("rest in contact only", float(rest.in_contact), 0.0)
        if rest.stability == UNSTABLE or not law.lacks_minimum:
            fastest = float((rest.eigenvalues.real + (0 if law.lacks_minimum else 1) * rest.uncertainty).max())
            good = rest.stability == STABLE or (rest.stability == MARGINAL and bool(law.lacks_minimum))
            yield Check("largest real part at rest [1/s]", fastest, 0.0, good, place)

    def _region(self) -> str:
        robot, law = self._plant.robot, self._law
        limits = "joint limits" if np.isfinite(robot.lower).all() else "joint limits (or a turn)"
        seen = "; objects as the law's random_scene draws them" if "features" in law.needs else ""
        span: Any = law.time_span  # of a law that fails it may be anything
        lasting = isinstance(span, (int, float, np.floating)) and span
        times = f"t over {span:.3g} s and later" if lasting else "t up to 1e5 s"
        return (
            f"{self._samples} states, seed {self._seed}: q at the goal and home, at, within and 10 % beyond {limits}; "
            "speeds from rest to twice the velocity limits and beyond; f_e from 0 to twice the motors' limits; "
            f"controller states from 0 to {LARGEST_STATE:g} natural units; {times}{seen}; besides, with one "
            "coordinate or some neighbouring joints alone away from rest, with p̂ = 0, at rest under a load; close to "
            "rest, from 1e-6; where the command is least smooth on lines between states and into the rest; and along "
            "short runs"
        )


def _times(law: Controller) -> tuple[float, ...]:
    """Return when a law's rest is looked at: at the start of each phase; of a law that changes, also later."""
    if len(law.phases) > 1 or not law.time_span:
        return law.phases
    times = tuple(share * law.time_span for share in (0.0, 0.5, 1.0, _LATE))
    return tuple(time for time in times if not _led_by_posture(law, time)) or times[:1]


def _led_by_posture(law: Controller, time: float) -> bool:
    """Return whether the velocity that a law leads along with depends on the posture: then it does not rest."""
    posture = law.rest_posture(time)
    here, beside = (law.reference_velocity(time, law.system.at(q)) for q in (posture, posture + 1e-2))
    return bool(np.abs(here - beside).max() > 1e-9)


def _places(law: Controller, plant: MechanicalSystem, time: float) -> list[tuple[Any, ...]]:
    """Return the arguments of ``find_rest`` beside law, plant and units: with a stiff and a soft spring in contact.

    A law that f_e may drive is touched too: what drives it is then fed back by what it touches.
    """
    if law.rest_force(plant.at(law.rest_posture(time))) is not None:
        return [(time, frequency) for frequency in ENVIRONMENT_FREQUENCIES]
    touches = TOUCH_FREQUENCIES if _felt(law) else ()
    return [(time,), *((time, frequency, True) for frequency in touches)]


def _felt(law: Controller) -> bool:
    """Return whether f_e may drive a law."""
    return bool(law.driven_by) and not {"external_force", "total_force"}.isdisjoint(law.needs)


def _largest(states: list[SampledState], values: list[float], lowest: float = 0.0) -> Worst:
    return Worst.among(values, lambda k: described(states[k]), lowest)


def _stability(rests: list[RestPoint]) -> str:
    """Return the worst that was found, and in what environment."""
    found = {rest.stability for rest in rests if not rest.touched}
    worst = next((name for name in (UNSTABLE, MARGINAL, STABLE) if name in found), "unknown")
    stiff, soft = ENVIRONMENT_FREQUENCIES
    touched = f", on springs that give each joint {stiff:g} and {soft:g} rad/s"
    return worst + (touched if any(rest.in_contact for rest in rests) else "")


def _conditions(controller: Controller, log: Log | None) -> dict[str, float]:
    """Return the smallest value of each condition, at the goal and along a run."""
    posture, nothing = controller.rest_posture(0.0), np.zeros(controller.system.n)
    scene = controller.rest_scene(controller.system.at(posture))
    at_rest = SampledState(0.0, posture, nothing, np.zeros(controller.state_size), nothing, scene, "")
    seen = Seen.of(controller, controller.system, at_rest)
    found = controller.conditions(seen.view, seen.measured)
    conditions = {f"{name}, at the goal": value for name, value in found.items()}
    for k in range(0 if log is None else len(log)):
        assert log is not None
        x = controller.system.at(log.position[k], log.velocity[k])
        for name, value in controller.conditions(x, log.true_measurement(k)).items():
            label = f"{name}, along the run"
            conditions[label] = min(value, conditions.get(label, np.inf))
    return conditions
