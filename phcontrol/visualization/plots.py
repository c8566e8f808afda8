"""Plots of a log with matplotlib, without a display."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from phcontrol._files import write_atomically
from phcontrol._validation import Array
from phcontrol.simulation.log import Log
from phcontrol.visualization.colors import COLORS, INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from phcontrol.mechanics.robot import Robot

FEATURES = ("μ", "ν", "l")
"""The image features: where an object is in the image, and how long."""


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> Path:
    """Write a figure as PNG, atomically. Raises DataFileError."""
    return write_atomically(path, lambda file: figure.savefig(file, format="png", dpi=130))


def end_of_motion(log: Log) -> float:
    """Return when a run has come to rest, and a little later [s]: where a time axis may end. Else the run's end."""
    speed = np.abs(log.velocity).max(axis=1)
    moving = np.flatnonzero(speed > 1e-3 * speed.max(initial=0.0))
    last = float(log.time[moving[-1]]) if len(moving) else 0.0
    start, end = float(log.time[0]), float(log.time[-1])
    return min(end, start + max(1.3 * (last - start), 0.1 * (end - start)))


def plot_joints(axes: Axes, log: Log, goal: Array | None = None) -> Axes:
    """Draw joint positions over time, and dashed where they should be: one goal (n,), or one a sample (N, n)."""
    for i, (name, position) in enumerate(zip(log.metadata["joint_names"], log.position.T, strict=True)):
        color = COLORS[i % len(COLORS)]
        axes.plot(log.time, position, color=color, label=name)
        if goal is not None and goal.ndim == 1:
            axes.axhline(goal[i], color=color, linestyle="--", linewidth=0.8, alpha=0.7)
        elif goal is not None:
            axes.plot(log.time, goal[:, i], color="black", linestyle="--", linewidth=0.8, alpha=0.7)
    finish(axes, "joint positions (dashed: goal)" if goal is not None else "joint positions", "q [rad]")
    return axes


def plot_errors(axes: Axes, log: Log, robot: Robot, goal: Array) -> Axes:
    """Draw how far each joint is from where it should be, on a logarithmic scale."""
    errors = np.abs(robot.difference(log.position, goal))
    for i, (name, error) in enumerate(zip(robot.joint_names, errors.T, strict=True)):
        axes.semilogy(log.time, np.maximum(error, 1e-16), color=COLORS[i % len(COLORS)], label=name)
    largest = float(errors.max(initial=0.0))
    if largest > 0.0:
        axes.set_ylim(bottom=max(1e-16, 1e-9 * largest))
    finish(axes, "joint errors", "|q − q$_d$| [rad]")
    return axes


def plot_velocities(axes: Axes, log: Log, robot: Robot) -> Axes:
    """Draw joint velocities over time, as parts of the joints' limits where all have one."""
    return _plot_of_limits(axes, log, log.velocity, robot.velocity_limit, "joint velocities", ("q̇", "rad/s"))


def plot_torques(axes: Axes, log: Log, robot: Robot | None = None) -> Axes:
    """Draw the applied torques over time; with a robot, as parts of the motors' limits where all have one."""
    limits = None if robot is None else robot.effort_limit
    return _plot_of_limits(axes, log, log.torque, limits, "motor torques", ("u", "N·m"))


def _plot_of_limits(axes: Axes, log: Log, values: Array, limits: Any, title: str, quantity: tuple[str, str]) -> Axes:
    """Draw a quantity of the joints, (symbol, unit), over its limits where all joints have one."""
    bounded = limits is not None and bool(np.isfinite(limits).all())
    columns = (values / np.asarray(limits) if bounded else values).T
    for i, (name, column) in enumerate(zip(log.metadata["joint_names"], columns, strict=True)):
        axes.plot(log.time, column, color=COLORS[i % len(COLORS)], label=name)
    symbol, unit = quantity
    finish(axes, title, f"{symbol} over its limit" if bounded else f"{symbol} [{unit}]")
    if bounded:
        _mark_limits(axes)
    return axes


