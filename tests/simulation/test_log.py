"""Logs: energies that balance, files that survive, and files that are refused."""

from __future__ import annotations

import json
import os
import zipfile

import numpy as np
import pytest

from phcontrol import (
    DataFileError,
    Log,
    MechanicalSystem,
    PHControlError,
    StribeckFriction,
    load_robot,
    make_controller,
)
from phcontrol import simulate as run
from phcontrol.simulation.power_balance import PowerBalance
from tests.log_files import contents, sealed, text


@pytest.fixture(scope="module")
def log():
    system = MechanicalSystem(load_robot("pera_shoulder_elbow"), friction=StribeckFriction(viscous=0.5))
    goal = [0.4, -0.3, 0.5]
    M = system.at(goal).mass_matrix  # gentle gains: the differences of samples 1 ms apart must see all that moves
    controller = make_controller("force_feedback_measured", system, goal, stiffness=16.0 * M, damping=8.0 * M)

    def force(t, x):
        return np.array([np.sin(3.0 * t), 1.0, -np.cos(t)])

    return run(system, controller, duration=1.0, dt=1e-3, disturbance=force, torque_limit=None)


@pytest.mark.parametrize("of", ["storage", "plant"])
def test_power_balances(log, of):
    """Ḣ by differences of the samples equals its parts: fourth order, so 1e-12·H⁽⁵⁾ at 1 ms."""
    balance = log.power_balance(of)
    assert np.abs(balance.supplied).max() > 0.1
    assert np.abs(balance.dissipated).max() > 0.1
    assert balance.relative_residual < 1e-7


def test_the_drift_of_the_energy_is_the_largest_integral_of_the_residual():
    """Of 2 W for 0.3 s, then −2 W: 0.6 J; at uneven times."""
    time = np.array([0.0, 0.1, 0.3, 0.3 + 1e-9, 0.4, 0.5])
    rate = np.array([2.0, 2.0, 2.0, -2.0, -2.0, -2.0])
    balance = PowerBalance(time, rate, np.zeros(6), np.zeros(6), np.zeros(6))
    assert balance.energy_drift == pytest.approx(0.6, abs=1e-8)


def test_a_run_without_external_wrenches_has_none(log):
    assert log.wrench_forces.shape == (len(log), 0, 3)


def test_the_balance_shows_a_forged_torque(log):
    forged = Log({name: getattr(log, name).copy() for name in recorded}, log.metadata, log._loop)
    forged.torque[400:600] += 0.5
    assert forged.power_balance("plant").largest_residual > 1e-2


recorded = ("time", "position", "velocity", "torque", "external_force", "controller_state", "body_state")


def changed(log, path, **arrays):
    """Return the log of a file with other numbers in it, whose hash was made to fit."""
    np.savez(path, **sealed(contents(log.save(path)) | arrays))
    return Log.load(path)


@pytest.mark.parametrize("name", ["position", "velocity", "torque"])
def test_the_balance_of_a_file_is_that_of_its_samples(log, tmp_path, name):
    """The energies in the file fit one another still; those of the samples do not."""
    array = getattr(log, name).copy()
    array[400:600] += 0.01 * np.sin(np.linspace(0.0, np.pi, 200))[:, None] ** 2
    forged = changed(log, tmp_path / "log.npz", **{name: array})
    assert forged.power_balance("plant").largest_residual > 1e3 * log.power_balance("plant").largest_residual
    np.testing.assert_array_equal(forged.kinetic_energy, log.kinetic_energy)


def friction(n):
    return StribeckFriction(viscous=0.2, coulomb=0.1, static=np.full(n, 0.15), smoothing=1e-2)


