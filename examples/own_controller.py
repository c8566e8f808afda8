"""A law of your own, certified: a spring that never pulls with more than a given torque, however far the goal is.

Its energy is sum k w² log cosh(e/w), e the error: a spring of stiffness k near the goal, the torque k w far from it.
Energy and promise are all that it states. From the shell: phcontrol certify --controller own_controller:BoundedSpring
"""

import numpy as np

from phcontrol import (
    Controller,
    Gain,
    MechanicalSystem,
    Positive,
    PositiveVector,
    Target,
    Vector,
    certify,
    load_robot,
    simulate,
)


class BoundedSpring(Controller):
    """A spring to a posture that never pulls with more than k w.

    u = ∂V/∂q − k w tanh(q̃/w) − C q̇,   H_d = ½|p̄|² + Σ k w² log cosh(q̃/w)
    """

    name = "bounded_spring"
    goal: Vector = Vector("q_d", "rad", tuned=lambda tuning: tuning.goal)
    stiffness: PositiveVector = PositiveVector("k", "N·m/rad", tuned=lambda tuning: tuning.stiffness.diagonal())
    damping: Gain = Gain("C", "N·m·s/rad", tuned=lambda tuning: tuning.damping)
    width: Positive = Positive("w", "rad", default=0.2)

    def storage(self, t, x, state, measured=None):
        far = np.abs(x.position_error(self.goal)) / self.width
        log_cosh = far + np.log1p(np.exp(-2.0 * far)) - np.log(2.0)  # as it stands it overflows far away
        return x.kinetic_energy + self.width**2 * self.stiffness @ log_cosh

    def target(self, t, x, state, measured=None):
        error = x.position_error(self.goal)
        pull = self.stiffness * self.width * np.tanh(error / self.width)
        return Target.mechanical(x, self.interconnection, error=error, gradient=pull, damping=self.damping)


if __name__ == "__main__":
    system = MechanicalSystem(load_robot("pera"))
    goal = [-0.3, 1.0, -0.3, -0.9, 0.3, -1.2, 0.2]  # [rad]
    controller = BoundedSpring(system, goal=goal, stiffness=50.0, damping=15.0, width=0.2)
    certificate = certify(controller, system)
    print(certificate)

    log = simulate(system, controller, duration=10.0, dt=2e-3)
    print("error at the end [rad]:", abs(log.position[-1] - goal).max())
    print("H_d never grew:", (np.diff(log.storage) <= 1e-9).all())