def _mark_limits(axes: Axes) -> None:
    """Shade what lies beyond ±1, where the curves come near to it."""
    low, high = axes.get_ylim()
    for sign, reached in ((1.0, high > 0.6), (-1.0, low < -0.6)):
        if reached:
            axes.axhspan(sign, sign * max(1.15, 1.05 * abs(high if sign > 0.0 else low)), color=COLORS[1], alpha=0.12)
            axes.axhline(sign, color=COLORS[1], linestyle="--", linewidth=0.9)


def plot_energy(axes: Axes, log: Log) -> Axes:
    """Draw the storage function H_d and the kinetic energy on a logarithmic scale."""
    largest = max(float(log.storage.max(initial=0.0)), float(log.kinetic_energy.max(initial=0.0)))
    floor = max(1e-18, 1e-12 * largest)
    for values, color, label in ((log.storage, COLORS[0], "storage $H_d$"), (log.kinetic_energy, COLORS[1], "kinetic")):
        shown = values > floor
        if shown.any():
            axes.semilogy(log.time, np.where(shown, values, np.nan), color=color, label=label)
        else:  # as of a law that follows exactly
            axes.axhline(floor, color=color, linestyle=":", label=f"{label} below {floor:.0e} J")
    finish(axes, "", "[J]")
    axes.set_title("energy", fontsize=10, color=INK, loc="left")
    axes.legend(fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False, borderaxespad=0.2)
    return axes


def plot_features(axes: Axes, log: Log, goal: Array, part: int, **style: Any) -> None:
    """Draw the error of one image feature (0: μ, 1: ν, 2: l) over time in millimetres on the image plane."""
    axes.plot(log.time, 1e3 * (log.features[:, part] - goal[part]), **style)
    name = FEATURES[part]
    finish(axes, f"error of {name}", f"{name} − {name}$_d$ [mm]")


def plot_poses(
    axes: Axes, log: Log, robot: Robot, goal: Array | None = None, poses: int = 7, seen_from: str = "the side"
) -> Axes:
    """Draw the arm as lines through its joints at even parts of its way, from the side (x, z) or from above (x, y).

    The last is orange; a goal's posture is drawn in blue, dashed.
    """
    height = 1 if seen_from == "above" else 2
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(log.position, axis=0), axis=1))])
    rows = np.searchsorted(way, np.linspace(0.0, way[-1] * (1.0 - 1e-6), poses))
    for order, row in enumerate(rows):
        points, last = skeleton(robot, log.position[row]), order == poses - 1
        shade = 0.12 + 0.88 * order / max(1, poses - 1)
        axes.plot(points[:, 0], points[:, height], "-o", color=COLORS[1] if last else INK, alpha=shade, markersize=3)
    if goal is not None:
        points = skeleton(robot, goal if goal.ndim == 1 else goal[-1])
        axes.plot(points[:, 0], points[:, height], "--", color=COLORS[0], linewidth=1.2, label="goal")
    axes.set_aspect("equal", adjustable="datalim")
    dashed = "" if goal is None else " (dashed: goal)"
    finish(axes, f"from {seen_from}, light to dark{dashed}", "y [m]" if height == 1 else "z [m]")
    axes.set_xlabel("x [m]")
    return axes


def skeleton(robot: Robot, position: Array) -> Array:
    """Return the base's, the joints' origins and the tool's, or the last link's end, in the world, (points, 3) [m]."""
    import pinocchio as pin

    from phcontrol.visualization.link_ends import link_end

    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.full_position(position))
    points = [np.zeros(3)] + [data.oMi[robot.model.getJointId(name)].translation for name in robot.joint_names]
    last = robot.model.getJointId(robot.joint_names[-1])
    if robot.tool_frame is not None:
        points.append(data.oMf[robot.frame_id(robot.tool_frame)].translation)
    elif (end := link_end(robot.model, last)) is not None:
        points.append(data.oMi[last].act(end))
    return np.array(points)