@pytest.mark.parametrize(
    ("robot", "options"),
    [
        ("pera", {"input_matrix": np.diag(np.arange(1.0, 8.0))}),
        ("pera_gripper", {}),  # with its springs
        ("pera_with_gripper", {"friction": friction(8), "gravity": (1.0, 2.0, -3.0)}),
        ("ur5", {"friction": None}),
        ("panda", {}),  # a finger that mimics, rotors given below
        ("kinova", {}),  # continuous joints
    ],
)
def test_a_file_describes_its_arm(robot, options, tmp_path):
    """The balance computed with the arm in the file is that of the run's own arm, to rounding of the energies."""
    system = MechanicalSystem(load_robot(robot, armature=0.05), **options)
    law = make_controller("energy_shaping", system, goal=system.robot.near_home())
    live = run(system, law, duration=0.02, v0=np.linspace(0.1, 0.2, system.n), disturbance=np.ones(system.n))
    loaded = Log.load(live.save(tmp_path / "log.npz"))
    for of in ("plant", "all"):
        ours, theirs = live.power_balance(of), loaded.power_balance(of)
        scale = np.abs(ours.supplied).max() + np.abs(live.potential_energy).max() * 1e3
        for part in ("rate", "supplied", "dissipated"):
            np.testing.assert_allclose(getattr(theirs, part), getattr(ours, part), atol=1e-12 * scale)
    assert np.abs(live.power_balance("plant").supplied).max() > 0.0


def test_an_arm_that_a_file_cannot_describe_is_said(tmp_path):
    class Own:
        def coefficients(self, velocity):
            return np.full(velocity.shape, 0.3)

    system = MechanicalSystem(load_robot("pera_shoulder"), friction=Own())
    live = run(system, make_controller("energy_shaping", system), duration=0.02)
    loaded = Log.load(live.save(tmp_path / "log.npz"))
    assert live.power_balance("plant").largest_residual < 1e-3
    with pytest.raises(PHControlError, match=r"cannot describe its arm \(Own\)"):
        loaded.power_balance("plant")


@pytest.mark.parametrize(
    "plant", [{}, {"unknown": 5}, {"unknown": [], "inertias": [[1.0]], "armature": []}, ...], ids=str
)
def test_an_arm_that_is_none_is_said(log, tmp_path, plant):
    path = log.save(tmp_path / "log.npz")
    np.savez(path, **sealed(contents(path), plant=plant))
    with pytest.raises(PHControlError, match="does not describe its arm"):
        Log.load(path).power_balance("plant")


def test_samples_that_energies_were_derived_from_stay(log):
    assert log.storage.size
    with pytest.raises(ValueError, match="read-only"):
        log.position[3] += 0.1


def test_energies_of_a_run_that_is_still_going_on_are_not_those_of_rows_to_come():
    system = MechanicalSystem(load_robot("pera_shoulder"))
    seen = []

    def watch(live):
        if len(live) == 3:
            with pytest.raises(PHControlError, match="still going on"):
                seen.append(live.storage)
            seen.append(live.derive(2)["storage"])

    log = run(system, make_controller("energy_shaping", system), duration=0.01, watch=watch)
    assert seen == [log.storage[2]]


def test_sampling_shows_in_the_balance_of_the_storage_not_of_the_plant(log):
    system, controller = log._loop.plant, log._loop.controller
    sampled = run(system, controller, duration=1.0, dt=1e-3, control_period=2e-2)
    continuous = run(system, controller, duration=1.0, dt=1e-3)
    assert sampled.power_balance().largest_residual > 100 * continuous.power_balance().largest_residual


def test_a_saved_log_is_the_same_log(log, tmp_path):
    path = log.save(tmp_path / "deep" / "log.npz")
    loaded = Log.load(path)
    for name in (*recorded, "storage", "kinetic_energy", "potential_energy", "supplied_power", "dissipated_power"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(log, name))
    assert loaded.metadata["robot"] == "pera_shoulder_elbow"
    assert loaded.power_balance().largest_residual == log.power_balance().largest_residual
    assert [item.name for item in path.parent.iterdir()] == ["log.npz"]  # nothing temporary is left


def test_saturation_survives_saving(tmp_path):
    system = MechanicalSystem(load_robot("pera_shoulder"))
    log = run(system, make_controller("energy_shaping", system, goal=[1.0, 0.5], stiffness=100.0), duration=0.1)
    assert log.saturated.any()
    np.testing.assert_array_equal(Log.load(log.save(tmp_path / "log.npz")).saturated, log.saturated)


