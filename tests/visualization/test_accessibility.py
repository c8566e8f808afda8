"""Pages that phcontrol writes, looked at by axe-core, in both colour schemes: not one complaint."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    LiveTrajectory,
    LiveView,
    MechanicalSystem,
    Setpoint,
    Sweep,
    certify,
    load_robot,
    make_controller,
    record,
    simulate,
)
from phcontrol.sweeps.report import write_report
from phcontrol.thesis.claim import Claim
from phcontrol.thesis.finding import Finding
from phcontrol.thesis.origin import Origin
from phcontrol.thesis.report import report

pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("browser")]
SCHEMES = ("light", "dark")


def complaints(browser, axe, address, ready="window.phcontrol && phcontrol.frames > 0"):
    """Return what axe says of a page in both schemes, with all that folds open."""
    found = []
    with browser.open(address, ready=ready) as page:
        for scheme in SCHEMES:
            page.emulate_media(color_scheme=scheme)
            page.evaluate("document.querySelectorAll('details').forEach((fold) => { fold.open = true; })")
            found += [f"{scheme}: {problem}" for problem in axe.problems(page)]
    return found


@pytest.mark.parametrize("gain", [1.0, -1.0], ids=["passed", "failed"])
def test_a_recorded_page(browser, axe, log, tmp_path, gain):
    system = MechanicalSystem(load_robot("pera"))
    law = make_controller("energy_shaping", system)
    if gain < 0.0:  # a law that does not do what it promises
        right = law.evaluate
        law.evaluate = lambda *given: right(*given)._replace(torque=-right(*given).torque)
    certificate = certify(law, system, samples=8)
    assert certificate.passed == (gain > 0.0)
    assert complaints(browser, axe, record(log, tmp_path / "run.html", certificate=certificate).as_uri()) == []


def test_a_live_page_with_controls(browser, axe):
    arm = MechanicalSystem(load_robot("pera_shoulder"))
    goal = LiveTrajectory(arm.robot, [0.0, 0.0])
    law = make_controller("energy_shaping", arm, reference=goal)
    setpoint = Setpoint(goal=goal)
    with LiveView(port=0, real_time=False, controls=setpoint, announce=lambda server: None) as view:
        simulate(arm, law, duration=0.1, dt=1e-2, q0=np.zeros(2), setpoint=setpoint, watch=view)
        assert complaints(browser, axe, view.server.address) == []


def test_the_page_of_a_sweep(browser, axe, tmp_path):
    sweep = Sweep(
        arm={"robot": "pera_shoulder"},
        law={"name": "energy_shaping", "goal": [0.3, 0.5]},
        run={"duration": 0.1},
        vary={"mass_factor": {"uniform": [0.9, 1.1]}, "gain_factor.stiffness": [0.5, 1.0, 2.0]},
        sampling={"method": "random", "runs": 8},
        measures=["final_error", "peak_torque"],
        require={"final_error": 0.1},
    )
    write_report(sweep.run(tmp_path / "sweep", workers=1))
    assert complaints(browser, axe, (tmp_path / "sweep" / "report.html").as_uri(), ready=None) == []


def test_the_page_of_the_reproduction(browser, axe, tmp_path):
    def claim(name, ours, **more):
        finding = Finding((ours,), "as erratum E8 has it")
        return Claim(name, f"{name} is 1", Origin.FIGURE, "figure 4.7", (1.0,), "s", 0.1, [finding], reason="E8, R1",
                     **more).to_dict()  # fmt: skip

    study = {"study": "fig-4-7", "title": "t", "notes": ["a note"], "figures": [], "logs": ["a"], "recordings": ["a"],
             "claims": [claim("shown", 1.0), claim("measured", 1.0, stand_in=True), claim("wrong", 2.0)],
             "seeds": {}}  # fmt: skip
    numbers = ("matching_residual", "gradient_residual", "skewness", "indefiniteness", "largest_storage_rate")
    rows = [
        dict.fromkeys(numbers, 0.0) | {
            "law": "force_control", "robot": "arm", "interconnection": "coriolis", "passed": passed, "samples": 1,
            "verdict": "PASSED" if passed else "FAILED", "driven_by": "", "caveat": "", "seed": 0,
        }
        for passed in (True, False)
    ]  # fmt: skip
    page = tmp_path / "index.html"
    page.write_text(report({"versions": {}, "studies": [study], "certificates": rows, "failed": {"b": "why"}}))
    assert complaints(browser, axe, page.as_uri(), ready=None) == []


def test_axe_sees_what_is_wrong(browser, axe, tmp_path):
    page = tmp_path / "wrong.html"
    page.write_text('<html><body><img src="a.png"><p style="color: #bbb; background: #fff">pale</p></body></html>')
    said = "\n".join(complaints(browser, axe, page.as_uri(), ready=None))
    for rule in ("html-has-lang", "image-alt", "color-contrast"):
        assert f"| {rule} |" in said
