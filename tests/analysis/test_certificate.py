"""Certificates of every registered law, and laws broken on purpose that must not get one."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    EnergyShaping,
    Flag,
    ForceFeedback,
    InvalidArgumentError,
    MechanicalSystem,
    NonNegative,
    Positive,
    PositiveVector,
    StribeckFriction,
    certify,
    load_robot,
    make_controller,
)
from phcontrol.analysis.certificate import MATCHING_TOLERANCE
from phcontrol.controllers.registry import CONTROLLERS, laws_for
from tests.conftest import ARMS, make_system

FORMS = [(law, form) for law, entry in CONTROLLERS.items() for form in entry.law.forms]
CASES = [(law, arm, form) for arm in ARMS for law in laws_for(make_system(arm)) for form in CONTROLLERS[law].law.forms]


@pytest.mark.parametrize(("law", "arm", "form"), CASES)
def test_every_law_is_what_it_claims_on_every_arm(law, arm, form):
    certificate = certify(make_controller(law, make_system(arm), interconnection=form), samples=20)
    assert certificate.passed, str(certificate)


@pytest.mark.parametrize(("law", "form"), FORMS)
def test_every_law_is_what_it_claims_with_gears_and_coupled_gains(law, form):
    """G not the identity, and full matrices as gains: nothing diagonal to hide behind."""
    rng = np.random.default_rng(3)
    arm = "pera_shoulder_elbow" if CONTROLLERS[law].minimum_joints <= 3 else "ur5"
    robot = load_robot(arm)
    gears = np.eye(robot.n) + 0.3 * rng.normal(size=(robot.n, robot.n))
    system = MechanicalSystem(robot, input_matrix=gears)
    controller = make_controller(law, system, interconnection=form, **coupled_gains(law, rng, make_system(arm)))
    certificate = certify(controller, samples=20)
    assert certificate.passed, str(certificate)


NO_GAINS = ("goal", "trajectory", "posture_gain", "path", "preferred_posture", "frame")
SCALARS = (Flag, NonNegative, Positive, PositiveVector)  # what is no matrix


def coupled_gains(law, rng, system):
    known = CONTROLLERS[law].law.default_gains(system, np.ones(system.n), given=CONTROLLERS[law].options)
    gains, parameters = {}, CONTROLLERS[law].law.parameters
    for name in known:
        n = {"adaptation": 10}.get(name, 3 if name.endswith("ional_stiffness") else system.n)
        root = rng.normal(size=(n, n))
        if name == "coupling":
            gains[name] = root + 3.0 * np.eye(n)
        elif name == "force":
            gains[name] = root[0]
        elif name not in NO_GAINS and not isinstance(parameters[name], SCALARS):
            gains[name] = root @ root.T + np.eye(n)
    if "rate" in gains:  # KΛ + ΛᵀK must be positive definite
        gains["rate"] = gains["rate"] @ gains["stiffness"]
    return gains


class WrongSign(EnergyShaping):
    """The spring pushes instead of pulling."""

    def shape(self, t, x, state, measured):
        law = super().shape(t, x, state, measured)
        return law._replace(effort=law.effort + 2.0 * self.stiffness @ x.position_error(self.goal))


class NoGravity(EnergyShaping):
    """Gravity is forgotten."""

    def shape(self, t, x, state, measured):
        law = super().shape(t, x, state, measured)
        return law._replace(effort=law.effort - x.gravity)


class LiteralAz(ForceFeedback):
    """(3.4) and (3.16) as printed: A z in place of A ż (errata E8)."""

    def shape(self, t, x, state, measured):
        law = super().shape(t, x, state, measured)
        return law._replace(offset_rate=-self.coupling @ state)


class MissingFactorRate(ForceFeedback):
    """f̄ = T⁻¹f without Ṫᵀq̇, as Remark 3.1.1 has it (errata E7)."""

    def shape(self, t, x, state, measured):
        law = super().shape(t, x, state, measured)
        state_rate = law.state_rate - self._port.T @ (x.factor_rate.T @ x.velocity)
        return law._replace(state_rate=state_rate, offset_rate=-self.coupling @ state_rate)


class UnshapedForces(ForceFeedback):
    """ż driven by gravity and not by the virtual spring, as (3.2) has it (errata E10)."""

    def shape(self, t, x, state, measured):
        law = super().shape(t, x, state, measured)
        spring = -self.stiffness @ x.position_error(self.goal)
        state_rate = law.state_rate + self._port.T @ x.solve_factor(-x.potential_gradient - spring)
        return law._replace(state_rate=state_rate, offset_rate=-self.coupling @ state_rate)


class MinusDampingOffTheDiagonal(ForceFeedback):
    """(3.15) as printed: −D̄Y in the dissipation matrix (errata E11)."""

    def target(self, t, x, state, measured=None):
        target = super().target(t, x, state, measured)
        R, n = target.dissipation.copy(), x.system.n
        R[n : 2 * n, 2 * n :] *= -1.0
        R[2 * n :, n : 2 * n] *= -1.0
        return type(target)(target.coordinates, target.interconnection, R, target.gradient, target.port)


class WrongStorage(EnergyShaping):
    """A storage function that is not what the target's gradient belongs to."""

    def storage(self, t, x, state, measured=None):
        return 2.0 * super().storage(t, x, state, measured)


