"""The state of an arm in symbols, as a law sees it while it is traced."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from phcontrol._lazy import lazy
from phcontrol.compilation.errors import NotTraceableError
from phcontrol.compilation.rigid_body import ArmModel, ArmPosture
from phcontrol.compilation.symbol import SymbolArray, symbols
from phcontrol.mechanics.pose import FrameKinematics, Pose
from phcontrol.mechanics.state import MechanicalState, frame_of_reference
from phcontrol.mechanics.system import MechanicalSystem


class TracedState(MechanicalState):
    """A :class:`MechanicalState` whose entries are symbols: the same formulas on other rigid-body quantities.

    Mimic joints follow by the same exact map, q_model = E q + e: M = EᵀM_model E and so on.
    """

    @lazy
    def _map(self) -> Any:
        coupling = self.system.coupling
        return None if coupling is None else coupling.matrix

    @lazy
    def _posture(self) -> ArmPosture:
        arm: ArmModel = self.system.arm  # type: ignore[attr-defined]
        coupling = self.system.coupling
        if coupling is None:
            return arm.at(self.position)
        return arm.at(symbols(coupling.matrix).dot(self.position) + coupling.offset)

    def _full(self, values: Any) -> Any:
        """Return E v: rates of all joints of the model."""
        return values if self._map is None else symbols(self._map).dot(values)

    def _reduced(self, rows: Any) -> SymbolArray:
        """Return Eᵀ M E of a matrix, Eᵀf of a vector."""
        full = symbols(rows)
        if self._map is None:
            return full
        E = symbols(self._map)
        turned = E.T.dot(full)
        reduced: SymbolArray = turned if full.ndim == 1 else turned.dot(E)
        return reduced

    def _independent(self, jacobian: Any) -> Any:
        full = symbols(jacobian)
        return full if self._map is None else full.dot(symbols(self._map))

    @lazy
    def mass_matrix(self) -> Any:
        """M."""
        return self._reduced(self._posture.mass_matrix())

    @lazy
    def coriolis_matrix(self) -> Any:
        """C."""
        return self._reduced(self._posture.coriolis_matrix(self._full(self.velocity)))

    def _weight_gradient(self) -> Any:
        return self._reduced(self._posture.gravity())

    def _weight_energy(self) -> Any:
        return self._posture.weight_energy()

    def _newton_euler(self, mean: Any, lag: Any, acceleration: Any) -> Any:
        velocity, along = self._full(self.velocity), self._full(mean - lag)
        return self._reduced(self._posture.inverse_dynamics(velocity, along, self._full(acceleration)))

    def acceleration(self, torque: Any, external_force: Any = None) -> Any:
        """Return q̈, by the factor of M; what motion and weight take is found without a matrix."""
        velocity = self._full(self.velocity)
        taken = self._reduced(self._posture.inverse_dynamics(velocity, velocity, np.zeros(len(velocity))))
        force = self.applied_force(torque, external_force) - taken
        return self.solve_factor_transposed(self.solve_factor(force))

    @lazy
    def mass_matrix_derivative(self) -> Any:
        """∂M/∂q."""
        full = symbols(self._posture.mass_matrix_derivative())
        if self._map is None:
            return full
        E = symbols(self._map)
        reduced = symbols([E.T.dot(matrix).dot(E) for matrix in full])
        return np.tensordot(E.T, reduced, axes=1).view(SymbolArray)

    # --- frames -----------------------------------------------------------------------------------

    def placement(self, frame: str) -> Any:
        """Return the pose of a frame in the world."""
        r, R = self._posture.frame(self.system.frame_id(frame))
        return Pose(symbols(r), symbols(R))

    def frame_kinematics(self, frame: str) -> FrameKinematics:
        """Return pose and Jacobian."""
        found = self._frame_kinematics.get(frame)
        if found is None:
            jacobian, pose = self.frame_jacobian(frame, "local_world_aligned"), self.placement(frame)
            found = self._frame_kinematics[frame] = FrameKinematics(pose.translation, pose.rotation, jacobian)
        return found

    def frame_kinematics_rate(self, frame: str) -> Any:
        """Return the rate of the Jacobian."""
        rate = self._frame_rates.get(frame)
        if rate is None:
            rate = self._frame_rates[frame] = self.frame_jacobian_rate(frame, "local_world_aligned")
        return rate

    def frame_jacobian(self, frame: str, reference: str) -> Any:
        """Return 𝒥."""
        frame_of_reference(reference)
        return self._independent(self._posture.frame_jacobian(self.system.frame_id(frame), reference))

    def frame_jacobian_rate(self, frame: str, reference: str) -> Any:
        """Return 𝒥̇ along q̇."""
        return self._rate_along(frame, self.velocity, reference)

    def _rate_along(self, frame: str, velocity: Any, reference: str) -> Any:
        frame_of_reference(reference)
        index = self.system.frame_id(frame)
        return self._independent(self._posture.frame_jacobian_rate(index, self._full(velocity), reference))

    def frame_jacobian_and_rate(self, frame: str, reference: str) -> tuple[Any, Any]:
        """Return 𝒥 and 𝒥̇."""
        return self.frame_jacobian(frame, reference), self.frame_jacobian_rate(frame, reference)

    def frame_jacobian_derivative(self, frame: str, reference: str) -> Any:
        """Return ∂𝒥/∂q."""
        return symbols([self._rate_along(frame, unit, reference) for unit in np.eye(self.system.n)])


class TracedSystem(MechanicalSystem):
    """A system whose states hold symbols. Made by ``traced_system``."""

    arm: ArmModel

    def at(self, position: Any, velocity: Any = None) -> TracedState:
        """Return the state at q and q̇."""
        still = symbols(np.zeros(self.n)) if velocity is None else symbols(velocity)
        return TracedState(self, symbols(position), still)

    def twin(self) -> MechanicalSystem:
        """Refuse: there is no second workspace to make."""
        raise NotTraceableError("the law makes another system")


def traced_system(system: MechanicalSystem) -> TracedSystem:
    """Return the same plant for symbols."""
    twin = copy.copy(system)
    twin.__class__ = TracedSystem
    assert isinstance(twin, TracedSystem)
    twin.state_type = TracedState
    twin.arm = ArmModel(system.model)
    return twin
