"""A law of your own, certified: a spring that never pulls with more than a given torque, however far the goal is.

Its energy is sum k w² log cosh(e/w), e the error: a spring of stiffness k near the goal, the torque k w far from it.
"""

import numpy as np

from phcontrol import Controller, MechanicalSystem, Shaping, Target, certify, load_robot, simulate


class BoundedSpring(Controller):
    """u = ∂V/∂q − k w tanh(q̃/w) − c q̇, with H_d = ½|p̄|² + Σ k w² log cosh(q̃/w)."""

    name = "bounded_spring"

    def __init__(self, system, *, goal, stiffness, width, damping, interconnection="coriolis"):
        super().__init__(system, interconnection)
        self.goal, self.k, self.w, self.c = system.robot.position(goal), stiffness, width, damping

    @classmethod
    def default_gains(cls, system, goal):
        return {"goal": goal, "stiffness": 50.0, "width": 0.2, "damping": 15.0}

    def pull(self, x):
        return self.k * self.w * np.tanh(x.position_error(self.goal) / self.w)

    def shape(self, t, x, state, measured):
        return Shaping(effort=-self.pull(x) - self.c * x.velocity)

    def storage(self, t, x, state, measured=None):
        return x.kinetic_energy + self.k * self.w**2 * np.log(np.cosh(x.position_error(self.goal) / self.w)).sum()

    def coordinates(self, t, x, state, measured=None):
        return np.concatenate([x.position_error(self.goal), x.transformed_momentum])

    def target(self, t, x, state, measured=None):
        zero, inverse = np.zeros((self.system.n, self.system.n)), np.linalg.inv(x.factor)
        damping = inverse @ (np.diag(x.damping) + self.c * np.eye(self.system.n)) @ inverse.T
        return Target(
            coordinates=self.coordinates(t, x, state),
            interconnection=np.block([[zero, inverse.T], [-inverse, x.interconnection(self.interconnection)]]),
            dissipation=np.block([[zero, zero], [zero, damping]]),
            gradient=np.concatenate([self.pull(x), x.transformed_momentum]),
            port=np.vstack([zero, inverse]),
        )


system = MechanicalSystem(load_robot("pera"))
goal = [-0.3, 1.0, -0.3, -0.9, 0.3, -1.2, 0.2]  # [rad]
controller = BoundedSpring(system, goal=goal, stiffness=50.0, width=0.2, damping=15.0)  # [N·m/rad], [rad], [N·m·s/rad]
certificate = certify(controller, system)
print(certificate)

log = simulate(system, controller, duration=10.0, dt=2e-3)
print("error at the end [rad]:", abs(log.position[-1] - goal).max())
print("H_d never grew:", (np.diff(log.storage) <= 1e-9).all())
