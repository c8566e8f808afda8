"""MuJoCo's models: as MuJoCo itself has them, and refused where something would be dropped."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from phcontrol import (
    Log,
    MechanicalSystem,
    Payload,
    RobotDescriptionError,
    certify,
    load_robot,
    make_controller,
    simulate,
)
from phcontrol.mechanics import catalogue, mjcf
from phcontrol.mechanics.loading import robot_from_record
from phcontrol.mechanics.markup import read_markup
from phcontrol.mechanics.mjcf_comparison import check_against_mujoco
from phcontrol.mechanics.mujoco_file import compiled, load_mujoco
from tests.mechanics import mjcf_reference as reference

pytestmark = pytest.mark.filterwarnings("ignore::phcontrol.RobotDescriptionWarning")


def load(name, tmp_path):
    path = tmp_path / f"{name}.xml"
    path.write_text(reference.text_of(name))
    return load_robot(path, locked_joints=reference.LOCKED[name])


def check(robot, expected):
    system = MechanicalSystem(robot)
    order = [expected["joints"].index(name) for name in robot.joint_names]
    assert len(order) == len(expected["joints"])
    for what, values in (
        ("dof_damping", robot.friction.viscous),
        ("dof_frictionloss", robot.friction.coulomb),
        ("dof_armature", robot.model.armature),
    ):
        np.testing.assert_array_equal(values, np.array(expected[what])[order])
    for q, v, mass_matrix, bias in expected["states"]:
        x = system.at(np.array(q)[order], np.array(v)[order])
        np.testing.assert_allclose(x.mass_matrix, np.array(mass_matrix)[np.ix_(order, order)], rtol=0, atol=1e-10)
        ours = x.coriolis_matrix @ x.velocity + x.potential_gradient
        np.testing.assert_allclose(ours, np.array(bias)[order], rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", reference.LOCKED)
def test_mass_matrix_and_bias_are_those_that_mujoco_gave(name, tmp_path):
    """Numbers of ``python -m tests.mechanics.mjcf_reference``."""
    expected = json.loads((reference.FOLDER / "mjcf_reference.json").read_text())[name]
    check(load(name, tmp_path), expected)


@pytest.mark.parametrize("name", reference.LOCKED)
def test_mass_matrix_and_bias_are_those_of_mujoco(name, tmp_path):
    pytest.importorskip("mujoco")
    check(load(name, tmp_path), reference.computed(name))


def test_limits_frames_and_home(tmp_path):
    arm, fr3 = load("arm", tmp_path), load("fr3", tmp_path)
    order = [("waist", "shoulder", "lift").index(name) for name in arm.joint_names]
    np.testing.assert_allclose(arm.lower, np.array([-np.pi / 2, -np.inf, -0.1])[order])
    np.testing.assert_allclose(arm.upper, np.array([np.pi / 1.5, np.inf, 0.2])[order])
    # of two unequal bounds the smaller; of a motor the torque at the joint, whichever of its ranges is the narrower
    np.testing.assert_array_equal(arm.effort_limit, np.array([20.0, 10.0, np.inf])[order])
    assert list(arm.continuous) == [name == "shoulder" for name in arm.joint_names]
    assert {"stand", "turret", "upper", "tip", "slider", "plate"} <= set(arm.frame_names)
    np.testing.assert_allclose(fr3.home, [0, 0, 0, -1.57079, 0, 1.57079, -0.7853])
    tip = fr3.placement("tcp", fr3.home).translation - fr3.placement("hand", fr3.home).translation
    assert np.linalg.norm(tip) == pytest.approx(0.1034)


def test_an_arm_of_an_mjcf_is_one_like_any_other(tmp_path):
    path = tmp_path / "fr3.xml"
    path.write_text(reference.text_of("fr3"))
    robot = load_robot(path, locked_joints=("finger_joint1", "finger_joint2"), payload=Payload(0.5, frame="tcp"))
    system = MechanicalSystem(robot)
    law = make_controller("energy_shaping", system)
    assert certify(law, samples=8).passed
    log = simulate(system, law, q0=robot.near_home(), duration=0.02, progress=False)
    read = Log.load(log.save(tmp_path / "log.npz"))
    np.testing.assert_allclose(read.power_balance("plant").rate, log.power_balance("plant").rate, atol=1e-6)
    drawn = robot_from_record(read.metadata["robot_record"])
    q = robot.random_position(np.random.default_rng(0))
    assert drawn.placement("tcp", q).isApprox(robot.placement("tcp", q), 1e-12)


def with_actuator(text):
    return ("</actuator>", f"{text}</actuator>")


CHANGES = [
    ("<worldbody>", "<include file='x.xml'/><worldbody>", "MuJoCo cannot read it: .*x.xml"),
    ("<worldbody>", '<option gravity="0 0 -1"/><worldbody>', r"take it out, and give MechanicalSystem\(..., gravity"),
    ("<worldbody>", '<option density="1.2"/><worldbody>', "no medium drags here"),
    ("<worldbody>", '<option wind="1 0 0"/><worldbody>', "no medium drags here"),
    ("<worldbody>", '<option><flag gravity="disable"/></option><worldbody>', "<flag gravity='disable'>"),
    ('<body name="stand"', '<body gravcomp="1" name="stand"', "body 'stand': gravcomp='1' would be overlooked"),
    ('<body name="stand"', '<body mocap="true" name="stand"', "body 'stand' is moved by mocap data"),
    ('<body name="plate"', "<body ", "a <body> has no name: the one in slider"),
    ('<joint name="waist" ', "<joint ", "a joint of body 'turret' has no name"),
    ('type="slide" axis="0 0 1" range="-0.1 0.2"', 'type="ball"', "joint 'lift' is a ball joint"),
    ('<joint name="lift" type="slide"', '<joint name="lift" type="screw"', "MuJoCo cannot read it: .*'screw'"),
    ('<body name="stand"', '<body name="ball"><freejoint/><geom size="0.1"/></body><body name="stand"',
     "body 'ball' is free to float"),
    ('<joint name="lift"', '<joint stiffness="3" name="lift"', "joint 'lift': stiffness='3' would be dropped"),
    ('damping="0.7"/>', 'damping="0.7" springdamper="1 1"/>', "joint 'shoulder': stiffness='0.15.*' would be dropped"),
    ('<joint name="lift"', '<joint damp="3" name="lift"', "MuJoCo cannot read it: .*'damp'.*line 20"),
    ('damping="0.7"', 'damping="-0.7"', "joint 'shoulder': damping='-0.7' must be one number >= 0"),
    ('range="-0.1 0.2"', "", "joint 'lift' slides without limits"),
    ('range="-90 120"', 'range="120 -90"', "line .*joint 'waist': range='120 -90' must be two numbers, the lower"),
    ('range="-90 120"', 'range="0 0"', "line .*joint 'waist': range='0 0' must be two numbers, the lower first"),
    ('forcerange="-9 9"', 'forcerange="0 0"', "motor '': forcerange='0 0' must be two numbers, the lower first"),
    ('forcerange="-9 9"', 'forcerange="0 9"', "joint 'shoulder' has actuators that make no torque in one direction"),
    ('ctrlrange="-5 5"', 'ctrlrange="2 5"', "joint 'shoulder' has actuators that make no torque in one direction"),
    ('gear="2"', 'gear="0"', "joint 'shoulder' has actuators that make no torque .*a gear of zero"),
    ('<joint name="lift"', '<joint name="lift2" axis="1 0 0"/><joint name="lift"', "body 'slider' has 2 joints"),
    ('childclass="upper"', 'childclass="uper"', "MuJoCo cannot read it: .*unknown default childclass"),
    (
        "</mujoco>",
        '<tendon><fixed name="cable"><joint joint="waist" coef="1"/></fixed></tendon></mujoco>',
        r"tendon <fixed> 'cable' of waist would be dropped; lock them \(locked_joints=\['waist'\]\), or take it out",
    ),
    (
        "</mujoco>",
        '<tendon><spatial><site site="tip"/><site site="foot"/></spatial></tendon></mujoco>',
        "tendon <spatial> would be dropped; take it out",
    ),
    (
        "</mujoco>",
        '<equality><joint joint1="waist" joint2="shoulder"/></equality></mujoco>',
        "constraint <joint> of waist, shoulder would be dropped",
    ),
    ("</mujoco>", '<equality><weld body1="plate"/></equality></mujoco>', "constraint <weld> would be dropped"),
    ("</mujoco>", '<keyframe><key name="home" qpos="0 1"/></keyframe></mujoco>', "'home' must|expected length 3"),
    (*with_actuator('<general name="slow" joint="waist" dyntype="filter" dynprm="0.1"/>'),
     "actuator 'slow' of joint 'waist' has a state of its own"),
    (*with_actuator('<motor name="jet" site="tip"/>'), r"actuator 'jet' acts on no joint \(on a site\)"),
    (*with_actuator('<adhesion name="glue" body="plate" ctrlrange="0 1"/>'), "actuator 'glue' acts on no joint"),
    ('<site name="tip"', '<site name="waist_axis" pos="0 0 0.1"/><site name="tip"', "'waist_axis' names more than one"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "said"), CHANGES, ids=range(len(CHANGES)))
def test_what_would_be_dropped_is_refused(old, new, said, tmp_path):
    arm = reference.ARM.replace("<worldbody>", '<worldbody><site name="foot"/>')
    assert old in arm
    path = tmp_path / "arm.xml"
    path.write_text(arm.replace(old, new, 1))
    with pytest.raises(RobotDescriptionError, match=said):
        load_robot(path)


READ = [
    ('angle="degree"', 'angle="degree" settotalmass="3"'),
    ('angle="degree"', 'angle="degree" inertiafromgeom="true"'),
    ('angle="degree"', 'angle="degree" eulerseq="XYZ"'),
    ('angle="degree"', 'angle="degree" boundmass="0.7" boundinertia="0.01"'),
    ('<geom type="capsule"', '<geom shellinertia="true" type="capsule"'),
    ('<site name="tip"', '<frame pos="0 0.1 0"><geom size="0.05"/></frame><site name="tip"'),
    ("<worldbody>", "<extension/><worldbody>"),
    ("<worldbody>", '<compiler angle="radian"/><worldbody>'),
    ("</mujoco>", '<equality><joint joint1="waist" active="false"/></equality></mujoco>'),
    ('<joint axis="0 1 0" damping="0.7"/>', '<joint axis="0 1 0" damping="0.7" pos="0.05 0 0"/><geom euler="20 0 0"/>'),
    ('ref="10"', 'ref="-20" pos="0 0.1 0"'),
    ('<joint name="lift"', '<joint ref="0.05" name="lift"'),
    ('<body name="plate" pos="0 0 0.1">', '<body name="plate" pos="0 0 0.1" quat="0 1 1 0"><geom size="0.1"/>'),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new"), READ, ids=range(len(READ)))
def test_all_ways_of_saying_it_are_those_of_mujoco(old, new, tmp_path, monkeypatch):
    """Each was refused, for it would have been read as another arm."""
    pytest.importorskip("mujoco")
    text = reference.ARM.replace(old, new, 1)
    assert text != reference.ARM
    monkeypatch.setattr(reference, "ARM", text)
    check(load("arm", tmp_path), reference.computed("arm"))


def test_a_file_in_a_file_is_part_of_it(tmp_path):
    pytest.importorskip("mujoco")
    actuator = '<motor joint="waist" forcerange="-7 7"/>'
    (tmp_path / "actuators.xml").write_text(f"<mujoco><actuator>{actuator}</actuator></mujoco>")
    text = reference.ARM.replace("<worldbody>", '<include file="actuators.xml"/><worldbody>')
    (tmp_path / "arm.xml").write_text(text)
    robot = load_robot(tmp_path / "arm.xml")
    assert robot.effort_limit[robot.joint_index("waist")] == 7.0


@pytest.mark.parametrize(
    ("actuators", "effort"),
    [
        ('<general class="strong" joint="waist"/>', 12.0),  # forcerange 4, gear 3, both of the class
        ('<motor class="strong" jointinparent="waist"/>', 12.0),
        ('<position class="strong" joint="waist" ctrlrange="-1 1"/>', 12.0),  # what it is sent is no torque
        ('<motor class="strong" joint="waist" ctrlrange="-2 2"/>', 6.0),
        ('<general class="strong" joint="waist" ctrlrange="-2 2" gainprm="1.5"/>', 9.0),
        ('<motor joint="waist" forcerange="-4 4"/><motor jointinparent="waist" forcerange="-5 6"/>', 9.0),
        ('<motor joint="waist" forcerange="-4 4"/><motor joint="waist"/>', 20.0),  # what the joint itself bears
        ('<motor class="weak" joint="waist"/>', 1.5),
        ("", 20.0),
    ],
)
def test_efforts_are_those_of_the_actuators_as_compiled(actuators, effort, tmp_path):
    """Those of a class, and of actuators in the parent's axes, were not read."""
    mujoco = pytest.importorskip("mujoco")
    classes = (
        '<default class="strong"><general forcerange="-4 5" gear="3"/></default>'
        '<default class="weak"><motor ctrlrange="-1.5 1.5"/></default>'
    )
    text = reference.ARM.replace('<default class="upper">', f'{classes}<default class="upper">')
    text = text.replace("</actuator>", f"{actuators}</actuator>")
    path = tmp_path / "arm.xml"
    path.write_text(text)
    robot = load_robot(path)
    assert robot.effort_limit[robot.joint_index("waist")] == effort
    if effort != 20.0 and "position" not in actuators:  # MuJoCo makes as much when it is asked for more
        model = mujoco.MjModel.from_xml_path(str(path))
        data, made = mujoco.MjData(model), []
        for sign in (1.0, -1.0):
            data.ctrl[:] = sign * 1e6
            mujoco.mj_forward(model, data)
            made.append(abs(data.qfrc_actuator[model.joint("waist").dofadr[0]]))
        assert min(made) == pytest.approx(effort)


