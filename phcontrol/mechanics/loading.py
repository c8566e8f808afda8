"""Building a robot from its description."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from phcontrol._validation import Array, decimal, flag, number, per_joint, sequence
from phcontrol.exceptions import InvalidArgumentError, PHControlError, RobotDescriptionError, RobotDescriptionWarning
from phcontrol.mechanics.catalogue import Description, find
from phcontrol.mechanics.friction import StribeckFriction
from phcontrol.mechanics.markup import read_markup
from phcontrol.mechanics.mjcf import read_mjcf
from phcontrol.mechanics.payload import Payload, check_payloads
from phcontrol.mechanics.plausibility import check_bodies, doubts
from phcontrol.mechanics.potentials import GripperSpring, OnJoint, Potential
from phcontrol.mechanics.robot import Coupling, Robot, check_joint_names
from phcontrol.mechanics.rotors import Rotor, rotors_of
from phcontrol.mechanics.stop_velocity import StopVelocity
from phcontrol.mechanics.structure import check_tree
from phcontrol.mechanics.urdf import Joint, Mimic, Urdf, canonical, read_urdf

DRY_FRICTION_SMOOTHING = 1e-3
"""α_f [rad²/s²] used with the dry friction of a URDF, which has no such number."""


def load_robot(
    source: str | os.PathLike[str],
    *,
    locked_joints: Sequence[str] | Mapping[str, float] = (),
    armature: ArrayLike | Mapping[str, float] | None = None,
    rotor_inertia: bool = False,
    payload: Payload | Sequence[Payload] | None = None,
    package_directories: Sequence[str | os.PathLike[str]] = (),
) -> Robot:
    """Load a fixed-base arm.

    Args:
        source: a robot shipped with phcontrol ("pera"), a path to a URDF file or to a MuJoCo model (MJCF, ``.xml``),
            or a name of example-robot-data ("panda", "ur5").
        locked_joints: names of joints to hold fixed at their home angle, or angles [rad] by name.
        armature: reflected rotor inertia [kg m²] ([kg] of a prismatic joint), one for all joints, one each, or
            by joint name (others as described); part of M(q) everywhere. By default what the robot's
            description gives.
        rotor_inertia: whether the rotors that a URDF gives (``motor_inertia`` and ``gear_ratio`` of a joint, or those
            of a ``<transmission>``) are part of M(q): each adds inertia · gear_ratio² to its joint's armature;
            ``Robot.rotors`` says which. URDF programs overlook them, so that they are not used unless asked for.
        payload: a body that the arm carries beside its description, or several: a tool, what the hand holds.
        package_directories: where ``package://`` names of meshes are looked for (visualization only).

    A description is read strictly: what is misspelt, missing, no number or impossible is refused, with file and line.
    What is only implausible (moments of inertia that no rigid body has exactly, units that seem not to be SI), and
    joints without a known effort or velocity limit, make a :class:`RobotDescriptionWarning`.

    Raises:
        UnknownNameError: no robot or joint of that name; lists those that exist.
        RobotDescriptionError: unreadable, broken or impossible description, floating base, or a mass matrix that is
            not positive definite.

    Example:
        >>> from phcontrol import load_robot
        >>> load_robot("ur5").n, load_robot("panda", locked_joints=["panda_finger_joint1", "panda_finger_joint2"]).n
        (6, 7)
    """
    description = find(source)
    for directory in sequence("package_directories", package_directories, "paths"):
        if not isinstance(directory, (str, os.PathLike)):
            raise InvalidArgumentError("package_directories", f"must hold paths, but one is {directory!r}")
        description.package_directories += (Path(directory),)
    urdf = _read(description, locked_joints)
    rotors = rotors_of(urdf) if flag("rotor_inertia", rotor_inertia) else {}
    if rotor_inertia and not rotors:
        raise RobotDescriptionError(
            f"{description.label}: gives no rotor: rotor_inertia=True needs motor_inertia and gear_ratio of its "
            "joints. armature=... takes the reflected inertia itself"
        )
    robot = _build(description, urdf, locked_joints, rotors)
    if armature is None and "armature" in description.extras:
        described = description.extras["armature"]
        armature = {name: value for name, value in described.items() if name in robot.joint_names}
    if armature is not None:
        robot = _with_armature(robot, armature)
    for body in check_payloads(payload):
        robot = robot.with_payload(body)
    robot.check_inertia()
    for doubt in (*doubts(urdf), *_unlimited(robot)):
        warnings.warn(f"{description.label}: {doubt}", RobotDescriptionWarning, stacklevel=2)
    return robot


def robot_from_record(record: Mapping[str, Any]) -> Robot:
    """Return the arm of which :meth:`Robot.record` was kept, without friction and springs: to draw it.

    Raises RobotDescriptionError when the record is of no robot.
    """
    try:
        description = Description(
            str(record["name"]),
            Path(f"{record['name']}.urdf"),
            extras={"tool_frame": record["tool_frame"], "camera_frame": record["camera_frame"]},
            package_directories=tuple(Path(directory) for directory in record["package_directories"]),
            text=str(record["urdf"]),
        )
        robot = _build(description, _read(description), dict(record["locked_joints"]))
        names = tuple(record["joint_names"])
        for payload in record.get("payloads", ()):
            robot = robot.with_payload(Payload.from_record(payload))
    except (KeyError, TypeError) as error:
        raise RobotDescriptionError(f"not the record of a robot: {error!r}") from error
    if robot.joint_names != names:
        raise RobotDescriptionError(f"the record names joints {names}, its URDF has {robot.joint_names}")
    return robot


def _read(description: Description, locked_joints: Sequence[str] | Mapping[str, float] = ()) -> Urdf:
    """Return what a URDF says, or an MJCF; what only the latter can say goes into the description's extras."""
    urdf = _read_mjcf(description, locked_joints) or read_urdf(description.path, description.label, description.text)
    check_tree(urdf)
    check_bodies(urdf)
    return urdf


