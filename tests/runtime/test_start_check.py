"""A loop with a safe set starts from inside it, and refuses or warns outside."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    ControlLoop,
    InvalidArgumentError,
    LoopMode,
    MechanicalSystem,
    PHControlError,
    load_robot,
    make_controller,
    safe_set,
)


@pytest.fixture(scope="module")
def guarded():
    system = MechanicalSystem(load_robot("pera"))
    law = make_controller("force_feedback", system, system.robot.near_home())
    return system, law, safe_set(law, keep=("position", "velocity"))


def stepped(system, law, position, velocity, **arguments):
    """Return a loop that made one step from a reading."""
    time = iter(np.arange(0.0, 1.0, 1e-3))
    loop = ControlLoop(system, law, 1e-3, clock=lambda: next(time), **arguments)
    torque = loop.step(position, velocity)
    return loop, torque


def test_a_start_inside_is_none_of_its_business(guarded):
    system, law, safe = guarded
    q, v, _ = safe.border(1, level=0.9 * safe.level)
    x = system.at(q[0], v[0])
    assert safe.contains(q[0], v[0])
    plain, with_set = (stepped(system, law, x.position, x.velocity, **extra) for extra in ({}, {"safe_set": safe}))
    assert with_set[0].mode == LoopMode.STARTING
    np.testing.assert_array_equal(plain[1], with_set[1])


def test_a_start_outside_is_refused_and_the_arm_is_held(guarded):
    system, law, safe = guarded
    start, still = np.array(law.goal) + 0.3, np.zeros(system.n)
    assert not safe.contains(start)
    loop, torque = stepped(system, law, start, still, safe_set=safe)
    assert isinstance(loop.fault, PHControlError)
    assert "a start with a storage function of" in loop.reason
    assert safe.binding in loop.reason
    assert not loop.mode.is_active
    np.testing.assert_allclose(torque, system.at(start).potential_gradient, atol=1e-9)  # its weight


def test_or_it_is_only_warned_of(guarded):
    system, law, safe = guarded
    start, still = np.array(law.goal) + 0.3, np.zeros(system.n)
    with pytest.warns(UserWarning, match="a start with a storage function of"):
        loop, _ = stepped(system, law, start, still, safe_set=safe, unsafe_start="warn")
    assert loop.fault is None
    assert loop.mode == LoopMode.STARTING


def test_the_set_must_be_that_of_the_law(guarded):
    system, law, safe = guarded
    other = make_controller("force_feedback", system)
    with pytest.raises(InvalidArgumentError, match="safe_set: must be the safe_set"):
        ControlLoop(system, other, 1e-3, safe_set=safe)
    with pytest.raises(InvalidArgumentError, match="safe_set"):
        ControlLoop(system, law, 1e-3, safe_set=3.0)
    with pytest.raises(Exception, match="unsafe_start"):
        ControlLoop(system, law, 1e-3, safe_set=safe, unsafe_start="no")
