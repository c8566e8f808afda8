"""``phcontrol certify``."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Annotated

import typer

from phcontrol._validation import choice
from phcontrol.analysis.certify import SAMPLES
from phcontrol.analysis.certify import certify as make_certificate
from phcontrol.cli.arm import system_of
from phcontrol.cli.options import ArmatureOption, JsonOption, LockOption, SetOption
from phcontrol.cli.texts import settings_of
from phcontrol.controllers.registry import CONTROLLERS, make_controller
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.runs.certificate_survey import SurveyRow, every_arm, markdown, survey, survey_of_compositions

ALL_FORMS = tuple(dict.fromkeys(form for entry in CONTROLLERS.values() for form in entry.law.forms))


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
    composed: Annotated[
        bool, typer.Option("--compositions", help="About every potential and along every reference: a table.")
    ] = False,
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
        if composed:
            raise InvalidArgumentError("--compositions", "takes one robot")
        _certify_every_arm(names, interconnection, samples, seed, as_json)
        return
    system, options = system_of(robot, lock, armature), settings_of(settings, "interconnection")
    if composed:
        if settings or as_json:
            raise InvalidArgumentError("--compositions", "takes neither --set nor --json")
        _certify_compositions(system, names, interconnection, samples, seed)
        return
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


def _certify_compositions(system: MechanicalSystem, names: list[str], form: str, samples: int, seed: int) -> None:
    typer.echo("| robot | law | potential | reference | matching | verdict |\n|---|---|---|---|---|---|")
    passed = []
    for row in survey_of_compositions(system, names, form=form, samples=samples, seed=seed):
        typer.echo(str(row))
        passed.append(row.passed)
    if not all(passed):
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
