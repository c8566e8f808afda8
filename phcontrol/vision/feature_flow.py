"""Features that evolve by their differential equation, as in the thesis's study."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, positive, vector
from phcontrol.mechanics.state import MechanicalState
from phcontrol.vision.interaction import interaction_matrix
from phcontrol.vision.pinhole_camera import PinholeCamera


class FeatureFlow:
    """Features with the state τ and the rate τ̇ = Δ̄(q, τ)q̇, Δ̄ = Δ(τ)𝒥(q) (5.6), from given ones.

    The same as an :class:`ObservedObject` that starts with these features, but for the error of integration: the
    differential equation is that of a fixed point.

    Args:
        camera: what sees them.
        features: τ(0) = (μ, ν, l) [m].
        length: L of the object [m].

    Example:
        >>> from phcontrol import FeatureFlow, MechanicalSystem, PinholeCamera, load_robot
        >>> camera = PinholeCamera()
        >>> flow = FeatureFlow(camera, [0.003, 0.002, 0.0028], length=0.038)  # [m]
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> flow.features(system.at(system.robot.home), flow.initial_state())
        array([0.003 , 0.002 , 0.0028])
    """

    state_size = 3

    def __init__(self, camera: PinholeCamera, features: ArrayLike, length: float) -> None:
        self.camera = camera
        self.start = vector("features", features, 3)
        self.length = positive("length", length)

    def initial_state(self) -> Array:
        """Return τ(0) [m]."""
        return np.array(self.start)

    def rate(self, x: MechanicalState, state: Array) -> Array:
        """Return τ̇ = Δ(τ)𝒥(q)q̇, shape (3,) [m/s]."""
        frame = self.camera.frame or self.camera.mounted_on(x.system.robot).frame
        twist = x.frame_jacobian(str(frame), "local").dot(x.velocity)
        rate: Array = interaction_matrix(state, self.camera.focal_length, self.length).dot(twist)
        return rate

    def features(self, x: MechanicalState, state: Array) -> Array:
        """Return τ [m]."""
        return state
