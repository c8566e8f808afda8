"""Laws that are wrong somewhere, or promise too little: none may get a certificate."""

from __future__ import annotations

import itertools
from functools import cache

import numpy as np
import pytest

from phcontrol import (
    NOTHING,
    ClassicalImpedance,
    EnergyShaping,
    ForceControl,
    ForceFeedback,
    ForceRegulation,
    ImpedanceGrasping,
    IntegralAction,
    MechanicalSystem,
    MinimumJerk,
    PHControlError,
    StribeckFriction,
    Target,
    TotalForceRejection,
    TrajectoryTracking,
    certify,
    equilibrium,
    force_control_conditions,
    l2_gain,
    load_robot,
    make_controller,
)
from phcontrol.controllers.command import Command
from phcontrol.controllers.target import Drive
from tests.conftest import make_system

KICK = 5.0  # [N·m]


@cache
def system(arm):
    return make_system(arm)


def wrong(law, where, kick=KICK):
    """Return the law with a torque added at all joints where the condition on (t, x, state, f_e) holds."""

    class Wrong(law):
        def evaluate(self, t, x, state, measured=NOTHING):
            command = super().evaluate(t, x, state, measured)
            if not where(self, t, x, state, measured):
                return command
            added = kick(x) if callable(kick) else kick
            return command._replace(torque=command.torque + added)

    return Wrong


def near_goal(radius):
    return lambda law, t, x, state, measured: np.linalg.norm(x.position_error(law.goal)) < radius


def slower(speed):
    return lambda law, t, x, state, measured: np.abs(x.velocity).max() < speed


def faster(speed):
    return lambda law, t, x, state, measured: np.abs(x.velocity).max() > speed


def close_to_a_limit(share):
    def where(law, t, x, state, measured):
        robot = x.system.robot
        width = share * (robot.upper - robot.lower)
        return ((x.position < robot.lower + width) | (x.position > robot.upper - width)).any()

    return where


def outside_limits(law, t, x, state, measured):
    robot = x.system.robot
    return ((x.position < robot.lower) | (x.position > robot.upper)).any()


def state_beyond(size):
    return lambda law, t, x, state, measured: np.abs(state).max() > size


def state_below(size):
    return lambda law, t, x, state, measured: np.abs(state).max() < size


def force_beyond(size):
    return lambda law, t, x, state, measured: np.abs(measured.external_force).max() > size


def no_force(law, t, x, state, measured):
    return not measured.external_force.any()


def later(time):
    return lambda law, t, x, state, measured: t > time


def between(start, end):
    return lambda law, t, x, state, measured: start < t < end


def joint_in(joint, low, high):
    return lambda law, t, x, state, measured: low < x.position[joint] < high


def moving(joint, low, high):
    return lambda law, t, x, state, measured: low < x.velocity[joint] < high


WRONG_SOMEWHERE = {
    "near the goal": (EnergyShaping, "pera", near_goal(0.3)),
    "nearer to the goal": (EnergyShaping, "pera", near_goal(0.01)),
    "at the goal itself": (EnergyShaping, "pera", near_goal(1e-9)),
    "close to rest": (EnergyShaping, "pera", slower(0.2), lambda x: 60.0 * x.velocity),
    "at rest": (EnergyShaping, "pera", slower(1e-12)),
    "fast": (EnergyShaping, "pera", faster(4.0)),
    "fast on the panda": (EnergyShaping, "panda", faster(4.0)),
    "0.5 % from a joint limit": (EnergyShaping, "pera", close_to_a_limit(0.005)),
    "0.5 % from a joint limit of the panda": (EnergyShaping, "panda", close_to_a_limit(0.005)),
    "outside the limits": (EnergyShaping, "panda", outside_limits),
    "beyond one turn": (EnergyShaping, "ur5", lambda law, t, x, s, m: np.abs(x.position).max() > 2.0 * np.pi),
    "beyond half a turn": (EnergyShaping, "ur5", lambda law, t, x, s, m: np.abs(x.position[0]) > np.pi),
    "beyond a turn of a continuous joint": (
        EnergyShaping, "kinova", lambda law, t, x, s, m: np.abs(x.position).max() > 2.0 * np.pi,
    ),
    "large controller states": (ForceFeedback, "pera", state_beyond(4.0)),
    "large controller states of the panda": (ForceFeedback, "panda", state_beyond(4.0)),
    "small controller states": (ForceFeedback, "pera", state_below(1e-3)),
    "a large integral": (IntegralAction, "pera", lambda law, t, x, s, m: np.abs(s[7:]).max() > 4.0),
    "large forces": (TotalForceRejection, "pera", lambda law, t, x, s, m: np.abs(m.total_force).max() > 20.0),
    "forces beyond 20 N·m": (ImpedanceGrasping, "pera", force_beyond(20.0)),
    "no force at all": (ImpedanceGrasping, "pera", no_force),
    "late": (EnergyShaping, "pera", later(10.0)),
    "later": (EnergyShaping, "pera", later(1e3)),
    "between 3 and 5 s": (EnergyShaping, "pera", between(3.0, 5.0)),
    "late on a trajectory": (TrajectoryTracking, "pera", later(10.0)),
    "one joint, a tenth of its way": (EnergyShaping, "pera", joint_in(4, 0.9, 1.3)),
    "one joint, a span of speeds": (EnergyShaping, "pera", moving(2, 0.3, 0.5)),
    "one joint moving backwards": (EnergyShaping, "pera", moving(6, -np.inf, 0.0)),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG_SOMEWHERE)
