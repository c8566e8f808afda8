"""The checks at the border: what passes unchanged, what is refused, and at which edge."""

from __future__ import annotations

import json
import os
import stat

import numpy as np
import pytest

from phcontrol._differences import central_difference
from phcontrol._files import write_atomically, write_json, write_text
from phcontrol._lazy import lazy
from phcontrol._validation import (
    choice,
    count,
    finite_array,
    flag,
    gain,
    matrix,
    number,
    per_joint,
    positive,
    rotation,
    sequence,
    vector,
    whole_multiple,
)
from phcontrol.exceptions import (
    DataFileError,
    InvalidArgumentError,
    MissingMeasurementError,
    UnknownNameError,
)
from phcontrol.trajectories.inverse_kinematics import Posture, UnreachableTargetError


@pytest.mark.parametrize("value", [3, 2.5, True, [1, 2], (1.0, 2.0), np.array([[1, 2]], dtype=np.uint8), np.float32(2)])
def test_real_arrays_pass_as_copies_that_cannot_be_changed(value):
    array = finite_array("a", value)
    np.testing.assert_array_equal(array, np.asarray(value, dtype=float))
    assert array.dtype == np.float64
    assert not array.flags.writeable
    assert array is not value


@pytest.mark.parametrize(
    ("value", "complaint"),
    [
        ([1.0, np.nan], "a: must be finite, but is nan at index 1"),
        ([[1.0, 2.0], [np.inf, np.nan]], "a: must be finite, but is inf at index 1, 0"),
        (np.inf, "a: must be finite, but is inf$"),
        (1j, "a: must be an array of real numbers .holds complex128 values"),
        ("1", "a: must be an array of real numbers"),
        ([[1.0], [1.0, 2.0]], "a: must be an array of real numbers"),
        (None, "a: must be an array of real numbers"),
    ],
)
def test_what_is_no_finite_array_is_refused(value, complaint):
    with pytest.raises(InvalidArgumentError, match=complaint):
        finite_array("a", value)


def test_vectors_have_their_length_and_numbers_stand_for_all_joints():
    np.testing.assert_array_equal(vector("v", [1, 2], 2), [1.0, 2.0])
    np.testing.assert_array_equal(per_joint("v", 3, 2), [3.0, 3.0])
    np.testing.assert_array_equal(per_joint("v", [3, 4], 2), [3.0, 4.0])
    for make in (lambda: vector("v", 1.0, 1), lambda: vector("v", [[1, 2]], 2), lambda: per_joint("v", [1.0], 2)):
        with pytest.raises(InvalidArgumentError, match="v: must have shape"):
            make()


def test_matrices_are_given_in_full_by_their_diagonal_or_by_a_number():
    np.testing.assert_array_equal(matrix("m", 2, 2), [[2.0, 0.0], [0.0, 2.0]])
    np.testing.assert_array_equal(matrix("m", [2, 3], 2), [[2.0, 0.0], [0.0, 3.0]])
    np.testing.assert_array_equal(matrix("m", [[1, 2], [3, 4]], 2), [[1.0, 2.0], [3.0, 4.0]])
    assert not any(matrix("m", value, 2).flags.writeable for value in (2, [2, 3], [[1, 2], [3, 4]]))
    for value in ([1, 2, 3], [[1, 2]], [[[1]]]):
        with pytest.raises(InvalidArgumentError, match=r"a scalar, a vector of length 2 or a \(2, 2\) matrix"):
            matrix("m", value, 2)


def test_gains_are_symmetric_but_for_rounding_and_positive_definite():
    np.testing.assert_array_equal(gain("g", [[2.0, 1.0], [1.0, 2.0]], 2), [[2.0, 1.0], [1.0, 2.0]])
    for size in (1.0, 1e6):
        gain("g", size * np.array([[2.0, 1.0 + 1.5e-12], [1.0, 2.0]]), 2)
        with pytest.raises(InvalidArgumentError, match="g: must be symmetric"):
            gain("g", size * np.array([[2.0, 1.0 + 3e-12], [1.0, 2.0]]), 2)
    for value in (0.0, [1.0, 0.0], [[1.0, 1.0], [1.0, 1.0]], [1.0, -1e-9]):
        with pytest.raises(InvalidArgumentError, match="g: must be positive definite, but its smallest eigenvalue"):
            gain("g", value, 2)
    gain("g", [1.0, 1e-9], 2)


def test_numbers_keep_inside_their_bounds():
    assert number("x", "2.5") == 2.5
    assert number("x", 1, minimum=1.0, maximum=1.0) == 1.0
    assert number("x", 1.0 + 1e-9, minimum=1.0, exclusive=True) > 1.0
    for value, bounds, complaint in [
        (1.0 - 1e-9, {"minimum": 1.0}, "x: must be >= 1, but is 1"),
        (1.0, {"minimum": 1.0, "exclusive": True}, "x: must be > 1, but is 1"),
        (0.5, {"minimum": 1.0, "exclusive": True}, "x: must be > 1, but is 0.5"),
        (2.0 + 1e-9, {"maximum": 2.0}, "x: must be <= 2, but is 2"),
        (np.nan, {}, "x: must be finite"),
        (-np.inf, {}, "x: must be finite"),
        (10**400, {}, "x: must be a number"),
        ("two", {}, "x: must be a number, but is 'two'"),
        (None, {}, "x: must be a number, but is None"),
    ]:
        with pytest.raises(InvalidArgumentError, match=complaint):
            number("x", value, **bounds)
    assert positive("x", 1e-300) == 1e-300
    for value in (0.0, -1.0):
        with pytest.raises(InvalidArgumentError, match="x: must be > 0"):
            positive("x", value)