def test_a_failed_save_leaves_the_old_file(log, tmp_path, monkeypatch):
    path = log.save(tmp_path / "log.npz")
    before = path.read_bytes()

    def full(file, **data):
        file.write(b"partial")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full)
    with pytest.raises(DataFileError, match=r"cannot write .*log\.npz: No space left on device"):
        log.save(path)
    assert path.read_bytes() == before
    assert [item.name for item in tmp_path.iterdir()] == ["log.npz"]


# --- files that are no logs, or not what they say ---------------------------------------------------


def refused(path, arrays, match):
    np.savez(path, **arrays)
    with pytest.raises(DataFileError, match=f"cannot read .*{match}") as caught:
        Log.load(path)
    assert "pickle" not in str(caught.value)  # NumPy's advice to allow them


@pytest.mark.parametrize(
    "content", [b"", b"not a zip file", b"PK\x05\x06" + bytes(18)], ids=["empty", "text", "empty zip"]
)
def test_files_that_are_no_archives_are_refused(tmp_path, content):
    path = tmp_path / "log.npz"
    path.write_bytes(content)
    with pytest.raises(DataFileError, match="cannot read"):
        Log.load(path)


@pytest.mark.parametrize(
    ("name", "array", "match"),
    [
        ("time", None, "incomplete"),
        ("metadata", None, "no metadata"),
        ("metadata", np.zeros(4, dtype=np.uint8), "no JSON"),
        ("metadata", np.frombuffer(b"[" * 100_000, dtype=np.uint8), "no JSON"),
        ("metadata", np.zeros(1 << 25, dtype=np.uint8), "has 33554432 bytes"),
        ("metadata", text(format="phcontrol-log-99"), "not of format"),
        ("metadata", text(format="phcontrol-log-1"), "no content hash"),
        ("sha256", None, "no content hash"),
        ("time", np.array([object()], dtype=object), "time holds object"),
        ("velocity", np.array([object()], dtype=object), "velocity holds object"),
        ("velocity", np.zeros((1001, 3), dtype=np.float32), "velocity holds float32"),
        ("velocity", np.zeros((1001, 3), dtype=complex), "velocity holds complex"),
        ("velocity", np.zeros((1001, 3), dtype=[("a", "f8")]), "velocity holds"),
        ("velocity", np.zeros((1001, 2)), r"velocity has shape \(1001, 2\), not \(1001, 3\)"),
        ("velocity", np.zeros((3, 1001)), "velocity has shape"),
        ("velocity", np.asfortranarray(np.zeros((1001, 3))), "no valid header"),
        ("controller_state", np.zeros(1001), "controller_state has shape"),
        ("contact_forces", np.zeros((1001, 2)), "'bodies' of its metadata has 0 entries, but contact_forces is of 2"),
        ("wrench_forces", np.zeros((1001, 1, 3)), "'wrench_frames' .* 0 entries, but wrench_forces is of 1"),
        ("other", np.zeros((1001, 3)), "'other' is nothing that a log holds"),
        ("../x", np.zeros((1001, 3)), "is nothing that a log holds"),
    ],
)
def test_members_that_are_not_those_of_a_log_are_refused(log, tmp_path, name, array, match):
    arrays = contents(log.save(tmp_path / "log.npz"))
    if array is None:
        del arrays[name]
    else:
        arrays[name] = array
    plain = name in ("metadata", "sha256") or arrays.get(name, np.zeros(0)).dtype == object
    refused(tmp_path / "forged.npz", arrays if plain else sealed(arrays), match)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda time: time[:0], "holds no sample"),
        (lambda time: np.where(time == 0.5, np.nan, time), "time is not finite at sample 500"),
        (lambda time: np.where(time == 0.5, np.inf, time), "time is not finite at sample 500"),
        (lambda time: time[::-1], "runs back from 1 s to 0.999 s at sample 1"),
        (lambda time: np.zeros_like(time), "runs back from 0 s to 0 s at sample 1"),
    ],
    ids=["none", "nan", "inf", "backwards", "still"],
)
def test_times_that_are_none_are_refused(log, tmp_path, change, match):
    arrays = contents(log.save(tmp_path / "log.npz"))
    time = np.ascontiguousarray(change(arrays["time"]))
    arrays = {name: array if array.dtype == np.uint8 else array[: len(time)] for name, array in arrays.items()}
    refused(tmp_path / "forged.npz", sealed(arrays | {"time": time}), match)


