"""What a red team that had not read the certificate got past it once: none passes any more."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    NOTHING,
    Command,
    Controller,
    EnergyShaping,
    ForceControl,
    ForceFeedback,
    ForceRegulation,
    Gain,
    ImpedanceGrasping,
    IntegralAction,
    MechanicalSystem,
    Schedule,
    Target,
    TrajectoryTracking,
    Vector,
    certify,
    load_robot,
)
from phcontrol.analysis.continuity import jump_at_switches
from phcontrol.analysis.natural_units import NaturalUnits
from phcontrol.analysis.rest_point import find_rest
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.target import Drive
from tests.conftest import make_system


def replaced(target, **parts):
    names = ("coordinates", "interconnection", "dissipation", "gradient", "port", "drive", "parts")
    return Target(**({name: getattr(target, name) for name in names} | parts))


class SwitchedGains(EnergyShaping):
    """Stiff while it moves in, soft while it moves out: H_d jumps at every switch, and the loop gains by it."""

    def factor(self, t, x):
        return 3.0 if (x.position_error(self.goal)[0] + 0.05) * (x.velocity[0] - 0.3) < 0.0 else 1.0

    def _scaled(self, t, x):
        stiffness = self.factor(t, x) * self.stiffness
        return EnergyShaping(self.system, goal=self.goal, stiffness=stiffness, damping=self.damping)

    def shape(self, t, x, state, measured):
        return EnergyShaping.shape(self._scaled(t, x), t, x, state, measured)

    def storage(self, t, x, state, measured=NOTHING):
        return EnergyShaping.storage(self._scaled(t, x), t, x, state, measured)

    def target(self, t, x, state, measured=NOTHING):
        return EnergyShaping.target(self._scaled(t, x), t, x, state, measured)


class ScheduledByDistance(SwitchedGains):
    """Gain scheduling in steps, as people do it."""

    def factor(self, t, x):
        return 1.0 + np.floor(4.0 * np.abs(x.position_error(self.goal)).max())


class ScheduledByTheClock(SwitchedGains):
    """Other gains every 0.35 s, and ``time_span`` says that nothing changes."""

    def factor(self, t, x):
        return 1.0 + int(t / 0.35) % 2


class PortOfTheForce(ImpedanceGrasping):
    """An arbitrary torque δ whenever the arm is touched: T⁻¹(f_e + δ) = T⁻¹(1 + δf_eᵀ/|f_e|²)f_e."""

    def _delta(self, x, force):
        return 0.5 * self.damping.dot(x.velocity) if force.any() else np.zeros_like(force)

    def evaluate(self, t, x, state, measured=NOTHING):
        command = super().evaluate(t, x, state, measured)
        return command._replace(torque=command.torque + self._delta(x, measured.external_force))

    def target(self, t, x, state, measured=NOTHING):
        target, force = super().target(t, x, state, measured), measured.external_force
        n, port = x.system.n, target.port.copy()
        if force is not None and force.any():
            port[n : 2 * n] += x.solve_factor(np.outer(self._delta(x, force), force) / force.dot(force))
        return replaced(target, port=port)


class InvertedForce(EnergyShaping):
    """Four times the measured force, backwards: a port −3T⁻¹, passive to an output that no environment has."""

    needs = ("external_force",)

    def shape(self, t, x, state, measured):
        return super().shape(t, x, state, measured)._replace(cancelled_force=4.0 * measured.external_force)

    def target(self, t, x, state, measured=NOTHING):
        target = super().target(t, x, state, measured)
        return replaced(target, port=-3.0 * target.port)


class ForceInCoordinates(EnergyShaping):
    """A plain spring, whose coordinates hold q̃ − K⁻¹f_e: "no force enters, H_d never grows"."""

    needs = ("external_force",)

    def _shift(self, measured):
        force = measured.external_force
        return 0.0 if force is None else np.linalg.solve(self.stiffness, force)

    def storage(self, t, x, state, measured=NOTHING):
        error = x.position_error(self.goal) - self._shift(measured)
        return x.kinetic_energy + float(0.5 * error @ self.stiffness @ error)

    def target(self, t, x, state, measured=NOTHING):
        target, n = super().target(t, x, state, measured), x.system.n
        gradient = target.gradient.copy()
        gradient[:n] -= measured.external_force
        coordinates = target.coordinates.copy()
        coordinates[:n] -= self._shift(measured)
        return replaced(target, coordinates=coordinates, gradient=gradient, port=0.0 * target.port)


class GuardedIntegrator(EnergyShaping):
    """An integral of its own, kept on the law, and reset at every gap: pure between scattered states."""

    def __init__(self, *arguments, **gains):
        super().__init__(*arguments, **gains)
        self.last, self.total = -1.0, 0.0

    def shape(self, t, x, state, measured):
        gap = t - self.last
        self.total = self.total + gap * x.position_error(self.goal) if 0.0 < gap < 0.02 else 0.0
        self.last = t
        law = super().shape(t, x, state, measured)
        return law._replace(effort=law.effort - 5.0 * self.total)


class EveryFiveHundredth(EnergyShaping):
    """Half as much again at every 500th call."""

    calls = 0

    def evaluate(self, t, x, state, measured=NOTHING):
        self.calls += 1
        command = super().evaluate(t, x, state, measured)
        return command if self.calls % 500 else command._replace(torque=1.5 * command.torque)


class WorksInPlace(EnergyShaping):
    """The careless bug: it works in an array that is not its own."""

    def evaluate(self, t, x, state, measured=NOTHING):
        force = x.potential_gradient
        force += super().shape(t, x, state, measured).effort
        return Command(self.system.motor_torque(force), np.zeros(0))


class WritesTheVelocity(EnergyShaping):
    """It halves the velocity that others look at after it."""

    def evaluate(self, t, x, state, measured=NOTHING):
        command = super().evaluate(t, x, state, measured)
        x.velocity[:] *= 0.5
        return command


class OneBuffer(EnergyShaping):
    """Every command is the same array."""

    def evaluate(self, t, x, state, measured=NOTHING):
        command = super().evaluate(t, x, state, measured)
        if not hasattr(self, "buffer"):
            self.buffer = np.empty(x.system.n)
        self.buffer[:] = command.torque
        return command._replace(torque=self.buffer)


class SwitchesGravityOff(EnergyShaping):
    """It forgets gravity, and takes it out of the model that it shares with the plant."""

    def evaluate(self, t, x, state, measured=NOTHING):
        self.system.model.gravity.linear = np.zeros(3)
        return super().evaluate(t, x, state, measured)


class LyingTarget(EnergyShaping):
    """A Target whose ``rate`` says what is wanted."""

    def shape(self, t, x, state, measured):
        law = super().shape(t, x, state, measured)
        return law._replace(effort=0.5 * law.effort)

    def target(self, t, x, state, measured=NOTHING):
        honest, system = super().target(t, x, state, measured), self.system
        torque = self.evaluate(t, x, state, measured).torque

        class Lying(Target):
            def rate(self, external_force):
                acceleration = system.at(x.position, x.velocity).acceleration(torque, external_force)
                return np.concatenate([x.velocity, x.factor.T @ acceleration + x.factor_rate.T @ x.velocity])

        names = ("coordinates", "interconnection", "dissipation", "gradient", "port")
        return Lying(**{name: getattr(honest, name) for name in names})


class DampedForAWhile(EnergyShaping):
    """Its damping ends after half a second, and its target says so."""

    def _damped(self, t):
        return EnergyShaping(
            self.system, goal=self.goal, stiffness=self.stiffness, damping=self.damping * (1.0 if t < 0.5 else 1e-12)
        )

    def shape(self, t, x, state, measured):
        return self._damped(t).shape(t, x, state, measured)

    def target(self, t, x, state, measured=NOTHING):
        return EnergyShaping.target(self._damped(t), t, x, state, measured)


class DampedNearTheGoal(DampedForAWhile):
    """Damping only within 0.01 rad of the goal: it swings for ever."""

    def shape(self, t, x, state, measured):
        return self._damped(1.0 - self._near(x)).shape(t, x, state, measured)

    def target(self, t, x, state, measured=NOTHING):
        return EnergyShaping.target(self._damped(1.0 - self._near(x)), t, x, state, measured)

    def _near(self, x):
        return float(np.abs(x.position_error(self.goal)).max() < 0.01)


class Well(EnergyShaping):
    """A spring within 0.6 rad, and an anti-spring beyond."""

    def _slope(self, x):
        error = x.position_error(self.goal)
        return self.stiffness.dot(error * (1.0 - (error / 0.6) ** 2))

    def shape(self, t, x, state, measured):
        return (
            super()
            .shape(t, x, state, measured)
            ._replace(effort=-self._slope(x) - x.injected_damping(self.damping, x.velocity), complete=False)
        )

    def storage(self, t, x, state, measured=NOTHING):
        error, stiffness = x.position_error(self.goal), np.diag(self.stiffness)
        return x.kinetic_energy + float(stiffness @ (0.5 * error**2 - 0.25 * error**4 / 0.36))

    def target(self, t, x, state, measured=NOTHING):
        target, gradient = super().target(t, x, state, measured), np.empty(2 * x.system.n)
        gradient[: x.system.n], gradient[x.system.n :] = self._slope(x), x.transformed_momentum
        return replaced(target, gradient=gradient)


class RestsElsewhere(EnergyShaping):
    """It says that it goes to its goal, and goes 0.1 rad beside it."""

    def target_posture(self, t):
        return self.goal + 0.1


class AlwaysPushes(EnergyShaping):
    """It claims a minimum of H_d, which only the spring that it is lent gives it."""

    def rest_force(self, x):
        return np.zeros(x.system.n)


class FalsePort(EnergyShaping):
    """The torque filter is told of ten times the losses."""

    def passive_port(self, t, x, state, measured=NOTHING):
        port = super().passive_port(t, x, state, measured)
        return port._replace(dissipated_power=10.0 * port.dissipated_power)


class Excited(ForceFeedback):
    """Its calmest state is an excited one."""

    def calmest_state(self, t, x, state):
        return state + 10.0


class StartsCharged(ForceFeedback):
    """z = 20 to begin with."""

    def initial_state(self, x):
        return np.full(self.state_size, 20.0)


class RunawayGoal(EnergyShaping):
    """It declares what drives it, and nothing does."""

    driven_by = "nothing at all"


class OtherCoordinates(EnergyShaping):
    """The target's coordinates are not those of ``coordinates``."""

    def coordinates(self, t, x, state, measured=NOTHING):
        return super().coordinates(t, x, state, measured) + 1.0