def test_counts_are_integers_from_a_least_one_on():
    assert (count("n", 1), count("n", np.int32(5)), count("n", 0, minimum=0)) == (1, 5, 0)
    assert type(count("n", np.int64(2))) is int
    for value, least in [(0, 1), (1, 2), (True, 1), (1.0, 1), ("1", 1), (-1, 0)]:
        with pytest.raises(InvalidArgumentError, match=f"n: must be an integer >= {least}"):
            count("n", value, minimum=least)


def test_choices_and_sequences():
    assert choice("side", "left", ["left", "right"]) == "left"
    for value in ("lift", 1, None, ["left"]):
        with pytest.raises(UnknownNameError, match=r"unknown side.*Known: left, right"):
            choice("side", value, ["right", "left"])
    assert sequence("s", (item for item in ("ab", [1])), "things", "__len__", "index") == ("ab", [1])
    for value in ("ab", b"ab", 3):
        with pytest.raises(InvalidArgumentError, match="s: must be a sequence of things"):
            sequence("s", value, "things")
    with pytest.raises(InvalidArgumentError, match="s: must hold things, but one is int"):
        sequence("s", ["ab", 3], "things", "__len__")
    with pytest.raises(InvalidArgumentError, match="s: must hold things, but one is tuple"):
        sequence("s", [()], "things", "__len__", "append")


def test_whole_multiples_are_whole_but_for_rounding():
    assert whole_multiple("period", 0.01, 1e-3) == 10
    assert whole_multiple("period", 1e-3, 1e-3) == 1
    assert whole_multiple("period", 0.01 * (1.0 + 0.9e-6), 1e-3) == 10
    for period in (0.01 * (1.0 + 1.2e-6), 0.0105, 0.4e-3, 0.6e-3):
        with pytest.raises(InvalidArgumentError, match=r"period: must be a whole multiple of dt = 0\.001 s"):
            whole_multiple("period", period, 1e-3)
    assert whole_multiple("period", 1e300, 1e-3) == 10**15


def test_differences_are_exact_for_polynomials_of_fourth_degree():
    for step in (0.5, 0.1):
        slope = central_difference(lambda h: 3.0 + 2.0 * h - h**2 + 4.0 * h**3 - 5.0 * h**4, step)
        assert slope == pytest.approx(2.0, rel=1e-12)


class Squared:
    def __init__(self):
        self.computed = 0

    @lazy
    def square(self):
        """Four."""
        self.computed += 1
        return 4


def test_a_lazy_quantity_is_computed_once():
    thing = Squared()
    assert (thing.square, thing.square, thing.computed) == (4, 4, 1)
    assert isinstance(Squared.square, lazy)
    assert Squared.square.__doc__ == "Four."


def test_files_are_whole_or_as_they_were(tmp_path):
    path = tmp_path / "new" / "data.json"
    assert write_json(path, {"a": [1, 2.5]}) == path
    assert json.loads(path.read_text()) == {"a": [1, 2.5]}
    assert path.read_text() == '{\n  "a": [\n    1,\n    2.5\n  ]\n}\n'
    mask = os.umask(0o022)
    try:
        write_text(path, "µ")
    finally:
        os.umask(mask)
    assert path.read_bytes() == "µ".encode()
    assert stat.S_IMODE(path.stat().st_mode) == 0o644

    def breaks_off(file):
        file.write(b"half")
        raise OSError(28, "No space left on device")

    with pytest.raises(DataFileError, match=r"cannot write .*data\.json: No space left on device"):
        write_atomically(path, breaks_off)
    assert path.read_bytes() == "µ".encode()
    assert [entry.name for entry in path.parent.iterdir()] == ["data.json"]
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(path, float("nan"))
    with pytest.raises(DataFileError, match="cannot write"):
        write_text(path / "below a file", "")


def test_errors_say_what_would_be_right():
    error = UnknownNameError("joint", "elbw", ["wrist", "elbow"], " of arm")
    assert str(error) == "unknown joint 'elbw' of arm. Did you mean 'elbow'? Known: elbow, wrist."
    assert error.known == ["elbow", "wrist"]
    hand = UnknownNameError("frame", "Hand", ["panda_link8", "panda_hand_tcp", "panda_hand"])
    assert "Did you mean 'panda_hand'?" in str(hand)
    assert str(UnknownNameError("joint", "q", [])) == "unknown joint 'q'. Known: none."
    error = MissingMeasurementError("law", "features")
    assert "law needs the measurement 'features': pass it as Measured(features=...)" in str(error)
    for angle, away in [(0.0, "stays 0.1 m away"), (0.2, "stays 0.1 m and 0.2 rad away")]:
        error = UnreachableTargetError("hand", "arm", " number 2", Posture(np.zeros(1), 0.1, angle))
        assert str(error).startswith("frame 'hand' of arm does not reach its target number 2: it ")
        assert str(error).endswith(away)


def test_rotations_are_orthogonal_and_do_not_reflect():
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_array_equal(rotation("r", turn), turn)
    assert not rotation("r", turn.tolist()).flags.writeable
    rotation("r", turn + 4e-10)
    for wrong in (turn + 2e-9, (1.0 + 1e-9) * turn, -turn, np.zeros((3, 3)), turn[:2]):
        with pytest.raises(InvalidArgumentError, match="r: must be a rotation matrix"):
            rotation("r", wrong)


def test_a_flag_is_true_or_false_and_nothing_that_only_counts_as_it():
    assert flag("f", True) is True
    assert flag("f", False) is False
    for wrong in (1, 0, "no", None, [], np.True_):
        with pytest.raises(InvalidArgumentError, match="f: must be True or False, but is"):
            flag("f", wrong)
