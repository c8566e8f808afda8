"""A body that gives way: a mass on a spring and a damper."""

from __future__ import annotations

import math

import numpy as np

from phcontrol._validation import Array, number, positive
from phcontrol.environments.body import Body, Rubbing, Surface, Touch
from phcontrol.environments.contact_geometry import ContactGeometry, effective_mass
from phcontrol.mechanics.state import MechanicalState


class CompliantBody(Body):
    """The port-Hamiltonian mass, spring and damper of (4.62) to (4.64), touched one-sidedly.

        H_c = ½p²/m_c + ½K_c s²,   ṡ = p/m_c,   ṗ = −K_c s − d_c p/m_c + F,   output p/m_c

    s is how far its surface is pushed in along the gap, F the contact force. Arm and surface meet in a
    one-sided spring and damper (:class:`Surface`), which pushes both with the same F: what the arm gives,
    −F ġ, the contact and the body receive. (4.65) and (4.66) as printed set a force equal to a velocity;
    here the body's port takes a force and returns a velocity.

    Args:
        geometry: where it is touched when undeformed.
        stiffness: K_c [N/m or N·m/rad].
        damping: d_c [N·s/m or N·m·s/rad].
        mass: m_c [kg or kg·m²].
        surface_stiffness: of the contact, by default 100 K_c.
        surface_damping: of the contact, by default what damps the mass on it critically.
        onset: depth over which the contact's damper sets in [m or rad].
        friction: μ of a fingertip that slides on it; 0 for none.
        slip_speed: below which that friction fades [m/s], see :class:`ContactFriction`.

    Example:
        >>> from phcontrol import CompliantBody, JointContact, MechanicalSystem, load_robot
        >>> gripper = MechanicalSystem(load_robot("pera_gripper"))
        >>> egg = CompliantBody(JointContact("gripper", 0.20), stiffness=30.0, damping=0.5, mass=0.05)
        >>> egg.state_size, egg.initial_state()
        (2, array([0., 0.]))
    """

    def __init__(
        self,
        geometry: ContactGeometry,
        *,
        stiffness: float,
        damping: float,
        mass: float,
        surface_stiffness: float | None = None,
        surface_damping: float | None = None,
        onset: float = 1e-4,
        friction: float = 0.0,
        slip_speed: float = 5e-3,
    ) -> None:
        super().__init__(geometry)
        self.rubbing = Rubbing(geometry, friction, slip_speed)
        self.stiffness = positive("stiffness", stiffness)
        self.damping = number("damping", damping, minimum=0.0)
        self.mass = positive("mass", mass)
        contact = (
            100.0 * self.stiffness if surface_stiffness is None else positive("surface_stiffness", surface_stiffness)
        )
        critical = 2.0 * math.sqrt(contact * self.mass) if surface_damping is None else surface_damping
        self.surface = Surface(contact, number("surface_damping", critical, minimum=0.0), onset)

    @property
    def state_size(self) -> int:
        """Two: displacement and momentum."""
        return 2

    def initial_state(self) -> Array:
        """Return the undeformed body at rest."""
        return np.zeros(2)

    def displacement(self, state: Array) -> float:
        """Return s [m or rad]."""
        return float(state[0])

    def touch(self, x: MechanicalState, state: Array) -> Touch:
        """Return force, rates of (s, p), energy and losses."""
        displacement, momentum = float(state[0]), float(state[1])
        speed = momentum / self.mass
        gap = self.geometry.gap(x)
        depth, closing = -gap.distance - displacement, -float(gap.slope.dot(x.velocity)) - speed
        force, stored, lost = self.surface.push(depth, closing)
        momentum_rate = force - self.stiffness * displacement - self.damping * speed
        rubbed, taken = self.rubbing.force(x, force)
        return Touch(
            gap.slope * force + rubbed,
            np.array([speed, momentum_rate]),
            force,
            stored + 0.5 * momentum * speed + 0.5 * self.stiffness * displacement**2,
            lost + self.damping * speed**2 + taken,
        )

    def fastest_rate(self, x: MechanicalState) -> float:
        """Return the faster of the rates of arm and body on the contact, and of the body on its spring [1/s]."""
        arm = effective_mass(x, self.geometry.gap(x).slope)
        reduced = self.mass if math.isinf(arm) else self.mass * arm / (self.mass + arm)
        return max(self.surface.fastest_rate(reduced), math.sqrt(self.stiffness / self.mass), self.damping / self.mass)
