"""The grasp study: laws against an independent integration of (4.59), and readings that differ where they must."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from phcontrol import MechanicalSystem, certify, load_robot
from phcontrol.thesis.constant_mass_grasping import ConstantMassGrasping
from phcontrol.thesis.grasping_runs import (
    ALLOYS,
    FORCE,
    PLACE,
    START,
    STRETCHED,
    grasp,
    make_body,
    make_laws,
    pressed_at_last,
    spring_at_a_stop,
)
from phcontrol.thesis.measures import touch_time

MASS, FRICTION, STIFFNESS = 0.5, 0.1, 1.0  # m_g, d_g, K_p


@pytest.fixture(scope="module")
def system():
    return MechanicalSystem(load_robot("pera_gripper"))


def first_at(place, virtual, rest, damping, sign, start=0.0, end=5.0):
    """Return when (4.59) and (4.44), written out for one joint, bring it to a place."""

    def rate(t, x):
        q, v, r = x
        spring = STIFFNESS * (q - virtual - r)
        output = MASS * v + spring
        rest_rate = -output + sign * spring - rest * r
        torque = -FRICTION * spring - STIFFNESS * (v - rest_rate) + rest * r - damping * output
        return v, (-FRICTION * v + torque) / MASS, rest_rate

    def there(t, x):
        return x[0] - place

    there.terminal = True
    found = solve_ivp(rate, (0.0, end), (START, 0.0, start), events=there, rtol=1e-9, atol=1e-12)
    return float(found.t_events[0][0]) if found.t_events[0].size else np.inf


@pytest.mark.parametrize(("body", "rest", "damping"), [("rigid", 0.5, 3.0), ("compliant", 0.25, 1.5)])
@pytest.mark.parametrize("printed_sign", [False, True])
def test_contact_is_when_the_printed_law_says(system, body, rest, damping, printed_sign):
    law = make_laws(system, body, "R1")["grasping"].changed(printed_sign=printed_sign)
    log = grasp(law, make_body(body, "grasping"), duration=1.0)
    expected = first_at(0.20, 0.0, rest, damping, -1.0 if printed_sign else 1.0)
    assert touch_time(log) == pytest.approx(expected, abs=2.1e-3)  # a step of the log


def test_under_r2_what_rests_at_the_body_never_touches_it(system):
    assert first_at(0.20, 0.20, 0.5, 3.0, 1.0) == np.inf
    for name in ("grasping", "classical"):
        law = make_laws(system, "rigid", "R2")[name]
        assert grasp(law, make_body("rigid", name)).contact_force.max() == 0.0


@pytest.mark.parametrize(("body", "rest", "damping"), [("rigid", 0.5, 3.0), ("compliant", 0.25, 1.5)])
def test_under_r2_a_rest_length_at_the_start_makes_it_touch(system, body, rest, damping):
    law = make_laws(system, body, "R2")["grasping"]
    log = grasp(law, make_body(body, "grasping"), duration=1.0, rest=STRETCHED)
    assert touch_time(log) == pytest.approx(first_at(0.20, 0.20, rest, damping, 1.0, STRETCHED), abs=2.1e-3)


def test_at_a_stop_the_rest_length_dies_out_slowly():
    """q̇ = 0 there: q̇_rl = −K_rl q_rl with K_rl = 0.5, so the spring comes to K_p · 0.20 long after contact."""
    at_contact, in_the_end, from_then = spring_at_a_stop()
    contact = first_at(PLACE, 0.0, 0.5, 3.0, 1.0)
    assert PLACE - at_contact > 0.03
    assert in_the_end == pytest.approx(FORCE, abs=1e-3)
    expected = contact + 2.0 * np.log((PLACE - at_contact) / (0.05 * FORCE))
    assert from_then == pytest.approx(expected, abs=0.15)  # it bounces a little at first


def test_a_body_that_begins_where_it_answers_with_the_force_is_held_late():
    touches, holds = pressed_at_last()
    expected = first_at(PLACE + FORCE / ALLOYS[False][0], PLACE, 0.5, 3.0, 1.0, end=30.0)
    assert touches == pytest.approx(expected, abs=0.01)
    assert holds > touches + 5.0


def test_with_the_force_reversed_the_arm_rests_at_half_the_spring(system):
    """K_p q = 2 f_e: the body pushes once, the law adds as much; where (4.60) has K_p q = f_e."""
    laws = make_laws(system, "rigid", "R1")
    logs = {name: grasp(laws[name], make_body("rigid", name)) for name in ("classical-reversed", "classical")}
    for name, share in (("classical-reversed", 0.5), ("classical", 1.0)):
        log = logs[name]
        assert log.contact_force[-1] == pytest.approx(share * STIFFNESS * log.position[-1, 0], rel=1e-3)
    assert not certify(laws["classical-reversed"], system, samples=20).passed


def test_the_law_as_printed_is_not_the_theorems(system):
    """Errata E28: for m = 0.5 its certificate fails; the general law's passes."""
    gains = {"goal": [0.0], "stiffness": 1.0, "rest_stiffness": 0.5, "damping": 3.0}
    assert not certify(ConstantMassGrasping(system, **gains), samples=20).passed
    assert certify(make_laws(system, "rigid", "R1")["grasping-general"], samples=20).passed


def test_where_the_force_would_rest_without_its_cancellation(system):
    """(d_g + C) K_p q for q at the body: what the reason of the claims says."""

    class NotCancelled(ConstantMassGrasping):
        name = "not_cancelled"

        def shape(self, t, x, state, measured):
            return super().shape(t, x, state, measured)._replace(cancelled_force=None)

    law = NotCancelled(system, goal=[0.0], stiffness=1.0, rest_stiffness=0.5, damping=3.0)
    log = grasp(law, make_body("rigid", "grasping"), duration=20.0)
    assert log.contact_force[-1] == pytest.approx((0.1 + 3.0) * log.position[-1, 0], rel=1e-3)
    assert log.contact_force[-1] > 0.55
