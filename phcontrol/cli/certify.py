"""``phcontrol certify``."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Annotated

import typer

from phcontrol._validation import choice
from phcontrol.analysis.certify import SAMPLES
from phcontrol.analysis.certify import certify as make_certificate
from phcontrol.cli import completion
from phcontrol.cli.arm_options import AS_DESCRIBED, ArmOptions
from phcontrol.cli.errors import say_error
from phcontrol.cli.laws import CONTROLLER_HELP, law_of
from phcontrol.cli.options import (
    JsonOption,
    SetOption,
)
from phcontrol.cli.texts import settings_of
from phcontrol.controllers.law_error import LawError, errors_of
from phcontrol.controllers.registry import CONTROLLERS, Entry, all_laws, make_controller
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.runs.certificate_survey import SurveyRow, every_arm, markdown, survey, survey_of_compositions

ALL_FORMS = tuple(dict.fromkeys(form for entry in CONTROLLERS.values() for form in entry.law.forms))


def certify(
    controller: Annotated[
        str,
        typer.Option(help=f"A law: {CONTROLLER_HELP}; or 'all'.", autocompletion=completion.with_all(completion.laws)),
    ] = "all",
    robot: Annotated[
        str,
        typer.Option(
            help="As in 'run', or 'all': every arm that can be named, a table of matching residuals.",
            autocompletion=completion.with_all(completion.robots),
        ),
    ] = "pera",
    interconnection: Annotated[
        str,
        typer.Option(
            help=f"{', '.join(ALL_FORMS)} or all.", autocompletion=completion.with_all(completion.one_of(ALL_FORMS))
        ),
    ] = "all",
    samples: Annotated[int, typer.Option(help="Number of states that are looked at.")] = SAMPLES,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the sequence that the states are drawn from.")] = 0,
    arm: ArmOptions = AS_DESCRIBED,
    settings: SetOption = None,
    composed: Annotated[
        bool, typer.Option("--compositions", help="About every potential and along every reference: a table.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Hold a law's promise against the arm's true motion, at states where laws go wrong.

    Exit code 1 if it fails.
    """
    laws = _laws(controller)
    known = _forms(laws)
    if interconnection != "all":
        choice("interconnection", interconnection, known)
        laws = {name: entry for name, entry in laws.items() if len(laws) == 1 or interconnection in entry.law.forms}
    if robot == "all":
        if arm.given or settings:
            raise InvalidArgumentError(
                "--robot", "all takes neither --lock, --armature, --payload, --rotor-inertia nor --set"
            )
        if composed:
            raise InvalidArgumentError("--compositions", "takes one robot")
        _certify_every_arm(laws, interconnection, samples, seed, as_json)
        return
    system, options = arm.system(robot), settings_of(settings, "interconnection")
    if composed:
        if settings or as_json:
            raise InvalidArgumentError("--compositions", "takes neither --set nor --json")
        _certify_compositions(system, list(laws), interconnection, samples, seed)
        return
    labelled, left_out, broken = [], [], False
    for name, entry in laws.items():
        forms = entry.law.forms if interconnection == "all" else (interconnection,)
        if controller == "all" and not set(forms) <= set(entry.law.forms):
            left_out.append(f"{name} has no form '{interconnection}': {', '.join(entry.law.forms)}")
            continue
        try:
            with errors_of(name, entry.law):
                made = [make_controller(name, system, interconnection=form, **options) for form in forms]
        except (InvalidArgumentError, LawError) as error:
            if controller != "all" or settings:
                raise
            left_out.append(f"{name} is not for this arm: {error}")
            broken = broken or isinstance(error, LawError)
            continue
        labelled += [(name, make_certificate(law, system, samples=samples, seed=seed)) for law in made]
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
    for label, item in labelled:
        if item.error:
            say_error(f"{label} ({item.interconnection}) raised {item.error}")
    if broken or not all(item.passed for _, item in labelled):
        raise typer.Exit(1)


def _laws(controller: str) -> dict[str, Entry]:
    """Return the laws that --controller names."""
    if controller != "all":
        return {controller: law_of(controller)}
    laws, problems = all_laws()
    for problem in problems:
        say_error(problem)
    return laws


def _forms(laws: dict[str, Entry]) -> tuple[str, ...]:
    """Return every form of J̄₂ that some of the laws know."""
    return tuple(dict.fromkeys(form for entry in laws.values() for form in entry.law.forms))


def _certify_compositions(system: MechanicalSystem, names: list[str], form: str, samples: int, seed: int) -> None:
    typer.echo("| robot | law | potential | reference | matching | verdict |\n|---|---|---|---|---|---|")
    passed = []
    for row in survey_of_compositions(system, names, form=form, samples=samples, seed=seed):
        typer.echo(str(row))
        passed.append(row.passed)
    if not all(passed):
        raise typer.Exit(1)


def _certify_every_arm(laws: dict[str, Entry], form: str, samples: int, seed: int, as_json: bool) -> None:
    rows = []
    forms = list(_forms(laws))

    def surveyed() -> Iterator[SurveyRow]:
        for row in survey(every_arm(), list(laws), form=form, samples=samples, seed=seed):
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
