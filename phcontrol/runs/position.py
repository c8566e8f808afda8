"""Any law on any arm, from rest at home: led to a posture, or along a trajectory. The first thing to try."""

from __future__ import annotations

import math
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigh

from phcontrol._files import write_json
from phcontrol._validation import Array, choice, positive
from phcontrol.analysis.certificate import Certificate
from phcontrol.analysis.certify import SAMPLES, certify
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.registry import find_law, make_controller
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.simulation.closed_loop import simulate
from phcontrol.simulation.integrators import INTEGRATORS
from phcontrol.simulation.log import Log
from phcontrol.simulation.simulation_error import SimulationError
from phcontrol.trajectories.limits import LimitReport, check_limits, check_samples
from phcontrol.trajectories.minimum_jerk import MinimumJerk

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REACHABLE = {"pera": (-0.3, 1.0, -0.3, -0.9, 0.3, -1.2, 0.2), "pera_shoulder": (1.0, 0.5), "pera_gripper": (0.6,)}
"""Postures inside the joint limits, for the shipped arms [rad]."""

LEADING = {"reference", "potential"}
"""Arguments of laws that say otherwise along what they go."""

ON_LIMIT = 1e-6
"""How far beyond a limit a run still counts as on it, relative to the limit (or to 1): what integrating may add."""

STILL = 1e-9
"""How far joints may go in a run in which nothing moved [rad]."""

LONGEST_STEP, SHORTEST_STEP = 1e-3, 1e-4
"""Steps of the integrator that are chosen on their own [s]."""


@dataclass(frozen=True)
class PositionRun:
    """What came of the run."""

    log: Log
    certificate: Certificate
    goal: Array
    """Where the arm should be, shape (n,), or at every sample, shape (N, n) [rad]."""
    wall_time: float
    robot: Robot
    limits: LimitReport | None = None
    """What the trajectory asks of the arm; None for a law that has none."""

    @property
    def departures(self) -> list[str]:
        """Where the run left the arm's position, velocity and effort limits, in words; empty where it kept them."""
        log, robot = self.log, self.robot
        found = check_samples(robot, log.time, log.position, log.velocity, log.torque, rounding=ON_LIMIT).violations
        lines = [
            f"{peak.quantity} of {peak.joint} {_amount(peak.value, peak.quantity, robot, peak.joint)} at "
            f"{peak.time:.3g} s, limit {peak.limit:.3g}"
            for peak in found
        ]
        cut = int(log.saturated.sum())
        return lines + ([f"torque limits cut the law's torque at {cut} of {len(log)} samples"] if cut else [])

    @property
    def final_error(self) -> float:
        """Largest joint error at the end [rad]; in continuous joints the shorter way round."""
        return float(self.errors[-1])

    @property
    def errors(self) -> Array:
        """Largest joint error at every sample, shape (N,) [rad]."""
        error: Array = np.abs(self.robot.difference(self.log.position, self.goal)).max(axis=1)
        return error

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

    @property
    def largest_speed(self) -> float:
        """Largest speed of a joint over its velocity limit; 0 where joints have none."""
        return float((np.abs(self.log.velocity) / self.robot.velocity_limit).max())

    @property
    def overshoot(self) -> float:
        """How far a joint goes beyond where it should be in the end, over its way, of the joints that move most.

        Joints whose way is less than a tenth of the longest are left out: what moves others moves them further.
        """
        goal = self.goal if self.goal.ndim == 1 else self.goal[-1]
        way = self.robot.difference(goal, self.log.position[0])
        beyond = self.robot.difference(self.log.position, goal) * np.sign(way)
        moved = np.abs(way) >= 0.1 * np.abs(way).max()
        if not np.abs(way).max() > 0.0:
            return 0.0
        return float((np.maximum(0.0, beyond.max(axis=0))[moved] / np.abs(way[moved])).max())

    def summary(self) -> str:
        """Return what a reader wants to know, in a few lines."""
        log, robot = self.log, self.robot
        balance = log.power_balance("plant")
        departures, grew = self.departures, self.largest_storage_step
        never = grew <= max(1e-9 * float(log.storage.max()), 1e-12)
        follows = [] if self.limits is None else [
            f"  error on the way   {self.errors.max():.2e} rad at most, "
            f"{self.errors[len(log) // 2 :].max():.2e} rad in the second half",
            *self._asked(self.limits),
        ]  # fmt: skip
        return "\n".join(
            [
                f"{log.metadata['controller']} ({log.metadata['interconnection']}) on {robot.name}, {robot.n} joints",
                f"  final error        {self.outcome} after {log.time[-1]:g} s",
                f"  storage H_d        {log.storage[0]:.3g} J -> {log.storage[-1]:.3g} J, "
                + ("never grew" if never else f"grew by up to {grew:.2g} J in a step"),
                *follows,
                f"  plant's power      balances to {balance.largest_residual:.1e} W "
                f"({balance.relative_residual:.1e} of the largest power)",
                f"  largest speed      {self.largest_speed:.2f} of the velocity limit",
                f"  limits             {'kept' if not departures else 'LEFT: ' + '; '.join(departures)}",
                f"  real-time factor   {self.real_time_factor:.1f} ({log.time[-1]:g} s in {self.wall_time:.2f} s, "
                f"steps of {1e3 * log.metadata['dt']:.3g} ms)",
                *(
                    []
                    if self.moved
                    else ["  note               nothing moved: the arm began where it should be, unpushed"]
                ),
                "",
                str(self.certificate),
            ]
        )

    @property
    def moved(self) -> bool:
        """Whether the arm moved at all, beyond rounding."""
        return float(np.abs(self.log.position - self.log.position[0]).max()) > STILL

    @staticmethod
    def _asked(report: LimitReport) -> list[str]:
        """Return whether what the law is led along keeps the limits, in words."""
        if report.kept:
            return ["  asked of it        within the limits of position, velocity and torque"]
        return [f"  asked of it        {line}" for line in str(report).splitlines()]

    def to_dict(self) -> dict[str, Any]:
        """Return what ``summary`` says, for JSON."""
        log = self.log
        return {
            "controller": log.metadata["controller"],
            "interconnection": log.metadata["interconnection"],
            "robot": self.robot.name,
            "joints": list(self.robot.joint_names),
            "duration": float(log.time[-1]),
            "step": log.metadata["dt"],
            "final_position": log.position[-1].tolist(),
            "final_error": self.final_error,
            "storage": [float(log.storage[0]), float(log.storage[-1])],
            "largest_storage_step": self.largest_storage_step,
            "power_imbalance": log.power_balance("plant").largest_residual,
            "largest_speed": self.largest_speed,
            "departures": self.departures,
            "real_time_factor": self.real_time_factor,
            "certificate": self.certificate.to_dict(),
        }

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


