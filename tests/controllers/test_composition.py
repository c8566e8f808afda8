"""Laws about any potential, along any reference: certificates of what composes, formulas written anew, a loaded run."""

from __future__ import annotations

from functools import partial
from itertools import islice

import numpy as np
import pinocchio as pin
import pytest

from phcontrol import (
    FigureOfEight,
    FrameSpring,
    InvalidArgumentError,
    Sinusoid,
    certify,
    make_controller,
    simulate,
)
from phcontrol.controllers.registry import CONTROLLERS
from phcontrol.runs.compositions import AT_REST, MOVED_BY, POTENTIALS, REFERENCES, Workplace, compositions
from tests.conftest import make_system
from tests.finite_differences import derivative, relative_error

ARMS = ("pera", "pera_shoulder_elbow", "panda", "ur5", "panda_with_fingers")
BOUND = 1e-6
FEW = 16  # with fewer a row's unit is taken from states of which hardly any moves it
QUICK = ("pera_shoulder_elbow", "ur5")


def check(composed, system, form, samples):
    """The certificate passes; along a path of a frame as driven by what the joints cannot follow of it."""
    certificate = certify(composed.make(system, form), samples=samples)
    driven = composed.reference in ("frame line", "figure of eight")
    assert certificate.verdict == ("PASSED AS DRIVEN" if driven else "PASSED"), f"{composed}\n{certificate}"
    assert certificate.matching_residual <= BOUND


def form_of(composed, k):
    """The law's forms in turn."""
    forms = [form for form in ("coriolis", "canonical") if form in CONTROLLERS[composed.law].law.forms]
    return forms[k % len(forms)]


# --- what composes ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", QUICK)
def test_some_of_what_composes_is_what_it_promises(name):
    """Each arm has another third of the compositions, in one form or the other."""
    system, start = make_system(name), QUICK.index(name)
    for k, composed in enumerate(islice(compositions(system), start, None, 3)):
        check(composed, system, form_of(composed, k), FEW)


@pytest.mark.study
@pytest.mark.parametrize("part", [0, 1])
@pytest.mark.parametrize("name", ARMS)
def test_all_that_composes_is_what_it_promises(name, part):
    """In one form or the other; both of all by ``phcontrol certify --compositions`` (docs/certificates.md)."""
    system, first = make_system(name), ARMS.index(name)
    for k, composed in enumerate(islice(compositions(system), part, None, 2)):
        check(composed, system, form_of(composed, k + first), 32)


@pytest.mark.parametrize("name", ["pera_shoulder_elbow", "ur5"])
def test_the_table_says_what_can_be_made(name):
    """A reference that would leave a part of the potential behind is refused, and no other."""
    system = make_system(name)
    place = Workplace(system)
    for potential, spring in POTENTIALS.items():
        for reference, path in REFERENCES.items():
            given = {"potential": spring(place), "reference": path(place)}
            options = {key: value for key, value in given.items() if value is not None}
            make = partial(make_controller, "energy_shaping", system, **options)
            if reference in MOVED_BY[potential]:
                make()
            else:
                with pytest.raises(InvalidArgumentError, match="potential|reference"):
                    make()


def test_every_law_of_chapters_3_and_4_composes():
    found = list(compositions(make_system("pera_shoulder_elbow")))
    laws = {composed.law for composed in found}
    of_the_joints = {name for name, entry in CONTROLLERS.items() if entry.law.run == "position"}
    assert laws == of_the_joints - {"tracking", "tracking_measured"}
    springs = {composed.law: {c.potential for c in found if c.law == composed.law} for composed in found}
    assert {law for law, of in springs.items() if of == set(POTENTIALS)} == laws - {
        "impedance_grasping",
        "adaptive_payload",
    }
    for law in laws:
        assert {c.reference for c in found if c.law == law} >= {AT_REST, "minimum jerk", "sinusoid"}
    assert len({(c.law, c.potential, c.reference) for c in found}) == len(found) == 94


