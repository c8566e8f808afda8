"""Motors that must suffice on given motions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, number, positive, vector
from phcontrol.controllers.controller import Controller
from phcontrol.design.design_problem import DesignProblem
from phcontrol.design.largest_bandwidth import FIRST, largest_bandwidth
from phcontrol.design.placed_gains import placed_gains
from phcontrol.design.specification import Choice, Specification
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.simulation.closed_loop import simulate
from phcontrol.simulation.simulation_error import SimulationError
from phcontrol.trajectories.trajectory import Trajectory, check_trajectory

_STEP = 1e-3  # of the simulations [s]


class TorqueBudget(Specification):
    """The largest bandwidth whose torque on given motions stays inside the effort limits.

    Each motion is simulated with the gains of :class:`DesiredBandwidth`, torques unlimited, and the largest torque held
    against the limits. It says nothing of other motions, and nothing of what disturbs them.

    Args:
        motions: postures from which the goal is a step [rad], and trajectories of the joints that lead the law (of laws
            with a ``reference``).
        damping_ratio: ζ.
        share: of the limits that may be used.
        fastest: bandwidth from which it is looked for [rad/s].
        duration: simulated of a step [s]; of a trajectory its own, and a tenth more.
        disturbance: f_e beside, constant [N·m].

    Example:
        >>> from phcontrol import MechanicalSystem, TorqueBudget, design_gains, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> start = system.robot.near_home()
        >>> found = design_gains("energy_shaping", system, TorqueBudget([start], share=0.8, duration=0.3))
        >>> found.stable
        True
    """

    def __init__(
        self,
        motions: Sequence[ArrayLike | Trajectory],
        *,
        damping_ratio: float = 0.7,
        share: float = 1.0,
        fastest: float = 60.0,
        duration: float = 1.0,
        disturbance: ArrayLike | None = None,
    ) -> None:
        if not isinstance(motions, (list, tuple)) or not motions:
            raise InvalidArgumentError("motions", "must be a list of postures to step from, or of trajectories")
        self.motions = tuple(motions)
        self.damping_ratio = positive("damping_ratio", damping_ratio)
        self.share = number("share", share, minimum=0.01, maximum=1.0)
        self.fastest = number("fastest", fastest, minimum=2.0 * FIRST)
        self.duration = positive("duration", duration)
        self.disturbance = disturbance

    def choose(self, problem: DesignProblem) -> Choice:
        """Return the gains of the largest bandwidth."""
        limit = self.share * problem.system.robot.effort_limit
        if not np.isfinite(limit).any():
            raise InvalidArgumentError("system", f"{problem.system.robot.name} has no effort limits")
        for motion in self.motions:
            if isinstance(motion, Trajectory):
                check_trajectory("motions", motion, problem.system.n)
            else:
                vector("motions", motion, problem.system.n)

        def excess(bandwidth: float) -> Array:
            gains = placed_gains(problem, bandwidth, self.damping_ratio).gains
            asked: Array = np.max([self._asked(problem, gains, motion) for motion in self.motions], axis=0)
            return asked / limit

        found = largest_bandwidth(lambda bandwidth: bool((excess(bandwidth) <= 1.0).all()), self.fastest)
        if not found:
            asked = excess(FIRST)
            worst = int(np.argmax(asked))
            raise PHControlError(
                f"at {FIRST:g} rad/s already joint '{problem.system.robot.joint_names[worst]}' needs "
                f"{asked[worst]:.3g} times what it may: the arm's weight, or the motion itself, is too much"
            )
        chosen = placed_gains(problem, found, self.damping_ratio)
        at_most = excess(found)
        joint = int(np.argmax(at_most))
        name = problem.system.robot.joint_names[joint]
        note = (
            f"the largest bandwidth is {found:.4g} rad/s: there '{name}' needs {at_most[joint]:.1%} of what it may"
            if found < self.fastest
            else f"the motions leave the torques inside the limits up to {self.fastest:g} rad/s, where the search ended"
        )
        return chosen._replace(notes=(*chosen.notes, note))

    def _asked(self, problem: DesignProblem, gains: dict[str, Any], motion: ArrayLike | Trajectory) -> Array:
        """Return the largest torque of each joint [N·m]; infinite where the motion does not end."""
        system, led = problem.system, isinstance(motion, Trajectory)
        law: Controller
        if isinstance(motion, Trajectory):
            name = "trajectory" if "trajectory" in problem.law.parameters else "reference"
            law, start, duration = problem.make(**gains, **{name: motion}), motion.at(0.0), 1.1 * motion.duration
            q0, v0 = start.position, start.velocity
        else:
            law, duration = problem.make(**gains), self.duration
            q0, v0 = vector("motions", motion, system.n), np.zeros(system.n)
        if not led and law.time_span:
            raise InvalidArgumentError("motions", f"must be trajectories, for {problem.name} follows one")
        try:
            log = simulate(
                system, law, q0=q0, v0=v0, duration=duration, dt=_STEP, torque_limit=None, disturbance=self.disturbance
            )
        except SimulationError:
            return np.full(system.n, np.inf)
        largest: Array = np.abs(log.torque).max(axis=0)
        return largest

    def __str__(self) -> str:
        """Return it in words."""
        motions = f"{len(self.motions)} motion{'' if len(self.motions) == 1 else 's'}"
        return (
            f"torques inside {self.share:.0%} of the effort limits on {motions}, damping ratio {self.damping_ratio:g}"
        )