def test_a_law_that_is_wrong_somewhere_gets_no_certificate(name):
    law, arm, where, *kick = WRONG_SOMEWHERE[name]
    made = wrong(law, where, *kick).tuned(system(arm))
    assert certify(law.tuned(system(arm))).passed
    certificate = certify(made)
    assert not certificate.passed, str(certificate)
    assert "FAILED" in str(certificate)


def test_a_law_that_is_wrong_only_late_on_a_long_trajectory():
    robot = system("pera").robot
    trajectory = MinimumJerk(robot.home, robot.near_home(), 100.0)
    options = {"trajectory": trajectory}
    assert certify(TrajectoryTracking.tuned(system("pera"), **options)).passed
    assert not certify(wrong(TrajectoryTracking, between(80.0, 90.0)).tuned(system("pera"), **options)).passed


# --- promises that are empty, false or not kept -----------------------------------------------------


def negative_stiffness(arm):
    """K_p negative definite: every row matches, R_d ⪰ 0, and the loop runs away from its goal."""
    law = make_controller("energy_shaping", system(arm))
    law.potential.stiffness = -law.stiffness
    return law


def saddle(arm):
    """K_p with one negative eigenvalue."""
    law = make_controller("energy_shaping", system(arm))
    gains = np.array(np.diag(law.stiffness))
    gains[-1] = -gains[-1]
    law.potential.stiffness = np.diag(gains)
    return law


class Trivial(EnergyShaping):
    """It promises nothing."""

    def storage(self, t, x, state, measured=None):
        return 0.0

    def coordinates(self, t, x, state, measured=None):
        return np.zeros(0)

    def target(self, t, x, state, measured=None):
        return Target(np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0), np.zeros((0, x.system.n)))


class TrivialAndWrong(Trivial):
    """... and does what it likes."""

    def evaluate(self, t, x, state, measured=None):
        return Command(7.0 * np.ones(x.system.n) * x.velocity**3, np.zeros(0))


def driven(declared, in_momentum, signal):
    """A torque of any kind, put down as what drives the loop."""

    class Driven(EnergyShaping):
        caveat = "anything"
        driven_by = "a ghost" if declared else ""
        lacks_minimum = "faith"

        def torque_added(self, t, x):
            return signal(t, x)

        def evaluate(self, t, x, state, measured=NOTHING):
            command = super().evaluate(t, x, state, measured)
            return command._replace(torque=command.torque + self.torque_added(t, x))

        def target(self, t, x, state, measured=NOTHING):
            target = super().target(t, x, state, measured)
            n = x.system.n
            port = np.vstack([np.zeros((n, n)), x.solve_factor(np.eye(n))])
            drive = Drive(port, self.torque_added(t, x))
            return Target(
                target.coordinates, target.interconnection, target.dissipation, target.gradient, target.port, drive
            )

    return Driven


class ReadsMore(EnergyShaping):
    """needs = (), but it reads f_e."""

    def shape(self, t, x, state, measured):
        law = super().shape(t, x, state, measured)
        return law if measured.external_force is None else law._replace(cancelled_force=measured.external_force)


class NeedsMore(EnergyShaping):
    """needs = (), but it cannot do without f_e."""

    def shape(self, t, x, state, measured):
        return (
            super().shape(t, x, state, measured)._replace(cancelled_force=self._measurement(measured, "external_force"))
        )


