"""What a law states in closed form, because it is faster, is what the base derives from its target."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from functools import cache
from itertools import count

import numpy as np
import pytest

from phcontrol import (
    NOTHING,
    Controller,
    EnergyShaping,
    ForceRegulation,
    MechanicalSystem,
    load_robot,
    make_controller,
)
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.analysis.state_sampler import StateSampler
from phcontrol.controllers import controller as base
from phcontrol.controllers.registry import CONTROLLERS
from phcontrol.runs.compositions import compositions
from tests.analysis.test_red_team import replaced
from tests.conftest import make_system

STEPS = (1e-3, 3e-3, 5e-4, 2e-4, 5e-5)
"""Of the base's differences of θ [rad], its own first: near singularities of a path θ bends within the region of
damping, and a large step leaves an error of its fourth power; a small one leaves rounding of a large θ over it."""
BOUND = 1e-10
MOST_UNSURE = 1e-5
"""What two steps may differ by: more would hide an error."""
FEW, MANY = 2, 64
ARMS = ("pera_shoulder_elbow", "ur5", "panda_with_fingers", "geared")


@cache
def arm(name: str) -> MechanicalSystem:
    """An arm of the table; "geared" has motors that act on several joints each."""
    if name != "geared":
        return make_system(name)
    mixing = np.eye(7) * np.linspace(0.5, 2.0, 7) + 0.2 * np.random.default_rng(1).normal(size=(7, 7))
    return MechanicalSystem(load_robot("pera"), input_matrix=mixing)


def derived(law: Controller) -> Controller:
    """The same law, whose torque, state rate and port are derived by the base from storage and target alone."""
    own = {name: getattr(Controller, name) for name in ("shape", "passive_port", "evaluate")}
    other = copy.copy(law)
    other.__class__ = type(f"Derived{type(law).__name__}", (type(law),), own)
    return other


def variants(system: MechanicalSystem) -> Iterator[tuple[str, str, dict]]:
    """Laws of the registry that are not composed, and options that change what a law is."""
    for name in ("tracking", "tracking_measured", "reduction_servo", "hamiltonian_servo"):
        yield name, name, {}
    force = np.full(system.n, 0.5)
    yield "force control that approaches", "force_control", {"force": force, "approach_speed": 0.2}
    yield "force control without feedforward", "force_control", {"force": force, "feedforward": False}
    for name in ("impedance_grasping", "classical_impedance"):
        yield f"{name}, regulated", name, {"regulation": ForceRegulation(force)}
        swing = {"regulation": ForceRegulation(force), "reference": make_controller("tracking", system).trajectory}
        yield f"{name}, regulated along a sinusoid", name, swing


def every_law(system: MechanicalSystem, every_form: bool) -> Iterator[tuple[str, Controller]]:
    """Every law in every form, or in one form after the other."""
    named = [(f"{c.law}, {c.potential}, {c.reference}", c.law, c.options) for c in compositions(system)]
    for k, (label, name, options) in enumerate([*named, *variants(system)]):
        forms = CONTROLLERS[name].law.forms
        for form in forms if every_form else (forms[k % len(forms)],):
            yield f"{label}, {form}", make_controller(name, system, interconnection=form, **options)


def states(law: Controller, system: MechanicalSystem, samples: int, seed: int) -> list[SampledState]:
    """States drawn where laws work and go wrong: at rest, at the goal, at the limits, fast, under forces.

    Every other one of twice as many, from the first or the second: the first is the rest point, the fourth is thin.
    """
    x = system.at(law.rest_posture(0.0))
    rest = x.position, law.reference_velocity(0.0, x), law.initial_state(x)
    sampler = StateSampler(law, system, NaturalUnits.of(law, system, 0.0), rest, np.zeros(system.n))
    return sampler.draw(2 * samples, seed)[seed % 2 :: 2]


def differences(fast: Controller, slow: Controller, at: SampledState) -> tuple[dict[str, float], float]:
    """Each quantity's difference, relative to its size, at least 1 [N·m, rad/s, W], and how unsure the torque's is.

    The derived torque is the nearest of those with several steps; where none is near enough, the derivation is as
    unsure as it differs from one step to the next.
    """
    seen = Seen.of(fast, fast.system, at)
    arguments = at.time, seen.view, at.state, seen.measured
    command, port = fast.evaluate(*arguments), fast.passive_port(*arguments)
    other_port = slow.passive_port(*arguments)
    pairs = {name: (getattr(port, name), getattr(other_port, name)) for name in port._fields}
    torques = []
    with pytest.MonkeyPatch.context() as patch:
        for step in STEPS:
            patch.setattr(base, "_STEP", step)
            other = slow.evaluate(*arguments)
            torques.append(other.torque)
            if distance(command.torque, other.torque) <= BOUND:
                break
    pairs["state rate"] = command.state_rate, other.state_rate
    nearest = min(torques, key=lambda torque: distance(command.torque, torque))
    others = sorted(distance(nearest, torque) for torque in torques if torque is not nearest)
    unsure = others[1] if len(others) == len(STEPS) - 1 else 0.0  # one other may agree by chance
    return {name: distance(*pair) for name, pair in pairs.items()} | {
        "torque": distance(command.torque, nearest)
    }, unsure


def distance(first: object, second: object) -> float:
    a, b = np.asarray(first), np.asarray(second)
    return float(np.abs(a - b).max(initial=0.0) / max(1.0, np.abs(a).max(initial=0.0)))


def failures(system: MechanicalSystem, samples: int) -> tuple[list[str], float, int]:
    """What differs by too much, the worst, and at how many states the derivation was unsure."""
    lines, worst, vague, seeds = [], 0.0, 0, count()
    for label, law in every_law(system, samples == MANY):
        slow = derived(law)
        for at in states(law, system, samples, next(seeds)):
            found, unsure = differences(law, slow, at)
            vague += unsure > 0.0
            for quantity, difference in found.items():
                worst = max(worst, difference)
                allowed = BOUND + (2.0 * min(unsure, MOST_UNSURE) if quantity == "torque" else 0.0)
                if not difference <= allowed:
                    lines.append(f"{label}: {quantity} {difference:.1e}; {at.stratum}, t = {at.time:.3g} s")
    return lines, worst, vague


@pytest.mark.parametrize("name", ARMS)
def test_fast_is_derived(name):
    lines, worst, vague = failures(arm(name), FEW)
    assert lines == []
    assert worst > 0.0  # two computations, not one
    assert vague < 20  # of some 200 states: beside them the bound is that of rounding


@pytest.mark.study
@pytest.mark.parametrize("name", [*ARMS, "pera", "panda", "tiago_no_hand"])
def test_fast_is_derived_at_many_states(name):
    assert failures(arm(name), MANY)[0] == []


@pytest.mark.parametrize("part", ["effort", "acceleration", "offset_rate", "state_rate"])
def test_an_error_of_a_millionth_is_seen(part):
    """Of one part of what integral action states along a path of the tool."""
    system = arm("ur5")
    composed = next(c for c in compositions(system, ["integral_action"]) if c.reference == "frame line")
    right = composed.make(system, "coriolis")

    class Wrong(type(right)):
        def shape(self, *arguments):
            stated = super().shape(*arguments)
            return stated._replace(**{part: getattr(stated, part) * (1.0 + 1e-6)})

    wrong = copy.copy(right)
    wrong.__class__ = Wrong
    found = []
    for at in states(right, system, 8, 0):
        differs, unsure = differences(wrong, derived(right), at)
        found.append(max(differs.values()) / (BOUND + 2.0 * unsure))
    assert max(found) > 100.0


def test_the_derivation_is_of_fourth_order():
    """So that what is left near a singularity is the difference quotient's error, not the law's."""
    system = arm("ur5")
    composed = next(c for c in compositions(system, ["energy_shaping"]) if c.reference == "frame line")
    law = composed.make(system, "coriolis")
    position = np.array(law.rest_posture(0.0))
    position[4] = 1e-3  # two wrist axes nearly in line
    at = SampledState(0.7, position, np.full(6, 0.5), np.zeros(0), np.zeros(6), None, "")
    seen = Seen.of(law, system, at)
    arguments = 0.7, seen.view, at.state, seen.measured
    torque, slow = law.evaluate(*arguments).torque, derived(law)
    errors = []
    with pytest.MonkeyPatch.context() as patch:
        for step in (4e-3, 2e-3):
            patch.setattr(base, "_STEP", step)
            errors.append(distance(torque, slow.evaluate(*arguments).torque))
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.3)


def test_the_derived_port_is_that_of_the_gradient():
    """With H_d twice what it was, a torque δ more brings in twice as much: ŷ follows ∂H_d/∂p̂, not p̂."""

    class Doubled(EnergyShaping):
        passive_port = Controller.passive_port

        def storage(self, t, x, state, measured=NOTHING):
            return 2.0 * super().storage(t, x, state, measured)

        def target(self, t, x, state, measured=NOTHING):
            target = super().target(t, x, state, measured)
            return replaced(target, gradient=2.0 * target.gradient)

    system = make_system("pera")
    law, generator = Doubled.tuned(system), np.random.default_rng(0)
    x = system.at(system.robot.random_position(generator), generator.normal(size=system.n))
    change = generator.normal(size=system.n)

    def stored(step):
        moved = x.velocity + step * np.linalg.solve(x.mass_matrix, change)  # what δ adds to q̇ in a short time
        return law.storage(0.0, system.at(x.position, moved), np.zeros(0))

    supplied = (stored(1e-5) - stored(-1e-5)) / 2e-5
    assert law.passive_port(0.0, x, np.zeros(0)).output.dot(change) == pytest.approx(supplied, rel=1e-7)