@pytest.mark.parametrize("name", ["position", "velocity", "goal"])
def test_states_that_are_not_finite_are_refused(log, tmp_path, name):
    arrays = contents(log.save(tmp_path / "log.npz"))
    arrays[name][7, 1] = np.nan
    refused(tmp_path / "forged.npz", sealed(arrays), f"{name} is not finite at sample 7")


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("robot", 5), ("robot", ...), ("controller", ["x"]), ("controller", ...), ("interconnection", 1),
        ("integrator", {}), ("joint_names", "abc"), ("joint_names", []), ("joint_names", ["a", "a", "b"]),
        ("joint_names", [1, 2, 3]), ("joint_names", ...), ("robot_record", "panda"), ("robot_record", None),
        ("plant", []), ("bodies", {}), ("bodies", ["x"]), ("sight", 3), ("wrench_frames", [0]),
        ("wrench_frames", "abc"),
        ("seeds", []), ("seeds", {"force": "x"}), ("dt", "x"), ("dt", -1.0), ("dt", True), ("dt", float("nan")),
        ("dt", float("inf")), ("control_period", 0), ("torque_limit", "x"), ("torque_limit", [1.0]),
        ("torque_limit", [1.0, None, 1.0]), ("torque_limit", [1.0, -1.0, 1.0]), ("versions", ["1"]),
        ("versions", {"numpy": 2}),
    ],
)  # fmt: skip
def test_metadata_of_wrong_types_are_refused(log, tmp_path, key, value):
    arrays = contents(log.save(tmp_path / "log.npz"))
    refused(tmp_path / "forged.npz", sealed(arrays, **{key: value}), f"metadata .*'{key}'|'{key}' of its metadata")


@pytest.mark.parametrize("key", ["versions", "seeds", "dt", "integrator", "torque_limit", "control_period"])
def test_metadata_that_older_files_lack_may_be_missing(log, tmp_path, key):
    path = tmp_path / "older.npz"
    np.savez(path, **sealed(contents(log.save(tmp_path / "log.npz")), **{key: ...}))
    found = Log.load(path)
    np.testing.assert_array_equal(found.position, log.position)
    assert key not in found.metadata


