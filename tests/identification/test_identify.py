"""Identification: parameters that a plant was given are found from how it moved; what cannot be told is named."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from typer.testing import CliRunner

from phcontrol import (
    ConstantTorque,
    InvalidArgumentError,
    Limits,
    MatrixDamping,
    MechanicalSystem,
    MinimumJerk,
    Motion,
    Payload,
    StribeckFriction,
    TrajectoryTracking,
    UnknownNameError,
    compare_models,
    exciting_trajectory,
    identify,
    load_robot,
    simulate,
)
from phcontrol._files import write_json
from phcontrol.cli import application
from phcontrol.identification.consistency import body_of, consistent_values, inconsistent, pseudo_inertia
from phcontrol.identification.parameters import GROUPS, parameters_of, torque_columns
from phcontrol.identification.weak_form import equations_of

FINGERS = ("panda_finger_joint1", "panda_finger_joint2")
BODY = Payload(0.8, (0.02, -0.03, 0.06), (0.004, 0.003, 0.002), "panda_hand")
VISCOUS, COULOMB = np.linspace(0.4, 1.0, 7), np.linspace(1.2, 0.3, 7)
ROTORS, OFFSET = np.linspace(0.2, 0.05, 7), np.linspace(-0.4, 0.5, 7)
SMOOTHING = 1e-3


def bare():
    """The panda as its description has it, without rotors and friction."""
    return replace(load_robot("panda", locked_joints=FINGERS, armature=0.0), friction=None)


@cache
def panda_run():
    """A run of a panda that carries and rubs what its model does not know."""
    robot = bare()
    friction = StribeckFriction(viscous=VISCOUS, coulomb=COULOMB, smoothing=SMOOTHING)
    carrying = load_robot("panda", locked_joints=FINGERS, armature=ROTORS, payload=BODY)
    plant = MechanicalSystem(carrying, friction=friction, potentials=[ConstantTorque(OFFSET)])
    motion = exciting_trajectory(robot, frame="panda_hand", duration=12.0, candidates=40)
    law = TrajectoryTracking.tuned(
        MechanicalSystem(robot),
        trajectory=motion,
        stiffness=[2000, 2000, 1500, 1500, 600, 500, 300],
        damping=[60, 60, 50, 50, 20, 15, 10],
    )
    start = motion.at(0.0).position
    return simulate(plant, law, q0=start, duration=12.0, dt=2e-3, progress=False), plant, motion


def found_in(log, what=GROUPS, **options):
    return identify(log, what, model=bare(), frame="panda_hand", smoothing=SMOOTHING, **options)


def test_every_group_is_found_from_one_run():
    log, plant, _ = panda_run()
    found = found_in(log)
    assert found.untold == found.corrected == ()
    assert found.passed
    assert found.payload.mass == pytest.approx(BODY.mass, rel=1e-3)
    np.testing.assert_allclose(found.payload.com, BODY.com, atol=1e-3)
    np.testing.assert_allclose(found.payload.inertia, BODY.inertia, atol=5e-4)
    np.testing.assert_allclose(found.robot.friction.viscous, VISCOUS, rtol=1e-2)
    np.testing.assert_allclose(found.robot.friction.coulomb, COULOMB, rtol=1e-2)
    np.testing.assert_allclose(found.robot.model.armature, ROTORS, atol=2e-3)
    np.testing.assert_allclose([found[f"offset of {name}"] for name in found.robot.joint_names], OFFSET, atol=5e-3)
    report = compare_models(MechanicalSystem(found.robot), plant, samples=10)
    assert report.largest("M") < 0.01
    assert report.largest("gravity") < 0.05
    before = compare_models(bare(), plant, samples=10)
    assert before.largest("M") > 20.0 * report.largest("M")


def test_torques_of_data_kept_back_are_predicted():
    found = found_in(panda_run()[0])
    prediction = found.prediction
    assert prediction.kept_back.sum() == int(0.25 * len(prediction.time))
    before, after = (np.linalg.norm(prediction.error(which, kept_back=True)) for which in ("before", "after"))
    assert after < 0.02 * before
    assert "confirmed by these" in str(found)
    data = found.to_dict()
    assert data["passed"]
    assert data["parameters"]["payload mass"]["value"] == found["payload mass"]


def test_what_another_arm_did_is_not_confirmed():
    """Torques of the kept part that belong to another load."""
    log, *_ = panda_run()
    torque = np.array(log.torque)
    torque[len(torque) * 3 // 4 :] *= 1.3
    found = found_in(Motion.of(log.time, log.position, log.velocity, torque, held=False))
    assert not found.passed
    assert "NOT confirmed" in str(found)


def panda_signals():
    log, *_ = panda_run()
    return [np.array(part) for part in (log.time, log.position, log.velocity, log.torque)]


def late(values, periods):
    """Return a signal that shows each value some periods later."""
    rows = np.clip(np.arange(len(values)) - periods, 0, len(values) - 1)
    return values[rows]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda t, q, v, u: (1e3 * t, q, v, u),
            "window: of 0.2 s has no 4 samples, which are 2 s apart: times must be in",
        ),
        (lambda t, q, v, u: (10.0 * t, q, v, u), r"panda_joint1 \(it goes 0.1 times as far as its velocity says\)"),
        (lambda t, q, v, u: (t, q, np.degrees(v), u), "velocity in degrees a second"),
        (lambda t, q, v, u: (t, q, v * [1, 1, 1, -1, 1, 1, 1], u), r"position of panda_joint4 \(it goes -1 times"),
        (lambda t, q, v, u: (t, q, v[:, [1, 0, 2, 3, 4, 5, 6]], u), "panda_joint1 .*; panda_joint2 "),
        (lambda t, q, v, u: (t, q, 0.0 * v, u), "the velocity is not the derivative of the position of panda_joint1"),
        (lambda t, q, v, u: (t, q, late(v, 1), u), r"are late by 0.002 s \(1.0 periods\) against the positions"),
        (lambda t, q, v, u: (t, q, late(v, 5), u), r"are late by 0.01 s \(5.0 periods\) against the positions"),
        (lambda t, q, v, u: (t, late(q, 3), v, u), r"are early by 0.006 s \(3.0 periods\) against the positions"),
    ],
)
def test_a_log_that_contradicts_itself_is_refused(change, said):
    """Each was believed, and called confirmed; velocities of one period before made viscous friction wrong by 15 %."""
    motion = Motion.of(*change(*panda_signals()), held=False)
    with pytest.raises(InvalidArgumentError, match=said):
        found_in(motion)


def noisy(signals):
    generator = np.random.default_rng(0)
    sizes = (0.0, 2e-4, 5e-3, 0.3)
    return [part + size * generator.normal(size=part.shape) for part, size in zip(signals, sizes, strict=True)]


@pytest.mark.parametrize("with_noise", [False, True])
def test_logs_that_agree_are_not_doubted(with_noise):
    """Of a hundredth of a degree and of 5 mrad/s noise, and where half a period is between position and velocity."""
    time, q, v, u = noisy(panda_signals()) if with_noise else panda_signals()
    assert found_in(Motion.of(time, q, v, u, held=False)).passed
    between = 0.5 * (v + late(v, 1))  # as a simulator that steps velocity and position in turn has it
    assert found_in(Motion.of(time, q, between, u, held=False)).doubts == ()


@pytest.mark.parametrize(("periods", "word"), [(1, "late by 0.002"), (5, "late by 0.0"), (-3, "early by 0.00")])
def test_torques_that_come_late_are_doubted(periods, word):
    """One period of 2 ms made viscous friction wrong by 29 %, 58 times its standard deviation, and was confirmed."""
    time, q, v, u = noisy(panda_signals())
    found = found_in(Motion.of(time, q, v, late(u, periods), held=False))
    assert not found.passed
    assert word in found.doubts[0]
    assert f"doubted: torques that seem {word}" in str(found)
    assert "NOT confirmed" in str(found)
    assert found.to_dict()["doubts"] == list(found.doubts)


@pytest.mark.filterwarnings("ignore::phcontrol.RobotDescriptionWarning")
def test_positions_of_continuous_joints_may_go_round():
    """A joint that passes ±π in a log has not gone back a turn."""
    robot = load_robot("double_pendulum_continuous")
    system = MechanicalSystem(robot)
    time = np.arange(0.0, 8.0, 2e-3)
    turn = np.outer(time, [1.3, 2.1])
    q, v, a = 4.0 * np.sin(turn), 4.0 * np.cos(turn) * [1.3, 2.1], -4.0 * np.sin(turn) * np.square([1.3, 2.1])
    torque = np.array([system.at(x, y).feedforward(y, z) for x, y, z in zip(q, v, a, strict=True)])
    wrapped = np.remainder(q + np.pi, 2.0 * np.pi) - np.pi
    assert np.abs(np.diff(wrapped, axis=0)).max() > 6.0
    found = identify(Motion.of(time, wrapped, v, torque, held=False), ("viscous",), model=robot)
    assert found.doubts == ()


def test_a_model_that_is_right_already_is_confirmed():
    """Errors of nothing before and after were compared with each other, and the comparison was lost by rounding."""
    log, plant, _ = panda_run()
    found = identify(log, ("offset",), model=plant, smoothing=SMOOTHING)
    assert found.prediction.error("before", kept_back=True).max() < 1e-3
    assert found.passed
    assert "confirmed by these" in str(found)


def test_nothing_kept_back_confirms_nothing(tmp_path):
    """Means of no windows were NaN, with warnings, and could not be written as JSON."""
    found = found_in(panda_run()[0], validation=0.0)
    assert not found.passed
    assert "none kept back: NOT confirmed by any" in str(found)
    write_json(tmp_path / "found.json", found.to_dict())


@cache
def shoulder_run():
    """Two joints that rub, at 100 Hz, a torque held for each period."""
    robot = replace(load_robot("pera_shoulder"), friction=None)
    plant = MechanicalSystem(robot, friction=StribeckFriction(viscous=[0.5, 0.3]))
    motion = exciting_trajectory(robot, duration=8.0, candidates=10)
    law = TrajectoryTracking.tuned(MechanicalSystem(robot), trajectory=motion, stiffness=20.0, damping=3.0)
    start = motion.at(0.0).position
    return robot, simulate(plant, law, q0=start, duration=8.0, dt=1e-2, control_period=1e-2, progress=False)


def test_noise_is_in_the_standard_deviations():
    """Over 25 draws of noise errors are as large as they are said to be, and the mean of them is not biased."""
    robot, log = shoulder_run()
    truth = np.array([0.5, 0.3, *np.asarray(robot.model.armature)])
    generator, scores = np.random.default_rng(5), []
    for _ in range(25):
        torque = log.torque + 0.1 * generator.normal(size=log.torque.shape)
        found = identify(Motion.of(log.time, log.position, log.velocity, torque), ("viscous", "armature"), model=robot)
        scores.append((found.values - truth) / found.deviations)
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.4
    assert np.abs(np.mean(scores, axis=0)).max() < 0.6  # the mean of 25: 0.2 is one deviation


def test_several_logs_and_some_groups():
    log, *_ = panda_run()
    half = len(log.time) // 2
    parts = [Motion.of(log.time[part], log.position[part], log.velocity[part], log.torque[part], held=False)
             for part in (slice(0, half), slice(half, None))]  # fmt: skip
    np.testing.assert_allclose(found_in(parts).values, found_in(log).values, atol=0.02)


def test_the_weak_form_is_the_equation_of_motion():
    """For an arbitrary motion: averages of the torques of inverse dynamics, with true accelerations."""
    robot = load_robot("panda", armature=0.1)  # its second finger follows the first
    system = MechanicalSystem(robot, friction=None)
    parameters = parameters_of(robot, GROUPS, "panda_hand")
    rng = np.random.default_rng(1)
    amplitude, rate, phase = rng.uniform(0.3, 0.6, 8), rng.uniform(1.0, 4.0, 8), rng.uniform(0.0, 6.0, 8)
    amplitude[7] = 0.02
    time = np.arange(0.0, 1.0, 1e-3)
    turn = np.outer(time, rate) + phase
    q = robot.near_home() + amplitude * np.sin(turn)
    v, a = amplitude * rate * np.cos(turn), -amplitude * rate**2 * np.sin(turn)
    torque = np.array([system.at(x, y).feedforward(y, z) for x, y, z in zip(q, v, a, strict=True)])
    equations = equations_of(system, parameters, Motion.of(time, q, v, torque, held=False), 0.2, 1e-6)
    plain = np.zeros(len(parameters.names))
    plain[parameters.columns("armature")] = np.asarray(robot.model.armature)[:8]
    np.testing.assert_allclose(equations.matrix @ plain, equations.known, atol=1e-6)
    columns = np.array([torque_columns(system, parameters, x, y, z) for x, y, z in zip(q, v, a, strict=True)])
    weights = (1.0 - np.linspace(-1.0, 1.0, 201) ** 2) ** 4
    direct = np.tensordot(weights / weights.sum(), columns[:201], axes=1)
    body = parameters.columns("payload")
    np.testing.assert_allclose(equations.matrix[0][:, body], direct[:, body], atol=1e-6)


def test_held_torques_are_integrated_as_held():
    """At 10 ms a torque that is held acts half a period later than one of the instant: that shows in what is found."""
    robot, log = shoulder_run()
    found = identify(log, ("viscous", "armature"), model=robot)
    np.testing.assert_allclose(found.values, [0.5, 0.3, *np.asarray(robot.model.armature)], atol=2e-3)
    wrong = identify(Motion.of(log.time, log.position, log.velocity, log.torque, held=False), ("viscous",), model=robot)
    assert np.abs(wrong.values - [0.5, 0.3]).max() > 5.0 * np.abs(found.values[:2] - [0.5, 0.3]).max()


def test_a_log_that_is_too_short_is_refused():
    log, *_ = panda_run()
    part = slice(0, 400)
    with pytest.raises(
        InvalidArgumentError, match=r"are too short: 0\.798 s give 5 windows of 7 equations, and 38 .*need 17"
    ):
        found_in(Motion.of(log.time[part], log.position[part], log.velocity[part], log.torque[part], held=False))


def test_a_log_that_tells_too_little_is_refused_by_name():
    """One joint moves: nothing tells the friction of the others, nor all of a body; kept, they are the model's."""
    robot = bare()
    goal = np.array(robot.near_home())
    goal[6] += 0.8
    law = TrajectoryTracking.tuned(MechanicalSystem(robot), trajectory=MinimumJerk(robot.near_home(), goal, 3.0))
    log = simulate(law.system, law, q0=robot.near_home(), duration=6.0, dt=2e-3, progress=False)
    with pytest.raises(InvalidArgumentError) as caught:
        found_in(log, ("payload", "viscous"))
    for name in ("payload Ixx", "viscous of panda_joint1"):
        assert name in str(caught.value)
    assert "viscous of panda_joint7" not in str(caught.value)
    found = found_in(log, ("payload", "viscous"), untold="keep")
    assert "viscous of panda_joint1" in found.untold
    assert found["viscous of panda_joint1"] == pytest.approx(0.0, abs=1e-9)
    assert found.deviation("viscous of panda_joint1") == 0.0
    assert "not told by the data" in str(found)
    still = Motion.of(log.time, np.tile(goal, (len(log.time), 1)), 0.0 * log.velocity, log.torque)
    with pytest.raises(InvalidArgumentError, match="do not tell"):
        found_in(still, ("coulomb", "viscous"))


