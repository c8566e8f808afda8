"""The command line: ``phcontrol run``, ``certify``, ``robots``, ``controllers``."""

from __future__ import annotations

import functools
import inspect
import io
import json
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, ParamSpec, TypeVar, get_type_hints

import typer

from phcontrol._files import check_file_place, check_folder
from phcontrol._validation import Array, choice
from phcontrol._version import __version__
from phcontrol.analysis.certify import SAMPLES
from phcontrol.analysis.certify import certify as make_certificate
from phcontrol.controllers.registry import CONTROLLERS, make_controller
from phcontrol.controllers.trajectory_tracking import TrajectoryTracking, swing
from phcontrol.controllers.visual_servo import VisualServo
from phcontrol.exceptions import (
    DataFileError,
    InvalidArgumentError,
    PHControlError,
    SimulationError,
    SimulationInterrupted,
)
from phcontrol.mechanics.catalogue import example_robots, shipped_robots
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.robot import Robot, check_joint_names
from phcontrol.mechanics.state import INTERCONNECTIONS
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.runs.certificate_survey import SurveyRow, every_arm, markdown, survey
from phcontrol.runs.position import PositionRun, run_position
from phcontrol.runs.servo import run_servo
from phcontrol.sensors.momentum_observer import MomentumObserver
from phcontrol.simulation.integrators import INTEGRATORS
from phcontrol.simulation.log import Log
from phcontrol.thesis.registry import STUDIES, run_study
from phcontrol.trajectories import inverse_kinematics
from phcontrol.trajectories.files import read_trajectory
from phcontrol.trajectories.minimum_jerk import MinimumJerk
from phcontrol.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from phcontrol.visualization.live import LiveView

ALL_FORMS = tuple(dict.fromkeys(form for entry in CONTROLLERS.values() for form in entry.law.forms))

