"""Every study runs, writes what it says, and its verdicts are those that were looked at."""

from __future__ import annotations

import json

import pytest

from phcontrol import InvalidArgumentError, UnknownNameError
from phcontrol.experiments.claims import Claim
from phcontrol.experiments.registry import STUDIES, run_study

NOT_REPRODUCED = {"fig-3-1": {"modeled-shift-at-10s"}}


@pytest.fixture(scope="module", params=list(STUDIES))
def outcome(request):
    return run_study(request.param)


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