def _read_mjcf(description: Description, locked_joints: Sequence[str] | Mapping[str, float]) -> Urdf | None:
    if description.text is not None or description.path.suffix != ".xml":
        return None
    root = read_markup(description.path, description.label)
    if root.tag != "mujoco":
        return None
    locked = frozenset(locked_joints) if not isinstance(locked_joints, str) else frozenset()
    try:
        found = read_mjcf(description.path, root, description.label, locked)
    except PHControlError:
        raise
    except (LookupError, ArithmeticError, np.linalg.LinAlgError) as error:
        raise RobotDescriptionError(f"{description.label}: not a valid MJCF: {error!r}") from error
    described = {"armature": found.armature} | ({"home": found.home} if found.home else {})
    description.extras = described | description.extras
    return found.urdf


def _build(
    description: Description,
    urdf: Urdf,
    locked_joints: Sequence[str] | Mapping[str, float],
    rotors: Mapping[str, Rotor] = MappingProxyType({}),
) -> Robot:
    joints = {joint.name: joint for joint in urdf.joints if joint.moves}
    try:
        model = pin.buildModelFromXML(canonical(urdf))
    except Exception as error:  # urdfdom and Pinocchio raise several kinds
        raise RobotDescriptionError(f"{description.label}: not a valid URDF: {error}") from error
    _read_rotor_parameters(model, description, rotors)
    mimics = {name: joint.mimic for name, joint in joints.items() if joint.mimic is not None}
    home = _home(model, description, joints)
    if "home" in description.extras:
        names, given = list(model.names)[1:], description.extras["home"]
        free = [name not in mimics for name in names]
        home[free] = [given[name] for name in names if name not in mimics] if isinstance(given, Mapping) else given
    locked = _locked_angles(description.name, locked_joints, mimics, list(model.names)[1:], home)
    if len(locked) == model.njoints - 1:
        raise InvalidArgumentError("locked_joints", "must leave at least one joint free")
    if locked:
        angles = dict(zip(list(model.names)[1:], home, strict=True)) | locked
        home = np.array([angles[name] for name in list(model.names)[1:]])
        model = pin.buildReducedModel(model, [model.getJointId(name) for name in locked], home)
        home = np.array([angles[name] for name in list(model.names)[1:]])
    robot = _assemble(description, model, joints, home, mimics, locked, urdf.text)
    return replace(robot, rotors={name: rotor for name, rotor in rotors.items() if name not in locked})


def _read_rotor_parameters(model: pin.Model, description: Description, rotors: Mapping[str, Rotor]) -> None:
    if description.semantic_path is not None and description.has_rotor_parameters:
        pin.loadRotorParameters(model, str(description.semantic_path), False)
        model.armature = np.asarray(model.rotorInertia) * np.square(np.asarray(model.rotorGearRatio))
    if rotors:
        names, armature = list(model.names)[1:], np.array(model.armature)
        for name, rotor in rotors.items():
            armature[names.index(name)] = rotor.armature
        model.armature = armature


