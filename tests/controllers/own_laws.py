"""Laws as a researcher writes them by the public documentation alone: right ones, and wrong ones."""

from __future__ import annotations

import numpy as np

from phcontrol import Controller, Gain, Positive, Shaping, Target, Vector


class Spring(Controller):
    """A spring and a damper."""

    name = "own_spring"
    goal: Vector = Vector("q_d", "rad", tuned=lambda tuning: tuning.goal)
    stiffness: Gain = Gain("K_p", "N·m/rad", tuned=lambda tuning: tuning.stiffness)
    damping: Gain = Gain("C", "N·m·s/rad", tuned=lambda tuning: tuning.damping)

    def error(self, t, x):
        return x.position_error(self.goal)

    def storage(self, t, x, state, measured=None):
        error = self.error(t, x)
        return x.kinetic_energy + 0.5 * error @ self.stiffness @ error

    def made(self, t, x, **changed):
        """Return the right target, but for what is changed."""
        error = self.error(t, x)
        given = {"error": error, "gradient": self.stiffness @ error, "damping": self.damping} | changed
        return Target.mechanical(x, self.interconnection, **given)

    def target(self, t, x, state, measured=None):
        return self.made(t, x)


class WithShape(Spring):
    def shape(self, t, x, state, measured):
        return Shaping(effort=-self.stiffness @ self.error(t, x) - self.damping @ x.velocity)


class Hardening(Spring):
    """Ψ = ½eᵀK e + ¼ Σ e⁴."""

    def storage(self, t, x, state, measured=None):
        return super().storage(t, x, state) + 0.25 * (self.error(t, x) ** 4).sum()

    def target(self, t, x, state, measured=None):
        error = self.error(t, x)
        return self.made(t, x, gradient=self.stiffness @ error + error**3)


class WithoutGyroscopicForces(Spring):
    """J̄₂ left out: another closed loop, and port-Hamiltonian too."""

    def target(self, t, x, state, measured=None):
        momentum, error = x.transformed_momentum, self.error(t, x)
        return Target.of(
            {"error": (error, self.stiffness @ error), "momentum": (momentum, momentum)},
            {("error", "momentum"): x.inverse_factor.T},
            {("momentum", "momentum"): x.transformed_damping + x.transformed_injection(self.damping)},
            {"momentum": x.inverse_factor},
        )


class Led(Spring):
    """A goal that moves by a sine, on the error state (docs/theory.md)."""

    forms = ("coriolis",)

    def led(self, t):
        return self.goal + 0.1 * np.sin(t), np.full(self.system.n, 0.1 * np.cos(t))

    @property
    def time_span(self):
        return 2.0 * np.pi

    def target_posture(self, t):
        return self.led(t)[0]

    def storage(self, t, x, state, measured=None):
        goal, velocity = self.led(t)
        error, momentum = x.position_error(goal), x.factor.T @ (x.velocity - velocity)
        return 0.5 * momentum @ momentum + 0.5 * error @ self.stiffness @ error

    def target(self, t, x, state, measured=None):
        goal, velocity = self.led(t)
        error = x.position_error(goal)
        return self.made(t, x, error=error, gradient=self.stiffness @ error,
                         momentum=x.factor.T @ (x.velocity - velocity))  # fmt: skip


class Adapted(Spring):
    """p̂ = p̄ − k z, where z integrates what drives the momentum."""

    name = "own_adapted"
    gain: Positive = Positive("k", default=0.5)

    @property
    def states(self):
        return ("pull",)

    def storage(self, t, x, state, measured=None):
        error, momentum = self.error(t, x), x.transformed_momentum - self.gain * state
        return 0.5 * momentum @ momentum + 0.5 * error @ self.stiffness @ error + 0.5 * state @ state

    def target(self, t, x, state, measured=None):
        error, momentum = self.error(t, x), x.transformed_momentum - self.gain * state
        J, D, k = x.interconnection(self.interconnection), x.transformed_damping, self.gain * np.eye(x.system.n)
        return Target.of(
            {"error": (error, self.stiffness @ error), "momentum": (momentum, momentum), "pull": (state, state)},
            {
                ("error", "momentum"): x.inverse_factor.T, ("error", "pull"): x.inverse_factor.T @ k,
                ("momentum", "momentum"): J, ("momentum", "pull"): J @ k, ("pull", "pull"): k @ J @ k,
            },
            {
                ("momentum", "momentum"): D + x.transformed_injection(self.damping),
                ("momentum", "pull"): D @ k, ("pull", "pull"): k @ D @ k,
            },
            {"momentum": x.inverse_factor},
        )  # fmt: skip


RIGHT = [Spring, WithShape, Hardening, WithoutGyroscopicForces, Led, Adapted]


# --- wrong, each with the line that says so ---------------------------------------------------------


class WrongGradient(Spring):
    def target(self, t, x, state, measured=None):
        return self.made(t, x, gradient=1.1 * self.stiffness @ self.error(t, x))


class ForgottenKineticEnergy(Spring):
    def storage(self, t, x, state, measured=None):
        return super().storage(t, x, state) - x.kinetic_energy


class ForgottenState(Adapted):
    def storage(self, t, x, state, measured=None):
        return super().storage(t, x, state) - 0.5 * state @ state


class NotSkew(Spring):
    def target(self, t, x, state, measured=None):
        momentum, error, inverse = x.transformed_momentum, self.error(t, x), x.inverse_factor
        return Target.of(
            {"error": (error, self.stiffness @ error), "momentum": (momentum, momentum)},
            {
                ("error", "momentum"): inverse.T,
                ("momentum", "error"): -1.5 * inverse,
                ("momentum", "momentum"): x.interconnection(self.interconnection),
            },
            {("momentum", "momentum"): x.transformed_damping + x.transformed_injection(self.damping)},
            {"momentum": inverse},
        )


