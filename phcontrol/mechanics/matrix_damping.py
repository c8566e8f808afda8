"""A damping that couples the joints and depends on where the arm is: a full D(q, q̇), thesis (2.2)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, finite_array
from phcontrol.exceptions import InvalidArgumentError

_SYMMETRIC = 1e-9  # of the largest entry


class MatrixDamping:
    """The friction torque D(q, q̇)q̇ with a full symmetric D ⪰ 0, in place of one coefficient a joint.

    Drag at a hand, 𝒥ᵀd𝒥, or tendons that run over two joints: friction of one joint that another's motion makes.
    A :class:`TorqueFilter` does not take it, since it bounds the friction of each joint by itself.

    Args:
        matrix: D, shape (n, n) [N·m·s/rad], or a function of q and q̇ that returns it. It is checked where a system is
            made with it, at the arm's home; that it stays symmetric and positive semidefinite is for the certificate
            of a law to see (R_d ⪰ 0).

    Example:
        >>> import numpy as np
        >>> from phcontrol import MatrixDamping, MechanicalSystem, load_robot
        >>> tendon = MatrixDamping([[0.5, 0.2], [0.2, 0.4]])  # [N·m·s/rad]
        >>> arm = MechanicalSystem(load_robot("pera_shoulder"), friction=tendon)
        >>> arm.at([0.0, 0.0], [1.0, 0.0]).friction_torque
        array([0.5, 0.2])
    """

    def __init__(self, matrix: ArrayLike | Callable[[Array, Array], Array]) -> None:
        self._function: Callable[[Array, Array], Array] | None = matrix if callable(matrix) else None
        self._constant = np.zeros((0, 0)) if callable(matrix) else finite_array("matrix", matrix)

    def matrix(self, position: Array, velocity: Array) -> Array:
        """Return D(q, q̇), shape (n, n) [N·m·s/rad]."""
        return self._constant if self._function is None else self._function(position, velocity)

    def coefficients(self, velocity: Array) -> Array:
        """Raise InvalidArgumentError: there is no coefficient a joint."""
        raise InvalidArgumentError(
            "friction", "couples the joints (MatrixDamping): here one is needed that acts on each joint by itself"
        )

    def check(self, position: Array) -> None:
        """Raise InvalidArgumentError unless D is an (n, n) symmetric positive semidefinite matrix at q and at rest."""
        size = position.size
        D = self.matrix(position, np.zeros(size))
        if not isinstance(D, np.ndarray) or D.shape != (size, size):
            raise InvalidArgumentError(
                "friction", f"must give a matrix of shape ({size}, {size}), but gives {np.shape(D)}"
            )
        largest = float(np.abs(D).max(initial=0.0))
        if not np.isfinite(D).all() or np.abs(D - D.T).max() > _SYMMETRIC * largest:
            raise InvalidArgumentError("friction", "must give a symmetric matrix of finite numbers")
        if float(np.linalg.eigvalsh(D)[0]) < -_SYMMETRIC * largest:
            raise InvalidArgumentError("friction", "must give a positive semidefinite matrix: D takes energy")
