"""Calibration files: OpenCV's own, ROS's, and what is none."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from phcontrol import DataFileError, PinholeCamera, read_camera

MATRIX = np.array([[521.3, 0.0, 331.7], [0.0, 517.9, 226.4], [0.0, 0.0, 1.0]])
LENS = np.array([[-0.3, 0.12, 0.0012, -0.0009, -0.02]])
EXPECTED = PinholeCamera.calibrated(MATRIX, LENS, (640, 480), frame="camera", focal_length=0.004)

ROS = """
image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [521.3, 0., 331.7, 0., 517.9, 226.4, 0., 0., 1.]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.3, 0.12, 1.2e-3, -9e-4, -2E-2]
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
projection_matrix: {rows: 3, cols: 4, data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]}
"""


def read(tmp_path, text):
    path = tmp_path / "camera.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_camera(path, frame="camera", focal_length=0.004)


@pytest.mark.parametrize("column", [False, True])
def test_what_opencv_wrote_is_read(tmp_path, column):
    path = tmp_path / "opencv.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Tue 24 Nov 2026 12:00:00")
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("camera_matrix", MATRIX)
    storage.write("distortion_coefficients", LENS.T.copy() if column else LENS)
    storage.write("avg_reprojection_error", 0.21)
    storage.release()
    made = read_camera(path, frame="camera", focal_length=0.004)
    assert made.frame == "camera"
    np.testing.assert_allclose(made.matrix, EXPECTED.matrix, rtol=1e-13)
    assert made.distortion == EXPECTED.distortion


def test_what_ros_wrote_is_read(tmp_path):
    made = read(tmp_path, ROS)
    np.testing.assert_allclose(made.matrix, EXPECTED.matrix, rtol=1e-13)
    assert made.distortion == EXPECTED.distortion
    assert made.image_size == (640, 480)


def test_a_lens_without_distortion_may_be_empty(tmp_path):
    empty = ROS.replace("cols: 5", "cols: 0").replace("[-0.3, 0.12, 1.2e-3, -9e-4, -2E-2]", "[]")
    assert read(tmp_path, empty).distortion == ()


# lists in lists in lists: 9^8 numbers, if anything walked through them
LAUGHS = "a: &a [1,1,1,1,1,1,1,1,1]\n"
LAUGHS += "".join(f"{b}: &{b} [{','.join(9 * [f'*{a}'])}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True))
LAUGHS += ROS.replace("data: [521.3", "data: *i\nother: [521.3")

HOSTILE = {
    "missing": (ROS.replace("image_width: 640", ""), "image_width: is missing"),
    "fisheye": (ROS.replace("plumb_bob", "equidistant"), "fisheye lens is not supported"),
    "fisheye of OpenCV": (ROS + "fisheye_model: 1\n", "fisheye lens is not supported"),
    "nan": (ROS.replace("521.3", ".nan"), "finite numbers"),
    "infinite": (ROS.replace("521.3", ".inf"), "finite numbers"),
    "word": (ROS.replace("521.3", "wide"), "finite numbers"),
    "flag": (ROS.replace("521.3", "true"), "finite numbers"),
    "huge": (ROS.replace("521.3", "1" + 400 * "0"), "finite numbers"),
    "negative": (ROS.replace("521.3", "-521.3"), "camera_matrix"),
    "zero": (ROS.replace("521.3", "0.0"), "camera_matrix"),
    "skewed": (ROS.replace("521.3, 0.,", "521.3, 4.,"), "camera_matrix"),
    "short": (ROS.replace("521.3, ", ""), "rows x cols"),
    "sizes": (ROS.replace("rows: 3", "rows: 100000"), "rows x cols"),
    "size of a text": (ROS.replace("image_width: 640", "image_width: '640'"), "whole number"),
    "small image": (ROS.replace("image_width: 640", "image_width: 2"), "image_size"),
    "axis outside": (ROS.replace("331.7", "3317.0"), "principal_point"),
    "folds": (ROS.replace("[-0.3, ", "[-30.0, "), "folds within the image"),
    "square": (ROS.replace("rows: 1\n  cols: 5", "rows: 2\n  cols: 2").replace(", -2E-2]", "]"), "row or a column"),
    "a list": ("- 1\n- 2\n", "names and values"),
    "no matrix": (ROS.replace("camera_matrix:", "camera_matrix: 5\nother:"), "rows, cols and data"),
    "code": (ROS.replace("narrow_stereo", "!!python/object/apply:os.system ['touch owned']"), "cannot read"),
    "not yaml": ("{", "cannot read"),
    "binary": (b"\xff\xfe\x00\x01", "cannot read"),
    "deep": ("[" * 5000, "cannot read"),
    "laughs": (LAUGHS, "one is a list"),
    "long": ("#" * 300_000, "longer than"),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_what_is_no_calibration_is_refused_in_words(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    text, problem = HOSTILE[name]
    assert text != ROS
    with pytest.raises(DataFileError, match=problem):
        read(tmp_path, text)
    assert not (tmp_path / "owned").exists()


@pytest.mark.parametrize("path", ["missing.yaml", ".", "a\0b", "/dev/zero"])
def test_a_place_without_a_file_is_refused(path):
    with pytest.raises(DataFileError, match="cannot read the calibration"):
        read_camera(path)
