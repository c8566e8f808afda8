"""A run in C is the interpreted run: over the whole of it, not at its end, for a damped loop forgets its errors."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    CompilationWarning,
    EnergyShaping,
    Log,
    MechanicalSystem,
    MinimumJerk,
    SimulationError,
    StribeckFriction,
    compile_law,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.compilation.rigid_body import ArmPosture
from tests.conftest import make_system

pytestmark = pytest.mark.usefixtures("compiler")


def both(plant, law, **options):
    """Return the interpreted and the compiled run, and check that all recorded is the same."""
    options = {"duration": 0.4, "dt": 1e-3} | options
    plain, compiled = (simulate(plant, law, compiled=choice, **options) for choice in (False, True))
    assert len(compiled) == len(plain)
    np.testing.assert_array_equal(compiled.time, plain.time)
    np.testing.assert_array_equal(compiled.external_force, plain.external_force)
    for name in ("position", "velocity", "controller_state"):
        np.testing.assert_allclose(getattr(compiled, name), getattr(plain, name), rtol=0.0, atol=1e-11, err_msg=name)
    np.testing.assert_allclose(compiled.torque, plain.torque, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(compiled.storage, plain.storage, rtol=1e-9, atol=1e-12)
    return compiled


CONTROL = {"continuous": {}, "sampled": {"control_period": 1e-3}, "slowly sampled": {"control_period": 4e-3}}


@pytest.mark.parametrize("control", list(CONTROL))
@pytest.mark.parametrize("integrator", ["rk4", "semi_implicit_euler"])
def test_a_law_with_a_state_under_a_force(control, integrator, shoulder):
    law = make_controller("force_feedback_measured", shoulder, goal=[0.4, 0.6])
    log = both(shoulder, law, integrator=integrator, disturbance=[0.5, -1.0], **CONTROL[control])
    assert np.ptp(log.position, axis=0).max() > 0.05  # it moves


def test_the_measured_total_force_is_that_of_the_plant(shoulder):
    both(shoulder, make_controller("total_force_rejection", shoulder, goal=[0.4, 0.6]), disturbance=[0.5, -1.0])


def test_torques_are_clipped_and_a_reference_begins_and_ends(shoulder):
    robot = shoulder.robot
    way = MinimumJerk(robot.home, robot.home + 0.3, 0.2, start=0.1)
    law = make_controller("energy_shaping", shoulder, reference=way)
    log = both(shoulder, law, torque_limit=[1.0, 20.0], q0=robot.home + 0.1)
    assert log.saturated.any()


def test_a_plant_that_is_not_the_laws_model():
    model = make_system("pera_shoulder")
    plant = MechanicalSystem(
        load_robot("pera_shoulder", armature=0.05), friction=StribeckFriction(viscous=0.4, coulomb=0.2, static=0.3)
    )
    both(plant, make_controller("force_feedback", model, goal=[0.4, 0.6]))


@pytest.mark.study
@pytest.mark.parametrize("arm", ["panda_with_fingers", "kinova", "pera_gripper"])
def test_mimic_continuous_and_sprung_joints(arm):
    system = make_system(arm)
    goal = system.robot.near_home()
    for name in ("energy_shaping", "integral_action"):
        both(system, make_controller(name, system, goal=goal), duration=0.2, dt=5e-4)


def test_a_compiled_law_is_taken_and_the_log_is_saved(shoulder, tmp_path):
    law = compile_law(make_controller("energy_shaping", shoulder, goal=[0.4, 0.6]))
    log = simulate(shoulder, law, duration=0.1, compiled=True)
    log.save(tmp_path / "run.npz")
    np.testing.assert_array_equal(Log.load(tmp_path / "run.npz").position, log.position)


def test_what_is_not_compiled_is_simulated_interpreted_and_says_so(shoulder, monkeypatch):
    law = make_controller("energy_shaping", shoulder, goal=[0.4, 0.6])
    for options, words in (
        ({"disturbance": lambda t, x: np.array([t, 0.0])}, "a disturbance that is a function: not compiled yet"),
        ({"integrator": "implicit_midpoint"}, "implicit_midpoint: not compiled yet"),
        ({"sensors": []}, "sensors: not compiled yet"),
    ):
        with pytest.warns(CompilationWarning, match=f"the run is simulated interpreted: {words}"):
            found = simulate(shoulder, law, duration=0.02, compiled=True, **options)
        expected = simulate(shoulder, law, duration=0.02, **options)
        np.testing.assert_array_equal(found.position, expected.position)
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.warns(CompilationWarning, match="no C compiler was found"):
        simulate(shoulder, law, duration=0.02, compiled=True)


class Late(EnergyShaping):
    """Takes a branch that none of the instants shows at which laws are traced."""

    name = "late"

    def shape(self, t, x, state, measured):
        shaping = super().shape(t, x, state, measured)
        return shaping._replace(effort=0.5 * shaping.effort) if t > 0.05 else shaping


def test_a_run_that_takes_a_branch_that_is_not_compiled_is_simulated_interpreted(shoulder):
    law = Late.tuned(shoulder, goal=[0.4, 0.6])
    with pytest.warns(CompilationWarning, match=r"at t = 0.05\d* s it takes a branch that is not compiled"):
        found = simulate(shoulder, law, duration=0.1, compiled=True)
    np.testing.assert_array_equal(found.position, simulate(shoulder, law, duration=0.1).position)


def test_a_plant_that_is_wrong_by_one_part_in_a_million_is_refused(monkeypatch):
    shoulder = make_system("pera_shoulder").twin()  # for which no loop was made before
    right = ArmPosture.inverse_dynamics

    def wrong(*arguments):
        return [entry * 1.000001 for entry in right(*arguments)]

    monkeypatch.setattr(ArmPosture, "inverse_dynamics", wrong)
    law = make_controller("energy_shaping", shoulder, goal=[0.4, 0.6])
    with pytest.warns(CompilationWarning, match="the loop as compiled is refused: it differs from the interpreted"):
        found = simulate(shoulder, law, duration=0.02, compiled=True)
    np.testing.assert_array_equal(found.position, simulate(shoulder, law, duration=0.02).position)


def test_a_run_that_diverges_says_so_as_the_interpreted_one(shoulder):
    law = make_controller("energy_shaping", shoulder, goal=[0.4, 0.6], damping=5e4)
    ends = []
    for compiled in (False, True):
        with pytest.raises(SimulationError) as caught:
            simulate(shoulder, law, duration=1.0, compiled=compiled, torque_limit=None)
        ends.append(str(caught.value))
    assert ends[0] == ends[1]


def test_a_sweep_of_gains_needs_one_trace(shoulder, monkeypatch):
    law = make_controller("force_feedback", shoulder, goal=[0.4, 0.6])
    simulate(shoulder, law, duration=0.02, compiled=True)
    monkeypatch.setattr("phcontrol.compilation.compiled_loop.trace_law", lambda *_: pytest.fail("traced again"))
    for stiffness in (10.0, 40.0):
        both(shoulder, law.changed(stiffness=stiffness), duration=0.1)
    both(shoulder, law, duration=0.1)


class Jumping(EnergyShaping):
    name = "jumping"
    jumps = True


def test_a_law_whose_state_jumps_is_simulated_interpreted(shoulder):
    law = Jumping.tuned(shoulder, goal=[0.4, 0.6])
    with pytest.warns(CompilationWarning, match="interpreted: a law whose state jumps: not compiled yet"):
        simulate(shoulder, law, duration=0.02, compiled=True)


class Tabled(EnergyShaping):
    name = "tabled"

    def prepare(self):
        super().prepare()
        self.boost, self.table = 1.0, np.array([1.0, 2.0])

    def shape(self, t, x, state, measured):
        shaping = super().shape(t, x, state, measured)
        return shaping._replace(effort=self.boost * self.table * shaping.effort)


@pytest.mark.parametrize("name", ["boost", "table"])
def test_a_law_that_was_changed_in_place_is_compiled_anew(name, shoulder):
    law = Tabled.tuned(shoulder, goal=[0.4, 0.6])
    before = both(shoulder, law, duration=0.1)
    if name == "boost":
        law.boost = 4.0
    else:
        law.table[:] = 9.0
    after = both(shoulder, law, duration=0.1)
    assert np.abs(after.torque - before.torque).max() > 1.0
