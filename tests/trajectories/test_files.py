"""Motions read from CSV files, against the numbers written into them."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import DataFileError, SampledTrajectory
from phcontrol.trajectories.files import read_trajectory
from tests.conftest import make_system

ROBOT = make_system("pera_shoulder").robot
FIRST, SECOND = ROBOT.joint_names
ROWS = [(0.0, 0.1, -0.2), (0.5, 0.3, -0.25), (1.5, 0.2, 0.05), (2.0, 0.0, 0.1), (2.5, -0.1, 0.2)]


def written(tmp_path, text):
    path = tmp_path / "motion.csv"
    path.write_text(text, encoding="utf-8")
    return path


def table(rows, *header):
    return "\n".join([*header, *(", ".join(f"{cell:g}" for cell in row) for row in rows)]) + "\n"


def check(trajectory):
    for time, *position in ROWS:
        np.testing.assert_allclose(trajectory.at(time).position, position, atol=1e-12)
    assert trajectory.duration == 2.5


def test_columns_stand_in_the_joints_order_or_are_named(tmp_path):
    check(read_trajectory(written(tmp_path, table(ROWS)), ROBOT))
    check(read_trajectory(written(tmp_path, table(ROWS, f"time,{FIRST},{SECOND}")), ROBOT))
    turned = [(second, time, first) for time, first, second in ROWS]
    check(read_trajectory(written(tmp_path, table(turned, f" {SECOND} , time,{FIRST}")), ROBOT))
    spaced = table(ROWS).replace("\n", "\n\n  \n")
    check(read_trajectory(str(written(tmp_path, "\n" + spaced)), ROBOT))


def test_a_byte_order_mark_is_no_part_of_the_numbers(tmp_path):
    for text in (table(ROWS), table(ROWS, f"time,{FIRST},{SECOND}")):
        check(read_trajectory(written(tmp_path, "\ufeff" + text), ROBOT))


def test_smoothing_is_passed_on(tmp_path):
    path = written(tmp_path, table(ROWS))
    times, positions = np.array(ROWS)[:, 0], np.array(ROWS)[:, 1:]
    expected = SampledTrajectory(times, positions, smoothing=0.1)
    for t in (0.2, 1.0, 2.2):
        np.testing.assert_array_equal(read_trajectory(path, ROBOT, smoothing=0.1).at(t), expected.at(t))
        assert np.abs(read_trajectory(path, ROBOT).at(t).position - expected.at(t).position).max() > 1e-3


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "each row must hold 3 numbers"),
        (f"time,{FIRST},{SECOND}\n", "each row must hold 3 numbers"),
        ("0,0,0\n1,0\n2,0,0\n", "each row must hold 3 numbers"),
        ("0,0,0\n1,0,0\n2,0,0,0\n", "each row must hold 3 numbers"),
        (f"time,{FIRST}\n0,0\n1,0\n", "its columns must be"),
        (f"time,{FIRST},{FIRST}\n0,0,0\n1,0,0\n", "its columns must be"),
        ("0,0,up\n1,0,0\n", "row 1 holds 'up', not a number"),
        ("0,0,1_0\n1,0,0\n", "row 1 holds '1_0', not a number"),  # Python's 10
        ("0,0,٣\n1,0,0\n", "row 1 holds '٣', not a number"),  # Python's 3
        ("0,0,0\n1,down,0\n", "row 2 holds 'down', not a number"),
        (f"time,{FIRST},{SECOND}\n0,0,0\n1,0,0\n2,0,there\n", "row 3 holds 'there', not a number"),
    ],
)
def test_what_is_no_motion_is_refused(tmp_path, text, complaint):
    with pytest.raises(DataFileError, match=complaint):
        read_trajectory(written(tmp_path, text), ROBOT)


def test_what_is_no_text_is_refused(tmp_path):
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    for name in ("binary.csv", "missing.csv"):
        with pytest.raises(DataFileError, match=f"cannot read the trajectory .*{name}"):
            read_trajectory(tmp_path / name, ROBOT)


def test_a_path_that_can_be_none_is_refused_like_any_other():
    with pytest.raises(DataFileError, match="cannot read the trajectory"):
        read_trajectory("\0", ROBOT)
