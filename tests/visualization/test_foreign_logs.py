"""Logs that somebody else may have written: nothing that they name is opened, and what cannot be is said."""

from __future__ import annotations

import json

import numpy as np
import pytest

from phcontrol import Log, MechanicalSystem, PHControlError, RigidBody, SphereContact, load_robot, make_controller
from phcontrol import simulate as run
from phcontrol.mechanics.catalogue import example_robots
from phcontrol.visualization.recording import recorded_page
from phcontrol.visualization.shapes import Shape, find_mesh
from phcontrol.visualization.stage import Stage
from tests.browser import run_of
from tests.log_files import contents, sealed
from tests.visualization.test_stage import ARM

pytestmark = pytest.mark.filterwarnings("ignore:.*is not drawn")  # said on the page is what is asserted here

MESH = '<visual><geometry><mesh filename="{}"/></geometry></visual>'


@pytest.fixture
def private(tmp_path):
    """A file that is none of the log's business, and its content as a page would have it."""
    trimesh = pytest.importorskip("trimesh")
    folder = tmp_path / "private"
    folder.mkdir()
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    box.export(folder / "scan.stl")
    return folder / "scan.stl"


@pytest.fixture
def own(tmp_path):
    """A log of an arm of the user's own, in its file."""
    (tmp_path / "arm").mkdir()
    (tmp_path / "arm" / "arm.urdf").write_text(ARM.format(""))
    system = MechanicalSystem(load_robot(tmp_path / "arm" / "arm.urdf"))
    log = run(system, make_controller("energy_shaping", system, goal=[0.5]), duration=0.05)
    return log.save(tmp_path / "log.npz")


def forged(path, **changes):
    np.savez(path, **sealed(contents(path), **changes))
    return Log.load(path)


def meshes(stage):
    return [shape for node in stage.nodes for shape in node.shapes if shape.kind == "mesh"]


@pytest.mark.parametrize("kind", ["absolute", "file", "upwards", "package", "below a folder it names"])
@pytest.mark.parametrize("name", ["arm", "panda", "../../arm.urdf"])
def test_meshes_that_a_log_names_are_not_opened(own, private, kind, name, monkeypatch):
    monkeypatch.chdir(private.parent)
    mesh, folders = {
        "absolute": (str(private), []),
        "file": (f"file://{private}", []),
        "upwards": ("../private/scan.stl", [str(private.parent)]),
        "package": ("package://x/../scan.stl", [str(private.parent / "x")]),
        "below a folder it names": (f"package:/{private}", ["/"]),
    }[kind]
    if kind == "package":
        (private.parent / "x").mkdir()
    record = json.loads(contents(own)["metadata"].tobytes())["robot_record"]
    record |= {"urdf": ARM.format(MESH.format(mesh)), "package_directories": folders, "name": name}
    log = forged(own, robot_record=record)
    stage = Stage.of(log)
    assert meshes(stage) == []
    reason = "missing" if name == "panda" and kind == "below a folder it names" else "not opened because a log's file"
    assert stage.notes[0].startswith(f"link arm is not drawn: mesh {mesh} is {reason}")
    # with the robot that the user names, it is
    (own.parent / "arm" / "arm.urdf").write_text(ARM.format(MESH.format(private)))
    assert meshes(Stage.of(log, load_robot(own.parent / "arm" / "arm.urdf")))


def test_a_link_does_not_lead_out_of_a_robots_folders(own, private):
    robot = load_robot(own.parent / "arm" / "arm.urdf")
    folder = own.parent / "arm"
    (folder / "inner.stl").symlink_to(private)
    (folder / "out").symlink_to(private.parent)
    for name in ("inner.stl", "package://inner.stl", "out/scan.stl", "package://arm/out/scan.stl"):
        assert find_mesh(name, robot).samefile(private)
        with pytest.raises(FileNotFoundError, match="not opened because a log's file names it"):
            find_mesh(name, robot, confined=True)
    (folder / "own.stl").write_bytes(private.read_bytes())
    assert find_mesh("package://arm/own.stl", robot, confined=True) == folder / "own.stl"