def test_numbers_that_were_changed_show(log, tmp_path):
    """Every member, and the metadata: one bit of one number is enough."""
    arrays = contents(log.save(tmp_path / "log.npz"))
    assert len(Log.load(tmp_path / "log.npz")) == 1001
    changed = 0
    for name, array in arrays.items():
        if array.size and array.dtype == np.float64:
            forged = array.copy()
            forged.flat[forged.size // 2] = np.nextafter(forged.flat[forged.size // 2], np.inf)
            if name == "time":
                forged[-1] += 1.0
            refused(tmp_path / "forged.npz", arrays | {name: forged}, "its content is not what its hash says")
            changed += 1
    assert changed > 18
    other = json.loads(arrays["metadata"].tobytes()) | {"robot": "pera"}
    refused(tmp_path / "forged.npz", arrays | {"metadata": text(**other)}, "its content is not what its hash says")


def bomb(path, method=zipfile.ZIP_DEFLATED, size=3 << 30):
    """Write an archive whose one member unpacks to more than anyone's memory, without having it in ours."""
    with zipfile.ZipFile(path, "w", method) as archive, archive.open("time.npy", "w", force_zip64=True) as member:
        np.lib.format.write_array_header_1_0(member, {"descr": "<f8", "fortran_order": False, "shape": (size // 8,)})
        for _ in range(size >> 20):
            member.write(bytes(1 << 20))


def test_what_unpacks_to_too_much_is_not_unpacked(tmp_path, monkeypatch):
    bomb(tmp_path / "bomb.npz", size=64 << 20)
    unpacked = []
    read = zipfile.ZipExtFile.read
    monkeypatch.setattr(zipfile.ZipExtFile, "read", lambda self, n=-1: unpacked.append(n) or read(self, n))
    with pytest.raises(DataFileError, match="it unpacks to 67 MB, more than 34 MB: .*largest="):
        Log.load(tmp_path / "bomb.npz", largest=1 << 25)
    assert unpacked == []


def test_a_header_that_lies_about_the_size_is_refused(log, tmp_path):
    """The member's declared size is small, its stream is long: it is not read to its end."""
    path = log.save(tmp_path / "log.npz")
    with zipfile.ZipFile(path) as archive:
        declared = archive.getinfo("time.npy").file_size
    content = path.read_bytes()
    small = (136).to_bytes(4, "little")  # eight bytes of header more than nothing
    refused_content = content.replace(declared.to_bytes(4, "little"), small)
    assert refused_content != content
    path.write_bytes(refused_content)
    with pytest.raises(DataFileError, match="cannot read"):
        Log.load(path)


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_methods_that_unpack_without_a_bound_are_refused(log, tmp_path, method):
    """700 bytes of bzip2 unpack to a gigabyte in one piece, whatever size is asked for."""
    path, packed = log.save(tmp_path / "log.npz"), tmp_path / "packed.npz"
    with zipfile.ZipFile(path) as archive, zipfile.ZipFile(packed, "w", method) as other:
        for name in archive.namelist():
            other.writestr(name, archive.read(name))
    with pytest.raises(DataFileError, match="another method than deflate"):
        Log.load(packed)


def test_members_of_one_name_are_refused(log, tmp_path):
    path = log.save(tmp_path / "log.npz")
    with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate name"):
        archive.writestr("time.npy", archive.read("time.npy"))
    with pytest.raises(DataFileError, match="same names"):
        Log.load(path)


def test_pipes_and_devices_are_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", "/dev/zero", tmp_path):
        with pytest.raises(DataFileError, match="not a regular file"):
            Log.load(path)


def test_a_truncated_file_is_refused(log, tmp_path):
    path = log.save(tmp_path / "log.npz")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(DataFileError, match="cannot read"):
        Log.load(path)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(DataFileError, match="cannot read"):
        Log.load(tmp_path / "nowhere.npz")


def test_to_dataframe(log):
    frame = log.to_dataframe()
    np.testing.assert_array_equal(frame["position/elbow_pitch"], log.position[:, 2])
    np.testing.assert_array_equal(frame.index, log.time)


def test_too_short_a_log_has_no_power_balance():
    system = MechanicalSystem(load_robot("pera_shoulder"))
    short = run(system, make_controller("energy_shaping", system), duration=2e-3)
    with pytest.raises(PHControlError, match="at least five samples"):
        short.power_balance()


def test_each_quantity_costs_what_it_needs_and_once(monkeypatch):
    """H_d over a run evaluates no promise; whatever was asked for before, the numbers are the same."""
    system = MechanicalSystem(load_robot("pera_shoulder"))
    law = make_controller("force_feedback", system)
    log, other = (run(system, law, duration=0.02, disturbance=[0.5, 1.0]) for _ in range(2))
    counts = {"target": 0, "storage": 0}

    def counted(name, real):
        def method(*arguments):
            counts[name] += 1
            return real(*arguments)

        return method

    for name in counts:
        monkeypatch.setattr(law, name, counted(name, getattr(law, name)))
    storage = log.storage
    assert counts == {"target": 0, "storage": len(log)}
    assert log.storage is storage
    assert log.dissipated_power.shape == log.supplied_power.shape == (len(log),)
    log.row(3)
    assert counts == {"target": len(log), "storage": len(log)}
    for k, name in ((5, "storage"), (5, "supplied_power"), (5, "kinetic_energy"), (5, "force_output")):
        np.testing.assert_array_equal(other.row(k)[name], log.row(k)[name])
        np.testing.assert_array_equal(other.derive(k)[name], log.row(k)[name])


def test_what_is_written_at_once_holds_the_run_and_says_what_it_lacks(tmp_path):
    system = MechanicalSystem(load_robot("pera_shoulder"))
    log = run(system, make_controller("energy_shaping", system), duration=0.1)
    read = Log.load(log.save(tmp_path / "part.npz", at_once=True))
    np.testing.assert_array_equal(read.position, log.position)
    np.testing.assert_array_equal(read.controller_state, log.controller_state)
    assert read.metadata["derived"] is False
    assert np.isnan(read.storage).all()
    assert "derived" not in Log.load(log.save(tmp_path / "whole.npz")).metadata
