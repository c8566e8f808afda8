"""A sweep's results are the runs that one would make by hand, whoever makes them, and however often it was stopped."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow as arrow
import pytest
from pyarrow import parquet
from typer.testing import CliRunner

from phcontrol import DataFileError, EngineError, LocalProcesses, Log, Statement, Sweep, SweepResults, simulate
from phcontrol._version import __version__
from phcontrol.cli import app
from phcontrol.compilation.compiler import find_compiler
from phcontrol.sweeps.chunk import Chunk, run_chunk
from phcontrol.sweeps.dask_scheduler import DaskScheduler

ROOT = Path(__file__).parents[2]
SPEC = """
measures = ["final_error", "peak_torque", "tests.sweeps.tasks:waits"]

[arm]
robot = "pera_shoulder"
friction = { viscous = 0.5 }

[law]
name = "force_feedback_measured"
goal = [0.3, 0.5]

[run]
duration = 0.05
control_period = 1e-3

[vary]
payload_mass = { uniform = [0.0, 0.5] }
sensor_noise = { uniform = [0.0, 0.1] }
sensor_delay = { uniform = [0.0, 3e-3] }
disturbance.each = { distribution = "norm", scale = 1.0 }
gain_factor.stiffness = [0.8, 1.0, 1.2]

[sampling]
runs = 48
seed = 3
chunk = 4