def _amount(value: float, quantity: str, robot: Robot, joint: str) -> str:
    """Return a number with its unit."""
    units = {"position": "rad", "velocity": "rad/s", "torque": "N·m"}
    if robot.prismatic and robot.prismatic[robot.joint_index(joint)]:
        units = {"position": "m", "velocity": "m/s", "torque": "N"}
    return f"{value:.3g} {units[quantity]}"


def reachable_goal(robot: Robot) -> Array:
    """Return a posture inside the limits, some way from home."""
    if robot.name in REACHABLE and len(REACHABLE[robot.name]) == robot.n:
        return np.array(REACHABLE[robot.name])
    return robot.near_home()


def stable_step(law: Controller, posture: Array, integrator: str = "rk4", control_period: float | None = None) -> float:
    """Return the step of an integrator [s]: 1 ms, or less where friction and damping at rest would make that unstable.

    Half of what the integrator bears is used (``longest_stable_step``). Raises InvalidArgumentError where that is less
    than 0.1 ms: such an arm has dry friction on joints without the rotors that go with it.
    """
    borne, joint = longest_stable_step(law, posture, integrator)
    longest = 0.5 * borne
    if longest < SHORTEST_STEP:
        raise InvalidArgumentError(
            "dt",
            f"friction brakes joint '{joint}' of {law.system.robot.name} so hard that it needs steps of "
            f"{longest:.1g} s: its description has friction but no rotor inertia; give one (an armature of 0.05, for "
            "instance), lock that joint, set dt yourself, or integrate with implicit_midpoint",
        )
    period = LONGEST_STEP if control_period is None else positive("control_period", control_period)
    step = min(LONGEST_STEP, longest)
    return period / max(1, math.ceil(period / step - 1e-9))


