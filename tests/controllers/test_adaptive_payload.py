"""The adaptive law: its promise on an arm that carries what the model does not know, and what it finds out."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import (
    AdaptivePayload,
    FrameSpring,
    InvalidArgumentError,
    MechanicalSystem,
    Payload,
    Sinusoid,
    TrajectoryTracking,
    UnknownNameError,
    certify,
    load_robot,
    simulate,
)
from phcontrol.identification.parameters import body_regressor
from phcontrol.mechanics.body_torques import body_at, body_torques

FINGERS = ("panda_finger_joint1", "panda_finger_joint2")
BODY = Payload(1.0, (0.02, 0.01, 0.05), (0.004, 0.003, 0.002), "panda_hand")


def pair(**options):
    """A model, and the arm that has a body in its hand."""
    arms = (load_robot("panda", **options), load_robot("panda", payload=BODY, **options))
    return tuple(MechanicalSystem(arm) for arm in arms)


def swing(start):
    """Sinusoids of seven periods, from rest."""
    amplitude = np.array([0.4, 0.3, 0.4, 0.3, 0.5, 0.4, 0.6])
    return Sinusoid(amplitude, [0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45], offset=start + amplitude)


@pytest.mark.parametrize("options", [{"locked_joints": FINGERS}, {}], ids=["seven joints", "a finger that follows"])
def test_torques_of_a_body_are_what_it_adds(options, rng):
    """Against the difference of two models of Pinocchio, with the Christoffel C: linear in the ten parameters."""
    model, arm = pair(**options)
    body = body_at(arm.robot, "panda_hand") - body_at(model.robot, "panda_hand")
    np.testing.assert_allclose(body[:4], [1.0, 0.02, 0.01, 0.05], atol=1e-12)
    for _ in range(5):
        q, (v, s, a) = model.robot.random_position(rng), rng.normal(size=(3, model.n))
        with_body, without = arm.at(q, v), model.at(q, v)
        added = [x.mass_matrix @ a + x.coriolis_matrix @ s + x.potential_gradient for x in (with_body, without)]
        np.testing.assert_allclose(body_torques(without, "panda_hand", s, a) @ body, added[0] - added[1], atol=1e-12)


def test_torques_of_a_body_are_those_of_pinocchios_regressor(rng):
    model, _ = pair(locked_joints=FINGERS)
    frame = model.robot.model.frames[model.robot.frame_id("panda_hand")]
    q, (v, s, a) = model.robot.random_position(rng), rng.normal(size=(3, 7))
    regressor, weightless = body_regressor(model), model.weightless_model
    part = slice(10 * (frame.parentJoint - 1), 10 * frame.parentJoint)
    polarised = regressor(model.model, q, 0.5 * (v + s), a) - regressor(weightless, q, 0.5 * (v - s), np.zeros(7))
    bodies = [body_of_its_own(rng) for _ in range(10)]  # whose parameters are independent
    here = np.array([body.toDynamicParameters() for body in bodies])
    at_joint = np.array([frame.placement.act(body).toDynamicParameters() for body in bodies])
    assert np.linalg.matrix_rank(here) == 10
    ours = body_torques(model.at(q, v), "panda_hand", s, a) @ here.T
    np.testing.assert_allclose(ours, polarised[:, part] @ at_joint.T, atol=1e-10)


def body_of_its_own(rng):
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    moments = turn @ np.diag(rng.uniform(0.5, 1.0, 3)) @ turn.T
    return pin.Inertia(rng.uniform(0.5, 2.0), rng.normal(size=3), moments)


@pytest.mark.parametrize("reference", [False, True])
def test_its_promise_holds_on_an_arm_with_a_body_that_it_does_not_know(reference):
    model, arm = pair(locked_joints=FINGERS)
    options = {"reference": swing(model.robot.near_home())} if reference else {}
    law = AdaptivePayload.tuned(model, frame="panda_hand", actual=arm, **options)
    certificate = certify(law, arm, samples=32)
    assert certificate.passed, str(certificate)
    assert certificate.matching_residual < 1e-7
    unknowing = certify(law.changed(actual=None), arm, samples=8)
    assert not unknowing.matching_passed  # a promise about an arm without a body


def test_it_goes_with_a_spring_on_the_hand():
    model, arm = pair(locked_joints=FINGERS)
    pose = model.at(model.robot.near_home()).placement("panda_hand")
    spring = FrameSpring("panda_hand", pose, translational_stiffness=400.0, rotational_stiffness=20.0)
    law = AdaptivePayload.tuned(model, frame="panda_hand", actual=arm, potential=spring)
    assert certify(law, arm, samples=16).matching_passed


def test_the_torque_knows_nothing_of_the_body(rng):
    model, arm = pair(locked_joints=FINGERS)
    law = AdaptivePayload.tuned(model, frame="panda_hand", actual=arm)
    x, state = model.at(model.robot.random_position(rng), rng.normal(size=7)), law.random_state(rng)
    command, blind = law.evaluate(0.0, x, state), law.changed(actual=None).evaluate(0.0, x, state)
    np.testing.assert_array_equal(command.torque, blind.torque)
    np.testing.assert_array_equal(command.state_rate, blind.state_rate)


def test_the_estimate_is_a_mass_and_its_first_moment():
    model, arm = pair(locked_joints=FINGERS)
    law = AdaptivePayload.tuned(model, frame="panda_hand", actual=arm)
    mass, first = law.estimate(2.0 * law.body)
    assert mass == pytest.approx(2.0 * BODY.mass)
    np.testing.assert_allclose(first, 2.0 * BODY.mass * np.array(BODY.com), atol=1e-12)


def test_an_unknown_kilogramme_is_found_and_the_hand_follows():
    """Estimate within 5 %, hand within 1 mm, H_d never grows; without adaptation the hand errs by centimetres."""
    model, arm = pair(locked_joints=FINGERS)
    start = model.robot.near_home()
    reference = swing(start)
    law = AdaptivePayload.tuned(model, frame="panda_hand", reference=reference, actual=arm)
    plain = TrajectoryTracking.tuned(model, trajectory=reference)
    errors = {}
    for name, controller, duration in (("adaptive", law, 20.0), ("plain", plain, 4.0)):
        log = simulate(arm, controller, q0=start, duration=duration, dt=2e-3, progress=False)
        places = [
            arm.robot.placement("panda_hand", q).translation
            - arm.robot.placement("panda_hand", reference.at(t).position).translation
            for t, q in zip(log.time[-1000::40], log.position[-1000::40], strict=True)
        ]
        errors[name] = np.linalg.norm(places, axis=1).max()
        if name == "adaptive":
            mass, first = law.estimate(log.controller_state[-1])
            assert mass == pytest.approx(1.0, rel=0.05)
            np.testing.assert_allclose(first, BODY.com, atol=0.01)
            assert np.diff(log.storage).max() <= 1e-6 * log.storage[0]
    assert errors["adaptive"] <= 1e-3
    assert errors["plain"] > 20e-3


def test_bad_arguments():
    model, arm = pair(locked_joints=FINGERS)
    for option, value, said in (
        ("frame", "panda_link0", "frame: 'panda_link0' is fixed to the base"),
        ("adaptation", np.ones(9), r"adaptation: must be a scalar, a vector of length 10"),
        ("adaptation", -1.0, "adaptation: must be positive definite"),
        ("actual", "panda", "actual: must be a Robot or a MechanicalSystem, but is str"),
        ("actual", load_robot("ur5"), "actual: must have the joints of the model"),
        ("compliance", -1.0, "compliance: must be positive definite"),
    ):
        with pytest.raises(InvalidArgumentError, match=said):
            AdaptivePayload.tuned(model, **{"frame": "panda_hand", option: value})
    with pytest.raises(UnknownNameError):
        AdaptivePayload.tuned(model, frame="nothing")
    assert AdaptivePayload.tuned(model, actual=arm.robot).actual.robot is arm.robot


def test_by_default_a_weight_in_the_hand_is_found_at_twenty_a_second_where_it_is_felt_most(rng):
    """With the damper slow, −ΓYᵀC⁻¹Y(π̂ − π): Y of a mass is 𝒥ᵀ of its weight. The rest goes by a usual body's size."""
    system, _ = pair()
    law = AdaptivePayload.tuned(system)
    rates = []
    for _ in range(200):
        x = system.at(system.robot.random_position(rng))
        weight = 9.81 * x.frame_jacobian(system.hand_frame, "local_world_aligned")[2]
        rates.append(law.adaptation[0, 0] * float(weight @ np.linalg.solve(law.damping, weight)))
    assert max(rates) == pytest.approx(20.0, rel=0.3)
    usual = np.array([1.0, *[0.1] * 3, *[0.02] * 6])  # [kg], [kg m], [kg m²]
    np.testing.assert_allclose(law.adaptation / law.adaptation[0, 0], np.diag(usual**2), rtol=1e-12)