[require]
final_error = 0.6
"""


class InThisProcess:
    """The simplest engine, in another order."""

    workers = 1

    def __init__(self, upwards=True):
        self.upwards = upwards

    def run(self, task, items):
        from phcontrol.sweeps.engine import Finished

        for item in items if self.upwards else reversed(list(items)):
            yield Finished(item, task(item), None)


def same(one: SweepResults, other: SweepResults) -> None:
    """Check that two results have the same values, to the last bit."""
    assert one.table.column_names == other.table.column_names
    for name in one.table.column_names:
        np.testing.assert_array_equal(one.column(name), other.column(name), err_msg=name)


def test_rows_are_the_runs_made_by_hand(small, tmp_path):
    sweep = Sweep(**small)
    results = sweep.run(tmp_path / "out", engine=InThisProcess())
    assert results.finished
    assert bool(results.column("compiled").all()) == (find_compiler() is not None)
    for run in range(sweep.runs):
        log = simulate(**sweep.loop(run))
        assert abs(results.column("final_error")[run] - np.abs(log.position[-1] - [0.3, 0.5]).max()) < 1e-9
        assert (
            abs(results.column("peak_velocity")[run] - _peak(log.velocity, sweep.nominal.robot.velocity_limit)) < 1e-9
        )
        assert results.column("payload_mass")[run] == sweep.scenario(run)["payload_mass"]
    assert np.ptp(results.column("final_error")) > 1e-3


def _peak(values, limit):
    bounded = np.isfinite(limit)
    return (np.abs(values[:, bounded]) / limit[bounded]).max() if bounded.any() else 0.0


def test_compiled_and_interpreted_runs_are_the_same(small, tmp_path):
    sweep = Sweep(**small)
    compiled = sweep.run(tmp_path / "compiled", engine=InThisProcess())
    interpreted = sweep.run(tmp_path / "interpreted", engine=InThisProcess(), compiled=False)
    assert not interpreted.column("compiled").any()
    for name in sweep.measures:
        np.testing.assert_allclose(compiled.column(name), interpreted.column(name), rtol=0.0, atol=1e-9, err_msg=name)


def test_results_do_not_depend_on_who_did_what(small, tmp_path):
    sweep = Sweep(**small)
    first = sweep.run(tmp_path / "a", engine=InThisProcess())
    same(first, sweep.run(tmp_path / "b", engine=InThisProcess(upwards=False)))
    same(first, sweep.run(tmp_path / "c", workers=2))


def test_what_is_there_is_not_done_again(small, tmp_path):
    sweep = Sweep(**small)
    whole = sweep.run(tmp_path / "out", engine=InThisProcess())
    parts = sorted((tmp_path / "out" / "parts").iterdir())
    assert [part.name for part in parts] == [f"runs-{first:010d}.parquet" for first in (0, 4, 8)]
    parts[0].unlink()
    parts[1].write_bytes(parts[1].read_bytes()[:-20])
    before = parts[2].stat().st_mtime_ns
    done = []

    class Watched(InThisProcess):
        def run(self, task, items):
            for found in super().run(task, items):
                done.append(found.item.first)
                yield found

    same(whole, sweep.run(tmp_path / "out", engine=Watched()))
    assert done == [0, 4]
    assert parts[2].stat().st_mtime_ns == before
    # a part of another place is none
    shutil.copy(parts[2], parts[0])
    done.clear()
    same(whole, sweep.run(tmp_path / "out", engine=Watched()))
    assert done == [0]


def test_a_run_that_fails_is_a_row_with_its_error(small, tmp_path):
    small["vary"] |= {"gain_factor.damping": [1.0, 1e9], "initial_offset.each": {"uniform": [-0.1, 0.1]}}
    small["run"] |= {"torque_limit": False}
    small["measures"] = ["final_error", "tests.sweeps.tasks:often_wrong"]
    results = Sweep(**small).run(tmp_path / "out", engine=InThisProcess())
    errors, wild = results.column("error"), results.column("gain_factor.damping") > 1.0
    assert 0 < wild.sum() < len(results)
    assert all("diverged" in error for error in errors[wild])
    assert np.isnan(results.column("final_error")[wild]).all()
    ours = (results.column("initial_offset." + Sweep(**small).nominal.robot.joint_names[0]) > 0.0) & ~wild
    assert all(error == "often_wrong: KeyError: 'no such thing'" for error in errors[ours])
    assert np.isfinite(results.column("final_error")[ours]).all()
    assert set(errors[~ours & ~wild]) == {""}
    assert set(results.worst("final_error", int(results.failed.sum()))) == set(np.flatnonzero(results.failed))


def test_processes_that_die_leave_what_others_did(small, tmp_path):
    small["measures"] = ["tests.sweeps.tasks:kills_its_process"]
    with pytest.raises(EngineError, match=r"3 of 3 parts are missing.*killed by signal 9"):
        Sweep(**small).run(tmp_path / "out", workers=1)
    assert list((tmp_path / "out" / "parts").iterdir()) == []


def test_folders_of_others_are_left_alone(small, tmp_path):
    sweep = Sweep(**small)
    sweep.run(tmp_path / "out", engine=InThisProcess())
    other = Sweep(**(small | {"sampling": small["sampling"] | {"seed": 4}}))
    with pytest.raises(
        DataFileError, match=r"holds another sweep \(12 runs of force_feedback_measured on pera_shoulder"
    ):
        other.run(tmp_path / "out")
    manifest = tmp_path / "out" / "sweep.json"
    manifest.write_text(manifest.read_text().replace('"phcontrol": "', '"phcontrol": "0.0.1+'))
    with pytest.raises(DataFileError, match=r"was begun by phcontrol 0\.0\.1\+"):
        sweep.run(tmp_path / "out")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("keep me")
    with pytest.raises(DataFileError, match="letter.txt, and is not of a sweep"):
        sweep.run(tmp_path / "mine")
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["letter.txt"]
    for text in ("", "[]", "{}", '{"format": 99, "hash": "", "phcontrol": "", "sweep": {}, "columns": {}}'):
        manifest.write_text(text)
        with pytest.raises(DataFileError):
            SweepResults.read(tmp_path / "out")
    with pytest.raises(DataFileError, match=r"is not of a sweep: it has no sweep\.json"):
        SweepResults.read(tmp_path)


def test_another_phcontrol_is_refused(small):
    sweep = Sweep(**small)
    with pytest.raises(EngineError, match="a worker has phcontrol .*, and the sweep 0.0.1: install the same on all"):
        run_chunk(Chunk(sweep.given, sweep.hash, 0, 1, True, "0.0.1"))


def test_a_statement_is_exact():
    """For k good of n it is the p at which so many or more have the probability 5 %."""
    from scipy.stats import binom

    for good, runs in ((1, 10), (7, 10), (997, 1000), (10, 10)):
        found = Statement(good, runs)
        assert abs(binom.sf(good - 1, runs, found.at_least) - 0.05) < 1e-9
        if good < runs:
            assert abs(binom.cdf(good, runs, found.at_most) - 0.05) < 1e-9
    assert Statement(0, 10).at_least == 0.0
    assert Statement(10, 10).at_most == 1.0
    # rounded down, so that what is said is true
    assert "at least 99.70 %" in str(Statement(1000, 1000))
    assert (
        float(str(Statement(99990, 100000)).split("at least ")[1].split()[0]) <= 100 * Statement(99990, 100000).at_least
    )


# --- killed --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def spec(tmp_path_factory):
    path = tmp_path_factory.mktemp("spec") / "sweep.toml"
    path.write_text(SPEC)
    return path


@pytest.fixture(scope="module")
def undisturbed(spec, tmp_path_factory):
    return Sweep.read(spec).run(tmp_path_factory.mktemp("undisturbed") / "out", engine=InThisProcess())


def command(*arguments):
    code = "import sys; from phcontrol.cli import main; sys.argv[0] = 'phcontrol'; main()"
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)], env=environment, cwd=ROOT, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip


def wait_for_parts(folder, count, process):
    for _ in range(1200):
        parts = list((folder / "parts").glob("runs-*.parquet")) if (folder / "parts").is_dir() else []
        if len(parts) >= count:
            return len(parts)
        assert process.poll() is None, process.stdout.read()
        time.sleep(0.05)
    raise AssertionError("no parts came")


def test_a_sweep_that_was_killed_goes_on(spec, undisturbed, tmp_path):
    folder = tmp_path / "out"
    process = command("sweep", spec, "--out", folder, "--workers", 1)
    wait_for_parts(folder, 2, process)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    found = SweepResults.read(folder)
    assert 8 <= len(found) < 48
    assert not found.finished
    again = command("sweep", spec, "--out", folder, "--workers", 2)
    said = again.communicate()[0]
    assert again.returncode == 0, said
    assert "48 of 48 runs, 0 failed" in said
    same(SweepResults.read(folder), undisturbed)


class Cluster:
    """A Dask scheduler and workers, each a process of its own on loopback.

    Args:
        folder: for what they write.
        packages: for each worker, the folder in which it finds phcontrol.
    """

    def __init__(self, folder, packages):
        self._folder, self.workers = folder, []
        place = folder / "scheduler.json"
        self._scheduler = self._started(
            "scheduler", ROOT, "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--dashboard-address", "",
            "--scheduler-file", str(place),
        )  # fmt: skip
        for package in packages:
            self.add(package)
        for _ in range(600):
            if place.is_file() and place.read_text().strip().endswith("}"):
                break
            time.sleep(0.1)
        self.address = json.loads(place.read_text())["address"]

    def add(self, package):
        """Start a worker."""
        own = self._folder / f"worker-{len(self.workers)}"
        self.workers.append(
            self._started(
                "worker", package, "--scheduler-file", str(self._folder / "scheduler.json"), "--host", "127.0.0.1",
                "--nthreads", "1", "--no-nanny", "--no-dashboard", "--death-timeout", "60", "--local-directory",
                str(own),
            )
        )  # fmt: skip

    @staticmethod
    def _started(kind, package, *arguments):
        environment = os.environ | {"PYTHONPATH": str(package), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": environment, "cwd": package}
        return subprocess.Popen([sys.executable, "-m", f"distributed.cli.dask_{kind}", *arguments], **quiet)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        processes = (*self.workers, self._scheduler)
        for process in processes:
            process.terminate()
        for process in processes:
            try:
                process.wait(20.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@pytest.fixture
def another_version(tmp_path):
    """Return a folder with a phcontrol that is the same, but for its version."""
    folder = tmp_path / "another"
    shutil.copytree(ROOT / "phcontrol", folder / "phcontrol", ignore=shutil.ignore_patterns("__pycache__"))
    path = folder / "phcontrol" / "_version.py"
    text = path.read_text()
    path.write_text(text.replace(f'__version__ = "{__version__}"', '__version__ = "0.0.1"'))
    assert path.read_text() != text
    return folder


def test_a_worker_of_another_version_is_refused(spec, another_version, tmp_path):
    """A worker that is there from the start, and one that comes when the sweep has begun."""
    with Cluster(tmp_path, [another_version]) as cluster:
        said = f"phcontrol 0.0.1, and this is {__version__}: install the same on all"
        with pytest.raises(EngineError, match=said):
            DaskScheduler(cluster.address, timeout=60.0)
        result = CliRunner().invoke(
            app, ["sweep", str(spec), "--out", str(tmp_path / "o"), "--scheduler", cluster.address]
        )
        assert result.exit_code == 2
        assert said in result.output
        assert not list((tmp_path / "o").rglob("*.parquet"))


def test_a_worker_of_another_version_that_comes_late_is_refused(small, another_version, tmp_path):
    with Cluster(tmp_path, [ROOT]) as cluster, DaskScheduler(cluster.address, timeout=60.0) as engine:
        cluster.add(another_version)
        for _ in range(600):
            if len(engine._client.nthreads()) == 2:
                break
            time.sleep(0.1)
        cluster.workers[0].kill()
        cluster.workers[0].wait()
        with pytest.raises(EngineError, match=f"a worker has phcontrol 0.0.1, and the sweep {__version__}: install"):
            Sweep(**small).run(tmp_path / "o", engine=engine)
        assert not list((tmp_path / "o").rglob("*.parquet"))


@pytest.fixture
def cluster(tmp_path):
    """Return a Dask scheduler and two workers: address and workers."""
    with Cluster(tmp_path, [ROOT, ROOT]) as found:
        yield found.address, found.workers


def test_a_worker_and_the_client_are_killed_on_dask(spec, undisturbed, cluster, tmp_path):
    address, workers = cluster
    folder = tmp_path / "out"
    process = command("sweep", spec, "--out", folder, "--scheduler", address)
    wait_for_parts(folder, 2, process)
    workers[0].send_signal(signal.SIGKILL)
    wait_for_parts(folder, 4, process)  # the other goes on
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert 16 <= len(SweepResults.read(folder)) < 48
    again = command("sweep", spec, "--out", folder, "--scheduler", address)
    said = again.communicate()[0]
    assert again.returncode == 0, said
    assert "48 of 48 runs, 0 failed" in said
    same(SweepResults.read(folder), undisturbed)


def test_a_scheduler_that_is_not_there(spec, tmp_path):
    result = CliRunner().invoke(
        app, ["sweep", str(spec), "--out", str(tmp_path / "o"), "--scheduler", "tcp://127.0.0.1:9"]
    )
    assert result.exit_code == 2
    assert "no Dask scheduler answers at tcp://127.0.0.1:9" in result.output
    with pytest.raises(EngineError, match="no Dask scheduler answers at nonsense://x"):
        DaskScheduler("nonsense://x", timeout=1.0)


# --- the command line ----------------------------------------------------------------------------------------------


def test_the_example_and_its_report(tmp_path, monkeypatch):
    """The shipped specification, with fewer runs; the page; a run that is replayed has the measures of its row."""
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "examples" / "sweep.toml").read_text()
    assert "runs = 128" in text
    Path("sweep.toml").write_text(text.replace("runs = 128", "runs = 8"))
    result = CliRunner().invoke(app, ["sweep", "sweep.toml", "--out", "out", "--workers", "1"])
    assert result.exit_code == 0, result.output
    assert "8 of 8 runs, 0 failed" in result.output
    assert "95 % sure that at least" in result.output
    result = CliRunner().invoke(app, ["sweep-report", "out", "--spec", "sweep.toml"])
    assert result.exit_code == 0, result.output
    page = Path("out/report.html").read_text()
    results = SweepResults.read("out")
    worst = results.worst("final_error", 1)[0]
    assert f"phcontrol sweep sweep.toml --replay {worst} --of {results.manifest['hash'][:8]}</code>" in page
    assert "exact for independent draws, for a Sobol sequence not proved" in page
    for picture in ("maps.png", "quantiles.png"):
        assert Path("out", picture).read_bytes()[:4] == b"\x89PNG"
    again = re.search(rf"phcontrol (sweep sweep.toml --replay {worst} --of \w+)</code>", page)[1].split()
    result = CliRunner().invoke(app, again)
    assert result.exit_code == 0, result.output
    assert len(Log.load(f"run-{worst}.npz")) == 1001
    said = dict(line.split() for line in result.output.splitlines() if len(line.split()) == 2)
    for name in results.measures:
        assert float(said[name]) == pytest.approx(results.column(name)[worst], rel=1e-7)
    for name in results.parameters:
        assert float(said[name]) == pytest.approx(results.column(name)[worst], rel=1e-7)
    # other gains in the file make other runs: not those of the report, and not done in their name
    assert "bandwidth = 10.0" in text
    Path("sweep.toml").write_text(text.replace("runs = 128", "runs = 8").replace("bandwidth = 10.0", "bandwidth = 5.0"))
    result = CliRunner().invoke(app, again)
    assert result.exit_code == 2
    assert "is not the sweep that sweep.toml describes now" in result.output
    result = CliRunner().invoke(app, again[:4])
    other = dict(line.split() for line in result.output.splitlines() if len(line.split()) == 2)
    assert float(other["final_error"]) > 1.05 * float(said["final_error"])
    assert other["payload_mass"] == said["payload_mass"]


@pytest.mark.parametrize(
    ("text", "arguments", "words"),
    [
        ("measures = [", [], "cannot read"),
        ("measures = ['final_error']", [], "vary: must be given in"),
        (SPEC + "\n[weather]\nrain = 1", [], "unknown part 'weather'"),
        (SPEC.replace("payload_mass", "payload_maas"), [], "Did you mean 'payload_mass'"),
        (SPEC.replace("uniform = [0.0, 0.5]", "distribution = 'norm'"), [], "must be >= 0 kg"),
        (SPEC, ["--replay", "48"], "must be below 48"),
        (SPEC, ["--replay", "1", "--workers", "2"], "takes neither --workers nor --scheduler"),
        (SPEC, ["--out", "o", "--of", "1a"], "--of: goes with --replay"),
        (SPEC, [], "--out: must be given"),
        (SPEC, ["--out", "o", "--workers", "1", "--scheduler", "tcp://x:1"], "leave out --workers"),
    ],
)
def test_what_is_wrong_is_one_line(text, arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("spec.toml").write_text(text)
    result = CliRunner().invoke(app, ["sweep", "spec.toml", *arguments])
    assert result.exit_code == 2, result.output
    assert words in result.output
    assert "Traceback" not in result.output


def test_a_report_of_runs_of_which_some_failed_and_some_are_infinite(small, tmp_path):
    small["measures"] = ["settling_time", "final_error"]
    sweep = Sweep(**small, require={"settling_time": 1.0})
    folder = tmp_path / "out"
    sweep.run(folder, engine=InThisProcess())
    part = folder / "parts" / "runs-0000000000.parquet"
    table = parquet.read_table(part)
    columns = {name: table.column(name).to_pylist() for name in table.column_names}
    columns["settling_time"] = [float("inf"), 0.1, float("nan"), float("nan")]
    columns["final_error"] = [1.0, 0.1, float("nan"), float("nan")]
    columns["error"] = ["", "", "stopped at t = 0.1 s: <b>", "stopped at t = 0.2 s: <b>"]
    parquet.write_table(arrow.table(columns).replace_schema_metadata(table.schema.metadata), part)
    result = CliRunner().invoke(app, ["sweep-report", str(folder)])
    assert result.exit_code == 0, result.output
    page = (folder / "report.html").read_text()
    assert "<td>2</td><td>2</td><td>stopped at t = … s: &lt;b&gt;</td>" in page
    assert "inf" in page
    assert SweepResults.read(folder).worst("settling_time", 2) == [2, 3]


def test_workers_are_those_of_the_engine(small, tmp_path):
    with pytest.raises(ValueError, match="workers: are those of the engine"):
        Sweep(**small).run(tmp_path / "out", engine=LocalProcesses(1), workers=2)
