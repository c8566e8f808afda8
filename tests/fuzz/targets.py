"""What is done with input nobody expected. Each target turns bytes into such input and returns what became of it.

A target passes when the library works, or raises one of its own errors; anything else leaves as it is. Hypothesis
draws the bytes in ``test_unexpected_input.py``, atheris searches for them in ``search.py``.
"""

from __future__ import annotations

import inspect
import io
import json
import os
import re
import tempfile
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from typer.testing import CliRunner

import phcontrol as ph
from phcontrol.cli import app
from phcontrol.controllers.registry import CONTROLLERS
from phcontrol.visualization.recording import recorded_page
from tests.log_files import seal

ROOT = Path(__file__).parents[2]
FOLDER = Path(tempfile.mkdtemp(prefix="phcontrol-fuzz-"))
ROBOTS = ("pera_shoulder", "pera_gripper", "pera")
NUMBERS = [
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "1e-320",
    "",
    "abc",
    "0",
    "-1",
    "1e999",
    "0x10",
    "1 2 3",
    "-0.0",
    "1,5",
]
KINDS = ["floating", "planar", "spherical", "Revolute", "", "fixed", "continuous", "prismatic", "screw"]
ELEMENTS = ["mimic", "limit", "dynamics", "link", "joint", "inertial", "robot", "origin"]
ATTRIBUTES = ["xyz", "rpy", "mass", "value", "joint", "multiplier", "link", "lower"]
EXTRAS = [
    '<joint name="x" type="revolute"><parent link="gripper"/><child link="base"/></joint>',  # a cycle
    '<joint name="y" type="floating"><parent link="base"/><child link="new"/></joint><link name="new"/>',
    "<link/><joint/>",
    "&a;",
]


class Choices:
    """Makes choices of bytes; zeros when they are used up."""

    def __init__(self, data: bytes) -> None:
        self._data, self._place = data, 0

    def below(self, n: int) -> int:
        """Return a number from 0 to n − 1."""
        width = 1 if n <= 256 else 3
        part = self._data[self._place : self._place + width]
        self._place += width
        return int.from_bytes(part, "little") % n if n > 0 else 0

    def one_of(self, values: Any) -> Any:
        """Return one of the values."""
        return values[self.below(len(values))]


def _edited(text: str, choices: Choices) -> str:
    """Return a robot description with one thing wrong."""
    kind = choices.below(12)
    if kind == 0:
        return text[: choices.below(len(text))]
    if kind == 1:
        place = choices.below(len(text))
        return text[:place] + choices.one_of("<>&\"'/\x00é \n") + text[place + 1 :]
    if kind == 2:
        return text.replace("</robot>", choices.one_of(EXTRAS) + "</robot>")
    if kind == 3:
        bomb = '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]><robot'
        return text.replace("<robot", bomb, 1)
    if kind == 4:
        lines = text.split("\n")
        del lines[choices.below(len(lines))]
        return "\n".join(lines)
    if kind == 5:
        lines = text.split("\n")
        lines.insert(choices.below(len(lines)), lines[choices.below(len(lines))])
        return "\n".join(lines)
    if kind == 6:
        start = choices.below(len(text))
        return text[:start] + text[start + choices.below(400) :]
    patterns = {7: (r'type="(\w+)"', KINDS), 8: (r"<(\w+) ", ELEMENTS), 9: (r"(\w+)=", ATTRIBUTES)}
    pattern, values = patterns.get(kind, (r'"([-+0-9.e ]+)"', NUMBERS))
    places = list(re.finditer(pattern, text))
    if not places:
        return text
    place = choices.one_of(places)
    return text[: place.start(1)] + choices.one_of(values) + text[place.end(1) :]


