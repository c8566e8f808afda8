"""Plots of a log, one call each: ``log.plot.position()``."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from phcontrol._validation import Array, choice, instance
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.robot import Robot
from phcontrol.simulation.log import Log
from phcontrol.visualization import plots
from phcontrol.visualization.colors import COLORS
from phcontrol.visualization.recorded_robot import recorded_robot

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class LogPlots:
    """Plots of one run. Each method draws into ``axes``, or into a figure of its own, and returns the axes.

    Figures are pyplot's where pyplot is loaded, as in a notebook, so that they are shown; else plain ones, without a
    display: ``axes.figure.savefig("run.png")``. There a legend below says which colour is which joint; in axes that
    are given none is drawn, but each line has its joint's name: ``axes.legend()``.

    Args:
        log: the run.

    Example:
        >>> from phcontrol import MechanicalSystem, load_robot, make_controller, simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> log = simulate(system, make_controller("energy_shaping", system), duration=0.1)
        >>> log.plot.position().get_ylabel()
        'q [rad]'
    """

    def __init__(self, log: Log) -> None:
        self._log = log

    def _of_joints(self, axes: Axes | None) -> Axes:
        """Return axes to draw the joints into; those of a figure of its own have a legend below."""
        if axes is not None:
            return axes
        figure = _figure()
        plots.joints_legend(figure, self._log)
        return figure.subplots()

    @property
    def _robot(self) -> Robot:
        return recorded_robot(self._log)

    def __call__(self, title: str | None = None) -> Figure:
        """Return one page on the run: poses, joints, errors, torques, energy."""
        metadata = self._log.metadata
        robot = self._robot
        name = f"{robot.name} under {metadata['controller']} ({metadata['interconnection']})"
        return plots.run_figure(self._log, robot, self._log.goal, name if title is None else title)

    def position(self, axes: Axes | None = None) -> Axes:
        """Draw joint positions [rad], and dashed where they should be."""
        return plots.plot_joints(self._of_joints(axes), self._log, self._log.goal)

    def error(self, axes: Axes | None = None) -> Axes:
        """Draw how far each joint is from where it should be [rad], on a logarithmic scale.

        Raises InvalidArgumentError for a run without a posture to go to.
        """
        if self._log.goal is None:
            raise InvalidArgumentError("log", "has no posture to go to: its law does not tell one")
        return plots.plot_errors(self._of_joints(axes), self._log, self._robot, self._log.goal)

    def velocity(self, axes: Axes | None = None) -> Axes:
        """Draw joint velocities, over their limits where all joints have one."""
        return plots.plot_velocities(self._of_joints(axes), self._log, self._robot)

    def torque(self, axes: Axes | None = None, *, limits: bool = False) -> Axes:
        """Draw the applied torques [N·m]; with ``limits`` over the motors' limits."""
        return plots.plot_torques(self._of_joints(axes), self._log, self._robot if limits else None)

    def energy(self, axes: Axes | None = None) -> Axes:
        """Draw H_d and the kinetic energy [J], on a logarithmic scale."""
        return plots.plot_energy(_axes(axes), self._log)

    def posture(self, axes: Axes | None = None, *, seen_from: str = "the side") -> Axes:
        """Draw the arm at even parts of its way, from "the side" (x, z) or from "above" (x, y) [m]."""
        choice("seen_from", seen_from, ("the side", "above"))
        return plots.plot_poses(_axes(axes), self._log, self._robot, self._log.goal, seen_from=seen_from)


def compare(logs: Mapping[str, Log], title: str = "") -> Figure:
    """Return runs over each other: largest joint error, largest torque over its limit, H_d, and the hand's way.

    Args:
        logs: the runs by what they shall be called, of arms with the same joints.
        title: of the page.

    Raises InvalidArgumentError for no runs, or runs of different joints.

    Example:
        >>> from phcontrol import MechanicalSystem, compare, load_robot, make_controller, simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> runs = {law: simulate(system, make_controller(law, system), duration=0.1)
        ...         for law in ("energy_shaping", "force_feedback")}
        >>> len(compare(runs).axes)
        4
    """
    if not isinstance(logs, Mapping):
        raise InvalidArgumentError("logs", f"must be runs by name, {{'first': log, ...}}, but is {type(logs).__name__}")
    for name, log in logs.items():
        instance(f"logs[{name!r}]", log, Log)
    if not logs:
        raise InvalidArgumentError("logs", "must hold at least one run")
    joints = {name: log.metadata["joint_names"] for name, log in logs.items()}
    first = next(iter(joints))
    for name, names in joints.items():
        if names != joints[first]:
            raise InvalidArgumentError("logs", f"'{name}' is of the joints {names}, '{first}' of {joints[first]}")
    figure = plots.page_figure(title)
    axes = figure.subplots(2, 2)
    for number, (name, log) in enumerate(logs.items()):
        robot, color = recorded_robot(log), COLORS[number % len(COLORS)]
        style: dict[str, Any] = {
            "color": color,
            "label": name,
            "linestyle": "-" if number < len(COLORS) else "--",
        }
        if log.goal is not None:
            error = np.abs(robot.difference(log.position, log.goal)).max(axis=1)
            axes[0, 0].semilogy(log.time, np.maximum(error, 1e-16), **style)
        axes[0, 1].plot(log.time, _largest(log.torque, np.asarray(robot.effort_limit)), **style)
        axes[1, 0].plot(log.time, log.storage, **style)
        frame = robot.tool_frame or robot.frame_names[-1]
        way = np.array([robot.placement(frame, position).translation for position in log.position])
        axes[1, 1].plot(way[:, 0], way[:, 2], **style)
    for place, (name, label) in zip(axes.flat, _COMPARED, strict=True):
        plots.finish(place, name, label)
    axes[1, 1].set_xlabel("x [m]")
    axes[1, 1].set_aspect("equal", adjustable="datalim")
    handles, labels = axes[0, 1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(6, len(labels)), frameon=False)
    return figure


_COMPARED = (
    ("largest joint error", "|q − q$_d$| [rad]"),
    ("largest torque over its limit", "u over its limit"),
    ("storage function H_d", "[J]"),
    ("way of the hand, from the side", "z [m]"),
)


def _largest(torque: Array, limits: Array) -> Array:
    largest: Array = np.abs(torque / np.where(np.isfinite(limits), limits, 1.0)).max(axis=1)
    return largest


def _axes(axes: Axes | None) -> Axes:
    return _figure().subplots() if axes is None else axes


def _figure() -> Figure:
    pyplot = sys.modules.get("matplotlib.pyplot")
    figure: Figure = Figure(layout="constrained") if pyplot is None else pyplot.figure(layout="constrained")
    return figure
