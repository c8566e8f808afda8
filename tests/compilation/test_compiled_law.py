"""Compiled laws order what interpreted ones do, keep the contract, and are refused where they would not."""

from __future__ import annotations

import copy
import math
import pickle
import threading
import time

import numpy as np
import pinocchio as pin
import pytest

import phcontrol.compilation.compiled_law as compiled_law_module
from phcontrol import (
    CompilationError,
    CompilationWarning,
    Controller,
    CubicSpline,
    EnergyShaping,
    FrameLine,
    FrameSpring,
    Gain,
    InvalidArgumentError,
    Measured,
    MechanicalSystem,
    MinimumJerk,
    MissingMeasurementError,
    NotTraceableError,
    Positive,
    Schedule,
    StribeckFriction,
    Target,
    TrajectoryTracking,
    Vector,
    certify,
    compile_law,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.compilation import _plain_caller
from phcontrol.compilation.compiled_law import CompiledLaw
from phcontrol.compilation.instants import instants
from phcontrol.controllers.registry import CONTROLLERS
from tests.conftest import make_system

pytestmark = pytest.mark.usefixtures("compiler")

TOLERANCE = 1e-9


def differences(law, compiled, count=12, seed=7):
    """Return the relative differences of torque and state rate at random instants, through ``evaluate``."""
    found = []
    for instant, command in instants(law, count, seed):
        x = law.system.at(instant.position, instant.velocity)
        answer = compiled.evaluate(instant.time, x, instant.state, instant.measured)
        for one, other in zip(answer, command, strict=True):
            found.append(np.abs(one - other).max(initial=0.0) / max(np.abs(other).max(initial=0.0), 1e-3))
    return np.array(found)


QUICK = [("energy_shaping", "coriolis"), ("force_feedback_measured", "coriolis"), ("tracking", "canonical"),
         ("integral_action", "coriolis"), ("total_force_rejection", "coriolis")]  # fmt: skip


@pytest.mark.parametrize(("name", "form"), QUICK)
def test_a_few_laws_on_two_joints(name, form, shoulder):
    law = make_controller(name, shoulder, interconnection=form)
    compiled = compile_law(law)
    assert isinstance(compiled, type(law))
    assert compiled.report.difference <= TOLERANCE
    assert differences(law, compiled).max() <= TOLERANCE
    assert compiled.step.counts[1] == 0  # C answered always


CARTESIAN = [name for name, entry in CONTROLLERS.items() if "cartesian" in entry.law.run]


def test_a_cartesian_law_whose_damping_is_by_eigenvectors():
    law = make_controller("cartesian_impedance", make_system("ur5"))
    compiled = compile_law(law)
    assert differences(law, compiled).max() <= 1e-12
    assert compiled.step.counts[1] == 0
    softer = compiled.changed(translational_stiffness=[200.0, 300.0, 400.0], damping_ratio=1.0)
    assert differences(softer.interpreted, softer).max() <= 1e-12
    assert certify(compiled, samples=4).passed


@pytest.mark.parametrize("name", ["cartesian_impedance", "cartesian_tracking"])
def test_a_cartesian_law_has_one_way_through_singular_postures_valves_and_ramps(name):
    """From clear of the stretched arm through what is damped there, with the tank empty, low, half full and full."""
    system, generator = make_system("ur5"), np.random.default_rng(1)
    law = make_controller(
        name, system, posture="tank", preferred_posture=system.robot.home, posture_stiffness=np.full(6, 20.0)
    )
    compiled, damped = compile_law(law), 0
    assert compiled.report.ways == 1
    levels = [law.tank.state(level) for level in (0.005, 0.1, 2.0, 4.9, 6.0)]
    for k, elbow in enumerate([1.0, 0.3, 0.12, 0.06, 0.03, 0.01, 1e-3, -0.02]):
        q, v = system.robot.near_home(), generator.normal(size=6)
        q[2] = elbow
        x, state = system.at(q, v), np.array([levels[k % 5]])
        damped += x.task_space(law.frame).damped is not None
        t = [-0.5, 0.0, 0.4, 1.0, 3.0, 9.0][k % 6]
        for one, other in zip(compiled.step(t, q, v, state), law.evaluate(t, x, state), strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-8 * max(1.0, float(np.abs(other).max())))
    assert 2 <= damped <= 6
    assert compiled.step.counts[1] == 0


@pytest.mark.study
@pytest.mark.parametrize("arm", ["panda", "ur5"])
@pytest.mark.parametrize("name", CARTESIAN)
def test_cartesian_laws_in_every_form(name, arm):
    system = make_system(arm)
    for form in CONTROLLERS[name].law.forms:
        law = make_controller(name, system, interconnection=form)
        compiled = compile_law(law)
        assert differences(law, compiled, 24).max() <= TOLERANCE, form
        assert compiled.report.ways == 1, form
        assert compiled.step.counts[1] == 0, form
        assert certify(compiled, samples=6).passed, form


@pytest.mark.study
@pytest.mark.parametrize("arm", ["pera", "pera_gripper", "panda_with_fingers", "ur5", "kinova"])
@pytest.mark.parametrize("name", [name for name, entry in CONTROLLERS.items() if "cartesian" not in entry.law.run])
def test_every_law_in_every_form_on_several_arms(name, arm):
    """Mimic joints, prismatic and continuous ones are among them."""
    system, entry = make_system(arm), CONTROLLERS[name]
    if system.n < entry.minimum_joints:
        pytest.skip("needs more joints")
    for form in entry.law.forms:
        law = make_controller(name, system, interconnection=form)
        compiled = compile_law(law)
        assert differences(law, compiled, 24).max() <= TOLERANCE, form
        asked, left = compiled.step.counts
        assert asked > 0
        assert left == 0, form
        assert certify(compiled, samples=6).passed, form


def potential_and_path(system):
    x = system.at(system.robot.home)
    pose = x.placement("tool")
    goal = copy.copy(pose)
    goal.translation = pose.translation + np.array([0.05, -0.05, 0.05])
    spring = FrameSpring("tool", pose, translational_stiffness=300.0, rotational_stiffness=8.0)
    return spring, FrameLine("tool", pose, goal, 2.0)


@pytest.mark.study
def test_potentials_references_and_an_input_matrix(pera, rng):
    spring, path = potential_and_path(pera)
    robot = pera.robot
    way = MinimumJerk.within_limits(robot, robot.home, robot.near_home())
    stops = CubicSpline([0.0, 1.0, 2.0], np.array([robot.home, robot.near_home(), robot.home]))
    turned = MechanicalSystem(load_robot("pera"), input_matrix=np.eye(7) + 0.2 * rng.normal(size=(7, 7)))
    first, second = (make_controller(name, pera) for name in ("energy_shaping", "force_feedback"))
    for law in (
        make_controller("integral_action", pera, potential=spring),
        make_controller("force_feedback", pera, potential=spring, reference=path),
        make_controller("force_feedback", pera, reference=way),
        TrajectoryTracking.tuned(pera, trajectory=stops, hold=1e-3),
        make_controller("force_control", pera, approach_speed=0.2),
        make_controller("impedance_grasping", turned),
        make_controller("hamiltonian_servo", pera, lost="hold"),
        Schedule([(0.0, first), (1.0, second)]),
    ):
        compiled = compile_law(law)
        assert differences(law, compiled, 24).max() <= TOLERANCE, law.name
        asked, left = compiled.step.counts
        assert left <= 0.5 * asked


def test_a_motion_with_a_beginning_and_an_end_is_right_before_within_and_after(shoulder):
    """One way through its branches alone would be wrong by the reference's acceleration in the others."""
    robot = shoulder.robot
    motion = MinimumJerk(robot.home, robot.near_home(), 1.0, start=0.5)
    law = make_controller("energy_shaping", shoulder, reference=motion)
    compiled = compile_law(law)
    assert compiled.report.ways == 3
    x, state = shoulder.at([0.1, 0.2], [0.3, -0.4]), np.zeros(0)
    for t in (-1.0, 0.0, 0.5, 0.7, 1.2, 1.5, 9.0):
        expected = law.evaluate(t, x, state).torque
        np.testing.assert_allclose(compiled.evaluate(t, x, state).torque, expected, rtol=1e-12)
    assert compiled.step.counts[1] == 0


def test_time_is_no_constant(shoulder):
    law = make_controller("tracking", shoulder)
    compiled = compile_law(law)
    x = shoulder.at([0.1, 0.2])
    torques = [compiled.evaluate(t, x, np.zeros(0)).torque for t in (0.1, 0.9)]
    assert np.abs(torques[0] - torques[1]).max() > 1e-3
    np.testing.assert_allclose(torques[1], law.evaluate(0.9, x, np.zeros(0)).torque, rtol=1e-12)


def test_a_whole_run_is_the_same(shoulder):
    """The largest difference over the run, not that at its end: a damped loop forgets its errors."""
    law = make_controller("force_feedback", shoulder, goal=[0.4, 0.6])
    logs = [simulate(shoulder, each, duration=0.5, dt=1e-3) for each in (law, compile_law(law))]
    np.testing.assert_allclose(logs[1].position, logs[0].position, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(logs[1].torque, logs[0].torque, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("name", ["force_feedback", "hamiltonian_servo"])
def test_the_certificate_of_a_compiled_law(name):
    system = make_system("pera_shoulder_elbow")
    compiled = compile_law(make_controller(name, system))
    before = compiled.step.counts
    certificate = certify(compiled, samples=6)
    asked, left = (after - first for after, first in zip(compiled.step.counts, before, strict=True))
    assert certificate.passed, str(certificate)
    assert asked > 100
    assert left < 0.5 * asked


def test_a_gain_that_is_wrong_by_one_percent_in_c_is_refused_and_fails_its_certificate(shoulder, monkeypatch):
    law = make_controller("force_feedback", shoulder)
    right = compile_law(law)
    from phcontrol.compilation.law_inputs import law_numbers

    numbers = law_numbers(law)
    numbers[numbers == law.stiffness[0, 0]] *= 1.01
    wrong = compiled_law_module._made(law, right._layout, numbers, right.report.library, {})
    with pytest.raises(CompilationError, match="is refused: it differs from the interpreted law by"):
        compiled_law_module._checked(wrong)
    assert not certify(wrong, samples=6).passed


def test_new_gains_and_goals_need_no_compiler(shoulder, monkeypatch):
    law = make_controller("force_feedback", shoulder)
    compiled = compile_law(law)

    def none_there():
        raise AssertionError("the compiler was asked for")

    monkeypatch.setattr(compiled_law_module, "find_compiler", none_there)
    other = compiled.changed(stiffness=[31.0, 17.0], goal=[0.2, 0.3], damping=[3.0, 4.0])
    expected = law.changed(stiffness=[31.0, 17.0], goal=[0.2, 0.3], damping=[3.0, 4.0])
    assert differences(expected, other).max() <= TOLERANCE
    assert other.step.counts[1] == 0
    assert differences(law, compiled).max() <= TOLERANCE  # the first is as it was
    with pytest.raises(AssertionError, match="the compiler was asked for"):
        compiled.changed(stiffness=[[30.0, 1.0], [1.0, 20.0]])  # no longer diagonal: other code


class Scaled(EnergyShaping):
    """Has single numbers, in branches too."""

    name = "scaled"
    factor: Positive = Positive("c", "", default=1.0)

    def shape(self, t, x, state, measured):
        shaping = super().shape(t, x, state, measured)
        scale = math.sqrt(self.factor) if self.factor > 0.25 else 0.5
        return shaping._replace(effort=scale * shaping.effort)


def test_new_single_numbers_friction_and_gravity_need_no_compiler(shoulder, monkeypatch):
    def plant(share):
        friction = StribeckFriction(viscous=[0.2 * share, 0.1], coulomb=0.1 * share, static=0.15 * share)
        return MechanicalSystem(load_robot("pera_shoulder"), friction=friction, gravity=(0.0, 0.0, -9.81 * share))

    law = Scaled.tuned(plant(1.0), goal=[0.4, 0.6], factor=0.7)
    tracking = make_controller("force_feedback", plant(1.0), interconnection="canonical")
    compiled, of_tracking = compile_law(law), compile_law(tracking)
    monkeypatch.setattr(compiled_law_module, "find_compiler", lambda: pytest.fail("the compiler was asked for"))
    for share in (1.0, 0.5, 2.0):
        other = compiled.changed(factor=0.8 * share).on(plant(share))
        assert differences(Scaled(plant(share), **other.interpreted._given), other).max() <= TOLERANCE
        assert other.step.counts[1] == 0
        again = of_tracking.on(plant(share))
        assert differences(again.interpreted, again).max() <= TOLERANCE
        assert again.interpreted.system.model.gravity.linear[2] == -9.81 * share
    with pytest.raises(pytest.fail.Exception, match="the compiler was asked for"):
        compiled.changed(factor=0.1)  # another branch, which none of the compiled ways goes


def test_what_is_not_plain_is_answered_by_the_interpreted_law(shoulder):
    law = make_controller("force_feedback_measured", shoulder)
    compiled = compile_law(law)
    q, v, z, f = np.array([0.1, 0.2]), np.array([0.3, 0.4]), np.array([0.1, -0.1]), np.array([1.0, 2.0])
    expected = law.evaluate(0.0, shoulder.at(q, v), z, Measured(f))
    wide = np.zeros((2, 2))
    wide[:, 0] = q
    for arguments in (
        (0.0, q, v, z, Measured(f)),
        (0, q, v, z, Measured(f)),
        (0.0, [0.1, 0.2], v, z, Measured(f)),
        (0.0, wide[:, 0], v, z, Measured(f)),
    ):
        np.testing.assert_allclose(compiled.step(*arguments).torque, expected.torque, rtol=1e-12)
    with pytest.raises(InvalidArgumentError, match="position: must have shape"):
        compiled.step(0.0, np.zeros(3), v, z, Measured(f))
    with pytest.raises(InvalidArgumentError, match="velocity: must be finite"):
        compiled.step(0.0, q, np.array([np.nan, 0.0]), z, Measured(f))
    with pytest.raises(MissingMeasurementError):
        compiled.step(0.0, q, v, z)
    other = MechanicalSystem(load_robot("pera_shoulder"), gravity=[0.0, 0.0, -1.6])
    x = other.at(q, v)
    np.testing.assert_array_equal(
        compiled.evaluate(0.0, x, z, Measured(f)).torque, law.evaluate(0.0, x, z, Measured(f)).torque
    )


def test_the_caller_by_ctypes_is_the_same(shoulder, monkeypatch):
    law = make_controller("force_feedback_measured", shoulder)
    monkeypatch.setattr(compiled_law_module, "Caller", _plain_caller.Caller)
    compiled = compile_law(law)
    assert isinstance(compiled.step, _plain_caller.Caller)
    assert differences(law, compiled).max() <= TOLERANCE
    assert compiled.step.counts[1] == 0
    with pytest.raises(MissingMeasurementError):
        compiled.step(0.0, np.zeros(2), np.zeros(2), np.zeros(2))


def test_a_compiled_law_is_pickled_and_not_compiled_twice(shoulder):
    compiled = compile_law(make_controller("energy_shaping", shoulder))
    assert compile_law(compiled) is compiled
    again = pickle.loads(pickle.dumps(compiled))
    assert isinstance(again, CompiledLaw)
    x = shoulder.at([0.1, 0.2], [0.3, 0.4])
    np.testing.assert_array_equal(
        again.evaluate(0.0, x, np.zeros(0)).torque, compiled.evaluate(0.0, x, np.zeros(0)).torque
    )


# --- laws of one's own ------------------------------------------------------------------------------------


class Spring(Controller):
    """States its promise alone: torque by finite differences of it."""

    name = "spring"
    goal: Vector = Vector("q_d", "rad", default=[0.1, 0.2])
    stiffness: Gain = Gain("K_p", "N·m/rad", default=20.0)
    damping: Gain = Gain("C", "N·m·s/rad", default=5.0)

    def storage(self, t, x, state, measured=None):
        error = x.position_error(self.goal)
        return x.kinetic_energy + 0.5 * error @ self.stiffness @ error

    def target(self, t, x, state, measured=None):
        error = x.position_error(self.goal)
        return Target.mechanical(
            x, self.interconnection, error=error, gradient=self.stiffness @ error, damping=self.damping
        )


class Counting(EnergyShaping):
    name = "counting"
    calls = 0

    def shape(self, t, x, state, measured):
        self.calls += 1
        return super().shape(t, x, state, measured)


class Clock(EnergyShaping):
    name = "clock"

    def shape(self, t, x, state, measured):
        shaping = super().shape(t, x, state, measured)
        return shaping._replace(effort=shaping.effort * (1.0 + 0.1 * np.sin(1e3 * time.perf_counter())))


class Eigenvalues(EnergyShaping):
    name = "eigenvalues"

    def shape(self, t, x, state, measured):
        shaping = super().shape(t, x, state, measured)
        return shaping._replace(effort=shaping.effort * np.linalg.eigvalsh(x.mass_matrix)[0])


class Switching(EnergyShaping):
    """A branch on the state of the arm that is taken at one state in a thousand."""

    name = "switching"

    def shape(self, t, x, state, measured):
        shaping = super().shape(t, x, state, measured)
        return shaping._replace(effort=2.0 * shaping.effort) if x.position[0] > 50.0 else shaping


def test_a_law_that_states_its_promise_alone_is_compiled(shoulder):
    law = Spring(shoulder)
    compiled = compile_law(law)
    assert differences(law, compiled).max() <= TOLERANCE


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (Counting, "counting cannot be compiled: it keeps 'calls' between calls"),
        (Clock, "clock cannot be compiled: it reads 'time', a clock or a random generator"),
        (Eigenvalues, r"eigenvalues cannot be compiled: eigvalsh .*test_compiled_law.py:\d+, in shape"),
    ],
)
def test_what_cannot_be_compiled_is_refused_and_says_why(law, words, shoulder):
    with pytest.raises(CompilationError, match=words) as caught:
        compile_law(law.tuned(shoulder))
    assert "\n" not in str(caught.value)
    assert issubclass(NotTraceableError, CompilationError)


def test_where_a_branch_was_not_compiled_the_interpreted_law_answers(shoulder):
    law = Switching.tuned(shoulder)
    compiled = compile_law(law)
    assert compiled.report.ways == 1
    x = shoulder.at([51.0, 0.2], [0.3, 0.4])
    np.testing.assert_array_equal(
        compiled.evaluate(0.0, x, np.zeros(0)).torque, law.evaluate(0.0, x, np.zeros(0)).torque
    )
    assert compiled.step.counts[1] == 1


def test_without_a_compiler_the_law_runs_interpreted_and_says_so(shoulder, monkeypatch):
    law = make_controller("energy_shaping", shoulder)
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.warns(CompilationWarning, match="no C compiler was found .* energy_shaping runs interpreted"):
        assert compile_law(law) is law


def test_a_compiler_that_fails_gives_one_line(shoulder, monkeypatch, tmp_path):
    law = make_controller("energy_shaping", shoulder, goal=[0.123, 0.2])
    broken = tmp_path / "cc"
    broken.write_text('#!/bin/sh\n[ "$1" = --version ] && { echo "broken 1.0"; exit 0; }\n'
                      'echo "In file included" >&2; echo "law.c:3: error: no" >&2; exit 1\n')  # fmt: skip
    broken.chmod(0o755)
    monkeypatch.setenv("CC", str(broken))
    with pytest.raises(CompilationError, match=r"failed: law.c:3: error: no$") as caught:
        compile_law(law)
    assert "\n" not in str(caught.value)


def test_another_payload_needs_no_compiler_where_inertias_are_inputs(monkeypatch):
    robots = [load_robot("pera_shoulder_elbow") for _ in range(2)]
    heavy = robots[1].model
    heavy.inertias[heavy.njoints - 1] += pin.Inertia(1.5, np.array([0.02, -0.1, 0.05]), 2e-3 * np.eye(3))
    light_arm, heavy_arm = map(MechanicalSystem, robots)
    law = make_controller("force_feedback", light_arm)
    compiled, plain = compile_law(law, inertias=True), compile_law(law)
    assert differences(law, compiled).max() <= TOLERANCE
    assert compiled.report.operations >= plain.report.operations
    monkeypatch.setattr(compiled_law_module, "find_compiler", lambda: pytest.fail("the compiler was asked for"))
    loaded = compiled.on(heavy_arm)
    expected = type(law)(heavy_arm, **law._given)
    assert differences(expected, loaded).max() <= TOLERANCE
    assert loaded.step.counts[1] == 0
    assert differences(law, compiled).max() <= TOLERANCE
    x, seen = heavy_arm.at(heavy_arm.robot.home), light_arm.at(light_arm.robot.home)
    torques = loaded.evaluate(0.0, x, np.zeros(3)).torque, compiled.evaluate(0.0, seen, np.zeros(3)).torque
    assert np.abs(torques[0] - torques[1]).max() > 1.0  # 1.5 kg are felt
    with pytest.raises(pytest.fail.Exception, match="the compiler was asked for"):
        plain.on(heavy_arm)
    with pytest.raises(pytest.fail.Exception, match="the compiler was asked for"):
        compiled.on(MechanicalSystem(robots[0], gravity=[0.0, -1.6, -9.0]))


def test_laws_that_run_in_other_threads_while_one_is_traced_are_right(shoulder):
    """The modules see other arithmetic meanwhile; for plain numbers it is the same, and arrays stay plain."""
    system = MechanicalSystem(load_robot("pera_shoulder"))
    law = make_controller("integral_action", system)
    q, v, state = np.array([0.1, 0.2]), np.array([0.3, 0.4]), np.array([0.1, 0.2, 0.3, 0.4])
    expected = law.evaluate(0.0, system.at(q, v), state)
    wrong, count, done = [], [0], threading.Event()

    def ask():
        while not done.is_set():
            try:
                for one, other in zip(law.evaluate(0.0, system.at(q, v), state), expected, strict=True):
                    assert one.dtype == np.float64
                    np.testing.assert_array_equal(one, other)
            except Exception as error:
                wrong.append(error)
            count[0] += 1

    thread = threading.Thread(target=ask)
    thread.start()
    try:
        compile_law(make_controller("integral_action", make_system("ur5")))
    finally:
        done.set()
        thread.join()
    assert wrong == []
    assert count[0] > 100


def test_a_schedule_of_compiled_laws_is_compiled_as_one(shoulder):
    laws = [make_controller(name, shoulder) for name in ("energy_shaping", "force_feedback")]
    plain = Schedule([(0.0, laws[0]), (1.0, laws[1])])
    parts = Schedule([(0.0, compile_law(laws[0])), (1.0, compile_law(laws[1]))])
    for schedule in (parts, compile_law(parts)):
        for t in (0.5, 1.0, 1.5):
            x, state = shoulder.at([0.1, 0.2], [0.3, -0.4]), np.array([0.1, -0.2])
            expected, found = plain.evaluate(t, x, state), schedule.evaluate(t, x, state)
            np.testing.assert_allclose(found.torque, expected.torque, rtol=1e-12)
            np.testing.assert_allclose(found.state_rate, expected.state_rate, rtol=1e-10, atol=1e-12)


class Named(EnergyShaping):
    name = "named"
    step: Vector = Vector("h", "rad", default=[0.1, 0.2])


@pytest.mark.parametrize("name", ["step", "report", "interpreted"])
def test_names_that_compiled_laws_have_a_use_for_are_refused(name, shoulder):
    law = Named.tuned(shoulder) if name == "step" else EnergyShaping.tuned(shoulder)
    if name != "step":
        setattr(law, name, 0.5)
    with pytest.raises(CompilationError, match=f"'{name}' of it must have another name"):
        compile_law(law)


class Remembering(EnergyShaping):
    """Counts in a dict, which a copy shares."""

    name = "remembering"

    def prepare(self):
        super().prepare()
        self.memory = {"calls": 0}

    def shape(self, t, x, state, measured):
        self.memory["calls"] += 1
        return super().shape(t, x, state, measured)


def test_a_law_that_changes_while_it_is_evaluated_is_refused(shoulder):
    with pytest.raises(CompilationError, match="it changes while it is evaluated|keeps 'memory'"):
        compile_law(Remembering.tuned(shoulder))


def test_every_way_is_held_against_the_law_where_it_was_traced(shoulder, monkeypatch):
    """A way that is wrong, and that none of the states drawn afterwards meets."""
    from phcontrol.compilation import trace

    right, law = trace._traced, EnergyShaping.tuned(shoulder)
    first = next(instant for instant, _ in instants(law, 48, seed=1))

    def wrong(law, layout, inputs, values, inertias):
        found = right(law, layout, inputs, values, inertias)
        if np.array_equal(values[1], first.position):
            there = inputs[1][0] == float(first.position[0])
            return found._replace(guards=[there], torque=[2.0 * entry for entry in found.torque])
        return found

    monkeypatch.setattr(trace, "_traced", wrong)
    with pytest.raises(CompilationError, match="differs from the interpreted law"):
        compile_law(law)
