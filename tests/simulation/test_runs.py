"""Runs: how many steps they take, what they watch, remember and refuse; forces and bodies in the vector field."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from phcontrol import (
    CameraSensor,
    InvalidArgumentError,
    MomentumObserver,
    ObservedObject,
    PinholeCamera,
    Schedule,
    SimulationError,
    SimulationInterrupted,
    make_controller,
    simulate,
)
from phcontrol.environments.compliant_body import CompliantBody
from phcontrol.environments.contact_geometry import JointContact
from phcontrol.environments.disturbances import Step, Wrench
from phcontrol.environments.rigid_body import RigidBody
from phcontrol.sensors.force_sensor import ForceSensor
from phcontrol.simulation.integrators import INTEGRATORS
from phcontrol.simulation.run import torque_limit_of
from phcontrol.simulation.simulate_many import _disturbances
from phcontrol.simulation.vector_field import ClosedLoop, Held
from phcontrol.vision.feature_flow import FeatureFlow
from tests.conftest import make_system


@pytest.mark.parametrize(
    ("duration", "dt", "steps"),
    [
        (0.01, 1e-3, 10),
        (0.0101, 1e-3, 11),
        (0.7, 1e-3, 700),
        (0.003, 1e-3, 3),
        (1e-9, 1e-3, 1),
        (1e-14, 1e-3, 1),
        (0.005, 5e-3, 1),
    ],
)
def test_a_run_takes_the_steps_that_reach_its_duration(shoulder, duration, dt, steps):
    log = simulate(shoulder, make_controller("energy_shaping", shoulder), duration=duration, dt=dt)
    assert len(log) == steps + 1
    assert log.time[-1] == steps * dt


def test_a_run_is_watched_at_each_step_and_may_be_stopped_by_it(shoulder):
    law, lengths = make_controller("energy_shaping", shoulder), []
    log = simulate(shoulder, law, duration=0.01, watch=lambda log: lengths.append(len(log)))
    assert lengths == list(range(1, 12))
    assert len(log) == 11

    def stops(log):
        if len(log) == 4:
            raise KeyboardInterrupt

    with pytest.raises(SimulationInterrupted, match=r"interrupted at t = 0\.003 s") as caught:
        simulate(shoulder, law, duration=0.01, watch=stops)
    assert len(caught.value.log) == 4


def test_limits_of_torque_as_they_are_asked_for(shoulder):
    np.testing.assert_array_equal(torque_limit_of("robot", shoulder), shoulder.robot.effort_limit)
    np.testing.assert_array_equal(torque_limit_of(2.0, shoulder), [2.0, 2.0])
    np.testing.assert_array_equal(torque_limit_of([1e-9, 3.0], shoulder), [1e-9, 3.0])
    assert torque_limit_of(None, shoulder) is None
    for value in (0.0, [1.0, 0.0], [1.0, -1.0]):
        with pytest.raises(InvalidArgumentError, match="torque_limit: must be > 0"):
            torque_limit_of(value, shoulder)


def test_seeds_and_wrenches_and_what_is_seen_are_kept(shoulder):
    system = make_system("pera_shoulder_elbow")
    law = make_controller("hamiltonian_servo", system)
    camera = law.camera.mounted_on(system.robot)
    scene = ObservedObject.seen_as(camera, [1e-3, 2e-3, 3e-3], system.at(system.robot.home))
    log = simulate(
        system,
        law,
        duration=2e-3,
        scene=scene,
        disturbance=Wrench("tool", np.zeros(6)) + Step(np.zeros(3)),
        sensors=[CameraSensor(scene, seed=5), ForceSensor(seed=7), MomentumObserverOfTotal(system)],
        integrator="semi_implicit_euler",
        control_period=1e-3,
    )
    kept = log.metadata
    assert kept["seeds"] == {"features": 5, "external_force": 7}
    assert kept["wrench_frames"] == ["tool"]
    assert kept["sight"] == {"camera": camera.record(), "object": scene.record(), "goal": law.goal.tolist()}
    assert (kept["dt"], kept["integrator"], kept["control_period"]) == (1e-3, "semi_implicit_euler", 1e-3)
    flow = FeatureFlow(law.camera, [1e-3, 2e-3, 3e-3], law.object_length)
    sight = simulate(system, law, duration=1e-3, scene=flow).metadata["sight"]
    assert sight == {"camera": camera.record(), "object": None, "goal": law.goal.tolist()}
    plain = make_controller("energy_shaping", system)
    assert simulate(system, plain, duration=1e-3, scene=flow).metadata["sight"]["goal"] is None
    assert simulate(system, plain, duration=1e-3).metadata["sight"] is None
    assert simulate(system, plain, duration=1e-3).metadata["seeds"] == {}


def test_what_sensors_show_needs_no_scene_beside():
    system = make_system("pera_shoulder_elbow")
    law = make_controller("hamiltonian_servo", system)
    scene = ObservedObject.seen_as(law.camera, [1e-3, 2e-3, 3e-3], system.at(system.robot.home))
    log = simulate(system, law, duration=2e-3, sensors=[CameraSensor(scene)])
    np.testing.assert_allclose(log.measured["features"][0], [1e-3, 2e-3, 3e-3], rtol=1e-9)
    for sensors in (None, [], [ForceSensor()]):
        with pytest.raises(InvalidArgumentError, match="scene: hamiltonian_servo needs image features"):
            simulate(system, law, duration=2e-3, sensors=sensors)


class MomentumObserverOfTotal(MomentumObserver):
    """Without a seed, and of another quantity than the force sensor's."""

    quantity = "total_force"


