"""What a fourth round of wrong laws got past the certificate, and a right one that it refused."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    NOTHING,
    CartesianImpedance,
    ClassicalImpedance,
    Command,
    Controller,
    EnergyShaping,
    ForceFeedback,
    ForceRegulation,
    Gain,
    HamiltonianServo,
    ImpedanceGrasping,
    InvalidArgumentError,
    JointForce,
    JointSpring,
    MechanicalSystem,
    PinholeCamera,
    ReductionServo,
    Target,
    Vector,
    certify,
    load_robot,
)
from phcontrol.analysis.empty_scene import EmptyScene
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.neighbourhood import Neighbourhood
from phcontrol.analysis.pushed_loop import fastest_when_pushed
from phcontrol.analysis.rest_point import find_rest
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.target import Drive
from tests.analysis.test_red_team import DrivenByTouch, replaced
from tests.analysis.test_wrong_laws import regulated, wrong
from tests.conftest import make_system

PUSHED = "largest real part when it is pushed [1/s]"


def failed(certificate):
    return {check.name for check in certificate.checks if not check.passed}


# --- what f_e drives, at large forces -----------------------------------------------------------------


class DrivenByTheCube(DrivenByTouch):
    """ż = −z + f_e-dependent signal: nothing at all for a small force."""

    def signal(self, force):
        return force**3

    def target(self, t, x, state, measured=NOTHING):
        target = super().target(t, x, state, measured)
        return replaced(target, drive=Drive(target.drive.port, self.signal(target.drive.signal)))


class YieldsToLittle(DrivenByTheCube):
    """It gives way to small forces, and pushes back at large ones."""

    gain = 5.0

    def signal(self, force):
        return force - 1e-3 * force**3


class TurnsRound(DrivenByTheCube):
    """It pushes back at what is stronger than 20 N·m."""

    gain = 5.0

    def signal(self, force):
        return np.where(np.abs(force) > 20.0, -8.0 * force, force)


@pytest.mark.parametrize("law", [DrivenByTheCube, YieldsToLittle, TurnsRound])
def test_what_large_forces_drive_is_looked_at(law):
    """Each passes all else: its answer to a small force is stable against any spring."""
    certificate = certify(law.tuned(make_system("pera_shoulder")), samples=32)
    assert failed(certificate) == {PUSHED}, str(certificate)


class BackwardsFromFar(ForceRegulation):
    """q̇_f moves the wrong way when the force is off by more than 10 N·m; the rate's limit hides how far."""

    def rate(self, external_force):
        error = external_force - self.force
        return np.clip(self.gain * (error - 1e-2 * error**3), -self.rate_limit, self.rate_limit)


class FasterFromFar(ForceRegulation):
    """q̇_f grows with the cube of the force, up to the limit of its rate: nonlinear, promised, and right."""

    def rate(self, external_force):
        error = external_force - self.force
        return np.clip(self.gain * (error + 1e-3 * error**3), -self.rate_limit, self.rate_limit)


@pytest.mark.parametrize("law", [ImpedanceGrasping, ClassicalImpedance])
def test_a_regulation_may_be_nonlinear_but_not_turn_round(law):
    assert failed(certify(regulated(law, BackwardsFromFar), samples=32)) == {PUSHED}
    assert certify(regulated(law, FasterFromFar), samples=32).verdict == "PASSED AS DRIVEN"


@pytest.mark.parametrize("size", [1e-9, 1e-3])
def test_a_cube_of_f_e_beside_a_linear_promise_is_no_match(size):
    class Cubed(ImpedanceGrasping):
        def shape(self, t, x, state, measured):
            law = super().shape(t, x, state, measured)
            return law._replace(cancelled_force=law.cancelled_force + size * law.cancelled_force**3)

    certificate = certify(Cubed.tuned(MechanicalSystem(load_robot("ur5"), friction=None)), samples=32)
    assert not certificate["matching residual"].passed, str(certificate)


def test_chords_of_a_law_that_is_linear_in_f_e_are_its_slope():
    """The spectrum when it is pushed is then that when it is touched, whatever the size of the push."""
    plant = make_system("pera_shoulder")
    law = type("Yielding", (DrivenByTouch,), {"gain": 5.0}).tuned(plant)
    units = NaturalUnits.of(law, plant, 0.0)
    rest = find_rest(law, plant, units, 0.0)
    for frequency in (0.5, 100.0):
        touched = find_rest(law, plant, units, 0.0, frequency, True)
        fastest = touched.eigenvalues.real.max()
        pushed = fastest_when_pushed(law, plant, units, rest, (frequency,)).value  # less its own uncertainty
        assert fastest - 2.0 * touched.uncertainty.max() < pushed < fastest + 1e-9