class HiddenState(EnergyShaping):
    """A filter of the velocity, kept on the law itself."""

    filtered = 0.0

    def shape(self, t, x, state, measured):
        self.filtered = 0.99 * self.filtered + 0.01 * x.velocity
        law = super().shape(t, x, state, measured)
        return law._replace(effort=law.effort - 0.1 * self.filtered)


class TiresAfterAThousandCalls(EnergyShaping):
    """Right for a thousand calls, and then not."""

    calls = 0

    def shape(self, t, x, state, measured):
        self.calls += 1
        law = super().shape(t, x, state, measured)
        return law if self.calls < 1000 else law._replace(effort=1.1 * law.effort)


class RemembersTheTime(EnergyShaping):
    """Computes once for each time: wrong for another state at the same time."""

    last = (None, None)

    def evaluate(self, t, x, state, measured=NOTHING):
        if self.last[0] is None or abs(t - self.last[0]) > 1e-6:
            self.last = (t, super().evaluate(t, x, state, measured))
        return self.last[1]


class ForgetsAState(ForceFeedback):
    """A state that is in no target: it counts up, and shakes the arm without anybody promising it."""

    @property
    def state_parts(self):
        return super().state_parts | {"counter": 1}

    def evaluate(self, t, x, state, measured=NOTHING):
        command = super().evaluate(t, x, state[: x.system.n], measured)
        return Command(command.torque, np.append(command.state_rate, 1.0))

    def storage(self, t, x, state, measured=NOTHING):
        return super().storage(t, x, state[: x.system.n], measured)

    def coordinates(self, t, x, state, measured=NOTHING):
        return super().coordinates(t, x, state[: x.system.n], measured)

    def target(self, t, x, state, measured=NOTHING):
        return super().target(t, x, state[: x.system.n], measured)

    def calmest_state(self, t, x, state):
        return np.append(super().calmest_state(t, x, state[: x.system.n]), state[x.system.n :])


class Backwards(ForceRegulation):
    """The virtual position moves away from the desired force, three times as fast."""

    def rate(self, external_force):
        return -3.0 * super().rate(external_force)


def regulated(law, regulation):
    made = system("pera_shoulder_elbow")
    return law(made, **(law.default_gains(made, np.zeros(3)) | {"regulation": regulation([0.5, -0.2, 0.1])}))


def tiny_injection(arm):
    """A damping of −10⁻³ in one joint beside 10⁷ in the others."""
    plant = MechanicalSystem(load_robot(arm), friction=None)
    law = make_controller("energy_shaping", plant)
    gains = np.full(plant.n, 1e7)
    gains[3] = -1e-3
    law.__dict__["damping"] = law.__dict__["_joint_damping"] = np.diag(gains)
    law.__dict__["_negative_damping"] = -np.diag(gains)
    return law


def shifted_rest(arm):
    """Gravity at another posture: it rests beside its goal."""

    class Shifted(EnergyShaping):
        def shape(self, t, x, state, measured):
            law = super().shape(t, x, state, measured)
            return law._replace(effort=law.effort + 1e-3)

    return Shifted.tuned(system(arm))


class Raises(EnergyShaping):
    """Gives up fast motion with an error of its own."""

    def shape(self, t, x, state, measured):
        if np.abs(x.velocity).max() > 0.5:
            raise ZeroDivisionError("too fast for me")
        return super().shape(t, x, state, measured)


class Sleeps(EnergyShaping):
    """Promises damping on a plant without any, and has none: marginal."""

    def prepare(self):
        self.damping = np.zeros_like(self.damping)
        super().prepare()