class DrivenByItsState(EnergyShaping):
    """A drive that enters no momentum, by a signal that is the arm's position."""

    driven_by = "the stars"

    def target(self, t, x, state, measured=NOTHING):
        target, n = super().target(t, x, state, measured), x.system.n
        return replaced(target, drive=Drive(np.zeros((2 * n, n)), x.position))


class Virtual(EnergyShaping):
    """A spring to a virtual goal g beside the goal; what moves g is called a drive."""

    driven_by = "an operator"

    @property
    def state_parts(self):
        return {"virtual_goal": self.system.n}

    def rate(self, x, goal):
        raise NotImplementedError

    def _error(self, x, goal):
        return x.position_error(self.goal) - goal

    def shape(self, t, x, state, measured):
        effort = -self.stiffness.dot(self._error(x, state)) - x.injected_damping(self.damping, x.velocity)
        return Shaping(effort, state_rate=self.rate(x, state))

    def storage(self, t, x, state, measured=NOTHING):
        error = self._error(x, state)
        return x.kinetic_energy + float(0.5 * error @ self.stiffness @ error + 0.5 * state @ state)

    def coordinates(self, t, x, state, measured=NOTHING):
        return np.concatenate([self._error(x, state), x.transformed_momentum, state])

    def target(self, t, x, state, measured=NOTHING):
        target, n = super().target(t, x, state, measured), x.system.n
        J, R = np.zeros((2, 3 * n, 3 * n))
        J[: 2 * n, : 2 * n], R[: 2 * n, : 2 * n] = target.interconnection, target.dissipation
        rate = self.rate(x, state)
        return Target(
            coordinates=self.coordinates(t, x, state),
            interconnection=J,
            dissipation=R,
            gradient=np.concatenate([self.stiffness.dot(self._error(x, state)), x.transformed_momentum, state]),
            port=np.vstack([target.port, np.zeros((n, n))]),
            drive=Drive(np.concatenate([-rate, np.zeros(n), rate])[:, None], np.ones(1)),
        )


