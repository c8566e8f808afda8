"""The hand of any arm on a spring and a damper: held at a pose and pushed, or led along a path."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array, finite_array
from phcontrol.analysis.certify import SAMPLES, certify
from phcontrol.controllers.cartesian_impedance import CartesianImpedance
from phcontrol.controllers.cartesian_law import CartesianLaw
from phcontrol.controllers.cartesian_tracking import CartesianTracking
from phcontrol.controllers.registry import find_law
from phcontrol.environments.disturbances import Wrench
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.runs.position import PositionRun, stable_step
from phcontrol.simulation.closed_loop import simulate
from phcontrol.simulation.log import Log
from phcontrol.trajectories.files import read_frame_path
from phcontrol.trajectories.frame_arc import FrameArc
from phcontrol.trajectories.frame_line import FrameLine
from phcontrol.trajectories.frame_path import FramePath

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PATHS = ("circle", "line")
RADIUS, WAY, TRAVEL_TIME = 0.08, 0.2, 4.0
"""Of the circle and the line [m], and how long they take [s]."""


@dataclass(frozen=True)
class CartesianRun(PositionRun):
    """What came of the run; ``goal`` is where the law would rest [rad]."""

    frame: str = ""
    """The hand."""
    hand_errors: Array = field(default_factory=lambda: np.zeros((0, 6)))
    """(e, φ): position less the goal's [m], and the turn between them [rad], world axes, shape (N, 6)."""

    picture = "hand.png"

    @property
    def final_error(self) -> float:
        """How far the hand is off at the end [m]."""
        return float(np.linalg.norm(self.hand_errors[-1, :3]))

    @property
    def outcome(self) -> str:
        """Return what is left of the error at the end, in words."""
        angle = float(np.linalg.norm(self.hand_errors[-1, 3:]))
        return f"{1e3 * self.final_error:.3g} mm and {1e3 * angle:.3g} mrad of the hand ({self.frame})"

    def to_dict(self) -> dict[str, Any]:
        """Return what ``summary`` says, for JSON; ``final_error`` is the hand's [m], ``final_turn`` its angle [rad]."""
        turn = float(np.linalg.norm(self.hand_errors[-1, 3:]))
        return super().to_dict() | {"frame": self.frame, "final_turn": turn}

    def figure(self, title: str) -> Figure:
        """Return a picture of the run."""
        from phcontrol.visualization.plots import hand_figure

        return hand_figure(self.log, self.hand_errors, self.frame, title)


def run_cartesian(
    system: MechanicalSystem,
    *,
    controller: str = "cartesian_impedance",
    stiffness: Sequence[float] | None = None,
    push: Sequence[float] | None = None,
    path: str = "circle",
    frame: str | None = None,
    duration: float = 5.0,
    interconnection: str = "coriolis",
    samples: int = SAMPLES,
    seed: int = 0,
    options: dict[str, Any] | None = None,
    dt: float | None = None,
    integrator: str = "rk4",
    control_period: float | None = None,
    **simulation: Any,
) -> CartesianRun:
    """Start at rest near home, hold the hand there or lead it from there along a path, push at it, and certify the law.

    Args:
        system: the arm.
        controller: name of a Cartesian law.
        stiffness: three numbers [N/m], and three more [N·m/rad]; by default what suits the arm.
        push: force on the hand in the axes of the world, from the start on, three numbers [N]; and a torque, three
            more [N·m].
        path: of ``cartesian_tracking``: "circle", "line", or a CSV file as ``read_frame_path`` takes it.
        frame: the hand, by default the arm's own.
        duration: [s].
        interconnection: "coriolis" or "canonical".
        samples: states at which the law is certified.
        seed: of these states.
        options: gains of the law, replacing the defaults.
        dt: step of the integrator [s]; by default as ``stable_step`` says.
        integrator: as in ``simulate``.
        control_period: as in ``simulate``.
        simulation: passed on to ``simulate``.
    """
    kind, chosen = find_law(controller).law, find_law(controller).options | dict(options or {})
    if not issubclass(kind, (CartesianImpedance, CartesianTracking)):
        raise InvalidArgumentError("controller", f"'{controller}' has no hand on a spring: use 'run position'")
    hand = frame or system.hand_frame
    system.frame_id(hand)
    chosen["frame"] = hand
    if stiffness is not None:
        numbers = finite_array("stiffness", stiffness)
        if numbers.shape not in ((3,), (6,)):
            message = f"must be three numbers [N/m], or six with [N·m/rad], but are {numbers.size}"
            raise InvalidArgumentError("stiffness", message)
        chosen["translational_stiffness"] = numbers[:3]
        if numbers.size == 6:
            chosen["rotational_stiffness"] = numbers[3:]
    start = system.robot.near_home()
    if issubclass(kind, CartesianTracking):
        chosen["path"] = _path(system, hand, start, path)
    law = kind.tuned(system, interconnection=interconnection, **chosen)  # about a posture near home, as start
    assert isinstance(law, CartesianLaw)
    if issubclass(kind, CartesianTracking):
        start = law.rest_posture(0.0)
    if push is not None:
        force = finite_array("push", push)
        if force.shape not in ((3,), (6,)):
            raise InvalidArgumentError("push", f"must be a force x,y,z, or with a torque six numbers: {force.tolist()}")
        simulation["disturbance"] = Wrench(hand, np.r_[force, np.zeros(6 - force.size)])
    if dt is None:
        dt = stable_step(law, start, integrator, control_period)
    begun = time.perf_counter()
    log = simulate(
        system, law, q0=start, duration=duration, dt=dt, integrator=integrator, control_period=control_period,
        **simulation,
    )  # fmt: skip
    wall_time = time.perf_counter() - begun
    rest = law.rest_posture(float(log.time[-1]))
    errors = _hand_errors(law, log)
    return CartesianRun(
        log,
        certify(law, system, samples=samples, seed=seed),
        rest,
        wall_time,
        system.robot,
        frame=hand,
        hand_errors=errors,
    )


def _hand_errors(law: CartesianLaw, log: Log) -> Array:
    """Return position and turn of the hand against its goal at every sample, shape (N, 6) [m, rad]."""
    motion, rows = log.frame(law.frame), []
    for t, position, turn in zip(log.time, motion.position, motion.rotation, strict=True):
        goal = law.pose_at(float(t))
        angle = np.zeros(3) if law.rotational_stiffness is None else pin.log3(goal.rotation.T @ turn)
        rows.append(np.r_[position - goal.translation, goal.rotation @ angle])
    return np.array(rows)


def _path(system: MechanicalSystem, frame: str, start: Array, path: str) -> FramePath:
    """Return a path from where the hand is, upright, round the world's x or along its y, or one from a file."""
    placement = system.at(start).placement(frame)
    first = (np.array(placement.translation), np.array(placement.rotation))
    if path == "circle":
        centre = first[0] - [0.0, 0.0, RADIUS]
        return FrameArc(frame, first, centre, (1.0, 0.0, 0.0), 2.0 * math.pi, TRAVEL_TIME)
    if path == "line":
        return FrameLine(frame, first, (first[0] + [0.0, WAY, 0.0], first[1]), TRAVEL_TIME)
    return read_frame_path(Path(path), frame)
