"""What is looked at before a run, and what a program asks its computer for: each says whether it took effect."""

from __future__ import annotations

import gc
import json
import os
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from phcontrol import InvalidArgumentError, RealTime, preflight
from phcontrol.cli.application import app
from phcontrol.runtime import preflight as module
from phcontrol.runtime import real_time

SYSTEM = {  # a computer that was set up for it
    "sys/devices/system/clocksource/clocksource0/current_clocksource": "tsc",
    "sys/kernel/realtime": "1",
    "sys/devices/system/cpu/isolated": "2-3",
    "sys/fs/cgroup/cpu.max": "max 100000",
    "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor": "performance",
    "proc/self/status": "VmRSS:\t10 kB\nVmLck:\t2048 kB",
}


def computer(folder, **changed):
    for place, text in SYSTEM.items():
        path = folder / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(changed.get(path.name, text) + "\n")
    return folder


@pytest.fixture
def capable(monkeypatch):
    """Eight cores without load, and the scheduler of a real-time program."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda who: set(range(8)))
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    monkeypatch.setattr(os, "getloadavg", lambda: (0.1, 0.1, 0.1))
    monkeypatch.setattr(os, "sched_getscheduler", lambda who: os.SCHED_FIFO)


def test_a_computer_that_is_set_up_needs_no_change(tmp_path, capable):
    findings = module.examine(1e-3, computer(tmp_path))
    assert [finding.name for finding in findings if not finding.is_well] == []
    assert {finding.name for finding in findings} == {
        "clock", "kernel", "cores", "load", "frequency of the cores", "scheduler", "memory"
    }  # fmt: skip
    assert "isolated: 2-3" in str(findings)


@pytest.mark.parametrize(
    ("changed", "name", "advice"),
    [
        ({"current_clocksource": "hpet"}, "clock", "clocksource=tsc"),
        ({"realtime": "0"}, "kernel", "PREEMPT_RT"),
        ({"cpu.max": "50000 100000"}, "share of the cores", "control group"),
        ({"scaling_governor": "powersave"}, "frequency of the cores", "performance"),
        ({"status": "VmLck:\t0 kB"}, "memory", "lock_memory=True"),
    ],
)
def test_what_is_not_well_is_named_with_what_to_change(tmp_path, capable, changed, name, advice, monkeypatch):
    monkeypatch.setattr(module.platform, "version", lambda: "#1 SMP")
    findings = module.examine(1e-3, computer(tmp_path, **changed))
    wrong = {finding.name: finding.advice for finding in findings if not finding.is_well}
    assert wrong.keys() == {name}
    assert advice in wrong[name]


def test_cores_load_and_scheduler_are_looked_at(tmp_path, capable, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda who: {0, 1})
    monkeypatch.setattr(os, "getloadavg", lambda: (5.0, 5.0, 5.0))
    monkeypatch.setattr(os, "sched_getscheduler", lambda who: os.SCHED_OTHER)
    wrong = {finding.name for finding in module.examine(1e-3, computer(tmp_path)) if not finding.is_well}
    assert wrong == {"cores", "load", "scheduler"}


def test_lateness_is_measured_and_missed_periods_are_counted(monkeypatch):
    """With a clock of our own: every tenth period begins 1.5 ms late, the others 20 µs."""

    class Time:
        now, waits = 0.0, 0

        def perf_counter(self):
            return self.now

        get_clock_info = staticmethod(module.time.get_clock_info)

    clock = Time()

    def wait_until(due):
        clock.waits += 1
        clock.now = max(clock.now, due) + (1.5e-3 if clock.waits % 10 == 0 else 20e-6)

    monkeypatch.setattr(module, "time", clock)
    monkeypatch.setattr(module, "wait_until", wait_until)
    found = preflight(1e-3, 1.0)
    assert found.periods == 1000
    assert found.missed == 100
    assert found.late_median == pytest.approx(20e-6, rel=0.01)
    assert found.late_p99_9 == pytest.approx(1.5e-3, rel=0.01)
    assert not found.keeps_the_period
    assert "100 missed" in str(found)
    assert "change: period: it is not kept" in str(found)


def test_lateness_is_told_in_microseconds():
    told = str(module.Preflight([module.Finding("clock", "tsc", "")], 2e-3, 7, 1.0, 2.0, 3.0, 5))
    assert "7 of 2 ms began late by 1000000 µs median, 2000000 µs p99.9, 3000000 µs at most; 5 missed" in told


def test_the_command_says_it_in_json_and_by_its_exit_code():
    result = CliRunner().invoke(app, ["preflight", "--seconds", "0.2", "--json"])
    found = json.loads(result.stdout)
    assert found["periods"] == 200
    assert result.exit_code == (0 if found["is_well"] else 1)
    assert {"clock", "kernel", "cores"} <= {finding["name"] for finding in found["findings"]}
    result = CliRunner().invoke(app, ["preflight", "--seconds", "0.01"])
    assert result.exit_code == 2
    assert "duration" in result.output


def test_what_was_asked_for_is_in_effect_or_said_not_to_be_and_is_given_back():
    cores = os.sched_getaffinity(0)
    policy = os.sched_getscheduler(0)
    with RealTime(priority=1, cores=[min(cores)], freeze_gc=True) as asked:
        effects = {effect.name: effect for effect in asked.effects}
        assert effects["cores"].took_effect == (os.sched_getaffinity(0) == {min(cores)})
        assert effects["priority"].took_effect == (os.sched_getscheduler(0) == os.SCHED_FIFO)
        assert effects["garbage collection"].took_effect
        assert gc.get_freeze_count() > 0
        assert str(asked).count("\n") == 2
    assert os.sched_getaffinity(0) == cores
    assert os.sched_getscheduler(0) == policy
    assert gc.get_freeze_count() == 0


def test_memory_is_locked_or_said_not_to_be():
    """In a process of its own: this one may be too large for what may be locked."""
    program = (
        "from phcontrol.runtime.real_time import RealTime, locked_memory\n"
        "with RealTime(lock_memory=True) as asked:\n"
        "    print(asked.effects[0].took_effect, locked_memory() > 0)\n"
        "print(locked_memory())\n"
    )
    printed = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert printed in ("True True\n0\n", "False False\n0\n")


def test_what_the_computer_refuses_is_no_error(monkeypatch):
    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(real_time.os, "sched_setscheduler", refuse)
    with RealTime(priority=10, cores=[max(os.sched_getaffinity(0)) + 1000]) as asked:
        assert not asked.all_took_effect
        assert [str(effect) for effect in asked.effects] == [
            "cores: NOT in effect, invalid argument",
            "priority: NOT in effect, operation not permitted",
        ]
    monkeypatch.delattr(real_time.os, "sched_setscheduler")
    with RealTime(priority=10) as asked:
        assert str(asked) == "priority: NOT in effect, unknown to this system"
    assert str(RealTime().__enter__()) == "nothing was asked for"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"priority": 100}, "priority: must be 1 to 99"),
        ({"priority": 0}, "priority"),
        ({"cores": []}, "cores: must name one core"),
        ({"cores": [-1]}, "cores"),
        ({"lock_memory": 1}, "lock_memory"),
    ],
)
def test_bad_wishes_are_refused(arguments, message):
    with pytest.raises(InvalidArgumentError, match=message):
        RealTime(**arguments)


def test_bad_trials_are_refused():
    with pytest.raises(InvalidArgumentError, match="period"):
        preflight(0.0)
    with pytest.raises(InvalidArgumentError, match="duration: must be >= 0.1"):
        preflight(1e-3, 0.05)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"period": 1e-9}, "period: must be >= 1e-05, but is 1e-09"),
        ({"period": 1e-300, "duration": 1.0}, "period: must be >= 1e-05"),
        ({"period": 1e-3, "duration": 1e9}, "duration: must be <= 3600"),
        ({"period": 100.0}, "period: must be <= 36"),
        ({"period": None}, "period: must be a number"),
    ],
)
def test_a_trial_that_would_not_end_is_refused(arguments, said):
    with pytest.raises(InvalidArgumentError, match=said):
        preflight(**arguments)
