"""Input nobody expected: nothing but our own errors comes out, and never a torque that is not finite."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phcontrol import DataFileError, Log, RobotDescriptionError, load_robot
from tests.fuzz.targets import TARGETS, run
from tests.mechanics.test_robot import chain, limits


@pytest.mark.parametrize("name", list(TARGETS))
@settings(max_examples=150)
@given(data=st.binary(min_size=8, max_size=64))
def test_only_our_own_errors_come_out(name, data):
    assert run(TARGETS[name], data) in ("accepted", "refused")


@pytest.mark.parametrize(
    ("limit", "complaint"),
    [
        (limits(1, -1), "lower limit 1 and the upper limit -1"),
        ('<limit lower="-1" upper="1" effort="-5" velocity="2"/>', "effort"),
        ('<limit lower="-1" upper="1" effort="5" velocity="-2"/>', "velocity"),
    ],
)
def test_limits_that_contradict_are_refused(tmp_path, limit, complaint):
    with pytest.raises(RobotDescriptionError, match=complaint):
        load_robot(chain(tmp_path, ("revolute", limit, "")))


def test_huge_masses_are_refused(tmp_path):
    with pytest.raises(RobotDescriptionError):
        load_robot(chain(tmp_path, ("revolute", limits(-1, 1), ""), ("revolute", limits(-1, 1), ""), mass=1e308))


def test_entities_are_not_expanded(tmp_path):
    """A billion laughs would fill the memory; a file entity would read files."""
    path = chain(tmp_path, ("revolute", limits(-1, 1), ""))
    for declaration in ('<!DOCTYPE r [<!ENTITY a "x">]>', '<!DOCTYPE r SYSTEM "file:///etc/passwd">'):
        path.write_text(declaration + path.read_text().replace(declaration, ""))
        with pytest.raises(RobotDescriptionError, match="document type declaration"):
            load_robot(path)


def test_an_archive_that_is_encrypted_or_compressed_otherwise_is_refused(tmp_path):
    """The ZIP reader raises RuntimeError and NotImplementedError there, which were not ours."""
    from tests.fuzz.targets import _good_log

    raw = bytearray(_good_log()[0])
    for offset, value in ((6, 1), (8, 99), (4, 230)):
        damaged = bytearray(raw)
        start = 0
        while (start := damaged.find(b"PK\x03\x04", start)) >= 0:
            damaged[start + offset] = value
            start += 4
        start = 0
        while (start := damaged.find(b"PK\x01\x02", start)) >= 0:
            damaged[start + offset + 2] = value
            start += 4
        path = tmp_path / "log.npz"
        path.write_bytes(damaged)
        with pytest.raises(DataFileError, match="cannot read"):
            Log.load(path)
