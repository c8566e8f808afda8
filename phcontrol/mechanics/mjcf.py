"""An arm from MuJoCo's XML (MJCF), as MuJoCo itself has compiled it.

MJCF says a thing in many ways: classes of defaults, options of its compiler, shapes that give masses, files in files.
None of it is read here: MuJoCo compiles the file, what its model holds that no arm of phcontrol has is refused
(:mod:`mjcf_checks`), a URDF of the rest is written, from which everything follows as for any arm, and what came of that
is held against MuJoCo again (:mod:`mjcf_comparison`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array
from phcontrol.mechanics.markup import Element
from phcontrol.mechanics.mjcf_checks import check_model, check_text
from phcontrol.mechanics.mjcf_comparison import check_against_mujoco
from phcontrol.mechanics.mujoco_file import compiled, load_mujoco
from phcontrol.mechanics.urdf import UNBOUNDED, Findings, Inertial, Joint, Limit, Link, Triple, Urdf, as_text

_BASE = "world"
_NO_AXIS = (1.0, 0.0, 0.0)


@dataclass(frozen=True)
class Mjcf:
    """An arm of an MJCF: as a URDF says it, and what a URDF cannot say."""

    urdf: Urdf
    armature: dict[str, float]
    """Reflected rotor inertia by joint [kg m²]."""
    home: dict[str, float]
    """Joint positions of the keyframe "home" [rad, m]; empty without one."""


def read_mjcf(path: Path, root: Element, label: str, locked: frozenset[str]) -> Mjcf:
    """Read an MJCF file, whose ``root`` element is known already.

    Tendons, constraints, springs and actuators of ``locked`` joints do nothing.

    Raises RobotDescriptionError, which names all that is wrong.
    """
    model, mujoco, findings = compiled(path, label), load_mujoco(), Findings(label)
    check_text(root, model.nq, findings)
    check_model(mujoco, model, findings, locked)
    findings.check()
    arm = _Arm(mujoco, model, findings, locked)
    findings.check()
    urdf = Urdf(label, tuple(arm.links), tuple(arm.joints), "")
    joints = [model.joint(j) for j in range(model.njnt)]
    armature = {joint.name: float(model.dof_armature[joint.dofadr[0]]) for joint in joints}
    homes = [key for key in map(model.key, range(model.nkey)) if key.name == "home"]
    found = Mjcf(
        Urdf(label, urdf.links, urdf.joints, as_text(urdf)),
        {name: value for name, value in armature.items() if value},
        {joint.name: float(key.qpos[joint.qposadr[0]]) for key in homes[:1] for joint in joints},
    )
    check_against_mujoco(mujoco, model, found.urdf, found.armature, label, locked)
    return found


class _Arm:
    """Links and joints of a compiled model: a body each, whose origin is moved onto the axis of its joint."""

    def __init__(self, mujoco: Any, model: Any, findings: Findings, locked: frozenset[str]) -> None:
        self._mujoco, self._model, self._findings = mujoco, model, findings
        self.links, self.joints = [Link(_BASE, None, 0)], list[Joint]()
        self._efforts = efforts_of(mujoco, model)
        self._locked = locked
        # of each body: the link that it is, or is fixed to, and its pose in that
        self._places: dict[int, tuple[str, pin.SE3]] = {0: (_BASE, pin.SE3.Identity())}
        for body in range(1, model.nbody):
            self._body(body)
        for site in range(model.nsite):
            self._site(site)

    def _body(self, body: int) -> None:
        model, name = self._model, self._model.body(body).name
        parent, place = self._places[int(model.body_parentid[body])]
        here = place * _pose(model.body_pos[body], model.body_quat[body])
        offset, link = pin.SE3.Identity(), name
        if model.body_jntnum[body]:
            joint = int(model.body_jntadr[body])
            axis, start = np.array(model.jnt_axis[joint]), float(model.qpos0[model.jnt_qposadr[joint]])
            if model.jnt_type[joint] == self._mujoco.mjtJoint.mjJNT_HINGE:
                anchor = pin.SE3(np.eye(3), np.array(model.jnt_pos[joint]))
                origin, offset = here * anchor * pin.SE3(pin.exp3(-start * axis), np.zeros(3)), anchor.inverse()
            else:
                origin = here * pin.SE3(np.eye(3), -start * axis)
            if not offset.isIdentity(0.0):
                link = f"{model.joint(joint).name}_axis"
            self._moving(joint, parent, link, origin, axis)
        else:
            self._fixed(link, parent, here)
        self._add(Link(link, self._inertial(body, offset), 0))
        if link != name:
            self._add(Link(name, None, 0))
            self._fixed(name, link, offset)
        self._places[body] = (link, offset)

    def _site(self, site: int) -> None:
        model, name = self._model, self._model.site(site).name
        link, place = self._places[int(model.site_bodyid[site])]
        pose = place * _pose(model.site_pos[site], model.site_quat[site])
        if not name:
            return
        body = self._mujoco.mj_name2id(model, self._mujoco.mjtObj.mjOBJ_BODY, name)
        if body >= 0:  # MuJoCo allows both to have it
            if self._places[body][0] == link and self._places[body][1].isApprox(pose, 1e-12):
                return
            name = f"{name}_site"
        self._add(Link(name, None, 0))
        self._fixed(name, link, pose)

    def _add(self, link: Link) -> None:
        if any(other.name == link.name for other in self.links):
            self._findings.add(0, f"'{link.name}' names more than one body, site or axis of a joint; give each its own")
        self.links.append(link)

    def _moving(self, joint: int, parent: str, child: str, origin: pin.SE3, axis: Array) -> None:
        model = self._model
        name, dof = model.joint(joint).name, int(model.jnt_dofadr[joint])
        limited, turns = bool(model.jnt_limited[joint]), model.jnt_type[joint] == self._mujoco.mjtJoint.mjJNT_HINGE
        if not turns and not limited:
            self._findings.add(0, f"joint '{name}' slides without limits; give it a range")
        effort = self._efforts[joint]
        if effort == 0.0 and name not in self._locked:
            self._findings.add(
                0, f"joint '{name}' has actuators that make no torque in one direction or both (a range or a gear of "
                "zero): give them some, or lock the joint (locked_joints)"
            )  # fmt: skip
        lower, upper = map(float, model.jnt_range[joint]) if limited else (-UNBOUNDED, UNBOUNDED)
        self.joints.append(
            Joint(
                name=name,
                kind="prismatic" if not turns else "revolute" if limited else "continuous",
                parent=parent,
                child=child,
                xyz=_triple(origin.translation),
                rpy=_triple(pin.rpy.matrixToRpy(origin.rotation)),
                axis=_triple(axis),
                limit=Limit(lower, upper, effort if math.isfinite(effort) else 0.0, 0.0),
                near_stops=None,
                damping=float(model.dof_damping[dof]),
                friction=float(model.dof_frictionloss[dof]),
                mimic=None,
                line=0,
            )
        )

    def _fixed(self, child: str, parent: str, place: pin.SE3) -> None:
        xyz, rpy = _triple(place.translation), _triple(pin.rpy.matrixToRpy(place.rotation))
        self.joints.append(
            Joint(f"{child}_fixed", "fixed", parent, child, xyz, rpy, _NO_AXIS, None, None, 0.0, 0.0, None, 0)
        )

    def _inertial(self, body: int, offset: pin.SE3) -> Inertial | None:
        """Return a body's inertia in its link, whose axes it has."""
        model = self._model
        mass, principal = float(model.body_mass[body]), np.array(model.body_inertia[body])
        if mass == 0.0 and not principal.any():
            return None
        place = offset * _pose(model.body_ipos[body], model.body_iquat[body])
        matrix = place.rotation @ np.diag(principal) @ place.rotation.T
        places = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
        moments = {name: float(matrix[entry]) for name, entry in places.items()}
        return Inertial(mass, _triple(place.translation), (0.0, 0.0, 0.0), moments, 0)


