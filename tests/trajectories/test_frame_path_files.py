"""Paths of frames read from CSV files, against the poses written into them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from phcontrol import DataFileError, SampledFramePath, read_frame_path

TIMES = np.linspace(0.0, 2.0, 9)
POINTS = np.column_stack([np.sin(TIMES), np.cos(TIMES), TIMES])
TURNS = Rotation.from_rotvec(np.column_stack([TIMES, np.sin(3.0 * TIMES), 1.0 + 0.0 * TIMES]))
NAMES = ["time", "x", "y", "z", "qx", "qy", "qz", "qw"]
TABLE = np.column_stack([TIMES, POINTS, TURNS.as_quat()])


def written(tmp_path, table, header=None):
    path = tmp_path / "path.csv"
    lines = [",".join(repr(float(cell)) for cell in row) for row in table]
    path.write_text("\n".join([*([",".join(header)] if header else []), *lines]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("smoothing", [0.0, 1e-4])
@pytest.mark.parametrize("order", [None, [0, 1, 2, 3, 4, 5, 6, 7], [7, 3, 0, 1, 2, 6, 5, 4]])
def test_a_path_written_is_the_path_read(tmp_path, order, smoothing):
    columns = order or range(8)
    path = written(tmp_path, TABLE[:, columns], order and [NAMES[k] for k in columns])
    read = read_frame_path(path, "tool", smoothing=smoothing)
    expected = SampledFramePath("tool", TIMES, POINTS, TURNS.as_matrix(), smoothing=smoothing)
    assert (read.frame, read.duration) == ("tool", 2.0)
    for t in (0.0, 0.25, 0.6, 1.99):
        for here, there in zip(read.at(t), expected.at(t), strict=True):
            np.testing.assert_allclose(here, there, atol=1e-11)


def test_the_sign_of_a_quaternion_does_not_matter_nor_its_last_digits(tmp_path):
    table = TABLE.copy()
    table[::2, 4:] *= -1.0
    table[:, 4:] = np.round(table[:, 4:], 6)
    read = read_frame_path(written(tmp_path, table), "tool")
    for t, turn in zip(TIMES, TURNS.as_matrix(), strict=True):
        np.testing.assert_allclose(read.at(t).rotation, turn, atol=2e-6)


def test_points_leave_the_orientation_free(tmp_path):
    for header in (None, NAMES[:4]):
        read = read_frame_path(written(tmp_path, TABLE[:, :4], header), "tool")
        assert read.at(0.5).rotation is None
        np.testing.assert_allclose(read.at(TIMES[3]).position, POINTS[3], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "each row must hold 4 numbers"),
        ("0,0,0\n1,0,0\n", "each row must hold 4 numbers"),
        ("0,0,0,0,0\n1,0,0,0,0\n", "each row must hold 8 numbers"),
        ("0,0,0,0\n1,0,0,0,0,0,0,1\n", "each row must hold 4 numbers"),
        ("time,x,y\n0,0,0\n", "its columns must be"),
        ("time,x,y,z,qw,qx,qy,qv\n0,0,0,0,0,0,0,1\n", "its columns must be .*'qw'"),
        ("0,0,0,0\n1,0,nan,0\n", "row 2 holds 'nan', not a number"),
        ("0,0,0,0\n1,0,1_0,0\n", "row 2 holds '1_0', not a number"),
        ("0,0,0,1e999\n1,0,0,0\n", "row 1 holds '1e999', not a number"),
        ("0,0,0,0,0,0,0,1\n1,0,0,0,0,0,0,0\n", "the quaternion of row 2 must have length 1, but has 0"),
        ("0,0,0,0,1,1,1,1\n1,0,0,0,0,0,0,1\n", "the quaternion of row 1 must have length 1, but has 2"),
        ("0,0,0,0,1e200,0,0,1\n1,0,0,0,0,0,0,1\n", "the quaternion of row 1 must have length 1"),
    ],
)
def test_what_is_no_path_is_refused(tmp_path, text, complaint):
    path = tmp_path / "path.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DataFileError, match=complaint):
        read_frame_path(path, "tool")


def test_what_is_no_text_is_refused(tmp_path):
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "folder.csv").mkdir()
    for name in ("binary.csv", "missing.csv", "folder.csv"):
        with pytest.raises(DataFileError, match=f"cannot read the trajectory .*{name}"):
            read_frame_path(tmp_path / name, "tool")