def test_a_push_is_felt_by_arm_and_law():
    """Of energy shaping, which does not measure it, q̈ changes by M⁻¹ times the push."""
    plant = make_system("pera_shoulder")
    law = EnergyShaping.tuned(plant)
    around = Neighbourhood(law, plant, NaturalUnits.of(law, plant, 0.0), 0.0, np.array([1.0, 2.0]))
    y, push = np.concatenate([law.goal + 0.1, [0.2, -0.3]]), np.array([3.0, -1.0])
    expected = np.linalg.solve(plant.at(y[:2]).mass_matrix, push)
    np.testing.assert_allclose((around.rate(y, push) - around.rate(y))[2:], expected, rtol=1e-12)


# --- goals --------------------------------------------------------------------------------------------


class SaysElsewhere(JointSpring):
    """It pulls beside the posture where it says that it is smallest."""

    def __init__(self, goal, stiffness):
        super().__init__(np.asarray(goal) + 0.3, stiffness)
        self.said = np.asarray(goal, dtype=float)

    @property
    def posture(self):
        return self.said


@pytest.mark.parametrize("law", [EnergyShaping, ForceFeedback])
@pytest.mark.parametrize("beside", [False, True])
def test_a_potential_that_lies_about_its_posture_is_refused(law, beside):
    plant = make_system("pera_shoulder")
    potential = SaysElsewhere([0.1, 0.2], 20.0)
    potential = JointSpring([0.3, 0.3], 10.0) + potential if beside else potential
    with pytest.raises(InvalidArgumentError, match=r"says that it is smallest at \[0\.1 0\.2\].* up to 6 N·m"):
        law.tuned(plant, potential=potential)


def test_honest_potentials_are_taken():
    """A sum rests beside the posture of its spring, and nobody says otherwise."""
    plant = make_system("pera_shoulder")
    law = EnergyShaping.tuned(plant, potential=JointSpring([0.1, 0.2], 20.0) + JointForce([1.0, 0.5]))
    assert law.target_posture(0.0) is None
    certificate = certify(law, samples=32)
    assert certificate.passed, str(certificate)


class PullsElsewhere(EnergyShaping):
    """It is given a goal, and puts its spring 0.3 rad beside it."""

    def shaped(self):
        return JointSpring(self.goal + 0.3, self.stiffness)


class BeginsElsewhere(EnergyShaping):
    """What takes over from it would be told of another posture."""

    def desired_posture(self, t, state):
        return self.goal + 0.5


@pytest.mark.parametrize(
    ("law", "line"),
    [(PullsElsewhere, "distance from its goal at rest"), (BeginsElsewhere, "desired posture that is another")],
)
def test_a_law_that_goes_elsewhere_than_to_its_goal_fails(law, line):
    assert failed(certify(law.tuned(make_system("pera_shoulder")), samples=32)) == {line}


def test_the_goal_of_a_law_on_a_frame_is_no_posture():
    plant = make_system("panda")
    assert CartesianImpedance.tuned(plant).target_posture(0.0) is None


# --- nothing to see -------------------------------------------------------------------------------------


class LostBadly(HamiltonianServo):
    """It holds, with a torque too much."""

    def lost_now(self, measured):
        return not self.camera.sees(measured.features)

    def added(self, x):
        return 1.0

    def evaluate(self, t, x, state, measured=NOTHING):
        command = super().evaluate(t, x, state, measured)
        return command._replace(torque=command.torque + self.added(x)) if self.lost_now(measured) else command


class LostBadlyInTheDark(LostBadly):
    """The same where the features are NaN only."""

    def lost_now(self, measured):
        return bool(np.isnan(measured.features).any())


class LostBadlyAtRest(LostBadlyInTheDark):
    """The same at rest only."""

    def added(self, x):
        return 0.0 if x.velocity.any() else 1.0


class LostBesideTheImage(LostBadly):
    """The same where the object has left the image, in front of the camera."""

    def lost_now(self, measured):
        return bool(measured.features[2] > 0.0) and super().lost_now(measured)


class Limp(HamiltonianServo):
    """It lets the arm fall when it sees nothing."""

    def evaluate(self, t, x, state, measured=NOTHING):
        if np.isnan(measured.features).any():
            return Command(np.zeros(x.system.n), np.zeros(0))
        return super().evaluate(t, x, state, measured)


class SlipsThrough(HamiltonianServo):
    """With lost="error", but NaN is taken for features."""

    def shape(self, t, x, state, measured):
        if np.isnan(measured.features).any():
            return Shaping(np.ones(x.system.n))
        return super().shape(t, x, state, measured)


