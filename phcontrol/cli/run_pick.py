"""``phcontrol run pick``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from phcontrol._validation import choice, positive
from phcontrol.analysis.certify import SAMPLES
from phcontrol.cli.errors import say_aside
from phcontrol.cli.showing import UNWATCHED, Showing, check_writable, record_logs, watching
from phcontrol.runs.pick import DURATION, run_pick
from phcontrol.runs.pick_scene import FEATURES
from phcontrol.vision.calibration_file import read_camera


def pick(
    objects: Annotated[int, typer.Option(min=1, help="How many objects, each at a random pose.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Of the poses and of all noise.")] = 0,
    camera: Annotated[
        Path | None,
        typer.Option(help="Calibration file of the camera (OpenCV's or ROS's YAML). Default: a wide one that bends."),
    ] = None,
    features: Annotated[str, typer.Option(help=f"By what the object is found: {' or '.join(FEATURES)}.")] = FEATURES[0],
    duration: Annotated[float, typer.Option(help="Simulated time for each object [s].")] = DURATION,
    samples: Annotated[int, typer.Option(min=0, help="States at which each law is certified; 0: not.")] = SAMPLES,
    out: Annotated[Path, typer.Option(help="Folder for log, picture, picks and certificates.")] = Path("results/pick"),
    showing: Showing = UNWATCHED,
) -> None:
    """See an object, reach it, grasp it: camera to force in one chain. Exit code 1 unless all are in view and held."""
    choice("features", features, FEATURES)
    positive("duration", duration)
    seen_by = None if camera is None else read_camera(camera)
    check_writable(out, showing.record)
    with watching(showing) as watch:
        result = run_pick(
            objects=objects,
            seed=seed,
            duration=duration,
            camera=seen_by,
            features=features,
            samples=samples,
            watch=watch,
        )
        typer.echo(json.dumps(result.to_dict(), indent=2) if showing.as_json else result.summary())
        say_aside("\nwrote " + ", ".join(str(path) for path in result.write(out)), showing.as_json)
        record_logs({"": result.log}, showing.record, err=showing.as_json)
        if watch is not None:
            watch.linger(result.log)
    if not result.passed:
        raise typer.Exit(1)