def robot_description(data: bytes) -> str:
    """Load a broken robot description, and control what it describes if it is one."""
    choices = Choices(data)
    text = (ROOT / "urdf" / f"{choices.one_of(ROBOTS)}.urdf").read_text(encoding="utf-8")
    for _ in range(1 + choices.below(3)):
        text = _edited(text, choices)
    path = FOLDER / "robot.urdf"
    path.write_text(text, encoding="utf-8")
    try:
        robot = ph.load_robot(path)
        system = ph.MechanicalSystem(robot)
        law = ph.make_controller("force_feedback", system)
        torque = law.evaluate(0.0, system.at(robot.home), np.zeros(robot.n)).torque
    except ph.PHControlError:
        return "refused"
    assert np.isfinite(torque).all()
    return "accepted"


class Evil:
    """Creates a file when it is unpickled."""

    mark = FOLDER / "code-was-executed"

    def __reduce__(self) -> Any:
        return (open, (str(self.mark), "w"))


METADATA = [
    b"{}", b"[]", b"null", b"\xff\xfe", b'{"format": "phcontrol-log-1"}', b'{"format": 3}', b"[" * 100_000,
    b'{"format": "phcontrol-log-2", "joint_names": 5}', b'{"format": "phcontrol-log-2", "joint_names": []}',
    b'{"format": "phcontrol-log-2", "joint_names": ["a", "b"], "robot": "r", "controller": "c", "torque_limit": "x"}',
    b'{"format": "phcontrol-log-2", "joint_names": ["a", "b"], "robot": "r", "controller": "c"}',
]  # fmt: skip
ARRAYS = [
    np.array([Evil()], dtype=object), np.zeros(0), np.array("x"), np.full(3, np.nan), np.array(5.0),
    np.zeros((11, 3), dtype=complex), np.zeros(11, dtype="U3"), np.zeros((11, 2, 2)), np.full((11, 2), np.inf),
    np.zeros((2, 11)), np.zeros(11, dtype=bool), np.zeros((11, 2), dtype=np.float32),
]  # fmt: skip


@cache
def _good_log() -> tuple[bytes, dict[str, Any]]:
    system = ph.MechanicalSystem(ph.load_robot("pera_shoulder"))
    log = ph.simulate(system, ph.make_controller("force_feedback", system), duration=0.01)
    path = log.save(FOLDER / "good.npz")
    with np.load(path) as file:
        return path.read_bytes(), dict(file)


ENTRIES: list[Any] = [
    None, 0, -1.0, 5, True, "", "x", "pera_shoulder", [], [1.0], [0.0, 0.0, 0.0], ["shoulder_roll"], {}, {"a": 1}, [{}],
    [{"geometry": {"kind": "joint", "joint": "shoulder_roll", "position": 0.1, "side": "below"}}], float("nan"), 1e308,
    [["shoulder_roll"]], "file:///etc/passwd", "../..",
]  # fmt: skip


def _with_changed_entry(metadata: bytes, choices: Choices) -> bytes:
    """Return metadata with one entry replaced, at the top or inside one of its tables."""
    content = table = json.loads(metadata)
    for _ in range(1 + choices.below(3)):
        key = choices.one_of(sorted(table))
        if not (isinstance(table[key], dict) and table[key] and choices.below(3)):
            break
        table = table[key]
    table[choices.one_of(sorted(table))] = choices.one_of(ENTRIES)
    return json.dumps(content).encode()


def _log_content(choices: Choices) -> bytes:
    """Return a log's file, cut, damaged, or put together by hand with a hash that fits."""
    raw, arrays = _good_log()
    arrays, kind = dict(arrays), choices.below(7)
    if kind == 0:
        return raw[: choices.below(len(raw))]
    if kind == 1:
        damaged = bytearray(raw)
        for _ in range(1 + choices.below(8)):
            damaged[choices.below(len(damaged))] = choices.below(256)
        return bytes(damaged)
    name = choices.one_of(sorted(arrays))
    if kind == 2:
        del arrays[name]
    elif kind == 3:
        arrays[name] = choices.one_of(ARRAYS)
    elif kind == 4:
        arrays["metadata"] = np.frombuffer(choices.one_of(METADATA), dtype=np.uint8)
    elif kind == 5:
        changed = _with_changed_entry(arrays["metadata"].tobytes(), choices)
        arrays["metadata"] = np.frombuffer(changed, dtype=np.uint8)
    else:
        arrays[choices.one_of(["../x", "measured_", "filter_status", "other"])] = choices.one_of(ARRAYS)
    file = io.BytesIO()
    np.savez(file, **(seal(arrays) if choices.below(8) else arrays))
    return file.getvalue()


