"""A payload is what a link on a fixed joint would be, in every quantity, in logs, certificates and commands."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
import pytest
from typer.testing import CliRunner

from phcontrol import (
    InvalidArgumentError,
    Log,
    MechanicalSystem,
    Payload,
    UnknownNameError,
    certify,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.cli import application
from phcontrol.cli.arm_options import payload_of
from phcontrol.mechanics.catalogue import find
from phcontrol.mechanics.loading import robot_from_record

MASS, COM = 1.3, (0.02, -0.01, 0.07)
INERTIA = np.array([[0.012, 0.001, -0.002], [0.001, 0.009, 0.0005], [-0.002, 0.0005, 0.007]])
FRAMES = {"panda": "panda_hand_tcp", "pera": "forearm", "ur5": "tool0", "pera_with_gripper": "forearm"}


def frame_of(arm):
    robot = load_robot(arm)
    return FRAMES[arm] if FRAMES[arm] in robot.frame_names else robot.tool_frame or robot.frame_names[-1]


def with_link(arm, frame, tmp_path):
    """The same arm from a URDF in which the body is a link."""
    text = load_robot(arm).description
    root = ET.fromstring(text)
    link = ET.SubElement(root, "link", name="carried")
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=" ".join(map(repr, COM)))
    ET.SubElement(inertial, "mass", value=repr(MASS))
    names = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
    ET.SubElement(inertial, "inertia", {name: repr(float(INERTIA[place])) for name, place in names.items()})
    joint = ET.SubElement(root, "joint", name="carried_joint", type="fixed")
    ET.SubElement(joint, "parent", link=frame)
    ET.SubElement(joint, "child", link="carried")
    path = tmp_path / f"{arm}.urdf"
    path.write_text(ET.tostring(root, encoding="unicode"))
    return load_robot(path, armature=dict(find(arm).extras.get("armature", {})) or None)


@pytest.mark.filterwarnings("ignore::phcontrol.RobotDescriptionWarning")
@pytest.mark.parametrize("arm", FRAMES)
def test_it_is_what_a_link_would_be(arm, tmp_path, rng):
    frame = frame_of(arm)
    carrying = MechanicalSystem(load_robot(arm, payload=Payload(MASS, COM, INERTIA, frame)))
    linked = MechanicalSystem(with_link(arm, frame, tmp_path), potentials=carrying.robot.potentials)
    plain = MechanicalSystem(load_robot(arm))
    for _ in range(5):
        q, v = carrying.robot.random_position(rng), rng.normal(size=carrying.n)
        a, b, without = carrying.at(q, v), linked.at(q, v), plain.at(q, v)
        for name in ("mass_matrix", "potential_gradient", "coriolis_matrix"):
            np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=0.0, atol=1e-12, err_msg=name)
        assert np.abs(a.mass_matrix - without.mass_matrix).max() > 0.01
        assert a.energy - without.energy == pytest.approx(b.energy - without.energy, abs=1e-10)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"mass": -0.1}, "payload.mass: must be >= 0"),
        ({"mass": float("nan")}, "payload.mass: must be finite"),
        ({"mass": 1.0, "com": (0.0, 0.1)}, "payload.com: must have shape"),
        ({"mass": 1.0, "inertia": (1.0, 0.3, 0.3)}, "at most the sum of the others"),
        ({"mass": 1.0, "inertia": (0.1, 0.1, -0.01)}, "none may be negative"),
        ({"mass": 1.0, "inertia": [[1, 2, 0], [0, 1, 0], [0, 0, 1]]}, "must be symmetric"),
        ({"mass": 1.0, "inertia": 0.1}, "its diagonal"),
        ({"mass": 0.0, "inertia": (0.1, 0.1, 0.1)}, "but no mass"),
        ({"mass": 1.0, "frame": ""}, "payload.frame: must be a name"),
    ],
)
def test_a_body_that_cannot_exist_is_refused(arguments, said):
    with pytest.raises(InvalidArgumentError, match=said):
        Payload(**arguments)


def test_a_frame_must_be_named_known_and_moved():
    with pytest.raises(InvalidArgumentError, match=r"payload\.frame: must be given, for panda names no tool frame"):
        load_robot("panda", payload=Payload(1.0))
    with pytest.raises(UnknownNameError, match="Did you mean 'panda_hand'"):
        load_robot("panda", payload=Payload(1.0, frame="panda_hnad"))
    with pytest.raises(InvalidArgumentError, match="is fixed to the base"):
        load_robot("panda", payload=Payload(1.0, frame="panda_link0"))
    for wrong in (1.0, [1.0], "1"):
        with pytest.raises(InvalidArgumentError, match="payload: must be a Payload"):
            load_robot("pera", payload=wrong)


def test_a_thin_plate_is_a_body_and_two_payloads_add():
    plate = Payload(1.0, inertia=(0.1, 0.2, 0.3), frame="panda_hand")
    robot = load_robot("panda", payload=[plate, Payload(0.5, frame="panda_hand")])
    assert robot.label == "panda with 1 kg at panda_hand, 0.5 kg at panda_hand"
    total = sum(inertia.mass for inertia in robot.model.inertias)
    assert total == pytest.approx(1.5 + sum(inertia.mass for inertia in load_robot("panda").model.inertias))


def test_it_is_kept_in_a_log_and_named_in_a_certificate(tmp_path):
    robot = load_robot("pera", payload=Payload(MASS, COM, INERTIA, frame_of("pera")))
    system = MechanicalSystem(robot)
    law = make_controller("energy_shaping", system)
    log = simulate(system, law, q0=robot.near_home(), duration=0.05, progress=False)
    path = log.save(tmp_path / "log.npz")
    read = Log.load(path)
    record = read.metadata["robot_record"]["payloads"]
    assert record == [robot.payloads[0].record()]
    assert Payload.from_record(record[0]).record() == record[0]
    assert read.power_balance("plant").relative_residual < 1e-3
    assert robot_from_record(read.metadata["robot_record"]).label == robot.label
    assert certify(law, samples=4).robot == robot.label


def test_the_option_of_the_command_line():
    body = payload_of("mass=1.5,com=0 0 0.05,inertia=0.01 0.01 0.02,frame=hand")
    assert body.record() == {
        "mass": 1.5, "com": [0.0, 0.0, 0.05], "inertia": np.diag([0.01, 0.01, 0.02]).tolist(), "frame": "hand",
    }  # fmt: skip
    assert payload_of("2").record() == Payload(2.0).record()
    for wrong in ("mass", "1,2", "com=0 0 1", "mass=1,com=0 0", "mass=1,mas=2", "mass=1,mass=2", "mass=x"):
        with pytest.raises(InvalidArgumentError, match="--payload: must be a mass"):
            payload_of(wrong)
    command = ["certify", "--robot", "panda", "--controller", "energy_shaping", "--samples", "4"]
    command += ["--interconnection", "coriolis", "--payload"]
    shown = CliRunner().invoke(application.app, [*command, "mass=1,frame=panda_hand"])
    assert shown.exit_code == 0, shown.output
    assert "on panda with 1 kg at panda_hand: PASSED" in shown.output
    refused = CliRunner().invoke(application.app, [*command, "-1"])
    assert refused.exit_code != 0
    assert "must be >= 0" in refused.output
