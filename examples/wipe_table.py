"""Press on a table with 10 N while the fingertip wipes over 0.3 m of it, against friction.

The spring on the hand leaves the table's normal free and a wrench presses along it; across it the hand follows a path.
No force is measured. Writes wipe_table.html.
"""

import numpy as np

from phcontrol import (
    CartesianTracking,
    FrameLine,
    MechanicalSystem,
    RigidBody,
    SphereContact,
    certify,
    load_robot,
    record,
    simulate,
)

PRESS, WAY, WAIT = 10.0, 0.31, 1.0  # [N], [m], [s]

system = MechanicalSystem(load_robot("panda", locked_joints=["panda_finger_joint1", "panda_finger_joint2"]))
frame, start = system.hand_frame, np.array([-0.3, 0.35, 0.0, -2.0, 0.0, 2.35, 0.5])  # [rad]
hand = system.at(start).placement(frame)
first, last = (hand.translation, hand.rotation), (hand.translation + [0.0, WAY, 0.0], hand.rotation)
controller = CartesianTracking(
    system,
    path=FrameLine(frame, first, last, 5.0, start=WAIT),  # [m], [s]
    translational_stiffness=1500.0,  # [N/m], across the table
    rotational_stiffness=60.0,  # [N·m/rad]
    free_direction=(0.0, 0.0, 1.0),
    wrench=(0.0, 0.0, -PRESS, 0.0, 0.0, 0.0),  # that the hand exerts [N, N·m]
)
table = RigidBody(
    SphereContact(frame, 0.01, "plane", position=hand.translation + [0.0, WAY / 2, -0.0105]),  # [m]
    stiffness=2e4,  # [N/m]
    damping=200.0,  # [N·s/m]
    friction=0.4,
)
certificate = certify(controller, samples=32)
print(certificate)

log = simulate(system, controller, duration=6.0, dt=1e-3, q0=start, bodies=[table])
sliding = log.time >= WAIT
off = np.abs(log.contact_force[sliding] - PRESS).max()
motion, balance = log.frame(frame), log.power_balance("all")
way = motion.position[-1, 1] - motion.position[0, 1]
rubbed = float(np.sum(log.contact_power) * log.metadata["dt"])
drag = np.abs(motion.wrench[sliding, 1]).max()
print(f"slid {way:.3f} m, pressing with {PRESS:g} N within {off:.2g} N, against up to {drag:.2g} N of friction")
print(f"friction took {rubbed:.3g} J; the energy of arm and table balances to {balance.energy_drift:.1g} J")
record(log, "wipe_table.html", certificate=certificate)
