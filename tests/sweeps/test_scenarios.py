"""What is drawn is what was asked for, the same whoever asks; what cannot be is refused at the border."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from phcontrol import (
    ForceSensor,
    InvalidArgumentError,
    JointSensor,
    Pulse,
    RobotDescriptionError,
    Sweep,
    UnknownNameError,
    simulate,
)
from phcontrol.compilation.compiler import find_compiler
from phcontrol.sweeps.chunk import rows_of
from phcontrol.sweeps.distribution import Distribution
from phcontrol.sweeps.space import Space


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"uniform": [1.0, 3.0]}, stats.uniform(1.0, 2.0)),
        ({"distribution": "norm", "loc": 2.0, "scale": 0.5}, stats.norm(2.0, 0.5)),
        ({"distribution": "lognorm", "s": 0.4}, stats.lognorm(0.4)),
        ({"distribution": "poisson", "mu": 3.0}, stats.poisson(3.0)),
        ({"distribution": "norm", "minimum": -1.0, "maximum": 0.5}, stats.truncnorm(-1.0, 0.5)),
    ],
)
def test_numbers_follow_the_distribution(given, expected):
    parts = (np.arange(4000) + 0.5) / 4000
    drawn = Distribution("x", given).at(parts)
    for edge in np.quantile(drawn, [0.0, 0.1, 0.5, 0.9, 1.0]):
        assert abs((drawn <= edge).mean() - expected.cdf(edge)) < 1e-3


def test_the_ends_of_a_distribution_are_finite():
    """As far out as a draw of 53 bits can be."""
    ends = Distribution("x", {"distribution": "norm"}).at([0.0, 1.0])
    np.testing.assert_allclose(ends, [-stats.norm.isf(2.0**-53), stats.norm.isf(2.0**-53)], rtol=1e-2)


def test_a_discrete_distribution_that_is_cut_off_keeps_its_ends():
    drawn = Distribution("x", {"distribution": "poisson", "mu": 3.0, "minimum": 1.0, "maximum": 4.0}).at(
        (np.arange(1000) + 0.5) / 1000
    )
    values, counts = np.unique(drawn, return_counts=True)
    np.testing.assert_array_equal(values, [1.0, 2.0, 3.0, 4.0])
    expected = stats.poisson(3.0).pmf(values)
    np.testing.assert_allclose(counts / 1000, expected / expected.sum(), atol=2e-3)


@pytest.mark.parametrize("method", ["random", "latin_hypercube", "sobol"])
def test_rows_do_not_depend_on_how_they_are_asked_for(method):
    axes = {name: Distribution(name, {"uniform": [0.0, 1.0]}) for name in "abc"}
    space = Space(axes, method, 64, seed=5)
    whole = space.rows(0, 64)
    np.testing.assert_array_equal(np.vstack([space.rows(k, k + 1) for k in range(64)]), whole)
    np.testing.assert_array_equal(Space(axes, method, 64, seed=5).rows(17, 40), whole[17:40])
    assert np.abs(Space(axes, method, 64, seed=6).rows(0, 64) - whole).max() > 0.1
    assert len({space.noise_seed(k) for k in range(64)}) == 64
    if method != "random":  # each of 64 equal parts of each range is met once
        for column in whole.T:
            np.testing.assert_array_equal(np.sort((column * 64).astype(int)), np.arange(64))


def test_grids_and_lists_are_all_combinations_and_in_step():
    axes = {"a": Distribution("a", [1.0, 2.0]), "b": Distribution("b", {"grid": {"from": 0, "to": 1, "count": 3}})}
    grid = Space(axes, "grid")
    assert grid.runs == 6
    np.testing.assert_array_equal(grid.rows(0, 6), [[a, b] for a in (1.0, 2.0) for b in (0.0, 0.5, 1.0)])
    np.testing.assert_array_equal(grid.rows(4, 5), [[2.0, 0.5]])
    listed = Space({"a": Distribution("a", [1, 2]), "b": Distribution("b", [3, 4])}, "list")
    np.testing.assert_array_equal(listed.rows(0, 2), [[1.0, 3.0], [2.0, 4.0]])


def test_a_scenario_is_the_loop_that_one_would_write(small):
    """Each quantity against the run that is made by hand."""
    small["vary"] = {
        "gain_factor.stiffness": [1.5], "initial_offset.each": [0.05], "payload_mass": [0.4], "payload_z": [0.02],
        "mass_factor": [1.1], "friction_factor": [1.4], "sensor_noise": [0.1], "sensor_bias": [0.2],
        "sensor_delay": [2e-3], "control_period": [2e-3], "disturbance.each": [0.7], "disturbance_start": [0.01],
        "disturbance_duration": [0.02],
    }  # fmt: skip
    small["sampling"] = {"method": "list", "seed": 9}
    sweep = Sweep(**small)
    loop, nominal = sweep.loop(0), sweep.nominal
    law = nominal.law.changed(stiffness=1.5 * np.asarray(nominal.law.stiffness))
    np.testing.assert_array_equal(loop["controller"].stiffness, law.stiffness)
    assert loop["controller"].system is nominal.system
    ours, theirs = loop["system"].at(nominal.start), nominal.system.at(nominal.start)
    # M with all links 1.1 times as heavy, and a point mass in the hand
    jacobian = theirs.frame_jacobian(nominal.hand, "local_world_aligned")[:3]
    lever = theirs.placement(nominal.hand).rotation @ [0.0, 0.0, 0.02]
    at_mass = jacobian - np.cross(lever, theirs.frame_jacobian(nominal.hand, "local_world_aligned")[3:], axisa=0,
                                  axisb=0, axisc=0)  # fmt: skip
    armature = np.diag(nominal.robot.model.armature)
    expected = 1.1 * (theirs.mass_matrix - armature) + armature + 0.4 * at_mass.T @ at_mass
    np.testing.assert_allclose(ours.mass_matrix, expected, rtol=1e-10)
    np.testing.assert_allclose(loop["system"].friction.viscous, 0.7)
    own = simulate(
        loop["system"], law, duration=0.05, control_period=2e-3, q0=nominal.start + 0.05,
        disturbance=Pulse([0.7, 0.7], 0.01, 0.02),
        sensors=[ForceSensor(noise=0.1, bias=0.2, delay=2e-3, seed=sweep.space.noise_seed(0))],
    )  # fmt: skip
    np.testing.assert_array_equal(sweep.replay(0).position, own.position)


def test_what_is_not_varied_stays_as_it_is_described(small):
    small["arm"] |= {"payload": 0.3, "friction": {"viscous": 0.5, "coulomb": 0.2}}
    small["vary"] = {"viscous_friction": [0.9], "gain.stiffness": [0.25], "disturbance.each": [0.7]}
    small["sampling"] = {"method": "list"}
    sweep = Sweep(**small)
    loop = sweep.loop(0)
    np.testing.assert_array_equal(loop["system"].friction.viscous, 0.9)
    np.testing.assert_array_equal(loop["system"].friction.coulomb, 0.2)
    np.testing.assert_array_equal(loop["controller"].stiffness, 0.25 * np.eye(2))
    np.testing.assert_array_equal(loop["disturbance"](0.0, loop["system"].at(loop["q0"])), 0.7)
    small["arm"]["payload"] = {"mass": 0.3}
    without = small | {"arm": {name: one for name, one in small["arm"].items() if name != "payload"}}
    mass, same, less = (
        one.nominal.system.at(one.nominal.start).mass_matrix for one in (sweep, Sweep(**small), Sweep(**without))
    )
    np.testing.assert_array_equal(mass, same)
    assert np.abs(mass - less).max() > 1e-3


def test_a_run_that_breaks_all_that_go_with_it_is_a_row_and_the_others_are_done(small, monkeypatch):
    from phcontrol.sweeps import chunk

    sweep = Sweep(**small)
    numbers, done = sweep.space.rows(0, 4), chunk.simulate_many
    expected = rows_of(sweep, 0, numbers, False)
    broken = sweep.loop(2)["disturbance"].force

    def breaks(**arguments):
        if any(np.array_equal(one.force, broken) for one in arguments["disturbance"]):
            raise ValueError("cannot be")
        return done(**arguments)

    monkeypatch.setattr(chunk, "simulate_many", breaks)
    rows = rows_of(sweep, 0, numbers, False)
    assert rows[2] == ({}, "ValueError: cannot be", False)
    assert [rows[k] for k in (0, 1, 3)] == [expected[k] for k in (0, 1, 3)]


def test_what_the_law_sees_and_when_its_torque_acts(small):
    small["vary"] = {
        "position_noise": [1e-3], "position_bias.each": [0.02], "velocity_noise": [0.01], "velocity_resolution": [1e-3],
        "velocity_bias.shoulder_roll": [0.1], "joint_delay": [2e-3], "torque_delay": [4e-3], "sensor_noise": [0.1],
    }  # fmt: skip
    small["joint_sensor"] = {"position_bias": [0.5, 0.6], "velocity_bias": [0.3, 0.4], "position_resolution": 1e-4}
    small["sampling"] = {"method": "list", "seed": 9}
    sweep = Sweep(**small)
    seed, nominal = sweep.space.noise_seed(0), sweep.nominal
    own = simulate(
        nominal.system, nominal.law, duration=0.05, control_period=1e-3, q0=nominal.start, torque_delay=4e-3,
        joint_sensor=JointSensor(
            position_noise=1e-3, position_bias=0.02, position_resolution=1e-4, velocity_noise=0.01,
            velocity_bias=[0.3, 0.1], velocity_resolution=1e-3, delay=2e-3, seed=seed,
        ),
        sensors=[ForceSensor(noise=0.1, seed=seed)],
    )  # fmt: skip
    log = sweep.replay(0)
    np.testing.assert_array_equal(log.position, own.position)
    np.testing.assert_array_equal(log.torque, own.torque)
    small["run"] |= {"torque_delay": 2e-3}
    del small["vary"]["torque_delay"]
    assert Sweep(**small).loop(0)["torque_delay"] == 2e-3


def test_delays_and_faults_are_compiled_in_groups(small):
    """Runs of several delays, compiled and interpreted, chunk by chunk as a sweep does them."""
    if find_compiler() is None:
        pytest.skip("no C compiler")
    small["vary"] |= {
        "position_noise": {"uniform": [0.0, 1e-3]}, "position_bias.each": {"uniform": [-0.01, 0.01]},
        "velocity_noise": {"uniform": [0.0, 0.02]}, "torque_delay": [0.0, 1e-3, 3e-3], "control_period": [1e-3, 2e-3],
    }  # fmt: skip
    sweep = Sweep(**small)
    numbers = sweep.space.rows(0, 12)
    fast, slow = (rows_of(sweep, 0, numbers, compiled) for compiled in (True, False))
    assert {row.compiled for row in fast} == {True}
    assert len({round(row.measures["final_error"], 12) for row in fast}) == 12
    for one, other in zip(fast, slow, strict=True):
        assert one.error == other.error == ""
        for name, value in other.measures.items():
            assert one.measures[name] == pytest.approx(value, abs=1e-9)


def test_contact_and_push(small):
    small["law"] = {"name": "energy_shaping", "goal": [0.3, 0.5]}
    small["vary"] = {"contact_stiffness": [50.0, 500.0], "push_x": [0.0, 1.0]}
    small["contact"] = {"joint": "shoulder_pitch", "position": 0.1, "side": "above"}
    small["sampling"] = {"method": "grid"}
    small["measures"] = ["contact_peak"]
    try:
        sweep = Sweep(**small)
    except UnknownNameError as error:
        small["contact"]["joint"] = error.known[-1]
        sweep = Sweep(**small)
    small["run"] |= {"duration": 0.3}
    sweep = Sweep(**small)
    peaks = [float(sweep.measured(sweep.replay(k), k)["contact_peak"]) for k in range(4)]
    assert min(peaks) > 0.1
    assert len({round(peak, 9) for peak in peaks}) == 4


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"vary": {"payload_maas": [1.0]}}, UnknownNameError, "Did you mean 'payload_mass'"),
        ({"vary": {"payload_mass": {"distribution": "norm", "loc": 1.0}}}, InvalidArgumentError,
         r"payload_mass: must be >= 0 kg .* goes down to -inf: cut it off with minimum = 0"),
        ({"vary": {"payload_mass": [0.1, -0.2]}}, InvalidArgumentError, "goes down to -0.2"),
        ({"vary": {"mass_factor": [0.0]}}, InvalidArgumentError, "must be > 0"),
        ({"vary": {"payload_mass": {"distribution": "normal"}}}, UnknownNameError, "Did you mean"),
        ({"vary": {"payload_mass": {"distribution": "gamma"}}}, InvalidArgumentError, "must be given: gamma needs a"),
        ({"vary": {"payload_mass": {"distribution": "gamma", "a": -1.0}}}, InvalidArgumentError, "no distribution"),
        ({"vary": {"payload_mass": {"distribution": "norm", "mean": 1.0}}}, UnknownNameError, "loc, maximum, minimum"),
        ({"vary": {"payload_mass": {"uniform": [1.0, 0.0]}}}, InvalidArgumentError, "the smaller first"),
        ({"vary": {"gain.stifness": [1.0]}}, UnknownNameError, "unknown gain 'stifness'"),
        ({"vary": {"gain.stiffness": [-1.0]}}, InvalidArgumentError, "must be > 0"),
        ({"vary": {"initial_offset.elbow": [0.0]}}, UnknownNameError, "unknown joint 'elbow'"),
        ({"vary": {"initial_offset": [0.0]}}, InvalidArgumentError, "is of a joint"),
        ({"vary": {"control_period": {"uniform": [1e-3, 2e-3]}}}, InvalidArgumentError, "list of values or a grid"),
        ({"vary": {"contact_stiffness": [1.0]}}, InvalidArgumentError, "needs something to touch"),
        ({"vary": {"payload_x": [0.1]}}, InvalidArgumentError, "vary payload_mass, too"),
        ({"vary": {}}, InvalidArgumentError, "nothing that is varied"),
        ({"law": {"name": "energy_shaping"}}, InvalidArgumentError, "is shown no force"),
        ({"law": {"nam": "energy_shaping"}}, UnknownNameError, "of \\[law\\]"),
        ({"arm": {"robot": "panda_"}}, UnknownNameError, "panda"),
        ({"arm": {"robot": "no/such.urdf"}}, RobotDescriptionError, "no/such.urdf"),
        ({"run": {}}, InvalidArgumentError, "run.duration: must be given"),
        ({"run": {"duration": 1.0, "length": 2.0}}, UnknownNameError, "of \\[run\\]"),
        ({"measures": ["final_eror"]}, UnknownNameError, "Did you mean 'final_error'"),
        ({"measures": ["tests.sweeps.tasks:reech"]}, UnknownNameError, "Did you mean 'reach'"),
        ({"measures": ["no_such_module:reach"]}, InvalidArgumentError, "cannot be imported"),
        ({"measures": [lambda log: 0.0]}, InvalidArgumentError, "cannot be sent to other processes"),
        ({"sampling": {"method": "latin_hypercube"}}, InvalidArgumentError, "runs: must be given"),
        ({"sampling": {"method": "hypercube", "runs": 3}}, UnknownNameError, "latin_hypercube"),
        ({"sampling": {"method": "grid"}}, InvalidArgumentError, "must have values or a grid"),
        ({"sampling": {"number": 3}}, UnknownNameError, "of \\[sampling\\]"),
        ({"require": {"overshoot": 0.1}}, UnknownNameError, "it must be measured, too"),
        ({"run": {"duration": 1.0}, "vary": {"torque_delay": [1e-3]}}, InvalidArgumentError,
         "torque_delay: is of a sampled law: give run.control_period"),
        ({"run": {"duration": 1.0}, "vary": {"position_bias.each": [1e-3]}}, InvalidArgumentError,
         "position_bias: is of a sampled law"),
        ({"run": {"duration": 1.0}, "joint_sensor": {"delay": 1e-3}}, InvalidArgumentError,
         "joint_sensor: is of a sampled law"),
        ({"run": {"duration": 1.0, "torque_delay": 1e-3}}, InvalidArgumentError, "run.torque_delay: is of a sampled"),
        ({"run": {"duration": 1.0, "control_period": 1e-3, "torque_delay": 1.5e-3}}, InvalidArgumentError,
         "run.torque_delay: must be a whole multiple of dt"),
        ({"vary": {"torque_delay": {"uniform": [0.0, 1e-2]}}}, InvalidArgumentError, "list of values or a grid"),
        ({"vary": {"torque_delay": [0.0, 1.5e-3]}}, InvalidArgumentError, "torque_delay: must be a whole multiple"),
        ({"vary": {"torque_delay": [-1e-3]}}, InvalidArgumentError, "torque_delay: must be >= 0 s"),
        ({"vary": {"control_period": [1.5e-3]}}, InvalidArgumentError, "control_period: must be a whole multiple"),
        ({"vary": {"position_noise": {"distribution": "norm"}}}, InvalidArgumentError, "position_noise: must be >= 0"),
        ({"vary": {"position_bias": [0.1]}}, InvalidArgumentError, "is of a joint: position_bias.shoulder_pitch"),
        ({"vary": {"velocity_bias.elbow": [0.1]}}, UnknownNameError, "unknown joint 'elbow'"),
        ({"joint_sensor": {"noise": 0.1}}, UnknownNameError, "of \\[joint_sensor\\]"),
        ({"joint_sensor": {"velocity_bias": [0.1, 0.2, 0.3]}}, InvalidArgumentError, "velocity_bias: must have shape"),
        ({"weather": {"rain": 1.0}}, UnknownNameError, "unknown part 'weather'"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(change, error, words, small):
    with pytest.raises(error, match=words):
        Sweep(**(small | change)).hash  # noqa: B018


def test_the_hash_is_of_all_that_numbers_depend_on(small):
    def changed(**parts):
        return Sweep(**{name: (small[name] | parts.get(name, {})) if isinstance(small[name], dict) else
                        parts.get(name, small[name]) for name in small}).hash  # fmt: skip

    first = Sweep(**small).hash
    assert Sweep(**small).hash == first
    assert Sweep(**small, require={"final_error": 0.1}).hash == first  # is asked of the results
    others = [
        changed(sampling={"seed": 4}), changed(sampling={"chunk": 3}), changed(run={"dt": 5e-4}),
        changed(law={"goal": [0.3, 0.6]}), changed(measures=["final_error"]),
        changed(measures=["tests.sweeps.tasks:reach"]), changed(vary={"payload_mass": {"uniform": [0.0, 0.6]}}),
    ]  # fmt: skip
    assert len({first, *others}) == 8
