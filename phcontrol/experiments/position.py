"""An arm goes from rest to a posture and stays there: the first thing to try on any arm."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._files import write_json
from phcontrol._validation import Array, choice
from phcontrol.analysis.certificate import Certificate, certify
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.registry import CONTROLLERS, make_controller
from phcontrol.controllers.visual_servo import VisualServo
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.simulation.closed_loop import simulate
from phcontrol.simulation.log import Log

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REACHABLE = {"pera": (-0.3, 1.0, -0.3, -0.9, 0.3, -1.2, 0.2), "pera_shoulder": (1.0, 0.5), "pera_gripper": (0.6,)}
"""Postures inside the joint limits, for the shipped arms [rad]."""


@dataclass(frozen=True)
class PositionRun:
    """What came of the run."""

    log: Log
    certificate: Certificate
    goal: Array
    wall_time: float
    robot: Robot

    @property
    def final_error(self) -> float:
        """Largest joint error at the end [rad]."""
        return float(np.abs(self.log.position[-1] - self.goal).max())

    @property
    def outcome(self) -> str:
        """Return what is left of the error at the end, in words."""
        return f"{self.final_error:.2e} rad (largest joint error)"

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds per second."""
        return float(self.log.time[-1]) / self.wall_time

    @property
    def largest_storage_step(self) -> float:
        """Largest growth of H_d from one sample to the next [J]; not positive for a passive loop."""
        return float(np.diff(self.log.storage).max())

    def summary(self) -> str:
        """Return what a reader wants to know, in a few lines."""
        log, robot = self.log, self.robot
        peak = np.abs(log.velocity).max(axis=0)
        fast = [
            f"{name} {value:.2f} of {limit:.2f} rad/s"
            for name, value, limit in zip(robot.joint_names, peak, robot.velocity_limit, strict=True)
            if value > limit
        ]
        balance = log.power_balance("plant")
        grew = self.largest_storage_step
        return "\n".join(
            [
                f"{log.metadata['controller']} ({log.metadata['interconnection']}) on {robot.name}, {robot.n} joints",
                f"  final error        {self.outcome} after {log.time[-1]:g} s",
                f"  storage H_d        {log.storage[0]:.3g} J -> {log.storage[-1]:.3g} J, "
                + ("never grew" if grew <= 1e-9 * log.storage[0] else f"grew by up to {grew:.2g} J in a step"),
                f"  plant's power      balances to {balance.largest_residual:.1e} W "
                f"({balance.relative_residual:.1e} of the largest power)",
                f"  torque limits      acted on {int(log.saturated.sum())} of {len(log)} samples",
                f"  velocity limits    {'kept' if not fast else 'exceeded: ' + ', '.join(fast)}",
                f"  real-time factor   {self.real_time_factor:.1f} ({log.time[-1]:g} s in {self.wall_time:.2f} s)",
                "",
                str(self.certificate),
            ]
        )

    picture = "position.png"

    def write(self, directory: str | os.PathLike[str]) -> list[Path]:
        """Write log, picture and certificate; return where."""
        from phcontrol.visualization.plots import save_figure

        folder = Path(directory)
        title = f"{self.robot.name} under {self.log.metadata['controller']} ({self.log.metadata['interconnection']})"
        return [
            self.log.save(folder / "log.npz"),
            write_json(folder / "certificate.json", self.certificate.to_dict()),
            save_figure(self.figure(title), folder / self.picture),
        ]

    def figure(self, title: str) -> Figure:
        """Return a picture of the run."""
        from phcontrol.visualization.plots import run_figure

        return run_figure(self.log, self.robot, self.goal, title)


def reachable_goal(robot: Robot) -> Array:
    """Return a posture inside the limits, some way from home."""
    if robot.name in REACHABLE and len(REACHABLE[robot.name]) == robot.n:
        return np.array(REACHABLE[robot.name])
    middle = np.where(np.isfinite(robot.lower + robot.upper), 0.5 * (robot.lower + robot.upper), robot.home + 1.0)
    step = np.where(np.array(robot.prismatic), 0.05, 0.4)
    goal: Array = robot.home + np.clip(np.where(middle == robot.home, step, middle - robot.home), -step, step)
    return goal


def run_position(
    system: MechanicalSystem,
    *,
    controller: str = "force_feedback",
    goal: dict[str, float] | ArrayLike | None = None,
    duration: float = 10.0,
    interconnection: str = "coriolis",
    samples: int = 50,
    options: dict[str, Any] | None = None,
    **simulation: Any,
) -> PositionRun:
    """Take an arm from its home to a goal and certify the law that did it.

    Args:
        system: the arm.
        controller: a registered law that holds a position.
        goal: [rad]; by default a reachable posture of the arm.
        duration: [s].
        interconnection: "coriolis" or "canonical".
        samples: states at which the law is certified.
        options: gains of the law, replacing the defaults.
        simulation: passed on to ``simulate``.
    """
    if issubclass(CONTROLLERS[choice("controller", controller, CONTROLLERS)].law, VisualServo):
        raise InvalidArgumentError("controller", f"{controller} steers by an image, not to a posture: use 'run servo'")
    posture = reachable_goal(system.robot) if goal is None else system.robot.position(goal)
    law: Controller = make_controller(controller, system, posture, interconnection=interconnection, **(options or {}))
    start = time.perf_counter()
    log = simulate(system, law, duration=duration, **simulation)
    wall_time = time.perf_counter() - start
    return PositionRun(log, certify(law, system, samples=samples), posture, wall_time, system.robot)
