"""Trajectory tracking (Theorem 6.1.1)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, number
from phcontrol.controllers.command import Command
from phcontrol.controllers.energy_shaping import EnergyShaping
from phcontrol.controllers.parameters import Flag, NonNegative, Parameter
from phcontrol.controllers.shaping import Shaping
from phcontrol.controllers.tuning import Tuning
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.state import INTERCONNECTIONS, MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import NOTHING, Measured
from phcontrol.trajectories.minimum_jerk import MinimumJerk, usual_speed
from phcontrol.trajectories.sinusoid import Sinusoid
from phcontrol.trajectories.tracking_transformation import TrackingTransformation
from phcontrol.trajectories.trajectory import Trajectory, check_trajectory


def _usual_trajectory(tuning: Tuning) -> Trajectory:
    """Return a minimum-jerk motion from home to the goal within the velocity limits; to home itself, a swing."""
    robot, goal = tuning.system.robot, tuning.goal
    if np.array_equal(goal, robot.home):
        return swing(robot, robot.near_home())
    return MinimumJerk.within_limits(robot, robot.home, goal)


class TrajectoryTracking(EnergyShaping):
    """Follow a trajectory: a spring and a damper between the arm and a goal that moves.

        p̂ = Tᵀ(q̇ − q̇_d),   q̃ = q − q_d(t)
        u = G⁻¹(∂V/∂q + M q̈_d + C q̇_d + D q̇_d − K_t q̃ [− f_e]) − C_d(y − Gᵀq̇_d)

    Theorem 6.1.1 corrected: errata E22. The closed loop on (q̃, p̂), with H_d = ½|p̂|² + ½q̃ᵀK_t q̃, does not know the
    time any more,

        [[0, T⁻ᵀ], [−T⁻¹, J̄₂ − D̄ − ḠC_dḠᵀ]] ∇H_d,

    so that q → q_d. The measured f_e is cancelled (the thesis's law), or f_e enters as [0; T⁻¹] and a constant one
    shifts the arm by K_t⁻¹f_e.

    ``interconnection`` chooses J̄₂, and with it what the law makes of C q̇_d: "coriolis" is the law above (PD+: B. Paden
    and R. Panja, "Globally asymptotically stable 'PD+' controller for robot manipulators", Int. J. Control 47, 1988);
    "canonical" uses (2.37); "transformed" is the thesis's own route, u = −β − C_d(y + α) − G⁻¹f_e with
    :class:`TrackingTransformation`, in which J̄₂ = P_dT⁻ᵀ − T⁻¹P_dᵀ. All three drive q̃ to zero, on different ways.

    A torque that is held for a period h acts on average h/2 late. With ``hold`` = h it is computed for the middle of
    the period: the reference there, and the arm moved along with it. The certificate is that of ``hold`` = 0.

    Args:
        system: the model of the arm.
        trajectory: q_d(t).
        stiffness: K_t, scalar, vector or matrix, positive definite [N·m/rad].
        damping: C_d, likewise [N·m·s/rad].
        measured: whether the measured external force is cancelled (needs ``external_force``).
        hold: for how long each torque will be held [s].
        interconnection: "coriolis", "canonical" or "transformed".

    Example:
        >>> from phcontrol import MechanicalSystem, Sinusoid, TrajectoryTracking, load_robot, simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> swing = Sinusoid([0.3, 0.2], [0.5, 0.5])  # [rad], [Hz]
        >>> law = TrajectoryTracking(system, trajectory=swing, stiffness=40.0, damping=8.0)
        >>> start = swing.at(0.0)
        >>> log = simulate(system, law, duration=1.0, q0=start.position, v0=start.velocity)
        >>> bool(abs(log.position[-1] - swing.at(1.0).position).max() < 1e-6)  # [rad]
        True
    """

    name = "tracking"
    forms: ClassVar[tuple[str, ...]] = (*INTERCONNECTIONS, "transformed")

    trajectory: Parameter[Trajectory, Trajectory] = Parameter(
        "q_d", "rad", check=lambda name, value, system: check_trajectory(name, value, system.n), tuned=_usual_trajectory
    )
    measured: Flag = Flag(default=False)
    hold: NonNegative = NonNegative("h", "s", default=0.0)

    @classmethod
    def default_gains(
        cls, system: MechanicalSystem, goal: Array, *, given: Mapping[str, Any] = MappingProxyType({}), **desired: Any
    ) -> dict[str, Any]:
        """Return gains that suit a robot, and a trajectory from home to the goal."""
        return super().default_gains(system, goal, given={**given, "goal": None}, **desired)

    def prepare(self) -> None:
        """Take the trajectory for the reference."""
        self.reference = self.trajectory
        super().prepare()
        self.transformation = TrackingTransformation(self.system, self.trajectory, self.stiffness)
        self._transformed = self.interconnection == "transformed"

    @property
    def unheld(self) -> TrajectoryTracking:
        """The same law for a torque that is not held: the one that the certificate is about."""
        return self.changed(hold=0.0)

    @property
    def cancels_external_force(self) -> bool:
        """Whether the measured f_e is cancelled."""
        return self.measured

    @property
    def needs(self) -> tuple[str, ...]:
        """The external force, when it is cancelled."""
        return ("external_force",) if self.measured else ()

    def evaluate(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Command:
        """Return the torque; see :meth:`Controller.evaluate`."""
        if self.hold:
            t, x = self._middle_of_hold(t, x)
        return super().evaluate(t, x, state, measured)

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State what energy shaping does; "transformed" states −Gβ instead."""
        if not self._transformed:
            return super().shape(t, x, state, measured)
        known = self._measurement(measured, "external_force") if self.measured else None
        aim, desired = self.aim(t, x), self.trajectory.at(t)
        shift = self.transformation.input_force(x, desired) + x.potential_gradient  # the base adds ∂V/∂q again
        injected = x.injected_damping(self.damping, aim.velocity)
        return Shaping(-(shift + injected), cancelled_force=known)

    def structure(self, t: float, x: MechanicalState) -> Array:
        """Return J̄₂."""
        if self._transformed:
            return self.transformation.interconnection(x, self.trajectory.at(t))
        return super().structure(t, x)

    def _middle_of_hold(self, t: float, x: MechanicalState) -> tuple[float, MechanicalState]:
        """Return time and state half a period on, if the arm moves as the reference does."""
        later = t + 0.5 * self.hold
        now, then = self.trajectory.at(t), self.trajectory.at(later)
        position = x.position + (then.position - now.position)
        return later, self.system.state_type(self.system, position, x.velocity + (then.velocity - now.velocity))


def swing(robot: Robot, goal: ArrayLike, *, fraction: float = 0.5) -> Sinusoid:
    """Return a sinusoid from home to a posture [rad] and back, at up to a ``fraction`` of the velocity limits.

    It starts from rest at home; all joints have one period, of at least 4 s.
    """
    way = robot.difference(robot.position(goal), robot.home)
    speed = number("fraction", fraction, minimum=0.0, exclusive=True) * usual_speed(robot)
    period = max(4.0, float((np.pi * np.abs(way) / speed).max()))
    return Sinusoid(0.5 * way, 1.0 / period, offset=robot.home + 0.5 * way)
