"""Descriptions: never a silent wrong model. What a parser would drop is refused, with file, line and name."""

from __future__ import annotations

import copy
import re
import warnings
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phcontrol import RobotDescriptionError, RobotDescriptionWarning, load_robot
from phcontrol.mechanics.catalogue import find
from phcontrol.runs.certificate_survey import every_arm
from tests.mechanics.independent_urdf import compare

ARM = """<robot name="arm">
<link name="base"/>
<link name="upper">
 <inertial>
  <origin xyz="0 0 0.2" rpy="0 0.1 0"/>
  <mass value="2"/>
  <inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0.001" iyz="0"/>
 </inertial>
</link>
<link name="fore">
 <inertial>
  <origin xyz="0 0 0.1"/>
  <mass value="1.5"/>
  <inertia ixx="0.01" iyy="0.01" izz="0.005" ixy="0" ixz="0" iyz="0"/>
 </inertial>
</link>
<joint name="shoulder" type="revolute">
 <origin xyz="0 0 0.3" rpy="0 0 0"/>
 <parent link="base"/>
 <child link="upper"/>
 <axis xyz="0 1 0"/>
 <dynamics damping="0.5" friction="0.1"/>
 <limit lower="-2" upper="2" effort="60" velocity="3"/>
</joint>
<joint name="elbow" type="revolute">
 <origin xyz="0 0 0.4"/>
 <parent link="upper"/>
 <child link="fore"/>
 <axis xyz="0 1 0"/>
 <limit lower="-2.5" upper="2.5" effort="30" velocity="3"/>
</joint>
</robot>
"""
TIP = '<link name="tip"/><joint name="tip_joint" type="{}"><parent link="{}"/><child link="{}"/></joint>'


def written(tmp_path, *changes, text=ARM):
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    return path


def refusal(path, **arguments):
    with pytest.raises(RobotDescriptionError) as caught:
        load_robot(path, **arguments)
    return str(caught.value)


def test_the_arm_itself_is_what_its_file_says(tmp_path):
    compare(load_robot(written(tmp_path)), ARM)


@pytest.mark.parametrize(
    "value",
    ["2,0", "0.85 kg", "nan", "NaN", "inf", "-Infinity", "", " ", "1_0", "0x10", "1e999", "1d0", "２", "1 2", "--1"],
)
def test_a_mass_that_is_no_number_is_refused_with_line_link_and_value(tmp_path, value):
    """urdfdom drops the whole inertial of most of these, with a line on stderr, and goes on."""
    message = refusal(written(tmp_path, ('<mass value="2"/>', f'<mass value="{value}"/>')))
    assert message.startswith(f"{tmp_path / 'arm.urdf'}, line 6: link 'upper': <mass value=\"{value}\"> must be")
    assert "such as 0.85" in message


NUMBERS = [
    (name, element.tag, attribute)
    for name, part in (("link 'upper'", "link[@name='upper']"), ("joint 'shoulder'", "joint[@name='shoulder']"))
    for element in ET.fromstring(ARM).find(part).iter()
    for attribute in element.attrib
    if attribute not in ("name", "type", "link")
]


