"""What the report links to is there: errata, readings, theorems, laws."""

from __future__ import annotations

import re
from pathlib import Path

from phcontrol.controllers.registry import CONTROLLERS
from phcontrol.thesis.claim import Claim
from phcontrol.thesis.errata import errata
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.origin import Origin
from phcontrol.thesis.readings import READINGS
from phcontrol.thesis.report import report
from phcontrol.thesis.report_claims import linked
from phcontrol.thesis.theorem import THEOREMS

THEORY = (Path(__file__).parents[2] / "docs" / "theory.md").read_text(encoding="utf-8")


def test_errata_are_those_of_the_documentation():
    listed = re.findall(r"^\| (E\d+) \|", THEORY, flags=re.MULTILINE)
    assert sorted(errata()) == sorted(listed)
    assert list(errata())[:3] == ["E1", "E2", "E3"]
    assert errata()["E3"].printed == "exp(+|q̇|/q̇_s), and F_v q̇"  # with its bars
    assert errata()["E16"].correct == "−l/Z"


def test_readings_are_those_of_the_documentation():
    listed = dict(re.findall(r"^\| (R\d+) \| [^|]* \| ([^|]*) \|", THEORY, flags=re.MULTILINE))
    assert list(listed) == list(READINGS)


def test_errata_and_readings_are_links_and_text_is_safe():
    assert linked("E8 to E10, <b>") == '<a href="#E8">E8</a> to <a href="#E10">E10</a>, &lt;b&gt;'
    assert linked("R1") == '<a href="#R1">R1</a>'
    assert linked("PE8, E8x, R") == "PE8, E8x, R"
    page = report({"versions": {}, "studies": [], "certificates": [], "failed": {}})
    for name in (*errata(), *READINGS):
        assert page.count(f'id="{name}"') == 1


def test_theorems_name_laws_that_exist():
    laws = [law for theorem in THEOREMS for law in theorem.laws]
    assert len(set(laws)) == len(laws)
    assert set(laws) <= set(CONTROLLERS)
    # every law that says it is a theorem's is in the list of theorems
    assert {law for law, entry in CONTROLLERS.items() if entry.source.startswith("Theorem")} <= set(laws)


def row(law, passed=True, residual=1e-9):
    numbers = dict.fromkeys(("gradient_residual", "skewness", "indefiniteness", "largest_storage_rate"), 0.0)
    return numbers | {
        "law": law, "robot": "arm", "interconnection": "coriolis", "matching_residual": residual, "passed": passed,
        "verdict": "PASSED" if passed else "FAILED", "driven_by": "", "caveat": "", "samples": 1, "seed": 0,
    }  # fmt: skip


def test_a_theorem_whose_certificate_fails_is_seen_to():
    rows = [row("integral_action"), row("integral_action", passed=False, residual=None), row("force_control")]
    page = report({"versions": {}, "studies": [], "certificates": rows, "failed": {}})
    assert re.search(r'Theorem 3\.2\.5</b>.*?<td class="bad">1 of 2 passed</td><td class="number">not finite', page)
    assert re.search(r'Theorem 4\.1\.1</b>.*?<td class="good">1 of 1 passed</td><td class="number">1\.0e-09', page)
    assert re.search(r'Theorem 6\.1\.1</b>.*?<td class="bad">0 of 0 passed', page)
    assert page.count('id="law-integral_action"') == 1


def test_what_was_measured_on_the_arm_is_counted_and_marked_apart():
    def entry(name, ours, stand_in):
        return Claim(name, f"{name} is 1", Origin.FIGURE, "figure 4.7", (1.0,), "s", 0.1, [Finding((ours,))],
                     reason="why", stand_in=stand_in).to_dict()  # fmt: skip

    claims = [entry("shown", 1.0, False), entry("measured", 1.0, True), entry("wrong", 2.0, True)]
    study = {
        "study": "fig-4-7",
        "title": "t",
        "notes": [],
        "figures": [],
        "logs": [],
        "recordings": [],
        "claims": claims,
    }
    page = report({"versions": {}, "studies": [study | {"seeds": {}}], "certificates": [], "failed": {}})
    assert "<b>1 of 1</b>of the thesis's claims reproduced" in page
    assert "<b>1 of 2</b>of what it measured on the arm" in page
    assert page.count("measured on the arm; ours is a simulation") == 2
