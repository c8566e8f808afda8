"""The log of a loop: rows that outlive the process, and what other programs read of them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from phcontrol import (
    ControlBox,
    ControlLoop,
    DataFileError,
    InvalidArgumentError,
    Limits,
    LoopLog,
    LoopMode,
    PHControlError,
    SimulatedArm,
    TorqueFilter,
    drive,
    make_controller,
    read_loop_log,
    simulate,
)
from phcontrol.runtime import loop_log
from phcontrol.simulation.signals import Signal, Signals
from tests.conftest import make_system

PERIOD = 1e-3


def make_loop(name="pera", law="force_feedback", filtered=True):
    system = make_system(name)
    box = ControlBox(system, period=PERIOD)
    limits = Limits(system)
    loop = ControlLoop(
        system,
        make_controller(law, system, system.robot.near_home()),
        PERIOD,
        torque_filter=TorqueFilter(system, period=PERIOD, limits=limits) if filtered else None,
        start_time=0.02,
        clock=lambda: box.time,
    )
    return loop, SimulatedArm(box)


def run(path, steps=100, duration=1.0, **arguments):
    loop, arm = make_loop(**arguments)
    kept = []
    with LoopLog(path, loop, duration=duration) as log:

        def note(t, reading, torque):
            kept.append((t, reading, torque, loop.desired_torque, loop.controller_state, loop.mode))
            log(t, reading, torque)

        drive(loop, arm, steps * PERIOD, each_step=note)
        assert len(log) == min(steps, round(duration / PERIOD))
    return kept, read_loop_log(path)


def test_every_step_is_kept_as_it_was(tmp_path):
    kept, record = run(tmp_path / "run.loop")
    assert len(record) == 100
    np.testing.assert_allclose(record.time, np.arange(100) * PERIOD, atol=1e-12)
    for k, (_, reading, torque, desired, state, mode) in enumerate(kept):
        np.testing.assert_array_equal(record.column("position")[k], reading.position)
        np.testing.assert_array_equal(record.column("velocity")[k], reading.velocity)
        np.testing.assert_array_equal(record.column("torque")[k], torque)
        np.testing.assert_array_equal(record.column("desired")[k], desired)
        np.testing.assert_array_equal(record.column("state")[k], state)
        np.testing.assert_array_equal(record.column("external_force")[k], reading.measured.external_force)
        assert record.modes[k] == mode
    assert {LoopMode.STARTING, LoopMode.RUNNING} <= set(record.modes)
    assert record.column("computing").min() >= 0.0
    assert record.about["law"] == "force_feedback"
    assert record.about["joints"] == list(make_system("pera").robot.joint_names)


def test_when_the_file_is_full_the_newest_steps_are_kept(tmp_path):
    kept, record = run(tmp_path / "run.loop", steps=137, duration=0.05)
    assert len(record) == 50
    np.testing.assert_allclose(record.time, np.arange(87, 137) * PERIOD, atol=1e-12)
    np.testing.assert_array_equal(record.column("torque"), [row[2] for row in kept[87:]])


def test_a_log_is_read_while_it_is_written(tmp_path):
    loop, arm = make_loop()
    with LoopLog(tmp_path / "run.loop", loop) as log:
        drive(loop, arm, 0.01, each_step=log)
        assert len(read_loop_log(tmp_path / "run.loop")) == 10
        drive(loop, arm, 0.01, each_step=log)
        assert len(read_loop_log(tmp_path / "run.loop")) == 20


@pytest.mark.parametrize("wrapped", [False, True])
def test_nothing_is_lost_when_the_process_is_killed(tmp_path, wrapped):
    """kill −9 in the middle of a run, at once after a step: that step is there, and all before it."""
    program = tmp_path / "program.py"
    program.write_text(
        "import os, signal, sys\n"
        "from phcontrol import LoopLog, drive\n"
        "from tests.runtime.test_loop_log import make_loop\n"
        "loop, arm = make_loop()\n"
        f"log = LoopLog(sys.argv[1], loop, duration={0.05 if wrapped else 10.0})\n"
        "steps = []\n"
        "def note(t, reading, torque):\n"
        "    log(t, reading, torque)\n"
        "    steps.append(t)\n"
        "    if len(steps) == 80:\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n"
        "drive(loop, arm, 1.0, each_step=note)\n"
    )
    path = tmp_path / "run.loop"
    root = str(Path(__file__).parents[2])
    ended = subprocess.run([sys.executable, program, path], env=os.environ | {"PYTHONPATH": root}, check=False)
    assert ended.returncode == -signal.SIGKILL
    record = read_loop_log(path)
    first = 30 if wrapped else 0
    np.testing.assert_allclose(record.time, np.arange(first, 80) * PERIOD, atol=1e-12)
    assert np.isfinite(record.column("torque")).all()


def test_a_row_that_was_cut_off_is_left_out(tmp_path):
    path = tmp_path / "run.loop"
    run(path, steps=20, duration=0.05)
    content = bytearray(path.read_bytes())
    width = 8 * int.from_bytes(content[16:24], "little")
    start = len(content) - 50 * width
    content[start + 5 * width : start + 5 * width + 8] = bytes(8)  # as it is while the row is written
    path.write_bytes(content)
    np.testing.assert_allclose(read_loop_log(path).time, np.delete(np.arange(20), 5) * PERIOD, atol=1e-12)


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"",
        lambda content: content[:-8],
        lambda content: b"PK" + content[2:],
        lambda content: content.replace(b'"places"', b'"plates"'),
        lambda content: content.replace(b'"time": [1, 2]', b'"time": [1, 9999]'[:14].ljust(14)),
        lambda content: content[:16] + (2**60).to_bytes(8, "little") + content[24:],
        lambda content: content[:24] + (2**60).to_bytes(8, "little") + content[32:],
    ],
)
def test_a_file_that_is_no_log_is_refused(tmp_path, damage):
    path = tmp_path / "run.loop"
    run(path, steps=5, duration=0.05)
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(DataFileError, match=r"run.loop"):
        read_loop_log(path)


def test_what_cannot_be_written_or_is_not_there_is_said(tmp_path, monkeypatch):
    loop, _ = make_loop()
    with pytest.raises(PHControlError, match="too large"):
        LoopLog(tmp_path / "run.loop", loop, duration=1e8)

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(PHControlError, match="no place for a log of .* MB: No space left"):
        LoopLog(tmp_path / "run.loop", loop)
    assert list(tmp_path.iterdir()) == []
    monkeypatch.undo()
    _, record = run(tmp_path / "run.loop", steps=3)
    with pytest.raises(PHControlError, match="has no 'force'; it has time"):
        record.column("force")
    with pytest.raises(DataFileError):
        read_loop_log(tmp_path / "none.loop")


def test_two_logs_on_one_path_are_refused(tmp_path):
    """The first went on into a file without a name, and all of it was lost without a word."""
    path = tmp_path / "run.loop"
    loop, arm = make_loop()
    with LoopLog(path, loop) as log:
        with pytest.raises(PHControlError, match="another LoopLog is writing this file"):
            LoopLog(path, loop)
        drive(loop, arm, 0.01, each_step=log)
    assert len(read_loop_log(path)) == 10
    LoopLog(path, loop).close()  # once it is closed the file is replaced
    assert len(read_loop_log(path)) == 0
    assert [item.name for item in tmp_path.iterdir()] == ["run.loop"]


def test_a_log_of_another_process_is_not_replaced_and_of_a_killed_one_is(tmp_path):
    path = tmp_path / "run.loop"
    program = (
        "import sys, time\n"
        "from phcontrol import LoopLog\n"
        "from tests.runtime.test_loop_log import make_loop\n"
        "log = LoopLog(sys.argv[1], make_loop()[0])\n"
        "print('ready', flush=True)\n"
        "time.sleep(60.0)\n"
    )
    root = str(Path(__file__).parents[2])
    loop, _ = make_loop()
    with subprocess.Popen(
        [sys.executable, "-c", program, path], env=os.environ | {"PYTHONPATH": root}, stdout=subprocess.PIPE, text=True
    ) as writer:
        assert writer.stdout.readline() == "ready\n"
        with pytest.raises(PHControlError, match="another LoopLog is writing this file"):
            LoopLog(path, loop)
        writer.kill()
        writer.wait()
        LoopLog(path, loop).close()


def test_a_closed_log_says_so(tmp_path):
    loop, arm = make_loop()
    with LoopLog(tmp_path / "run.loop", loop) as log:
        drive(loop, arm, 0.01, each_step=log)
    with pytest.raises(PHControlError, match="this log is closed"):
        drive(loop, arm, 0.01, each_step=log)
    log.close()
    with pytest.raises(PHControlError, match="loop: must be a ControlLoop, but is NoneType"):
        LoopLog(tmp_path / "run.loop", None)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b'"position": [6, 13]', b'"position": [13, 20]'),  # velocities for positions
        (b'"gravity": "controller"', b'"gravity": "robot"'),
        (b'"period": 0.001', b'"period": 0.002'),
    ],
)
def test_a_log_whose_head_was_edited_is_refused(tmp_path, old, new):
    path = tmp_path / "run.loop"
    run(path, steps=5, duration=0.05)
    content = bytearray(path.read_bytes())
    length, first = int.from_bytes(content[8:16], "little"), loop_log._HEAD.size
    text = bytes(content[first : first + length])
    assert old in text
    edited = text.replace(old, new)
    content[first : first + len(edited)] = edited
    content[8:16] = len(edited).to_bytes(8, "little")
    path.write_bytes(content)
    with pytest.raises(DataFileError, match="its head was changed after it was written"):
        read_loop_log(path)


def edited_log(path, change):
    """Write a log again whose text is changed, with a head that fits."""
    content = bytearray(path.read_bytes())
    length, first = int.from_bytes(content[8:16], "little"), loop_log._HEAD.size
    about = json.loads(content[first : first + length])
    change(about)
    text = json.dumps(about).encode()
    width, rows = (int.from_bytes(content[k : k + 8], "little") for k in (16, 24))
    content[: first + len(text)] = loop_log._head(text, width, rows) + text
    path.write_bytes(content)


@pytest.mark.parametrize(
    "change",
    [
        lambda about: about["places"].update(position=about["places"]["velocity"]),
        lambda about: about["joints"].pop(),
        lambda about: about.update(joints=[1, 2, 3, 4, 5, 6, 7]),
        lambda about: about.update(robot=None),
        lambda about: about["places"].pop("age"),
        lambda about: about["places"].update(age=[2, 2]),
        lambda about: about.update(places=None),
    ],
)
def test_a_head_that_contradicts_itself_is_refused(tmp_path, change):
    path = tmp_path / "run.loop"
    run(path, steps=5, duration=0.05)
    edited_log(path, change)
    with pytest.raises(DataFileError, match="not the log of a control loop"):
        read_loop_log(path)


@pytest.mark.parametrize(("column", "value"), [(1, np.nan), (4, 7.0), (4, np.nan)])
def test_a_row_that_no_loop_writes_is_refused(tmp_path, column, value):
    """``modes`` raised ValueError, and an export wrote its times as they came."""
    path = tmp_path / "run.loop"
    run(path, steps=5, duration=0.05)
    content = bytearray(path.read_bytes())
    width = 8 * int.from_bytes(content[16:24], "little")
    place = len(content) - 50 * width + 8 * column
    content[place : place + 8] = np.array([value]).tobytes()
    path.write_bytes(content)
    with pytest.raises(DataFileError, match="a row has no time, or a mode that no loop has"):
        read_loop_log(path)


# --- other programs -------------------------------------------------------------------------------------------


@pytest.fixture
def records(tmp_path):
    """A loop's log and a simulation's, both with their signals."""
    _, record = run(tmp_path / "run.loop", steps=30)
    system = make_system("pera")
    law = make_controller("force_feedback", system, system.robot.near_home())
    return record, simulate(system, law, duration=0.02, dt=1e-3)


def test_xarray_has_every_quantity_with_joints_and_units(records):
    pytest.importorskip("xarray", reason="needs xarray: pip install 'phcontrol[xarray]'")
    record, log = records
    data = record.to_xarray()
    joint = record.about["joints"][3]
    np.testing.assert_array_equal(data.torque.sel(joint=joint), record.column("torque")[:, 3])
    assert data.torque.attrs["units"] == "N·m"
    assert data.sizes["time"] == 30
    data = log.to_xarray()
    np.testing.assert_array_equal(data.position.sel(joint=joint), log.position[:, 3])
    np.testing.assert_array_equal(data.storage, log.storage)
    assert data.storage.attrs["units"] == "J"
    assert data.attrs["controller"] == "force_feedback"


def test_mcap_is_read_by_its_own_reader(records, tmp_path):
    pytest.importorskip("mcap", reason="needs mcap: pip install 'phcontrol[mcap]'")
    from mcap.reader import make_reader

    record, log = records
    for source, torques, joints in (
        (record, record.column("torque"), record.about["joints"]),
        (log, log.torque, log.metadata["joint_names"]),
    ):
        path = source.to_mcap(tmp_path / "run.mcap")
        found = []
        with path.open("rb") as file:
            reader = make_reader(file)
            for schema, channel, message in reader.iter_messages(topics=["/torque"]):
                assert channel.message_encoding == "json"
                assert channel.metadata == {"unit": "N·m"}
                assert json.loads(schema.data)["properties"].keys() == set(joints)
                content = json.loads(message.data)
                found.append((message.log_time, [content[joint] for joint in joints]))
        assert [stamp for stamp, _ in found] == [round(1e9 * t) for t in source.signals.time]
        np.testing.assert_array_equal([row for _, row in found], torques)


def test_rerun_makes_a_recording(records, tmp_path):
    pytest.importorskip("rerun", reason="needs rerun: pip install 'phcontrol[rerun]'")
    for source in records:
        path = source.to_rerun(tmp_path / "run.rrd")
        content = path.read_bytes()
        assert content[:4] == b"RRF2"
        assert b"/torque/" in content


class BrokenStream:
    """A recording that fails in the middle, as on a full disk."""

    def __init__(self, name):
        self.file = None

    def save(self, path):
        self.file = open(path, "wb")  # noqa: SIM115
        self.file.write(b"RRF2 half")

    def log(self, *_, **__):
        self.file.close()
        raise OSError(28, "No space left on device")


def test_a_rerun_recording_is_whole_or_the_old_one(records, tmp_path, monkeypatch):
    """The file of before was there in part only."""
    monkeypatch.setitem(
        sys.modules,
        "rerun",
        SimpleNamespace(RecordingStream=BrokenStream, TimeColumn=lambda *_, **__: None, SeriesLines=lambda **_: None),
    )
    path = tmp_path / "exports" / "run.rrd"
    path.parent.mkdir()
    path.write_bytes(b"of before")
    for source in records:
        with pytest.raises(DataFileError, match="No space left"):
            source.to_rerun(path)
    assert path.read_bytes() == b"of before"
    assert [item.name for item in path.parent.iterdir()] == ["run.rrd"]


@pytest.mark.parametrize("time", [np.nan, np.inf, -1.0, 1e300])
@pytest.mark.parametrize("way", ["to_mcap", "to_rerun"])
def test_times_that_no_file_has_are_refused(time, way, tmp_path, monkeypatch):
    """struct.error left ``to_mcap``."""
    if way == "to_mcap":
        pytest.importorskip("mcap")
    else:
        monkeypatch.setitem(sys.modules, "rerun", SimpleNamespace())
    signals = Signals(np.array([0.0, time]), {"a": Signal(np.zeros(2), "m")}, {"robot": "arm"})
    with pytest.raises(InvalidArgumentError, match="time: must be"):
        getattr(signals, way)(tmp_path / "file")
    signals = Signals(np.array([0.0, 1.0]), {"a": Signal(np.zeros(3), "m")}, {"robot": "arm"})
    with pytest.raises(InvalidArgumentError, match="a: has 3 samples, but there are 2 times"):
        getattr(signals, way)(tmp_path / "file")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("way", ["to_xarray", "to_mcap", "to_rerun"])
def test_without_the_other_program_it_is_said_how_to_install_it(records, way, tmp_path, monkeypatch):
    module = way.removeprefix("to_")
    monkeypatch.setitem(sys.modules, module, None)
    arguments = [] if way == "to_xarray" else [tmp_path / "file"]
    for source in records:
        with pytest.raises(PHControlError, match=rf"pip install 'phcontrol\[{module}\]'"):
            getattr(source, way)(*arguments)