IMAGE = {"camera": PinholeCamera(field_of_view=1.0, image_size=(640, 480))}
BLIND = {
    "holds badly": (LostBadly, {"lost": "hold"}),
    "holds badly in the dark": (LostBadlyInTheDark, {"lost": "hold"}),
    "holds badly in the dark, at rest": (LostBadlyAtRest, {"lost": "hold"}),
    "holds badly beside the image": (LostBesideTheImage, {"lost": "hold"} | IMAGE),
    "limp": (Limp, {"lost": "hold"}),
    "NaN slips through": (SlipsThrough, {"lost": "error"}),
}


@pytest.mark.parametrize("name", BLIND)
def test_a_law_that_is_wrong_when_it_sees_nothing_fails(name):
    law, options = BLIND[name]
    assert not certify(law.tuned(make_system("pera"), **options))["matching residual"].passed


class Coasts(HamiltonianServo):
    """It does not brake when it sees nothing, and says so."""

    def shape(self, t, x, state, measured):
        return Shaping(np.zeros(x.system.n)) if self.seen(measured) is None else super().shape(t, x, state, measured)

    def target(self, t, x, state, measured=NOTHING):
        target = super().target(t, x, state, measured)
        return target if self.seen(measured) is not None else replaced(target, dissipation=x.transformed_damping)

    passive_port = Controller.passive_port


def test_an_arm_without_friction_must_be_braked_in_the_dark():
    plant = MechanicalSystem(load_robot("pera"), friction=None)
    certificate = certify(Coasts.tuned(plant, lost="hold"), samples=64)
    assert failed(certificate) == {"least dissipation with nothing to see [1/s]"}, str(certificate)


@pytest.mark.parametrize(
    ("law", "options"),
    [
        (HamiltonianServo, {"lost": "hold"}),
        (HamiltonianServo, {"lost": "error"}),
        (HamiltonianServo, {"lost": "hold"} | IMAGE),
        (ReductionServo, {"lost": "hold"}),
    ],
)
def test_right_laws_pass_in_the_dark(law, options):
    certificate = certify(law.tuned(make_system("pera"), **options), samples=64)
    assert certificate.passed, str(certificate)
    names = {check.name for check in certificate.checks}
    assert ("least dissipation with nothing to see [1/s]" in names) == (options["lost"] == "hold")


def test_an_empty_scene_shows_what_a_camera_shows_that_finds_nothing(pera):
    scene = EmptyScene()
    assert scene.initial_state().shape == scene.rate(pera.at(pera.robot.home), scene.initial_state()).shape == (0,)
    features = scene.features(pera.at(pera.robot.home), scene.initial_state())
    assert features.shape == (3,)
    assert not PinholeCamera(frame="tool").sees(features)


# --- H_d that changes with time -----------------------------------------------------------------------------


class Aging(Controller):
    """H_d = ½|p̄|² + ½a(t) q̃ᵀK q̃."""

    name = "aging"
    goal: Vector = Vector("q_d", "rad", tuned=lambda tuning: tuning.goal)
    stiffness: Gain = Gain("K_p", "N·m/rad", tuned=lambda tuning: tuning.stiffness)
    damping: Gain = Gain("C", "N·m·s/rad", tuned=lambda tuning: tuning.damping)
    time_span = 5.0

    def factor(self, t):
        return 0.5 + 0.5 * np.exp(-t)

    def storage(self, t, x, state, measured=NOTHING):
        error = x.position_error(self.goal)
        return x.kinetic_energy + 0.5 * self.factor(t) * float(error @ self.stiffness @ error)

    def target(self, t, x, state, measured=NOTHING):
        error = x.position_error(self.goal)
        gradient = self.factor(t) * self.stiffness @ error
        return Target.mechanical(x, self.interconnection, error=error, gradient=gradient, damping=self.damping)


class AgesFast(Aging):
    """Its runs do not balance without ∂H_d/∂t."""

    def factor(self, t):
        return 0.1 + 0.9 * np.exp(-20.0 * t)


class Stiffens(Aging):
    """It gains energy by the clock."""

    def factor(self, t):
        return 1.0 - 0.5 * np.exp(-t)


class StiffensLate(Aging):
    """... from the fourth second on."""

    def factor(self, t):
        return 0.5 + 0.5 * np.exp(-t) + (0.2 * (t - 4.0) ** 2 if t > 4.0 else 0.0)


class FadesAway(Aging):
    """In the end nothing is left that holds the arm."""

    def factor(self, t):
        return np.exp(-t)


class StorageForgetsTime(Aging):
    """H_d is said to stay."""

    def storage(self, t, x, state, measured=NOTHING):
        return super().storage(0.0, x, state, measured)


class GradientForgetsTime(Aging):
    """The target is said to stay."""

    def target(self, t, x, state, measured=NOTHING):
        return super().target(0.0, x, state, measured)


