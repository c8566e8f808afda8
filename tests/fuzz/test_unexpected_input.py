"""Input nobody expected: nothing but our own errors comes out, and never a torque that is not finite."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phcontrol import (
    ControlLoop,
    DataFileError,
    Holding,
    InvalidArgumentError,
    Log,
    Measured,
    RobotDescriptionError,
    StribeckFriction,
    load_robot,
    make_controller,
)
from tests.conftest import make_system
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


def test_friction_parameters_of_several_lengths_are_refused():
    with pytest.raises(InvalidArgumentError, match="vectors of one length"):
        StribeckFriction(coulomb=[1.0, 2.0], static=[2.0, 3.0, 4.0])


def test_a_spring_needs_a_state_to_hold():
    with pytest.raises(InvalidArgumentError, match="reference: must be a state of the arm"):
        Holding("tool", 1.0, [0.0, 0.0, 1.0])


def test_an_approach_speed_beyond_all_numbers_is_as_good_as_none():
    system = make_system("pera_shoulder")
    x, state = system.at([0.1, 0.2], [0.1, 0.2]), np.array([0.1, 0.2])
    torques = [
        make_controller("force_control", system, feedforward=False, approach_speed=speed)
        .evaluate(0.0, x, state, Measured(np.zeros(2)))
        .torque
        for speed in (1e308, 1e3)
    ]
    np.testing.assert_array_equal(*torques)


def test_damping_beyond_all_numbers_is_refused():
    """On the way to a stop 0 · ∞ came out of it, which no limit clips."""
    system = make_system("pera_shoulder")
    with pytest.raises(InvalidArgumentError, match=r"holding_damping: must be 0 to 1e\+09"):
        ControlLoop(system, make_controller("energy_shaping", system), period=1e-3, holding_damping=1e308)
