"""What a red team that had not read the certificate got past it once: none passes any more."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    NOTHING,
    EnergyShaping,
    ForceFeedback,
    ImpedanceGrasping,
    IntegralAction,
    MechanicalSystem,
    Schedule,
    Target,
    TrajectoryTracking,
    certify,
    load_robot,
)
from phcontrol.controllers.target import Drive
from tests.conftest import make_system


def replaced(target, **parts):
    names = ("coordinates", "interconnection", "dissipation", "gradient", "port", "drive")
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

    def coordinates(self, t, x, state, measured=NOTHING):
        coordinates = super().coordinates(t, x, state, measured)
        coordinates[: x.system.n] -= self._shift(measured)
        return coordinates

    def storage(self, t, x, state, measured=NOTHING):
        error = x.position_error(self.goal) - self._shift(measured)
        return x.kinetic_energy + float(0.5 * error @ self.stiffness @ error)

    def target(self, t, x, state, measured=NOTHING):
        target, n = super().target(t, x, state, measured), x.system.n
        gradient = target.gradient.copy()
        gradient[:n] -= measured.external_force
        coordinates = self.coordinates(t, x, state, measured)
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
        return self._command(t, x, state, force, np.zeros(0))


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
            ._replace(effort=-self._slope(x) - x.injected_damping(self.damping, x.velocity))
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

    def target(self, t, x, state, measured=NOTHING):
        target = super().target(t, x, state, measured)
        return replaced(target, coordinates=target.coordinates + 1.0)


class DrivenByItsState(EnergyShaping):
    """A drive that enters no momentum, by a signal that is the arm's position."""

    driven_by = "the stars"

    def target(self, t, x, state, measured=NOTHING):
        target, n = super().target(t, x, state, measured), x.system.n
        return replaced(target, drive=Drive(np.zeros((2 * n, n)), x.position))


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
    RunawayGoal: "drive that is declared",
    OtherCoordinates: "target's coordinates are others",
    DrivenByItsState: "drive that depends on the state",
}


@pytest.mark.parametrize("law", CASES, ids=lambda law: law.__name__)
def test_it_does_not_pass_any_more(law):
    plant = MechanicalSystem(load_robot("ur5"), friction=None)
    certificate = certify(law.tuned(plant, plant.robot.near_home()))
    assert not certificate.passed, str(certificate)
    assert certificate.error if CASES[law] == "error" else not certificate[CASES[law]].passed, str(certificate)


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
            return super().shape(t, x, state, measured)._replace(effort=effort)

        def storage(self, t, x, state, measured=NOTHING):
            return super().storage(t, x, state, measured) - self._depth(x)

        def target(self, t, x, state, measured=NOTHING):
            target = super().target(t, x, state, measured)
            return replaced(target, gradient=np.concatenate([self._slope(x), x.transformed_momentum]))

    certificate = certify(Deeper.tuned(make_system("pera_shoulder"), stiffness=25.0))  # ½·25·0.8² = 8 < 10
    assert certificate.matching_passed, str(certificate)
    assert not certificate["depth of H_d below its rest"].passed, str(certificate)
