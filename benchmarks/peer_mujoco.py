"""The same arm and law in MuJoCo: the law in Python, by a control callback, or all in C."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from phcontrol import MechanicalSystem
from phcontrol.compilation.rigid_body import ArmModel

INTEGRATORS = ("RK4", "Euler")


def _numbers(values: Any) -> str:
    return " ".join(repr(float(value)) for value in values)


def model_of(
    system: MechanicalSystem,
    dt: float,
    integrator: str,
    gains: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
) -> Any:
    """Return an ``MjModel`` with the inertias of a system, frictionless and without contact.

    With ``gains`` (goal, K_p, C, the last two by joint) the law is in it: affine actuators, and the weight compensated.
    """
    import mujoco

    arm = ArmModel(system.model)
    texts, children = [""] * len(arm), [[] for _ in range(len(arm))]
    roots = []
    for k, body in enumerate(arm.bodies):
        (roots if body.parent < 0 else children[body.parent]).append(k)
    for k in reversed(range(len(arm))):
        body = arm.bodies[k]
        R, (a, b, c), (_, d, e), (_, _, f) = np.array(body.rotation), *body.inertia
        kind = "slide" if body.prismatic else "hinge"
        compensated = "" if gains is None else ' gravcomp="1"'
        place = f'pos="{_numbers(body.translation)}" xyaxes="{_numbers([*R[:, 0], *R[:, 1]])}"{compensated}'
        joint = f'type="{kind}" axis="{_numbers(body.axis)}" armature="{body.armature!r}" limited="false"'
        matter = f'mass="{body.mass!r}" fullinertia="{_numbers([a, d, f, b, c, e])}"'
        texts[k] = (
            f'<body name="b{k}" {place}><joint name="j{k}" {joint}/>'
            f'<inertial pos="{_numbers(body.centre)}" {matter}/>{"".join(texts[child] for child in children[k])}</body>'
        )
    actuators = ""
    if gains is not None:
        _, stiffness, damping = gains
        for k in range(len(arm)):  # torque = K_p·q_d − K_p q − C q̇
            actuators += (
                f'<general joint="j{k}" gaintype="fixed" gainprm="{float(stiffness[k])!r}" biastype="affine" '
                f'biasprm="0 {-float(stiffness[k])!r} {-float(damping[k])!r}"/>'
            )
    text = (
        f'<mujoco><compiler angle="radian" autolimits="false"/><option timestep="{dt!r}" integrator="{integrator}" '
        f'gravity="{_numbers(system.model.gravity.linear)}"><flag contact="disable" constraint="disable"/></option>'
        f"<worldbody>{''.join(texts[k] for k in roots)}</worldbody><actuator>{actuators}</actuator></mujoco>"
    )
    return mujoco.MjModel.from_xml_string(text)


def by_python(
    model: Any, law: Callable[..., np.ndarray], q0: np.ndarray, v0: np.ndarray, steps: int, callback: bool
) -> dict[str, np.ndarray]:
    """Run with a law in Python, once a step or (``callback``) at each evaluation; log q, q̇ and torque."""
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = q0, v0
    log = {name: np.zeros((steps + 1, model.nv)) for name in ("q", "v", "torque")}

    def control(model: Any, data: Any) -> None:
        data.qfrc_applied[:] = law(data.qpos, data.qvel)

    if callback:
        mujoco.set_mjcb_control(control)
    try:
        for k in range(steps + 1):
            log["q"][k], log["v"][k] = data.qpos, data.qvel
            if not callback:
                control(model, data)
            mujoco.mj_step(model, data)
            log["torque"][k] = data.qfrc_applied
    finally:
        mujoco.set_mjcb_control(None)
    return log


def in_c(model: Any, goal: np.ndarray, q0: np.ndarray, v0: np.ndarray, steps: int) -> dict[str, np.ndarray]:
    """Run with the law that is in the model; MuJoCo's own loop in C logs the states."""
    import mujoco
    from mujoco import rollout

    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = q0, v0, goal
    start = np.zeros((1, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    mujoco.mj_getState(model, data, start[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    control = np.tile(goal, (1, steps, 1))
    states, _ = rollout.rollout(model, data, start, control, nstep=steps)
    n = model.nv
    states = np.concatenate([start[None], states], axis=1)[0]
    return {"q": states[:, 1 : 1 + n], "v": states[:, 1 + n : 1 + 2 * n]}


def step_of(
    model: Any, goal: np.ndarray, stiffness: np.ndarray, damping: np.ndarray
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return u = g − K_p(q − q_d) − C q̇ with g of MuJoCo's recursive Newton-Euler."""
    import mujoco

    data, weight = mujoco.MjData(model), np.zeros(model.nv)

    def law(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_rne(model, data, 0, weight)  # data.qvel is 0
        torque: np.ndarray = weight - stiffness @ (q - goal) - damping @ v
        return torque

    return law