class DriveOfItsState(Virtual):
    """The virtual goal comes home from near, and runs away from far: ġ = −g, and 2g beyond 0.3."""

    def rate(self, x, goal):
        return np.where(np.abs(goal) > 0.3, 2.0 * goal, -goal)


class DriveOfTheVelocity(Virtual):
    """The virtual goal runs ahead of the motion."""

    def rate(self, x, goal):
        return -goal + 3.0 * x.velocity


class UnsteadyRest(EnergyShaping):
    """It rests somewhere else whenever it is asked."""

    asked = 0

    def rest_posture(self, t):
        self.asked += 1
        return self.goal + 0.1 * np.sin(self.asked)


class UnsteadyStorage(EnergyShaping):
    """Its storage function grows with every question, by what no difference over a run sees."""

    asked = 0

    def storage(self, t, x, state, measured=NOTHING):
        self.asked += 1
        return super().storage(t, x, state, measured) * (1.0 + 1e-11 * self.asked)


class ReadsTheWorkspace(EnergyShaping):
    """1 % of whatever somebody last computed with the model."""

    def evaluate(self, t, x, state, measured=NOTHING):
        left_over = 0.01 * self.system.data.nle
        command = super().evaluate(t, x, state, measured)
        return command._replace(torque=command.torque + left_over)


