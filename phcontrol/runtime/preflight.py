"""Whether this computer can keep a control loop's period, and what to change."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from phcontrol._validation import number
from phcontrol.runtime.arm_driver import wait_until
from phcontrol.runtime.duration_histogram import DurationHistogram

_LATE = 0.3  # of a period: a Franka waits 300 µs of its millisecond
_SHORTEST = 1e-5  # period that is tried [s]: looking at the clock from Python takes a part of a microsecond
_LONGEST = 3600.0  # trial [s]
_ROOT = Path("/")


class Finding(NamedTuple):
    """One thing that was looked at."""

    name: str
    value: str
    """What was found."""
    advice: str
    """What to change; empty where it is well."""

    @property
    def is_well(self) -> bool:
        """Whether nothing needs to be changed."""
        return not self.advice


class Preflight(NamedTuple):
    """What was found, and how well the period was kept.

    Example:
        >>> from phcontrol import preflight
        >>> found = preflight(period=2e-3, duration=0.2)
        >>> found.periods, isinstance(found.keeps_the_period, bool)
        (100, True)
    """

    findings: list[Finding]
    """The computer: clock, kernel, scheduler, cores."""
    period: float
    """Asked for [s]."""
    periods: int
    """Periods that were tried."""
    late_median: float
    """How late a period began, median [s]."""
    late_p99_9: float
    """99.9th percentile of it [s]."""
    latest: float
    """The latest [s]."""
    missed: int
    """Periods that began after their end."""

    @property
    def keeps_the_period(self) -> bool:
        """Whether 99.9 % of the periods began within 30 % of one, and none was missed."""
        return self.missed == 0 and self.late_p99_9 <= _LATE * self.period

    @property
    def is_well(self) -> bool:
        """Whether nothing was found that needs to be changed."""
        return self.keeps_the_period and all(finding.is_well for finding in self.findings)

    def __str__(self) -> str:
        width = max(len(finding.name) for finding in self.findings)
        lines = [f"{finding.name:<{width}}  {finding.value}" for finding in self.findings]
        lines.append(
            f"{'period':<{width}}  {self.periods} of {1e3 * self.period:g} ms began late by "
            f"{1e6 * self.late_median:.0f} µs median, {1e6 * self.late_p99_9:.0f} µs p99.9, "
            f"{1e6 * self.latest:.0f} µs at most; {self.missed} missed"
        )
        lines += [f"change: {finding.name}: {finding.advice}" for finding in self.findings if finding.advice]
        if not self.keeps_the_period:
            lines.append(
                "change: period: it is not kept; end what else runs here, and see RealTime for what one can ask for"
            )
        if self.is_well:
            lines.append("nothing needs to be changed")
        return "\n".join(lines)


def preflight(period: float = 1e-3, duration: float = 5.0) -> Preflight:
    """Look at this computer as a control loop will find it, and try the period for a while.

    The loop sleeps and watches the clock as ``drive`` does; it computes nothing, and talks to nobody: what is found is
    the least that a loop will see. Run it as the loop will run: as the same user, inside :class:`RealTime`, with what
    else runs then.

    Args:
        period: of the loop to come [s], 10 µs at least.
        duration: of the trial [s], a hundred periods at least, and an hour at most.

    Example:
        >>> from phcontrol import preflight
        >>> preflight(period=2e-3, duration=0.2).periods
        100
    """
    wanted = number("period", period, minimum=_SHORTEST, maximum=0.01 * _LONGEST)
    tried = number("duration", duration, minimum=100 * wanted, maximum=_LONGEST)
    lateness, missed, count = DurationHistogram(), 0, round(tried / wanted)
    start = time.perf_counter() + wanted
    for k in range(count):
        due = start + k * wanted
        wait_until(due)
        late = max(0.0, time.perf_counter() - due)
        lateness.add(late)
        missed += late >= wanted
    return Preflight(
        examine(wanted),
        wanted,
        count,
        lateness.percentile(50.0),
        lateness.percentile(99.9),
        lateness.longest,
        missed,
    )


def examine(period: float, root: Path = _ROOT) -> list[Finding]:
    """Return what is found of clock, kernel, scheduler and cores; ``root`` is where /sys and /proc are."""
    looks: tuple[Callable[[float, Path], Finding | None], ...] = (
        _clock,
        _kernel,
        _cores,
        _share,
        _load,
        _frequency,
        _priority,
        _memory,
    )
    found = (look(period, root) for look in looks)
    return [finding for finding in found if finding is not None]


def _clock(period: float, root: Path) -> Finding:
    step = time.get_clock_info("perf_counter").resolution
    source = _read(root, "sys/devices/system/clocksource/clocksource0/current_clocksource")
    advice = ""
    if step > 0.01 * period:
        advice = "too coarse for the period"
    elif source in ("hpet", "acpi_pm", "jiffies"):
        advice = "slow to read: boot with clocksource=tsc where the processor's is stable"
    return Finding("clock", f"{source or 'unknown'}, steps of {1e9 * step:g} ns", advice)


def _kernel(period: float, root: Path) -> Finding:
    version = platform.version()
    preempts = _read(root, "sys/kernel/realtime") == "1" or "PREEMPT_RT" in version
    advice = "" if preempts else "not real-time: install one with PREEMPT_RT (Ubuntu Pro: pro enable realtime-kernel)"
    return Finding("kernel", f"{platform.release()}, {'real-time' if preempts else 'not real-time'}", advice)


def _cores(period: float, root: Path) -> Finding:
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    isolated = _read(root, "sys/devices/system/cpu/isolated")
    advice = "" if count >= 3 else "too few: one for the loop, one for the network's interrupts, one for all else"
    return Finding("cores", f"{count}" + (f", isolated: {isolated}" if isolated else ""), advice)


def _share(period: float, root: Path) -> Finding | None:
    quota = _read(root, "sys/fs/cgroup/cpu.max").split()
    if len(quota) != 2 or quota[0] == "max":
        return None
    share = float(quota[0]) / float(quota[1])
    return Finding(
        "share of the cores", f"{share:g}", "limited by a control group, which stops the loop when it is used up"
    )


def _load(period: float, root: Path) -> Finding | None:
    if not hasattr(os, "getloadavg"):
        return None
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    return Finding("load", f"{load:.1f} on {cores} cores", "end what else runs here" if load > 0.5 * cores else "")


def _frequency(period: float, root: Path) -> Finding | None:
    governor = _read(root, "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
    if not governor:
        return None
    advice = (
        ""
        if governor == "performance"
        else "the cores slow down between periods: cpupower frequency-set -g performance"
    )
    return Finding("frequency of the cores", governor, advice)


def _priority(period: float, root: Path) -> Finding | None:
    if not hasattr(os, "sched_getscheduler"):
        return None
    names = {os.SCHED_OTHER: "shared with all", os.SCHED_FIFO: "SCHED_FIFO", os.SCHED_RR: "SCHED_RR"}
    policy = names.get(os.sched_getscheduler(0), "another")
    allowed = _limit("RLIMIT_RTPRIO")
    advice = ""
    if not policy.startswith("SCHED_"):
        advice = "ask for SCHED_FIFO: RealTime(priority=80)"
        if allowed == 0 and os.geteuid() != 0:
            advice += (
                "; this user may not: a line '@realtime - rtprio 99' in /etc/security/limits.conf, and join the group"
            )
    return Finding("scheduler", policy, advice)


def _memory(period: float, root: Path) -> Finding | None:
    locked = next((line for line in _read(root, "proc/self/status").splitlines() if line.startswith("VmLck")), "")
    if not locked:
        return None
    amount = int(locked.split()[1])
    advice = ""
    if amount == 0:
        advice = "a page that was moved to disk costs milliseconds: RealTime(lock_memory=True)"
        limit = _limit("RLIMIT_MEMLOCK")
        if 0 <= limit < 2**30 and os.geteuid() != 0:
            advice += "; this user may lock too little: a line '@realtime - memlock unlimited' in limits.conf"
    return Finding("memory", f"{amount / 1024:.0f} MB locked" if amount else "not locked", advice)


def _limit(name: str) -> int:
    """Return the soft limit of a resource; −1 for none."""
    import resource

    return int(resource.getrlimit(getattr(resource, name))[0])


def _read(root: Path, place: str) -> str:
    """Return the text of a file of the system; empty where there is none."""
    try:
        return (root / place).read_text(encoding="utf-8").strip()
    except OSError:
        return ""
