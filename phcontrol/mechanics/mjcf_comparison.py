"""What was understood of an MJCF, held against what MuJoCo itself makes of the file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from phcontrol._validation import Array
from phcontrol.exceptions import RobotDescriptionError
from phcontrol.mechanics.urdf import UNBOUNDED, Findings, Urdf, canonical

_CLOSE = 1e-8  # of the largest entry: both are exact but for rounding
_POSTURES = 3


def check_against_mujoco(
    mujoco: Any, model: Any, urdf: Urdf, armature: Mapping[str, float], label: str, locked: frozenset[str]
) -> None:
    """Raise RobotDescriptionError unless an arm is the one that MuJoCo has compiled.

    Compared are mass matrix with rotors, weight with Coriolis forces, passive forces (which are those of damping, but
    for ``locked`` joints), ranges, damping and dry friction of the joints, and where bodies and sites are, at some
    postures and speeds. Of what a model holds the passive forces and the bias are all but constraints, contacts and
    actuators: what would be overlooked shows here.
    """
    findings = Findings(label)
    try:
        problems = _Comparison(mujoco, model, urdf, armature, locked).problems()
    except (ArithmeticError, LookupError, ValueError, mujoco.FatalError) as error:
        raise RobotDescriptionError(f"{label}: cannot be held against MuJoCo's model: {error}") from error
    for problem in problems:
        findings.add(0, problem)
    findings.check()


class _Comparison:
    def __init__(
        self, mujoco: Any, theirs: Any, urdf: Urdf, armature: Mapping[str, float], locked: frozenset[str]
    ) -> None:
        self._mujoco, self._theirs, self._urdf, self._locked = mujoco, theirs, urdf, locked
        # contacts and limits have no part in what is compared, and may need more memory than there is
        theirs.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        self._data = mujoco.MjData(theirs)
        self._ours = pin.buildModelFromXML(canonical(urdf))
        self._names = list(self._ours.names)[1:]
        for i, name in enumerate(self._names, start=1):
            self._ours.armature[self._ours.joints[i].idx_v] = armature.get(name, 0.0)

    def problems(self) -> list[str]:
        """Return what differs, in words."""
        if not self._names:
            return ["it has no joint"]
        known = {self._theirs.joint(i).name: i for i in range(self._theirs.njnt)}
        if set(known) != set(self._names):
            return [f"MuJoCo has the joints {', '.join(known) or 'none'}; read were {', '.join(self._names) or 'none'}"]
        joints = [known[name] for name in self._names]
        places = [int(self._theirs.jnt_qposadr[i]) for i in joints]
        freedoms = [int(self._theirs.jnt_dofadr[i]) for i in joints]
        found = self._joints(joints, freedoms)
        damping = np.array([float(np.ravel(self._theirs.dof_damping[k])[0]) for k in freedoms])
        free = np.array([name not in self._locked for name in self._names])
        generator, ours = np.random.default_rng(0), self._ours.createData()
        for _ in range(_POSTURES):
            q, v = generator.uniform(-1.0, 1.0, self._ours.nq), generator.uniform(-1.0, 1.0, self._ours.nv)
            self._data.qpos[places], self._data.qvel[freedoms] = q, v
            self._mujoco.mj_forward(self._theirs, self._data)
            mass, bias = self._mass_matrix(freedoms), self._data.qfrc_bias[freedoms]
            largest, scale = float(np.abs(mass).max()), float(np.abs(bias).max())
            for what, one, other, size in (
                ("the mass matrix", pin.crba(self._ours, ours, q), mass, largest),
                ("weight and Coriolis force", pin.nonLinearEffects(self._ours, ours, q, v), bias, 10 * largest + scale),
                ("the passive force", -damping * v * free, self._data.qfrc_passive[freedoms] * free, scale + largest),
            ):
                if not np.abs(one - other).max(initial=0.0) <= _CLOSE * size:
                    found.append(f"{what} is another than MuJoCo's, by {np.abs(one - other).max():.2g}")
            found += self._frames(ours, q)
            if found:
                return list(dict.fromkeys(found))
        return []

    def _mass_matrix(self, freedoms: list[int]) -> Array:
        columns = np.zeros((len(freedoms), len(freedoms)))
        column, axis = np.zeros(self._theirs.nv), np.zeros(self._theirs.nv)
        for k, freedom in enumerate(freedoms):
            axis[:] = 0.0
            axis[freedom] = 1.0
            self._mujoco.mj_mulM(self._theirs, self._data, column, axis)
            columns[:, k] = column[freedoms]
        return columns

    def _joints(self, joints: list[int], freedoms: list[int]) -> list[str]:
        """Return what differs of ranges, damping and friction."""
        read = {joint.name: joint for joint in self._urdf.joints if joint.moves}
        found = []
        for name, i, freedom in zip(self._names, joints, freedoms, strict=True):
            joint, theirs = read[name], self._theirs
            if theirs.jnt_limited[i] and joint.limit is not None:
                one, other = (joint.limit.lower, joint.limit.upper), tuple(theirs.jnt_range[i])
                if not np.allclose(one, other, rtol=1e-9, atol=1e-9):
                    found.append(f"joint '{name}' has the range {one}, in MuJoCo {other}")
            elif joint.limit is not None and max(abs(joint.limit.lower), abs(joint.limit.upper)) < UNBOUNDED:
                found.append(f"joint '{name}' has a range, in MuJoCo none")
            for what, mine, its in (
                ("damping", joint.damping, theirs.dof_damping[freedom]),
                ("friction", joint.friction, theirs.dof_frictionloss[freedom]),
            ):
                if not np.isclose(mine, np.ravel(its)[0], rtol=1e-9, atol=1e-12):
                    found.append(f"joint '{name}' has the {what} {mine:g}, in MuJoCo {np.ravel(its)[0]:g}")
        return found

    def _frames(self, ours: pin.Data, q: Array) -> list[str]:
        """Return which bodies and sites are elsewhere."""
        pin.framesForwardKinematics(self._ours, ours, q)
        bodies = {
            self._theirs.body(i).name: (self._data.xpos[i], self._data.xmat[i]) for i in range(self._theirs.nbody)
        }
        sites = {
            self._theirs.site(i).name: (self._data.site_xpos[i], self._data.site_xmat[i])
            for i in range(self._theirs.nsite)
        }
        sites = {f"{name}_site" if name in bodies else name: place for name, place in sites.items()}
        found = []
        for name, (position, rotation) in (sites | bodies).items():
            if not name or name == "world" or not self._ours.existFrame(name, pin.FrameType.BODY):
                continue
            place = ours.oMf[self._ours.getFrameId(name, pin.FrameType.BODY)]
            off = max(np.abs(place.translation - position).max(), np.abs(place.rotation - rotation.reshape(3, 3)).max())
            if not off <= 1e-7:
                found.append(f"'{name}' is elsewhere than in MuJoCo, by {off:.2g}")
        return found
