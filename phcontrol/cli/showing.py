"""Where the results of a run go, and how it is shown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from phcontrol._files import check_file_place, check_folder
from phcontrol.cli.errors import say_aside
from phcontrol.cli.option_group import OptionGroup
from phcontrol.cli.options import JsonOption, PortOption, RecordOption, ViewOption
from phcontrol.exceptions import DataFileError, InvalidArgumentError
from phcontrol.mechanics.robot import Robot
from phcontrol.simulation.log import Log

if TYPE_CHECKING:
    from phcontrol.analysis.certificate import Certificate
    from phcontrol.visualization.live import LiveView


@dataclass(frozen=True)
class Showing(OptionGroup):
    """How a run is to be shown."""

    view: ViewOption = False
    record: RecordOption = None
    port: PortOption = None
    as_json: JsonOption = False


UNWATCHED = Showing()
"""A run that nobody watches."""


@contextmanager
def watching(showing: Showing) -> Iterator[LiveView | None]:
    """Give a live view, or nothing where none is asked for."""
    if not showing.view:
        check_port_is_used(showing.port)
        yield None
        return
    from phcontrol.visualization.live import LiveView

    with LiveView(port=showing.port) as live:
        yield live


def check_port_is_used(port: int | None) -> None:
    """Refuse a --port that nothing would be served on."""
    if port is not None:
        raise InvalidArgumentError("--port", "is the port of --view, which is not given")


def record_logs(
    logs: Mapping[str, Log], path: Path | None, err: bool = False, certificate: Certificate | None = None
) -> None:
    """Write a page for each log; with several, the log's name is added to the file's."""
    if path is None:
        return
    from phcontrol.visualization.recording import record

    for name, log in logs.items():
        target = path if len(logs) == 1 else path.with_name(f"{path.stem}-{name}{path.suffix}")
        written = record(log, target, certificate=certificate)
        say_aside(f"recorded {written}: open it in any browser", err)


def show(logs: Mapping[str, Log | Mapping[str, Log]], port: int | None, robot: Robot | None = None) -> None:
    """Serve pages, each of a log or of several, one after another when the last is stopped."""
    from phcontrol.visualization.recording import recorded_page
    from phcontrol.visualization.server import view

    for name, log in logs.items():
        if name:
            typer.echo(f"{name}:")
        view(recorded_page(log, robot=robot), port=port)


def check_writable(folder: Path, record: Path | None = None) -> None:
    """Find out before a long run, not after it, that its results cannot be written."""
    try:
        check_folder(folder)
    except OSError as error:
        raise DataFileError(f"cannot write to --out {folder}: {error.strerror or error}") from error
    if record is not None:
        check_file_place(record)
