"""The pictures of section 4.2: positions and forces under each reading, with what is printed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from phcontrol.simulation.log import Log
from phcontrol.thesis.grasping_printed import Printed
from phcontrol.thesis.grasping_runs import FOAMS, FORCE, LAW_NAMES, LAWS, PLACE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STYLES = {
    "grasping": ("#0072b2", "-"),
    "grasping-general": ("#56b4e9", "--"),
    "classical-compensated": ("#d55e00", "--"),
    "classical-reversed": ("#e69f00", "-."),
    "classical": ("black", ":"),
    "regulated": ("#009e73", "-"),
    "classical-regulated": ("#cc79a7", "-."),
}
LOWEST, HIGHEST = 0.3, 1.2
"""The least and the largest force to which a panel goes [N·m]: what grows without bound leaves the picture."""


def grasping_figure(logs: Mapping[str, Log], body: str, quantity: str, name: str, printed: Printed) -> Figure:
    """Draw positions or forces, a panel for each reading and body; printed values where their reading is R1."""
    from matplotlib.figure import Figure

    panels = _panels(logs, body, sampled=name in ("fig-4-9", "fig-4-10"))
    figure = Figure(figsize=(7.5, 1.5 + 2.4 * len(panels)), layout="constrained")
    figure.suptitle(f"Figure {name[4:].replace('-', '.', 1)}: {quantity}, {body} body")
    for axes, (group, title) in zip(np.atleast_1d(figure.subplots(len(panels), 1)), panels.items(), strict=True):
        shown = {law: logs[f"{group}-{law}"] for law in STYLES if f"{group}-{law}" in logs}
        end, at_r1 = (12.0 if group == "R2" else 5.0), group in ("R1", "R1-foam")
        for law, log in shown.items():
            values = log.position[:, 0] if quantity == "position" else log.contact_force
            color, line = STYLES[law]
            axes.plot(log.time, values, color=color, linestyle=line, label=LAW_NAMES[law])
        axes.set(xlim=(0.0, end))
        if quantity == "position":
            _mark_positions(axes, printed if at_r1 else None)
        else:
            highest = max(float(log.contact_force[log.time <= end].max()) for log in shown.values())
            axes.set_ylim(-0.02, min(HIGHEST, max(LOWEST, 1.05 * highest)))
            _mark_forces(axes, printed if at_r1 else None)
        axes.set_title(title, fontsize=10)
        axes.grid(alpha=0.25)
    figure.axes[-1].set_xlabel("t [s]")
    handles = {
        text: handle for axes in figure.axes for handle, text in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(list(handles.values()), list(handles), fontsize=9, loc="outside lower center", ncols=2)
    return figure


def _panels(logs: Mapping[str, Log], body: str, *, sampled: bool) -> dict[str, str]:
    """Return the panels' groups of runs, and titles."""
    at_once = "R2: virtual position 0.20, where the body begins"
    if body == "rigid":
        return {"R1": "R1: virtual position 0, body at 0.20", "R2": at_once}
    panels = {"R1": "R1, foam as printed", "R1-foam": f"R1, foam of {FOAMS[sampled][0]:g} N·m/rad", "R2": at_once}
    if "R8-grasping" in logs:
        panels["R8"] = "R1, R8: foam as printed, coupled by (4.65) and (4.66)"
    return panels


def _mark_positions(axes: Axes, printed: Printed | None) -> None:
    """Draw where the body is, and the printed times of contact."""
    axes.axhspan(0.0, PLACE, color="#bbbbbb", alpha=0.25, linewidth=0.0)
    axes.axhline(PLACE, color="black", linewidth=0.6, label="where the body begins")
    axes.set(ylim=(0.0, 0.31), ylabel="q [rad]")
    for law, time in zip(("grasping", "classical"), printed.contact if printed else (), strict=False):
        if time is not None:
            axes.plot(time, PLACE, "v", color=STYLES[law][0], zorder=5, label="printed time of contact")


def _mark_forces(axes: Axes, printed: Printed | None) -> None:
    """Draw what is to be reached, at the left the printed impacts, and the printed times from which f_d is there."""
    axes.axhline(FORCE, color="black", linewidth=0.6, label="f_d")
    axes.set_ylabel("contact force [N·m]")
    if printed is None:
        return
    for law, impact, time in zip(LAWS, printed.impact, printed.settled, strict=True):
        color = STYLES[law][0]
        axes.plot(0.0, impact, ">", color=color, clip_on=False, zorder=5, label="printed impact")
        if time is not None:
            axes.plot(time, FORCE, "v", color=color, zorder=5, label="printed time of f_d")
