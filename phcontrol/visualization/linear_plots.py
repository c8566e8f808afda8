"""A linear loop in four pictures: poles, steps, frequency responses and the gain."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from phcontrol.analysis.linearization import Linearization
from phcontrol.visualization.colors import COLORS, INK

_POINTS = 400
_LONG = 6.0  # of a step, in slowest time constants


def linear_figure(loop: Linearization, title: str) -> Figure:
    """Return a figure of a loop: its poles, q_i after a step of f_e,i, |f_e,i → q_i|, and the gain to portᵀ∇H_d."""
    figure = Figure(figsize=(11.0, 7.5), layout="constrained")
    (poles, steps), (bode, gain) = figure.subplots(2, 2)
    values = loop.eigenvalues
    poles.scatter(values.real, values.imag, marker="x", color=COLORS[0], linewidths=1.4)
    poles.axvline(0.0, color=INK, linewidth=0.8)
    poles.set(title="poles", xlabel="Re λ [1/s]", ylabel="Im λ [1/s]", xscale="symlog", yscale="symlog")
    poles.margins(0.15)
    fading = -values.real[values.real + loop.uncertainty < 0.0]
    duration = _LONG / float(fading.min()) if fading.size else 1.0
    time, outputs = loop.step_response(duration, _POINTS)
    sizes = np.abs(values)[np.abs(values) > 1e-6 * np.abs(values).max()]
    frequencies = np.geomspace(0.05 * sizes.min(), 20.0 * sizes.max(), _POINTS)
    responses = np.stack([loop.response(each) for each in frequencies])
    for k, joint in enumerate(loop.joints):
        color = COLORS[k % len(COLORS)]
        steps.plot(time, 1e3 * outputs[:, k, k], color=color, label=joint)
        bode.loglog(frequencies, np.abs(responses[:, k, k]), color=color)
    steps.set(title="step of 1 N·m on each joint", xlabel="t [s]", ylabel="q − q* [mrad]")
    steps.legend(fontsize=7, framealpha=0.8)
    bode.set(title="f_e → q, joint by joint", xlabel="ω [rad/s]", ylabel="|q / f_e| [rad/(N·m)]")
    gain.loglog(frequencies, [max(loop.gain(each), 1e-300) for each in frequencies], color=COLORS[0])
    gain.set(title="largest gain from f_e to portᵀ∇H_d", xlabel="ω [rad/s]", ylabel="[rad/s per N·m]")
    for axes in (poles, steps, bode, gain):
        axes.grid(alpha=0.25)
    figure.suptitle(title)
    return figure
