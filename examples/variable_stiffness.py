"""A stiffness goes from 100 to 2000 N/m and back at 2 Hz while somebody pushes: unpaid it puts energy in, paid never.

Writes variable_stiffness.png.
"""

import numpy as np
from matplotlib.figure import Figure

from phcontrol import CartesianImpedance, MechanicalSystem, Stiffness, Wrench, certify, load_robot, simulate


def stiffness(t):
    """K_t(t) [N/m]."""
    return 1050.0 - 950.0 * np.cos(4.0 * np.pi * t)


class Unpaid(CartesianImpedance):
    """The same torque with nobody who pays for it."""

    name = "unpaid"

    def shape(self, t, x, state, measured):
        law = super().shape(t, x, state, measured)
        return law._replace(effort=law.effort + varying.torque(t, x))


robot = load_robot("panda", locked_joints=["panda_finger_joint1", "panda_finger_joint2"])
system = MechanicalSystem(robot, friction=None)
frame, start = system.hand_frame, robot.near_home()
hand = system.at(start).placement(frame)
gains = {
    "goal": hand,
    "translational_stiffness": 100.0,  # [N/m], the constant part, which has a potential
    "rotational_stiffness": 30.0,  # [N·m/rad]
    "damping_ratio": 0.05,
    "preferred_posture": start,
}
paid = CartesianImpedance(system, variation=Stiffness(stiffness, duration=0.5), **gains)
(varying,) = paid.paid
certificate = certify(paid, samples=64)
print(certificate)

push = Wrench(frame, [0.0, 0.0, -10.0, 0.0, 0.0, 0.0])  # [N]
excess = {}
for law in (paid, Unpaid(system, **gains)):
    log = simulate(system, law, duration=4.0, q0=start, disturbance=push, torque_limit=None)
    energy = log.storage
    if law is not paid:  # motion and spring, of what it is at each instant
        away = log.frame(frame).position - hand.translation
        energy = energy + 0.5 * (stiffness(log.time) - 100.0) * (away**2).sum(axis=1)
    power = log.external_power
    supplied = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(log.time))])
    excess[law.name] = energy - energy[0] - supplied
    if law is paid:
        level = log.tank_level
for name, values in excess.items():
    print(f"{name}: energy beyond what the push supplied, at most {values.max():.2g} J")

figure = Figure(figsize=(9.0, 6.0), layout="constrained")
above, below = figure.subplots(2, 1, sharex=True)
for name, values in excess.items():
    above.plot(log.time, values, label=name)
above.set_ylabel("H_d − H_d(0) − supplied [J]")
above.legend()
below.plot(log.time, level)
below.set_ylabel("in the tank [J]")
below.set_xlabel("t [s]")
figure.savefig("variable_stiffness.png", dpi=110)