@pytest.mark.parametrize(("name", "tag", "attribute"), NUMBERS)
def test_every_number_is_read_strictly(tmp_path, name, tag, attribute):
    assert len(NUMBERS) == 18
    root = ET.fromstring(ARM)
    owner = root.find("link[@name='upper']" if name.startswith("link") else "joint[@name='shoulder']")
    element = next(owner.iter(tag))
    for value in ("0,5", "0.5m", "nan", ""):
        parts = element.attrib[attribute].split()
        element.set(attribute, " ".join([value, *parts[1:]]))
        message = refusal(written(tmp_path, text=ET.tostring(root, encoding="unicode")))
        assert f'{name}: <{tag} {attribute}="{element.attrib[attribute]}"> must be' in message
        element.set(attribute, " ".join(["0", *parts[1:]]))


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (('<mass value="2"/>', ""), "line 4: link 'upper': its <inertial> has no <mass>"),
        (('<mass value="2"/>', "<mass/>"), 'line 6: link \'upper\': <mass> has no value; give value="..."'),
        (('<mass value="2"/>', '<mass vaule="2"/>'), "line 6: link 'upper': <mass> has no attribute 'vaule'"),
        (('<mass value="2"/>', '<weight value="2"/>'), "line 6: link 'upper' has an element <weight>"),
        (('<mass value="2"/>', '<mass value="2"/><mass value="3"/>'), "line 6: link 'upper' has a second <mass>"),
        ((' ixy="0"', ""), "line 7: link 'upper': <inertia> has no ixy"),
        (("<inertial>", "<inertail>"), "not well-formed XML"),
        (('xyz="0 0 0.2"', 'xyz="0 0"'), "line 5: .*must be three decimal numbers"),
        (('xyz="0 0 0.2"', 'xzy="0 0 0.2"'), "line 5: link 'upper': <origin> has no attribute 'xzy'"),
        ((' effort="60"', ""), "line 23: joint 'shoulder': <limit> has no effort; give effort=.*\"0\" says that no"),
        ((' velocity="3"', ""), "line 23: joint 'shoulder': <limit> has no velocity"),
        (('effort="60"', 'effort="-5"'), "line 23: joint 'shoulder' has the effort limit -5"),
        (('velocity="3"', 'velocity="-2"'), "line 23: joint 'shoulder' has the velocity limit -2"),
        (('damping="0.5"', 'damping="-0.5"'), "line 22: joint 'shoulder' has the damping -0.5"),
        (('lower="-2"', 'lower="3"'), "line 23: joint 'shoulder' has the lower limit 3 and the upper limit 2"),
        (('<limit lower="-2" upper="2" effort="60" velocity="3"/>', ""),
         "line 17: joint 'shoulder' has no limits; give"),
        (('<child link="upper"/>', '<child link="uper"/>'),
         "line 17: joint 'shoulder' has the child 'uper', which is no link; did you mean 'upper'"),
        (('<parent link="base"/>', '<parent link="floor"/>'),
         "joint 'shoulder' has the parent 'floor', which is no link"),
        (('<parent link="base"/>', ""), "line 17: joint 'shoulder' has no parent link"),
        (('name="elbow"', 'name="shoulder"'), "line 17: joint 'shoulder' is one of 2(.|\n)*line 25: joint 'shoulder'"),
        (('<link name="fore">', '<link name="upper">'), "line 3: link 'upper' is one of 2 of that name"),
        (('name="elbow"', ""), "line 25: a <joint> has no name"),
        (('type="revolute"', 'type="spherical"'),
         "line 17: joint 'shoulder' has the unknown type 'spherical'; there are fixed"),
        (('type="revolute"', ""), "line 17: joint 'shoulder' has the unknown type ''"),
        (('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>'),
         "line 21: joint 'shoulder': <axis xyz=\"0 0 0\"> is no direction"),
        (('<axis xyz="0 1 0"/>', "<axis/>"), "line 21: joint 'shoulder': <axis> has no xyz"),
        (("</robot>", '<link name="stray"/></robot>'),
         r"2 links hang on no joint.*'base' \(line 2\), 'stray' \(line 32\)"),
        (("</robot>", TIP.format("fixed", "base", "fore") + "</robot>"),
         "line 32: link 'fore' is the child of two joints, 'elbow' and 'tip_joint'"),
        (("</robot>", TIP.format("fixed", "tip", "tip") + "</robot>"), r"joints make a loop: 'tip_joint' \(line 32\)"),
        (('<parent link="base"/>', '<parent link="fore"/>'),
         r"joints make a loop: 'shoulder' \(line 17\), 'elbow' \(line 25\)"),
        (("</robot>", '<jiont name="x"/></robot>'), "line 32: the robot has an element <jiont>"),
        (('<mass value="2"/>', '<mass value="1e9"/>'), r"line 4: link 'upper' has mass 1e\+09 kg; at most 1e\+06"),
        (('<mass value="2"/>', '<mass value="-2"/>'), "line 4: link 'upper' has mass -2 kg; it must not be negative"),
        (('<mass value="2"/>', '<mass value="0"/>'), "line 4: link 'upper' has no mass, but the moment"),
        (('xyz="0 0 0.3"', 'xyz="0 0 1e6"'), r"line 17: joint 'shoulder' has the xyz 0 0 1e\+06"),
        (('xyz="0 0 0.2"', 'xyz="0 1e6 0.2"'), r"line 4: link 'upper' has its centre of mass at xyz 0 1e\+06"),
        (('izz="0.01"', 'izz="0.1"'), "line 4: link 'upper' has the principal moments .*at most the sum of the others"),
        (('ixz="0.001"', 'ixz="0.1"'), "line 4: link 'upper' has the principal moments .*none may be negative"),
        (('izz="0.01"', 'izz="-0.01"'), "line 4: link 'upper' has the principal moments .*none may be negative"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(tmp_path, change, complaint):
    message = refusal(written(tmp_path, change))
    assert message.startswith(str(tmp_path / "arm.urdf"))
    assert re.search(complaint, message), message


def test_a_misspelt_inertial_is_no_missing_one(tmp_path):
    text = ARM.replace("inertial>", "inertail>", 2)
    assert "line 4: link 'upper' has an element <inertail>" in refusal(written(tmp_path, text=text))


def test_all_that_is_wrong_is_named_at_once(tmp_path):
    message = refusal(
        written(tmp_path, ('value="2"', 'value="2,0"'), ('value="1.5"', 'value="x"'), (' effort="30"', ""))
    )
    assert "3 problems" in message
    assert all(part in message for part in ("line 6: link 'upper'", "line 13: link 'fore'", "line 30: joint 'elbow'"))


def test_all_missing_inertials_are_named_at_once(tmp_path):
    text = re.sub(r"<inertial>.*?</inertial>", "", ARM, flags=re.DOTALL)
    message = refusal(written(tmp_path, text=text))
    assert "joints 'shoulder', 'elbow'" in message
    assert "Give links 'upper', 'fore' an <inertial> element" in message
    assert "locked_joints=['shoulder', 'elbow']" in message
    assert load_robot(written(tmp_path, text=text), armature=0.1).n == 2  # rotors move with each joint


def test_inertia_of_what_cannot_move_is_not_judged(tmp_path):
    moments = '<inertia ixx="1" iyy="1" izz="9" ixy="0" ixz="0" iyz="0"/>'
    heavy = f'<link name="base"><inertial><mass value="-1"/>{moments}</inertial>'
    compare(load_robot(written(tmp_path, ('<link name="base"/>', heavy + "</link>"))), ARM)


@pytest.mark.parametrize(
    ("change", "doubt"),
    [
        (('izz="0.01"', 'izz="0.05"'), r"link 'upper' \(line 4\): the largest principal moment.*used as given"),
        (('effort="60"', 'effort="0"'), r"no effort limit, or 0, for shoulder: none is applied.*Limits\(effort=...\)"),
        (('velocity="3"', 'velocity="0"'), r"no velocity limit, or 0, for shoulder: none is applied"),
        (('lower="-2" upper="2"', 'lower="0" upper="0"'), r"joint 'shoulder' \(line 17\): the lower and the upper"),
        (('lower="-2" upper="2"', 'lower="-90" upper="90"'), r"joint 'shoulder' \(line 17\): .*in degrees\?"),
        (('rpy="0 0 0"', 'rpy="0 90 0"'), r"joint 'shoulder' \(line 17\): .*in degrees\?"),
        (('xyz="0 0 0.3"', 'xyz="0 0 300"'), r"joint 'shoulder' \(line 17\): .*in mm\?"),
        (('xyz="0 0 0.2"', 'xyz="0 0 200"'), r"link 'upper' \(line 4\): .*in mm\?"),
        (('ixx="0.02" iyy="0.02" izz="0.01"', 'ixx="20000" iyy="20000" izz="10000"'), r"link 'upper' .*in kg mm²\?"),
    ],
)  # fmt: skip
def test_what_is_only_implausible_is_used_and_said(tmp_path, change, doubt):
    path = written(tmp_path, change)
    with pytest.warns(RobotDescriptionWarning, match=doubt) as caught:
        robot = load_robot(path)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    compare(robot, path.read_text())


def test_numbers_may_have_space_around_them_and_axes_any_length(tmp_path):
    """urdfdom drops an inertial for a blank; its meaning is beyond doubt."""
    path = written(
        tmp_path, ('value="2"', 'value=" +2.50e0\n"'), ('xyz="0 1 0"', 'xyz="0\t3 -4"'), ('"0 0 0.2"', '"0 .5  1."')
    )
    compare(load_robot(path), path.read_text())


def test_elements_of_other_programs_are_let_pass(tmp_path):
    others = '<gazebo><mass value="x"/></gazebo><ros2_control name="a"/><transmission name="t"/></robot>'
    inside = '<link name="fore"><gravity>0</gravity><surface><friction/></surface><drake:proximity/>'
    compare(load_robot(written(tmp_path, ("</robot>", others), ('<link name="fore">', inside))), ARM)


def test_a_byte_order_mark_is_no_content(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_bytes(b"\xef\xbb\xbf" + ARM.encode())
    compare(load_robot(path), ARM)


def test_deeply_nested_elements_are_refused(tmp_path):
    message = refusal(written(tmp_path, ("</robot>", "<a>" * 50_000 + "</a>" * 50_000 + "</robot>")))
    assert "line 32: more than 100 elements inside one another" in message


@pytest.mark.parametrize(
    ("kind", "links", "complaint"),
    [("revolute", 129, "129 moving joints.*at most 128"), ("fixed", 3000, "at most 2000")],
)
def test_a_robot_too_large_is_refused(tmp_path, kind, links, complaint):
    """Pinocchio's workspace of 300 joints takes 1.7 GB, and a long chain of links its stack."""
    chain = "".join(
        f'<link name="l{k}"/><joint name="j{k}" type="{kind}"><parent link="{f"l{k - 1}" if k else "fore"}"/>'
        f'<child link="l{k}"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for k in range(links - 2 if kind == "revolute" else links)
    )
    assert re.search(complaint, refusal(written(tmp_path, ("</robot>", chain + "</robot>"))))


REFUSED = {"bravo7_gripper": "no mass or inertia", "alex_psyonic_hands": "mimics 'index_q1', which is no joint"}


@pytest.mark.filterwarnings("ignore::phcontrol.RobotDescriptionWarning")
@pytest.mark.parametrize("name", every_arm())
def test_every_arm_is_what_its_file_says(name):
    if name in REFUSED:
        assert REFUSED[name] in refusal(name)
    else:
        compare(load_robot(name), find(name).path.read_text())


BASES = ["pera", "z1", "double_pendulum_continuous", "kinova"]
BAD = ["2,0", "0.85 kg", "nan", "inf", "-inf", "", " ", "1_0", "0x10", "1e999", "1.0.0", "½", "１", "1e", "+", "1 2",
       "true", ".", "1d0", "0 0 nan", "0 0", "0 0 0 0", "0,0,1", "1;2;3", "base", "-1", "0", "1e7", "1e-7"]  # fmt: skip
GOOD = ["5.", ".5", "+3", "1e-3", " 0.5 ", "0.5\n", "0 0\t1", " 0  1 0", "3 0 4", "007", "-0"]
MODEL = ["inertial", "origin", "mass", "inertia", "parent", "child", "axis", "limit", "dynamics", "link", "joint"]


def mutated(text, choose):
    """Return a description with one thing changed; ``choose`` picks one of a list."""
    root = ET.fromstring(text)
    parents = {child: parent for parent in root.iter() for child in parent}
    inside = [e for e in parents if e.tag in MODEL and not {"visual", "collision"} & {parents[e].tag}]
    inside = [e for e in inside if parents[e] in parents or parents[e] is root]
    element = choose(inside)
    parent, attribute = parents[element], choose(sorted(element.attrib) or [""])
    kind = choose(["value", "value", "value", "drop attribute", "rename attribute", "drop", "rename", "double", "move"])
    if kind == "value" and attribute:
        element.set(attribute, choose([*BAD, *GOOD]))
    elif kind == "drop attribute" and attribute:
        del element.attrib[attribute]
    elif kind == "rename attribute" and attribute:
        element.set(
            choose([attribute.upper(), attribute + "s", attribute[::-1], "value"]), element.attrib.pop(attribute)
        )
    elif kind == "drop":
        parent.remove(element)
    elif kind == "rename":
        element.tag = choose(
            [element.tag.upper(), element.tag.capitalize(), element.tag + "s", element.tag[1:], *MODEL]
        )
    elif kind == "double":
        parent.append(copy.deepcopy(choose(inside)))
    elif kind == "move":
        parent.remove(element)
        choose(inside).append(element)
    return ET.tostring(root, encoding="unicode")


@settings(max_examples=300)
@given(data=st.data())
def test_a_changed_description_is_refused_or_is_what_it_says(tmp_path, data):
    """Whatever is changed in it: numbers, names, places. The reader it is compared with shares no code."""
    base = find(data.draw(st.sampled_from(BASES))).path.read_text()
    text = mutated(base, lambda items: data.draw(st.sampled_from(items)))
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RobotDescriptionWarning)
        try:
            robot = load_robot(path)
        except RobotDescriptionError:
            return
    compare(robot, text)