def test_a_law_of_a_schedule_steers_by_what_it_sees():
    system = make_system("pera_shoulder_elbow")
    servo, rest = make_controller("hamiltonian_servo", system), make_controller("energy_shaping", system)
    schedule = Schedule([(0.0, rest), (0.5, servo)])
    scene = ObservedObject.seen_as(PinholeCamera(), [1e-3, 2e-3, 3e-3], system.at(system.robot.home))
    log = simulate(system, schedule, duration=1e-3, scene=scene)
    assert log.metadata["sight"]["goal"] == servo.goal.tolist()


def test_bodies_may_touch_at_the_start_and_not_more():
    system = make_system("pera_gripper")
    law, home = make_controller("energy_shaping", system), float(system.robot.home[0])
    simulate(system, law, duration=1e-3, bodies=[RigidBody(JointContact("gripper", home + 0.9e-9))])
    bodies = [RigidBody(JointContact("gripper", home - 0.1)), RigidBody(JointContact("gripper", home + 2e-9))]
    with pytest.raises(InvalidArgumentError, match="bodies: number 1 starts inside the arm"):
        simulate(system, law, duration=1e-3, bodies=bodies)


@pytest.mark.parametrize("integrator", list(INTEGRATORS))
def test_the_longest_stable_step_is_that_of_the_stiffest_body(integrator):
    system = make_system("pera_gripper")
    law, where = make_controller("energy_shaping", system), JointContact("gripper", 0.1)
    soft, stiff = RigidBody(where, stiffness=10.0), RigidBody(where, stiffness=1e6)
    x = system.at(system.robot.home)
    reach = {"semi_implicit_euler": 2.0, "rk4": 2.78, "implicit_midpoint": np.inf, "discrete_gradient": np.inf}[
        integrator
    ]
    longest = reach / stiff.fastest_rate(x)
    assert soft.fastest_rate(x) < 0.01 * stiff.fastest_rate(x)
    for bodies in ([soft, stiff], [stiff, soft]):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            dt = min(0.99 * longest, 1e-2)
            simulate(system, law, duration=dt, dt=dt, bodies=bodies, integrator=integrator)
        if np.isfinite(longest):
            with pytest.warns(UserWarning, match="is too long for the stiffest body") as caught:
                simulate(system, law, duration=longest, dt=1.01 * longest, bodies=bodies, integrator=integrator)
            assert [warning.filename for warning in caught] == [__file__]  # it points at who called


