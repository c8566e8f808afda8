"""Your own arm: python own_urdf.py path/to/arm.urdf [joint to lock ...]. Without arguments, a Kinova.

Certifies force feedback on it, leads it to a posture near its home within its velocity limits, and writes
own_urdf.html.
"""

import sys

from phcontrol import MechanicalSystem, MinimumJerk, certify, load_robot, make_controller, record, simulate

source, *locked = sys.argv[1:] or ["kinova"]
robot = load_robot(source, locked_joints=locked)
print(f"{robot.name}: {robot.n} joints: {', '.join(robot.joint_names)}")

system = MechanicalSystem(robot)
goal = robot.near_home()  # [rad]
way = MinimumJerk.within_limits(robot, robot.home, goal)
controller = make_controller("force_feedback", system, goal, reference=way)  # gains by the arm's inertia and friction
print("stiffness [N·m/rad]:", controller.stiffness.diagonal().round(1))
print("damping [N·m·s/rad]:", controller.damping.diagonal().round(1))
certificate = certify(controller, system)
print(certificate)

log = simulate(system, controller, duration=10.0, dt=2e-3)
print("error at the end [rad]:", abs(log.position[-1] - goal).max())
record(log, "own_urdf.html")