class CachedByPosition(EnergyShaping):
    """Its torque is remembered under time and position: it forgets that the velocity has changed."""

    def evaluate(self, t, x, state, measured=NOTHING):
        cache, key = self.__dict__.setdefault("cache", {}), (t, x.position.tobytes())
        return cache.setdefault(key, super().evaluate(t, x, state, measured))


CASES = {
    SwitchedGains: "jump of H_d between states",
    ScheduledByDistance: "jump of H_d between states",
    ScheduledByTheClock: "change with time that is not declared",
    PortOfTheForce: "change of the promise with f_e",
    InvertedForce: "output of f_e that is no velocity",
    ForceInCoordinates: "change of the promise with f_e",
    GuardedIntegrator: "command that remembers the motion",
    EveryFiveHundredth: "command that is not repeated",
    WorksInPlace: "command that is not repeated",
    WritesTheVelocity: "command that is not repeated",
    OneBuffer: "command that is not repeated",
    SwitchesGravityOff: "matching residual",
    LyingTarget: "matching residual",
    DampedForAWhile: "change with time that is not declared",
    DampedNearTheGoal: "least dissipation in motion [1/s]",
    Well: "error",  # it runs away
    RestsElsewhere: "distance from its goal at rest",
    AlwaysPushes: "rest in contact only",
    FalsePort: "passive port that is another",
    Excited: "rise of H_d to the calmest state",
    StartsCharged: "energy of the law's initial state",
    RunawayGoal: "states with the drive that is declared",
    OtherCoordinates: "target's coordinates are others",
    DrivenByItsState: "drive that depends on the state",
    DriveOfItsState: "drive that depends on the state",
    DriveOfTheVelocity: "drive that depends on the state",
    UnsteadyRest: "command that is not repeated",
    UnsteadyStorage: "command that is not repeated",
    ReadsTheWorkspace: "command that is not repeated",
    CachedByPosition: "matching residual",
}


@pytest.mark.parametrize("law", CASES, ids=lambda law: law.__name__)
def test_it_does_not_pass_any_more(law):
    plant = MechanicalSystem(load_robot("ur5"), friction=None)
    certificate = certify(law.tuned(plant, plant.robot.near_home()))
    assert not certificate.passed, str(certificate)
    assert certificate.error if CASES[law] == "error" else not certificate[CASES[law]].passed, str(certificate)


