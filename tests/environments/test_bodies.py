"""Bodies: contact against closed forms, energy that is never created, and geometry against analytic distances."""

from __future__ import annotations

import warnings

import coal
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from phcontrol import (
    InvalidArgumentError,
    MechanicalSystem,
    RobotDescriptionError,
    UnknownNameError,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.controllers.energy_shaping import EnergyShaping
from phcontrol.environments.body import Surface
from phcontrol.environments.compliant_body import CompliantBody
from phcontrol.environments.contact_geometry import JointContact, SphereContact
from phcontrol.environments.rigid_body import RigidBody
from tests.conftest import make_system
from tests.finite_differences import gradient
from tests.simulation.idle import IdleLaw

FREE_GRIPPER = MechanicalSystem(load_robot("pera_gripper"), friction=None)


@given(st.floats(1, 1e5), st.floats(0, 1e3), st.floats(1e-6, 1e-2), st.floats(-1e-2, 1e-1), st.floats(-10, 10))
def test_a_surface_never_pulls_and_always_dissipates(stiffness, damping, onset, depth, speed):
    force, stored, lost = Surface(stiffness, damping, onset).push(depth, speed)
    assert force >= 0.0
    assert stored >= 0.0
    assert lost >= -1e-9 * abs(force * speed)
    if depth <= 0.0:
        assert force == stored == lost == 0.0


@given(st.floats(-10, 10))
def test_force_is_continuous_at_first_touch(speed):
    surface = Surface(1e4, 50.0, 1e-3)
    assert surface.push(1e-9, speed)[0] <= 1e-4 * (1.0 + abs(speed))


def test_pressing_a_rigid_body_rests_where_two_springs_balance():
    """K_p(q_d − q) = k(q − q_c): with K_p = 5 to q_d = 0.1 against k = 200 at q_c = 0.25."""
    system = make_system("pera_gripper")
    body = RigidBody(JointContact("gripper", 0.25), stiffness=200.0, damping=5.0)
    law = EnergyShaping(system, goal=[0.1], stiffness=5.0, damping=2.0)
    log = simulate(system, law, duration=6.0, dt=2e-3, bodies=[body])
    expected = (5.0 * 0.1 + 200.0 * 0.25) / 205.0
    np.testing.assert_allclose(log.position[-1], expected, atol=1e-6)
    np.testing.assert_allclose(log.contact_force[-1], 200.0 * (0.25 - expected), atol=1e-3)
    np.testing.assert_allclose(log.external_force[-1], log.contact_force[-1], atol=1e-9)  # pushes the gripper open


def test_a_body_above_pushes_down():
    system = make_system("pera_gripper")
    body = RigidBody(JointContact("gripper", 0.4, side="above"), stiffness=200.0, damping=5.0)
    law = EnergyShaping(system, goal=[0.6], stiffness=5.0, damping=2.0)
    log = simulate(system, law, duration=4.0, dt=2e-3, bodies=[body])
    assert log.position[-1, 0] == pytest.approx((5.0 * 0.6 + 200.0 * 0.4) / 205.0, abs=1e-5)
    assert log.external_force[-1, 0] < 0.0


def test_pressing_a_compliant_body_rests_where_three_springs_balance():
    """The contact's k_s and the body's K_c in series: 1/k = 1/100 + 1/5."""
    system = make_system("pera_gripper")
    body = CompliantBody(JointContact("gripper", 0.25), stiffness=5.0, damping=0.3, mass=0.02, surface_stiffness=100.0)
    law = EnergyShaping(system, goal=[0.1], stiffness=5.0, damping=2.0)
    log = simulate(system, law, duration=10.0, dt=2e-3, bodies=[body])
    series = 1.0 / (1.0 / 100.0 + 1.0 / 5.0)
    expected = (5.0 * 0.1 + series * 0.25) / (5.0 + series)
    np.testing.assert_allclose(log.position[-1], expected, atol=1e-5)
    np.testing.assert_allclose(log.body_state[-1], [series * (0.25 - expected) / 5.0, 0.0], atol=1e-4)


@pytest.mark.parametrize(
    "body",
    [
        RigidBody(JointContact("gripper", 0.25), stiffness=100.0, damping=1.0, onset=1e-2),
        CompliantBody(JointContact("gripper", 0.25), stiffness=5.0, damping=0.3, mass=0.05, onset=1e-2),
    ],
    ids=["rigid", "compliant"],
)
@pytest.mark.parametrize("of", ["storage", "plant", "all"])
def test_energy_of_robot_body_and_controller_closes(body, of):
    """Each balance integrates to nothing but the kinks at touch, of second order: below 5e-6 of the 0.1 J that move."""
    system = make_system("pera_gripper")
    law = EnergyShaping(system, goal=[0.1], stiffness=5.0, damping=0.5)
    log = simulate(system, law, duration=2.0, dt=5e-4, bodies=[body])
    assert log.contact_energy.max() > 1e-4
    assert log.contact_power.max() > 1e-4
    assert log.power_balance(of).energy_drift < 5e-6


@settings(max_examples=25)
@example(speed=0.80078125, stiffness=2152.0, damping=0.0, fineness=0.109375, compliant=False)
@given(
    speed=st.floats(0.05, 2.0),
    stiffness=st.floats(10.0, 1e4),
    damping=st.floats(0.0, 20.0),
    fineness=st.floats(0.02, 0.2),
    compliant=st.booleans(),
)
def test_no_contact_creates_energy(speed, stiffness, damping, fineness, compliant):
    """A free gripper runs into a body: arm, body and contact together never hold more than at the start.

    But for the integrator: a step of RK4 that crosses the kink of a spring at a fraction s is wrong by
    (s/6 - s²/2) f² v in velocity, f the step times the fastest rate: at most f²/12 of the energy, and that twice.
    """
    where = JointContact("gripper", 0.25)
    if compliant:
        body = CompliantBody(where, stiffness=stiffness / 100.0, damping=damping / 10.0, mass=0.05)
    else:
        body = RigidBody(where, stiffness=stiffness, damping=damping, onset=1e-3)
    x = FREE_GRIPPER.at([0.3], [-speed])
    dt = min(2e-3, fineness / body.fastest_rate(x))
    log = simulate(
        FREE_GRIPPER, IdleLaw(FREE_GRIPPER), duration=150 * dt + 0.06 / speed, dt=dt, v0=[-speed], bodies=[body]
    )
    total = log.kinetic_energy + log.potential_energy + log.contact_energy
    assert total.max() <= total[0] * (1.0 + fineness**2 / 6.0)


@pytest.mark.parametrize("stiffness", [1e2, 1e4])
def test_an_elastic_bounce_returns_the_speed(stiffness):
    body = RigidBody(JointContact("gripper", 0.25), stiffness=stiffness)
    log = simulate(FREE_GRIPPER, IdleLaw(FREE_GRIPPER), duration=0.6, dt=2e-4, v0=[-0.5], bodies=[body])
    before, after = (log.position[:, 0] - 0.25 > 0.0) & (log.time < 0.2), log.position[:, 0] > 0.29
    rebound = log.velocity[after & (log.time > 0.2)][0, 0]
    approach = log.velocity[before & (log.position[:, 0] <= log.position[after & (log.time > 0.2)][0, 0])][0, 0]
    assert rebound == pytest.approx(-approach, rel=1e-3)


CUBE = np.array([[x, y, z] for z in (-0.1, 0.1) for y in (-0.1, 0.1) for x in (-0.1, 0.1)])
FACES = [(0, 2, 1), (1, 2, 3), (4, 5, 6), (5, 7, 6), (0, 1, 5), (0, 5, 4), (2, 7, 3), (2, 6, 7), (0, 4, 6), (0, 6, 2)]
FACES += [(1, 3, 7), (1, 7, 5)]


def cube_mesh():
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(len(FACES), len(CUBE))
    for face in FACES:
        mesh.addTriangle(*(CUBE[i] for i in face))
    mesh.endModel()
    return mesh


def to_box(point):
    return np.linalg.norm(point - np.clip(point, -0.1, 0.1))


SHAPES = {
    "plane": (lambda: ("plane", {}), lambda p: p[2]),
    "sphere": (lambda: ("sphere", {"size": 0.1}), lambda p: np.linalg.norm(p) - 0.1),
    "box": (lambda: ("box", {"size": [0.2, 0.2, 0.2]}), to_box),
    "mesh": (lambda: (cube_mesh(), {}), to_box),
}


@pytest.mark.parametrize("name", list(SHAPES))
def test_gaps_are_the_analytic_distances_and_slopes_their_derivatives(name, rng):
    system, (make, distance) = make_system("pera"), SHAPES[name]
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn[:, 0] *= np.sign(np.linalg.det(turn))
    for _ in range(5):
        x = system.at(system.robot.random_position(rng))
        offset = turn @ np.array([0.03, -0.04, 0.25])  # outside each of them
        place = x.placement("tool").translation - offset
        shape, options = make()
        contact = SphereContact("tool", 0.02, shape, position=place, rotation=turn, **options)

        def expected(q, place=place):
            return np.array(distance(turn.T @ (system.at(q).placement("tool").translation - place)) - 0.02)

        gap = contact.gap(x)
        assert gap.distance == pytest.approx(float(expected(x.position)), abs=1e-9)
        np.testing.assert_allclose(gap.slope, gradient(expected, x.position, 1e-4), atol=1e-6)


def test_signed_distance_inside_the_primitives(pera):
    x = pera.at(pera.robot.home)
    tip = x.placement("tool").translation
    for shape, options, depth in [
        ("plane", {"position": tip + 0.03 * np.eye(3)[2]}, 0.03 + 0.01),
        ("sphere", {"size": 0.1, "position": tip - [0, 0, 0.08]}, 0.02 + 0.01),
        ("box", {"size": [0.2, 0.2, 0.2], "position": tip - [0, 0, 0.08]}, 0.02 + 0.01),
    ]:
        assert SphereContact("tool", 0.01, shape, **options).gap(x).distance == pytest.approx(-depth, abs=1e-9)


def test_a_mesh_file_can_be_touched(pera, tmp_path):
    path = tmp_path / "cube.obj"
    lines = [f"v {x} {y} {z}" for x, y, z in CUBE] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in FACES]
    path.write_text("\n".join(lines) + "\n")
    x = pera.at(pera.robot.home)
    tip = x.placement("tool").translation
    contact = SphereContact.with_mesh("tool", 0.02, path, position=tip - [0, 0, 0.15])
    assert contact.gap(x).distance == pytest.approx(0.15 - 0.1 - 0.02, abs=1e-8)  # coal reads single precision
    (tmp_path / "broken.stl").write_text("not a mesh")
    with pytest.raises(RobotDescriptionError, match="cannot be read as a mesh"):
        SphereContact.with_mesh("tool", 0.02, tmp_path / "broken.stl")
    with pytest.raises(RobotDescriptionError, match="no such mesh file"):
        SphereContact.with_mesh("tool", 0.02, tmp_path / "missing.stl")


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: RigidBody(JointContact("gripper", 0.2), stiffness=-1.0), "stiffness: must be > 0"),
        (lambda: RigidBody(JointContact("gripper", 0.2), damping=-1.0), "damping: must be >= 0"),
        (
            lambda: CompliantBody(JointContact("gripper", 0.2), stiffness=1.0, damping=0.0, mass=0.0),
            "mass: must be > 0",
        ),
        (lambda: JointContact("gripper", np.nan), "position: must be finite"),
        (lambda: SphereContact("tool", 0.01, "box"), "size: is needed for a box"),
        (lambda: SphereContact("tool", 0.01, "box", size=[1.0, 1.0, -1.0]), "size: edges must be > 0"),
        (lambda: SphereContact("tool", 0.0, "plane"), "radius: must be >="),
        (lambda: SphereContact("tool", 0.01, "plane", rotation=np.ones((3, 3))), "rotation: must be a rotation matrix"),
        (lambda: SphereContact("tool", 0.01, 3.0), "shape: must be plane, sphere, box or a coal shape"),
    ],
)
def test_bad_bodies_are_refused(make, complaint):
    with pytest.raises(InvalidArgumentError, match=complaint):
        make()