# --- formulas written anew, from Pinocchio alone --------------------------------------------------------------


class Bare:
    """M, C, g, D and T, Ṫ of an arm at (q, q̇)."""

    def __init__(self, system, q, v):
        model = system.robot.model
        data = model.createData()
        self.M = np.array(pin.crba(model, data, q))
        self.M = np.triu(self.M) + np.triu(self.M, 1).T
        self.C = np.array(pin.computeCoriolisMatrix(model, data, q, v))
        self.g = np.array(pin.computeGeneralizedGravity(model, data, q))
        self.D = np.diag(system.at(q, v).damping) if system.friction is not None else np.zeros_like(self.M)
        self.T = self.factor(model, q)
        self.T_rate = derivative(lambda h: self.factor(model, q + h * v), 1e-3)

    @staticmethod
    def factor(model, q):
        M = pin.crba(model, model.createData(), q)
        return np.linalg.cholesky(np.triu(M) + np.triu(M, 1).T)

    def transformed_rate(self, velocity, force):
        """T⁻¹f + (J̄₂ − D̄)Tᵀv with J̄₂ = ṪᵀT⁻ᵀ − T⁻¹C T⁻ᵀ."""
        return self.T_rate.T @ velocity + np.linalg.solve(self.T, force - (self.C + self.D) @ velocity)


def test_energy_shaping_along_a_frame_path_is_the_formula(rng):
    """u = g + M q̈_ref + C q̇_ref + D q̇_ref − 𝒥ᵀF − C_d(q̇ − q̇_ref), with the least q̇_ref that follows the path."""
    system, frame = make_system("panda"), "panda_hand_tcp"
    home = system.robot.near_home()
    start = system.at(home).placement(frame)
    path = FigureOfEight(frame, (start.translation, start.rotation), 0.2, 0.1, 3.0, turn=0.4)
    K_t, K_r, damping = np.diag([300.0, 200.0, 400.0]), np.diag([9.0, 12.0, 15.0]), np.linspace(3.0, 9.0, 7)
    spring = FrameSpring(frame, start, translational_stiffness=K_t, rotational_stiffness=K_r)
    law = make_controller("energy_shaping", system, potential=spring, reference=path, damping=damping)
    model = system.robot.model
    data, index = model.createData(), model.getFrameId(frame)
    for t in (0.4, 1.3, 7.9):
        q, v = home + 0.2 * rng.normal(size=7), rng.normal(size=7)
        pin.computeJointJacobiansTimeVariation(model, data, q, v)
        pin.updateFramePlacements(model, data)
        J = pin.getFrameJacobian(model, data, index, pin.LOCAL_WORLD_ALIGNED)
        dJ = pin.getFrameJacobianTimeVariation(model, data, index, pin.LOCAL_WORLD_ALIGNED)
        desired, pose = path.at(t), data.oMf[index]
        square = np.linalg.inv(J @ J.T)
        inverse = J.T @ square
        inverse_rate = -inverse @ dJ @ inverse + (np.eye(7) - inverse @ J) @ dJ.T @ square
        velocity = inverse @ desired.twist
        acceleration = inverse @ desired.acceleration + inverse_rate @ desired.twist
        turn, G = desired.rotation.T @ pose.rotation, 0.5 * np.trace(K_r) * np.eye(3) - K_r
        skew = G @ turn - turn.T @ G
        moment = pose.rotation @ np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
        wrench = np.concatenate([K_t @ (pose.translation - desired.position), moment])
        arm = Bare(system, q, v)
        expected = arm.g + arm.M @ acceleration + (arm.C + arm.D) @ velocity - J.T @ wrench - damping * (v - velocity)
        torque = law.evaluate(t, system.at(q, v), np.zeros(0)).torque
        assert relative_error(torque, expected) < 1e-11