def longest_stable_step(law: Controller, posture: Array, integrator: str = "rk4") -> tuple[float, str]:
    """Return the longest step with which an integrator damps what is damped fastest [s], and the joint that is.

    The fastest rate is the largest eigenvalue of M⁻¹(D + G C Gᵀ) at home and at the posture.
    """
    system, rate, fastest = law.system, 0.0, ""
    damping = getattr(law, "damping", None)
    for position in (system.robot.home, posture):
        x = system.at(position)
        injected = 0.0 if damping is None else x.input_matrix @ damping @ x.input_matrix.T
        rates, directions = eigh(x.damping_matrix + injected, x.mass_matrix)
        if rates[-1] > rate:
            rate, fastest = float(rates[-1]), system.robot.joint_names[int(np.abs(directions[:, -1]).argmax())]
    return INTEGRATORS[choice("integrator", integrator, INTEGRATORS)].stability / max(rate, 1e-9), fastest


def run_position(
    system: MechanicalSystem,
    *,
    controller: str = "force_feedback",
    goal: dict[str, float] | ArrayLike | None = None,
    duration: float = 10.0,
    interconnection: str = "coriolis",
    samples: int = SAMPLES,
    seed: int = 0,
    options: dict[str, Any] | None = None,
    dt: float | None = None,
    integrator: str = "rk4",
    control_period: float | None = None,
    step: bool = False,
    **simulation: Any,
) -> PositionRun:
    """Let a law act on an arm that rests at home, and certify it there.

    A law that holds a position is led to the goal by a minimum-jerk reference, at up to half of the velocity limits.

    Args:
        system: the arm.
        controller: a law's name, as ``make_controller`` takes it.
        goal: [rad]; by default a reachable posture of the arm.
        duration: [s].
        interconnection: "coriolis" or "canonical".
        samples: states at which the law is certified.
        seed: of these states.
        options: gains and references of the law, replacing the defaults.
        dt: step of the integrator [s]; by default 1 ms, or less where the friction asks for it (``stable_step``).
        integrator: as in ``simulate``.
        control_period: as in ``simulate``.
        step: give the goal at once, as a jump, in place of a reference: force feedback and integral action must
            overshoot it.
        simulation: passed on to ``simulate``.
    """
    belongs_to = find_law(controller).law.run
    if belongs_to != "position":
        raise InvalidArgumentError("controller", f"{controller} does not steer to a posture: use 'run {belongs_to}'")
    posture = reachable_goal(system.robot) if goal is None else system.robot.position(goal)
    chosen = dict(options or {})
    if not step and _can_be_led(controller, chosen):
        start = system.robot.position(simulation.get("q0", system.robot.home), "q0")
        chosen["reference"] = MinimumJerk.within_limits(system.robot, start, posture)
    law: Controller = make_controller(controller, system, posture, interconnection=interconnection, **chosen)
    given, dt = dt, stable_step(law, posture, integrator, control_period) if dt is None else dt
    simulation |= {"dt": dt, "integrator": integrator, "control_period": control_period}
    begun = time.perf_counter()
    try:
        log = simulate(system, law, duration=duration, **simulation)
    except SimulationError as error:
        longest = longest_stable_step(law, posture, integrator)[0]
        if given is None or given <= longest:
            raise
        raise type(error)(f"{error}. The longest stable step here is about {longest:.2g} s", error.log) from error
    wall_time = time.perf_counter() - begun
    certificate, trajectory = certify(law.unheld, system, samples=samples, seed=seed), law.led_along
    if trajectory is None:
        return PositionRun(log, certificate, posture, wall_time, system.robot)
    desired = np.array([trajectory.at(float(t)).position for t in log.time])
    return PositionRun(log, certificate, desired, wall_time, system.robot, check_limits(trajectory, system))


def _can_be_led(controller: str, options: dict[str, Any]) -> bool:
    """Whether a law takes a trajectory of the joints for its goal, and is not given another or another potential."""
    law = find_law(controller).law
    takes = law.parameters.keys()
    return {"goal", "reference"} <= takes and "trajectory" not in takes and not options.keys() & LEADING
