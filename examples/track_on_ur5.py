"""A UR5 follows a trajectory, certified on the arm as it is, with the friction model 20 % wrong.

Writes track_on_ur5.html.
"""

import numpy as np

from phcontrol import (
    MechanicalSystem,
    MinimumJerk,
    StribeckFriction,
    TrajectoryTracking,
    certify,
    load_robot,
    record,
    simulate,
)

robot = load_robot("ur5")
home = np.array([0.0, -1.2, 1.2, -1.5, -1.5, 0.0])  # [rad]
goal = home + [0.8, 0.4, -0.5, 0.3, 0.2, 0.5]  # [rad]
friction = StribeckFriction(viscous=[8.0, 8.0, 6.0, 2.0, 2.0, 1.0])  # [N·m·s/rad], a guess
real_friction = StribeckFriction(viscous=[9.6, 9.6, 7.2, 2.4, 2.4, 1.2])  # 20 % more
model, plant = MechanicalSystem(robot, friction=friction), MechanicalSystem(robot, friction=real_friction)

controller = TrajectoryTracking(
    model,
    trajectory=MinimumJerk(home, goal, travel_time=3.0),  # [rad], [s]
    stiffness=[400.0, 400.0, 300.0, 60.0, 60.0, 40.0],  # K_t [N·m/rad]
    damping=[60.0, 60.0, 40.0, 6.0, 6.0, 4.0],  # C [N·m·s/rad]
)
certificate = certify(controller, model)
print(certificate)

log = simulate(plant, controller, duration=4.0, dt=1e-3, q0=home)
errors = np.abs(log.position - log.goal).max(axis=1)
print("largest error on the way [mrad]:", 1e3 * errors.max())
print("error at the end [mrad]:", 1e3 * errors[-1])
record(log, "track_on_ur5.html")
