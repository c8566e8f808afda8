"""The chain of the thesis's section 7.2: see, go there, grasp. One arm, one closed loop.

The PERA brings its gripper to an object by the camera in its hand (Hamiltonian servo). When the object looks as it does
from between the fingers, the hand closes and holds it with 0.5 N·m (impedance grasping). The camera gives 30 frames a
second, each one late; the force sensor has noise.
Writes servo_and_grasp.html.
"""

import numpy as np

from phcontrol import (
    CameraSensor,
    CompliantBody,
    ForceRegulation,
    ForceSensor,
    HamiltonianServo,
    ImpedanceGrasping,
    JointContact,
    MechanicalSystem,
    ObservedObject,
    PinholeCamera,
    Schedule,
    certify,
    goal_posture,
    load_robot,
    record,
    simulate,
)

robot = load_robot("pera_with_gripper")  # seven joints and the gripper
system = MechanicalSystem(robot)
gripper = robot.joint_index("gripper")
start = np.array([-0.3, 0.8, -0.2, -1.4, 0.2, -1.2, 0.1, 1.0])  # elbow bent, hand open [rad]

# What is there: a foam block of 50 x 30 x 30 mm, 25 cm before the camera, a little aside.
camera = PinholeCamera(image_size=(640, 480), field_of_view=np.pi / 2)  # f = 10 mm
size = (0.05, 0.03, 0.03)  # [m]
block = ObservedObject.seen_as(camera, [0.002, -0.002, 0.002], system.at(start), size, turn=np.pi / 2)
foam = CompliantBody(
    JointContact("gripper", 0.38),  # the fingers are 30 mm apart at 0.38 rad
    stiffness=8.0,  # [N·m/rad]
    damping=0.2,  # [N·m·s/rad]
    mass=0.01,  # [kg·m²]
)

# Where it has to be: at the grip point, as the camera sees that.
grip = robot.placement("camera", robot.home).actInv(robot.placement("tool", robot.home).translation)  # [m]
goal = camera.focal_length / grip[2] * np.array([grip[0], grip[1], size[0]])  # (mu, nu, l) [m]
posture = goal_posture(system, block, goal, guess=start)  # from what is seen at the start [rad]

servo = HamiltonianServo.tuned(system, goal, camera=camera, object_length=size[0], posture=posture)
grasp = ImpedanceGrasping(
    system,
    goal=np.append(posture[:gripper], 0.38),  # [rad]
    stiffness=[150.0, 150.0, 100.0, 100.0, 60.0, 40.0, 40.0, 1.0],  # K_p [N·m/rad]
    rest_stiffness=[150.0, 150.0, 100.0, 100.0, 60.0, 40.0, 40.0, 0.25],  # K_rl [N·m/rad]
    damping=[40.0, 40.0, 25.0, 25.0, 10.0, 6.0, 6.0, 1.5],  # C [N·m·s/rad]
    regulation=ForceRegulation([0.0] * 7 + [0.5], gain=0.3, rate_limit=0.5),  # [N·m], [rad/(N·m·s)], [rad/s]
)
certificates = [certify(law, system) for law in (servo, grasp)]
print(*certificates, sep="\n")

close_at = 6.0  # [s]
log = simulate(
    system,
    Schedule([(0.0, servo), (close_at, grasp)]),
    duration=30.0,
    dt=2e-3,
    q0=start,
    scene=block,
    bodies=[foam],
    sensors=[CameraSensor(block, rate=30.0), ForceSensor(noise=0.005)],  # [1/s], [N·m]
)
touch = int(np.argmax(log.contact_force > 0.0))
distance = np.linalg.norm(robot.placement("tool", log.position[touch]).translation - block.position)
print(f"at first touch, {log.time[touch]:.2f} s, the grip point is {1e3 * distance:.2f} mm from the block")
print(f"contact moment at the end {log.contact_force[-1]:.4f} N·m, at most {log.contact_force.max():.3f} N·m")
record(log, "servo_and_grasp.html")
