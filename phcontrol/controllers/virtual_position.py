"""The virtual position that stands for a desired grasping force (4.39), (4.40)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, gain, vector
from phcontrol.mechanics.system import MechanicalSystem, check_system


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
    """f_d = 𝒥(q_c)ᵀF_d, shape (n,) [N·m]."""


def virtual_position(
    system: MechanicalSystem,
    frame: str,
    force: ArrayLike,
    stiffness: ArrayLike,
    *,
    contact: ArrayLike | None = None,
) -> VirtualPosition:
    """Return the q_f whose spring, held at the contact, exerts a force in space: K_p(q_f − q_c) = 𝒥(q_c)ᵀF_d.

    Thesis (4.40), remark 4.2.1; there the contact is at q_c = 0. The Jacobian is that of the contact, where the arm
    is when the force acts, not that of q_f, as printed (errata E43).

    Args:
        system: the model of the arm.
        frame: at whose origin the force acts.
        force: F_d, what the arm exerts there, in the axes of the world, shape (3,) [N], or (6,) with a moment [N·m].
        stiffness: K_p, positive definite [N·m/rad].
        contact: q_c, where the joints are held by what is touched [rad]; 0 if not given.

    Raises InvalidArgumentError for what has another shape, UnknownNameError for another frame.

    Example:
        >>> from phcontrol import MechanicalSystem, load_robot, virtual_position
        >>> arm = MechanicalSystem(load_robot("pera_shoulder_elbow"))
        >>> found = virtual_position(arm, "tool", [0.0, 0.0, -5.0], 40.0, contact=[0.0, 0.7, -1.8])
        >>> found.position.shape
        (3,)
    """
    check_system(system)
    wrench = np.asarray(force, dtype=float)
    wrench = np.concatenate([vector("force", force, 3), np.zeros(3)]) if wrench.size == 3 else vector("force", force, 6)
    K = gain("stiffness", stiffness, system.n)
    held = np.zeros(system.n) if contact is None else vector("contact", contact, system.n)
    asked = np.asarray(system.at(held).frame_jacobian(frame, "local_world_aligned").T @ wrench, dtype=float)
    return VirtualPosition(held + np.linalg.solve(K, asked), asked)