def _home(model: pin.Model, description: Description, joints: Mapping[str, Joint]) -> Array:
    """Zero, moved inside the limits; where an SRDF gives the reference posture, that one."""
    limits = model.lowerPositionLimit, model.upperPositionLimit
    home = np.clip(np.zeros(model.nq), *limits)
    if description.semantic_path is None or description.reference_posture is None:
        return home
    names = list(model.names)[1:]
    for state in read_markup(description.semantic_path, description.semantic_path.name).iter("group_state"):
        if state.get("name") != description.reference_posture:
            continue
        for joint in state.iter("joint"):
            if joint.get("name") not in names:
                continue
            texts = joint.get("value", "").split()
            values = [value for text in texts if (value := decimal(text)) is not None]
            if len(values) not in (1, 2) or len(values) < len(texts):
                raise RobotDescriptionError(
                    f"{description.semantic_path.name}: joint '{joint.get('name')}' has the value "
                    f"'{joint.get('value')}'; it must be a decimal number"
                )
            # a continuous joint may be given by its cosine and sine
            angle = math.atan2(values[1], values[0]) if len(values) == 2 else values[0]
            index = names.index(joint.get("name", ""))
            prismatic = joints[names[index]].kind == "prismatic"
            home[index] = angle if prismatic else _turned(angle, *(limit[index] for limit in limits))
    return home


def _turned(angle: float, lower: float, upper: float) -> float:
    """Return an angle [rad], a whole turn further where only that is inside the limits."""
    turns = (angle, angle + 2.0 * math.pi, angle - 2.0 * math.pi)
    return next((turned for turned in turns if lower <= turned <= upper), angle)


def _locked_angles(
    robot: str,
    locked_joints: Sequence[str] | Mapping[str, float],
    mimics: dict[str, Mimic],
    names: list[str],
    home: Array,
) -> dict[str, float]:
    if isinstance(locked_joints, str):
        raise InvalidArgumentError(
            "locked_joints", f"must be a list of joint names, but is the string '{locked_joints}'"
        )
    check_joint_names(list(sequence("locked_joints", locked_joints, "joint names")), names, robot)
    angles = dict(zip(names, home, strict=True))
    if isinstance(locked_joints, Mapping):
        locked = {name: number(f"locked_joints['{name}']", value) for name, value in locked_joints.items()}
    else:
        locked = {name: float(angles[name]) for name in locked_joints}
    changed = True
    while changed:  # what follows a locked joint is locked too
        followers = {
            name: mimic.multiplier * locked[mimic.joint] + mimic.offset
            for name, mimic in mimics.items()
            if mimic.joint in locked and name not in locked
        }
        locked |= followers
        changed = bool(followers)
    return locked


def _coupling(names: list[str], mimics: dict[str, Mimic], robot: str) -> tuple[list[str], Coupling | None]:
    followers = {name: mimics[name] for name in names if name in mimics}
    independent = [name for name in names if name not in followers]
    if not followers:
        return independent, None
    matrix, offset = np.zeros((len(names), len(independent))), np.zeros(len(names))
    for row, name in enumerate(names):
        gain, shift, seen = 1.0, 0.0, [name]
        while seen[-1] in followers:  # a follower may follow a follower
            mimic, leader = followers[seen[-1]], followers[seen[-1]].joint
            gain, shift = gain * mimic.multiplier, shift + gain * mimic.offset
            if leader in seen or leader not in names:
                raise RobotDescriptionError(
                    f"{robot}: joint '{seen[-1]}' mimics '{leader}', which is no joint it can follow"
                )
            seen.append(leader)
        matrix[row, independent.index(seen[-1])] = gain
        offset[row] = shift
    return independent, Coupling(matrix, offset)