class DrivenByTouch(EnergyShaping):
    """p̂ = p̄ − z/2 with ż = −z + gain·f_e, declared as what it is: it pushes at what it touches, or gives way to it."""

    needs = ("external_force",)
    states = ("lag",)
    driven_by = "f_e"
    gain = -40.0

    def _felt(self, x, measured):
        return None

    def storage(self, t, x, state, measured=NOTHING):
        momentum, error = x.transformed_momentum - 0.5 * state, x.position_error(self.goal)
        return float(0.5 * (momentum @ momentum + error @ self.stiffness @ error + state @ state))

    def target(self, t, x, state, measured=NOTHING):
        momentum, error = x.transformed_momentum - 0.5 * state, x.position_error(self.goal)
        n, inverse, structure = x.system.n, x.inverse_factor, x.interconnection(self.interconnection)
        drag = x.transformed_damping
        force = np.zeros(n) if measured.external_force is None else measured.external_force
        return Target.of(
            {"error": (error, self.stiffness @ error), "momentum": (momentum, momentum), "lag": (state, state)},
            {("error", "momentum"): inverse.T, ("error", "lag"): 0.5 * inverse.T, ("momentum", "momentum"): structure,
             ("momentum", "lag"): 0.5 * structure, ("lag", "lag"): 0.25 * structure},
            {("momentum", "momentum"): drag + x.transformed_injection(self.damping), ("momentum", "lag"): 0.5 * drag,
             ("lag", "lag"): 0.25 * drag + np.eye(n)},
            {"momentum": inverse},
            ({"lag": self.gain * np.eye(n)}, force),
        )  # fmt: skip

    shape, passive_port = Controller.shape, Controller.passive_port


def test_what_f_e_drives_is_asked_what_it_does_to_what_it_touches():
    """In free motion it is stable, and so is the loop with a soft spring; a stiff one tells."""
    plant = make_system("pera_shoulder")
    certificate = certify(DrivenByTouch.tuned(plant), samples=64)
    lines = ["largest real part when it is touched [1/s]", "largest real part when it is pushed [1/s]"]
    assert [check.name for check in certificate.checks if not check.passed] == lines
    yielding = type("Yielding", (DrivenByTouch,), {"gain": 5.0})
    assert certify(yielding.tuned(plant), samples=64).verdict == "PASSED AS DRIVEN"


def test_a_schedule_must_hold_what_its_law_does_not_use():
    """ξ winds up while the first law acts, which does not know it."""

    class Winding(Schedule):
        def evaluate(self, t, x, state, measured=NOTHING):
            command = super().evaluate(t, x, state, measured)
            rate = command.state_rate.copy()
            rate[2:] += 0.1 if t < 5.0 else 0.0
            return command._replace(state_rate=rate)

    plant = make_system("pera_shoulder")
    laws = [(0.0, ForceFeedback.tuned(plant)), (5.0, IntegralAction.tuned(plant))]
    assert certify(Schedule(laws)).passed
    assert not certify(Winding(laws))["velocities and states not promised"].passed


def test_each_phase_of_a_schedule_is_looked_at():
    """A torque that is off in one second out of a thousand."""

    class WrongForASecond(EnergyShaping):
        def shape(self, t, x, state, measured):
            law = super().shape(t, x, state, measured)
            return law._replace(effort=law.effort + 2.0 * np.abs(x.position_error(self.goal)))

    plant = make_system("pera_shoulder")
    right = EnergyShaping.tuned(plant)
    assert not certify(Schedule([(0.0, right), (1000.0, WrongForASecond.tuned(plant)), (1001.0, right)])).passed


def test_a_trajectory_that_goes_on_after_its_duration_is_followed():
    """It says two seconds and moves for ten; wrong in the eighth."""
    from phcontrol import MinimumJerk

    class Understated(MinimumJerk):
        duration = 2.0

    class WrongInTheEighth(TrajectoryTracking):
        def evaluate(self, t, x, state, measured=NOTHING):
            command = super().evaluate(t, x, state, measured)
            return command._replace(torque=command.torque + 2.0) if 7.0 < t < 8.5 else command

    plant = make_system("ur5")
    trajectory = Understated(plant.robot.home, plant.robot.near_home(), 10.0)
    assert not certify(WrongInTheEighth.tuned(plant, trajectory=trajectory)).matching_passed


def test_a_deeper_minimum_beside_the_goal_is_seen():
    """H_d has a strict minimum at the goal, and a deeper one 0.8 rad beside it: −10 exp(−(10(q̃₁ − 0.8))²)."""

    class Deeper(EnergyShaping):
        def _depth(self, x):
            return 10.0 * float(np.exp(-((10.0 * (x.position_error(self.goal)[0] - 0.8)) ** 2)))

        def _slope(self, x):
            slope = self.stiffness.dot(x.position_error(self.goal))
            slope[0] += 200.0 * (x.position_error(self.goal)[0] - 0.8) * self._depth(x)
            return slope

        def shape(self, t, x, state, measured):
            effort = -self._slope(x) - x.injected_damping(self.damping, x.velocity)
            return super().shape(t, x, state, measured)._replace(effort=effort, complete=False)

        def storage(self, t, x, state, measured=NOTHING):
            return super().storage(t, x, state, measured) - self._depth(x)

        def target(self, t, x, state, measured=NOTHING):
            target = super().target(t, x, state, measured)
            return replaced(target, gradient=np.concatenate([self._slope(x), x.transformed_momentum]))

    certificate = certify(Deeper.tuned(make_system("pera_shoulder"), stiffness=25.0))  # ½·25·0.8² = 8 < 10
    assert certificate.matching_passed, str(certificate)
    assert not certificate["depth of H_d below its rest"].passed, str(certificate)


