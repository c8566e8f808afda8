"""Motions from CSV files: numbers as a file means them, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import DataFileError
from phcontrol.trajectories.files import read_trajectory
from tests.conftest import make_system

ROWS = "0,0.1,0.2\n1,0.2,-3e-1\n2,+.5,1.\n3,0,0\n"
TABLE = np.array([[0, 0.1, 0.2], [1, 0.2, -0.3], [2, 0.5, 1.0], [3, 0, 0]])


def read(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "motion.csv"
    path.write_text(text, encoding=encoding)
    return read_trajectory(path, make_system("pera_shoulder").robot)


@pytest.mark.parametrize("header", ["", "time,shoulder_yaw,shoulder_pitch\n"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_a_byte_order_mark_is_no_content(tmp_path, header, encoding):
    names = ",".join(make_system("pera_shoulder").robot.joint_names)
    trajectory = read(tmp_path, (f"time,{names}\n" if header else "") + ROWS, encoding)
    for row in TABLE:
        np.testing.assert_allclose(trajectory.at(row[0]).position, row[1:], atol=1e-12)


@pytest.mark.parametrize("cell", ["1_0", "nan", "inf", "0x1", "", "0.2 rad", "１", "1e999", "true"])
def test_a_cell_that_is_no_decimal_number_is_refused(tmp_path, cell):
    with pytest.raises(DataFileError, match=rf"row 2 holds '{cell}', not a number such as 0\.25"):
        read(tmp_path, ROWS.replace("\n1,0.2,", f"\n\n1,{cell},"))


def test_a_first_row_that_is_neither_numbers_nor_names_is_refused(tmp_path):
    with pytest.raises(DataFileError, match=r"its columns must be \['time', .*but are \['1_0'"):
        read(tmp_path, "1_0,0.1,0.2\n" + ROWS)
