"""The scales of an arm and of a law on it: what is a large velocity, force or controller state there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phcontrol._validation import Array
from phcontrol.analysis.sampled_state import SampledState
from phcontrol.analysis.seen import Seen
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.system import MechanicalSystem

_UNLIMITED_SPEED = 2.0 * np.pi  # [rad/s]; for a prismatic joint a tenth of it [m/s]
_NO_LIMIT = 100.0  # times that: descriptions that say more (10⁴ rad/s of Baxter's head) mean none
_SAMPLES = 8  # of the positions at which the arm's own forces are looked at


@dataclass(frozen=True)
class NaturalUnits:
    """Natural units of an arm, and of a law's own state: a gram-scale arm and a heavy one get the same checks."""

    position: Array
    """1 rad, or 0.3 m for a prismatic joint, shape (n,)."""
    speed: Array
    """The joints' velocity limits; 2π where there is none that means anything, shape (n,) [rad/s]."""
    force: Array
    """The motors' limits, or where there are none what weight and inertia ask for, shape (n,) [N·m]."""
    state: Array
    """Of the controller's own state: what stores as much as the arm at full speed, shape (m,)."""

    @classmethod
    def of(cls, law: Controller, plant: MechanicalSystem, time: float) -> NaturalUnits:
        """Return the units of a law and the plant it is tried on; the law's storage function gives those of its state.

        H_d at rest has a curvature along each entry of the state; with the kinetic energy E that the arm has at its
        velocity limits the unit is sqrt(2E / curvature), and 1 where H_d does not depend on that entry.
        """
        robot = plant.robot
        prismatic = is_prismatic(robot)
        position = np.where(prismatic, 0.3, 1.0)
        limit = np.where(prismatic, 0.1, 1.0) * _UNLIMITED_SPEED
        speed = np.where(robot.velocity_limit < _NO_LIMIT * limit, robot.velocity_limit, limit)
        x = plant.at(law.rest_posture(time))
        inertia = np.diag(x.mass_matrix)
        energy = 0.5 * float(inertia.dot(speed * speed))
        return cls(position, speed, _forces(plant, inertia * speed), _state_units(law, plant, time, energy))

    @property
    def motion(self) -> Array:
        """Of (q, q̇, controller state), in one vector."""
        return np.concatenate([self.position, self.speed, self.state])


def is_prismatic(robot: Robot) -> Array:
    """Return which joints are prismatic, shape (n,)."""
    return np.array(robot.prismatic or [False] * robot.n)


def _forces(plant: MechanicalSystem, inertial: Array) -> Array:
    """Return the effort limits; for joints without one the largest weight at some positions plus M q̇_max / 1 s."""
    robot, generator = plant.robot, np.random.default_rng(0)
    weights = [np.abs(plant.at(robot.random_position(generator)).potential_gradient) for _ in range(_SAMPLES)]
    own = np.max(weights, axis=0) + inertial
    return np.where(np.isfinite(robot.effort_limit), robot.effort_limit, own)


def _state_units(law: Controller, plant: MechanicalSystem, time: float, energy: float) -> Array:
    m = law.state_size
    if m == 0:
        return np.zeros(0)
    view, still = law.system.at(law.rest_posture(time)), np.zeros(plant.n)
    start, scene = law.initial_state(view), law.rest_scene(view)
    seen = Seen.of(law, plant, SampledState(time, view.position, still, start, still, scene, ""))

    def stored(shift: Array) -> float:
        return seen.elsewhere(state=start + shift).stored()

    middle = stored(np.zeros(m))
    curvature = np.array([stored(axis) + stored(-axis) - 2.0 * middle for axis in np.eye(m)])
    felt = curvature > 1e-9 * max(1.0, float(np.abs(curvature).max()))
    return np.where(felt, np.sqrt(2.0 * energy / np.where(felt, curvature, 1.0)), 1.0)
