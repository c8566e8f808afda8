"""Identification of an arm's parameters from logs, by weighted least squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from phcontrol._validation import Array, choice, number, positive
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.identification.agreement import LATE, check_agreement, said_delay
from phcontrol.identification.consistency import consistent_values, inconsistent
from phcontrol.identification.identified import Identification, Prediction
from phcontrol.identification.motion import Motion, motions_of
from phcontrol.identification.parameters import SMOOTHING, Parameters, parameters_of
from phcontrol.identification.weak_form import Equations, equations_of
from phcontrol.mechanics.friction import StribeckFriction
from phcontrol.mechanics.loading import DRY_FRICTION_SMOOTHING
from phcontrol.mechanics.payload import Payload
from phcontrol.mechanics.potentials import ConstantTorque
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.simulation.log import Log
from phcontrol.simulation.plant_record import plant_from_record

Mask = NDArray[np.bool_]
UNTOLD = ("refuse", "keep")
_ROUNDS = 4  # of weighting the joints by what remains of their torques
_FLOOR = 1e-3  # part of a joint's torque below which what remains is not believed to be all that is wrong
_NULL = 1e-9  # part of the largest singular value below which a direction is not told at all
_SHARE = 1e-2  # of a parameter in such a direction, from which on it is not told either
_SIGMAS = 2.0  # by which torques must be late beyond what they may be, to be doubted
_CLEARER = 0.15  # of the squares of what remains, that must be saved by it
_ROWS = 3  # equations for each parameter, at least


def identify(
    logs: Log | Motion | Sequence[Log | Motion],
    what: Sequence[str] = ("payload", "coulomb", "viscous"),
    *,
    model: Robot | MechanicalSystem | None = None,
    frame: str | None = None,
    window: float = 0.2,
    validation: float = 0.25,
    untold: str = "refuse",
    smoothing: float = SMOOTHING,
) -> Identification:
    """Identify parameters of an arm from how it moved under its torques.

    Both sides of the equations of motion are averaged over windows with a smooth weight, by which no acceleration is
    needed, and the parameters, in which they are linear (Pinocchio's regressor), are found by least squares, each joint
    weighted by what remains of its torque. Where that gives a mass, an inertia or a friction that cannot be, the
    nearest that can is taken (``corrected``). The last part of each log is kept back, and predicted. When Coulomb
    friction is asked for, windows in which a joint turns round are left out of its equations: its velocity does not
    tell its friction there.

    Torques that come later than the motion they make, by a period only, look like friction, and much of it: how late
    they seem is estimated beside the parameters, and more than most of a period makes the result a doubted one
    (``doubts``).

    Args:
        logs: of an arm that moved, best along an :func:`exciting_trajectory`; measurements as :class:`Motion`.
        what: groups out of "payload", "coulomb", "viscous", "armature" and "offset". Friction and rotors are found as
            whole, in place of the model's; a payload beside what the model carries.
        model: of the arm, all that is not asked for; by default what the first log says of its arm.
        frame: what carries the payload; by default the robot's tool frame.
        window: how long torques are averaged [s]: some periods of the sensors' noise, and less than the motion's.
        validation: part of each log that is kept back.
        untold: "refuse" logs that do not tell all parameters, or "keep" the model's values of these.
        smoothing: α_f of the sign in the Coulomb friction [rad²/s²].

    Raises:
        InvalidArgumentError: a log is too short, of another arm, contradicts itself (times in another unit, velocities
            that are late, or not the derivatives of the positions), or tells too little; the message names the
            parameters that cannot be told.
        UnknownNameError: no such group or frame.

    Example:
        >>> from phcontrol import MechanicalSystem, StribeckFriction, TrajectoryTracking, load_robot, simulate
        >>> from phcontrol import exciting_trajectory, identify
        >>> robot = load_robot("pera_shoulder")
        >>> plant = MechanicalSystem(robot, friction=StribeckFriction(viscous=[1.5, 0.8]))
        >>> law = TrajectoryTracking.tuned(
        ...     MechanicalSystem(robot), trajectory=exciting_trajectory(robot, duration=4.0, candidates=10))
        >>> log = simulate(plant, law, q0=law.trajectory.at(0.0).position, duration=4.0, dt=2e-3, progress=False)
        >>> found = identify(log, ("coulomb", "viscous"), model=robot)
        >>> found.values.round(4).tolist(), found.passed  # the plant has no dry friction
        ([0.0, 0.0, 1.5, 0.8], True)
    """
    system = _model(logs, model)
    motions = motions_of(logs, system.input_matrix)
    parameters = parameters_of(system.robot, what, frame)
    choice("untold", untold, UNTOLD)
    window, smoothing = positive("window", window), positive("smoothing", smoothing)
    share = number("validation", validation, minimum=0.0, maximum=0.9)
    _check_friction(system, parameters)
    for motion in motions:
        if motion.position.shape[1] != system.n:
            raise InvalidArgumentError(
                "logs", f"hold {motion.position.shape[1]} joints, but {system.robot.name} has {system.n}"
            )
        check_agreement(system.robot, motion, window)
    parts = [equations_of(system, parameters, motion, window, smoothing) for motion in motions]
    kept = np.concatenate([_kept_back(len(item.time), share) for item in parts])
    equations = _joined(parts)
    _check_length(equations, kept, parameters, window, motions)
    plain = _plain_values(system, parameters)
    used = ~kept[:, None] & (equations.steady if "coulomb" in parameters.groups else True)
    fit = _Fit(equations, used, parameters)
    missing = fit.untold()
    if missing and untold == "refuse":
        raise InvalidArgumentError(
            "logs",
            f"do not tell {', '.join(missing)}: the arm must move more, in more directions and at several speeds "
            "(exciting_trajectory); or leave them out of `what`, or keep the model's values with untold='keep'",
        )
    values = fit.values(plain, missing)
    corrected = inconsistent(parameters, values)
    if corrected:
        values = consistent_values(parameters, *fit.triangle(plain, missing), values)
    covariance = fit.covariance(missing)
    rest = equations.torque - equations.known
    prediction = Prediction(
        equations.time, equations.torque, rest + equations.matrix @ plain, rest + equations.matrix @ values, kept
    )
    body = _payload(system.robot, parameters, values)
    return Identification(
        _identified(system, parameters, values, body), parameters.names, parameters.units, values,
        np.sqrt(np.diag(covariance)), covariance, missing, corrected, body, prediction,
        _doubts(fit, motions),
    )  # fmt: skip


class _Fit:
    """Weighted least squares in usual units."""

    def __init__(self, equations: Equations, used: Mask, parameters: Parameters) -> None:
        self.parameters = parameters
        matrix = np.where(used[..., None], equations.matrix * parameters.scales, 0.0)
        known = np.where(used, equations.known, 0.0)
        count = np.maximum(used.sum(axis=0), 1)
        torque = np.sqrt(np.sum(np.where(used, equations.torque, 0.0) ** 2, axis=0) / count)
        floor = _FLOOR * np.maximum(torque, 1e-2)
        deviation = np.maximum(np.sqrt(np.sum(known**2, axis=0) / count), floor)
        freedom = max(0.1, 1.0 - matrix.shape[2] / max(1, used.sum()))
        for _ in range(_ROUNDS):
            A, b = self._rows(matrix, known, deviation)
            x = np.linalg.lstsq(A, b, rcond=_NULL)[0]
            remains = known - matrix @ x
            deviation = np.maximum(np.sqrt(np.sum(remains**2, axis=0) / count / freedom), floor)
        self.matrix, self.known = self._rows(matrix, known, deviation)
        self._rate = (np.where(used, equations.torque_rate, 0.0) / deviation).ravel()
        self._found = np.linalg.svd(self.matrix, full_matrices=False)

    @staticmethod
    def _rows(matrix: Array, known: Array, deviation: Array) -> tuple[Array, Array]:
        weighted = matrix / deviation[:, None]
        return weighted.reshape(-1, matrix.shape[2]), (known / deviation).ravel()

    def untold(self) -> tuple[str, ...]:
        """Return the names of the parameters that the equations do not tell to within a usual change of them."""
        _, singular, directions = self._found
        told = singular > _NULL * singular[0] if singular.size and singular[0] > 0.0 else np.zeros(len(singular), bool)
        lost = np.linalg.norm(directions[~told], axis=0) > _SHARE
        spread = np.linalg.norm(directions[told] / singular[told][:, None], axis=0) > 1.0
        return tuple(name for name, a, b in zip(self.parameters.names, lost, spread, strict=True) if a or b)

    def delay(self) -> tuple[float, float, float]:
        """Return by how many periods torques seem late, its standard deviation, and its share of what remains.

        A torque u(t − τ) is u − τ u̇: τ is one more parameter. The share of the squares is 1 where it explains all.
        """
        A = np.column_stack([self.matrix, -self._rate])
        x = np.linalg.lstsq(A, self.known, rcond=_NULL)[0]
        plain = np.linalg.lstsq(self.matrix, self.known, rcond=_NULL)[0]
        left, before = (float(np.sum((self.known - B @ y) ** 2)) for B, y in ((A, x), (self.matrix, plain)))
        freedom = max(1, len(self.known) - A.shape[1])
        deviation = np.sqrt(left / freedom * np.linalg.pinv(A.T @ A)[-1, -1])
        return float(x[-1]), float(deviation), 1.0 - left / before if before > 0.0 else 0.0

    def triangle(self, plain: Array, missing: tuple[str, ...]) -> tuple[Array, Array]:
        """Return a matrix and a vector of which least squares are those of the fit; what is missing stays as it was."""
        nailed = np.array([name in missing for name in self.parameters.names], dtype=float) * 1e6
        A = np.vstack([self.matrix, np.diag(nailed)])
        b = np.concatenate([self.known, nailed * plain / self.parameters.scales])
        Q, R = np.linalg.qr(A)
        return R / self.parameters.scales, Q.T @ b

    def values(self, plain: Array, missing: tuple[str, ...]) -> Array:
        """Return the values of least squares."""
        R, b = self.triangle(plain, missing)
        values: Array = np.linalg.lstsq(R * self.parameters.scales, b, rcond=None)[0] * self.parameters.scales
        return values

    def covariance(self, missing: tuple[str, ...]) -> Array:
        """Return the covariance of the values; what is missing has none."""
        told = np.array([name not in missing for name in self.parameters.names])
        size, scales = len(told), self.parameters.scales
        covariance = np.zeros((size, size))
        A = self.matrix[:, told]
        covariance[np.ix_(told, told)] = np.linalg.pinv(A.T @ A) * np.outer(scales[told], scales[told])
        return covariance


def _model(logs: Log | Motion | Sequence[Log | Motion], model: Robot | MechanicalSystem | None) -> MechanicalSystem:
    if isinstance(model, MechanicalSystem):
        return model
    if isinstance(model, Robot):
        return MechanicalSystem(model)
    if model is not None:
        raise InvalidArgumentError("model", f"must be a Robot or a MechanicalSystem, but is {type(model).__name__}")
    first = logs[0] if isinstance(logs, (list, tuple)) and logs else logs
    if not isinstance(first, Log) or "plant" not in first.metadata:
        raise InvalidArgumentError("model", "must be given: measurements, and logs that were not saved, name no arm")
    return plant_from_record(first.metadata)


def _doubts(fit: _Fit, motions: list[Motion]) -> tuple[str, ...]:
    """Return in words what speaks against the logs."""
    late, deviation, clearer = fit.delay()
    if not (abs(late) > LATE + _SIGMAS * deviation and clearer > _CLEARER):
        return ()
    return (
        f"torques that seem {said_delay(late, motions[0].period)} against the motion: shift them by that and see "
        "whether they are predicted better; friction that is not asked for can look alike",
    )


def _check_friction(system: MechanicalSystem, parameters: Parameters) -> None:
    asked = {"coulomb", "viscous"} & set(parameters.groups)
    known = system.friction is None or isinstance(system.friction, StribeckFriction)
    if len(asked) == 1 and not known:
        raise InvalidArgumentError(
            "what", f"must name coulomb and viscous friction together: the model has a {type(system.friction).__name__}"
        )


def _kept_back(windows: int, part: float) -> Mask:
    """Return whether each window is kept back: the last ones."""
    return np.arange(windows) >= windows - int(part * windows)


def _joined(parts: list[Equations]) -> Equations:
    starts = np.cumsum([0.0, *(item.time[-1] if len(item.time) else 0.0 for item in parts)])
    times = [item.time + start for item, start in zip(parts, starts, strict=False)]
    return Equations(
        np.concatenate([item.matrix for item in parts]),
        np.concatenate([item.known for item in parts]),
        np.concatenate([item.torque for item in parts]),
        np.concatenate([item.torque_rate for item in parts]),
        np.concatenate([item.steady for item in parts]),
        np.concatenate(times),
    )


def _check_length(
    equations: Equations, kept: Mask, parameters: Parameters, window: float, motions: list[Motion]
) -> None:
    n, used = equations.known.shape[1], int((~kept).sum())
    needed = -(-_ROWS * len(parameters.names) // n)
    if used < needed:
        lasts = sum(float(motion.time[-1] - motion.time[0]) for motion in motions)
        asked = 0.5 * window * (needed + 2) * max(1.0, len(kept) / max(1, used))
        raise InvalidArgumentError(
            "logs",
            f"are too short: {lasts:.3g} s give {used} windows of {n} equations, and {len(parameters.names)} "
            f"({', '.join(parameters.groups)}) need {needed}, which takes about {asked:.2g} s",
        )


def _plain_values(system: MechanicalSystem, parameters: Parameters) -> Array:
    """Return the values that the model has: no payload and no offset."""
    values = np.zeros(len(parameters.names))
    for group in ("coulomb", "viscous"):
        if group in parameters.groups and system.friction is not None:
            values[parameters.columns(group)] = getattr(system.friction, group, 0.0)
    if "armature" in parameters.groups:
        names = list(system.model.names)
        joints = [system.model.joints[names.index(name)].idx_v for name in system.robot.joint_names]
        values[parameters.columns("armature")] = np.asarray(system.model.armature)[joints]
    return values


def _payload(robot: Robot, parameters: Parameters, values: Array) -> Payload | None:
    """Return the body in the axes of its frame; its parameters are about the joint."""
    if parameters.frame is None:
        return None
    body = values[parameters.columns("payload")]
    if body[0] <= 1e-9:
        return Payload(0.0, frame=parameters.frame)
    inertia = pin.Inertia.FromDynamicParameters(body)
    moved = robot.model.frames[robot.frame_id(parameters.frame)].placement.actInv(inertia)
    moments, axes = np.linalg.eigh(np.asarray(moved.inertia))
    moments = np.maximum(moments, 0.0)
    moments[2] = min(moments[2], moments[0] + moments[1])  # what rounding takes
    return Payload(float(moved.mass), moved.lever, axes @ np.diag(moments) @ axes.T, parameters.frame)


def _identified(system: MechanicalSystem, parameters: Parameters, values: Array, body: Payload | None) -> Robot:
    """Return the arm with what was identified."""
    robot, groups = system.robot, parameters.groups
    if body is not None and body.mass > 0.0:
        robot = robot.with_payload(body)
    friction = system.friction
    if "coulomb" in groups or "viscous" in groups:
        friction = _friction(system, parameters, values)
    if "armature" in groups:
        model = pin.Model(robot.model)
        names, armature = list(model.names), np.array(model.armature)
        for name, value in zip(robot.joint_names, values[parameters.columns("armature")], strict=True):
            armature[model.joints[names.index(name)].idx_v] = value
        model.armature = armature
        robot = replace(robot, model=model)
    if "offset" in groups:
        offset = ConstantTorque(values[parameters.columns("offset")])
        robot = replace(robot, potentials=(*robot.potentials, offset))
    return replace(robot, friction=friction)


def _friction(system: MechanicalSystem, parameters: Parameters, values: Array) -> StribeckFriction:
    known, n = system.friction, system.n
    own = isinstance(known, StribeckFriction)
    found = {
        group: values[parameters.columns(group)]
        if group in parameters.groups
        else np.broadcast_to(getattr(known, group, 0.0), (n,))
        for group in ("coulomb", "viscous")
    }
    static = getattr(known, "static", None) if own and "coulomb" not in parameters.groups else None
    return StribeckFriction(
        viscous=found["viscous"],
        coulomb=found["coulomb"],
        static=None if static is None else np.broadcast_to(static, (n,)),
        stribeck_velocity=np.broadcast_to(getattr(known, "stribeck_velocity", 0.1), (n,)),
        smoothing=getattr(known, "smoothing", DRY_FRICTION_SMOOTHING),
    )