def test_the_mesh_of_a_body_is_not_opened(private, tmp_path):
    system = MechanicalSystem(load_robot("pera"))
    body = RigidBody(SphereContact.with_mesh("tool", 0.01, private, position=[3.0, 0.0, 0.0]))
    log = run(system, make_controller("energy_shaping", system), duration=0.01, bodies=[body])
    assert len(meshes(Stage.of(log))) == 1
    points = meshes(Stage.of(log))[0].points
    packed = Shape("mesh", points=points).to_dict()["points"]
    assert packed in run_of(recorded_page(log))
    loaded = Log.load(log.save(tmp_path / "log.npz"))
    (note,) = Stage.of(loaded).notes
    assert f"body 0 is not drawn: its mesh {private.resolve()} is not opened" in note
    assert packed not in run_of(recorded_page(loaded))


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_the_meshes_of_an_installed_robot_are_those_installed_here(name, tmp_path):
    """Wherever the log comes from: the folders that it names are not on this machine."""
    system = MechanicalSystem(load_robot(name))
    log = run(system, make_controller("energy_shaping", system), duration=0.01)
    assert len(meshes(Stage.of(log))) > 5
    path = log.save(tmp_path / "log.npz")
    record = log.metadata["robot_record"] | {"package_directories": ["/nowhere"]}
    assert name in example_robots()
    assert recorded_page(forged(path, robot_record=record)) == recorded_page(log)


@pytest.mark.parametrize(
    "record",
    [
        {}, {"urdf": 5}, {"urdf": "<robot/>"}, {"locked_joints": "abc"}, {"locked_joints": {"turn": "x"}},
        {"joint_names": ["other"]}, {"tool_frame": "nowhere"}, {"tool_frame": 5}, {"name": None}, {"name": ["x"]},
        {"urdf": ARM.format('<visual><geometry><sphere radius="x"/></geometry></visual>')},
    ],
)  # fmt: skip
def test_robots_that_are_none_are_said(own, record):
    known = json.loads(contents(own)["metadata"].tobytes())["robot_record"]
    log = forged(own, robot_record=known | record if record else {})
    if record in ({"name": None}, {"name": ["x"]}):
        assert recorded_page(log)
        return
    with pytest.raises(PHControlError):
        recorded_page(log)


@pytest.mark.parametrize(
    "visual",
    [
        '<geometry><box size="nan 1 1"/></geometry>',
        '<geometry><box size="1"/></geometry>',
        '<origin xyz="1e999 0 0"/><geometry><sphere radius="1"/></geometry>',
        '<origin rpy="nan 0 0"/><geometry><cylinder radius="1" length="1"/></geometry>',
    ],
)
def test_shapes_that_are_none_are_a_note(own, visual):
    record = json.loads(contents(own)["metadata"].tobytes())["robot_record"]
    log = forged(own, robot_record=record | {"urdf": ARM.format(f"<visual>{visual}</visual>")})
    assert any("link arm is not drawn" in note for note in Stage.of(log).notes)
    assert recorded_page(log)


CAMERA = {"frame": "arm", "focal_length": 0.01, "half_size": [0.1, 0.1]}
SEEN = {"position": [1.0, 0.0, 0.0], "rotation": np.eye(3).tolist(), "size": [0.1, 0.1, 0.1]}
SIGHTS = [
    {}, {"camera": 5}, {"camera": CAMERA | {"frame": "nowhere"}}, {"camera": CAMERA | {"focal_length": "x"}},
    {"camera": CAMERA | {"focal_length": 0.0}}, {"camera": CAMERA | {"half_size": [1.0]}},
    {"camera": CAMERA, "object": {}}, {"camera": CAMERA, "object": SEEN | {"rotation": [1.0]}},
    {"camera": CAMERA, "object": SEEN | {"size": [1.0]}}, {"camera": CAMERA, "object": SEEN, "goal": ["x"]},
    {"camera": CAMERA | {"half_size": [float("nan"), 1.0]}, "object": SEEN, "goal": None},
]  # fmt: skip


