"""A Panda holds its hand like a spring: a push moves it by K⁻¹F; its elbow is brought where it should be, and pays.

Writes cartesian_impedance.html.
"""

import numpy as np

from phcontrol import CartesianImpedance, EnergyTank, MechanicalSystem, Wrench, certify, load_robot, record, simulate

system = MechanicalSystem(load_robot("panda", locked_joints=["panda_finger_joint1", "panda_finger_joint2"]))
frame, start = system.hand_frame, system.robot.near_home()
preferred = start + [0.3, 0.0, -0.4, 0.0, 0.3, 0.0, 0.0]  # [rad], another elbow
controller = CartesianImpedance(
    system,
    goal=system.at(start).placement(frame),
    translational_stiffness=[600.0, 600.0, 200.0],  # [N/m], axes of the world
    rotational_stiffness=30.0,  # [N·m/rad]
    damping_ratio=0.7,
    nullspace_damping=4.0,  # [1/s]
    posture="tank",
    preferred_posture=preferred,
    posture_stiffness=10.0,  # [N·m/rad]
    tank=EnergyTank(initial=2.0, lowest=0.02, highest=5.0),  # [J]
)
certificate = certify(controller, samples=64)
print(certificate)

push = np.array([0.0, 6.0, -10.0])  # [N]
log = simulate(system, controller, duration=6.0, dt=2e-3, q0=start, disturbance=Wrench(frame, [*push, 0.0, 0.0, 0.0]))
motion = log.frame(frame)
moved = motion.position[-1] - motion.position[0]
expected = push / [600.0, 600.0, 200.0]
print(f"pushed by {push} N the hand moves by {1e3 * moved} mm; K⁻¹F is {1e3 * expected} mm")
turned = np.abs(log.position[-1] - start).max()
print(f"the elbow turns by {turned:.2g} rad; the tank holds {log.tank_level.min():.3g} J at least")
record(log, "cartesian_impedance.html")
