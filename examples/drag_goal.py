"""A hand whose goal and stiffness change while the arm runs: from a script, or dragged in the browser with --view.

Goals become jerk-limited paths, and what changes of the stiffness is paid for by an energy tank: so the stored energy
never grows by more than what is done to the arm from outside.
"""

import sys

import numpy as np
import pinocchio as pin

from phcontrol import CartesianTracking, LiveView, MechanicalSystem, Stiffness, load_robot, simulate
from phcontrol.setpoints import LiveFramePath, LiveValue, Setpoint

system = MechanicalSystem(load_robot("panda"))
frame = "panda_hand_tcp"
start = system.at(system.robot.home).placement(frame)

goal = LiveFramePath(frame, start, speed=0.25)  # [m/s]
stiffness = LiveValue([600.0, 600.0, 600.0], rate=2000.0, unit="N/m")  # [N/m over a second]
law = CartesianTracking.tuned(
    system, path=goal, translational_stiffness=600.0, rotational_stiffness=30.0,
    variation=Stiffness(stiffness, duration=1.0),
)  # fmt: skip
setpoint = Setpoint(goal=goal, stiffness=stiffness)

if "--view" in sys.argv:  # drag the blue ball, or move the sliders
    with LiveView(controls=setpoint) as view:
        log = simulate(system, law, duration=120.0, control_period=1e-3, setpoint=setpoint, watch=view)
        view.linger(log)
else:
    up = start.translation + np.array([0.0, 0.1, 0.15])
    turned = start.rotation @ pin.exp3(np.array([0.0, 0.4, 0.0]))
    setpoint.change(goal=(up, start.rotation), at=0.5)
    setpoint.change(goal=(start.translation, turned), at=1.0)  # before the first is reached
    setpoint.change(stiffness=[1500.0, 600.0, 200.0], at=1.0)
    log = simulate(system, law, duration=4.0, control_period=1e-3, setpoint=setpoint)

hand = system.at(log.position[-1]).placement(frame)
error = np.abs(hand.translation - goal.goal.position).max()
print(f"the hand is {error:.1e} m from its last goal")
print(f"H_d never grew by more than {np.diff(log.storage).max():.1e} J from one sample to the next")
