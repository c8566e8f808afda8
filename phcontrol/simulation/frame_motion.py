"""How a frame of the arm moved in a run, and what acted on it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from phcontrol._lazy import lazy
from phcontrol._validation import Array
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem


class FrameMotion:
    """Pose, twist, wrench and singularity of a frame at every sample of a run; each computed on first use and once.

    Made by ``Log.frame``. Twists and wrenches are (linear, angular), at the frame's origin in the axes of the world.

    Args:
        system: the arm.
        name: of the frame.
        position: q, shape (N, n) [rad].
        velocity: q̇, shape (N, n) [rad/s].
        external_force: f_e, shape (N, n) [N·m].
    """

    def __init__(
        self, system: MechanicalSystem, name: str, position: Array, velocity: Array, external_force: Array
    ) -> None:
        system.frame_id(name)
        self.name = name
        self._system, self._samples = system, (position, velocity, external_force)

    @lazy
    def position(self) -> Array:
        """r, the frame's origin in the world, shape (N, 3) [m]."""
        return self._of_each(lambda x, force: x.frame_kinematics(self.name).translation)

    @lazy
    def rotation(self) -> Array:
        """R, its axes in the world, shape (N, 3, 3)."""
        return self._of_each(lambda x, force: x.frame_kinematics(self.name).rotation)

    @lazy
    def twist(self) -> Array:
        """(ṙ, ω) = 𝒥q̇, shape (N, 6) [m/s, rad/s]."""
        return self._of_each(lambda x, force: x.frame_kinematics(self.name).jacobian.dot(x.velocity))

    @lazy
    def wrench(self) -> Array:
        """The smallest wrench at the frame that explains f_e = 𝒥ᵀF best, shape (N, 6) [N, N·m].

        It is what acts on the frame where all that acts on the arm does so there, and the posture is not singular.
        """
        return self._of_each(lambda x, force: np.linalg.pinv(x.frame_kinematics(self.name).jacobian.T) @ force)

    @lazy
    def manipulability(self) -> Array:
        """sqrt(det 𝒥𝒥ᵀ), shape (N,); 0 at a singularity."""
        return self._of_each(lambda x, force: x.task_space(self.name).manipulability)

    @lazy
    def singularity_distance(self) -> Array:
        """Smallest singular value of 𝒥 with its angular rows times 0.3 m, shape (N,) [m/rad]; 0 at a singularity."""
        return self._of_each(lambda x, force: x.task_space(self.name).singularity_distance)

    @lazy
    def self_motion_energy(self) -> Array:
        """½|P p̄|², the kinetic energy of the motion that leaves the frame alone, shape (N,) [J]."""

        def energy(x: MechanicalState, force: Array) -> float:
            rest = x.task_space(self.name).without_task(x.transformed_momentum)
            return 0.5 * float(rest.dot(rest))

        return self._of_each(energy)

    def _of_each(self, quantity: Callable[[MechanicalState, Array], Any]) -> Array:
        system = self._system
        rows = (
            quantity(system.state_type(system, position, velocity), force)
            for position, velocity, force in zip(*self._samples, strict=True)
        )
        return np.array(list(rows))
