"""What a sixth round of laws, wrong and right, found in the certificate: switches, declarations, indirect damping."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    NOTHING,
    Controller,
    EnergyShaping,
    Gain,
    MechanicalSystem,
    MinimumJerk,
    Schedule,
    Target,
    Vector,
    certify,
    load_robot,
)
from phcontrol.analysis.flow import Flow
from phcontrol.analysis.lines import largest_jump, lines_of
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.rest_point import find_rest
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.state_sampler import beside_switches
from tests.analysis.test_fourth_round import failed
from tests.conftest import make_system

SECONDS = 1.0


def pushed(when):
    """Return a law that pushes with 20 N·m that it does not promise, at some times."""

    class Pushed(EnergyShaping):
        name = "pushed"

        def shape(self, t, x, state, measured):
            shaping = super().shape(t, x, state, measured)
            return shaping._replace(effort=shaping.effort + 20.0 * when(t))

    return Pushed


# --- just before and just after the times at which a law says that it changes ---------------------------------


@pytest.mark.parametrize(
    "when",
    [
        lambda t: 2.999 < t < 3.0,
        lambda t: 3.0 <= t < 3.0005,
        lambda t: 0.0 < t < 0.004,
    ],
    ids=["before the switch", "after the switch", "at the start"],
)
@pytest.mark.parametrize("seed", [0, 3])
def test_a_law_is_wrong_for_a_millisecond_at_a_switch(when, seed):
    system = make_system("pera_shoulder")
    goal = system.robot.home + 0.2
    led = MinimumJerk(system.robot.home, goal, 6.0)
    law = pushed(when)
    right = Schedule([(0.0, EnergyShaping.tuned(system)), (3.0, EnergyShaping.tuned(system, reference=led))])
    wrong = Schedule([(0.0, law.tuned(system)), (3.0, law.tuned(system, reference=led))])
    assert certify(right, seed=seed).passed
    assert "matching residual" in failed(certify(wrong, seed=seed))


@pytest.mark.parametrize("when", [lambda t: 1.9995 < t < 2.0, lambda t: 2.0 < t < 2.0005], ids=["before", "after"])
def test_a_law_is_wrong_for_a_moment_at_the_end_of_its_reference(when):
    system = make_system("pera_shoulder")
    led = MinimumJerk(system.robot.home, system.robot.home + 0.2, 2.0)
    assert certify(EnergyShaping.tuned(system, reference=led)).passed
    assert "matching residual" in failed(certify(pushed(when).tuned(system, reference=led)))


def test_states_beside_switches_are_on_both_sides_of_each():
    system = make_system("pera_shoulder")
    law = Schedule([(k * SECONDS, EnergyShaping.tuned(system, [0.1 * k, 0.2])) for k in range(3)])
    still = np.zeros(2)
    states = [SampledState(0.5, still, still, np.zeros(0), still, None, "")] * 100
    times = {round(at.time, 9) for at in beside_switches(law, states)}
    for turn in (1.0, 2.0):
        assert {round(turn + side * near, 9) for side in (-1, 1) for near in (1e-3, 1e-4, 1e-5)} <= times
    assert min(times) == 1e-5
    many = Schedule([(k * SECONDS, EnergyShaping.tuned(system, [0.1, 0.2])) for k in range(40)])
    assert 12 <= len(beside_switches(many, states)) <= 24
    assert beside_switches(EnergyShaping.tuned(system), states) == []


def test_differences_do_not_reach_across_a_switch():
    system = make_system("pera_shoulder")
    law = Schedule([(0.0, EnergyShaping.tuned(system)), (1.0, EnergyShaping.tuned(system, [0.4, 0.3]))])
    still = np.zeros(2)

    def stays(time, stretch):
        return Flow(law, system, SampledState(time, still, still, np.zeros(0), still, None, "")).stays(stretch)

    assert stays(0.5, 8.0)
    assert not stays(1.0 - 1e-3, 8.0)
    assert stays(1.0 - 1e-3, 1.0)
    assert not stays(1.0, 1.0 / 512.0)


def test_a_run_that_meets_a_switch_is_no_violation():
    """With states taken at the very time of a switch, differences reached across it."""
    system = make_system("pera_shoulder")
    first, then = EnergyShaping.tuned(system), EnergyShaping.tuned(system, [0.4, 0.3])
    for switch in (0.04, 0.085, 0.13, 0.17, 0.215, 0.26):
        certificate = certify(Schedule([(0.0, first), (switch, then)]), samples=16)
        assert certificate.matching_passed, str(certificate)


class Stiffens(EnergyShaping):
    """Twice as stiff from 2 s on."""

    name = "stiffens"

    @property
    def phases(self):
        return (0.0, 2.0)

    @property
    def time_span(self):
        return 2.0

    def _factor(self, t):
        return 1.0 if t < 2.0 else 2.0

    def shape(self, t, x, state, measured):
        shaping = super().shape(t, x, state, measured)
        more = (self._factor(t) - 1.0) * self.stiffness @ x.position_error(self.goal)
        return shaping._replace(effort=shaping.effort - more)

    def storage(self, t, x, state, measured=NOTHING):
        error = x.position_error(self.goal)
        return x.kinetic_energy + 0.5 * self._factor(t) * error @ self.stiffness @ error

    def target(self, t, x, state, measured=NOTHING):
        error = x.position_error(self.goal)
        pull = self._factor(t) * self.stiffness @ error
        return Target.mechanical(x, self.interconnection, error=error, gradient=pull, damping=self.damping)


class SaysThatItStiffens(Stiffens):
    @property
    def caveat(self):
        return "passivity at 2 s, where its stiffness doubles"


def test_energy_that_a_switch_brings_in_is_told():
    system = make_system("pera_shoulder")
    silent, told = certify(Stiffens.tuned(system)), certify(SaysThatItStiffens.tuned(system))
    assert failed(silent) == {"jump of H_d at switches, untold"}
    assert told.passed, str(told)
    assert told.jump_at_switches == silent.jump_at_switches > 0.0


# --- damping by a state of the law alone ----------------------------------------------------------------------


class Lagging(Controller):
    """A spring, and beside it a spring and a damper in a row: no velocity is used, and all damping is indirect.

    u = ∂V/∂q − K q̃ − 3K(q̃ − z),   C ż = 3K(q̃ − z)
    """

    name = "lagging"
    states = ("lag",)
    goal: Vector = Vector("q_d", "rad", tuned=lambda tuning: tuning.goal)
    stiffness: Gain = Gain("K", "N·m/rad", tuned=lambda tuning: tuning.stiffness)
    damping: Gain = Gain("C", "N·m·s/rad", tuned=lambda tuning: tuning.damping)
    damped = True

    def storage(self, t, x, state, measured=NOTHING):
        error = x.position_error(self.goal)
        stretch = error - state
        return x.kinetic_energy + 0.5 * error @ self.stiffness @ error + 1.5 * stretch @ self.stiffness @ stretch

    def target(self, t, x, state, measured=NOTHING):
        error, momentum = x.position_error(self.goal), x.transformed_momentum
        pull = 3.0 * self.stiffness @ (error - state)
        lost = {("lag", "lag"): np.linalg.inv(self.damping)} if self.damped else {}
        return Target.of(
            {"error": (error, self.stiffness @ error + pull), "momentum": (momentum, momentum), "lag": (state, -pull)},
            {
                ("error", "momentum"): x.inverse_factor.T,
                ("momentum", "momentum"): x.interconnection(self.interconnection),
            },
            lost | {("momentum", "momentum"): x.transformed_damping},
            {"momentum": x.inverse_factor},
        )


class Undamped(Lagging):
    damped = False


@pytest.mark.parametrize("seed", [0, 1])
def test_damping_by_a_state_of_the_law_is_damping(seed):
    """Where its spring is not stretched it takes nothing, for an instant."""
    system = MechanicalSystem(load_robot("asr_twodof"))
    certificate = certify(Lagging.tuned(system), seed=seed)
    assert certificate.passed, str(certificate)


def test_a_state_that_damps_nothing_is_none():
    certificate = certify(Undamped.tuned(MechanicalSystem(load_robot("asr_twodof"))))
    assert "least dissipation in motion [1/s]" in failed(certificate)


# --- rounding near the goal ------------------------------------------------------------------------------------


class Cosines(Controller):
    """A spring k sin(q̃) whose energy k(1 − cos q̃) is a difference of large numbers near the goal."""

    name = "cosines"
    goal: Vector = Vector("q_d", "rad", tuned=lambda tuning: tuning.goal)
    stiffness: Gain = Gain("K", "N·m/rad", tuned=lambda tuning: tuning.stiffness)
    damping: Gain = Gain("C", "N·m·s/rad", tuned=lambda tuning: tuning.damping)
    step = 0.0

    def storage(self, t, x, state, measured=NOTHING):
        error = x.position - self.goal
        more = self.step * (abs(error[0]) > 1e-4)
        return x.kinetic_energy + self.stiffness.diagonal() @ (1.0 - np.cos(error)) + more

    def target(self, t, x, state, measured=NOTHING):
        error = x.position - self.goal
        pull = self.stiffness.diagonal() * np.sin(error)
        return Target.mechanical(x, self.interconnection, error=error, gradient=pull, damping=self.damping)


class SteppedCosines(Cosines):
    """The same with a step of H_d that is small beside all but rounding."""

    step = 1e-9


def jump_towards_rest(law):
    system, nothing = law.system, np.zeros(0)
    units, rest = NaturalUnits.of(law, system, 0.0), find_rest(law, system, NaturalUnits.of(law, system, 0.0), 0.0)
    still = np.zeros(system.n)
    states = [SampledState(0.0, law.goal + 0.1 * k, still, nothing, still, None, "") for k in range(256)]
    return largest_jump([line for line in lines_of(law, system, units, rest, states) if line.into_rest]).value


def test_rounding_near_the_goal_is_no_jump():
    system = make_system("ur5")
    assert jump_towards_rest(Cosines.tuned(system)) == 0.0
    assert jump_towards_rest(SteppedCosines.tuned(system)) > 1e-4


# --- what a law says of itself ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("phases", (0.0, float("nan"))),
        ("phases", (0.0, 2.0, 1.0)),
        ("phases", (0.0, "late")),
        ("longest_period", -1.0),
        ("longest_period", float("nan")),
        ("longest_period", None),
        ("other_rests", None),
        ("other_rests", True),
    ],
)
def test_declarations_are_looked_at(name, value):
    law = type("Declared", (EnergyShaping,), {"name": "declared", name: property(lambda self: value)})
    certificate = certify(law.tuned(make_system("pera_shoulder")), samples=16)
    assert f"Declared.{name} is " in certificate.error, str(certificate)