@pytest.mark.parametrize("integral", [False, True])
def test_laws_with_a_state_along_a_sinusoid_are_the_formula(integral, rng):
    """u = u_law(q̃, v_e) + M q̈_d + C q̇_d + D q̇_d, of force feedback and of integral action; and their states' rates."""
    system = make_system("pera_shoulder_elbow")
    swing = Sinusoid([0.3, 0.4, 0.2], [0.5, 0.4, 0.3], offset=system.robot.near_home())
    K, Cd, Kz = np.array([30.0, 20.0, 10.0]), np.array([5.0, 4.0, 3.0]), np.diag([2.0, 1.0, 3.0])
    A, K_i = rng.normal(size=(3, 3)) + 2.0 * np.eye(3), np.array([1.0, 2.0, 0.5])
    name, options = ("integral_action", {"integral_gain": K_i}) if integral else ("force_feedback", {})
    law = make_controller(name, system, reference=swing, stiffness=K, damping=Cd, coupling=A, force_gain=Kz, **options)
    for t in (0.2, 1.7, 33.0):
        q, v = system.robot.near_home() + 0.3 * rng.normal(size=3), rng.normal(size=3)
        z, xi = rng.normal(size=3), rng.normal(size=3)
        desired, arm = swing.at(t), Bare(system, q, v)
        error, v_e = q - desired.position, v - desired.velocity
        s = K_i * error if integral else np.zeros(3)
        z_rate = (A @ Kz).T @ arm.transformed_rate(v_e + s, -K * error)
        output = v_e + s - np.linalg.solve(arm.T.T, A @ z)
        expected = arm.g + arm.M @ desired.acceleration + (arm.C + arm.D) @ desired.velocity
        expected += arm.T @ A @ z_rate - K * error - Cd * output
        if integral:
            expected -= arm.M @ (K_i * v_e) + (arm.C + arm.D) @ s + xi
        command = law.evaluate(t, system.at(q, v), np.concatenate([z, xi]) if integral else z)
        assert relative_error(command.torque, expected) < 1e-9  # Ṫ is a difference quotient
        assert (
            relative_error(
                command.state_rate, np.concatenate([z_rate, law.integral_stiffness @ output]) if integral else z_rate
            )
            < 1e-9
        )


# --- what integral action is for ------------------------------------------------------------------------------


def test_integral_action_carries_an_unknown_load_along(shoulder):
    """(3, −3) N·m on the moving shoulder: energy shaping is K⁻¹f_e away, integral action less than a fiftieth of it."""
    swing = Sinusoid([0.4, 0.3], 0.25, offset=[0.2, 0.4])
    errors = {}
    for name, gains in (
        ("energy_shaping", {}),
        ("integral_action", {"integral_gain": 3.0, "coupling": 0.5, "force_gain": 1.0}),
    ):
        law = make_controller(name, shoulder, reference=swing, stiffness=45.0, damping=10.0, **gains)
        start, load = swing.at(0.0).position, [3.0, -3.0]
        log = simulate(shoulder, law, duration=20.0, dt=4e-3, q0=start, disturbance=load, torque_limit=None)
        away = log.position - np.stack([swing.at(t).position for t in log.time])
        errors[name] = float(np.linalg.norm(away[log.time >= 16.0], axis=1).max())  # the last period
    assert errors["energy_shaping"] == pytest.approx(np.hypot(3.0, 3.0) / 45.0, rel=0.01)
    assert errors["integral_action"] < errors["energy_shaping"] / 50.0


SEEN = {
    # of a frame's path the reference turns within 0.5 % of a chord; the certificate took it for a kink of H_d
    "a bend close to a singularity": ("energy_shaping", "free direction", "figure of eight"),
    # two singular values of the hand's Jacobian cross on a chord, where the damping had no derivative
    "weak directions change places": ("force_feedback_measured", "frame spring", "frame line"),
}


@pytest.mark.parametrize("names", SEEN.values(), ids=SEEN)
def test_what_was_taken_for_a_kink_or_was_one_is_none(names):
    system = make_system("pera_shoulder_elbow")
    composed = next(c for c in compositions(system) if (c.law, c.potential, c.reference) == names)
    check(composed, system, "coriolis", 32)
