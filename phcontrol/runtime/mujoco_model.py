"""MuJoCo's model of an arm: an MJCF file's, or what MuJoCo reads in the robot's own URDF."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array
from phcontrol.exceptions import InvalidArgumentError, RobotDescriptionError
from phcontrol.mechanics.friction import StribeckFriction
from phcontrol.mechanics.mujoco_file import load_mujoco
from phcontrol.mechanics.robot import Robot
from phcontrol.mechanics.system import MechanicalSystem

_PRIMITIVES = ("box", "cylinder", "sphere")


def model_of_urdf(system: MechanicalSystem, *, friction: bool, contacts: bool) -> Any:
    """Return the MjModel that MuJoCo makes of the robot's URDF; its integrator is RK4.

    Locked joints are fixed, rotors (``armature``) and friction are those of the plant: F_v as damping, F_c as
    MuJoCo's frictionloss. Meshes are left out.

    Args:
        system: the plant.
        friction: whether it has its friction.
        contacts: whether the boxes, cylinders and spheres of the URDF's collision shapes are there to touch.
    """
    mujoco, robot = load_mujoco(), system.robot
    if robot.coupling is not None:
        raise InvalidArgumentError(
            "system", f"{robot.name} has mimic joints, which MuJoCo does not read in a URDF: lock them (locked_joints)"
        )
    if robot.payloads:
        raise InvalidArgumentError(
            "system", f"{robot.name} carries a payload, which is not in its URDF: give an MJCF file that has it"
        )
    if system.potentials:
        raise InvalidArgumentError("system", "has springs, which MuJoCo does not know: give an MJCF file that has them")
    try:
        model = mujoco.MjModel.from_xml_string(urdf_for_mujoco(robot, contacts))
    except Exception as error:
        raise RobotDescriptionError(f"{robot.name}: MuJoCo cannot read its URDF: {error}") from error
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.gravity[:] = system.model.gravity.linear
    for k, name in enumerate(robot.joint_names):
        dof = model.joint(name).dofadr[0]
        index = list(robot.model.names)[1:].index(name)
        model.dof_armature[dof] = robot.model.armature[index]
        viscous, dry = _friction(system, k) if friction else (0.0, 0.0)
        model.dof_damping[dof], model.dof_frictionloss[dof] = viscous, dry
    return model


def urdf_for_mujoco(robot: Robot, contacts: bool) -> str:
    """Return the robot's URDF as MuJoCo can read it: without shapes that it cannot, locked joints fixed."""
    root = ET.fromstring(robot.description)
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            geometry = shape.find("geometry")
            kept = contacts and shape.tag == "collision" and geometry is not None
            if not (kept and geometry is not None and any(child.tag in _PRIMITIVES for child in geometry)):
                link.remove(shape)
    for joint in root.findall("joint"):
        angle = robot.locked_joints.get(joint.get("name", ""))
        if angle is not None:
            _fix(joint, angle)
        limit = joint.find("limit")
        if limit is not None:  # of what a motor can do; the arm clips itself
            limit.set("effort", "0")
    compiler = ET.SubElement(ET.SubElement(root, "mujoco"), "compiler")
    compiler.set("fusestatic", "true")
    compiler.set("discardvisual", "false")
    compiler.set("inertiafromgeom", "false")
    return ET.tostring(root, encoding="unicode")


def _fix(joint: ET.Element, angle: float) -> None:
    """Turn a joint that is locked at an angle [rad], or a length [m], into a fixed one."""
    origin = joint.find("origin")
    if origin is None:
        origin = ET.SubElement(joint, "origin")
    place = [np.array([float(x) for x in origin.get(name, "0 0 0").split()]) for name in ("xyz", "rpy")]
    element = joint.find("axis")
    axis = np.array([float(x) for x in ("1 0 0" if element is None else element.get("xyz", "1 0 0")).split()])
    axis = axis / np.linalg.norm(axis)
    rotation, shift = pin.rpy.rpyToMatrix(*place[1]), place[0]
    if joint.get("type") == "prismatic":
        shift = shift + rotation @ (angle * axis)
    else:
        rotation = rotation @ pin.AngleAxis(angle, axis).matrix()
    origin.set("xyz", " ".join(repr(float(x)) for x in shift))
    origin.set("rpy", " ".join(repr(float(x)) for x in pin.rpy.matrixToRpy(rotation)))
    joint.set("type", "fixed")


def _friction(system: MechanicalSystem, joint: int) -> tuple[float, float]:
    """Return a joint's viscous [N·m·s/rad] and dry friction [N·m]."""
    friction = system.friction
    if friction is None:
        return 0.0, 0.0
    if not isinstance(friction, StribeckFriction):
        raise InvalidArgumentError(
            "friction", f"MuJoCo has no {type(friction).__name__}: give an MJCF file, or friction=False"
        )
    viscous, dry = (np.broadcast_to(value, system.n)[joint] for value in (friction.viscous, friction.coulomb))
    return float(viscous), float(dry)


def addresses(model: Any, system: MechanicalSystem) -> tuple[Array, Array]:
    """Return where the robot's joints are in MuJoCo's qpos and qvel, shape (n,) each, found by name.

    Raises InvalidArgumentError when one is not there, is of another kind, or is not driven one to one.
    """
    mujoco, robot = load_mujoco(), system.robot
    there = [model.joint(index).name for index in range(model.njnt)]
    kinds = {int(mujoco.mjtJoint.mjJNT_HINGE): "turns", int(mujoco.mjtJoint.mjJNT_SLIDE): "slides"}
    positions, velocities = [], []
    for k, name in enumerate(robot.joint_names):
        if name not in there:
            raise InvalidArgumentError(
                "model",
                f"MuJoCo's model has no joint '{name}' of {robot.name}, whose {robot.n} joints are "
                f"{', '.join(robot.joint_names)}; it has {', '.join(there) or 'none'}",
            )
        joint = model.joint(name)
        kind, wanted = kinds.get(int(joint.type[0]), "is free"), "slides" if robot.prismatic[k] else "turns"
        if kind != wanted:
            raise InvalidArgumentError(
                "model", f"joint '{name}' {kind} in MuJoCo's model, and {wanted} in {robot.name}"
            )
        positions.append(int(joint.qposadr[0]))
        velocities.append(int(joint.dofadr[0]))
    return np.array(positions), np.array(velocities)


def silence_actuators(model: Any, velocities: Array) -> None:
    """Take the force from actuators that act on these degrees of freedom: the arm's torque is applied instead."""
    mujoco = load_mujoco()
    ours = set(velocities.tolist())
    for actuator in range(model.nu):
        of_joint = int(model.actuator_trntype[actuator]) in (
            int(mujoco.mjtTrn.mjTRN_JOINT),
            int(mujoco.mjtTrn.mjTRN_JOINTINPARENT),
        )
        of_tendon = int(model.actuator_trntype[actuator]) == int(mujoco.mjtTrn.mjTRN_TENDON)  # it may pull at the arm
        if of_tendon or (of_joint and int(model.jnt_dofadr[model.actuator_trnid[actuator, 0]]) in ours):
            model.actuator_gainprm[actuator, :] = 0.0
            model.actuator_biasprm[actuator, :] = 0.0