def run(body, **options):
    system = make_system("pera_gripper")
    return simulate(system, make_controller("energy_shaping", system), duration=0.01, bodies=[body], **options)


def test_bodies_that_do_not_fit_the_run_are_refused():
    with pytest.raises(InvalidArgumentError, match=r"bodies: number 0 starts inside the arm, 0\.1 deep"):
        run(RigidBody(JointContact("gripper", 0.4)))
    with pytest.raises(UnknownNameError, match="unknown joint 'finger' of pera_gripper"):
        run(RigidBody(JointContact("finger", 0.2)))
    with pytest.raises(UnknownNameError, match="unknown frame 'fingertip'"):
        run(RigidBody(SphereContact("fingertip", 0.01, "plane")))
    with pytest.raises(UnknownNameError, match="unknown side 'left'"):
        JointContact("gripper", 0.2, side="left")
    with pytest.raises(InvalidArgumentError, match="bodies: must hold bodies, but number 0 is str"):
        run("wall")


def test_a_step_too_long_for_the_stiffness_warns_with_the_longest_stable_one():
    """RK4 is stable to |λ|dt = 2.78: with k = 1e6 and m = 0.5, to 1.97 ms."""
    body = RigidBody(JointContact("gripper", 0.2), stiffness=1e6)
    with pytest.warns(UserWarning, match=r"dt = 0\.005 s is too long .* at most 0\.002 s is stable"):
        run(body, dt=5e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run(body, dt=1e-3)
        run(body, dt=5e-3, integrator="implicit_midpoint")
