"""``phcontrol sweep``."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from phcontrol.exceptions import InvalidArgumentError

if TYPE_CHECKING:
    from phcontrol.sweeps.sweep import Sweep


def sweep(
    spec: Annotated[Path, typer.Argument(help="The sweep: a TOML file.", metavar="SPEC.toml")],
    out: Annotated[Path | None, typer.Option(help="Folder of the results, or of the log of --replay.")] = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes on this machine. Default: one for each processor.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="A Dask scheduler whose workers do it.", metavar="tcp://HOST:PORT")
    ] = None,
    replay: Annotated[int | None, typer.Option(help="Do this run alone, and write its log.", metavar="N")] = None,
    of: Annotated[
        str | None, typer.Option(help="The sweep that --replay is of, as its report says; another is refused.")
    ] = None,
    interpreted: Annotated[bool, typer.Option("--interpreted", help="Compile nothing.")] = False,
) -> None:
    """Run what a file describes many times: arms, loads and delays that are drawn.

    'phcontrol init' writes such a file. Goes on where it was stopped. Exit code 1 if runs failed.
    """
    from phcontrol.sweeps.sweep import Sweep

    read = Sweep.read(spec)
    if of is not None:
        if replay is None:
            raise InvalidArgumentError("--of", "goes with --replay")
        if not of or not read.hash.startswith(of):
            raise InvalidArgumentError(
                "--of", f"{of} is not the sweep that {spec} describes now, {read.hash[:8]}: its runs are others"
            )
    if replay is not None:
        if workers is not None or scheduler is not None:
            raise InvalidArgumentError("--replay", "takes neither --workers nor --scheduler")
        _replay(read, replay, Path() if out is None else out)
        return
    if out is None:
        raise InvalidArgumentError("--out", "must be given: the folder of the results, for instance results/sweep")
    if workers is not None and scheduler is not None:
        raise InvalidArgumentError("--scheduler", "has workers of its own: leave out --workers")
    try:
        if scheduler is None:
            results = read.run(out, workers=workers, compiled=not interpreted)
        else:
            from phcontrol.sweeps.dask_scheduler import DaskScheduler

            with DaskScheduler(scheduler) as engine:
                results = read.run(out, engine=engine, compiled=not interpreted)
    except KeyboardInterrupt as error:
        typer.echo("stopped; what is finished is kept, the same command goes on from there", err=True)
        raise typer.Exit(130) from error
    typer.echo(results.summary())
    report = shlex.join(["phcontrol", "sweep-report", str(out), "--spec", str(spec)])
    typer.echo(f"\nwrote {out}\nnext, its page: {report}")
    if results.failed.any():
        raise typer.Exit(1)


def _replay(read: Sweep, run: int, folder: Path) -> None:
    log = read.replay(run)
    for name, value in read.scenario(run).items():
        typer.echo(f"  {name:<32} {value:.9g}")
    typer.echo("measures")
    for name, measured in read.measured(log, run).items():
        typer.echo(f"  {name:<32} {measured if isinstance(measured, str) else format(measured, '.9g')}")
    typer.echo(f"wrote {log.save(folder / f'run-{run}.npz')}")
