"""The plant: a robot with its friction, potentials and input matrix."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from scipy.linalg import lapack

from phcontrol._lazy import lazy
from phcontrol._validation import Array, matrix, sequence, vector
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics import kernels
from phcontrol.mechanics.coupled_state import CoupledMechanicalState
from phcontrol.mechanics.friction import Friction, StribeckFriction, check_size
from phcontrol.mechanics.matrix_damping import MatrixDamping
from phcontrol.mechanics.potentials import Potential
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.varying_input import VaryingInput

_finite_copy = kernels.finite_copy


def check_system(system: object) -> None:
    """Raise InvalidArgumentError unless this is a MechanicalSystem."""
    if not isinstance(system, MechanicalSystem):
        raise InvalidArgumentError("system", f"must be a MechanicalSystem, but is {type(system).__name__}")


class MechanicalSystem:
    """The plant M(q)q̈ + C(q,q̇)q̇ + D(q̇)q̇ + ∂V/∂q = G(q) u + f_e, thesis (2.2) with errata E2.

    In port-Hamiltonian form: p = M q̇, H = ½pᵀM⁻¹p + V(q), output y = Gᵀq̇. The external force f_e
    [N·m] acts on the joints (B = I): a wrench F at a frame enters as 𝒥ᵀF (2.5).

    Args:
        robot: the arm.
        friction: a friction model, None for a frictionless arm, or "robot" for what the robot's
            description gives. :class:`MatrixDamping` for a full D(q, q̇).
        potentials: potentials in addition to gravity and to those of the robot itself (its springs).
        input_matrix: G, (n, n) and invertible; the identity if not given. Or a function q ↦ G(q), invertible wherever
            the arm goes: for states, laws, simulations and certificates. What needs a G known beforehand (torque
            filters, limits, compiled laws, momentum observers) refuses it.
        gravity: acceleration of gravity in the world frame [m/s²].

    One system serves one thread: states made by it share a workspace.

    Example:
        >>> from phcontrol import MechanicalSystem, StribeckFriction, load_robot
        >>> system = MechanicalSystem(load_robot("pera_shoulder"), friction=StribeckFriction(viscous=0.2))
        >>> x = system.at([0.3, 0.2], [0.1, -0.2])
        >>> system.n, x.friction_torque  # [N·m]
        (2, array([ 0.02, -0.04]))
    """

    def __init__(
        self,
        robot: Robot,
        *,
        friction: Friction | Literal["robot"] | None = "robot",
        potentials: Sequence[Potential] = (),
        input_matrix: ArrayLike | Callable[[Array], ArrayLike] | None = None,
        gravity: ArrayLike = (0.0, 0.0, -9.81),
    ) -> None:
        if not isinstance(robot, Robot):
            raise InvalidArgumentError("robot", f"must be a Robot (see load_robot), but is {type(robot).__name__}")
        self.robot = robot
        self.n = robot.n
        if isinstance(friction, str) and friction != "robot":
            raise InvalidArgumentError("friction", f"must be a friction model, None or 'robot', but is '{friction}'")
        self.friction: Friction | None = robot.friction if isinstance(friction, str) else friction
        if not (self.friction is None or hasattr(self.friction, "coefficients")):
            raise InvalidArgumentError("friction", f"must be a friction model, None or 'robot', but is {friction!r}")
        if isinstance(self.friction, StribeckFriction):
            check_size(self.friction, self.n)
        self.full_damping: MatrixDamping | None = self.friction if isinstance(self.friction, MatrixDamping) else None
        """The friction where it is a full D(q, q̇)."""
        if self.full_damping is not None:
            self.full_damping.check(robot.home)
        own = sequence("potentials", potentials, "potentials", "gradient", "energy")
        self.potentials: tuple[Potential, ...] = (*robot.potentials, *own)
        self.constant_input: Array | None = None
        """G where it is the same everywhere, and not the identity."""
        self.varying_input: VaryingInput | None = None
        """G(q) where it is a function."""
        if callable(input_matrix):
            self.varying_input = VaryingInput(input_matrix, self.n)
            self.varying_input.matrix(robot.home)
        elif input_matrix is not None:
            self.constant_input = matrix("input_matrix", input_matrix, self.n)
            if np.linalg.cond(self.constant_input) > 1e12:
                raise InvalidArgumentError("input_matrix", "must be invertible")
            self.input_factors = lapack.dgetrf(self.constant_input)[:2]
        self.model: pin.Model = robot.model.copy()
        self.model.gravity.linear = np.array(vector("gravity", gravity, 3))
        self.weightless_model: pin.Model = self.model.copy()
        """The same arm without gravity."""
        self.weightless_model.gravity.linear = np.zeros(3)
        self.data: pin.Data = self.model.createData()
        self.coupling = robot.coupling
        self.has_continuous_joints = bool(robot.continuous.any())
        self.state_type: type[MechanicalState] = MechanicalState if self.coupling is None else CoupledMechanicalState
        self._frame_ids: dict[str, int] = {}

    def __repr__(self) -> str:
        return f"<MechanicalSystem {self.robot.name}: {self.n} joints>"

    def twin(self) -> MechanicalSystem:
        """Return the same plant with a model and a workspace of its own: what happens to one does not to the other."""
        twin = copy.copy(self)
        twin.model, twin.weightless_model = self.model.copy(), self.weightless_model.copy()
        twin.data, twin._frame_ids = twin.model.createData(), {}
        return twin

    def at(self, position: ArrayLike, velocity: ArrayLike | None = None) -> MechanicalState:
        """Return the state at q [rad] and q̇ [rad/s] (0 if not given); both are copied.

        Raises InvalidArgumentError when one has a wrong length or is not finite.
        """
        if velocity is None:
            velocity = np.zeros(self.n)
        q, v = _finite_copy(position, self.n), _finite_copy(velocity, self.n)
        if q is None or v is None:
            q, v = vector("position", position, self.n), vector("velocity", velocity, self.n)
        return self.state_type(self, q, v)

    @property
    def input_matrix(self) -> Array | None:
        """G, shape (n, n), or None for the identity. Raises InvalidArgumentError where it depends on q."""
        self.need_constant_input("what was asked for")
        return self.constant_input

    def need_constant_input(self, user: str) -> None:
        """Raise InvalidArgumentError where G depends on q, for someone who needs a constant one."""
        if self.varying_input is not None:
            raise InvalidArgumentError("input_matrix", f"depends on q, and {user} needs one that does not")

    def motor_torque(self, force: Array) -> Array:
        """Return u = G⁻¹f, the torque that acts on the joints as f, shape (n,) [N·m].

        Raises InvalidArgumentError where G depends on q: then ``MechanicalState.motor_torque`` has it.
        """
        if self.input_matrix is None:
            return force
        torque: Array = lapack.dgetrs(*self.input_factors, force)[0]
        return torque

    @lazy
    def hand_frame(self) -> str:
        """Name of the frame that does the arm's work: its tool, or the last one that all joints of a chain move."""
        robot = self.robot
        if robot.tool_frame:
            return robot.tool_frame
        x = self.at(robot.near_home())
        moves = {
            frame: int(np.abs(x.frame_jacobian(frame, "local_world_aligned")).max(axis=0).astype(bool).sum())
            for frame in robot.frame_names
        }
        most = max(moves.values())
        return [frame for frame, count in moves.items() if count == most][-1]

    def frame_id(self, name: str) -> int:
        """Return Pinocchio's index of a frame. Raises UnknownNameError, listing the frames."""
        index = self._frame_ids.get(name) if isinstance(name, str) else None
        if index is None:
            index = self._frame_ids[name] = self.robot.frame_id(name)
        return index