app = typer.Typer(
    help="Energy-based control of robot arms, with a certificate for every controller.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
)
run_app = typer.Typer(
    help="Run a law on any arm, or a study; writes logs and pictures.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(run_app, name="run")

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

RobotOption = Annotated[str, typer.Option(help="A shipped robot, a URDF file, or a name of example-robot-data.")]
LockOption = Annotated[list[str] | None, typer.Option(help="Joint to lock at home; may be repeated.", metavar="JOINT")]
FormOption = Annotated[str, typer.Option(help=f"Which J2 the law uses: {' or '.join(INTERCONNECTIONS)}.")]
ArmatureOption = Annotated[
    str | None,
    typer.Option(help="Reflected rotor inertia [kg m²]: one number, one each joint, or joint=value pairs."),
]
StepOption = Annotated[
    float | None, typer.Option(help="Step of the integrator [s]. Default: 1 ms, or less if friction asks for it.")
]
ReachOption = Annotated[
    str | None,
    typer.Option(help="Goal for a frame instead of the joints: a point x,y,z in the world [m] (needs Pink)."),
]
FrameOption = Annotated[str | None, typer.Option(help="The frame of --reach. Default: the tool, or the last frame.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", help="A gain or option of the law; may be repeated.", metavar="NAME=VALUE"),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]
ViewOption = Annotated[bool, typer.Option("--view", help="Watch in a browser, at the pace of the clock.")]
RecordOption = Annotated[
    Path | None, typer.Option(help="Write a page that plays the run, to be opened offline.", metavar="FILE.html")
]
PortOption = Annotated[
    int | None,
    typer.Option(
        min=0, max=65535, help="To serve the view on; 0 for any free one. Default: the first free one from 7000."
    ),
]


NOT_SET = ("system", "name", "cls", "camera")
"""What a law is made with that no text can be."""


class Showing(NamedTuple):
    """How a run is to be shown."""

    view: bool = False
    record: Path | None = None
    port: int | None = None


def reports_errors(command: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Turn our own errors into one line on stderr and exit code 2."""

    @functools.wraps(command)
    def wrapped(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        try:
            return command(*args, **kwargs)
        except PHControlError as error:
            typer.echo(f"error: {_one_line(str(error))}", err=True)
            raise typer.Exit(130 if isinstance(error, SimulationInterrupted) else 2) from error

    return wrapped


def _one_line(text: str) -> str:
    """Return a message in one line, without what a terminal would obey: parts of it may come from a file."""
    return "".join(letter if letter.isprintable() else "?" for letter in " ".join(text.split()))


@app.callback(invoke_without_command=True)
def version_option(
    context: typer.Context, version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False
) -> None:
    """Energy-based control of robot arms, with a certificate for every controller."""
    for stream in (sys.stdout, sys.stderr):  # a file's name may hold what is no text
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    if version:
        typer.echo(f"phcontrol {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def run_arm(
    controller: Annotated[
        str, typer.Option(help="A law that holds a position; see 'phcontrol controllers'.")
    ] = "force_feedback",
    robot: RobotOption = "pera",
    interconnection: FormOption = "coriolis",
    goal: Annotated[
        str | None,
        typer.Option(help="Angles [rad], comma-separated, or joint=angle pairs. Default: a reachable posture."),
    ] = None,
    reach: ReachOption = None,
    frame: FrameOption = None,
    duration: Annotated[float, typer.Option(help="Simulated time [s].")] = 10.0,
    dt: StepOption = None,
    integrator: Annotated[str, typer.Option(help=f"One of {', '.join(INTEGRATORS)}.")] = "rk4",
    control_period: Annotated[
        float | None, typer.Option(help="Hold the torque for this long [s]. Default: continuous control.")
    ] = None,
    lock: LockOption = None,
    armature: ArmatureOption = None,
    settings: SetOption = None,
    samples: Annotated[int, typer.Option(help="States at which the law is certified.")] = SAMPLES,
    out: Annotated[Path | None, typer.Option(help="Folder for log, picture and certificate.")] = None,
    view: ViewOption = False,
    record: RecordOption = None,
    port: PortOption = None,
) -> None:
    """Take an arm from its home to a posture, and certify the law that does it."""
    system = _system(robot, lock, armature)
    _run_and_write(
        system,
        Path("results/position") if out is None else out,
        Showing(view, record, port),
        controller=controller,
        goal=_goal(system, goal, reach, frame),
        duration=duration,
        interconnection=interconnection,
        samples=samples,
        options=_settings(settings, "goal", "interconnection"),
        dt=dt,
        integrator=integrator,
        control_period=control_period,
    )


def _run_and_write(
    system: MechanicalSystem,
    folder: Path,
    showing: Showing,
    study: Callable[..., PositionRun] = run_position,
    **arguments: Any,
) -> None:
    _check_writable(folder, showing.record)
    with _watching(showing) as watch:
        result = _run(study, system, folder, watch=watch, **arguments)
        typer.echo(result.summary())
        typer.echo("\nwrote " + ", ".join(str(path) for path in result.write(folder)))
        _record({"": result.log}, showing.record)
        if watch is not None:
            watch.linger(result.log)
    if not result.certificate.passed:
        raise typer.Exit(1)


def _run(study: Callable[..., PositionRun], system: MechanicalSystem, folder: Path, **arguments: Any) -> PositionRun:
    """Run, and when the run fails keep what there is of its log."""
    try:
        return study(system, **arguments)
    except SimulationError as error:
        if len(error.log):
            typer.echo(f"kept the log so far in {error.log.save(folder / 'log-stopped.npz')}", err=True)
        raise


run_app.command("position")(reports_errors(run_arm))


@run_app.command("track", short_help="Follow a trajectory with any arm, and certify the law that does it.")
@reports_errors
def track(
    robot: RobotOption = "pera",
    trajectory: Annotated[
        str,
        typer.Option(
            help="'swing' from home to the goal and back for ever, 'reach' the goal by minimum jerk, or a CSV file of "
            "times [s] and joint positions [rad], one row an instant."
        ),
    ] = "swing",
    goal: Annotated[
        str | None, typer.Option(help="Angles [rad] or joint=angle pairs. Default: a posture near home.")
    ] = None,
    speed: Annotated[float, typer.Option(help="Largest fraction of the velocity limits (swing, reach).")] = 0.5,
    external_force: Annotated[
        str, typer.Option(help="What the law knows of it: none, measured, or observed (momentum observer).")
    ] = "none",
    push: Annotated[str | None, typer.Option(help="Constant external force on the joints [N·m], as --goal.")] = None,
    interconnection: Annotated[
        str, typer.Option(help=f"Which J2 the law uses: {', '.join(TrajectoryTracking.forms)}.")
    ] = "coriolis",
    reach: ReachOption = None,
    frame: FrameOption = None,
    duration: Annotated[float, typer.Option(help="Simulated time [s].")] = 10.0,
    dt: StepOption = None,
    control_period: Annotated[
        float | None,
        typer.Option(help="Hold the torque for this long [s]; it is computed for the middle of that time."),
    ] = None,
    lock: LockOption = None,
    armature: ArmatureOption = None,
    settings: SetOption = None,
    samples: Annotated[int, typer.Option(help="States at which the law is certified.")] = SAMPLES,
    out: Annotated[Path, typer.Option(help="Folder for log, picture and certificate.")] = Path("results/track"),
    view: ViewOption = False,
    record: RecordOption = None,
    port: PortOption = None,
) -> None:
    """Follow a trajectory with any arm; say what it asks of the joints, and certify the law."""
    system = _system(robot, lock, armature)
    wished = _goal(system, goal, reach, frame)
    posture = system.robot.near_home() if wished is None else wished
    knowledge = choice("external force", external_force, ("none", "measured", "observed"))
    _run_and_write(
        system,
        out,
        Showing(view, record, port),
        controller="tracking" if knowledge == "none" else "tracking_measured",
        goal=posture,
        duration=duration,
        interconnection=interconnection,
        samples=samples,
        options={"trajectory": _trajectory(trajectory, system, posture, speed), "hold": control_period or 0.0}
        | _settings(settings, "goal", "interconnection"),
        dt=dt,
        control_period=control_period,
        disturbance=None if push is None else _joint_values(system, "--push", push),
        sensors=[MomentumObserver(system)] if knowledge == "observed" else None,
    )


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
    armature: ArmatureOption = None,
    settings: SetOption = None,
    samples: Annotated[int, typer.Option(help="States at which the law is certified.")] = SAMPLES,
    out: Annotated[Path, typer.Option(help="Folder for log, picture and certificate.")] = Path("results/servo"),
    view: ViewOption = False,
    record: RecordOption = None,
    port: PortOption = None,
) -> None:
    """Bring an object to where it should be in the image of a camera in the hand, and certify the law that does it."""
    _run_and_write(
        _system(robot, lock, armature),
        out,
        Showing(view, record, port),
        study=run_servo,
        controller=controller,
        start=_numbers("--start", start),
        goal=_numbers("--goal", goal),
        interconnection=interconnection,
        samples=samples,
        camera_rate=camera_rate,
        options=_settings(settings, "goal", "interconnection"),
        duration=duration,
        dt=dt,
    )


def _add_law(name: str, summary: str, general: Callable[..., None]) -> None:
    """Make ``run NAME`` of ``run position`` or ``run servo``: the same options but --controller."""
    signature, hints = inspect.signature(general), get_type_hints(general, include_extras=True)

    def command(out: Path | None = None, **arguments: Any) -> None:
        general(controller=name, out=Path("results") / name if out is None else out, **arguments)

    command.__signature__ = signature.replace(  # type: ignore[attr-defined]
        parameters=[
            parameter.replace(annotation=hints[key])
            for key, parameter in signature.parameters.items()
            if key != "controller"
        ]
    )
    command.__annotations__ = {key: hint for key, hint in hints.items() if key != "controller"}
    wrapped = reports_errors(command)
    run_app.command(name, help=f"Run an arm under {name}: {summary}.", short_help=f"law: {summary}")(wrapped)


for _name, _entry in CONTROLLERS.items():
    _add_law(_name, _entry.summary, run_servo_command if issubclass(_entry.law, VisualServo) else run_arm)


def _add_study(name: str, summary: str) -> None:
    @run_app.command(name, help=f"Run {summary}; write figures, logs and claims.json.", short_help=summary)
    @reports_errors
    def command(
        out: Annotated[Path | None, typer.Option(help="Folder. Default: results/NAME.")] = None,
        view: Annotated[bool, typer.Option("--view", help="Then play its runs in a browser.")] = False,
        record: RecordOption = None,
        port: PortOption = None,
    ) -> None:
        folder = Path("results") / name if out is None else out
        _check_writable(folder, record)
        if not view:
            _check_port_is_used(port)
        outcome = run_study(name)
        typer.echo(outcome.summary())
        typer.echo("\nwrote " + ", ".join(str(path) for path in outcome.write(folder)))
        _record(outcome.logs, record)
        if view:
            _show(outcome.logs, port)


for _name, _study in STUDIES.items():
    _add_study(_name, _study.summary)


@app.command("view")
@reports_errors
def view_command(
    log: Annotated[Path, typer.Argument(help="A log that a run wrote (.npz).")],
    robot: Annotated[
        str | None,
        typer.Option(help="The log's arm, as in 'run': for the meshes of a URDF file, which a log alone may not open."),
    ] = None,
    port: PortOption = None,
) -> None:
    """Play a log in a browser: opens one, or prints the address."""
    run = Log.load(log)
    if robot is None:
        _show({"": run}, port)
        return
    locked = run.metadata.get("robot_record", {}).get("locked_joints", {})
    _show({"": run}, port, load_robot(robot, locked_joints=locked))


@app.command()
@reports_errors
def certify(
    controller: Annotated[str, typer.Option(help="A law, or 'all'.")] = "all",
    robot: Annotated[
        str, typer.Option(help="As in 'run', or 'all': every arm that can be named, a table of matching residuals.")
    ] = "pera",
    interconnection: Annotated[str, typer.Option(help=f"{', '.join(ALL_FORMS)} or all.")] = "all",
    samples: Annotated[int, typer.Option(help="Number of states that are looked at.")] = SAMPLES,
    seed: Annotated[int, typer.Option(help="Seed of the sequence that the states are drawn from.")] = 0,
    lock: LockOption = None,
    armature: ArmatureOption = None,
    settings: SetOption = None,
    as_json: JsonOption = False,
) -> None:
    """Hold a law's promise against the arm's true motion, at states where laws go wrong. Exit code 1 if it fails."""
    names = list(CONTROLLERS) if controller == "all" else [choice("controller", controller, CONTROLLERS)]
    if interconnection != "all":
        choice("interconnection", interconnection, ALL_FORMS)
        names = [name for name in names if len(names) == 1 or interconnection in CONTROLLERS[name].law.forms]
    if robot == "all":
        if lock or armature is not None or settings:
            raise InvalidArgumentError("--robot", "all takes neither --lock nor --armature nor --set")
        _certify_every_arm(names, interconnection, samples, seed, as_json)
        return
    system, options = _system(robot, lock, armature), _settings(settings, "interconnection")
    labelled, left_out = [], []
    for name in names:
        forms = CONTROLLERS[name].law.forms if interconnection == "all" else (interconnection,)
        try:
            laws = [make_controller(name, system, interconnection=form, **options) for form in forms]
        except InvalidArgumentError as error:
            if controller != "all" or settings:
                raise
            left_out.append(f"{name} is not for this arm: {error}")
            continue
        labelled += [(name, make_certificate(law, system, samples=samples, seed=seed)) for law in laws]
    if as_json:
        typer.echo(json.dumps([item.to_dict() | {"law": label} for label, item in labelled], indent=2))
    elif len(labelled) == 1:
        typer.echo(str(labelled[0][1]))
    else:
        typer.echo(f"{system.robot.name}, {system.n} joints, {samples} states, seed {seed}")
        typer.echo(f"{'law':<32}{'J2':<12}{'matching':>10}{'gradient':>10}{'growth':>10}{'slowest':>10}  verdict")
        for label, item in labelled:
            verdict = item.verdict.lower() if item.passed else item.verdict
            typer.echo(
                f"{label:<32}{item.interconnection:<12}{item.matching_residual:>10.1e}{item.gradient_residual:>10.1e}"
                f"{item.largest_storage_rate:>10.1e}{item.slowest:>8.2g} s  {verdict}"
            )
        for line in left_out:
            typer.echo(line)
    if not all(item.passed for _, item in labelled):
        raise typer.Exit(1)


def _certify_every_arm(names: list[str], form: str, samples: int, seed: int, as_json: bool) -> None:
    rows = []
    forms = [each for each in ALL_FORMS if any(each in CONTROLLERS[name].law.forms for name in names)]

    def surveyed() -> Iterator[SurveyRow]:
        for row in survey(every_arm(), names, form=form, samples=samples, seed=seed):
            rows.append(row)
            yield row

    if as_json:
        data = [
            {"robot": row.robot, "joints": row.joints, "law": row.law, "verdict": row.verdict, "refused": row.refused}
            | {"certificates": [certificate.to_dict() for certificate in row.certificates]}
            for row in surveyed()
        ]
        typer.echo(json.dumps(data, indent=2))
    else:
        for line in markdown(surveyed(), forms if form == "all" else [form]):
            typer.echo(line)
    if any(row.verdict == "FAILED" for row in rows):
        raise typer.Exit(1)


@app.command("reproduce")
@reports_errors
def reproduce_command(
    out: Annotated[Path, typer.Option(help="Folder of the report.")] = Path("results/thesis"),
    only: Annotated[
        list[str] | None,
        typer.Option(help="A study, or certificates-ARM; may be repeated.", metavar="NAME"),
    ] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Run again what has been run.")] = False,
    jobs: Annotated[int | None, typer.Option(help="Processes at a time. Default: one a processor.")] = None,
) -> None:
    """Reproduce the thesis: every study and certificate, into one page. Goes on where it was stopped."""
    from phcontrol.thesis.reproduce import reproduce

    _check_writable(out)
    try:
        result = reproduce(out, only=only, fresh=fresh, jobs=jobs)
    except KeyboardInterrupt as error:
        typer.echo("stopped; what is finished is kept, the same command goes on from there", err=True)
        raise typer.Exit(130) from error
    typer.echo(f"{len(result.run)} tasks run, {len(result.kept)} kept from before")
    typer.echo(result.summary())
    typer.echo(f"\nwrote {result.report}, {out / 'claims.json'}")
    if not result.passed:
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


@contextmanager
def _watching(showing: Showing) -> Iterator[LiveView | None]:
    """Give a live view, or nothing where none is wished."""
    if not showing.view:
        _check_port_is_used(showing.port)
        yield None
        return
    from phcontrol.visualization.live import LiveView

    with LiveView(port=showing.port) as live:
        yield live


def _check_port_is_used(port: int | None) -> None:
    if port is not None:
        raise InvalidArgumentError("--port", "is the port of --view, which is not given")


def _record(logs: Mapping[str, Log], path: Path | None) -> None:
    """Write a page for each log; with several, the log's name is added to the file's."""
    if path is None:
        return
    from phcontrol.visualization.recording import record

    for name, log in logs.items():
        target = path if len(logs) == 1 else path.with_name(f"{path.stem}-{name}{path.suffix}")
        typer.echo(f"recorded {record(log, target)}")


def _show(logs: Mapping[str, Log], port: int | None, robot: Robot | None = None) -> None:
    """Serve the pages of logs, one after another when the last is stopped."""
    from phcontrol.visualization.recording import recorded_page
    from phcontrol.visualization.server import view

    for name, log in logs.items():
        if name:
            typer.echo(f"{name}:")
        view(recorded_page(log, robot=robot), port=port)


def _system(robot: str, lock: list[str] | None, armature: str | None) -> MechanicalSystem:
    rotors = None if armature is None else _by_joint("--armature", armature)
    if isinstance(rotors, list) and len(rotors) == 1:
        return MechanicalSystem(load_robot(robot, locked_joints=lock or [], armature=rotors[0]))
    return MechanicalSystem(load_robot(robot, locked_joints=lock or [], armature=rotors))


def _goal(system: MechanicalSystem, goal: str | None, target: str | None, frame: str | None) -> Array | None:
    """Return the joint positions that --goal or --reach asks for; None for neither."""
    robot = system.robot
    if target is None:
        if frame is not None:
            raise InvalidArgumentError("--frame", "is the frame of --reach, which is not given")
        if goal is None:
            return None
        posture = robot.position(_by_joint("--goal", goal), "--goal")
        for joint in ((posture < robot.lower) | (posture > robot.upper)).nonzero()[0]:
            typer.echo(
                f"note: --goal puts joint '{robot.joint_names[joint]}' at {posture[joint]:g}, outside its limits "
                f"{robot.lower[joint]:g} to {robot.upper[joint]:g}",
                err=True,
            )
        return posture
    if goal is not None:
        raise InvalidArgumentError("--reach", "and --goal are two goals: give one of them")
    point = _by_joint("--reach", target)
    if isinstance(point, dict) or len(point) != 3:
        raise InvalidArgumentError("--reach", f"must be a point x,y,z in metres, but is '{target}'")
    name = frame or robot.tool_frame or robot.frame_names[-1]
    return inverse_kinematics.reach(robot, name, point).position


def _joint_values(system: MechanicalSystem, option: str, text: str) -> list[float]:
    """Return one number a joint; joints that pairs do not name get 0."""
    values = _by_joint(option, text)
    if isinstance(values, list):
        return values
    check_joint_names(list(values), system.robot.joint_names, system.robot.name)
    return [values.get(name, 0.0) for name in system.robot.joint_names]


def _trajectory(kind: str, system: MechanicalSystem, goal: Array, speed: float) -> Trajectory:
    if kind == "swing":
        return swing(system.robot, goal, fraction=speed)
    if kind == "reach":
        return MinimumJerk.within_limits(system.robot, system.robot.home, goal, fraction=speed)
    return read_trajectory(kind, system.robot)


def _by_joint(option: str, text: str) -> dict[str, float] | list[float]:
    parts = [part.strip() for part in text.split(",") if part.strip()]
    try:
        if not parts:
            raise ValueError("empty")
        if not all("=" in part for part in parts):
            return [_number(part) for part in parts]
        pairs = [(name.strip(), _number(value)) for name, value in (part.split("=", 1) for part in parts)]
    except ValueError as error:
        message = f"must be {'angles' if option == '--goal' else 'numbers'} like 0.1,0.2 or pairs like elbow=0.3"
        raise InvalidArgumentError(option, f"{message}, but is '{text}'") from error
    values = dict(pairs)
    if len(values) < len(pairs):
        raise InvalidArgumentError(option, f"names a joint twice: '{text}'")
    return values


def _numbers(option: str, text: str) -> list[float]:
    try:
        return [_number(part) for part in text.split(",")]
    except ValueError as error:
        raise InvalidArgumentError(option, f"must be numbers like 0,0,0.002, but is '{text}'") from error


def _number(text: str) -> float:
    """Return the number that a text is; Python's "1_0" is none. Raises ValueError."""
    if "_" in text:
        raise ValueError(text)
    return float(text)


def _settings(pairs: list[str] | None, *options: str) -> dict[str, Any]:
    """Return what --set sets; ``options`` have options of their own."""
    settings: dict[str, Any] = {}
    for pair in pairs or []:
        name, separator, value = pair.partition("=")
        name = name.strip()
        if not separator:
            raise InvalidArgumentError("--set", f"must be NAME=VALUE, but is '{pair}'")
        if name in options:
            raise InvalidArgumentError("--set", f"'{name}' has an option of its own: use --{name}")
        if name in NOT_SET:
            raise InvalidArgumentError("--set", f"'{name}' cannot be given on the command line")
        if name in settings:
            raise InvalidArgumentError("--set", f"'{name}' is given twice")
        try:
            settings[name] = json.loads(value)
        except (ValueError, RecursionError) as error:
            shown = value if len(value) < 80 else f"{value[:80]}..."
            message = f"'{name}' must be a number, a list like [1, 2], true or false, but is '{shown}'"
            raise InvalidArgumentError("--set", message) from error
    return settings


def _check_writable(folder: Path, record: Path | None = None) -> None:
    """Find out before a long run, not after it, that its results cannot be written."""
    try:
        check_folder(folder)
    except OSError as error:
        raise DataFileError(f"cannot write to --out {folder}: {error.strerror or error}") from error
    if record is not None:
        check_file_place(record)


if __name__ == "__main__":
    main()
