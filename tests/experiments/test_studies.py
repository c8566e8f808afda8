"""Every study runs, writes what it says, and its verdicts are those that were looked at."""

from __future__ import annotations

import json
from functools import cache

import pytest

from phcontrol import InvalidArgumentError, UnknownNameError
from phcontrol.experiments.claims import Claim
from phcontrol.experiments.registry import STUDIES, run_study

GRASP_TIMES = {f"settled-{law}" for law in ("grasping", "classical-compensated", "classical")}
GRASP_IMPACTS = {f"impact-{law}" for law in ("grasping", "classical-compensated", "classical")}
NOT_REPRODUCED = {
    "fig-2-3": {"closing-as-printed"},
    "fig-3-1": {"modeled-shift-at-10s"},
    "fig-4-1": set(),
    "fig-4-2": {"contact-grasping", "contact-classical"},
    "fig-4-3": GRASP_TIMES | GRASP_IMPACTS,
    "fig-4-4": {"contact-grasping", "contact-classical"},
    "fig-4-5": GRASP_TIMES | GRASP_IMPACTS - {"impact-grasping"} | {"impact-regulated"},
    "fig-4-7": {"contact-grasping"},
    "fig-4-8": {"impact-classical-compensated", "impact-classical", "settled-grasping"},
    "fig-4-9": {"contact-grasping"},
    "fig-4-10": {"impact-classical", "settled-grasping", "impact-regulated"},
    "pera-press": set(),
    "grasp-grid": {"contact", "impact", "settled"},
    "fig-5-3": {"reduction-is-better"},
    "servo-pera": {"positive-stable"},
    "servo-images": set(),
}


@cache
def run_once(name):
    return run_study(name)


@pytest.fixture(params=[pytest.param(name, marks=pytest.mark.xdist_group(name)) for name in STUDIES])
def outcome(request):
    return run_once(request.param)


def test_verdicts_are_those_reported(outcome):
    verdicts = {claim.name: claim.verdict for claim in outcome.claims}
    assert {name for name, verdict in verdicts.items() if verdict == "not reproduced"} == NOT_REPRODUCED[outcome.name]


def test_everything_is_written(outcome, tmp_path):
    paths = outcome.write(tmp_path)
    assert {path.name for path in paths} == {path.name for path in tmp_path.iterdir()}
    data = json.loads((tmp_path / "claims.json").read_text())
    assert [claim["name"] for claim in data["claims"]] == [claim.name for claim in outcome.claims]
    assert outcome.figures
    for name in outcome.figures:
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000


def test_a_claim_that_is_not_reproduced_must_say_why():
    claim = Claim("x", "x is 1", "nowhere", (1.0,), (2.0,), "rad", 0.1)
    with pytest.raises(InvalidArgumentError, match="must say why"):
        _ = claim.verdict
    assert Claim("x", "x is 1", "nowhere", (1.0,), (1.05,), "rad", 0.1, "E9").verdict == "reproduced with correction E9"


def test_unknown_studies_are_listed():
    with pytest.raises(UnknownNameError, match="unknown study 'fig-9'.*fig-3-1"):
        run_study("fig-9")
