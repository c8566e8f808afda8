"""A picture of picks: what was seen, where the hand went, with which force it holds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from phcontrol.controllers.event_schedule import Switch
from phcontrol.simulation.log import Log
from phcontrol.visualization.colors import COLORS, INK


def pick_figure(logs: Sequence[Log], switches: Sequence[Sequence[Switch]], force: float) -> Figure:
    """Return one page on picks: a line for each; dots where a phase began.

    Args:
        logs: a run each.
        switches: of each.
        force: that is desired [N·m].
    """
    figure = Figure(figsize=(12.0, 7.5), layout="constrained")
    figure.suptitle(f"{len(logs)} objects seen, reached and grasped", fontsize=13, color=INK)
    axes = figure.subplots(2, 2)
    phases = list(dict.fromkeys(switch.entering for run in switches for switch in run))
    for log, run in zip(logs, switches, strict=True):
        goal = np.array(log.metadata["sight"]["goal"])
        errors = 1e3 * np.abs(log.features - goal).max(axis=1)
        gripper = log.position[:, -1]
        for place, values in ((axes[0, 1], errors), (axes[1, 0], gripper), (axes[1, 1], log.contact_force)):
            place.plot(log.time, values, color="0.6", linewidth=0.7)
            for switch in run:
                k = int(np.searchsorted(log.time, switch.time - 1e-9))
                place.plot(switch.time, values[k], ".", color=COLORS[phases.index(switch.entering) % len(COLORS)])
        axes[0, 0].plot(1e3 * log.features[:, 0], 1e3 * log.features[:, 1], color="0.6", linewidth=0.7)
        axes[0, 0].plot(*(1e3 * log.features[0, :2]), "o", color=INK, markersize=3)
        axes[0, 0].plot(*(1e3 * goal[:2]), "x", color=INK)
    axes[0, 0].invert_yaxis()
    axes[0, 0].set_aspect("equal")
    axes[0, 0].set(title="the object's middle on the image plane, from o to x", xlabel="μ [mm]", ylabel="ν [mm]")
    axes[0, 1].set(title="largest error of a feature", ylabel="[mm]", yscale="log")
    axes[1, 0].set(title="gripper", ylabel="[rad]")
    axes[1, 1].set(title=f"contact moment (line: {force:g} desired)", ylabel="[N·m]")
    axes[1, 1].axhline(force, color=INK, linewidth=0.6)
    for place in axes.flat:
        place.grid(alpha=0.25)
        if place is not axes[0, 0]:
            place.set_xlabel("t [s]")
    for name, color in zip(phases, COLORS, strict=False):
        axes[1, 1].plot([], [], ".", color=color, label=f"{name} begins")
    axes[1, 1].legend(fontsize=8)
    return figure