def test_bodies_that_lie_in_each_other_are_no_matter(tmp_path):
    """MuJoCo's FatalError came out: it had no memory for the contacts of a posture."""
    pytest.importorskip("mujoco")
    inner = "".join(f"<body name='b{i}'><joint name='j{i}'/><geom size='0.1'/>" for i in range(90))
    path = tmp_path / "heap.xml"
    path.write_text(f"<mujoco><worldbody>{inner}{'</body>' * 90}</worldbody></mujoco>")
    assert load_robot(path).n == 90
    with pytest.raises(RobotDescriptionError, match="no such file"):
        load_robot("x" * 5000 + ".xml")


def test_a_site_may_have_the_name_of_a_body(tmp_path):
    """As in models that people share; the body's frame has the name."""
    pytest.importorskip("mujoco")
    path = tmp_path / "arm.xml"
    path.write_text(reference.ARM.replace('<site name="tip"', '<site name="plate"'))
    robot, plain = load_robot(path), load("arm", tmp_path)
    for name, as_before in (("plate", "plate"), ("plate_site", "tip")):
        assert robot.placement(name, robot.home).isApprox(plain.placement(as_before, robot.home), 1e-12)
    path.write_text(reference.ARM.replace('<site name="tip"', '<site name="upper" quat="1 0 0 0"/><site name="tip"'))
    assert "upper_site" not in load_robot(path).frame_names  # it is where the body is


