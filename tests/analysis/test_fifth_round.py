"""What a fifth round of wrong laws got past the certificate: near the goal, by memory, in thin sets, elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    NOTHING,
    Controller,
    EnergyShaping,
    ForceFeedback,
    Log,
    MechanicalSystem,
    Target,
    certify,
    load_robot,
    simulate,
)
from phcontrol.analysis.lines import Line
from phcontrol.analysis.memory import PERIODS, untouched
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.other_rests import other_rests
from phcontrol.analysis.rest_point import find_rest
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.analysis.worst import Worst
from phcontrol.controllers.shaping import Shaping
from tests.analysis.test_fourth_round import Aging, failed
from tests.analysis.test_wrong_laws import wrong
from tests.conftest import make_system


def distance(law, x):
    return float(np.linalg.norm(x.position_error(law.goal)))


def inwards(law, x):
    return x.position_error(law.goal) @ x.velocity < 0.0


# --- balls about the goal -------------------------------------------------------------------------------------


class Scaled(EnergyShaping):
    """Energy shaping with its stiffness times a factor: right on either side of where that switches."""

    def factor(self, x):
        return 1.0

    def _scaled(self, x):
        factor, laws = self.factor(x), self.__dict__.setdefault("_laws", {})
        if factor not in laws:
            laws[factor] = EnergyShaping(
                self.system, goal=self.goal, stiffness=factor * self.stiffness, damping=self.damping
            )
        return laws[factor]

    def shape(self, t, x, state, measured):
        return self._scaled(x).shape(t, x, state, measured)

    def storage(self, t, x, state, measured=NOTHING):
        return self._scaled(x).storage(t, x, state, measured)

    def target(self, t, x, state, measured=NOTHING):
        return self._scaled(x).target(t, x, state, measured)


class StiffBall(Scaled):
    """Three times as stiff within a hundredth of a radian."""

    def factor(self, x):
        return 3.0 if distance(self, x) < 0.01 else 1.0


class SoftBall(Scaled):
    """Softer within two thousandths."""

    def factor(self, x):
        return 0.7 if distance(self, x) < 0.002 else 1.0


class StiffOnTheWayIn(Scaled):
    """It gains energy each time it turns round, within two hundredths."""

    def factor(self, x):
        return 2.0 if distance(self, x) < 0.02 and inwards(self, x) else 1.0


class LentNear(EnergyShaping):
    """H_d has more in a ball, while the arm moves; the torque does not know."""

    def storage(self, t, x, state, measured=NOTHING):
        lent = distance(self, x) < 0.02 and np.abs(x.velocity).max() > 0.01
        return super().storage(t, x, state, measured) + 0.05 * lent


@pytest.mark.parametrize("arm", ["panda", "pera"])
@pytest.mark.parametrize("law", [StiffBall, SoftBall, StiffOnTheWayIn, LentNear])
def test_a_storage_function_that_jumps_close_to_the_goal_fails(law, arm):
    certificate = certify(law.tuned(make_system(arm)))
    assert not certificate["jump of H_d between states"].passed or not certificate["gradient residual"].passed


# --- thin sets that lines hit --------------------------------------------------------------------------------


def shell(law, t, x, state, measured):
    return 0.03 < distance(law, x) < 0.035


def slab(law, t, x, state, measured):
    return abs(x.position[3] + 1.5) < 0.005


def band(law, t, x, state, measured):
    return 0.05 < np.abs(x.velocity).max() < 0.06


def two_joints_away(law, t, x, state, measured):
    return list(np.flatnonzero(np.abs(x.position_error(law.goal)) > 1e-9)) == [1, 4]


def ball_on_the_way_out(law, t, x, state, measured):
    return distance(law, x) < 0.002 and x.velocity.any() and not inwards(law, x)


@pytest.mark.parametrize("where", [shell, slab, band, two_joints_away, ball_on_the_way_out])
def test_a_torque_that_is_wrong_in_a_thin_set_is_no_match(where):
    certificate = certify(wrong(EnergyShaping, where).tuned(make_system("panda")))
    assert not certificate["matching residual"].passed, str(certificate)


def test_a_torque_that_is_wrong_for_some_milliseconds_is_seen():
    law = wrong(EnergyShaping, lambda law, t, x, state, measured: 7.0 < t < 7.05).tuned(make_system("pera"))
    assert "change with time that is not declared" in failed(certify(law, samples=16))


# --- a line -----------------------------------------------------------------------------------------------------


def line(law, shares, into_rest=False):
    """Return the line from the goal of a law on one joint in its direction, a natural unit long."""
    still, none = np.zeros(1), np.zeros(0)
    at = SampledState(0.0, np.array(law.goal), still, none, still, None, "")
    change = at._replace(position=np.ones(1), velocity=still)
    return Line(Seen.of(law, law.system, at), change, shares, into_rest=into_rest, name="")


class OnOneJoint(EnergyShaping):
    """H_d is any function of the error."""

    def energy(self, error):
        return 0.5 * error**2

    def storage(self, t, x, state, measured=NOTHING):
        return self.energy(float(x.position_error(self.goal)[0]))


CHORD, RAY = np.linspace(0.0, 1.0, 33), np.geomspace(1e-6, 1.0, 25)


@pytest.mark.parametrize(
    ("energy", "jumps", "kinks"),
    [
        (lambda e: 0.5 * e**2, False, False),
        (lambda e: 1.0 - np.cos(20.0 * e), False, False),
        (lambda e: np.sqrt(e**2 + 1e-2), False, False),
        (lambda e: 0.5 * e**2 + (1e-3 if e > 0.4321 else 0.0), True, None),
        (lambda e: 0.5 * e**2 - (1e-3 if e > 0.4321 else 0.0), True, None),
        (lambda e: 0.5 * e**2 + 0.1 * abs(e - 0.4321), False, True),
        (lambda e: 0.5 * min(e**2, (e - 0.9) ** 2), False, True),
    ],
)
def test_a_chord_tells_jumps_and_kinks_from_what_is_smooth(energy, jumps, kinks):
    law = type("Own", (OnOneJoint,), {"energy": lambda self, e: energy(e)}).tuned(make_system("pera_gripper"))
    chord = line(law, CHORD)
    size, share = chord.jump()
    assert (size > 0.0) == jumps
    assert not jumps or (size == pytest.approx(1e-3 / np.ptp(chord.energies), rel=1e-3) and abs(share - 0.4321) < 1e-6)
    if kinks is not None:
        size, share = chord.kink()
        assert (size > 0.0) == kinks
        assert not kinks or abs(share - (0.4321 if energy(0.9) > 0.1 else 0.45)) < 1e-3


@pytest.mark.parametrize("radius", [3e-5, 2e-3, 0.2])
@pytest.mark.parametrize("factor", [0.5, 1.01, 3.0])
def test_a_ray_sees_a_jump_at_any_distance(radius, factor):
    """Relative to H_d there: |factor − 1| inside, or |factor − 1|/factor for what is larger."""

    def energy(self, e):
        return 0.5 * e**2 * (factor if abs(e) < radius else 1.0)

    law = type("Own", (OnOneJoint,), {"energy": energy}).tuned(make_system("pera_gripper"))
    size, share = line(law, RAY, into_rest=True).jump()
    assert share == pytest.approx(radius, rel=1e-6)
    assert 0.2 * abs(factor - 1.0) < size <= abs(factor - 1.0)
    assert line(OnOneJoint.tuned(law.system), RAY, into_rest=True).jump() == (0.0, 0.0)


# --- memory -------------------------------------------------------------------------------------------------------


class Integrates(EnergyShaping):
    """It integrates its error where it is asked with some period."""

    shortest, longest = 0.0, 0.0
    last, sum = None, 0.0

    def evaluate(self, t, x, state, measured=NOTHING):
        period = 0.0 if self.last is None else t - self.last
        within = self.shortest < period < self.longest
        self.sum = self.sum + period * x.position_error(self.goal) if within else 0.0
        self.last = t
        command = super().evaluate(t, x, state, measured)
        return command._replace(torque=command.torque - 5.0 * self.sum)


class Differentiates(EnergyShaping):
    """It takes differences of positions at 500 Hz, and is right where the arm stands."""

    last = None

    def evaluate(self, t, x, state, measured=NOTHING):
        command = super().evaluate(t, x, state, measured)
        before, self.last = self.last, (t, np.array(x.position))
        if before is None or not 1.9e-3 < t - before[0] < 2.1e-3:
            return command
        slip = (x.position - before[1]) / (t - before[0]) - x.velocity
        return command._replace(torque=command.torque - 0.1 * slip)


class WakesUpAt250(EnergyShaping):
    """After 150 periods of 4 ms."""

    last, count = -1.0, 0

    def evaluate(self, t, x, state, measured=NOTHING):
        self.count = self.count + 1 if 3.9e-3 < t - self.last < 4.1e-3 else 0
        self.last = t
        command = super().evaluate(t, x, state, measured)
        return command._replace(torque=1.3 * command.torque) if self.count > 150 else command


class LimitsItsRate(EnergyShaping):
    """From 2 to 8 ms its torque changes slowly."""

    last = None

    def evaluate(self, t, x, state, measured=NOTHING):
        command = super().evaluate(t, x, state, measured)
        if self.last is not None and 2e-3 < t - self.last[0] < 8e-3:
            change = np.clip(command.torque - self.last[1], -1e-2, 1e-2)
            command = command._replace(torque=self.last[1] + change)
        self.last = t, command.torque
        return command


class OneAnswerATime(EnergyShaping):
    """At the same time it says the same, wherever the arm is."""

    last = None

    def evaluate(self, t, x, state, measured=NOTHING):
        if self.last is None or self.last[0] != t:
            self.last = t, super().evaluate(t, x, state, measured)
        return self.last[1]


WINDOWS = ((0.05, 0.15), (0.2, 0.3), (0.3, 0.4), (1.5, 2.5), (3.0, 3.5), (4.9, 5.1), (7.0, 9.0), (9.5, 10.5))  # [ms]
REMEMBER = {
    f"integrates from {a:g} to {b:g} ms": type("At", (Integrates,), {"shortest": 1e-3 * a, "longest": 1e-3 * b})
    for a, b in WINDOWS
}
REMEMBER |= {law.__name__: law for law in (Differentiates, WakesUpAt250, LimitsItsRate, OneAnswerATime)}


@pytest.mark.parametrize("name", REMEMBER)
def test_what_a_law_remembers_at_any_period_shows(name):
    certificate = certify(REMEMBER[name].tuned(make_system("pera_shoulder")), samples=16)
    assert not certificate["command that remembers the motion"].passed, str(certificate)


def test_periods_go_from_a_tenth_to_ten_milliseconds():
    assert min(PERIODS) == 1e-4
    assert max(PERIODS) == 1e-2
    assert (np.diff(np.log(PERIODS)) < np.log(1.3)).all()
    for rate in (10_000, 8000, 5000, 4000, 2500, 2000, 1250, 1000, 800, 500, 400, 250, 200, 125, 100):
        assert np.isclose(PERIODS, 1.0 / rate, rtol=1e-9).any()


def set_by(method, *, for_good):
    """Return a law whose torque is another after a method was called: until it was asked for, or for good."""

    class Set(EnergyShaping):
        boost = 1.0

        def evaluate(self, t, x, state, measured=NOTHING):
            command = super().evaluate(t, x, state, measured)
            command = command._replace(torque=self.boost * command.torque)
            self.boost = self.boost if for_good else 1.0
            return command

    def asked(self, *arguments):
        self.boost = 1.2
        return getattr(super(Set, self), method)(*arguments)

    setattr(Set, method, asked)
    return Set


METHODS = ("passive_port", "storage", "target", "coordinates", "conditions", "calmest_state", "tank_level",
           "rate_under_limits", "jump", "desired_posture", "reference_velocity", "random_state")  # fmt: skip


@pytest.mark.parametrize("for_good", [False, True])
@pytest.mark.parametrize("method", METHODS)
def test_no_method_may_change_the_command(method, for_good):
    """Those that the certificate asks before it asks for commands are seen by the copy that was asked nothing."""
    certificate = certify(set_by(method, for_good=for_good).tuned(make_system("pera_shoulder")), samples=16)
    assert not certificate["command that other methods change"].passed, str(certificate)


class ReportsOnce(EnergyShaping):
    """A method of its own, that no certificate knows of."""

    boost = 1.0

    def report(self, t, x):
        self.boost = 1.2

    def evaluate(self, t, x, state, measured=NOTHING):
        command = super().evaluate(t, x, state, measured)
        return command._replace(torque=self.boost * command.torque)


def test_nor_may_a_method_of_its_own():
    certificate = certify(ReportsOnce.tuned(make_system("pera_shoulder")), samples=16)
    assert failed(certificate) == {"command that other methods change"}
    # it is seen when the question that it changes is asked again, some methods later
    assert certificate["command that other methods change"].where.endswith("() was asked")


def test_a_copy_has_been_asked_nothing():
    law = set_by("storage", for_good=True).tuned(make_system("pera_shoulder"))
    alone = untouched(law)
    x = law.system.at(law.goal)
    law.storage(0.0, x, np.zeros(0))
    assert (law.boost, alone.boost) == (1.2, 1.0)
    assert alone.system is law.system


# --- where else it rests -----------------------------------------------------------------------------------------


class AnyPotential(EnergyShaping):
    """About a potential of the error, given with its slope, that replaces that of the spring."""

    def error(self, x):
        return x.position_error(self.goal)

    def potential_of(self, error):
        """Return Ψ and ∂Ψ/∂error."""
        return 0.5 * float(error @ self.stiffness @ error), self.stiffness @ error

    def shape(self, t, x, state, measured):
        return Shaping(-self.potential_of(self.error(x))[1] - self.damping @ x.velocity)

    def storage(self, t, x, state, measured=NOTHING):
        return x.kinetic_energy + self.potential_of(self.error(x))[0]

    def target(self, t, x, state, measured=NOTHING):
        error = self.error(x)
        gradient = self.potential_of(error)[1]
        return Target.mechanical(x, self.interconnection, error=error, gradient=gradient, damping=self.damping)

    passive_port = Controller.passive_port


class Folded(AnyPotential):
    """Errors are folded to half a turn, as they are in continuous joints, in joints that have ends."""

    def error(self, x):
        return (x.position - self.goal + np.pi) % (2.0 * np.pi) - np.pi


class FoldedInOneJoint(AnyPotential):
    def error(self, x):
        error = np.array(x.position - self.goal)
        error[2] = (error[2] + np.pi) % (2.0 * np.pi) - np.pi
        return error


class Wells(AnyPotential):
    """A second well in the direction of all joints, as deep, 1.3 rad away."""

    apart, lift = 1.3, 0.0

    def potential_of(self, error):
        k, a = float(np.diag(self.stiffness).mean()), self.apart
        along = np.array([1.0, -0.5, 0.8, -0.3, 0.6, 0.2, -0.9][: len(error)])
        along /= np.linalg.norm(along)
        s = float(along @ error)
        aside = error - s * along
        energy = 0.5 * k * (float(aside @ aside) + (s * (s - a) / a) ** 2 + self.lift * s**2)
        return energy, k * aside + k * along * (s * (s - a) * (2.0 * s - a) / a**2 + self.lift * s)


class Kinked(AnyPotential):
    """A constant torque towards the goal in the first joint: Ψ has no gradient there."""

    def potential_of(self, error):
        energy, gradient = super().potential_of(error)
        return energy + 2.0 * abs(error[0]), gradient + 2.0 * np.sign(error[0]) * np.eye(len(error))[0]


NEAR_ITS_LIMIT = [2.7, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8]
KINK, REST = "kink of H_d between states", "other rests as deep as the goal"


@pytest.mark.parametrize(
    ("law", "arm", "goal", "line"),
    [
        (Folded, "ur5", None, KINK),
        (Folded, "panda", NEAR_ITS_LIMIT, KINK),
        (FoldedInOneJoint, "panda", [0.0, -0.8, 1.0, -2.4, 0.0, 1.6, 0.8], KINK),
        (Kinked, "panda", None, KINK),
        (Wells, "panda", None, REST),
        (type("WellsNear", (Wells,), {"apart": -0.7}), "panda", None, REST),
    ],
)
def test_what_folds_or_rests_elsewhere_as_deep_fails(law, arm, goal, line):
    certificate = certify(law.tuned(make_system(arm), goal=goal))
    assert not certificate[line].passed, str(certificate)


def test_any_potential_is_right_with_one_minimum():
    certificate = certify(AnyPotential.tuned(make_system("ur5")), samples=64)
    assert certificate.passed, str(certificate)
    assert certificate.other_rests == ()


def test_a_shallower_rest_is_said():
    """s²(s − a)²/a² + c s² has a second minimum, above zero, at a root of its derivative."""
    law = type("Shallow", (Wells,), {"lift": 0.02}).tuned(make_system("pera_shoulder"))
    certificate = certify(law)
    assert certificate.passed, str(certificate)
    a, c = law.apart, law.lift
    s = max(np.roots([4.0 / a**2, -6.0 / a, 2.0 + 2.0 * c]).real)
    along = np.array([1.0, -0.5]) / np.linalg.norm([1.0, -0.5])
    ((posture, height),) = certificate.other_rests
    np.testing.assert_allclose(posture, law.goal + s * along, atol=1e-3)
    assert height == pytest.approx(law.potential_of(s * along)[0], rel=1e-4)
    assert f"another minimum, {height:.3g} J above that of the goal" in str(certificate)
    assert certificate.to_dict()["other_rests"] == [{"position": posture, "height": height}]


def test_a_whole_turn_of_a_continuous_joint_is_no_other_rest():
    """Of the Kinova's; where errors are folded in joints that have ends it is one."""
    for arm, law, count in (("kinova", EnergyShaping, 0), ("ur5", Folded, 5)):
        plant = make_system(arm)
        tuned = law.tuned(plant)
        units = NaturalUnits.of(tuned, plant, 0.0)
        found = other_rests(tuned, plant, units, find_rest(tuned, plant, units, 0.0), 0)
        assert len([each for each in found if each.height < 1e-9]) >= count
        assert count or not found


