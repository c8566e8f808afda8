"""Rotors of a URDF: used when asked for, with what they add said; what is half given is refused."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import MechanicalSystem, RobotDescriptionError, load_robot
from phcontrol.mechanics.rotors import Rotor
from tests.mechanics.test_urdf import ARM

pytestmark = pytest.mark.filterwarnings("ignore::phcontrol.RobotDescriptionWarning")
DYNAMICS = '<dynamics damping="0.5" friction="0.1"/>'
GIVEN = '<dynamics damping="0.5" friction="0.1" motor_inertia="4e-5" gear_ratio="100"/>'
TRANSMISSION = """<transmission name="drive"><type>simple</type><joint name="elbow"/>
<actuator name="motor"><mechanicalReduction>50</mechanicalReduction>{}</actuator></transmission></robot>"""


def written(tmp_path, text):
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    return path


def test_rotors_are_used_when_asked_for(tmp_path):
    inertia = "<rotor_inertia>1e-4</rotor_inertia>"
    path = written(tmp_path, ARM.replace(DYNAMICS, GIVEN).replace("</robot>", TRANSMISSION.format(inertia)))
    plain, geared = load_robot(path), load_robot(path, rotor_inertia=True)
    assert plain.rotors == {}
    assert geared.rotors == {"shoulder": Rotor(4e-5, 100.0), "elbow": Rotor(1e-4, 50.0)}
    added = [MechanicalSystem(robot).at(robot.home).mass_matrix for robot in (geared, plain)]
    np.testing.assert_allclose(added[0] - added[1], np.diag([0.4, 0.25]), atol=1e-14)
    mixed = load_robot(path, rotor_inertia=True, armature={"elbow": 0.1})
    np.testing.assert_allclose(mixed.model.armature, [0.4, 0.1])
    locked = load_robot(path, rotor_inertia=True, locked_joints=["shoulder"])
    assert list(locked.rotors) == ["elbow"]
    np.testing.assert_allclose(locked.model.armature, [0.25])


def test_the_elements_of_drake_are_read(tmp_path):
    text = ARM.replace('<robot name="arm">', '<robot name="arm" xmlns:drake="http://drake.mit.edu">')
    text = text.replace(
        "</robot>",
        '<transmission><joint name="elbow"/><actuator name="m"><drake:rotor_inertia value="2e-4"/>'
        '<drake:gear_ratio value="30"/></actuator></transmission></robot>',
    )
    assert load_robot(written(tmp_path, text), rotor_inertia=True).rotors == {"elbow": Rotor(2e-4, 30.0)}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (ARM, "gives no rotor: rotor_inertia=True needs"),
        (ARM.replace("</robot>", TRANSMISSION.format("")), "gives no rotor"),  # a gear ratio alone
        (ARM.replace(DYNAMICS, '<dynamics motor_inertia="4e-5"/>'), "joint 'shoulder' has motor_inertia but no gear"),
        (ARM.replace(DYNAMICS, '<dynamics motor_inertia="4e-5" gear_ratio="1,2"/>'), "gear_ratio='1,2'; it must be"),
        (ARM.replace(DYNAMICS, '<dynamics motor_inertia="-1" gear_ratio="1"/>'), "motor_inertia='-1'; it must be"),
        (ARM.replace(DYNAMICS, '<dynamics motor_inertia="1" gear_ratio="0"/>'), "gear ratio 0; it must be > 0"),
        (
            ARM.replace(
                "</robot>", TRANSMISSION.format("<motorInertia>1</motorInertia>").replace('"elbow"', '"wrist"')
            ),
            "must name one moving joint, but names 'wrist'",
        ),
        (  # one motor for two joints
            ARM.replace(
                "</robot>",
                TRANSMISSION.format("<motorInertia>1</motorInertia>").replace("/>", '/><joint name="shoulder"/>', 1),
            ),
            "must name one moving joint, but names 'elbow', 'shoulder'",
        ),
    ],
)
def test_what_is_half_given_is_refused(tmp_path, text, said):
    with pytest.raises(RobotDescriptionError, match=said):
        load_robot(written(tmp_path, text), rotor_inertia=True)
