"""A constant force on a point, as a potential."""

from __future__ import annotations

from numpy.typing import ArrayLike

from phcontrol._validation import Array, vector
from phcontrol.mechanics.state import MechanicalState
from phcontrol.potentials.frame_potential import WORLD, FramePotential


class PointForce(FramePotential):
    """A constant force on the origin r of a frame: Ψ = Fᵀ(r − r_d), without a goal Fᵀr; ∂Ψ/∂q = 𝒥_vᵀF.

    A law that shapes it pushes with −F and rests where the environment pushes with F: in force control F is the desired
    force of the environment on the arm (Theorem 4.1.1). It has no minimum. The coordinates are r − r_d.

    Args:
        frame: name of a link or frame.
        force: F in the axes of the world, shape (3,) [N].

    Raises:
        InvalidArgumentError: not three finite numbers.

    Example:
        >>> from phcontrol import MechanicalSystem, PointForce, load_robot
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> x = system.at(system.robot.home)
        >>> PointForce("tool", [0.0, 0.0, 10.0]).energy(x) == 10.0 * float(x.placement("tool").translation[2])
        True
    """

    def __init__(self, frame: str, force: ArrayLike) -> None:
        self.force = vector("force", force, 3)
        """F, shape (3,) [N]."""
        super().__init__(frame, WORLD, force=self.force)

    def lever(self, x: MechanicalState) -> Array:
        """Return how ``force`` acts on the joints, 𝒥_vᵀ, shape (n, 3): ∂Ψ/∂q = lever · force."""
        lever: Array = x.frame_kinematics(self.frame).jacobian[:3].T
        return lever