def test_what_locked_joints_have_does_nothing(tmp_path):
    """Springs, states of actuators and tendons of a joint that is held."""
    pytest.importorskip("mujoco")
    text = reference.ARM.replace('<joint name="lift"', '<joint stiffness="3" name="lift"')
    text = text.replace("</actuator>", '<general joint="lift" dyntype="filter" dynprm="0.1"/></actuator>')
    path = tmp_path / "arm.xml"
    path.write_text(text)
    assert load_robot(path, locked_joints=["lift"]).n == 2


def test_what_is_overlooked_is_found_by_what_it_does(tmp_path, monkeypatch):
    """Were the checks blind to it, a spring or drag would show in the passive forces."""
    pytest.importorskip("mujoco")
    monkeypatch.setattr(mjcf, "check_model", lambda *_: None)
    for old, new in (
        ('<joint name="lift"', '<joint stiffness="3" name="lift"'),
        ("<worldbody>", '<option density="1000"/><worldbody>'),
        ('<body name="plate"', '<body gravcomp="1" name="plate"'),
    ):
        path = tmp_path / "arm.xml"
        path.write_text(reference.ARM.replace(old, new, 1))
        with pytest.raises(RobotDescriptionError, match="the passive force is another than MuJoCo's"):
            load_robot(path)