FALSE_PROMISES = {
    "negative stiffness": (lambda: negative_stiffness("pera"), "smallest curvature of H_d at rest"),
    "saddle": (lambda: saddle("pera"), "smallest curvature of H_d at rest"),
    "nothing promised": (lambda: Trivial.tuned(system("pera")), "velocities and states not promised"),
    "nothing promised, anything done": (
        lambda: TrivialAndWrong.tuned(system("pera")), "error",
    ),
    "a drive not declared": (
        lambda: driven(False, True, lambda t, x: x.position).tuned(system("pera")), "drive that is not declared",
    ),
    "a drive that is a torque": (
        lambda: driven(True, True, lambda t, x: np.full(x.system.n, np.sin(t))).tuned(system("pera")),
        "drive in rows of a momentum",
    ),
    "a drive that depends on the state": (
        lambda: driven(True, True, lambda t, x: x.position).tuned(system("pera")), "drive that depends on the state",
    ),
    "reads what it does not need": (lambda: ReadsMore.tuned(system("pera")), "change by what is not needed"),
    "hidden state": (lambda: HiddenState.tuned(system("pera")), "command that is not repeated"),
    "tires": (lambda: TiresAfterAThousandCalls.tuned(system("pera_shoulder")), "matching residual"),
    "remembers the time": (lambda: RemembersTheTime.tuned(system("pera")), "command that is not repeated"),
    "a state not promised": (lambda: ForgetsAState.tuned(system("pera")), "velocities and states not promised"),
    "regulation backwards, grasping": (
        lambda: regulated(ImpedanceGrasping, Backwards), "largest real part at rest [1/s]",
    ),
    "regulation backwards, classical": (
        lambda: regulated(ClassicalImpedance, Backwards), "largest real part at rest [1/s]",
    ),
    "a little energy injected": (lambda: tiny_injection("pera"), "indefiniteness of R_d"),
    "rests beside its goal": (lambda: shifted_rest("pera"), "motion where it should rest"),
    "no damping": (
        lambda: Sleeps.tuned(MechanicalSystem(load_robot("pera"), friction=None)), "largest real part at rest [1/s]",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FALSE_PROMISES)
def test_a_false_promise_gets_no_certificate(name):
    make, line = FALSE_PROMISES[name]
    certificate = certify(make())
    assert not certificate.passed, str(certificate)
    assert certificate.error if line == "error" else not certificate[line].passed, str(certificate)


@pytest.mark.parametrize(("law", "words"), [(Raises, "too fast for me"), (NeedsMore, "needs the measurement")])
def test_a_law_that_raises_gets_no_certificate_but_the_error(law, words):
    certificate = certify(law.tuned(system("pera")))
    assert not certificate.passed
    assert words in certificate.error
    assert words in str(certificate)


@pytest.mark.parametrize("law", [ImpedanceGrasping, ClassicalImpedance])
def test_regulation_the_right_way_round_passes_as_driven(law):
    certificate = certify(regulated(law, ForceRegulation))
    assert certificate.verdict == "PASSED AS DRIVEN", str(certificate)
    assert "driven by: f_e − f_d" in str(certificate)


@pytest.mark.parametrize("form", ["coriolis", "canonical"])
@pytest.mark.parametrize("arm", ["pera_gripper", "pera_shoulder_elbow", "pera"])
def test_the_approach_of_force_control_is_promised(arm, form):
    """README's own example: matching residual 2.7 to 4.9 in free motion before the approach had a target of its own."""
    plant = system(arm)
    law = ForceControl(
        plant, force=np.full(plant.n, 3.5), damping=5.0, coupling=1.0, force_gain=1.0, approach_speed=0.2,
        interconnection=form,
    )  # fmt: skip
    certificate = certify(law)
    assert certificate.verdict == "PASSED AS DRIVEN", str(certificate)
    assert certificate.matching_residual < 1e-7


def test_a_wrong_approach_is_caught():
    """The feedforward does not wait until there is contact, as it says."""

    class Hasty(ForceControl):
        def shape(self, t, x, state, measured):
            law = super().shape(t, x, state, measured)
            if not self._approaches(measured):
                return law
            return law._replace(effort=law.effort - 0.1 * self.desired.gradient(x))

    plant = system("pera_gripper")
    law = Hasty(plant, force=[3.5], damping=5.0, coupling=1.0, force_gain=1.0, approach_speed=0.2)
    assert not certify(law).matching_passed


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("law", ["energy_shaping", "force_feedback", "integral_action", "force_control", "tracking"])
def test_light_and_heavy_arms_get_the_same_checks(law, scale, tmp_path):
    """The same arm of a thousandth of its lengths' and masses' scale, and of a thousand times its mass."""
    plant = MechanicalSystem(scaled_arm(scale, tmp_path))
    certificate = certify(make_controller(law, plant))
    assert certificate.passed, str(certificate)


def scaled_arm(scale, folder):
    """Two links: 0.3 m and 1 kg at scale 1, 3 cm and 1 g at 10⁻³, 3 m and 1000 kg at 10³."""
    length, mass = 0.3 * scale ** (1.0 / 3.0), scale
    inertia, effort = mass * length**2 / 12.0, 4.0 * mass * 9.81 * length
    links = "".join(
        f'<link name="l{k}"><inertial><origin xyz="{length / 2} 0 0"/><mass value="{mass}"/><inertia ixx="{inertia}" '
        f'iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        for k in (1, 2)
    )
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="l{k}"/><origin xyz="{at} 0 0"/>'
        f'<axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="3" effort="{effort}"/></joint>'
        for k, parent, at in ((1, "base", 0.0), (2, "l1", length))
    )
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="arm"><link name="base"/>{links}{joints}</robot>')
    return load_robot(path)


