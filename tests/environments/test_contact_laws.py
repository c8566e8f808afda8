"""Surfaces and bodies against poles of polynomials and the energy that flows; geometry kept in records."""

from __future__ import annotations

import coal
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phcontrol import InvalidArgumentError, RobotDescriptionError
from phcontrol.environments.body import Surface
from phcontrol.environments.compliant_body import CompliantBody
from phcontrol.environments.contact_geometry import (
    JointContact,
    SphereContact,
    effective_mass,
    geometry_from_record,
)
from phcontrol.environments.rigid_body import RigidBody
from tests.conftest import make_system
from tests.finite_differences import derivative

K, D, ONSET = 2000.0, 30.0, 1e-3


def test_a_surface_is_a_spring_and_a_damper_that_sets_in():
    surface = Surface(K, D, ONSET)
    assert surface.push(2e-3, 0.1) == pytest.approx((K * 2e-3 + D * 0.1, 0.5 * K * 4e-6, D * 0.01))
    assert surface.push(5e-4, 0.1) == pytest.approx((K * 5e-4 + 0.5 * D * 0.1, 0.5 * K * 25e-8, 0.5 * D * 0.01))
    assert surface.push(1e-4, -1.0) == pytest.approx((0.0, 0.5 * K * 1e-8, K * 1e-4))  # let go: the spring's is lost
    assert surface.push(0.0, 1.0) == surface.push(-1.0, -1.0) == (0.0, 0.0, 0.0)


@given(st.floats(1.0, 1e5), st.floats(0.0, 1e3), st.floats(1e-3, 10.0))
def test_the_fastest_rate_is_that_of_the_fastest_pole(stiffness, damping, mass):
    poles = np.roots([mass, damping, stiffness])
    # where both poles nearly meet, rounding moves them by the root of itself
    assert Surface(stiffness, damping, 1e-3).fastest_rate(mass) == pytest.approx(np.abs(poles).max(), rel=1e-6)
    assert Surface(stiffness, damping, 1e-3).fastest_rate(np.inf) == 0.0


def bodies():
    contact = SphereContact("tool", 0.02, "plane", position=[0.0, 0.0, 0.3])
    return [
        (RigidBody(contact, stiffness=K, damping=D, onset=ONSET), np.zeros(0)),
        (CompliantBody(contact, stiffness=90.0, damping=4.0, mass=0.3, onset=ONSET), np.array([0.01, 0.05])),
        (CompliantBody(contact, stiffness=90.0, damping=4.0, mass=0.3, onset=ONSET), np.array([0.01, 5.0])),
    ]


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize("depth", [-0.05, 5e-4, 0.02])
def test_what_the_arm_gives_is_stored_or_lost(number, depth):
    """−f_eᵀq̇ = d/dt stored + dissipated, the rate by finite differences along the motion of arm and body."""
    body, state = bodies()[number]
    system = make_system("pera")
    q = system.robot.home + np.linspace(0.2, -0.3, 7)
    velocity = np.linspace(-0.5, 0.4, 7)
    height = system.at(q).placement("tool").translation[2]
    displacement = body.displacement(state)
    body.geometry = SphereContact("tool", 0.02, "plane", position=[0.0, 0.0, height - 0.02 + displacement + depth])
    x = system.at(q, velocity)
    assert body.geometry.gap(x).distance == pytest.approx(-depth - displacement)
    touch = body.touch(x, state)

    def stored(h):
        return np.array(body.touch(system.at(q + h * velocity, velocity), state + h * touch.state_rate).stored)

    step = 1e-5 if depth > 0.0 else 1e-3
    power = -float(touch.force @ velocity)
    assert power == pytest.approx(float(derivative(stored, step)) + touch.dissipated, rel=1e-6, abs=1e-9)
    assert touch.dissipated >= 0.0
    assert (touch.magnitude == 0.0) is (depth < 0.0 or touch.magnitude <= 0.0)
    np.testing.assert_allclose(touch.force, body.geometry.gap(x).slope * touch.magnitude, atol=1e-12)
    if state.size:
        speed = state[1] / 0.3
        np.testing.assert_allclose(touch.state_rate, [speed, touch.magnitude - 90.0 * state[0] - 4.0 * speed])