def changed(urdf, joint, **more):
    """A description with one joint changed."""
    assert joint in {each.name for each in urdf.joints}
    return replace(urdf, joints=tuple(replace(each, **more) if each.name == joint else each for each in urdf.joints))


def test_what_was_read_wrongly_is_found(tmp_path):
    """Ranges, their absence, and bodies elsewhere, each wrong in what was read alone; rounding is let pass."""
    pytest.importorskip("mujoco")
    path = tmp_path / "arm.xml"
    path.write_text(reference.ARM)
    found = mjcf.read_mjcf(path, read_markup(path, "arm"), "arm", frozenset())
    model, mujoco = compiled(path, "arm"), load_mujoco()

    def check_it(urdf):
        check_against_mujoco(mujoco, model, urdf, found.armature, "arm", frozenset())

    check_it(found.urdf)
    joints = {joint.name: joint for joint in found.urdf.joints}
    lift, shoulder = joints["lift"].limit, joints["shoulder"].limit
    check_it(changed(found.urdf, "lift", limit=replace(lift, upper=lift.upper + 1e-11)))
    with pytest.raises(RobotDescriptionError, match="joint 'lift' has the range .*, in MuJoCo"):
        check_it(changed(found.urdf, "lift", limit=replace(lift, upper=lift.upper + 1e-7)))
    with pytest.raises(RobotDescriptionError, match="^arm, joint 'shoulder' has a range, in MuJoCo none$"):
        check_it(changed(found.urdf, "shoulder", limit=replace(shoulder, lower=-1.0, upper=1.0)))
    plate = next(joint for joint in found.urdf.joints if joint.child == "plate")
    x, y, z = plate.xyz
    with pytest.raises(RobotDescriptionError, match="'plate' is elsewhere than in MuJoCo, by 0"):
        check_it(changed(found.urdf, plate.name, xyz=(x + 0.01, y, z)))


