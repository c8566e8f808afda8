"""Thesis figures 4.2 to 4.5 and 4.7 to 4.10: grasping a rigid and a compliant body, under both readings of q_f."""

from __future__ import annotations

from dataclasses import replace

from phcontrol.thesis.grasping_claims import body_text, force_claims, position_claims
from phcontrol.thesis.grasping_figure import grasping_figure
from phcontrol.thesis.grasping_printed import PRINTED
from phcontrol.thesis.grasping_runs import NOISE, PERIOD, REST_LENGTH, grasp_logs
from phcontrol.thesis.study import Outcome


def run(name: str, body: str, quantity: str, sampled: bool) -> Outcome:
    """Run one of the figures: all laws on a body, with positions or forces as the figure."""
    logs, printed = grasp_logs(body, sampled), PRINTED[(body, sampled)]
    claims = (position_claims if quantity == "position" else force_claims)(body, sampled)
    if sampled:
        claims = [replace(claim, stand_in=claim.origin.of_the_thesis) for claim in claims]
    kind = "a stand-in for the measurement: sampled at 10 ms, noisy force" if sampled else "simulation"
    notes = [
        "R1: the body stands at 0.20 rad, the virtual position is 0, against the printed q_f = 0.20. R2: both are at "
        f"0.20 rad, and with {REST_LENGTH}, no law touches; there only our laws grasp, which move q_f by the "
        "measured force.",
        "forces of the thesis are printed in N, K_p without a unit: read as N·m and N·m/rad, of the one joint.",
        f"chosen: {body_text(body, sampled)}.",
        *([f"NOT the thesis's measurement, but a simulation: control every {PERIOD} s, force noise of {NOISE} N·m."]
          * sampled),
    ]  # fmt: skip
    title = f"grasping {quantity} of a {body} body ({kind})"
    return Outcome(
        name, title, logs, claims, {name: lambda: grasping_figure(logs, body, quantity, name, printed)}, tuple(notes)
    )