def test_a_compliant_body_is_touched_by_default_a_hundred_times_stiffer_and_critically_damped():
    body = CompliantBody(JointContact("gripper", 0.2), stiffness=5.0, damping=0.0, mass=0.02)
    assert body.surface.stiffness == 500.0
    poles = np.roots([0.02, body.surface.damping, 500.0])
    np.testing.assert_allclose(poles, -np.sqrt(500.0 / 0.02), rtol=1e-6)
    assert (body.state_size, body.initial_state().tolist(), body.surface.onset) == (2, [0.0, 0.0], 1e-4)
    own = CompliantBody(JointContact("gripper", 0.2), stiffness=5.0, damping=0.0, mass=0.02, surface_damping=0.0)
    assert own.surface.damping == 0.0
    rigid = RigidBody(JointContact("gripper", 0.2))
    assert (rigid.surface.stiffness, rigid.surface.damping, rigid.surface.onset) == (1e4, 0.0, 1e-4)
    assert (rigid.state_size, rigid.initial_state().size, rigid.displacement(np.zeros(0))) == (0, 0, 0.0)


def test_the_fastest_rate_of_bodies():
    """Of the arm's effective mass on the surface; of the reduced mass, the body on its spring, and its damper."""
    system = make_system("pera_gripper")
    x = system.at([0.3])
    arm = float(system.at([0.3]).mass_matrix[0, 0])
    where = JointContact("gripper", 0.25)
    assert RigidBody(where, stiffness=100.0).fastest_rate(x) == pytest.approx(np.sqrt(100.0 / arm))
    reduced = 1.0 / (1.0 / arm + 1.0 / 0.2)
    for stiffness, damping, surface, expected in [
        (5.0, 0.1, 700.0, np.sqrt(700.0 / reduced)),
        (9e4, 0.1, 1.0, np.sqrt(9e4 / 0.2)),
        (5.0, 900.0, 1.0, 900.0 / 0.2),
    ]:
        body = CompliantBody(
            where, stiffness=stiffness, damping=damping, mass=0.2, surface_stiffness=surface, surface_damping=0.0
        )
        assert body.fastest_rate(x) == pytest.approx(expected)


def test_the_effective_mass_is_what_a_push_along_the_gap_feels(rng):
    system = make_system("pera")
    x = system.at(system.robot.random_position(rng))
    slope = rng.normal(size=7)
    acceleration = np.linalg.solve(x.mass_matrix, slope)  # under a unit force along the gap
    assert effective_mass(x, slope) == pytest.approx(1.0 / (slope @ acceleration))
    assert effective_mass(x, np.zeros(7)) == np.inf
    body = CompliantBody(SphereContact("tool", 0.02, "plane"), stiffness=50.0, damping=0.0, mass=0.5)
    far = system.at(x.position)
    body.geometry.gap = lambda state: type(SphereContact("tool", 0.02, "plane").gap(state))(1.0, np.zeros(7))
    assert body.fastest_rate(far) == pytest.approx(np.sqrt(5000.0 / 0.5))  # an arm that cannot move along the gap


@pytest.mark.parametrize(("side", "sign"), [("below", 1.0), ("above", -1.0)])
def test_the_gap_of_a_joint(side, sign):
    system = make_system("pera_shoulder")
    name = system.robot.joint_names[1]
    gap = JointContact(name, 0.2, side).gap(system.at([0.7, 0.5]))
    assert gap.distance == pytest.approx(sign * 0.3)
    np.testing.assert_array_equal(gap.slope, [0.0, sign])


TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("shape", "size"), [("plane", None), ("sphere", 0.1), ("box", [0.2, 0.3, 0.1])], ids=["plane", "sphere", "box"]
)
def test_a_geometry_is_kept_in_its_record(shape, size, pera):
    contact = SphereContact("tool", 0.02, shape, size=size, position=[0.5, 0.1, 0.2], rotation=TURN)
    record = contact.record()
    assert record == {
        "kind": "sphere", "frame": "tool", "radius": 0.02, "shape": shape, "size": size,
        "position": [0.5, 0.1, 0.2], "rotation": TURN.tolist(),
    }  # fmt: skip
    again, x = geometry_from_record(record), pera.at(pera.robot.home)
    assert again.record() == record
    assert again.gap(x).distance == contact.gap(x).distance
    default = SphereContact("tool", 0.02, shape, size=size)
    assert default.position.tolist() == [0.0, 0.0, 0.0]
    np.testing.assert_array_equal(default.rotation, np.eye(3))