def test_constraints_of_locked_joints_do_nothing(tmp_path):
    """The fingers of an FR3 are held together; locked, nothing is lost."""
    path = tmp_path / "fr3.xml"
    path.write_text(reference.text_of("fr3"))
    assert load_robot(path, locked_joints=["finger_joint1", "finger_joint2"]).n == 7
    with pytest.raises(RobotDescriptionError, match="constraint <joint> of finger_joint1, finger_joint2 would be"):
        load_robot(path)


XACRO = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="m" value="{}"/>
<link name="a"/><link name="b"><inertial><mass value="${{m*2}}"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def test_a_xacro_file_is_expanded(tmp_path):
    pytest.importorskip("xacrodoc")
    path = tmp_path / "arm.xacro"
    path.write_text(XACRO.format("1.5"))
    assert load_robot(path).model.inertias[1].mass == 3.0
    path.write_text(XACRO.format("${nothing}"))
    with pytest.raises(RobotDescriptionError, match=r"arm\.xacro: cannot be expanded"):
        load_robot(path)


def test_what_is_not_installed_is_said(tmp_path, monkeypatch):
    for name in ("xacrodoc", "robot_descriptions"):
        monkeypatch.setitem(sys.modules, name, None)
    path = tmp_path / "arm.xacro"
    path.write_text("<robot/>")
    with pytest.raises(RobotDescriptionError, match=r"needs xacrodoc \(pip install 'phcontrol\[models\]'\)"):
        load_robot(path)
    with pytest.raises(RobotDescriptionError, match="needs robot_descriptions"):
        load_robot("robot_descriptions:iiwa14_description")
    monkeypatch.setitem(catalogue.installed(), "fr3", catalogue.installed()["fr3"] | {"package": "not-installed"})
    with pytest.raises(RobotDescriptionError, match="fr3: comes with not-installed: pip install not-installed"):
        load_robot("fr3")


def test_names_of_robot_descriptions(tmp_path, monkeypatch):
    """Nothing is fetched: the package is a stand-in with the attributes that its modules have."""
    path = tmp_path / "arm.urdf"
    path.write_text(XACRO.format(1).replace("${m*2}", "2").replace('<xacro:property name="m" value="1"/>', ""))
    package = tmp_path / "robot_descriptions"
    package.mkdir()
    (package / "__init__.py").write_text("DESCRIPTIONS = {'arm_description': None}\n")
    (package / "arm_description.py").write_text(f"URDF_PATH = {str(path)!r}\nPACKAGE_PATH = {str(tmp_path)!r}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    for name in [name for name in sys.modules if name.startswith("robot_descriptions")]:
        monkeypatch.delitem(sys.modules, name)
    assert load_robot("robot_descriptions:arm_description").n == 1
    with pytest.raises(LookupError, match="Did you mean 'arm_description'"):
        load_robot("robot_descriptions:arm_descriptio")


CLASSY = """<mujoco model="arm"><compiler {compiler}/>{extra}
 <default><default class="c">{default}</default></default>
 <worldbody><body name="upper" childclass="c"><joint name="turn" axis="0 1 0" range="-1 1" damping="0.1"/>
  <geom type="box" size="0.03 0.04 0.1" pos="0 0 0.1" {geom}/></body></worldbody></mujoco>
"""


def test_the_same_arm_as_mujocos_is_loaded(tmp_path):
    pytest.importorskip("mujoco")
    path = tmp_path / "arm.xml"
    path.write_text(CLASSY.format(compiler="", extra="", default='<joint armature="0.1"/>', geom='mass="2"'))
    robot = load_robot(path)
    assert list(robot.joint_names) == ["turn"]
    assert MechanicalSystem(robot).at([0.0]).mass_matrix[0, 0] > 0.1


def test_without_mujoco_it_is_said_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    path = tmp_path / "arm.xml"
    path.write_text(CLASSY.format(compiler="", extra="", default="", geom=""))
    with pytest.raises(RobotDescriptionError, match=r"an MJCF file needs MuJoCo: pip install 'phcontrol\[mujoco\]'"):
        load_robot(path)
