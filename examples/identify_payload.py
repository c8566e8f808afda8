"""What an arm carries and how it rubs is found out from how it moved; then a law follows a path closer.

    python examples/identify_payload.py

A Panda holds a body and has friction and rotors of which its model knows nothing. It is led along a motion that tells
them; they are identified from the log with noise of sensors, and a tracking law with the new model follows a figure
that it followed badly before. At the end the body is exchanged, and an adaptive law finds out the new one as it goes.
"""

from dataclasses import replace

import numpy as np

from phcontrol import (
    AdaptivePayload,
    MechanicalSystem,
    Motion,
    Payload,
    StribeckFriction,
    TrajectoryTracking,
    certify,
    compare_models,
    exciting_trajectory,
    identify,
    load_robot,
    simulate,
)
from phcontrol.trajectories.minimum_jerk import usual_speed
from phcontrol.trajectories.sinusoid import Sinusoid

FINGERS = ("panda_finger_joint1", "panda_finger_joint2")
GAINS = {
    "stiffness": [2000, 2000, 1500, 1500, 600, 500, 300],  # [N·m/rad]
    "damping": [60, 60, 50, 50, 20, 15, 10],  # [N·m·s/rad]
}
ROTORS = np.linspace(0.2, 0.05, 7)  # [kg·m²]
FRICTION = StribeckFriction(viscous=np.linspace(0.4, 1.0, 7), coulomb=np.linspace(1.2, 0.3, 7))  # [N·m·s/rad], [N·m]
HELD = Payload(0.8, com=(0.02, -0.03, 0.06), inertia=(0.004, 0.003, 0.002), frame="panda_hand")  # [kg], [m], [kg·m²]

# what is known, and what is so
known = replace(load_robot("panda", locked_joints=FINGERS, armature=0.0), friction=None)
true = MechanicalSystem(load_robot("panda", locked_joints=FINGERS, armature=ROTORS, payload=HELD), friction=FRICTION)
print(compare_models(known, true, samples=10), end="\n\n")

# a motion that tells the parameters, inside the limits, and the log of it
motion = exciting_trajectory(known, duration=12.0, frame="panda_hand", candidates=40)
print(f"condition number {motion.condition:.0f}, the first motion tried had {motion.first_condition:.0f}")
start = motion.at(0.0).position
law = TrajectoryTracking.tuned(MechanicalSystem(known), trajectory=motion, **GAINS)
log = simulate(true, law, q0=start, duration=12.0, dt=2e-3, progress=False)
noise = np.random.default_rng(1)
shown = Motion.of(
    log.time,
    log.position + 1e-4 * noise.normal(size=log.position.shape),  # [rad]
    log.velocity + 1e-3 * noise.normal(size=log.velocity.shape),  # [rad/s]
    log.torque + 1e-2 * noise.normal(size=log.torque.shape),  # [N·m]
    held=False,
)

found = identify(
    shown, ("payload", "coulomb", "viscous", "armature"), model=known, frame="panda_hand", smoothing=FRICTION.smoothing
)
print(found, end="\n\n")

# the same law, before and after, along a figure that was not seen
size = 0.3 * np.ones(7)  # [rad]
figure = Sinusoid(size, [0.2, 0.25, 0.3, 0.35, 0.4, 0.3, 0.5], offset=start + size)  # [Hz], [rad]
assert (2.0 * np.pi * figure.frequency * size < usual_speed(known)).all()
errors = {}
for name, robot in (("before", known), ("after", found.robot)):
    law = TrajectoryTracking.tuned(MechanicalSystem(robot), trajectory=figure, **GAINS)
    run = simulate(true, law, q0=start, duration=4.0, dt=2e-3, progress=False)
    desired = np.array([figure.at(t).position for t in run.time])
    errors[name] = float(np.sqrt(np.mean((run.position - desired) ** 2)))
    print(f"tracking error {name}: {1e3 * errors[name]:.3f} mrad")

# another body, one kilogramme: found out while the arm moves
other = Payload(1.0, com=(0.0, 0.0, 0.05), frame="panda_hand")
hands = load_robot("panda", locked_joints=FINGERS, armature=ROTORS)
model, arm = (MechanicalSystem(robot, friction=FRICTION) for robot in (hands, hands.with_payload(other)))
adaptive = AdaptivePayload.tuned(model, frame="panda_hand", reference=figure, actual=arm)
certificate = certify(adaptive, arm, samples=8)
print(f"\n{certificate.controller} on {certificate.robot}: {certificate.verdict}")
run = simulate(arm, adaptive, q0=start, duration=10.0, dt=2e-3, progress=False)
mass, first = adaptive.estimate(run.controller_state[-1])
hand = [
    np.linalg.norm(
        arm.robot.placement("panda_hand", q).translation
        - arm.robot.placement("panda_hand", figure.at(t).position).translation
    )
    for t, q in zip(run.time[-500::25], run.position[-500::25], strict=True)
]
print(f"estimate {mass:.3f} kg at {np.round(first / mass, 3)} m; the hand errs by {1e3 * max(hand):.2f} mm")
