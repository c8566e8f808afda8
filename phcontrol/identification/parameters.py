"""What can be identified: groups of parameters, their names and units, and the torque that each makes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array, choice
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.system import MechanicalSystem

GROUPS = ("payload", "coulomb", "viscous", "armature", "offset")
"""Groups of parameters: a body at a frame, and of each joint its Coulomb and viscous friction, its rotor, and a
constant torque (of a sensor's zero, or of a spring)."""
BODY = ("mass", "mass·x", "mass·y", "mass·z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""The ten parameters of a body, in which torques are linear, in the order of Pinocchio: first and second moments about
the origin of the joint that moves it."""
_BODY_UNITS = ("kg", *("kg·m",) * 3, *("kg·m²",) * 6)
_BODY_SCALES = (1.0, *(0.1,) * 3, *(0.02,) * 6)
_UNITS = {"coulomb": "N·m", "viscous": "N·m·s/rad", "armature": "kg·m²", "offset": "N·m"}
_SCALES = {"coulomb": 1.0, "viscous": 1.0, "armature": 0.1, "offset": 1.0}
SMOOTHING = 1e-6
"""α_f [rad²/s²] of the sign in the Coulomb friction that is identified."""

Regressor = Callable[[pin.Model, Array, Array, Array], Array]


@dataclass(frozen=True)
class Parameters:
    """The parameters of an identification, in the order of their columns."""

    groups: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    scales: Array
    """What change of each would be a usual one: the unit in which parameters are compared."""
    frame: str | None
    """The frame that the payload is fixed to."""
    joint: int
    """Pinocchio's index of the joint that moves it, 0 without one."""

    def columns(self, group: str) -> slice:
        """Return where the columns of a group are."""
        start = 0
        for name in self.groups:
            size = len(BODY) if name == "payload" else self._joints
            if name == group:
                return slice(start, start + size)
            start += size
        raise InvalidArgumentError("what", f"has no group '{group}'")

    @property
    def _joints(self) -> int:
        sizes = [len(BODY) if name == "payload" else 0 for name in self.groups]
        others = sum(1 for name in self.groups if name != "payload")
        return (len(self.names) - sum(sizes)) // others if others else 0


def parameters_of(robot: Robot, what: Sequence[str], frame: str | None) -> Parameters:
    """Return the parameters that ``what`` names, of an arm. Raises InvalidArgumentError or UnknownNameError."""
    if not isinstance(what, (list, tuple, set, frozenset)) or not what:
        raise InvalidArgumentError("what", f"must be a list of {', '.join(GROUPS)}, but is {what!r}")
    if frame is not None:
        robot.frame_id(frame)
    asked = [choice("group of parameters", name, GROUPS) for name in what]
    groups = tuple(name for name in GROUPS if name in asked)
    names: list[str] = []
    units: list[str] = []
    scales: list[float] = []
    joint = 0
    for group in groups:
        if group == "payload":
            frame = frame or robot.tool_frame
            if frame is None:
                raise InvalidArgumentError(
                    "frame", f"must name what carries the payload: {robot.name} names no tool frame"
                )
            joint = robot.model.frames[robot.frame_id(frame)].parentJoint
            if joint == 0:
                raise InvalidArgumentError("frame", f"'{frame}' is fixed to the base: nothing moves it")
            names += [f"payload {name}" for name in BODY]
            units += _BODY_UNITS
            scales += _BODY_SCALES
        else:
            names += [f"{group} of {name}" for name in robot.joint_names]
            units += [_UNITS[group]] * robot.n
            scales += [_SCALES[group]] * robot.n
    frame = frame if "payload" in groups else None
    return Parameters(groups, tuple(names), tuple(units), np.array(scales), frame, joint)


def body_regressor(system: MechanicalSystem) -> Regressor:
    """Return the function (model, q, v, a) -> torques of all bodies' parameters, shape (n, 10·joints of the model)."""
    data, coupling = system.data, system.coupling
    if coupling is None:
        return lambda model, q, v, a: np.array(pin.computeJointTorqueRegressor(model, data, q, v, a))
    E, offset = coupling.matrix, coupling.offset

    def regressor(model: pin.Model, q: Array, v: Array, a: Array) -> Array:
        full = pin.computeJointTorqueRegressor(model, data, E.dot(q) + offset, E.dot(v), E.dot(a))
        return np.array(E.T.dot(full))

    return regressor


def smooth_sign(velocity: Array, smoothing: float = SMOOTHING) -> Array:
    """Return q̇/√(α_f + q̇²), what Coulomb friction is multiplied with."""
    sign: Array = velocity / np.sqrt(smoothing + velocity * velocity)
    return sign


def torque_columns(system: MechanicalSystem, parameters: Parameters, q: Array, v: Array, a: Array) -> Array:
    """Return the torques that a unit of each parameter makes at (q, q̇, q̈), shape (n, parameters)."""
    n, blocks = system.n, []
    for group in parameters.groups:
        if group == "payload":
            first = 10 * (parameters.joint - 1)
            blocks.append(body_regressor(system)(system.model, q, v, a)[:, first : first + 10])
        else:
            values = {"coulomb": smooth_sign(v), "viscous": v, "armature": a, "offset": np.ones(n)}
            blocks.append(np.diag(values[group]))
    return np.hstack(blocks)
