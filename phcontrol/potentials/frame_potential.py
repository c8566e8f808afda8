"""What potentials of a frame's pose share."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array, text
from phcontrol.mechanics import kernels
from phcontrol.mechanics.pose import FrameKinematics, Pose
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.potentials.potential import Goal, Potential

_frame_wrench = kernels.frame_wrench

WORLD = Pose(np.zeros(3), np.eye(3))
"""The world's own pose."""


class Deviation(NamedTuple):
    """How far a frame is from its goal."""

    distance: float
    """[m]; across a free direction, and 0 where the position is free."""
    angle: float
    """[rad]; 0 where the orientation is free."""

    def __str__(self) -> str:
        return f"{self.distance:.3g} m" + (f" and {self.angle:.3g} rad" if self.angle else "")


class FramePotential(Potential):
    """Ψ = ½eᵀK e + Fᵀe + ⟨M, R_e − 1⟩ of a frame's pose (r, R), with e = r − r_d and R_e = R_dᵀR.

    Its wrench at the frame's origin, in the axes of the world, is (K e + F, vee(B − Bᵀ)) with B = R_d M Rᵀ and
    vee(S) = (S₃₂, S₁₃, S₂₁); ∂Ψ/∂q is 𝒥ᵀ times it. The coordinates are (e, R_e), R_e by its nine entries, row by row,
    or one of both. They change with the twist ξ − ξ_d only, also along a goal (r_d, R_d) that moves. M symmetric
    makes a spring, M skew a torque.

    Args:
        frame: its name.
        goal: (r_d, R_d).
        stiffness: K, shape (3, 3), world axes; None for zero.
        force: F, shape (3,), world axes; None for zero.
        turning: M, shape (3, 3), in the axes of the goal; None leaves the orientation out.
        translates: whether e is among the coordinates.
    """

    def __init__(
        self,
        frame: str,
        goal: Pose,
        *,
        stiffness: Array | None = None,
        force: Array | None = None,
        turning: Array | None = None,
        translates: bool = True,
    ) -> None:
        self.frame = text("frame", frame)
        self.goal = goal
        """The pose (r_d, R_d) in the world."""
        self._stiffness, self._force, self._turning = stiffness, force, turning
        self._translates = translates
        self._rows = slice(0 if translates else 3, 3 if turning is None else 6)
        if turning is not None:
            self._turned = goal.rotation @ turning
            self._symmetric, self._skew = 0.5 * (turning + turning.T), 0.5 * (turning - turning.T)

    @property
    def follows(self) -> tuple[str, ...]:
        """The pose of its frame."""
        return (self.frame,)

    def check(self, system: MechanicalSystem) -> None:
        """Raise UnknownNameError unless the arm has the frame."""
        system.frame_id(self.frame)

    def energy(self, x: MechanicalState, goal: Goal | None = None) -> float:
        """Return Ψ [J]."""
        kinematics, pose = x.frame_kinematics(self.frame), self._pose(goal)
        energy = 0.0
        if self._translates:
            error = kinematics.translation - pose.translation
            if self._stiffness is not None:
                energy += 0.5 * error.dot(self._stiffness.dot(error))
            if self._force is not None:
                energy += self._force.dot(error)
        if self._turning is not None:
            # R_e + R_eᵀ − 2 = −E Eᵀ with E = R_e − 1: exact to the square of a small angle
            turn = pose.rotation.T @ kinematics.rotation - np.eye(3)
            energy += np.vdot(self._skew, turn) - 0.5 * np.vdot(self._symmetric, turn @ turn.T)
        return float(energy)

    def gradient(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return 𝒥ᵀ times the wrench, shape (n,) [N·m]."""
        kinematics = x.frame_kinematics(self.frame)
        gradient: Array = self.wrench(kinematics, goal).dot(kinematics.jacobian)
        return gradient

    def gradient_rate(
        self, x: MechanicalState, velocity: Array, goal: Goal | None = None, missed: Array | None = None
    ) -> Array:
        """Return 𝒥̇ᵀ times the wrench, and 𝒥ᵀ times its rate, shape (n,) [N·m/s].

        With ω of the frame, (ė, ω_e) = 𝒥v the twist of the error, and ω − ω_e of the goal, the wrench changes by
        (K ė, (ω − ω_e) × τ + Bᵀω_e − tr(B)ω_e).
        """
        jacobian_rate, kinematics = x.frame_kinematics_rate(self.frame), x.frame_kinematics(self.frame)
        jacobian, rows = kinematics.jacobian, self._rows
        wrench, error_twist = self.wrench(kinematics, goal), jacobian.dot(velocity)
        if missed is not None:
            error_twist[: len(missed)] -= missed
        wrench_rate: Array = np.zeros(6)
        if self._stiffness is not None:
            wrench_rate[:3] = self._stiffness.dot(error_twist[:3])
        if self._turning is not None:
            turn, turned = error_twist[3:], self._turned_map(self._turning, goal).dot(kinematics.rotation.T)
            goal_turn = jacobian[3:].dot(x.velocity) - turn
            wrench_rate[3:] = _cross(goal_turn, wrench[3:]) + turn.dot(turned) - np.trace(turned) * turn
        rate: Array = wrench_rate[rows].dot(jacobian[rows]) + wrench[rows].dot(jacobian_rate[rows])
        return rate

    def wrench(self, kinematics: FrameKinematics, goal: Goal | None = None) -> Array:
        """Return (K e + F, vee(B − Bᵀ)), shape (6,), at the frame's origin in the axes of the world [N, N·m]."""
        pose, turning = self._pose(goal), self._turning
        turn: Array | None = pose.rotation
        if goal is None and turning is not None:
            turning, turn = self._turned, None
        r, R = kinematics.translation, kinematics.rotation
        return _frame_wrench(r, R, pose.translation, turn, self._stiffness, self._force, turning)

    def coordinates(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return (e, R_e), shape (12,), or e, shape (3,), or R_e, shape (9,)."""
        kinematics, pose = x.frame_kinematics(self.frame), self._pose(goal)
        error: Array = kinematics.translation - pose.translation
        if self._turning is None:
            return error
        turn = (pose.rotation.T @ kinematics.rotation).ravel()
        return np.concatenate([error, turn]) if self._translates else turn

    def coordinate_gradient(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return (K e + F, M), of the shape of the coordinates."""
        linear = self.wrench(x.frame_kinematics(self.frame), goal)[:3]
        if self._turning is None:
            return linear
        turn = self._turning.ravel()
        return np.concatenate([linear, turn]) if self._translates else turn

    def coordinate_map(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return A, shape (k, n): ė = 𝒥_v v, and Ṙ_e = (R_dᵀ𝒥_ω v) × R_e, column by column."""
        jacobian = x.frame_kinematics(self.frame).jacobian
        if self._turning is None:
            return jacobian[:3]
        result: Array = self.twist_map(x, goal) @ jacobian
        return result

    def twist_map(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return L, shape (k, 6): how the coordinates change with a twist of the frame against its goal."""
        kinematics, pose = x.frame_kinematics(self.frame), self._pose(goal)
        linear = np.eye(3, 6)
        if self._turning is None:
            return linear
        first, second, third = pose.rotation.T @ kinematics.rotation
        turning: Array = np.zeros((3, 3, 3))  # [i, j, k]: the rate of R_e[i, j] by a turn about the goal's axis k
        turning[0, :, 1], turning[0, :, 2] = third, -second
        turning[1, :, 0], turning[1, :, 2] = -third, first
        turning[2, :, 0], turning[2, :, 1] = second, -first
        turn = np.hstack([np.zeros((9, 3)), turning.reshape(9, 3) @ pose.rotation.T])
        return np.concatenate([linear, turn]) if self._translates else turn

    def held_directions(self, x: MechanicalState) -> Array:
        """Return how the joints move the frame where K holds it, and turn it where M does."""
        jacobian = x.frame_kinematics(self.frame).jacobian
        held = []
        if self._stiffness is not None:
            held.append((self._stiffness / np.abs(self._stiffness).max()) @ jacobian[:3])
        if self._turning is not None and self._symmetric.any():
            held.append(jacobian[3:])
        return np.concatenate([np.zeros((0, x.system.n)), *held])

    def deviation(self, x: MechanicalState, goal: Goal | None = None) -> Deviation:
        """Return how far the frame is from the goal, of what is held."""
        pose, hand = self._pose(goal), x.placement(self.frame)
        error, angle = np.zeros(3), 0.0
        if self._stiffness is not None:
            values, axes = np.linalg.eigh(self._stiffness)
            error = axes[:, values > 1e-9 * values[-1]].T @ (hand.translation - pose.translation)
        if self._turning is not None and self._symmetric.any():
            angle = float(np.linalg.norm(pin.log3(pose.rotation.T @ hand.rotation)))
        return Deviation(float(np.linalg.norm(error)), angle)

    def _pose(self, goal: Goal | None) -> Pose:
        return self.goal if goal is None else goal  # type: ignore[return-value]  # the pose of its frame

    def _turned_map(self, turning: Array, goal: Goal | None) -> Array:
        """Return R_d M."""
        return self._turned if goal is None else self._pose(goal).rotation @ turning

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.frame!r})"


def vee(matrix: Array) -> Array:
    """Return the vector w, shape (3,), of the skew matrix X − Xᵀ = (w × ·)."""
    (_, xy, xz), (yx, _, yz), (zx, zy, _) = matrix.tolist()
    return np.array([zy - yz, xz - zx, yx - xy])


def skew(vector: Array) -> Array:
    """Return the matrix of w × ·, shape (3, 3)."""
    x, y, z = vector.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _cross(first: Array, second: Array) -> Array:
    """Return the cross product of two vectors; ``np.cross`` takes ten times as long."""
    (ax, ay, az), (bx, by, bz) = first.tolist(), second.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
