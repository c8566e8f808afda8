"""A body that hardly gives way."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array
from phcontrol.environments.body import Body, Rubbing, Surface, Touch
from phcontrol.environments.contact_geometry import ContactGeometry, effective_mass
from phcontrol.mechanics.state import MechanicalState

_NOTHING = np.zeros(0)


class RigidBody(Body):
    """A fixed body with a stiff one-sided spring and damper as its surface; see :class:`Surface`.

    Args:
        geometry: where it is touched.
        stiffness: [N/m or N·m/rad].
        damping: [N·s/m or N·m·s/rad].
        onset: depth over which the damper sets in [m or rad].
        friction: μ of a fingertip that slides on it; 0 for none.
        slip_speed: below which that friction fades [m/s], see :class:`ContactFriction`.

    Example:
        >>> from phcontrol import JointContact, MechanicalSystem, RigidBody, load_robot
        >>> gripper = MechanicalSystem(load_robot("pera_gripper"))
        >>> ball = RigidBody(JointContact("gripper", 0.20), stiffness=20.0, damping=0.5)
        >>> touch = ball.touch(gripper.at([0.10]), ball.initial_state())  # 0.1 rad into it
        >>> touch.force.round(2), round(touch.magnitude, 2), round(touch.stored, 3)  # [N·m], [N·m], [J]
        (array([2.]), 2.0, 0.1)
    """

    def __init__(
        self,
        geometry: ContactGeometry,
        *,
        stiffness: float = 1e4,
        damping: float = 0.0,
        onset: float = 1e-4,
        friction: float = 0.0,
        slip_speed: float = 5e-3,
    ) -> None:
        super().__init__(geometry)
        self.rubbing = Rubbing(geometry, friction, slip_speed)
        self.surface = Surface(stiffness, damping, onset)

    def initial_state(self) -> Array:
        """Return nothing: it has no state."""
        return _NOTHING

    def touch(self, x: MechanicalState, state: Array) -> Touch:
        """Return force, energy and losses."""
        gap = self.geometry.gap(x)
        force, stored, lost = self.surface.push(-gap.distance, -float(gap.slope.dot(x.velocity)))
        rubbed, taken = self.rubbing.force(x, force)
        return Touch(gap.slope * force + rubbed, _NOTHING, force, stored, lost + taken)

    def fastest_rate(self, x: MechanicalState) -> float:
        """Return the rate of the arm's effective mass on the surface [1/s]."""
        return self.surface.fastest_rate(effective_mass(x, self.geometry.gap(x).slope))