# --- what is not forbidden, but said ------------------------------------------------------------------


def test_the_jump_of_the_energy_at_a_switch_is_said():
    """From K to 3K, H_d jumps by q̃ᵀK q̃; from A to A′ in the dynamic extension by ½|p̄ − A′z|² − ½|p̄ − A z|²."""
    plant = make_system("pera_shoulder")
    goal = plant.robot.near_home()
    soft = EnergyShaping.tuned(plant, goal)
    stiff = EnergyShaping.tuned(plant, goal, stiffness=3.0 * soft.stiffness)
    generator = np.random.default_rng(4)
    states = [
        SampledState(0.0, position, velocity, np.zeros(0), np.zeros(2), None, "")
        for position, velocity in generator.uniform(-1.0, 1.0, (64, 2, 2))
    ]
    errors = np.array([at.position - goal for at in states])
    expected = np.einsum("ki,ij,kj->k", errors, soft.stiffness, errors).max()
    schedule = Schedule([(0.0, soft), (2.0, stiff), (5.0, soft)])
    assert jump_at_switches(schedule, plant, states) == pytest.approx(expected, rel=1e-12)
    assert jump_at_switches(soft, plant, states) is None

    certificate = certify(schedule)
    assert certificate.passed
    assert certificate.jump_at_switches > 1.0
    assert f"at its switches H_d jumps by up to {certificate.jump_at_switches:.3g} J" in str(certificate)
    assert certify(Schedule([(0.0, soft), (2.0, soft)])).jump_at_switches == 0.0
    assert "at its switches" not in str(certify(soft))


def test_the_power_of_a_drive_is_said():
    """Regulation moves q_f by v, which takes −vᵀK_p e out of H_d: at most so much of the sampled states."""
    plant = make_system("pera_shoulder")
    law = ImpedanceGrasping.tuned(plant, regulation=ForceRegulation(np.full(2, 0.2)))
    certificate = certify(law)
    assert certificate.verdict == "PASSED AS DRIVEN"
    assert certificate.drive_power > 0.0
    assert f"which brings in up to {certificate.drive_power:.3g} W" in str(certificate)
    assert certify(ImpedanceGrasping.tuned(plant)).drive_power is None


def test_a_drive_of_a_micrometre_a_second_brings_in_microwatts():
    """|vᵀK_p e| ≤ |v| |K_p| |e|, of an error of a hundred turns at most."""
    plant = make_system("pera_shoulder")
    law = ImpedanceGrasping.tuned(plant, regulation=ForceRegulation(np.full(2, 0.2), rate_limit=1e-6))
    most = np.sqrt(2.0) * 1e-6 * np.linalg.norm(law.stiffness, 2) * 200.0 * np.pi
    assert 0.0 < certify(law, samples=32).drive_power < most < 1.0


# --- right laws that once failed --------------------------------------------------------------------------


@pytest.mark.parametrize("gains", [{"integral_gain": 1e6}, {"coupling": 1e6, "force_gain": 1e-6}], ids=str)
def test_right_laws_with_extreme_gains_pass(gains):
    common = {"stiffness": 100.0, "damping": 10.0, "coupling": 0.5, "force_gain": 2.0}
    law = IntegralAction if "integral_gain" in gains else ForceFeedback
    plant = make_system("pera_shoulder")
    certificate = certify(law(plant, goal=plant.robot.near_home(), **common | gains))
    assert certificate.passed, str(certificate)


