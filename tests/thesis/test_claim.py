"""Verdicts: each can be reached, none by accident, and what cannot fail is not counted."""

from __future__ import annotations

import math

import pytest

from phcontrol import InvalidArgumentError, UnknownNameError
from phcontrol.thesis.claim import Claim
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.origin import Origin
from phcontrol.thesis.tally import Tally
from phcontrol.thesis.verdict import Verdict


def claim(*findings, relation="=", origin=Origin.TEXT, reason="why", name="x", stand_in=False):
    return Claim(name, "x is 1", origin, "nowhere", (1.0,), "rad", 0.1, findings, relation, reason, stand_in)


@pytest.mark.parametrize(
    ("finding", "verdict", "text"),
    [
        (Finding((1.05,)), Verdict.AS_PRINTED, "as printed"),
        (Finding((1.05,), "E9"), Verdict.CORRECTED, "with correction E9"),
        (Finding((1.05,), "E9", "R1"), Verdict.READING, "under reading R1, with correction E9"),
        (Finding((1.05,), reading="R1"), Verdict.READING, "under reading R1"),
        (Finding((1.05,), "E9", fitted=True), Verdict.FITTED, "fitted"),
        (Finding((1.05,), "E9", vacuous="it rests at 1"), Verdict.VACUOUS, "vacuous"),
        (Finding((1.2,)), Verdict.NOT_REPRODUCED, "not reproduced"),
        (Finding((math.inf,)), Verdict.NOT_REPRODUCED, "not reproduced"),
        (Finding((math.nan,)), Verdict.NOT_REPRODUCED, "not reproduced"),
    ],
)
def test_each_verdict(finding, verdict, text):
    assert claim(finding).verdict is verdict
    assert claim(finding).verdict_text == text
    assert text in str(claim(finding))


@pytest.mark.parametrize(
    ("relation", "ours", "holds"),
    [("=", 0.85, False), ("<=", 0.85, True), ("<=", 1.05, True), ("<=", 1.2, False), (">=", 1.2, True),
     (">=", 0.95, True), (">=", 0.85, False), (">=", math.inf, False), ("<=", -math.inf, False)],
)  # fmt: skip
def test_bounds_are_bounds(relation, ours, holds):
    finding = Finding((ours,))
    assert claim(finding, relation=relation).holds(finding) is holds


def test_the_finding_under_the_fewest_conditions_is_the_one_that_counts():
    wrong, fitted, read = Finding((2.0,)), Finding((1.0,), fitted=True), Finding((1.0,), "E9", "R1")
    mended = Finding((1.0,), "E9")
    for findings in ((wrong, fitted, read, mended), (mended, read, fitted, wrong)):
        assert claim(*findings).best is mended
    assert claim(wrong, fitted, read).best is read
    assert claim(wrong, Finding((3.0,))).best is wrong
    data = claim(wrong, read).to_dict()
    assert data["best"] == 1
    assert [entry["holds"] for entry in data["findings"]] == [False, True]


def test_a_claim_that_is_not_reproduced_must_say_why():
    with pytest.raises(InvalidArgumentError, match="must say why"):
        _ = claim(Finding((2.0,)), reason="").verdict


def test_a_finding_may_rest_on_several_readings():
    finding = Finding((1.0,), "E15", "R1, R8")
    assert finding.readings == ("R1", "R8")
    assert finding.verdict is Verdict.READING
    assert claim(finding).verdict_text == "under reading R1, R8, with correction E15"
    with pytest.raises(UnknownNameError, match="unknown reading 'R99'"):
        Finding((1.0,), reading="R1, R99")
    entry = claim(finding).to_dict()
    assert [Tally.under([entry], reading).reproduced for reading in ("R1", "R8", "R2")] == [1, 1, 0]


def test_readings_are_those_that_are_listed():
    with pytest.raises(UnknownNameError, match="unknown reading 'R99'.*R1"):
        Finding((1.0,), reading="R99")


def test_the_tally_counts_the_thesis_apart_and_only_what_could_fail():
    findings = [
        Finding((1.0,)), Finding((1.0,), "E9"), Finding((1.0,), "E9", "R1"), Finding((1.0,), fitted=True),
        Finding((1.0,), vacuous="always"), Finding((2.0,)),
    ]  # fmt: skip
    claims = [
        claim(finding, origin=origin).to_dict()
        for origin in (Origin.THEOREM, Origin.TEXT, Origin.FIGURE)
        for finding in findings
    ]
    ours = [claim(Finding((1.0,)), origin=Origin.OURS).to_dict(), claim(findings[-1], origin=Origin.OURS).to_dict()]
    tally = Tally.of_the_thesis(claims + ours)
    assert (tally.total, tally.reproduced) == (18, 9)
    assert all(count == 3 for count in tally.counts.values())
    assert (Tally.of_ours(claims + ours).total, Tally.of_ours(claims + ours).reproduced) == (2, 1)
    assert [claim(findings[i], origin=Origin.OURS).verdict_text for i in (0, 5)] == ["met", "not met"]
    assert Tally.of(claims, iter([Origin.TEXT])).total == 6


def test_what_a_simulation_stands_in_for_is_counted_apart():
    shown, measured, wrong = (
        claim(Finding((1.0,))),
        claim(Finding((1.0,)), stand_in=True),
        claim(Finding((2.0,)), stand_in=True),
    )
    claims = [entry.to_dict() for entry in (shown, measured, wrong, claim(Finding((1.0,)), origin=Origin.OURS))]
    assert (Tally.of_the_thesis(claims).reproduced, Tally.of_the_thesis(claims).total) == (1, 1)
    assert (Tally.of_stand_ins(claims).reproduced, Tally.of_stand_ins(claims).total) == (1, 2)
    assert Tally.of_ours(claims).total == 1
    assert "(measured; ours is a simulation)" in str(measured)
    assert "measured" not in str(shown)


def test_a_tally_under_one_reading_counts_only_what_was_run_under_it():
    first = claim(Finding((2.0,), reading="R1"), Finding((1.0,), reading="R2"))
    second = claim(Finding((1.0,), "E9", "R1"), Finding((1.0,), reading="R2", vacuous="never touches"))
    third = claim(Finding((1.0,), reading="R1"), Finding((1.0,), reading="R1", fitted=True))
    claims = [entry.to_dict() for entry in (first, second, third, claim(Finding((1.0,))))]
    claims.append(claim(Finding((1.0,), reading="R1"), origin=Origin.OURS).to_dict())
    under = {reading: Tally.under(claims, reading) for reading in ("R1", "R2")}
    assert (under["R1"].total, under["R1"].reproduced, under["R1"].counts[Verdict.NOT_REPRODUCED]) == (3, 2, 1)
    assert (under["R2"].total, under["R2"].reproduced, under["R2"].counts[Verdict.VACUOUS]) == (2, 1, 1)
    assert Tally.under(claims, "R3").total == 0