def test_forces_of_disturbances_and_bodies_add_and_their_states_follow_each_other(rng):
    """The vector field with two bodies, a scene and a force, against each part by itself."""
    system = make_system("pera_shoulder_elbow")
    names, camera = system.robot.joint_names, PinholeCamera().mounted_on(system.robot)
    q = system.robot.home + 0.1
    bodies = [
        CompliantBody(JointContact(names[0], q[0] + 0.01), stiffness=50.0, damping=1.0, mass=0.2),
        RigidBody(JointContact(names[1], q[1] - 0.01, "above"), stiffness=300.0),
        CompliantBody(JointContact(names[2], q[2] + 0.02), stiffness=70.0, damping=0.5, mass=0.1),
    ]
    scene = FeatureFlow(camera, [1e-3, 2e-3, 3e-3], 0.038)
    law = make_controller("force_feedback", system)
    force, features = np.array([0.5, -1.0, 2.0]), np.array([2e-3, -1e-3, 4e-3])
    velocity = rng.normal(size=3)
    law_state, first, third = rng.normal(size=3), np.array([1e-3, 2e-3]), np.array([-1e-3, 3e-3])
    y = np.concatenate([q, velocity, law_state, first, third, features])
    x = system.at(q, velocity)
    touches = [body.touch(x, state) for body, state in zip(bodies, (first, np.zeros(0), third), strict=True)]
    total = force + sum(touch.force for touch in touches)
    assert all(np.abs(touch.force).max() > 0.0 for touch in touches)
    expected_bodies = np.concatenate([touches[0].state_rate, touches[2].state_rate, scene.rate(x, features)])
    for disturbance in (force, lambda t, x: t * force, lambda t, x: (t * force).tolist()):
        loop = ClosedLoop(system, law, disturbance, None, bodies, scene)
        rate, torque, external_force, seen = loop.evaluate(1.0, y)
        np.testing.assert_allclose(external_force, total, atol=1e-12)
        np.testing.assert_array_equal(seen, features)
        np.testing.assert_array_equal(torque, loop.torque(1.0, y))
        np.testing.assert_array_equal(rate[:3], velocity)
        np.testing.assert_allclose(rate[3:6], x.acceleration(torque, total), atol=1e-9)
        np.testing.assert_allclose(rate[9:], expected_bodies, atol=1e-12)
        momentum_rate, states_rate = loop.momentum_rate(1.0, y)
        np.testing.assert_allclose(momentum_rate, x.momentum_rate(torque, total), atol=1e-9)
        np.testing.assert_allclose(states_rate, rate[6:], atol=1e-12)
        np.testing.assert_allclose(loop.momentum(y), x.mass_matrix @ velocity, atol=1e-12)
        np.testing.assert_allclose(loop.velocity(q, loop.momentum(y)), velocity, atol=1e-9)
        held = Held(torque=np.array([1.0, -2.0, 3.0]))
        rate, torque, _, _ = loop.evaluate(1.0, y, held)
        assert torque is held.torque
        np.testing.assert_allclose(rate[3:6], x.acceleration(held.torque, total), atol=1e-9)
        np.testing.assert_array_equal(rate[6:9], np.zeros(3))  # between samples the law's state rests
        np.testing.assert_allclose(rate[9:], expected_bodies, atol=1e-12)
        np.testing.assert_array_equal(loop.during(held).rate(1.0, y), rate)


def test_a_force_that_is_no_vector_is_refused_where_it_shows(shoulder):
    law = make_controller("energy_shaping", shoulder)
    for force in (lambda t, x: 1.0, lambda t, x: np.zeros((2, 1)), lambda t, x: ["a", "b"]):
        with pytest.raises(SimulationError, match="disturbance: must"):
            simulate(shoulder, law, duration=1e-3, disturbance=force)
    whole = simulate(shoulder, law, duration=0.01, disturbance=lambda t, x: [1, -2])
    exact = simulate(shoulder, law, duration=0.01, disturbance=[1.0, -2.0])
    np.testing.assert_array_equal(whole.position, exact.position)


def test_a_disturbance_of_one_row_is_for_all_runs_and_of_two_dimensions_one_for_each():
    for one in (None, [0.5, -0.5], np.array([0.5, -0.5]), np.sin):
        assert _disturbances(one) is None
    for rows in ([[0.5, -0.5], [1.0, 2.0]], np.array([[0.5, -0.5], [1.0, 2.0]])):
        np.testing.assert_array_equal(_disturbances(rows), [[0.5, -0.5], [1.0, 2.0]])
    assert _disturbances([None, np.sin]) == [None, np.sin]
