"""Certificates of tracking on arms of every kind, and the table of all of them in the documentation."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from phcontrol.controllers.trajectory_tracking import TrajectoryTracking
from phcontrol.runs.certificate_survey import every_arm, markdown, survey

PAGE = Path(__file__).parents[2] / "docs" / "certificates.md"
REPRESENTATIVE = {
    "asr_twodof": 2,  # the smallest
    "talos_arm": 7,  # rotor inertia in its description
    "bravo7_no_ee": 6,  # continuous joints
    "tiago_no_hand": 12,  # wheels and a prismatic torso
    "baxter": 17,  # two arms and mimic grippers
    "allegro_right_hand": 16,  # a hand
    "xarm7": 7,
}


@pytest.mark.filterwarnings("ignore::phcontrol.RobotDescriptionWarning")
@pytest.mark.parametrize("arm", list(REPRESENTATIVE))
def test_tracking_is_certified_on_arms_of_every_kind(arm):
    (row,) = survey([arm], ["tracking"], samples=3)
    assert row.verdict == "passed"
    assert row.joints == REPRESENTATIVE[arm]
    for form in TrajectoryTracking.forms:  # at rest a row's unit is small, and so are few digits left of a difference
        assert row.residual(form) < 1e-7


def test_the_documented_table_has_every_arm_and_they_passed():
    rows = re.findall(r"^\| (\w+) \| (\d*) \|.*\| (\w+)[^|]* \|$", PAGE.read_text(), re.MULTILINE)
    assert [name for name, _, _ in rows] == every_arm()
    assert {verdict for _, _, verdict in rows} == {"passed", "refused"}
    assert [name for name, _, verdict in rows if verdict == "refused"] == ["bravo7_gripper", "alex_psyonic_hands"]


def test_a_refused_description_says_why():
    lines = list(markdown(survey(["alex_psyonic_hands"], ["tracking"], samples=1), TrajectoryTracking.forms))
    assert (
        "refused: alex_psyonic_hands (alex_psyonic_hands.urdf): 8 problems: line 1030: joint 'Left_index_q2'"
        in lines[-1]
    )