def test_modes_that_differ_by_a_factor_of_1e9_are_told_apart():
    """The spectrum, by differences of the true rate, is that of (J − R)∂²H_d, the promise's own."""
    plant = make_system("panda")
    n, goal = plant.n, plant.robot.near_home()
    law = IntegralAction(
        plant, goal=goal, stiffness=100.0, damping=10.0, coupling=0.5, force_gain=2.0, integral_gain=1e6
    )
    target = law.target(0.0, plant.at(goal), np.zeros(2 * n))
    curvature = np.diag(np.repeat([100.0, 1.0, 0.5, 1.0], n))
    expected = np.sort(np.linalg.eigvals((target.interconnection - target.dissipation) @ curvature).real)
    found = find_rest(law, plant, NaturalUnits.of(law, plant, 0.0), 0.0)
    assert found.stability == "asymptotically stable"
    np.testing.assert_allclose(np.sort(found.eigenvalues.real), expected, rtol=1e-6, atol=1e-6)
    assert found.slowest == pytest.approx(-1.0 / expected[-1], rel=1e-3)


def test_a_stiff_arm_that_follows_a_trajectory_passes():
    """Its runs last 0.2 ms; differences in time must not reach back beyond the beginning of the trajectory."""
    plant = MechanicalSystem(load_robot("xarm7"))
    certificate = certify(TrajectoryTracking.tuned(plant, plant.robot.near_home(), measured=True))
    assert certificate.matching_passed, str(certificate)


def test_a_schedule_whose_drive_is_a_force_of_0_passes():
    plant = make_system("pera_shoulder")
    laws = [(0.0, EnergyShaping.tuned(plant)), (5.0, ForceControl.tuned(plant, approach_speed=0.3))]
    assert certify(Schedule(laws)).verdict == "PASSED AS DRIVEN"


class CalmsFarAwayWrongly(ForceFeedback):
    """Where z is large its calmest state is twice as far: filters would be told to put energy in."""

    def calmest_state(self, t, x, state):
        calm = super().calmest_state(t, x, state)
        return 2.0 * state if np.abs(state).max() > 10.0 else calm


class CalmsAtRestWrongly(ForceFeedback):
    """The same at rest."""

    def calmest_state(self, t, x, state):
        calm = super().calmest_state(t, x, state)
        return calm + 5.0 if np.abs(x.velocity).max() < 1e-3 else calm


class StartsCharged(ForceFeedback):
    """Far from its goal, or moving, it starts with energy of its own."""

    def initial_state(self, x):
        far = np.abs(x.position_error(self.goal)).max() > 0.7
        return np.full(self.state_size, 100.0 if far else 0.0)


class QuarticHill(Controller):
    """H_d = ½|p̄|² − 2Σq̃⁴: no minimum, as it says, and no bound either."""

    name = "quartic_hill"
    goal: Vector = Vector("q_d", "rad", tuned=lambda tuning: tuning.goal)
    damping: Gain = Gain("C", "N·m·s/rad", tuned=lambda tuning: 1.0)

    lacks_minimum = "a hill"

    def storage(self, t, x, state, measured=NOTHING):
        return x.kinetic_energy - 2.0 * float((x.position_error(self.goal) ** 4).sum())

    def target(self, t, x, state, measured=NOTHING):
        error = x.position_error(self.goal)
        return Target.mechanical(x, self.interconnection, error=error, gradient=-8.0 * error**3, damping=self.damping)


@pytest.mark.parametrize(
    ("law", "line"),
    [
        (CalmsFarAwayWrongly, "rise of H_d to the calmest state"),
        (CalmsAtRestWrongly, "rise of H_d to the calmest state"),
        (StartsCharged, "energy that it starts with"),
        (QuarticHill, "depth of H_d below its rest"),
    ],
)
def test_what_the_third_round_found_fails(law, line):
    certificate = certify(law.tuned(make_system("pera_shoulder")))
    assert not certificate.passed
    assert not certificate[line].passed, str(certificate)


def test_a_jump_half_a_turn_away_is_said():
    plant = MechanicalSystem(load_robot("kinova"))
    apart = EnergyShaping.tuned(plant)
    coupled = 20.0 * np.eye(plant.n) + 5.0
    together = EnergyShaping.tuned(plant, stiffness=coupled)
    assert certify(apart, samples=32).jump_at_half_turns is None
    certificate = certify(together, samples=32)
    assert certificate.jump_at_half_turns > 1.0
    assert "half a turn" in str(certificate)
