"""The seven-joint PERA is led to a posture, and returns to it under a load that nobody told it about.

Writes position_control.html: open it in a browser.
"""

from phcontrol import ForceFeedback, MechanicalSystem, MinimumJerk, Step, certify, load_robot, record, simulate

robot = load_robot("pera")
system = MechanicalSystem(robot)
goal = [-0.3, 1.0, -0.3, -0.9, 0.3, -1.2, 0.2]  # [rad]
controller = ForceFeedback(
    system,
    reference=MinimumJerk.within_limits(robot, robot.home, goal),  # a goal that jumps is overshot
    stiffness=[60.0, 60.0, 40.0, 40.0, 25.0, 15.0, 15.0],  # K_p [N·m/rad]
    damping=[20.0, 20.0, 10.0, 10.0, 5.0, 3.0, 3.0],  # C [N·m·s/rad]
    coupling=1.0,  # A
    force_gain=2.0,  # K_z
)
certificate = certify(controller, system)
print(certificate)

load = Step([0.0, 3.0, 0.0, 1.0, 0.0, 0.0, 0.0], start=5.0)  # [N·m] from 5 s on
log = simulate(system, controller, duration=9.0, dt=2e-3, disturbance=load)

before, after = log.time < 5.0, log.time >= 5.0
print("error before the load [rad]:", abs(log.position[before][-1] - goal).max())
print("largest error under it [rad]:", abs(log.position[after] - goal).max())
print("error at the end [rad]:", abs(log.position[-1] - goal).max())
record(log, "position_control.html")
