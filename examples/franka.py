"""A law on a Franka Research 3, real or simulated: the same commands for both.

    pip install 'phcontrol[franka]'
    pip install franky-sim && franky-sim -s mujoco  # in another environment: prints the simulated robot's address
    python examples/franka.py 127.0.0.1 --urdf fr3.urdf [--law tracking] [--seconds 20]

The arm goes half a radian's way and back, or swings, within the documented limits of the robot. ``fr3.urdf`` is your
robot's description (franka_description; the simulator brings one). Keep the stop button in your hand.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from phcontrol import (
    ArmDriver,
    ArmError,
    CartesianImpedance,
    Controller,
    ControlLoop,
    FrankaArm,
    Limits,
    MechanicalSystem,
    MinimumJerk,
    MomentumObserver,
    ObservedArm,
    Pose,
    Sinusoid,
    TorqueFilter,
    Trajectory,
    drive,
    load_robot,
    make_controller,
)

PERIOD = 1e-3  # [s]
ROTORS = 0.195  # reflected inertia of each joint's motor [kg m²], as in MuJoCo's model of the arm
WAY = np.array([0.3, -0.2, 0.3, -0.2, 0.3, 0.2, 0.3])  # [rad]
LAWS = (
    "energy_shaping",
    "force_feedback",
    "force_feedback_measured",
    "integral_action",
    "total_force_rejection",
    "adaptive_payload",
    "classical_impedance",
    "tracking",
    "cartesian_impedance",
)


def make_law(name: str, system: MechanicalSystem, start: np.ndarray) -> tuple[Controller, Trajectory | None]:
    """Return a law that starts where the arm is, and the joints' way; the hand's spring has none."""
    if name == "cartesian_impedance":
        hand = system.at(start).placement(system.hand_frame)
        goal = Pose(hand.translation + [0.0, 0.05, -0.05], hand.rotation)  # [m]
        law = CartesianImpedance(
            system, goal=goal, translational_stiffness=400.0, rotational_stiffness=20.0, nullspace_damping=4.0
        )  # [N/m], [N·m/rad], [1/s]
        return law, None
    way = MinimumJerk.within_limits(system.robot, start, start + WAY)
    if name == "tracking":  # the swing begins at its end, at rest
        way = Sinusoid(0.5 * WAY, 0.2, offset=start + 0.5 * WAY)
        return make_controller(name, system, trajectory=way), way
    return make_controller(name, system, start + WAY, reference=way), way


def driver_for(law: Controller, arm: FrankaArm, system: MechanicalSystem) -> ArmDriver:
    """Return the arm, with an observer of the external force where the law asks for it."""
    return ObservedArm(arm, MomentumObserver(system)) if law.needs else arm


def main() -> None:
    """Run a law on the arm and print how it went."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("address", help="of the robot, or of a simulated one")
    parser.add_argument("--urdf", required=True, help="the robot's description")
    parser.add_argument("--law", choices=LAWS, default="energy_shaping")
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--realtime", action="store_true", help="insist on a real-time kernel: on a real robot, do")
    parser.add_argument("--velocity-margin", type=float, default=0.3, help="how far below its velocity limits")
    options = parser.parse_args()
    text = Path(options.urdf).read_text(encoding="utf-8")
    fingers = [name for name in ("fr3_finger_joint1", "fr3_finger_joint2") if f'"{name}"' in text]
    robot = load_robot(options.urdf, locked_joints=fingers, armature=ROTORS)
    system = MechanicalSystem(robot, friction=None)
    limits = Limits.franka(system, velocity_margin=options.velocity_margin)
    steps: list[tuple[np.ndarray, np.ndarray]] = []
    print(f"connecting to {options.address}", flush=True)
    try:
        with FrankaArm(options.address, system, realtime=options.realtime, recover=True) as arm:
            law, way = make_law(options.law, system, arm.position)
            loop = ControlLoop(
                system,
                law,
                PERIOD,
                torque_filter=TorqueFilter(system, period=PERIOD, limits=limits),
                stale_after=0.02,
            )
            driver = driver_for(law, arm, system)
            print(f"{options.law} moves the arm for {options.seconds:g} s, and stops", flush=True)
            drive(loop, driver, options.seconds, each_step=lambda t, now, torque: steps.append((now.position, torque)))
            mode = loop.mode.name
            loop.stop("the end")
            drive(loop, driver, 0.5)
    except ArmError as reason:
        print(reason)
        raise SystemExit(1) from reason
    torques = np.array([torque for _, torque in steps])
    print("mode:", mode, loop.fault or "")
    if way is not None:
        ways = np.array([way.at(k * PERIOD).position for k in range(len(steps))])
        errors = np.abs(np.array([position for position, _ in steps]) - ways).max(axis=1)
        print(f"error [rad]: {errors.max():.4f} at most, {errors[-1]:.4f} at the end")
    else:
        hand = system.at(steps[-1][0]).placement(system.hand_frame)
        print(f"hand from its goal [m]: {np.linalg.norm(hand.translation - law.pose_at(0.0).translation):.4f}")
    print("largest torque sent [N·m]:", np.round(np.abs(torques).max(axis=0), 1))
    print(f"largest rate [N·m/s]: {np.abs(np.diff(torques, axis=0)).max() / PERIOD:.0f}")
    print("states:", arm.counts, "loop:", loop.counts)
    print("filter:", {status.name.lower(): number for status, number in loop.torque_filter.counts.items() if number})
    print("timing:", loop.timing)


if __name__ == "__main__":
    main()
