"""Certificates of laws on every arm that can be named."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from phcontrol.analysis.certificate import Certificate
from phcontrol.analysis.certify import certify
from phcontrol.controllers.registry import find_law, make_controller
from phcontrol.exceptions import InvalidArgumentError, RobotDescriptionError, UnknownNameError
from phcontrol.mechanics.catalogue import example_robots, shipped_robots
from phcontrol.mechanics.loading import load_robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.runs.compositions import Composition, compositions


@dataclass(frozen=True)
class SurveyRow:
    """A law on an arm: one certificate for each form of its J̄₂, or why the arm is refused."""

    robot: str
    joints: int
    law: str
    certificates: tuple[Certificate, ...] = ()
    refused: str = ""

    @property
    def verdict(self) -> str:
        """Return "passed", "FAILED" or "refused"."""
        if self.refused:
            return "refused"
        return "passed" if all(certificate.passed for certificate in self.certificates) else "FAILED"

    def residual(self, form: str) -> float | None:
        """Return the matching residual with a form of J̄₂; None where there is none."""
        for certificate in self.certificates:
            if certificate.interconnection == form:
                return certificate.matching_residual
        return None


def every_arm() -> list[str]:
    """Return the names of all shipped robots and of all of example-robot-data with a fixed base."""
    return [*shipped_robots(), *(name for name, floating in example_robots().items() if not floating)]


def survey(
    robots: Iterable[str], laws: Sequence[str], *, form: str = "all", samples: int = 20, seed: int = 0
) -> Iterator[SurveyRow]:
    """Certify laws on arms, one row after another; what a description or a law refuses makes a row that says why.

    Args:
        robots: names.
        laws: names, as ``make_controller`` takes them.
        form: one form of J̄₂ for all, or "all" that each law knows.
        samples: states of each certificate.
        seed: of the random states.
    """
    for name in robots:
        try:
            system = MechanicalSystem(load_robot(name))
        except RobotDescriptionError as error:
            yield SurveyRow(name, 0, "", refused=" ".join(str(error).split()))
            continue
        for law in laws:
            forms = find_law(law).law.forms if form == "all" else (form,)
            try:
                made = [make_controller(law, system, interconnection=each) for each in forms]
            except (InvalidArgumentError, UnknownNameError) as error:  # a law that is not for this arm, or not so
                yield SurveyRow(name, system.n, law, refused=str(error))
                continue
            certificates = tuple(certify(each, system, samples=samples, seed=seed) for each in made)
            yield SurveyRow(name, system.n, law, certificates)


@dataclass(frozen=True)
class ComposedRow:
    """A composition on an arm: one certificate for each form of its J̄₂."""

    robot: str
    composition: Composition
    certificates: tuple[Certificate, ...]

    @property
    def passed(self) -> bool:
        """Whether all passed."""
        return all(certificate.passed for certificate in self.certificates)

    def __str__(self) -> str:
        """Return a line of the Markdown table."""
        composed, worst = self.composition, max(certificate.matching_residual for certificate in self.certificates)
        verdict = next((each.verdict for each in self.certificates if not each.passed), self.certificates[0].verdict)
        cells = (self.robot, composed.law, composed.potential, composed.reference, f"{worst:.1e}", verdict.lower())
        return "| " + " | ".join(cells) + " |"


def survey_of_compositions(
    system: MechanicalSystem, laws: Sequence[str], *, form: str = "all", samples: int = 20, seed: int = 0
) -> Iterator[ComposedRow]:
    """Certify every potential, along every reference, under every law that can be composed for an arm.

    Args:
        system: the arm.
        laws: registered names; those that are not composed are left out.
        form: one form of J̄₂ for all, or "all" that each law knows.
        samples: states of each certificate.
        seed: of the random states.
    """
    for composed in compositions(system, laws):
        known = find_law(composed.law).law.forms
        forms = known if form == "all" else tuple({form} & set(known))
        if not forms:
            continue  # the law does not know the form
        made = (composed.make(system, each) for each in forms)
        certificates = tuple(certify(law, system, samples=samples, seed=seed) for law in made)
        yield ComposedRow(system.robot.name, composed, certificates)


def markdown(rows: Iterable[SurveyRow], forms: Sequence[str]) -> Iterator[str]:
    """Return the lines of a Markdown table of a survey."""
    yield "| robot | joints | law | " + " | ".join(forms) + " | verdict |"
    yield "|---|---|---|" + "---|" * (len(forms) + 1)
    for row in rows:
        residuals = (row.residual(form) for form in forms)
        cells = ["" if residual is None else f"{residual:.1e}" for residual in residuals]
        verdict = f"refused: {row.refused}" if row.refused else row.verdict
        yield f"| {row.robot} | {row.joints or ''} | {row.law} | " + " | ".join(cells) + f" | {verdict} |"
