"""Where the viewer draws things, against another library's kinematics; and what it does when it cannot draw them."""

from __future__ import annotations

import base64
import io

import numpy as np
import pinocchio as pin
import pytest
import yourdfpy

from phcontrol import (
    CompliantBody,
    FeatureFlow,
    JointContact,
    Log,
    MechanicalSystem,
    ObservedObject,
    PHControlError,
    PinholeCamera,
    RigidBody,
    RobotDescriptionWarning,
    SphereContact,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.mechanics.loading import robot_from_record
from phcontrol.visualization.recording import frames_of, record
from phcontrol.visualization.stage import Stage
from tests.conftest import ARMS, make_system

ROW = {
    "kinetic_energy": 1.0,
    "potential_energy": 2.0,
    "storage": 4.0,
    "dissipated_power": 5.0,
    "supplied_power": 6.0,
    "control_power": 7.0,
    "contact_force": 0.0,
    "contact_forces": [],
    "contact_depths": [],
}


def row_of(robot):
    return ROW | {name: np.arange(robot.n) + k for k, name in enumerate(("velocity", "torque", "external_force"))}


def poses(stage, frame):
    count = len(stage.nodes)
    table = frame[1 : 1 + 7 * count].reshape(count, 7)
    return {node.path: pin.XYZQUATToSE3(pose) for node, pose in zip(stage.nodes, table, strict=True)}


def arrows(stage, frame):
    start = 1 + 7 * len(stage.nodes)
    table = frame[start : start + 6 * len(stage.arrows)].reshape(-1, 6)
    return [(row[:3], row[3:]) for row in table]


@pytest.mark.parametrize("name", ARMS)
def test_links_are_where_yourdfpy_puts_them(name, rng):
    """Locked, continuous and mimic joints included, and again after the robot went through a log's record."""
    robot = make_system(name).robot
    again = robot_from_record(robot.record())
    urdf = yourdfpy.URDF.load(io.StringIO(robot.description), build_scene_graph=True, load_meshes=False)
    position = robot.random_position(rng)
    angles = dict(zip(robot.joint_names, position, strict=True)) | robot.locked_joints
    urdf.update_cfg({joint: angles[joint] for joint in urdf.actuated_joint_names})
    for stage in (Stage(robot), Stage(again)):
        placed = poses(stage, stage.frame(0.0, position, row_of(robot)))
        assert any(path.startswith("robot/") for path in placed)
        for path, pose in placed.items():
            if path == "frames/hand":
                np.testing.assert_allclose(pose.homogeneous, urdf.get_transform(stage.trail), atol=1e-6)
                continue
            if name == "panda" and path == "robot/panda_rightfinger":
                continue  # locked at a home of its own, where yourdfpy lets it follow the other
            np.testing.assert_allclose(pose.homogeneous, urdf.get_transform(path.split("/")[1]), atol=1e-6)


def test_all_shapes_of_the_urdf_are_drawn():
    for name in ("pera", "ur5", "panda"):
        robot = load_robot(name)
        urdf = yourdfpy.URDF.load(io.StringIO(robot.description), build_scene_graph=False, load_meshes=False)
        stage = Stage(robot)
        assert stage.notes == []
        wanted = {link.name for link in urdf.robot.links if link.visuals}
        drawn = {node.path.removeprefix("robot/"): node.shapes for node in stage.nodes if node.path != "frames/hand"}
        assert wanted <= drawn.keys()
        for name in drawn.keys() - wanted:  # the others have a ghost from joint to joint, where joints follow
            assert [shape.kind for shape in drawn[name]] == ["sphere", "lines"]
            assert drawn[name][0].color[3] < 1.0


def test_the_ghost_stands_at_the_goal(log):
    stage = Stage.of(log)
    placed = poses(stage, stage.frame(0.0, log.position[-1], log.row(len(log) - 1)))
    robot = load_robot("pera")
    for link in ("hand", "forearm"):
        assert placed[f"goal/{link}"].isApprox(robot.placement(link, log.goal[-1]), 1e-9)
        assert placed[f"robot/{link}"].isApprox(robot.placement(link, log.position[-1]), 1e-9)
    assert "goal/base" not in placed


def test_arrows_are_the_forces(log):
    """The contact force pushes the tip up and away from the table; the wrench pulls at the hand."""
    stage, k = Stage.of(log), len(log) - 1
    (tip, contact), (hand, wrench) = arrows(stage, stage.frame(log.time[k], log.position[k], log.row(k)))
    robot = load_robot("pera")
    assert log.contact_force[k] > 1.0
    np.testing.assert_allclose(contact, [0.0, 0.0, log.contact_force[k]], atol=1e-9)
    np.testing.assert_allclose(wrench, [5.0 * np.sin(log.time[k]), 0.0, -25.0])
    np.testing.assert_allclose(tip, robot.placement("tool", log.position[k]).translation, atol=1e-12)
    np.testing.assert_allclose(hand, robot.placement("hand", log.position[k]).translation, atol=1e-12)
    # the two forces are all that acts on the joints from outside
    x = MechanicalSystem(robot).at(log.position[k])
    sum_of_both = sum(
        force @ x.frame_jacobian(frame, "local_world_aligned")[:3]
        for frame, force in (("tool", contact), ("hand", wrench))
    )
    np.testing.assert_allclose(log.external_force[k], sum_of_both, atol=1e-9)


def test_a_body_in_a_joints_way_is_drawn_where_the_joint_meets_it():
    system = MechanicalSystem(load_robot("pera_gripper"))
    foam = CompliantBody(JointContact("gripper", 0.2), stiffness=2.0, damping=0.1, mass=0.01)
    log = simulate(system, make_controller("energy_shaping", system, goal=[0.1]), duration=2.0, q0=[0.3], bodies=[foam])
    stage, k = Stage.of(log), len(log) - 1
    frame = stage.frame(log.time[k], log.position[k], log.row(k))
    depth = log.contact_depths[k, 0]
    assert depth > 0.01
    for finger in ("left_finger", "right_finger"):
        there = system.robot.placement(finger, [0.2 - depth])
        assert poses(stage, frame)[f"bodies/0/{finger}"].isApprox(there, 1e-9)
    ((_, moment),) = arrows(stage, frame)
    np.testing.assert_allclose(moment, [0.0, 0.0, log.contact_force[k]], atol=1e-9)


def test_a_loaded_log_gives_the_same_page(log, tmp_path):
    direct = record(log, tmp_path / "direct.html").read_bytes()
    loaded = Log.load(log.save(tmp_path / "log.npz"))
    assert record(loaded, tmp_path / "loaded.html").read_bytes() == direct


def test_frames_are_even_and_reach_the_end(log):
    frames = frames_of(log, Stage.of(log), 30.0)
    assert len(frames) == 61
    assert frames[0, 0] == 0.0
    assert frames[-1, 0] == log.time[-1]
    assert np.abs(np.diff(frames[:, 0]) - 1.0 / 30.0).max() < 4e-3 + 1e-9  # one sample


ARM = """<robot name="arm"><link name="base"/>
<link name="arm">
<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>{}</link>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.mark.parametrize(
    ("content", "note"),
    [
        (None, "mesh package://parts/arm.stl is missing"),
        (b"", "cannot be read|is empty"),
        (b"solid nothing\nendsolid nothing\n", "cannot be read|is empty"),
    ],
    ids=["missing", "no content", "no triangles"],
)
def test_a_mesh_that_is_missing_or_broken_is_a_note(tmp_path, content, note):
    mesh = '<visual><geometry><mesh filename="package://parts/arm.stl"/></geometry></visual>'
    (tmp_path / "arm.urdf").write_text(ARM.format(mesh))
    if content is not None:
        (tmp_path / "arm.stl").write_bytes(content)
    with pytest.warns(RobotDescriptionWarning, match=note):  # on the console too
        stage = Stage(load_robot(tmp_path / "arm.urdf"))
    (first, second) = stage.notes
    assert first.startswith("link arm is not drawn: ")
    assert any(part in first for part in note.split("|"))
    assert "lines between its joints" in second
    assert {node.path for node in stage.nodes} == {"robot/base", "robot/arm", "frames/hand"}


def test_a_mesh_beside_its_urdf_is_found_and_scaled(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    (tmp_path / "parts").mkdir()
    trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / "parts" / "arm.stl")
    mesh = '<visual><geometry><mesh filename="package://parts/arm.stl" scale="0.1 0.1 0.1"/></geometry></visual>'
    (tmp_path / "arm.urdf").write_text(ARM.format(mesh))
    (node,) = [node for node in Stage(load_robot(tmp_path / "arm.urdf")).nodes if node.path == "robot/arm"]
    np.testing.assert_allclose(np.ptp(node.shapes[0].points, axis=0), [0.1, 0.2, 0.3], atol=1e-6)


def test_many_missing_meshes_are_one_short_warning_and_a_note_each(tmp_path):
    """A description without its folder of meshes has one missing for each link: the warning went over eleven lines."""
    mesh = '<visual><geometry><mesh filename="meshes/{}.stl"/></geometry></visual>'
    (tmp_path / "arm.urdf").write_text(ARM.format("".join(mesh.format(number) for number in range(9))))
    with pytest.warns(RobotDescriptionWarning) as warned:
        stage = Stage(load_robot(tmp_path / "arm.urdf"))
    (message,) = [str(warning.message) for warning in warned]
    assert message.count("is not drawn") == 2
    assert "; and 7 more. Meshes are sought from the folder of the description on" in message
    assert sum("is not drawn" in note for note in stage.notes) == 9


def test_what_a_log_does_not_hold_is_said(log):
    stripped = Log(log._data, {key: value for key, value in log.metadata.items() if key != "robot_record"}, log._loop)
    with pytest.raises(PHControlError, match="does not hold its robot's description"):
        Stage.of(stripped)
    assert Stage.of(stripped, load_robot("pera")).nodes


def test_a_body_with_a_geometry_of_its_own_is_a_note():
    class Somewhere:
        def gap(self, x):
            return JointContact("gripper", 0.2).gap(x)

    system = MechanicalSystem(load_robot("pera_gripper"))
    log = simulate(
        system, make_controller("energy_shaping", system), duration=0.1, q0=[0.3], bodies=[RigidBody(Somewhere())]
    )
    stage = Stage.of(log)
    assert any("body 0 is not drawn" in note for note in stage.notes)
    assert frames_of(log, stage, 30.0).shape[1] == 1 + 7 * len(stage.nodes) + len(stage.signals) + 3


@pytest.mark.parametrize("shape", ["sphere", "box"])
def test_bodies_in_space_stand_where_they_are(shape):
    system = make_system("pera")
    size = 0.05 if shape == "sphere" else [0.1, 0.2, 0.05]
    body = RigidBody(SphereContact("tool", 0.01, shape, size=size, position=[0.9, 0.1, 0.4]))
    log = simulate(system, make_controller("energy_shaping", system), duration=0.05, bodies=[body])
    stage = Stage.of(log)
    placed = poses(stage, stage.frame(0.0, log.position[0], log.row(0)))
    np.testing.assert_allclose(placed["bodies/0/shape"].translation, [0.9, 0.1, 0.4])
    (node,) = [node for node in stage.nodes if node.path == "bodies/0/shape"]
    assert node.shapes[0].kind == shape
    np.testing.assert_allclose(node.shapes[0].size, np.atleast_1d(size))


def test_the_camera_its_image_and_the_object():
    """The object is where the camera's features, projected by hand, say; the frustum's edges span its field of view."""
    system = make_system("pera")
    camera = PinholeCamera(image_size=(640, 480), field_of_view=np.pi / 2)
    seen = ObservedObject.seen_as(camera, [0.004, 0.003, 0.0028], system.at(system.robot.home))
    law = make_controller("hamiltonian_servo", system, camera=camera)
    log = simulate(system, law, duration=0.3, dt=5e-3, scene=seen)
    stage, k = Stage.of(log), len(log) - 1
    frame = stage.frame(log.time[k], log.position[k], log.row(k))
    placed = poses(stage, frame)
    eye = placed["camera/frustum"]
    x, y, z = eye.actInv(placed["object/box"].translation)
    np.testing.assert_allclose([0.01 * x / z, 0.01 * y / z, 0.01 * 0.038 / z], log.features[k], atol=1e-12)
    np.testing.assert_allclose(frame[-3:], log.features[k])
    (frustum,) = [node for node in stage.nodes if node.path == "camera/frustum"]
    corner = np.abs(frustum.shapes[0].points).max(axis=0)
    np.testing.assert_allclose(corner / corner[2], [1.0, 0.75, 1.0])  # 90 degrees wide, 3/4 as high
    assert stage.image["goal"] == [0.0, 0.0, 0.002]
    assert stage.image["width"] == pytest.approx(0.02)


def test_a_camera_whose_image_has_no_end_shows_all_there_is_to_see():
    system = make_system("pera_shoulder_elbow")
    flow = FeatureFlow(PinholeCamera(), [0.004, -0.003, 0.0028], 0.038)
    law = make_controller("hamiltonian_servo", system)
    log = simulate(system, law, duration=0.1, dt=5e-3, scene=flow, q0=[0.0, 0.7, -1.8])
    stage = Stage.of(log)
    half = [0.5 * stage.image["width"], 0.5 * stage.image["height"]]
    assert (np.abs(log.features[:, :2]).max(axis=0) < half).all()
    assert not any(node.path.startswith(("object/", "goal/")) for node in stage.nodes)
    assert np.isfinite(frames_of(log, stage, 30.0)).all()


def test_signals_are_those_of_the_log(log):
    stage, k = Stage.of(log), len(log) // 2
    robot, signals = load_robot("pera"), {}
    begin = 1 + 7 * len(stage.nodes) + 6 * len(stage.arrows)
    values = stage.frame(log.time[k], log.position[k], log.row(k))[begin : begin + len(stage.signals)]
    for signal, value in zip(stage.signals, values, strict=True):
        signals.setdefault(signal.group, {})[signal.label] = (value, signal)
    elbow = robot.joint_names.index("elbow_pitch")
    assert signals["storage function"]["storage function H_d"][0] == log.storage[k]
    assert signals["energy of the arm"]["energy H of the arm"][0] == log.kinetic_energy[k] + log.potential_energy[k]
    assert signals["contact"]["contact force"][0] == log.contact_force[k]
    for group, array in (
        ("position", log.position), ("velocity", log.velocity), ("torque", log.torque),
        ("external force", log.external_force), ("joint error", log.position - log.goal),
    ):  # fmt: skip
        assert signals[group]["elbow_pitch"][0] == array[k, elbow], group
    assert signals["torque"]["elbow_pitch"][1].limits == (-robot.effort_limit[elbow], robot.effort_limit[elbow])
    assert signals["position"]["elbow_pitch"][1].limits == (robot.lower[elbow], robot.upper[elbow])
    here, there = (robot.placement("tool", position) for position in (log.position[k], log.goal[k]))
    off = signals["hand to its goal"]
    assert off["distance"][0] == pytest.approx(np.linalg.norm(here.translation - there.translation), abs=1e-12)
    angle = np.arccos(0.5 * (np.trace(here.rotation.T @ there.rotation) - 1.0))
    assert off["angle"][0] == pytest.approx(angle, abs=1e-9)


def test_meshes_are_written_to_a_4000th_of_their_size(rng):
    from phcontrol.visualization.shapes import Shape

    points, faces = rng.normal(size=(500, 3)), rng.integers(0, 500, (900, 3))
    entry = Shape("mesh", points=points, faces=faces).to_dict()
    assert np.abs(unpacked_points(entry) - points).max() <= np.ptp(points, axis=0).max() / 4000.0
    np.testing.assert_array_equal(whole_numbers(entry["faces"], 1).reshape(-1, 3), faces)
    wide = Shape("mesh", points=np.zeros((70_000, 3)), faces=np.array([[0, 69_999, 1]])).to_dict()
    assert np.frombuffer(base64.b64decode(wide["faces"]), dtype="<u4").tolist() == [0, 69_999, 1]


def whole_numbers(text, columns):
    """Read what ``shapes.differences`` writes, by its description."""
    low, high = np.frombuffer(base64.b64decode(text), dtype=np.uint8).astype(np.int64).reshape(2, -1)
    coded = low + 256 * high
    steps = np.where(coded % 2, -(coded + 1) // 2, coded // 2).reshape(columns, -1)
    return np.cumsum(steps, axis=1).T % 65536


def unpacked_points(entry):
    return entry["low"] + whole_numbers(entry["points"], 3) * np.array(entry["step"])
