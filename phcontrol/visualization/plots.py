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

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from phcontrol.mechanics.robot import Robot

INK = "#30343b"
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7a5195", "#6b705c")
"""A palette that stays apart for colour-blind eyes, one colour a joint."""


FEATURES = ("μ", "ν", "l")
"""The image features: where an object is in the image, and how long."""


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> Path:
    """Write a figure as PNG, atomically. Raises DataFileError."""
    return write_atomically(path, lambda file: figure.savefig(file, format="png", dpi=130))


def plot_joints(axes: Axes, log: Log, goal: Array | None = None) -> None:
    """Draw joint positions over time, and dashed where they should be: one goal (n,), or one a sample (N, n)."""
    for i, (name, position) in enumerate(zip(log.metadata["joint_names"], log.position.T, strict=True)):
        color = COLORS[i % len(COLORS)]
        axes.plot(log.time, position, color=color, label=name)
        if goal is not None and goal.ndim == 1:
            axes.axhline(goal[i], color=color, linestyle="--", linewidth=0.8, alpha=0.7)
        elif goal is not None:
            axes.plot(log.time, goal[:, i], color="black", linestyle="--", linewidth=0.8, alpha=0.7)
    _finish(axes, "joint positions (dashed: goal)" if goal is not None else "joint positions", "q [rad]")
    axes.legend(fontsize=7, ncols=2, framealpha=0.8)


def plot_torques(axes: Axes, log: Log) -> None:
    """Draw the applied torques over time."""
    for i, torque in enumerate(log.torque.T):
        axes.plot(log.time, torque, color=COLORS[i % len(COLORS)])
    _finish(axes, "motor torques", "u [N·m]")


def plot_energy(axes: Axes, log: Log) -> None:
    """Draw the storage function H_d and the kinetic energy on a logarithmic scale."""
    floor = max(1e-12, 1e-14 * float(log.storage.max(initial=1.0)))
    axes.semilogy(log.time, np.maximum(log.storage, floor), color=COLORS[0], label="storage $H_d$")
    axes.semilogy(
        log.time, np.maximum(log.kinetic_energy, floor), color=COLORS[1], linewidth=0.9, label="kinetic energy"
    )
    _finish(axes, "energy", "[J]")
    axes.legend(fontsize=8)


def plot_features(axes: Axes, log: Log, goal: Array, part: int, **style: Any) -> None:
    """Draw the error of one image feature (0: μ, 1: ν, 2: l) over time in millimetres on the image plane."""
    axes.plot(log.time, 1e3 * (log.features[:, part] - goal[part]), **style)
    name = FEATURES[part]
    _finish(axes, f"error of {name}", f"{name} − {name}$_d$ [mm]")


def plot_poses(axes: Axes, log: Log, robot: Robot, poses: int = 7) -> None:
    """Draw the arm from the side, as lines through its joints, at even parts of its way."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(log.position, axis=0), axis=1))])
    rows = np.searchsorted(way, np.linspace(0.0, way[-1] * (1.0 - 1e-6), poses))
    for order, row in enumerate(rows):
        points = skeleton(robot, log.position[row])
        shade = 0.12 + 0.88 * order / max(1, poses - 1)
        axes.plot(
            points[:, 0], points[:, 2], "-o", color=COLORS[1] if order == poses - 1 else INK, alpha=shade, markersize=4
        )
    axes.set_aspect("equal", adjustable="datalim")
    _finish(axes, "the arm from the side, from light to dark", "z [m]")
    axes.set_xlabel("x [m]")


def skeleton(robot: Robot, position: Array) -> Array:
    """Return the joints' origins and the tool's in the world, shape (points, 3) [m]."""
    import pinocchio as pin

    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.full_position(position))
    points = [data.oMi[robot.model.getJointId(name)].translation for name in robot.joint_names]
    if robot.tool_frame is not None:
        points.append(data.oMf[robot.frame_id(robot.tool_frame)].translation)
    return np.array(points)


def run_figure(log: Log, robot: Robot, goal: Array | None, title: str) -> Figure:
    """Return one page on a run: poses, joints, torques, energy."""
    figure = Figure(figsize=(12.0, 7.5), layout="constrained")
    figure.suptitle(title, fontsize=13, color=INK)
    axes = figure.subplots(2, 2)
    plot_poses(axes[0, 0], log, robot)
    plot_joints(axes[0, 1], log, goal)
    plot_torques(axes[1, 0], log)
    plot_energy(axes[1, 1], log)
    return figure


def hand_figure(log: Log, errors: Array, frame: str, title: str) -> Figure:
    """Return one page on a hand on a spring: its errors (N, 6) [m, rad], the wrench on it, tank and energy, torques."""
    figure = Figure(figsize=(12.0, 7.5), layout="constrained")
    figure.suptitle(title, fontsize=13, color=INK)
    axes = figure.subplots(2, 2)
    for part, name in enumerate("xyz"):
        color = COLORS[part]
        axes[0, 0].plot(log.time, 1e3 * errors[:, part], color=color, label=f"{name} [mm]")
        axes[0, 0].plot(log.time, 1e3 * errors[:, 3 + part], color=color, linestyle="--", label=f"about {name} [mrad]")
    _finish(axes[0, 0], "error of the hand", "[mm], dashed: [mrad]")
    axes[0, 0].legend(fontsize=7, ncols=2, framealpha=0.8)
    wrench = log.frame(frame).wrench
    for part, name in enumerate("xyz"):
        axes[0, 1].plot(log.time, wrench[:, part], color=COLORS[part], label=f"force, {name} [N]")
        axes[0, 1].plot(
            log.time, wrench[:, 3 + part], color=COLORS[part], linestyle="--", label=f"torque, {name} [N·m]"
        )
    _finish(axes[0, 1], "wrench on the hand from outside", "[N], dashed: [N·m]")
    axes[0, 1].legend(fontsize=7, ncols=2, framealpha=0.8)
    plot_torques(axes[1, 0], log)
    if log.tank_level is None:
        plot_energy(axes[1, 1], log)
    else:
        axes[1, 1].plot(log.time, log.tank_level, color=COLORS[1], label="in the tank")
        axes[1, 1].plot(log.time, log.storage, color=COLORS[0], label="storage $H_d$ with it")
        _finish(axes[1, 1], "energy", "[J]")
        axes[1, 1].legend(fontsize=8)
    return figure


def servo_figure(log: Log, goal: Array, title: str) -> Figure:
    """Return one page on a run of visual servoing: features, joints, torques, energy."""
    figure = Figure(figsize=(12.0, 7.5), layout="constrained")
    figure.suptitle(title, fontsize=13, color=INK)
    axes = figure.subplots(2, 2)
    for part, color in zip(range(len(FEATURES)), COLORS, strict=False):
        plot_features(axes[0, 0], log, goal, part, color=color, label=FEATURES[part])
    _finish(axes[0, 0], "errors of the image features", "[mm]")
    axes[0, 0].legend(fontsize=8)
    plot_joints(axes[0, 1], log)
    plot_torques(axes[1, 0], log)
    plot_energy(axes[1, 1], log)
    return figure


def _finish(axes: Axes, title: str, label: str) -> None:
    axes.set_title(title, fontsize=10, color=INK)
    axes.set_xlabel("t [s]")
    axes.set_ylabel(label)
    axes.grid(alpha=0.25)
