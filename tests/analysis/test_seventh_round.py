"""What a seventh round of laws, as researchers write them by mistake, found in the certificate: what others trust."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    NOTHING,
    Controller,
    EnergyShaping,
    Gain,
    PassivePort,
    Shaping,
    Target,
    Vector,
    certify,
)
from tests.conftest import make_system

# --- a momentum that is not p̄ + θ -------------------------------------------------------------------------------


class ShapedInertia(Controller):
    """M_d q̈ = −K q̃ − C q̇ + f_e with a constant M_d, and p̂ = Lᵀq̇: the torque moves p̂ by LᵀM⁻¹, not by T⁻¹."""

    name = "shaped_inertia"
    needs = ("external_force",)
    goal: Vector = Vector("q_d", "rad", tuned=lambda tuning: tuning.goal)
    stiffness: Gain = Gain("K_p", "N·m/rad", tuned=lambda tuning: tuning.stiffness)
    damping: Gain = Gain("C", "N·m·s/rad", tuned=lambda tuning: tuning.damping)

    def prepare(self):
        super().prepare()
        self.inertia = 0.5 * self.system.at(self.goal).mass_matrix
        self.root = np.linalg.cholesky(self.inertia)

    def storage(self, t, x, state, measured=NOTHING):
        error = x.position_error(self.goal)
        return 0.5 * float(x.velocity @ self.inertia @ x.velocity + error @ self.stiffness @ error)

    def target(self, t, x, state, measured=NOTHING):
        error, momentum, inverse = x.position_error(self.goal), self.root.T @ x.velocity, np.linalg.inv(self.root)
        return Target.of(
            {"error": (error, self.stiffness @ error), "momentum": (momentum, momentum)},
            {("error", "momentum"): inverse.T},
            {("momentum", "momentum"): inverse @ self.damping @ inverse.T},
            {"momentum": inverse},
        )

    def shape(self, t, x, state, measured):
        force = measured.external_force - self.stiffness @ x.position_error(self.goal) - self.damping @ x.velocity
        desired = x.mass_matrix @ np.linalg.solve(self.inertia, force)
        return Shaping(
            desired + x.coriolis_matrix @ x.velocity + x.friction_torque, cancelled_force=measured.external_force
        )


class StatesItsPort(ShapedInertia):
    """The same, with ŷ = M⁻¹M_d q̇ stated."""

    name = "states_its_port"

    def passive_port(self, t, x, state, measured=NOTHING):
        force = self.damping @ x.velocity
        output = np.linalg.solve(x.mass_matrix, self.inertia @ x.velocity)
        return PassivePort(output, float(x.velocity @ force), force)


def test_a_derived_passive_port_of_another_momentum_fails():
    certificate = certify(ShapedInertia.tuned(make_system("pera_shoulder")))
    assert [check.name for check in certificate.checks if not check.passed] == ["passive port that is another"]


def test_the_true_passive_port_of_another_momentum_passes():
    certificate = certify(StatesItsPort.tuned(make_system("pera_shoulder")))
    assert certificate.passed, str(certificate)


@pytest.mark.parametrize("entry", ["output", "dissipated_power", "resistance"])
def test_each_part_of_the_passive_port_is_looked_at(entry):
    class ALittleMore(StatesItsPort):
        def passive_port(self, t, x, state, measured=NOTHING):
            port = super().passive_port(t, x, state, measured)
            return port._replace(**{entry: 1.00001 * getattr(port, entry)})

    certificate = certify(ALittleMore.tuned(make_system("pera_shoulder")), samples=15)
    assert certificate["matching residual"].passed
    assert not certificate["passive port that is another"].passed, str(certificate)


# --- what a law says of its damping ----------------------------------------------------------------------------


class SaysMoreInjected(EnergyShaping):
    """Damps as its target says, and says a hundredth more where a bound of the gain asks."""

    @property
    def injected_damping(self):
        return 1.01 * self.damping


class SaysMoreOfJoints(EnergyShaping):
    """The same where a tank asks, and the target does not."""

    def joint_damping(self, t, x):
        return 1.01 * self.damping

    def damping_force(self, t, x, velocity):
        return self.damping @ velocity

    def target(self, t, x, state, measured=NOTHING):
        error = x.position_error(self.goal)
        return Target.mechanical(
            x, self.interconnection, error=error, gradient=self.stiffness @ error, damping=self.damping
        )

    def shape(self, t, x, state, measured):
        return Shaping(-self.stiffness @ x.position_error(self.goal) - self.damping @ x.velocity)

    passive_port = Controller.passive_port


@pytest.mark.parametrize("law", [SaysMoreInjected, SaysMoreOfJoints])
def test_damping_that_a_law_says_it_injects_is_dissipated(law):
    certificate = certify(law.tuned(make_system("panda")), samples=15)
    assert certificate["matching residual"].passed
    assert [check.name for check in certificate.checks if not check.passed] == ["damping that is not dissipated"]