# --- what others trust -----------------------------------------------------------------------------------------


class SlowPortIsAnother(EnergyShaping):
    def passive_port(self, t, x, state, measured=NOTHING):
        port = super().passive_port(t, x, state, measured)
        return port._replace(output=1.2 * port.output) if np.abs(x.velocity).max() < 0.04 else port


class ReversesUnderLimits(ForceFeedback):
    def rate_under_limits(self, t, x, state, rate, change, measured=NOTHING):
        return -rate


class GainsUnderLimits(ForceFeedback):
    def rate_under_limits(self, t, x, state, rate, change, measured=NOTHING):
        return rate + 0.1 * change


class GoesElsewhereLater(EnergyShaping):
    def target_posture(self, t):
        return self.goal + 0.2 * (t > 5.0)


class DesiresElsewhereLater(EnergyShaping):
    def desired_posture(self, t, state):
        return self.goal + 0.2 * (t > 5.0)


@pytest.mark.parametrize(
    ("law", "line"),
    [
        (SlowPortIsAnother, "passive port that is another"),
        (ReversesUnderLimits, "rise of H_d under limits"),
        (GainsUnderLimits, "rise of H_d under limits"),
        (GoesElsewhereLater, "change with time that is not declared"),
        (DesiresElsewhereLater, "change with time that is not declared"),
    ],
)
def test_what_others_trust_is_looked_at(law, line):
    certificate = certify(law.tuned(make_system("panda")))
    assert not certificate[line].passed, str(certificate)


