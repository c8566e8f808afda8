"""Where the arm will be when the object looks as it should (thesis remark 5.2.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, vector
from phcontrol.exceptions import PHControlError
from phcontrol.mechanics.derivatives import right_inverse
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.vision.interaction import interaction_matrix
from phcontrol.vision.observed_object import ObservedObject

TOLERANCE = 1e-10
"""On the features [m]."""
_LONGEST_STEP = 0.2  # [rad]


def goal_posture(
    system: MechanicalSystem,
    scene: ObservedObject,
    features: ArrayLike,
    guess: ArrayLike | None = None,
    steps: int = 500,
) -> Array:
    """Return a posture from which an object has the desired features, by Newton steps from ``guess``, shape (n,) [rad].

    On an arm with more than three joints it is the one that the smallest steps from ``guess`` lead to.

    Args:
        system: the arm.
        scene: the object, with the camera that sees it.
        features: τ_d = (μ, ν, l) [m].
        guess: where to start [rad]; by default the robot's home.
        steps: how many steps at most; each is cut to 0.2 rad, and shorter where the features' scale demands it.

    Raises PHControlError when none is found.

    Example:
        >>> from phcontrol import MechanicalSystem, ObservedObject, PinholeCamera, goal_posture, load_robot
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> x = system.at(system.robot.home)
        >>> thing = ObservedObject.seen_as(PinholeCamera(), [0.001, 0.001, 0.0022], x)
        >>> q = goal_posture(system, thing, [0.0, 0.0, 0.002])
        >>> thing.features(system.at(q)).round(6)
        array([0.   , 0.   , 0.002])
    """
    goal = vector("features", features, 3)
    position = np.array(vector("guess", system.robot.home if guess is None else guess, system.n))
    camera = scene.camera.mounted_on(system.robot)
    for _ in range(steps):
        x = system.at(position)
        seen = scene.features(x)
        error = seen - goal
        if np.abs(error).max() <= TOLERANCE:
            return position
        delta = interaction_matrix(seen, camera.focal_length, scene.length)
        image_jacobian = delta @ x.frame_jacobian(str(camera.frame), "local")
        scale = float(np.trace(image_jacobian @ image_jacobian.T))
        step = right_inverse(image_jacobian, 1e-12 * scale * np.eye(3)) @ error
        position -= step * min(1.0, _LONGEST_STEP / max(float(np.abs(step).max()), 1e-300))
    raise PHControlError(f"no posture found from which the object has the features {goal} m; last {seen} m")
