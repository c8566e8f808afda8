"""MuJoCo as a plant that phcontrol's laws drive: an arm of an MJCF, with its rotors, damping and dry friction."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from phcontrol import Motion, load_robot

FR3 = Path(__file__).parents[1] / "mechanics" / "fr3.xml"
FINGERS = ("finger_joint1", "finger_joint2")
READY = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])


def arm(**options):
    """The arm as the file has it, its fingers locked."""
    return load_robot(FR3, locked_joints=FINGERS, **options)


def plant(payload=None, com=(0.0, 0.0, 0.0), inertia=(0.0, 0.0, 0.0), text=None):
    """MuJoCo's model without finger joints, and a body at the tool point; its integrator is Runge-Kutta of order 4."""
    import mujoco

    spec = mujoco.MjSpec.from_string(FR3.read_text() if text is None else text)
    for equality in list(spec.equalities):
        spec.delete(equality)
    for key in list(spec.keys):
        spec.delete(key)
    for name in FINGERS:
        spec.delete(spec.joint(name))
    if payload is not None:
        body = spec.body("hand").add_body(name="payload", pos=[0.0, 0.0, 0.1034])
        body.mass, body.ipos, body.inertia, body.explicitinertial = payload, list(com), list(inertia), True
    spec.option.timestep = 1e-3
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    return spec.compile()


def run(model, law, duration, start, *, noise=0.0, seed=0, substeps=1):
    """Drive MuJoCo by a law, a torque a millisecond; return the motion that sensors with noise show, and the true one.

    ``noise`` is the standard deviation of measured velocities [rad/s]; of positions a tenth, of torques ten times it.
    """
    import mujoco

    data, generator = mujoco.MjData(model), np.random.default_rng(seed)
    data.qpos[:], data.qvel[:] = start, 0.0
    period, n = model.opt.timestep * substeps, model.nv
    samples = round(duration / period)
    time, q, v, u = np.arange(samples) * period, *np.zeros((3, samples, n))
    state = law.initial_state(law.system.at(start))
    for k in range(samples):
        q[k], v[k] = data.qpos, data.qvel
        command = law.evaluate(time[k], law.system.at(q[k], v[k]), state)
        if command.state_rate is not None:
            state = state + period * command.state_rate
        u[k] = data.qfrc_applied[:] = command.torque
        for _ in range(substeps):
            mujoco.mj_step(model, data)
    shown = [array + sigma * generator.normal(size=array.shape)
             for array, sigma in ((q, 0.1 * noise), (v, noise), (u, 10.0 * noise))]  # fmt: skip
    return Motion.of(time, *shown), Motion.of(time, q, v, u), state