# --- figures ---------------------------------------------------------------------------------------------------


def test_the_worst_of_values_is_described_alone():
    described = []

    def words(k):
        described.append(k)
        return f"place {k}"

    assert Worst.among([1.0, 3.0, 2.0], words) == Worst(3.0, "place 1")
    assert Worst.among([-1.0, float("nan")], words) == Worst(np.inf, "place 1")
    assert Worst.among([-1.0], words) == Worst(0.0, "")
    assert described == [1, 1]


# --- H_d that changes with time, along runs -------------------------------------------------------------------


@pytest.mark.parametrize("kept", [False, True])
def test_a_power_balance_knows_the_clock(kept, tmp_path):
    """∂H_d/∂t = −½·½e⁻ᵗ q̃ᵀK q̃ of this law, whose stiffness falls by itself."""
    plant = MechanicalSystem(load_robot("pera_shoulder"))
    law = Aging.tuned(plant)
    log = simulate(plant, law, duration=1.0, dt=1e-3, q0=law.goal + 0.3, torque_limit=None, progress=False)
    errors = log.position - law.goal
    expected = -0.25 * np.exp(-log.time) * np.einsum("ki,ij,kj->k", errors, law.stiffness, errors)
    if kept:
        log = Log.load(log.save(tmp_path / "log.npz"))
    np.testing.assert_allclose(log.aging_power[1:], expected[1:], rtol=1e-6, atol=1e-9)
    balance = log.power_balance("storage")
    assert balance.relative_residual < 1e-6
    assert np.abs(balance.aging).max() > 0.1 * np.abs(balance.rate).max()


def test_a_law_that_does_not_change_has_no_such_power():
    plant = make_system("pera_shoulder")
    log = simulate(plant, EnergyShaping.tuned(plant), duration=0.01, progress=False)
    assert log.aging_power is None
    assert not log.power_balance().aging.any()
