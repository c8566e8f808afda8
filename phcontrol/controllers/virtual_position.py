"""The virtual position that stands for a desired grasping force (4.39), (4.40)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import root

from phcontrol._validation import Array, gain, vector
from phcontrol.exceptions import PHControlError
from phcontrol.mechanics.system import MechanicalSystem, check_system

_FOUND = 1e-9  # of the joint force


class VirtualPosition(NamedTuple):
    """Where a virtual spring must pull to, and what it then asks of the joints.

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, load_robot, virtual_position
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> found = virtual_position(system, "tool", [1.0, 0.0, 0.0], 40.0, contact=system.robot.home)
        >>> np.allclose(40.0 * (found.position - system.robot.home), found.joint_force, atol=1e-6)
        True
    """

    position: Array
    """q_f, shape (n,) [rad]."""
    joint_force: Array
    """f_d = 𝒥(q_f)ᵀF_d, shape (n,) [N·m]."""


def virtual_position(
    system: MechanicalSystem,
    frame: str,
    force: ArrayLike,
    stiffness: ArrayLike,
    *,
    contact: ArrayLike | None = None,
) -> VirtualPosition:
    """Return the q_f whose spring, held at the contact, exerts a force in space: f_d = 𝒥(q_f)ᵀF_d = K_p(q_f − q_c).

    Thesis (4.40), remark 4.2.1; there the contact is at q_c = 0. The Jacobian is that of the virtual position, as
    printed: an equation for q_f, solved numerically from q_c.

    Args:
        system: the model of the arm.
        frame: at whose origin the force acts.
        force: F_d, what the arm exerts there, in the axes of the world, shape (3,) [N], or (6,) with a moment [N·m].
        stiffness: K_p, positive definite [N·m/rad].
        contact: q_c, where the joints are held by what is touched [rad]; 0 if not given.

    Raises PHControlError when no such position is found: the force is more than the spring can be stretched for.

    Example:
        >>> from phcontrol import MechanicalSystem, load_robot, virtual_position
        >>> system = MechanicalSystem(load_robot("pera"))
        >>> virtual_position(system, "tool", [1.0, 0.0, 0.0], 40.0).position.shape
        (7,)
    """
    check_system(system)
    wrench = np.asarray(force, dtype=float)
    wrench = np.concatenate([vector("force", force, 3), np.zeros(3)]) if wrench.size == 3 else vector("force", force, 6)
    K = gain("stiffness", stiffness, system.n)
    held = np.zeros(system.n) if contact is None else vector("contact", contact, system.n)

    def joint_force(position: Array) -> Array:
        return np.asarray(system.at(position).frame_jacobian(frame, "local_world_aligned").T @ wrench, dtype=float)

    def missing(position: Array) -> Array:
        left: Array = K.dot(position - held) - joint_force(position)
        return left

    found = root(missing, held + np.linalg.solve(K, joint_force(held)), method="hybr", tol=1e-13).x
    asked = joint_force(found)
    if float(np.abs(missing(found)).max()) > _FOUND * max(1.0, float(np.abs(asked).max())):
        raise PHControlError(f"found no virtual position for {wrench[:3]} N at '{frame}': a stiffer K_p may have one")
    return VirtualPosition(found, asked)