def efforts_of(mujoco: Any, model: Any) -> Array:
    """Return the largest force [N·m, N] that each joint's actuators make in both directions; infinite where unsaid.

    Of two unequal bounds it is the smaller, of several actuators the sum, of the joint's own bound the narrower.
    """
    efforts = np.full(model.njnt, np.inf)
    for joint in range(model.njnt):
        made = [_actuator_effort(mujoco, model, i) for i in actuators_of(mujoco, model, joint)]
        if made:
            efforts[joint] = sum(made)
        if model.jnt_actfrclimited[joint]:
            efforts[joint] = min(efforts[joint], *np.maximum([-1.0, 1.0] * model.jnt_actfrcrange[joint], 0.0))
    return efforts


def actuators_of(mujoco: Any, model: Any, joint: int) -> list[int]:
    """Return the actuators that act on a joint, in its own axes or its parent's."""
    kinds = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    return [i for i, kind in enumerate(model.actuator_trntype) if kind in kinds and model.actuator_trnid[i, 0] == joint]


def _actuator_effort(mujoco: Any, model: Any, i: int) -> float:
    gear, ranges = abs(float(model.actuator_gear[i, 0])), []
    if gear == 0.0:
        return 0.0
    if model.actuator_forcelimited[i]:
        ranges.append(model.actuator_forcerange[i])
    is_motor = model.actuator_gaintype[i] == mujoco.mjtGain.mjGAIN_FIXED and not model.actuator_biasprm[i].any()
    if is_motor and model.actuator_ctrllimited[i]:
        ranges.append(np.sort(model.actuator_gainprm[i, 0] * model.actuator_ctrlrange[i]))
    # what it makes both ways: nothing where a range is on one side of zero
    return gear * min((float(np.maximum([-1.0, 1.0] * pair, 0.0).min()) for pair in ranges), default=math.inf)


def _pose(position: Array, quaternion: Array) -> pin.SE3:
    w, x, y, z = (float(part) for part in quaternion)
    return pin.SE3(pin.Quaternion(w, x, y, z).normalized().matrix(), np.array(position))


def _triple(values: Array) -> Triple:
    x, y, z = (float(value) for value in values)
    return x, y, z
