"""Which gains? From what a Panda's loop should do, and from what limits it, to starts that are safe.

    python examples/which_gains.py

Places the poles of force feedback, holds them against a simulated step, looks how far motors and sampling let one go,
tunes what no formula says, and asks from where no limit can be reached.
"""

from __future__ import annotations

import numpy as np

from phcontrol import (
    ControlLoop,
    DesiredBandwidth,
    MechanicalSystem,
    SamplingBudget,
    TorqueBudget,
    design_gains,
    load_robot,
    safe_set,
    simulate,
    tune,
)

arm = load_robot("panda", locked_joints=["panda_finger_joint1", "panda_finger_joint2"])
system = MechanicalSystem(arm)
home, goal = arm.home, arm.near_home()

# what is desired: every mode at 5 rad/s with ζ = 0.8, and what the true loop's spectrum says of it
designed = design_gains("force_feedback", system, DesiredBandwidth(5.0, 0.8), goal)
print(designed)

# what limits it: the motors on a step from home, and a torque that is held for 2 ms and one period late
by_torque = design_gains("force_feedback", system, TorqueBudget([home], share=0.9), goal)
by_period = design_gains("force_feedback", system, SamplingBudget(2e-3, delay=1), goal)
print(by_torque.notes[-1])
print(by_period.notes[-1])

# what no formula says: the least error of two steps, one of them with a push, that 30 % more torque is not worth
scenarios = [{"q0": home, "duration": 1.0, "dt": 2e-3}, {"q0": home, "duration": 1.0, "dt": 2e-3}]
scenarios[1]["disturbance"] = np.full(system.n, 0.5)  # [N·m]


def objective(log):
    """Mean error [rad], and what torque costs."""
    return float(np.abs(log.position - goal).mean() + 2e-4 * np.sqrt((log.torque**2).mean()))


tuned = tune(designed.law, objective, scenarios, evaluations=30, period=1e-3)
print(tuned)

# from where is no limit ever reached? H_d never grows
safe = safe_set(designed.law, keep=("position", "velocity"))
print(safe)
q0, v0, z0 = (rows[0] for rows in safe.border(1))
log = simulate(system, designed.law, q0=q0, v0=v0, controller_state0=z0, duration=1.0, dt=1e-3)
used = float(np.max(np.abs(log.velocity) / arm.velocity_limit))
print(f"a run from the border uses {used:.0%} of a velocity limit at most")

# a loop that refuses to start from anywhere else: here the arm stands at home, too far for that promise
loop = ControlLoop(system, designed.law, 1e-3, safe_set=safe, clock=iter(np.arange(0.0, 1.0, 1e-3)).__next__)
loop.step(home, np.zeros(system.n))
print(loop.reason)
