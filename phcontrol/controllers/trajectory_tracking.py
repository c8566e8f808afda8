"""Trajectory tracking (Theorem 6.1.1)."""

from __future__ import annotations

import copy
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, gain, number
from phcontrol.controllers.controller import (
    EMPTY,
    Command,
    Controller,
    PassivePort,
    Shaping,
    Target,
    inertia_scaled_gains,
)
from phcontrol.controllers.tracking_transformation import TrackingTransformation
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics import kernels
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.state import INTERCONNECTIONS, MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import NOTHING, Measured
from phcontrol.trajectories.minimum_jerk import MinimumJerk, usual_speed
from phcontrol.trajectories.sinusoid import Sinusoid
from phcontrol.trajectories.trajectory import Reference, Trajectory, check_trajectory

_feedback = kernels.feedback


class TrajectoryTracking(Controller):
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
    """

    name = "tracking"
    forms: ClassVar[tuple[str, ...]] = (*INTERCONNECTIONS, "transformed")

    def __init__(
        self,
        system: MechanicalSystem,
        *,
        trajectory: Trajectory,
        stiffness: ArrayLike,
        damping: ArrayLike,
        measured: bool = False,
        hold: float = 0.0,
        interconnection: str = "coriolis",
    ) -> None:
        super().__init__(system, interconnection)
        self.trajectory = check_trajectory("trajectory", trajectory, system.n)
        self.stiffness = gain("stiffness", stiffness, system.n)
        self.damping = gain("damping", damping, system.n)
        if not isinstance(measured, bool):
            raise InvalidArgumentError("measured", "must be True or False")
        self.measured = measured
        self.hold = number("hold", hold, minimum=0.0)
        self.transformation = TrackingTransformation(system, trajectory, self.stiffness)
        self._is_coriolis, self._transformed = interconnection == "coriolis", interconnection == "transformed"
        matrix = system.input_matrix
        self._joint_damping = self.damping if matrix is None else matrix @ self.damping @ matrix.T

    @classmethod
    def default_gains(cls, system: MechanicalSystem, goal: Array) -> dict[str, Any]:
        """Return gains critically damped at 4 rad/s or faster, and a trajectory from home to the goal.

        It is a minimum-jerk motion at up to half the velocity limits; with the goal at home itself, a swing.
        """
        stiffness, damping = inertia_scaled_gains(system, goal)
        robot = system.robot
        trajectory: Trajectory = (
            swing(robot, robot.near_home())
            if np.array_equal(goal, robot.home)
            else MinimumJerk.within_limits(robot, robot.home, goal)
        )
        return {"trajectory": trajectory, "stiffness": stiffness, "damping": damping}

    @property
    def unheld(self) -> TrajectoryTracking:
        """The same law for a torque that is not held: the one that the certificate is about."""
        law = copy.copy(self)
        law.hold = 0.0
        return law

    @property
    def needs(self) -> tuple[str, ...]:
        """The external force, when it is cancelled."""
        return ("external_force",) if self.measured else ()

    @property
    def time_span(self) -> float:
        """The trajectory's duration [s]."""
        return max(self.trajectory.duration, 1e-3)

    def target_posture(self, t: float) -> Array:
        """Return q_d at time t [s]."""
        return self.trajectory.at(t).position

    def evaluate(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Command:
        """Return the torque; see :meth:`Controller.evaluate`. The coriolis form needs neither M nor C to be formed."""
        if self.hold:
            t, x = self._middle_of_hold(t, x)
        if not self._is_coriolis:
            return super().evaluate(t, x, state, measured)
        goal = self.trajectory.at(t)
        force = _feedback(
            x.feedforward(goal.velocity, goal.acceleration),
            self.stiffness,
            x.position_error(goal.position),
            self._joint_damping,
            x.velocity,
            goal.velocity,
        )
        if self.measured:
            force -= self._measurement(measured, "external_force")
        return self._command(t, x, state, force, EMPTY)

    def shape(self, t: float, x: MechanicalState, state: Array, measured: Measured) -> Shaping:
        """State s = −q̇_d, its rate, and the effort −K_t q̃ − G C_d Gᵀ(q̇ − q̇_d); "transformed" states −Gβ instead."""
        goal = self.trajectory.at(t)
        force = self._measurement(measured, "external_force") if self.measured else None
        if self._transformed:
            shift = self.transformation.input_force(x, goal) + x.potential_gradient  # the base class adds ∂V/∂q again
            return Shaping(-shift - self._injection(x, goal), cancelled_force=force)
        effort = -self.stiffness.dot(x.position_error(goal.position)) - self._injection(x, goal)
        return Shaping(effort, -goal.velocity, -goal.acceleration, None, force)

    def _injection(self, x: MechanicalState, goal: Reference) -> Array:
        """Return G C_d Gᵀ(q̇ − q̇_d) [N·m]."""
        force: Array = self._joint_damping.dot(x.velocity - goal.velocity)
        return force

    def storage(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> float:
        """Return H_d = ½|p̂|² + ½q̃ᵀK_t q̃ [J]."""
        error, momentum = self._coordinates(x, self.trajectory.at(t))
        return float(0.5 * (momentum.dot(momentum) + error.dot(self.stiffness.dot(error))))

    def passive_port(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> PassivePort:
        """Return Gᵀv, vᵀ(D + G C_d Gᵀ)v, and (D + G C_d Gᵀ)v, v = q̇ − q̇_d."""
        slip = x.velocity - self.trajectory.at(t).velocity
        return PassivePort.of(x, slip, self._joint_damping.dot(slip), slip)

    def coordinates(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Array:
        """Return (q̃, p̂)."""
        return np.concatenate(self._coordinates(x, self.trajectory.at(t)))

    def _coordinates(self, x: MechanicalState, goal: Reference) -> tuple[Array, Array]:
        return x.position_error(goal.position), (x.velocity - goal.velocity).dot(x.factor)

    def target(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Target:
        """Return the closed loop on (q̃, p̂)."""
        goal = self.trajectory.at(t)
        error, momentum = self._coordinates(x, goal)
        zero, inverse = np.zeros((x.system.n, x.system.n)), x.solve_factor(np.eye(x.system.n))
        structure = (
            self.transformation.interconnection(x, goal)
            if self._transformed
            else x.interconnection(self.interconnection)
        )
        return Target(
            coordinates=np.concatenate([error, momentum]),
            interconnection=np.block([[zero, inverse.T], [-inverse, structure]]),
            dissipation=np.block([[zero, zero], [zero, self._injected_damping(x, self.damping)]]),
            gradient=np.concatenate([self.stiffness.dot(error), momentum]),
            port=np.vstack([zero, zero if self.measured else inverse]),
        )

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
