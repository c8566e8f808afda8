"""An arm as a log keeps it, so that its energies can be computed again from the samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from phcontrol.exceptions import PHControlError
from phcontrol.mechanics.friction import StribeckFriction
from phcontrol.mechanics.loading import robot_from_record
from phcontrol.mechanics.potentials import ConstantTorque, GripperSpring, OnJoint, Potential
from phcontrol.mechanics.system import MechanicalSystem

_FRICTION = ("viscous", "coulomb", "static", "stribeck_velocity", "smoothing")
_SPRING = ("closing_stiffness", "opening_stiffness", "rest_angle", "smoothing")


def plant_record(system: MechanicalSystem) -> dict[str, Any]:
    """Return, for JSON, what ``Robot.record`` does not keep: inertias, rotors, gravity, friction, springs and G.

    Friction and potentials of another kind than phcontrol's own cannot be kept: "unknown" names them.
    """
    model, friction = system.model, system.friction
    record: dict[str, Any] = {
        "inertias": [_numbers(inertia) for inertia in model.inertias],
        "armature": np.asarray(model.armature).tolist(),
        "gravity": np.asarray(model.gravity.linear).tolist(),
        "input_matrix": None if system.constant_input is None else system.constant_input.tolist(),
        "friction": None,
        "springs": [],
        "constant_torques": [],
        "unknown": [],
    }
    if type(friction) is StribeckFriction:
        record["friction"] = {name: np.asarray(getattr(friction, name)).tolist() for name in _FRICTION}
    elif friction is not None:
        record["unknown"].append(type(friction).__name__)
    if system.varying_input is not None:
        record["unknown"].append("an input matrix that depends on q")
    for potential in system.potentials:
        spring, joint = (potential.potential, potential.index) if type(potential) is OnJoint else (potential, None)
        if type(spring) is GripperSpring:
            record["springs"].append({name: getattr(spring, name) for name in _SPRING} | {"joint": joint})
        elif type(spring) is ConstantTorque:
            record["constant_torques"].append(spring.torque.tolist())
        else:
            record["unknown"].append(type(spring).__name__)
    return record


def _numbers(inertia: pin.Inertia) -> list[float]:
    """Return mass [kg], centre of mass [m] and inertia about it [kg m²]: also of a link without mass."""
    return [float(inertia.mass), *np.asarray(inertia.lever).tolist(), *np.asarray(inertia.inertia).ravel().tolist()]


def plant_from_record(metadata: Mapping[str, Any]) -> MechanicalSystem:
    """Return the arm of a log's metadata, with its friction and springs.

    Raises PHControlError when they do not describe one.
    """
    try:
        record = metadata["plant"]
        if record["unknown"]:
            raise PHControlError(
                f"this log's file cannot describe its arm ({', '.join(map(str, record['unknown']))}): its energies "
                "cannot be computed again"
            )
        return _build(metadata["robot_record"], record)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise PHControlError(
            f"this log does not describe its arm, so that its energies cannot be computed again ({error!r})"
        ) from error


def _build(robot_record: Mapping[str, Any], record: Mapping[str, Any]) -> MechanicalSystem:
    robot = robot_from_record(robot_record)
    model = robot.model.copy()
    inertias = np.array(record["inertias"], dtype=float)
    armature = np.array(record["armature"], dtype=float)
    if inertias.shape != (model.njoints, 13) or armature.shape != (model.nv,):
        raise ValueError("inertias or rotors are not those of its joints")
    for joint in range(1, model.njoints):  # 0 is the base, which does not move
        mass, lever, inertia = inertias[joint, 0], inertias[joint, 1:4], inertias[joint, 4:].reshape(3, 3)
        model.inertias[joint] = pin.Inertia(float(mass), lever, inertia)
    model.armature = armature
    friction = None if record["friction"] is None else StribeckFriction(**record["friction"])
    potentials: list[Potential] = []
    for entry in record["springs"]:
        spring = GripperSpring(**{name: entry[name] for name in _SPRING})
        potentials.append(spring if entry["joint"] is None else OnJoint(spring, int(entry["joint"])))
    potentials += [ConstantTorque(torque) for torque in record.get("constant_torques", ())]
    robot = replace(robot, model=model, friction=friction, potentials=tuple(potentials))
    return MechanicalSystem(robot, gravity=record["gravity"], input_matrix=record["input_matrix"])