def log_file(data: bytes) -> str:
    """Load a broken log, and look at all that is in it if it is one."""
    path = FOLDER / "log.npz"
    path.write_bytes(_log_content(Choices(data)))
    try:
        log = ph.Log.load(path)
        (repr(log), log.saturated, log.measured, log.filter_activity, log.storage, log.power_balance())
        log.to_dataframe()
        log.power_balance("all")
        recorded_page(log)
    except ph.PHControlError:
        return "refused"
    finally:
        assert not Evil.mark.exists()
    return "accepted"


VALUES: list[Any] = [
    0, 0.0, -1, 1, 1.5, True, False, None, "", "1", "x", np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-308, 1e200,
    1e100, [],
    [1], [1, 2], [1, 2, 3], [[1, 0], [0, 1]], [[1, 2], [2, 1]], [[1, 0], [0]], np.eye(2), np.eye(3), np.zeros((2, 2)),
    np.ones((2, 2)), np.array([1, 2]), np.array(["a", "b"]), {}, {"a": 1}, object(), 1j, [1j, 2], (1, 2), range(2),
    np.float32(2), 10**400, -0.0, b"x", [None, 1], [[np.nan, 0], [0, 1]], [1e308, 1e308], [1e-320, 1],
    np.full((2, 2), 1e200),
]  # fmt: skip
TAKERS: list[Callable[..., Any]] = [
    ph.StribeckFriction, ph.GripperSpring, ph.PacketFaults, ph.ForceRegulation, ph.RigidBody, ph.CompliantBody,
    ph.JointContact, ph.SphereContact, ph.Step, ph.Pulse, ph.Sine, ph.ForceSensor, ph.MomentumObserver, ph.ControlBox,
    ph.MechanicalSystem, ph.Schedule, ph.Holding, ph.Limits, ph.TorqueFilter, ph.JointSpring, ph.SingleJointSpring,
    ph.JointForce, ph.PointForce, ph.FrameWrench, ph.FrameSpring, ph.PositionPotential,
]  # fmt: skip


@cache
def _system(index: int) -> ph.MechanicalSystem:
    return ph.MechanicalSystem(ph.load_robot(ROBOTS[index]))


def arguments(data: bytes) -> str:
    """Call a public entry with values of all kinds; no torque that is not finite may come out."""
    choices = Choices(data)
    try:
        with np.errstate(all="ignore"):
            _call(choices, _system(choices.below(2)))
    except ph.PHControlError:
        return "refused"
    except TypeError as error:
        if re.search(r"required (positional|keyword-only)|unexpected keyword", str(error)):
            return "refused"
        raise
    return "accepted"


def _some(choices: Choices, function: Callable[..., Any], share: int, *but: str) -> dict[str, Any]:
    names = inspect.signature(function).parameters
    return {name: choices.one_of(VALUES) for name in names if name not in but and choices.below(100) < share}


