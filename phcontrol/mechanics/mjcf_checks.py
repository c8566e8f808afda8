"""What a compiled model of MuJoCo holds that no arm of phcontrol has."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from phcontrol._validation import decimal
from phcontrol.mechanics.markup import Element
from phcontrol.mechanics.urdf import Findings

_GRAVITY = (0.0, 0.0, -9.81)
_FLAGS = ("GRAVITY", "FRICTIONLOSS", "DAMPER", "PASSIVE")
_NONLINEAR = {"jnt_stiffnesspoly": "a spring", "jnt_springyield": "a spring that yields"}


def check_model(mujoco: Any, model: Any, findings: Findings, locked: frozenset[str]) -> None:
    """Note everything of a compiled model that would be dropped, or that no arm has, as a finding.

    Of joints that are ``locked`` springs, tendons, constraints and actuators do nothing.
    """
    if not model.njnt:
        findings.add(0, "it has no joint")
    for found in (
        _options(mujoco, model),
        _bodies(mujoco, model),
        _joints(mujoco, model, locked),
        _actuators(mujoco, model, locked),
        _constraints(mujoco, model, locked),
        _tendons(mujoco, model, locked),
    ):
        for problem in found:
            findings.add(0, problem)
    for size, what in (("nflex", "deformable bodies are no part of an arm"), ("nplugin", "plugins are not run")):
        if getattr(model, size, 0):
            findings.add(0, f"{what} ({getattr(model, size)} of them)")


def check_text(root: Element, nq: int, findings: Findings) -> None:
    """Note what a compiled model does not tell: ranges that MuJoCo takes for none, a posture that it fills with zeros.

    ``nq`` is how many positions the model has.
    """
    for key in root.iter("key"):
        numbers = len(key.get("qpos", "").split())
        if key.get("name") == "home" and numbers not in (0, nq):
            assert isinstance(key, Element)
            findings.add(key.line, f"keyframe 'home' must have {nq} numbers in qpos, one a joint, but has {numbers}")
    sizes = {"range", "ctrlrange", "forcerange", "actuatorfrcrange"}
    for element in root.iter():
        assert isinstance(element, Element)
        for name in sizes & element.attrib.keys():
            pair = [decimal(part) for part in element.attrib[name].split()]
            if len(pair) == 2 and None not in pair and not pair[0] < pair[1]:  # type: ignore[operator]
                findings.add(
                    element.line,
                    f"{element.tag} '{element.get('name', '')}': {name}='{element.attrib[name]}' must be two numbers, "
                    "the lower first; MuJoCo takes this one for no limit",
                )


def _options(mujoco: Any, model: Any) -> Iterator[str]:
    option = model.opt
    if tuple(option.gravity) != _GRAVITY:
        said = " ".join(f"{part:g}" for part in option.gravity)
        yield (
            f"<option gravity='{said}'> would be overlooked; take it out, and give MechanicalSystem(..., gravity=...)"
        )
    for name in ("density", "viscosity", "wind"):
        if np.any(getattr(option, name)):
            yield f"<option {name}='{getattr(option, name)}'> would be overlooked: no medium drags here"
    for name in _FLAGS:
        bit = getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}", None)
        if bit is not None and option.disableflags & int(bit):
            yield f"<flag {name.lower()}='disable'> would be overlooked"


def _bodies(mujoco: Any, model: Any) -> Iterator[str]:
    for body in range(1, model.nbody):
        name = model.body(body).name
        if not name:
            yield f"a <body> has no name: the one in {model.body(model.body_parentid[body]).name or 'one without'}"
        if model.body_mocapid[body] >= 0:
            yield f"body '{name}' is moved by mocap data, which an arm is not"
        if model.body_gravcomp[body]:
            yield f"body '{name}': gravcomp='{model.body_gravcomp[body]:g}' would be overlooked; laws compensate weight"
        joints = range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        if any(model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE for joint in joints):
            yield f"body '{name}' is free to float; phcontrol controls arms on a fixed base"
        elif len(joints) > 1:
            yield f"body '{name}' has {len(joints)} joints; give each a body of its own"


def _joints(mujoco: Any, model: Any, locked: frozenset[str]) -> Iterator[str]:
    for joint in range(model.njnt):
        name, dof = model.joint(joint).name, int(model.jnt_dofadr[joint])
        where = f"joint '{name}'"
        if not name:
            yield f"a joint of body '{model.body(model.jnt_bodyid[joint]).name}' has no name"
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_BALL:
            yield f"{where} is a ball joint; phcontrol controls arms of hinge and slide joints"
        for what in ("dof_armature", "dof_damping", "dof_frictionloss"):
            value = float(getattr(model, what)[dof])
            if not value >= 0.0:
                yield f"{where}: {what.removeprefix('dof_')}='{value:g}' must be one number >= 0"
        low, high = (float(end) for end in model.jnt_range[joint])
        if not model.jnt_limited[joint] and low > high:
            yield f"{where}: range='{low:g} {high:g}' must be two numbers, the lower first"
        if name in locked:
            continue
        stiffness = float(model.jnt_stiffness[joint])
        if stiffness:
            yield f"{where}: stiffness='{stiffness:g}' would be dropped; springs are potentials of a MechanicalSystem"
        for field, what in _NONLINEAR.items():
            if np.any(getattr(model, field, np.zeros(model.njnt))[joint]):
                yield f"{where} has {what} ({field.removeprefix('jnt_')}), which would be dropped"
        if np.any(getattr(model, "dof_dampingpoly", np.zeros(model.nv))[dof]):
            yield f"{where} has a damping that is not linear in its speed; an arm has viscous and dry friction"


def _actuators(mujoco: Any, model: Any, locked: frozenset[str]) -> Iterator[str]:
    kinds = {int(getattr(mujoco.mjtTrn, name)): name.removeprefix("mjTRN_") for name in dir(mujoco.mjtTrn)
             if name.startswith("mjTRN_")}  # fmt: skip
    for i, kind in enumerate(model.actuator_trntype):
        actuator = model.actuator(i)
        where = f"actuator '{actuator.name}'"
        target = kinds[int(kind)]
        if target == "TENDON":
            continue  # what is said of the tendon says it
        for limited, name in (("ctrllimited", "ctrlrange"), ("forcelimited", "forcerange")):
            low, high = (float(end) for end in getattr(model, f"actuator_{name}")[i])
            if not getattr(model, f"actuator_{limited}")[i] and low > high:
                yield f"{where}: {name}='{low:g} {high:g}' must be two numbers, the lower first"
        if target not in ("JOINT", "JOINTINPARENT"):
            yield f"{where} acts on no joint (on a {target.lower()}), which would be dropped; take it out"
            continue
        joint = model.joint(model.actuator_trnid[i, 0]).name
        if joint in locked:
            continue
        if model.actuator_dyntype[i] != mujoco.mjtDyn.mjDYN_NONE:
            yield f"{where} of joint '{joint}' has a state of its own, which would be dropped"
        for field in ("actuator_armature", "actuator_damping", "actuator_dampingpoly"):
            if np.any(getattr(model, field, np.zeros(len(model.actuator_trntype)))[i]):
                what = field.removeprefix("actuator_")
                yield f"{where} has {what}, which would be dropped; give it to the joint '{joint}'"


def _constraints(mujoco: Any, model: Any, locked: frozenset[str]) -> Iterator[str]:
    kinds = {int(getattr(mujoco.mjtEq, name)): name.removeprefix("mjEQ_").lower() for name in dir(mujoco.mjtEq)
             if name.startswith("mjEQ_")}  # fmt: skip
    for i in range(model.neq):
        if not model.eq_active0[i]:
            continue
        kind, names = kinds[int(model.eq_type[i])], []
        if kind == "joint":
            names = [model.joint(k).name for k in (model.eq_obj1id[i], model.eq_obj2id[i]) if k >= 0]
        yield from _dropped(f"constraint <{kind}>", _name(mujoco, model, "EQUALITY", i), names, locked)


def _tendons(mujoco: Any, model: Any, locked: frozenset[str]) -> Iterator[str]:
    for i in range(model.ntendon):
        parts = range(model.tendon_adr[i], model.tendon_adr[i] + model.tendon_num[i])
        on_joints = all(model.wrap_type[part] == mujoco.mjtWrap.mjWRAP_JOINT for part in parts)
        names = [model.joint(model.wrap_objid[part]).name for part in parts] if on_joints else []
        yield from _dropped(
            f"tendon <{'fixed' if on_joints else 'spatial'}>", _name(mujoco, model, "TENDON", i), names, locked
        )


def _dropped(kind: str, own: str, names: Iterable[str], locked: frozenset[str]) -> Iterator[str]:
    names = list(dict.fromkeys(names))
    free = [name for name in names if name not in locked]
    if names and not free:
        return
    label = kind + (f" '{own}'" if own else "")
    between = f" of {', '.join(free)}" if free else ""
    advice = f"lock them (locked_joints={free!r}), or take it out" if free else "take it out"
    yield f"{label}{between} would be dropped; {advice}"


def _name(mujoco: Any, model: Any, kind: str, i: int) -> str:
    return mujoco.mj_id2name(model, int(getattr(mujoco.mjtObj, f"mjOBJ_{kind}")), i) or ""
