"""The command line: ``phcontrol run``, ``certify``, ``robots``, ``controllers``."""

from __future__ import annotations

import functools
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, ParamSpec, TypeVar

import typer

from phcontrol._version import __version__
from phcontrol.analysis.certificate import certify as make_certificate
from phcontrol.controllers.registry import CONTROLLERS, make_controller
from phcontrol.exceptions import (
    DataFileError,
    InvalidArgumentError,
    PHControlError,
    SimulationError,
    SimulationInterrupted,
)
from phcontrol.experiments.position import run_position
from phcontrol.experiments.registry import STUDIES, run_study
from phcontrol.experiments.servo import run_servo
from phcontrol.mechanics.catalogue import example_robots, shipped_robots
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.state import INTERCONNECTIONS
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.simulation.integrators import INTEGRATORS

app = typer.Typer(
    help="Energy-based control of robot arms, with a certificate for every controller.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
)
run_app = typer.Typer(
    help="Run a study; writes its log, picture and figures.", no_args_is_help=True, rich_markup_mode=None
)
app.add_typer(run_app, name="run")

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

RobotOption = Annotated[str, typer.Option(help="A shipped robot, a URDF file, or a name of example-robot-data.")]
LockOption = Annotated[list[str] | None, typer.Option(help="Joint to lock at home; may be repeated.", metavar="JOINT")]
FormOption = Annotated[str, typer.Option(help=f"Which J2 the law uses: {' or '.join(INTERCONNECTIONS)}.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", help="A gain or option of the law; may be repeated.", metavar="NAME=VALUE"),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]