def _assemble(
    description: Description,
    model: pin.Model,
    joints: dict[str, Joint],
    home: Array,
    mimics: dict[str, Mimic],
    locked: dict[str, float],
    text: str,
) -> Robot:
    all_names = list(model.names)[1:]
    names, coupling = _coupling(all_names, mimics, description.name)
    index = [all_names.index(name) for name in names]
    turning = np.array([joints[name].kind == "continuous" for name in names])
    extras = description.extras
    described = [name for name in joints if name not in mimics]
    friction = _friction([joints[name] for name in names], [described.index(name) for name in names], extras)
    robot = Robot(
        name=description.name,
        model=model,
        joint_names=tuple(names),
        home=home[index],
        lower=np.where(turning, -np.inf, np.asarray(model.lowerPositionLimit)[index]),
        upper=np.where(turning, np.inf, np.asarray(model.upperPositionLimit)[index]),
        velocity_limit=_limit(np.asarray(model.upperVelocityLimit)[index], names, extras.get("velocity", {})),
        effort_limit=_limit(np.asarray(model.upperEffortLimit)[index], names, extras.get("effort", {})),
        continuous=turning,
        stop_velocity=_stop_velocity([joints[name] for name in names]),
        prismatic=tuple(joints[name].kind == "prismatic" for name in names),
        friction=friction,
        potentials=_springs(extras, names),
        tool_frame=extras.get("tool_frame"),
        camera_frame=extras.get("camera_frame"),
        coupling=coupling,
        description=text,
        path=description.path,
        package_directories=description.package_directories,
        locked_joints=locked,
    )
    for array in (robot.home, robot.lower, robot.upper, robot.velocity_limit, robot.effort_limit):
        array.flags.writeable = False
    return robot


def _stop_velocity(joints: list[Joint]) -> StopVelocity | None:
    """Return the velocity limits near the stops of joints that are not continuous; None where none has such."""
    near = [None if joint.kind == "continuous" else joint.near_stops for joint in joints]
    if not any(near):
        return None
    return StopVelocity(
        [0.0 if one is None else one.offset for one in near],
        [math.inf if one is None else one.deceleration for one in near],
    )


def _springs(extras: dict[str, Any], names: list[str]) -> tuple[Potential, ...]:
    """Return the spring that a shipped robot has: on all its joints, or on the one that is named."""
    if "spring" not in extras:
        return ()
    spring = GripperSpring(**extras["spring"])
    if "spring_joint" not in extras:
        return (spring,)
    joint = extras["spring_joint"]
    return (OnJoint(spring, names.index(joint)),) if joint in names else ()


def _limit(values: Array, names: Sequence[str], known: Mapping[str, float]) -> Array:
    """Return limits, where a description gives none what is known beside it, and infinity where nothing is.

    A URDF without limits gives zeros, which would say that the joint cannot move at all.
    """
    return np.where(values > 0.0, values, [known.get(name, np.inf) for name in names])


def _unlimited(robot: Robot) -> Iterator[str]:
    """Yield which joints have no limit of effort or speed, for nothing holds a law back there."""
    limits = {"effort": robot.effort_limit, "velocity": robot.velocity_limit}
    for kind, values in limits.items():
        names = np.array(robot.joint_names)[np.isinf(values)]
        if names.size:
            yield (
                f"gives no {kind} limit, or 0, for {', '.join(names)}: none is applied. Give {kind} in the <limit> of "
                f"each, or Limits({kind}=...) to a TorqueFilter"
            )


def _friction(joints: list[Joint], places: list[int], extras: dict[str, Any]) -> StribeckFriction | None:
    """Return the friction of joints, or None; ``places`` says which entries of the lists in ``extras`` are theirs."""
    viscous, coulomb = [joint.damping for joint in joints], [joint.friction for joint in joints]
    static = [extras["static"][place] for place in places] if "static" in extras else coulomb
    speed = [extras["stribeck_velocity"][place] for place in places] if "stribeck_velocity" in extras else None
    if not (any(viscous) or any(coulomb) or any(static)):
        return None
    return StribeckFriction(
        viscous=viscous,
        coulomb=coulomb,
        static=static,
        stribeck_velocity=[0.1] * len(joints) if speed is None else speed,
        smoothing=extras.get("friction_smoothing", DRY_FRICTION_SMOOTHING),
    )


def _with_armature(robot: Robot, armature: ArrayLike | Mapping[str, float]) -> Robot:
    names = list(robot.model.names)[1:]
    index = [names.index(name) for name in robot.joint_names]
    full = np.zeros(robot.model.nv)
    if isinstance(armature, Mapping):
        full = np.array(robot.model.armature)
        check_joint_names(list(armature), robot.joint_names, robot.name)
        armature = [armature.get(name, full[i]) for name, i in zip(robot.joint_names, index, strict=True)]
    values = per_joint("armature", armature, robot.n)
    if (values < 0.0).any():
        raise InvalidArgumentError("armature", f"must be >= 0 [kg m²], but is {values.tolist()}")
    model = robot.model.copy()
    full[index] = values
    model.armature = full
    return replace(robot, model=model)