def run_figure(log: Log, robot: Robot, goal: Array | None, title: str) -> Figure:
    """Return one page on a run: poses from the side and from above, joints, errors or velocities, torques, energy."""
    figure = page_figure(title)
    axes = figure.subplots(2, 3)
    plot_poses(axes[0, 0], log, robot, goal)
    plot_poses(axes[1, 0], log, robot, goal, seen_from="above")
    plot_joints(axes[0, 1], log, goal)
    if goal is None:
        plot_velocities(axes[0, 2], log, robot)
    else:
        plot_errors(axes[0, 2], log, robot, goal)
    plot_torques(axes[1, 1], log, robot)
    plot_energy(axes[1, 2], log)
    for place in (axes[0, 1], axes[0, 2], axes[1, 1], axes[1, 2]):
        place.set_xlim(float(log.time[0]), end_of_motion(log))
    joints_legend(figure, log)
    return figure


def page_figure(title: str) -> Figure:
    """Return an empty page with a title."""
    figure = Figure(figsize=(15.0, 8.0), layout="constrained")
    figure.suptitle(title, fontsize=13, color=INK)
    return figure


def joints_legend(figure: Figure, log: Log) -> None:
    """Write below all plots which colour is which joint."""
    from matplotlib.lines import Line2D

    names = log.metadata["joint_names"]
    handles = [Line2D([], [], color=COLORS[i % len(COLORS)], label=name) for i, name in enumerate(names)]
    wide = 5.5 * max(map(len, names)) + 45.0  # of a name with its line, in points
    columns = max(1, min(len(names), 8, int(72.0 * figure.get_figwidth() / wide)))
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, fontsize=9, frameon=False)


def hand_figure(log: Log, errors: Array, frame: str, title: str) -> Figure:
    """Return one page on a hand on a spring: its errors (N, 6) [m, rad], the wrench on it, tank and energy, torques."""
    figure = page_figure(title)
    axes = figure.subplots(2, 2)
    for part, name in enumerate("xyz"):
        color = COLORS[part]
        axes[0, 0].plot(log.time, 1e3 * errors[:, part], color=color, label=f"{name} [mm]")
        axes[0, 0].plot(log.time, 1e3 * errors[:, 3 + part], color=color, linestyle="--", label=f"about {name} [mrad]")
    finish(axes[0, 0], "error of the hand", "[mm], dashed: [mrad]")
    _legend_beside(axes[0, 0])
    wrench = log.frame(frame).wrench
    for part, name in enumerate("xyz"):
        axes[0, 1].plot(log.time, wrench[:, part], color=COLORS[part], label=f"force, {name} [N]")
        axes[0, 1].plot(
            log.time, wrench[:, 3 + part], color=COLORS[part], linestyle="--", label=f"torque, {name} [N·m]"
        )
    finish(axes[0, 1], "wrench on the hand from outside", "[N], dashed: [N·m]")
    _legend_beside(axes[0, 1])
    plot_torques(axes[1, 0], log)
    joints_legend(figure, log)
    if log.tank_level is None:
        plot_energy(axes[1, 1], log)
    else:
        axes[1, 1].plot(log.time, log.tank_level, color=COLORS[1], label="in the tank")
        axes[1, 1].plot(log.time, log.storage, color=COLORS[0], label="storage $H_d$ with it")
        finish(axes[1, 1], "energy", "[J]")
        _legend_beside(axes[1, 1])
    return figure


def servo_figure(log: Log, goal: Array, title: str) -> Figure:
    """Return one page on a run of visual servoing: features, joints, torques, energy."""
    figure = page_figure(title)
    axes = figure.subplots(2, 2)
    for part, color in zip(range(len(FEATURES)), COLORS, strict=False):
        plot_features(axes[0, 0], log, goal, part, color=color, label=FEATURES[part])
    finish(axes[0, 0], "errors of the image features", "[mm]")
    _legend_beside(axes[0, 0])
    plot_joints(axes[0, 1], log)
    plot_torques(axes[1, 0], log)
    plot_energy(axes[1, 1], log)
    joints_legend(figure, log)
    return figure


def _legend_beside(axes: Axes) -> None:
    """Write the legend to the right of a plot, where it covers nothing."""
    axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)


def finish(axes: Axes, title: str, label: str) -> None:
    """Write title and labels, and a light grid."""
    axes.set_title(title, fontsize=10, color=INK)
    axes.set_xlabel("t [s]")
    axes.set_ylabel(label)
    axes.grid(alpha=0.25)