class NegativeDamping(EnergyShaping):
    """Energy is injected, and the target says so: matching holds, R_d ⪰ 0 does not."""

    def prepare(self):
        self.damping = -self.damping
        super().prepare()


POSITION = {"goal": 0.3 * np.ones(7), "stiffness": 15.0, "damping": 10.0}
FEEDBACK = POSITION | {"coupling": 0.5, "force_gain": 2.0}
BROKEN = {
    WrongSign: (POSITION, "matching"),
    NoGravity: (POSITION, "matching"),
    LiteralAz: (FEEDBACK, "matching"),
    MissingFactorRate: (FEEDBACK, "matching"),
    UnshapedForces: (FEEDBACK, "matching"),
    MinusDampingOffTheDiagonal: (FEEDBACK, "matching"),
    WrongStorage: (POSITION, "matching"),
    NegativeDamping: (POSITION, "structure"),
}


@pytest.mark.parametrize("law", list(BROKEN), ids=lambda law: law.__name__)
def test_broken_laws_are_caught(pera, law):
    gains, part = BROKEN[law]
    frictionless = MechanicalSystem(pera.robot, friction=StribeckFriction(viscous=0.5))
    certificate = certify(law(frictionless, **gains), samples=10)
    assert not certificate.passed
    assert not getattr(certificate, f"{part}_passed"), str(certificate)
    assert "FAILED" in str(certificate)


def test_energy_injection_shows_in_the_storage_rate(pera):
    certificate = certify(NegativeDamping(MechanicalSystem(pera.robot, friction=None), **POSITION), samples=10)
    assert certificate.matching_passed
    assert not certificate.storage_passed


def test_a_skewness_error_is_caught(shoulder):
    class NotSkew(EnergyShaping):
        def target(self, t, x, state, measured=None):
            target = super().target(t, x, state, measured)
            shift = 1e-6 * np.eye(4)
            return type(target)(
                target.coordinates, target.interconnection + shift, target.dissipation + shift, target.gradient,
                target.port,
            )  # fmt: skip

    certificate = certify(NotSkew(shoulder, goal=[0, 0], stiffness=1.0, damping=1.0), samples=5)
    assert certificate.matching_passed  # J − R is the same
    assert not certificate.structure_passed


def test_a_wrong_model_loses_the_certificate(pera):
    """The law computed on a model whose hand is 0.1 kg m² lighter than the plant's: not certified there."""
    heavier = MechanicalSystem(load_robot("pera", armature=0.1))
    controller = make_controller("force_feedback", pera)
    assert certify(controller, pera, samples=5).passed
    assert certify(controller, heavier, samples=5).matching_residual > 1e3 * MATCHING_TOLERANCE


def test_same_seed_same_certificate(shoulder):
    controller = make_controller("energy_shaping", shoulder)
    assert certify(controller, samples=3, seed=4) == certify(controller, samples=3, seed=4)
    assert certify(controller, samples=3, seed=4) != certify(controller, samples=3, seed=5)


def test_bad_sample_counts_are_refused(shoulder):
    with pytest.raises(InvalidArgumentError, match="samples: must be an integer >= 1, but is 0"):
        certify(make_controller("energy_shaping", shoulder), samples=0)