@pytest.mark.parametrize("sight", SIGHTS)
def test_cameras_that_are_none_are_said(own, sight):
    arrays = contents(own)
    arrays["features"] = np.zeros((len(arrays["time"]), 3))
    np.savez(own, **sealed(arrays, sight={"object": None, "goal": None} | sight if sight else {"x": 1}))
    log = Log.load(own)
    with pytest.raises(PHControlError):
        recorded_page(log)


PLANE = {
    "kind": "sphere", "frame": "arm", "radius": 0.1, "shape": "plane", "size": None, "position": [0.0, 0.0, 0.0],
    "rotation": np.eye(3).tolist(),
}  # fmt: skip


@pytest.mark.parametrize(
    "geometry",
    [
        5, {}, {"kind": "joint"}, {"kind": "joint", "joint": "none", "position": 0.0, "side": "below"},
        {"kind": "joint", "joint": "turn", "position": "x", "side": "below"}, PLANE | {"frame": "nowhere"},
        PLANE | {"radius": -1.0}, PLANE | {"shape": "ghost"}, PLANE | {"shape": "box", "size": [1.0]},
        PLANE | {"rotation": [1.0]}, PLANE | {"position": "x"}, PLANE | {"shape": ["mesh"]},
    ],
)  # fmt: skip
def test_bodies_that_are_none_are_a_note(own, geometry):
    arrays = contents(own)
    arrays |= {name: np.zeros((len(arrays["time"]), 1)) for name in ("contact_forces", "contact_depths")}
    np.savez(own, **sealed(arrays, bodies=[{"geometry": geometry}]))
    log = Log.load(own)
    assert any("body 0 is not drawn" in note for note in Stage.of(log).notes)
    assert recorded_page(log)


def test_wrenches_at_a_frame_that_is_none_are_said(own):
    arrays = contents(own)
    arrays["wrench_forces"] = np.zeros((len(arrays["time"]), 1, 3))
    np.savez(own, **sealed(arrays, wrench_frames=["nowhere"]))
    with pytest.raises(PHControlError, match="unknown frame 'nowhere'"):
        recorded_page(Log.load(own))


def test_a_log_is_not_shown_on_another_arm(own):
    with pytest.raises(PHControlError, match=r"this log is of the joints \['turn'\], pera_shoulder has"):
        recorded_page(Log.load(own), robot=load_robot("pera_shoulder"))


def test_a_name_cannot_take_the_place_of_a_part_of_the_page(own):
    record = json.loads(contents(own)["metadata"].tobytes())["robot_record"]
    page = recorded_page(forged(own, robot_record=record | {"name": "{{run}}</title><script>alert(1)</script>"}))
    assert "<title>{{run}}&lt;/title&gt;&lt;script&gt;" in page
    assert "<script>alert(1)" not in page


def test_an_object_that_is_not_seen_for_a_while_can_be_shown(tmp_path):
    """Its features are NaN then: the image has a size all the same."""
    from phcontrol import FeatureFlow, PinholeCamera

    system = MechanicalSystem(load_robot("pera_shoulder_elbow"))
    flow = FeatureFlow(PinholeCamera(), [0.004, -0.003, 0.0028], 0.038)
    log = run(system, make_controller("hamiltonian_servo", system), duration=0.02, scene=flow, q0=[0.0, 0.7, -1.8])
    arrays = contents(log.save(tmp_path / "log.npz"))
    arrays["features"][-3:] = np.nan
    np.savez(tmp_path / "log.npz", **sealed(arrays))
    assert recorded_page(Log.load(tmp_path / "log.npz"))
