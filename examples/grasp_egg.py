"""The gripper closes on something as soft as an egg, and holds it with 0.2 N·m: neither more nor less.

Without a force sensor: the momentum observer finds the contact force from position, velocity and torque.
Writes grasp_egg.html.
"""

from phcontrol import (
    CompliantBody,
    ForceRegulation,
    ImpedanceGrasping,
    JointContact,
    MechanicalSystem,
    MomentumObserver,
    load_robot,
    record,
    simulate,
)

gripper = MechanicalSystem(load_robot("pera_gripper"))
egg = CompliantBody(
    JointContact("gripper", 0.20),  # the fingers meet it at 0.20 rad
    stiffness=4.0,  # [N·m/rad]
    damping=0.1,  # [N·m·s/rad]
    mass=0.01,  # [kg·m²]
)
force = 0.2  # of the egg on the gripper [N·m]
controller = ImpedanceGrasping(
    gripper,
    goal=[0.20],  # where the virtual spring pulls to, at first [rad]
    stiffness=1.0,  # K_p [N·m/rad]
    rest_stiffness=0.25,  # K_rl [N·m/rad]
    damping=1.5,  # C [N·m·s/rad]
    regulation=ForceRegulation([force], gain=0.3, rate_limit=0.5),  # [rad/(N·m·s)], [rad/s]
)
log = simulate(
    gripper,
    controller,
    duration=25.0,
    dt=2e-3,
    control_period=1e-2,  # the real gripper's [s]
    q0=[0.30],
    bodies=[egg],
    sensors=[MomentumObserver(gripper, gain=50.0)],  # [1/s]
)
print("contact force at the end [N·m]:", log.contact_force[-1])
print("largest contact force [N·m]:", log.contact_force.max())
record(log, "grasp_egg.html")
