"""Time of one step of Cartesian impedance against one written by hand with Λ and a pseudo-inverse, on seven joints.

    python benchmarks/cartesian_step.py [--rounds N]

The last two follow a figure of eight: by hand with q̇_ref = 𝒥⁺ξ_d, its rate, and M q̈_ref + C q̇_ref fed forward; the
path is the same object in both.

By hand are: F = −K x̃ − D ẋ with D constant, or the double diagonalisation, the torque 𝒥ᵀF + g, and a damper in the
null space by N = 1 − 𝒥ᵀ𝒥̄ᵀ, 𝒥̄ = M⁻¹𝒥ᵀΛ. All are interleaved in one run; the ratios are what to look at.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np
import pinocchio as pin
from timing import interleaved

from phcontrol import FramePath, MechanicalSystem, load_robot, make_controller
from phcontrol.mechanics.kernels import KERNELS

FINGERS = ["panda_finger_joint1", "panda_finger_joint2"]
STIFFNESS = np.array([600.0, 600.0, 200.0, 30.0, 30.0, 30.0])


def by_hand(model: pin.Model, frame: str, goal: pin.SE3, designed: bool) -> Callable[..., np.ndarray]:
    """Return Cartesian impedance as it is commonly written, with a constant damping or one that Λ is used for."""
    data, index, stiffness = model.createData(), model.getFrameId(frame), np.diag(STIFFNESS)
    constant, one = np.diag(2.0 * 0.7 * np.sqrt(STIFFNESS)), np.eye(model.nv)

    def law(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        pin.computeJointJacobians(model, data, q)
        pose = pin.updateFramePlacement(model, data, index)
        jacobian = pin.getFrameJacobian(model, data, index, pin.LOCAL_WORLD_ALIGNED)
        error = np.concatenate([pose.translation - goal.translation, pin.log3(pose.rotation @ goal.rotation.T)])
        mass, gravity = pin.crba(model, data, q), pin.computeGeneralizedGravity(model, data, q)
        inverse = np.linalg.inv(mass)
        inertia = np.linalg.pinv(jacobian @ inverse @ jacobian.T)
        damping = constant
        if designed:
            half = np.linalg.cholesky(inertia)
            squares, modes = np.linalg.eigh(np.linalg.solve(half, np.linalg.solve(half, stiffness).T))
            damping = (half @ modes * (1.4 * np.sqrt(squares))) @ (half @ modes).T
        null = one - jacobian.T @ (inertia @ jacobian @ inverse)
        force = stiffness @ error + damping @ (jacobian @ v)
        torque: np.ndarray = gravity - jacobian.T @ force - null @ (4.0 * v)
        return torque

    return law


def tracking_by_hand(model: pin.Model, frame: str, path: FramePath) -> Callable[..., np.ndarray]:
    """Return the same law with a constant damping along a path, as it is commonly written."""
    data, index, stiffness = model.createData(), model.getFrameId(frame), np.diag(STIFFNESS)
    damping, one = np.diag(2.0 * 0.7 * np.sqrt(STIFFNESS)), np.eye(model.nv)

    def law(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        desired = path.at(t)
        pin.computeJointJacobiansTimeVariation(model, data, q, v)
        pose = pin.updateFramePlacement(model, data, index)
        jacobian = pin.getFrameJacobian(model, data, index, pin.LOCAL_WORLD_ALIGNED)
        rate = pin.getFrameJacobianTimeVariation(model, data, index, pin.LOCAL_WORLD_ALIGNED)
        error = np.concatenate([pose.translation - desired.position, pin.log3(pose.rotation @ desired.rotation.T)])
        inverse = np.linalg.pinv(jacobian)
        v_ref = inverse @ desired.twist
        a_ref = inverse @ (desired.acceleration - rate @ v_ref) + (one - inverse @ jacobian) @ rate.T @ (
            inverse.T @ v_ref
        )
        mass, gravity = pin.crba(model, data, q), pin.computeGeneralizedGravity(model, data, q)
        coriolis = pin.computeCoriolisMatrix(model, data, q, v)
        mobility = np.linalg.inv(mass)
        inertia = np.linalg.pinv(jacobian @ mobility @ jacobian.T)
        null = one - jacobian.T @ (inertia @ jacobian @ mobility)
        slip = v - v_ref
        force = stiffness @ error + damping @ (jacobian @ slip)
        torque: np.ndarray = gravity - jacobian.T @ force - null @ (4.0 * slip) + mass @ a_ref + coriolis @ v_ref
        return torque

    return law


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=200, help="rounds of 20 calls each")
    rounds = parser.parse_args().rounds
    system = MechanicalSystem(load_robot("panda", locked_joints=FINGERS))
    goal, generator = system.robot.near_home(), np.random.default_rng(0)
    q, v = goal + 0.1 * generator.normal(size=7), generator.normal(size=7)
    pose = system.at(goal).placement(system.hand_frame)
    gains = {"translational_stiffness": STIFFNESS[:3], "rotational_stiffness": STIFFNESS[3:]}
    candidates: dict[str, Callable[[], object]] = {}
    for name, designed in (("by hand, constant damping", False), ("by hand, damping of Λ and K", True)):
        law = by_hand(system.model, system.hand_frame, pose, designed)
        candidates[name] = lambda law=law: law(q, v)  # type: ignore[misc]
    for name in ("cartesian_impedance", "cartesian_impedance_with_tank", "cartesian_tracking"):
        made = make_controller(name, system, **gains)
        state = made.initial_state(system.at(q, v))
        candidates[name] = lambda made=made, state=state: made.evaluate(1.0, system.at(q, v), state)  # type: ignore[misc]
        if name == "cartesian_tracking":
            tracking = tracking_by_hand(system.model, system.hand_frame, made.path)
            candidates["by hand, along the path"] = lambda tracking=tracking: tracking(1.0, q, v)  # type: ignore[misc]
    times = interleaved(candidates, rounds)
    reference = times["by hand, constant damping"].median
    print(f"kernels: {KERNELS}\n{'':<36}{'median':>9}{'p99':>11}{'/ by hand':>11}")
    for name, timing in times.items():
        print(f"{name:<36}{timing.median:>6.1f} µs{timing.p99:>8.1f} µs{timing.median / reference:>11.2f}")


if __name__ == "__main__":
    main()