def test_joints_and_shapes_of_ones_own_in_records(pera):
    joint = JointContact("gripper", 0.2, "above")
    assert joint.record() == {"kind": "joint", "joint": "gripper", "position": 0.2, "side": "above"}
    assert geometry_from_record(joint.record()).record() == joint.record()
    own = SphereContact("tool", 0.02, coal.Sphere(0.1), position=[0.0, 0.0, 1.0]).record()
    assert own["shape"] == "other"
    for record in (own, {"kind": "other"}, {}):
        with pytest.raises(RobotDescriptionError, match="a shape of its own that a log does not keep"):
            geometry_from_record(record)
    body = RigidBody(joint)
    assert body.record() == {"kind": "RigidBody", "geometry": joint.record()}
    body.geometry = type("Own", (), {})()
    assert body.record() == {"kind": "RigidBody", "geometry": {"kind": "other"}}


def test_a_mesh_is_kept_by_its_path(tmp_path):
    path = tmp_path / "tetrahedron.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    record = SphereContact.with_mesh("tool", 0.02, path, position=[1.0, 0.0, 0.0]).record()
    assert (record["shape"], record["path"], record["position"]) == ("mesh", str(path.resolve()), [1.0, 0.0, 0.0])
    assert geometry_from_record(record).record() == record


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: SphereContact("tool", 0.9e-6, "plane"), "radius: must be >= 1e-06"),
        (lambda: SphereContact("tool", 0.01, "sphere", size=0.9e-6), "size: must be >= 1e-06"),
        (lambda: SphereContact("tool", 0.01, "box", size=[1.0, 0.0, 1.0]), "size: edges must be > 0"),
        (lambda: SphereContact("tool", 0.01, "box", size=[1.0, 1.0]), r"size: must have shape \(3,\)"),
        (lambda: SphereContact("tool", 0.01, "plane", rotation=np.diag([1.0, 1.0, -1.0])), "rotation: must be"),
        (lambda: SphereContact("tool", 0.01, "plane", rotation=np.eye(3) + 1e-8 * np.eye(3, k=1)), "rotation: must be"),
        (lambda: SphereContact("tool", 0.01, "plane", rotation=np.eye(2)), "rotation: must be"),
        (lambda: SphereContact("tool", 0.01, "plane", rotation=(1.0 + 4e-6) * np.eye(3)), "rotation: must be"),
        (lambda: SphereContact("tool", 0.01, "plane", rotation="turned"), "rotation: must be an array"),
        (lambda: SphereContact("tool", 0.01, "plane", rotation=np.full((3, 3), np.nan)), "rotation: must be finite"),
        (lambda: CompliantBody(JointContact("g", 0.2), stiffness=1.0, damping=-0.1, mass=1.0), "damping: must be >= 0"),
        (lambda: CompliantBody(JointContact("g", 0.2), stiffness=0.0, damping=0.0, mass=1.0), "stiffness: must be > 0"),
        (lambda: RigidBody(JointContact("g", 0.2), damping=-0.1), "damping: must be >= 0"),
        (lambda: Surface(0.0, 0.0, 1.0), "stiffness: must be > 0"),
        (lambda: Surface(1.0, 0.0, 0.0), "onset: must be > 0"),
    ],
)
def test_bad_shapes_are_refused(make, complaint):
    with pytest.raises(InvalidArgumentError, match=complaint):
        make()


def test_the_smallest_shapes_and_nearly_exact_rotations_are_taken():
    assert SphereContact("tool", 1e-6, "sphere", size=1e-6).radius == 1e-6
    SphereContact("tool", 0.01, "plane", rotation=np.eye(3) + 1e-10 * np.eye(3, k=1))
