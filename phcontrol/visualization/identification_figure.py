"""Measured torques against those that a model predicts, before and after its identification."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from phcontrol.identification.identified import Identification
from phcontrol.visualization.colors import COLORS, INK


def identification_figure(found: Identification) -> Figure:
    """Return a figure with a row for each joint: torque measured, by the model as it was, and by the identified one.

    What was kept back from the fit has a grey ground.
    """
    prediction, names = found.prediction, found.robot.joint_names
    figure = Figure(figsize=(9.0, 1.0 + 1.35 * len(names)), layout="constrained")
    rows = np.atleast_1d(np.array(figure.subplots(len(names), 1, sharex=True), dtype=object))
    step = float(np.median(np.diff(prediction.time))) if len(prediction.time) > 1 else 0.0
    errors = [prediction.error(which, kept_back=bool(prediction.kept_back.any())) for which in ("before", "after")]
    for i, (axes, name) in enumerate(zip(rows, names, strict=True)):
        for t in prediction.time[prediction.kept_back]:
            axes.axvspan(t - 0.5 * step, t + 0.5 * step, color="#eceae4", linewidth=0)
        axes.plot(prediction.time, prediction.before[:, i], color=COLORS[1], linewidth=0.8, label="model as it was")
        axes.plot(prediction.time, prediction.measured[:, i], color=INK, linewidth=1.6, label="measured")
        axes.plot(prediction.time, prediction.after[:, i], color=COLORS[2], linewidth=0.9, label="identified")
        axes.set_ylabel("[N·m]", fontsize=7)
        axes.tick_params(labelsize=7)
        title = f"{name}: error {errors[0][i]:.3g} before, {errors[1][i]:.3g} N·m after"
        axes.set_title(title, fontsize=8, loc="left")
    rows[0].legend(fontsize=7, ncols=3, loc="upper right")
    rows[-1].set_xlabel("time [s]; grey: kept back", fontsize=8)
    return figure