class NegativeDamping(Spring):
    def target(self, t, x, state, measured=None):
        return self.made(t, x, damping=-10.0 * self.damping)


class WrongCoupling(Spring):
    def target(self, t, x, state, measured=None):
        return self.made(t, x, coupling=x.inverse_factor)


class ForgottenPort(Spring):
    def target(self, t, x, state, measured=None):
        right = self.made(t, x)
        return Target(right.coordinates, right.interconnection, right.dissipation, right.gradient,
                      np.zeros_like(right.port), parts=right.parts)  # fmt: skip


class VelocityInTheError(Spring):
    def error(self, t, x):
        return x.position_error(self.goal) + 0.1 * x.velocity


class NegativeStiffness(Spring):
    def storage(self, t, x, state, measured=None):
        return 2.0 * x.kinetic_energy - super().storage(t, x, state)

    def target(self, t, x, state, measured=None):
        return self.made(t, x, gradient=-self.stiffness @ self.error(t, x))


class SilentClock(Spring):
    def error(self, t, x):
        return x.position_error(self.goal + 0.1 * np.sin(t))


class Switched(Spring):
    def storage(self, t, x, state, measured=None):
        return super().storage(t, x, state) + (np.abs(self.error(t, x)).max() > 0.5)


class WrongShape(Spring):
    def shape(self, t, x, state, measured):
        return Shaping(effort=-self.stiffness @ self.error(t, x) + self.damping @ x.velocity)


FAILS = {
    WrongGradient: "gradient residual",
    ForgottenKineticEnergy: "gradient residual",
    ForgottenState: "gradient residual",
    NotSkew: "skewness of J_d",
    NegativeDamping: "indefiniteness of R_d",
    WrongCoupling: "matching residual",
    ForgottenPort: "matching residual",
    VelocityInTheError: "matching residual",
    NegativeStiffness: "smallest curvature of H_d at rest",
    SilentClock: "change with time that is not declared",
    Switched: "jump of H_d between states",
    WrongShape: "matching residual",
}


# --- refused, each with what is said of it ----------------------------------------------------------


class PlainMomentum(Spring):
    def target(self, t, x, state, measured=None):
        return self.made(t, x, momentum=x.momentum)


class ShiftByVelocity(Spring):
    def target(self, t, x, state, measured=None):
        return self.made(t, x, momentum=x.transformed_momentum + 0.1 * np.tanh(x.velocity))


class StateInNoPart(Adapted):
    def target(self, t, x, state, measured=None):
        return self.made(t, x)


class NoMomentum(Spring):
    def target(self, t, x, state, measured=None):
        momentum = x.transformed_momentum
        return Target.of({"impulse": (momentum, momentum)}, {})


class ShortGradient(Spring):
    def target(self, t, x, state, measured=None):
        return self.made(t, x, gradient=np.zeros(1))


class BlockOfAnotherShape(Spring):
    def target(self, t, x, state, measured=None):
        return self.made(t, x, coupling=x.inverse_factor[:-1])


class BlockOfNoPart(Spring):
    def target(self, t, x, state, measured=None):
        return Target.of({"momentum": (x.transformed_momentum,) * 2}, {("error", "momentum"): x.inverse_factor})


class NoTarget(Spring):
    def target(self, t, x, state, measured=None):
        self.made(t, x)


class StorageOfEachJoint(Spring):
    def storage(self, t, x, state, measured=None):
        return 0.5 * x.transformed_momentum**2


class StorageThatIsNone(Spring):
    def storage(self, t, x, state, measured=None):
        return float("nan")


class TargetThatIsNone(Spring):
    def target(self, t, x, state, measured=None):
        return self.made(t, x, gradient=np.full(x.system.n, np.nan))


class Raises(Spring):
    def target(self, t, x, state, measured=None):
        return self.made(t, x, gradient=np.ones(3) @ np.ones(4))


class UnknownFrame(Spring):
    def target(self, t, x, state, measured=None):
        return self.made(t, x, gradient=x.frame_jacobian("hnad", "local")[0])


REFUSED = {
    PlainMomentum: ("must have the momentum p̂ = p̄ \\+ θ", "target"),
    ShiftByVelocity: ("p̂ − p̄ changes with q̇", "target"),
    StateInNoPart: ("has no part 'pull', which is a state of it; it has 'error', 'momentum'", "target"),
    NoMomentum: ("has no part 'momentum', but 'impulse'", "target"),
    ShortGradient: ("part 'error' has 2 coordinates, but a gradient of 1", "target|made"),
    BlockOfAnotherShape: (r"block \('error', 'momentum'\) must have shape \(2, 2\), but has shape \(1, 2\)", "target"),
    BlockOfNoPart: (r"block \('error', 'momentum'\) names no part; there are 'momentum'", "target"),
    NoTarget: ("NoTarget.target returned None, expected a Target", "target"),
    StorageOfEachJoint: (
        r"StorageOfEachJoint.storage returned an array of shape \(2,\), expected a number \[J\]",
        "storage",
    ),
    StorageThatIsNone: (r"StorageThatIsNone.storage returned nan, expected a finite number \[J\]", "storage"),
    TargetThatIsNone: ("target returned a Target whose gradient must be finite|torque that is not finite", "target"),
    Raises: ("ValueError: matmul", "target"),
    UnknownFrame: ("unknown frame 'hnad' of pera_shoulder", "target"),
}