def _call(choices: Choices, system: ph.MechanicalSystem) -> None:
    kind = choices.below(6)
    n = system.n
    if kind <= 1:
        name = choices.one_of(list(CONTROLLERS))
        options = _some(choices, CONTROLLERS[name].law, 30, "system")
        law = ph.make_controller(name, system, **options)
        x, measured = system.at(np.full(n, 0.1), np.full(n, 0.2)), ph.Measured(np.ones(n), np.ones(n))
        assert np.isfinite(law.evaluate(0.0, x, np.zeros(law.state_size), measured).torque).all()
    elif kind == 2:
        law = ph.make_controller("energy_shaping", system)
        options = {"duration": 0.003} | _some(
            choices, ph.simulate, 20, "system", "controller", "duration", "dt", "progress"
        )
        assert np.isfinite(ph.simulate(system, law, **options).torque).all()
    elif kind == 3:
        law = ph.make_controller("energy_shaping", system)
        options = {"period": 1e-3} | _some(choices, ph.ControlLoop, 20, "system", "controller", "clock")
        loop = ph.ControlLoop(system, law, **options)
        for _ in range(4):
            torque = loop.step(choices.one_of(VALUES), choices.one_of(VALUES), age=choices.one_of(VALUES))
            assert np.isfinite(torque).all()
        for _ in range(4):
            assert np.isfinite(loop.step(np.zeros(n), np.zeros(n))).all()
    elif kind == 4:
        system.at(choices.one_of(VALUES), choices.one_of(VALUES))
        ph.load_robot("pera_shoulder", **_some(choices, ph.load_robot, 40, "source"))
    else:
        taker = choices.one_of(TAKERS)
        first = [system] if "system" in inspect.signature(taker).parameters else []
        first = [system.robot] if taker is ph.MechanicalSystem else first
        taker(*first, **_some(choices, taker, 50, "system", "robot"))


class Hostile:
    """An object that raises whatever it is asked."""

    def _refuse(self, *arguments: Any, **named: Any) -> Any:
        raise RuntimeError("no")

    __array__ = __float__ = __index__ = __len__ = __iter__ = __eq__ = __lt__ = __bool__ = __getitem__ = _refuse


SIGNALS: list[Any] = [
    *VALUES, Hostile(), [Hostile()] * 2, np.full(2, np.nan), np.array([np.inf, 0.0]), np.full(2, 1e4), np.full(2, 39.0),
    np.full(2, 1e160), np.zeros(2) + 1j, np.zeros(2, dtype=bool), np.array(["1", "2"]), np.zeros((2, 1)),
    np.zeros((1, 2)), np.zeros(3), np.zeros(0), np.array(0.1), np.ma.masked_all(2), np.array([1, 2], dtype=np.int8),
    np.zeros(2, dtype=np.longdouble), np.zeros(2, dtype="M8[s]"), np.zeros(2, dtype="f4,f4"), np.array([None, 1.0]),
    memoryview(b"ab"), lambda: None, NotImplemented, ..., type, 1 << 70, [1 << 70, 0],
]  # fmt: skip
FORCES: list[Any] = [None, np.zeros(2), np.array([3.0, -2.0]), np.full(2, 30.0)]
ERRORS = [TypeError, np.linalg.LinAlgError, ZeroDivisionError, RecursionError, MemoryError, StopIteration, UnicodeError]
PERIOD, RATE = 1e-3, 500.0


class _WildLaw(ph.ForceFeedback):
    """A law that now and then raises or returns what is no command, as the choices have it."""

    choices: Choices

    def evaluate(self, t: float, x: Any, state: Any, measured: Any = ph.NOTHING) -> Any:
        good = super().evaluate(t, x, state, measured)
        kind = self.choices.below(12)
        if kind == 0:
            raise self.choices.one_of(ERRORS)
        if kind == 1:
            return self.choices.one_of(SIGNALS)
        if kind == 2:
            return ph.Command(self.choices.one_of(SIGNALS), good.state_rate)
        if kind == 3:
            return ph.Command(good.torque, self.choices.one_of(SIGNALS))
        if kind == 4:
            return ph.Command(good.torque * 10.0 ** (self.choices.below(256)), good.state_rate)
        return good


@cache
def _limits() -> ph.Limits:
    return ph.Limits(_system(0), torque_rate=RATE, braking_jerk=1000.0)


def _loop(choices: Choices, now: list[float]) -> tuple[ph.ControlLoop, bool]:
    system = _system(0)
    kind = choices.below(4)
    if kind == 0:
        law: ph.Controller = _WildLaw.tuned(system)
        law.choices = choices
    else:
        names = [
            "force_feedback",
            "force_feedback_measured",
            "total_force_rejection",
            "energy_shaping",
            "force_control",
        ]
        law = ph.make_controller(choices.one_of(names), system)
    filtered = choices.below(2) == 1
    torque_filter = ph.TorqueFilter(system, period=PERIOD, limits=_limits()) if filtered else None
    start, stop = choices.one_of([0.0, 3e-3]), choices.one_of([0.0, 3e-3])
    loop = ph.ControlLoop(
        system, law, PERIOD, torque_filter=torque_filter, start_time=start, stop_time=stop, clock=lambda: now[0]
    )
    return loop, filtered


