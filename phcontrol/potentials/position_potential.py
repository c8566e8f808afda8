"""A spring of the mechanism, as a potential that a law shapes."""

from __future__ import annotations

import numpy as np

from phcontrol._validation import Array, vector
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.potentials import GripperSpring, OnJoint
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.potentials.potential import Goal, Potential


class PositionPotential(Potential):
    """What a plant takes in ``MechanicalSystem(potentials=...)``, the gripper's spring, as a potential to be shaped.

    Ψ(q) = V(q). The coordinates are q: it follows no goal, and a continuous joint is not wrapped.

    Args:
        spring: a ``GripperSpring`` (the same on each joint), or one on a joint of an arm (``OnJoint``). Anything with
            ``energy(position)``, ``gradient(position)`` and ``tangent_stiffness(position)``, the diagonal of ∂²V/∂q²
            (all others zero), does.

    Raises:
        InvalidArgumentError: one of the three is missing.

    Example:
        >>> from phcontrol import GripperSpring, MechanicalSystem, PositionPotential, load_robot
        >>> spring = GripperSpring(closing_stiffness=0.21, opening_stiffness=0.06, rest_angle=0.3, smoothing=1e-3)
        >>> potential = PositionPotential(spring)
        >>> potential.gradient(MechanicalSystem(load_robot("pera_gripper")).at([0.3]))
        array([0.])
    """

    def __init__(self, spring: GripperSpring | OnJoint) -> None:
        for part in (spring, spring.potential) if isinstance(spring, OnJoint) else (spring,):
            missing = [name for name in ("energy", "gradient", "tangent_stiffness") if not hasattr(part, name)]
            if missing:
                message = (
                    f"must have energy, gradient and tangent_stiffness, but {type(part).__name__} has no {missing[0]}"
                )
                raise InvalidArgumentError("spring", message)
        self.spring = spring

    def check(self, system: MechanicalSystem) -> None:
        """Raise InvalidArgumentError unless the spring is on a joint that the arm has."""
        if isinstance(self.spring, OnJoint) and not 0 <= self.spring.index < system.n:
            message = f"is on joint {self.spring.index}, but {system.robot.name} has joints 0 to {system.n - 1}"
            raise InvalidArgumentError("spring", message)
        vector("spring's gradient", self.spring.gradient(system.robot.home), system.n)

    def energy(self, x: MechanicalState, goal: Goal | None = None) -> float:
        """Return V(q) [J]."""
        return self.spring.energy(x.position)

    def gradient(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return ∂V/∂q, shape (n,) [N·m]."""
        return self.spring.gradient(x.position)

    def gradient_rate(
        self, x: MechanicalState, velocity: Array, goal: Goal | None = None, missed: Array | None = None
    ) -> Array:
        """Return (∂²V/∂q²)v, shape (n,) [N·m/s]."""
        rate: Array = self.spring.tangent_stiffness(x.position) * velocity
        return rate

    def hessian_along(self, x: MechanicalState, velocity: Array, goal: Goal | None = None) -> Array:
        """Return (∂²V/∂q²)v, shape (n,) [N·m/s]."""
        return self.gradient_rate(x, velocity)

    def coordinates(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return q, shape (n,) [rad]."""
        return x.position

    def coordinate_gradient(self, x: MechanicalState, goal: Goal | None = None) -> Array:
        """Return ∂V/∂q, shape (n,) [N·m]."""
        return self.gradient(x)

    def coordinate_map(self, x: MechanicalState, goal: Goal | None = None) -> None:
        """Return None: the identity."""
        return

    def held_directions(self, x: MechanicalState) -> Array:
        """Return the rows of the identity of the joints that have a spring."""
        return np.diag((self.spring.tangent_stiffness(x.position) != 0.0).astype(float))

    def __repr__(self) -> str:
        return f"PositionPotential({type(self.spring).__name__})"