def test_a_light_joint_is_not_hidden_by_heavy_ones():
    """10⁻⁴ N·m of friction that the law does not know, in the wrist alone, beside 40 N·m motors."""
    real = MechanicalSystem(load_robot("pera"), friction=StribeckFriction(viscous=[0.5] * 6 + [0.5002]))
    model = MechanicalSystem(load_robot("pera"), friction=StribeckFriction(viscous=0.5))
    law = make_controller("energy_shaping", model)
    assert certify(law, model).passed
    assert not certify(law, real).matching_passed


def test_a_certificate_says_what_it_supports(pera):
    law = make_controller("energy_shaping", pera)
    certificate = certify(law)
    assert certificate.samples == 256
    assert certificate.supported == pytest.approx(0.0116, abs=1e-4)  # 1 − 0.05^(1/256)
    text = str(certificate)
    assert "no violation in 256 states: 95 % sure that less than 1.2 % of the sampled region violates" in text
    assert "at rest: asymptotically stable, slowest time constant" in text
    assert "FAILED" not in text


def test_no_line_failed_stands_under_passed(pera):
    """Whatever is broken: the verdict is FAILED exactly when one of its lines is."""
    laws = [*(make() for make, _ in FALSE_PROMISES.values()), make_controller("tracking", pera)]
    for certificate in map(certify, laws):
        lines = str(certificate).splitlines()
        assert ("FAILED" in lines[0]) == any("FAILED" in line for line in lines[1:]) == (not certificate.passed)


def test_the_slowest_time_constant_is_that_of_a_simulation():
    """The gripper without its spring: m q̈ = −K q̃ − C q̇ has the poles of its characteristic polynomial."""
    plant = system("pera_gripper")
    law = ClassicalImpedance(plant, goal=[0.2], stiffness=1.0, damping=3.0)
    poles = np.roots([0.5, 3.0, 1.0])
    assert certify(law).slowest == pytest.approx(-1.0 / poles.max(), rel=1e-6)


def test_seeds_and_samples_are_part_of_the_certificate(pera):
    law = make_controller("energy_shaping", pera)
    found = {str(certify(law, samples=n, seed=seed)) for n, seed in itertools.product((16, 32), (0, 1))}
    assert len(found) == 4
    assert certify(law, samples=16, seed=3) == certify(law, samples=16, seed=3)


# --- what rests on a promise demands the promise ----------------------------------------------------


class TenthOfItsDamping(ForceFeedback):
    """Its damping is a tenth of what it says and promises."""

    def shape(self, t, x, state, measured):
        law = super().shape(t, x, state, measured)
        adapted = x.velocity - x.solve_factor_transposed(self.coupling.dot(state))
        return law._replace(effort=law.effort + 0.9 * x.injected_damping(self.damping, adapted))


def test_gains_equilibria_and_conditions_need_a_certificate():
    plant = MechanicalSystem(load_robot("pera_shoulder"), friction=None)
    false = TenthOfItsDamping.tuned(plant)
    with pytest.raises(PHControlError, match="(?s)bound of the L₂ gain.*no certificate.*matching residual.*FAILED"):
        l2_gain(false, plant)
    with pytest.raises(PHControlError, match="equilibrium rests on the promise"):
        equilibrium(false, plant, [1.0, 0.0])
    with pytest.raises(PHControlError, match="(?s)L₂ gain.*largest real part"):
        l2_gain(negative_stiffness("pera"), system("pera"))  # an eigenvalue on the right

    class Forgetful(ForceControl):
        def shape(self, t, x, state, measured):
            return super().shape(t, x, state, measured)._replace(offset_rate=None)

    with pytest.raises(PHControlError, match="proof of force control rests on the promise"):
        force_control_conditions(Forgetful.tuned(plant), plant)