def reports_errors(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Turn our own errors into one line on stderr and exit code 2."""

    @functools.wraps(command)
    def wrapped(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        try:
            return command(*args, **kwargs)
        except PHControlError as error:
            typer.echo(f"error: {' '.join(str(error).split())}", err=True)
            raise typer.Exit(130 if isinstance(error, SimulationInterrupted) else 2) from error

    return wrapped


@app.callback(invoke_without_command=True)
def version_option(
    context: typer.Context, version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False
) -> None:
    """Energy-based control of robot arms, with a certificate for every controller."""
    if version:
        typer.echo(f"phcontrol {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@run_app.command("position")
@reports_errors
def run_position_command(
    robot: RobotOption = "pera",
    controller: Annotated[
        str, typer.Option(help="A law that holds a position; see 'phcontrol controllers'.")
    ] = "force_feedback",
    interconnection: FormOption = "coriolis",
    goal: Annotated[
        str | None,
        typer.Option(help="Angles [rad], comma-separated, or joint=angle pairs. Default: a reachable posture."),
    ] = None,
    duration: Annotated[float, typer.Option(help="Simulated time [s].")] = 10.0,
    dt: Annotated[float, typer.Option(help="Step of the integrator [s].")] = 1e-3,
    integrator: Annotated[str, typer.Option(help=f"One of {', '.join(INTEGRATORS)}.")] = "rk4",
    control_period: Annotated[
        float | None, typer.Option(help="Hold the torque for this long [s]. Default: continuous control.")
    ] = None,
    lock: LockOption = None,
    settings: SetOption = None,
    samples: Annotated[int, typer.Option(help="States at which the law is certified.")] = 50,
    out: Annotated[Path, typer.Option(help="Folder for log, picture and certificate.")] = Path("results/position"),
) -> None:
    """Take an arm from its home to a posture, and certify the law that does it."""
    system = MechanicalSystem(load_robot(robot, locked_joints=lock or []))
    _check_writable(out)
    try:
        result = run_position(
            system,
            controller=controller,
            goal=None if goal is None else _goal(goal),
            duration=duration,
            interconnection=interconnection,
            samples=samples,
            options=_settings(settings),
            dt=dt,
            integrator=integrator,
            control_period=control_period,
        )
    except SimulationError as error:
        if len(error.log):
            typer.echo(f"kept the log so far in {error.log.save(out / 'log-stopped.npz')}", err=True)
        raise
    typer.echo(result.summary())
    typer.echo("\nwrote " + ", ".join(str(path) for path in result.write(out)))
    if not result.certificate.passed:
        raise typer.Exit(1)


@run_app.command("servo")
@reports_errors
def run_servo_command(
    robot: RobotOption = "pera",
    controller: Annotated[str, typer.Option(help="reduction_servo or hamiltonian_servo.")] = "hamiltonian_servo",
    interconnection: FormOption = "coriolis",
    start: Annotated[
        str, typer.Option(help="Where the object is in the image at home: mu,nu,l [m].")
    ] = "0.004,0.003,0.0028",
    goal: Annotated[str, typer.Option(help="Where it should be: mu,nu,l [m].")] = "0,0,0.002",
    duration: Annotated[float, typer.Option(help="Simulated time [s].")] = 6.0,
    dt: Annotated[float, typer.Option(help="Step of the integrator [s].")] = 2e-3,
    camera_rate: Annotated[
        float | None, typer.Option(help="Frames in a second [Hz], one late. Default: features at every instant.")
    ] = None,
    lock: LockOption = None,
    settings: SetOption = None,
    samples: Annotated[int, typer.Option(help="States at which the law is certified.")] = 50,
    out: Annotated[Path, typer.Option(help="Folder for log, picture and certificate.")] = Path("results/servo"),
) -> None:
    """Bring an object to where it should be in the image of a camera in the hand, and certify the law that does it."""
    system = MechanicalSystem(load_robot(robot, locked_joints=lock or []))
    _check_writable(out)
    result = run_servo(
        system,
        controller=controller,
        start=_numbers("--start", start),
        goal=_numbers("--goal", goal),
        interconnection=interconnection,
        samples=samples,
        camera_rate=camera_rate,
        options=_settings(settings),
        duration=duration,
        dt=dt,
    )
    typer.echo(result.summary())
    typer.echo("\nwrote " + ", ".join(str(path) for path in result.write(out)))
    if not result.certificate.passed:
        raise typer.Exit(1)


def _add_study(name: str, summary: str) -> None:
    @run_app.command(name, help=f"Run {summary}; write figures, logs and claims.json.", short_help=summary)
    @reports_errors
    def command(out: Annotated[Path | None, typer.Option(help="Folder. Default: results/NAME.")] = None) -> None:
        folder = Path("results") / name if out is None else out
        _check_writable(folder)
        outcome = run_study(name)
        typer.echo(outcome.summary())
        typer.echo("\nwrote " + ", ".join(str(path) for path in outcome.write(folder)))


for _name, _study in STUDIES.items():
    _add_study(_name, _study.summary)


@app.command()
@reports_errors
def certify(
    controller: Annotated[str, typer.Option(help="A law, or 'all'.")] = "all",
    robot: RobotOption = "pera",
    interconnection: Annotated[str, typer.Option(help=f"{', '.join(INTERCONNECTIONS)} or all.")] = "all",
    samples: Annotated[int, typer.Option(help="Number of random states.")] = 50,
    seed: Annotated[int, typer.Option(help="Seed of the random states.")] = 0,
    lock: LockOption = None,
    settings: SetOption = None,
    as_json: JsonOption = False,
) -> None:
    """Prove numerically that a law's closed loop is the system it claims. Exit code 1 if it is not."""
    system = MechanicalSystem(load_robot(robot, locked_joints=lock or []))
    names = list(CONTROLLERS) if controller == "all" else [controller]
    forms = list(INTERCONNECTIONS) if interconnection == "all" else [interconnection]
    certificates, labels, left_out = [], [], []
    for name in names:
        try:
            laws = [make_controller(name, system, interconnection=form, **_settings(settings)) for form in forms]
        except InvalidArgumentError as error:
            if controller != "all" or settings:
                raise
            left_out.append(f"{name} is not for this arm: {error}")
            continue
        certificates += [make_certificate(law, system, samples=samples, seed=seed) for law in laws]
        labels += [name for _ in laws]
    if as_json:
        typer.echo(
            json.dumps(
                [item.to_dict() | {"law": label} for label, item in zip(labels, certificates, strict=True)], indent=2
            )
        )
    elif len(certificates) == 1:
        typer.echo(str(certificates[0]))
    else:
        typer.echo(f"{system.robot.name}, {system.n} joints, {samples} states, seed {seed}")
        typer.echo(f"{'law':<26}{'J2':<11}{'matching':>10}{'skewness':>10}{'min R_d':>10}{'max dH_d':>10}  verdict")
        for label, item in zip(labels, certificates, strict=True):
            typer.echo(
                f"{label:<26}{item.interconnection:<11}{item.matching_residual:>10.1e}{item.skewness:>10.1e}"
                f"{item.smallest_dissipation:>10.1e}{item.largest_storage_rate:>10.1e}  "
                + ("passed" if item.passed else "FAILED")
            )
        for line in left_out:
            typer.echo(line)
    if not all(item.passed for item in certificates):
        raise typer.Exit(1)


@app.command()
@reports_errors
def robots(as_json: JsonOption = False) -> None:
    """List the robots that can be named; a path to any URDF file works too."""
    rows = [
        {"name": name, "source": "phcontrol", "fixed_base": True, "title": title}
        for name, title in shipped_robots().items()
    ]
    rows += [
        {"name": name, "source": "example-robot-data", "fixed_base": not floating, "title": ""}
        for name, floating in example_robots().items()
    ]
    if as_json:
        typer.echo(json.dumps(rows, indent=2))
        return
    for row in rows:
        if row["source"] == "phcontrol":
            typer.echo(f"{row['name']:<22}{row['title']}")
    names = [str(row["name"]) for row in rows if row["source"] != "phcontrol" and row["fixed_base"]]
    typer.echo(f"\nfrom example-robot-data (fixed base): {', '.join(names)}")


@app.command()
@reports_errors
def controllers(as_json: JsonOption = False) -> None:
    """List the laws, where each comes from, and what it needs measured."""
    if as_json:
        rows = [
            {"name": name, "summary": entry.summary, "source": entry.source, "needs": entry.needs}
            for name, entry in CONTROLLERS.items()
        ]
        typer.echo(json.dumps(rows, indent=2, ensure_ascii=False))
        return
    for name, entry in CONTROLLERS.items():
        typer.echo(f"{name}\n    {entry.summary}\n    from {entry.source}; needs {entry.needs}")


def main() -> None:
    """Entry point of the ``phcontrol`` command."""
    try:
        app()
    except BrokenPipeError:  # the reader of our output has gone
        sys.stderr.close()
        sys.exit(1)


def _goal(text: str) -> dict[str, float] | list[float]:
    parts = [part.strip() for part in text.split(",") if part.strip()]
    try:
        if all("=" in part for part in parts):
            return {name.strip(): float(value) for name, value in (part.split("=", 1) for part in parts)}
        return [float(part) for part in parts]
    except ValueError as error:
        raise InvalidArgumentError(
            "--goal", f"must be angles like 0.1,0.2 or pairs like elbow=0.3, but is '{text}'"
        ) from error


def _numbers(option: str, text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError as error:
        raise InvalidArgumentError(option, f"must be numbers like 0,0,0.002, but is '{text}'") from error


def _settings(pairs: list[str] | None) -> dict[str, Any]:
    settings: dict[str, Any] = {}
    for pair in pairs or []:
        name, separator, value = pair.partition("=")
        if not separator:
            raise InvalidArgumentError("--set", f"must be NAME=VALUE, but is '{pair}'")
        try:
            settings[name.strip()] = json.loads(value)
        except json.JSONDecodeError as error:
            message = f"'{name}' must be a number, a list like [1, 2], true or false, but is '{value}'"
            raise InvalidArgumentError("--set", message) from error
    return settings


def _check_writable(folder: Path) -> None:
    """Find out before a long run, not after it, that its results cannot be written."""
    from phcontrol._files import write_atomically

    probe = folder / ".phcontrol-probe"
    try:
        write_atomically(probe, lambda file: None)
        probe.unlink()
    except (DataFileError, OSError) as error:
        raise DataFileError(f"cannot write to --out {folder}: {error}") from error


if __name__ == "__main__":
    main()
