"""``phcontrol run``: a law on any arm, or a study of the thesis."""

from __future__ import annotations

from collections.abc import Callable

from phcontrol.cli.command import add_command, plain_app
from phcontrol.cli.run_cartesian import impedance, tracking
from phcontrol.cli.run_law import law_command
from phcontrol.cli.run_pick import pick
from phcontrol.cli.run_position import position
from phcontrol.cli.run_servo import servo
from phcontrol.cli.run_study import study_command
from phcontrol.cli.run_track import track
from phcontrol.controllers.own_laws import installed_laws, origin_of
from phcontrol.controllers.registry import CONTROLLERS
from phcontrol.thesis.registry import STUDIES

run_app = plain_app("Run a law on any arm, or a study; writes logs and pictures.", add_completion=False)

add_command(run_app, "position", position)
add_command(run_app, "track", track, short_help="Follow a trajectory with any arm, and certify the law that does it.")
add_command(run_app, "servo", servo)
add_command(
    run_app, "pick", pick, short_help="See an object, reach it, grasp it: 20 random poses, from rendered images."
)
_RUNS: dict[str, Callable[..., None]] = {
    "position": position,
    "servo": servo,
    "cartesian_impedance": impedance,
    "cartesian_tracking": tracking,
}
for _name, _entry in CONTROLLERS.items():
    add_command(
        run_app,
        _name,
        law_command(_name, _RUNS[_entry.law.run]),
        help=f"Run an arm under {_name}: {_entry.summary}.",
        short_help=f"law: {_entry.summary}",
    )
for _name, _points in installed_laws().items():  # nothing of them is imported before it is asked for
    if _name not in CONTROLLERS:
        _text = f"a law of {origin_of(_points[0])}"
        add_command(
            run_app, _name, law_command(_name, position), help=f"Run an arm under {_name}, {_text}.", short_help=_text
        )
for _name, _study in STUDIES.items():
    add_command(
        run_app,
        _name,
        study_command(_name),
        help=f"Run {_study.summary}; write figures, logs and claims.json.",
        short_help=_study.summary,
    )