def control_loop(data: bytes) -> str:
    """Step a loop with inputs of any type and laws of any kind; what leaves is finite and inside all limits."""
    choices, now = Choices(data), [0.0]
    loop, filtered = _loop(choices, now)
    limit, before = np.asarray(_system(0).robot.effort_limit), None
    q, v = np.array(_system(0).robot.home), np.zeros(2)
    for _ in range(12):
        now[0] += choices.one_of([PERIOD, PERIOD, PERIOD, 0.0, 0.02, 0.4, -1.0, 20.0])
        q, v = q + choices.one_of([0.0, 1e-3, -2e-3, 0.3]), v + choices.one_of([0.0, 0.1, -0.2, 3.0])
        kind, age = choices.below(8), choices.one_of([0.0, 0.0, 1e-3, 0.05])
        position = choices.one_of(SIGNALS) if kind == 1 else q
        velocity = choices.one_of(SIGNALS) if kind == 2 else v
        force = choices.one_of(SIGNALS) if kind in (3, 4) else choices.one_of(FORCES)
        measured = force if kind == 4 else ph.Measured(force, force, choices.one_of([None, np.zeros(3), force]))
        age = choices.one_of(SIGNALS) if kind == 5 else age
        if kind == 6:
            loop.stop() if choices.below(2) else loop.restart()
        torque = loop.step(position, velocity, measured, age=age)
        assert type(torque) is np.ndarray
        assert torque.dtype == np.float64
        assert torque.shape == (2,)
        assert (np.abs(torque) <= limit).all(), torque  # false of NaN
        if filtered and before is not None:
            assert (np.abs(torque - before) <= RATE * PERIOD * (1.0 + 1e-12)).all(), (torque, before)
        before = None if loop.mode == ph.LoopMode.WAITING else torque.copy()
        torque *= choices.one_of([1.0, 1e3, -1.0, np.nan])  # what a driver may do
    return "refused" if loop.fault is not None else "accepted"


WORDS = [
    "run", "certify", "robots", "controllers", "position", "--robot", "--controller", "--samples", "--seed", "--set",
    "--goal", "--lock", "--json", "--duration", "--dt", "--integrator", "--out", "--interconnection", "--help",
    "pera_shoulder",
    "energy_shaping", "all", "2", "-1", "nan", "1e999", "0", "", "stiffness=nan", "stiffness=[1,", "=",
    "goal=1", "\x00",
    "../..", "/dev/null/x", "é", "coriolis", "rk4", "0.01", "0.001", "1,2", "a=b,c", "--nonsense", "-h",
]  # fmt: skip


def command_line(data: bytes) -> str:
    """Run a command line of known and unknown words: exit code 0, 1 or 2 and no traceback."""
    choices = Choices(data)
    words = [choices.one_of(WORDS) for _ in range(1 + choices.below(7))]
    if words[0] in ("certify", "run") and "--samples" not in words:
        words = [*words, "--robot", "pera_shoulder"]
    if words[:2] == ["run", "position"]:
        words = [*words, "--duration", "0.01", "--samples", "2"]
    elif words[0] == "certify":
        words = [*words, "--samples", "2"]
    here = os.getcwd()
    os.chdir(FOLDER)
    try:
        result = CliRunner().invoke(app, words)
    finally:
        os.chdir(here)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code in (0, 1, 2), (words, result.exit_code)
    return "accepted" if result.exit_code == 0 else "refused"


TARGETS = {
    "robot_description": robot_description,
    "log_file": log_file,
    "arguments": arguments,
    "control_loop": control_loop,
    "command_line": command_line,
}


def run(target: Callable[[bytes], str], data: bytes) -> str:
    """Run a target with warnings silent: what matters is what comes out."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return target(data)