class Steps(Aging):
    """Softer all of a sudden."""

    def factor(self, t):
        return 1.0 if t < 2.5 else 0.5


class DeeperBeside(Aging):
    """A deeper minimum 0.8 rad beside its goal."""

    def _dent(self, x):
        return 10.0 * float(np.exp(-((10.0 * (x.position_error(self.goal)[0] - 0.8)) ** 2)))

    def storage(self, t, x, state, measured=NOTHING):
        return super().storage(t, x, state, measured) - self._dent(x)

    def target(self, t, x, state, measured=NOTHING):
        target = super().target(t, x, state, measured)
        gradient = target.gradient.copy()
        gradient[0] += 200.0 * (x.position_error(self.goal)[0] - 0.8) * self._dent(x)
        return replaced(target, gradient=gradient)


@pytest.mark.parametrize("law", [Aging, AgesFast])
def test_a_stiffness_that_falls_with_time_is_right(law):
    """Ḣ_d = ∇H_dᵀẋ + ∂H_d/∂t, and the last is not positive."""
    certificate = certify(law.tuned(make_system("pera_shoulder")))
    assert certificate.passed, str(certificate)
    assert certificate["growth of H_d with time alone"].value <= 0.0


@pytest.mark.parametrize(
    ("law", "line"),
    [
        (Stiffens, "growth of H_d with time alone"),
        (StiffensLate, "growth of H_d with time alone"),
        (FadesAway, "largest real part at rest [1/s]"),
        (StorageForgetsTime, "gradient residual"),
        (GradientForgetsTime, "gradient residual"),
        (Steps, "jump of H_d between states"),
        (DeeperBeside, "depth of H_d below its rest"),
    ],
)
def test_what_else_changes_with_time_is_not(law, line):
    options = {"stiffness": 25.0} if law is DeeperBeside else {}
    certificate = certify(law.tuned(make_system("pera_shoulder"), **options))
    assert not certificate[line].passed, str(certificate)


# --- memory, jumps, corners -----------------------------------------------------------------------------------


class WakesUp(EnergyShaping):
    """It remembers how long it has been asked at times that run on, and changes after two thousand periods."""

    last, count = -1.0, 0

    def evaluate(self, t, x, state, measured=NOTHING):
        self.count = self.count + 1 if 0.0 < t - self.last < 0.02 else 0
        self.last = t
        command = super().evaluate(t, x, state, measured)
        return command._replace(torque=1.3 * command.torque) if self.count > 2000 else command


class JumpsUp(ForceFeedback):
    """Where the arm is fast its state jumps."""

    jumps = True

    def jump(self, t, x, state, measured=NOTHING):
        return 2.0 * state if np.abs(x.velocity).max() > 2.0 else state


class JumpsDown(ForceFeedback):
    """Where the arm is fast its state goes to the calmest one: H_d falls."""

    jumps = True

    def jump(self, t, x, state, measured=NOTHING):
        return self.calmest_state(t, x, state) if np.abs(x.velocity).max() > 2.0 else state


class JumpsUnsaid(JumpsDown):
    """The same, without saying so."""

    jumps = False


def upper_quarter(law, t, x, state, measured):
    robot = x.system.robot
    return (x.position > robot.upper - 0.25 * (robot.upper - robot.lower)).all()


def upper_limits(law, t, x, state, measured):
    return (x.position >= x.system.robot.upper).all()


def two_joints_move(law, t, x, state, measured):
    return np.count_nonzero(x.velocity) == 2


def calmest(law, t, x, state, measured):
    return np.abs(state - law.calmest_state(t, x, state)).max() < 1e-9 and np.abs(x.velocity).max() > 0.1


@pytest.mark.parametrize(
    ("law", "line"),
    [
        (WakesUp, "command that remembers the motion"),
        (JumpsUp, "rise of H_d by a jump"),
        (JumpsUnsaid, "rise of H_d by a jump"),
        (wrong(EnergyShaping, upper_quarter), "matching residual"),
        (wrong(EnergyShaping, upper_limits), "matching residual"),
        (wrong(EnergyShaping, two_joints_move), "matching residual"),
        (wrong(ForceFeedback, calmest), "matching residual"),
    ],
)
def test_what_else_got_through_does_not(law, line):
    certificate = certify(law.tuned(make_system("pera")))
    assert not certificate[line].passed, str(certificate)


def test_a_state_may_jump_to_less_energy():
    certificate = certify(JumpsDown.tuned(make_system("pera_shoulder")))
    assert certificate["rise of H_d by a jump"].passed, str(certificate)
    assert certificate["rise of H_d by a jump"].value == 0.0