def test_a_body_that_cannot_be_becomes_the_nearest_that_can():
    """A point mass is at the edge of what can be: noise puts least squares beyond it."""
    robot = bare()
    parameters = parameters_of(robot, ("payload", "viscous"), "panda_hand")
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(200, 17))
    truth = np.concatenate([[1.0, 0.0, 0.0, 0.1, 0.01, 0.0, 0.01, 0.0, 0.0, 0.0], np.full(7, 0.01)])
    wrong = truth + 0.02 * rng.normal(size=17)
    assert inconsistent(parameters, wrong)
    known = matrix @ wrong
    values = consistent_values(parameters, matrix, known, wrong)
    assert inconsistent(parameters, values) == ()
    assert np.linalg.norm(matrix @ values - known) <= np.linalg.norm(matrix @ truth - known)
    assert np.linalg.eigvalsh(pseudo_inertia(values[:10]))[0] >= -1e-12
    np.testing.assert_allclose(body_of(pseudo_inertia(wrong[:10])), wrong[:10], atol=1e-15)


def test_a_pseudo_inertia_is_positive_exactly_for_bodies():
    """Against the definition: principal moments about the centre of mass, and their triangle inequality."""
    rng = np.random.default_rng(2)
    seen = set()
    for _ in range(200):
        moments, mass, com = np.diag(rng.uniform(0.0, 1.0, 3)), rng.uniform(0.1, 2.0), rng.normal(size=3)
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        about = turn @ moments @ turn.T
        about_origin = about + mass * (com @ com * np.eye(3) - np.outer(com, com))
        body = np.concatenate([[mass], mass * com, about_origin[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])
        possible = bool(2.0 * np.diag(moments).max() <= np.diag(moments).sum())
        seen.add(possible)
        assert (np.linalg.eigvalsh(pseudo_inertia(body))[0] >= -1e-12) == possible
    assert seen == {True, False}


def test_bad_arguments():
    log, *_ = panda_run()
    for what in ("payload", []):
        with pytest.raises(InvalidArgumentError, match="what: must be a list of payload, coulomb"):
            identify(log, what, model=bare())
    with pytest.raises(UnknownNameError, match="unknown group of parameters 'viscose'"):
        identify(log, ["viscose"], model=bare())
    with pytest.raises(InvalidArgumentError, match="frame: must name what carries the payload"):
        identify(log, ["payload"], model=bare())
    with pytest.raises(InvalidArgumentError, match="model: must be given"):
        identify(log, ["viscous"])
    with pytest.raises(InvalidArgumentError, match="hold 7 joints, but ur5 has 6"):
        identify(log, ["viscous"], model=load_robot("ur5"))
    with pytest.raises(InvalidArgumentError, match="logs: must be a Log, a Motion or a list"):
        identify(3, ["viscous"], model=bare())
    with pytest.raises(InvalidArgumentError, match="model: must be a Robot"):
        identify(log, ["viscous"], model="panda")
    full = MechanicalSystem(bare(), friction=MatrixDamping(lambda q, v: np.eye(7)))
    with pytest.raises(InvalidArgumentError, match="must name coulomb and viscous friction together"):
        identify(log, ["viscous"], model=full)


def test_motions_are_checked():
    time, zero = np.linspace(0.0, 1.0, 11), np.zeros((11, 2))
    with pytest.raises(
        InvalidArgumentError, match="time: must grow in equal steps, but they are 0.1 to 0.2 s: samples are missing"
    ):
        Motion.of(np.delete(time, 4), *[zero[:10]] * 3)
    with pytest.raises(InvalidArgumentError, match=r"velocity: must have shape \(11, 2\), a row a sample, but has"):
        Motion.of(time, zero, zero[:10], zero)
    with pytest.raises(InvalidArgumentError, match="torque: must be finite"):
        Motion.of(time, zero, zero, zero + np.nan)
    with pytest.raises(InvalidArgumentError, match="at least 3 samples"):
        Motion.of([0.0], *[zero[:1]] * 3)


def test_the_exciting_motion_stays_inside_the_limits_and_begins_at_rest():
    robot = load_robot("ur5")
    limits = Limits(MechanicalSystem(robot), velocity=1.5)
    motion = exciting_trajectory(robot, limits, 16.0, frame="tool0", what=("payload", "viscous"), candidates=30)
    assert motion.condition <= motion.first_condition
    assert (motion.n, motion.duration, motion.series.period) == (6, 16.0, 8.0)
    for part in motion.at(0.0)[1:]:
        np.testing.assert_allclose(part, 0.0, atol=1e-12)
    system, moments = MechanicalSystem(robot), [motion.at(t) for t in np.linspace(0.0, 16.0, 1000)]
    q, v, a = (np.array([moment[i] for moment in moments]) for i in range(3))
    assert (q >= robot.lower).all()
    assert (q <= robot.upper).all()
    assert np.abs(v).max() <= 0.81 * 1.5
    torque = [np.abs(system.at(*moment[:2]).feedforward(*moment[1:])) for moment in moments]
    assert (np.array(torque) <= 0.85 * robot.effort_limit).all()
    np.testing.assert_allclose(np.gradient(q, 16.0 / 999, axis=0)[1:-1], v[1:-1], atol=0.01)
    np.testing.assert_allclose(np.gradient(v, 16.0 / 999, axis=0)[1:-1], a[1:-1], atol=0.02)
    with pytest.raises(InvalidArgumentError, match="start: is outside the limits"):
        exciting_trajectory(robot, start=np.full(6, 100.0), what=("viscous",))
    weak = Limits(system, effort=0.5, braking_acceleration=1.0)
    with pytest.raises(InvalidArgumentError, match="limits: leave no room for a motion"):
        exciting_trajectory(robot, weak, what=("viscous",), candidates=2)


def test_the_command(tmp_path):
    log, *_ = panda_run()
    path = log.save(tmp_path / "log.npz")
    command = ["identify", str(path), "--what", "payload,coulomb,viscous,armature,offset", "--frame", "panda_hand"]
    command += ["--robot", "panda", "--armature", "0", "--out", str(tmp_path / "out")]
    for finger in FINGERS:
        command += ["--lock", finger]
    shown = CliRunner().invoke(application.app, command)
    assert shown.exit_code == 0, shown.output
    assert "payload: 0.7999 kg at panda_hand" in shown.output or "payload: 0.8 kg" in shown.output
    assert (tmp_path / "out" / "identification.json").exists()
    assert (tmp_path / "out" / "torques.png").stat().st_size > 20_000
    nothing_new = CliRunner().invoke(application.app, ["identify", str(path), "--what", "nothing"])
    assert nothing_new.exit_code == 2 or nothing_new.exit_code == 1
    assert "unknown group of parameters 'nothing'" in nothing_new.output
