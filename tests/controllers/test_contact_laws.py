"""Force control and grasping: potentials, certificates of the variants, and what each law promises."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    Holding,
    InvalidArgumentError,
    JointForce,
    PointForce,
    UnknownNameError,
    certify,
    make_controller,
    simulate,
)
from phcontrol.controllers.classical_impedance import ClassicalImpedance
from phcontrol.controllers.force_control import ForceControl
from phcontrol.controllers.force_regulation import ForceRegulation
from phcontrol.controllers.impedance_grasping import ImpedanceGrasping
from phcontrol.mechanics.state import INTERCONNECTIONS
from tests.conftest import make_system
from tests.finite_differences import gradient, relative_error

GAINS = {"damping": 3.0, "coupling": 0.7, "force_gain": 1.5}
GRASP = {"goal": [0.2], "stiffness": 1.0, "damping": 3.0}
UP = np.array([0.0, 0.0, 1.0])


def holding(system, **options):
    return Holding("tool", system.at(system.robot.home), UP, joint="elbow_roll", **options)


def test_gradients_of_task_potentials(pera, rng):
    potentials = [JointForce(rng.normal(size=7)), PointForce("tool", rng.normal(size=3)), holding(pera)]
    for potential in potentials:
        for _ in range(3):
            q = pera.robot.home + rng.uniform(-0.3, 0.3, size=7)
            expected = gradient(lambda y, potential=potential: np.array(potential.energy(pera.at(y))), q)
            assert relative_error(potential.gradient(pera.at(q)), expected) < 1e-7


def test_holding_is_zero_and_flat_at_its_posture(pera):
    potential, x = holding(pera), pera.at(pera.robot.home)
    assert potential.energy(x) < 1e-20
    np.testing.assert_allclose(potential.gradient(x), 0.0, atol=1e-12)


@pytest.mark.parametrize("form", INTERCONNECTIONS)
def test_force_control_in_space_with_holding_is_port_hamiltonian(pera, form):
    law = ForceControl(pera, force=10.0 * UP, frame="tool", holding=[holding(pera)], interconnection=form, **GAINS)
    assert law.caveat == ""
    certificate = certify(law, samples=20)
    assert certificate.passed, str(certificate)


@pytest.mark.parametrize("form", INTERCONNECTIONS)
def test_without_feedforward_the_certificate_says_what_drives_the_law(form):
    """The thesis's law (E23): it is what its equations say, but f_d drives w from outside."""
    system = make_system("pera_shoulder_elbow")
    law = ForceControl(system, force=[60.0, -40.0, 20.0], feedforward=False, interconnection=form, **GAINS)
    certificate = certify(law, samples=20)
    assert certificate.matching_passed
    assert certificate.structure_passed
    assert certificate.verdict == "PASSED AS DRIVEN", str(certificate)
    assert "driven by: f_d, which moves w: no storage function but for constant T (errata E23)" in str(certificate)


@pytest.mark.parametrize("form", INTERCONNECTIONS)
@pytest.mark.parametrize("law", [ImpedanceGrasping, ClassicalImpedance])
def test_regulated_laws_are_what_they_say_but_do_not_claim_passivity(law, form):
    system = make_system("pera_shoulder_elbow")
    gains = law.default_gains(system, np.zeros(3)) | {"regulation": ForceRegulation([0.5, -0.2, 0.1], rate_limit=5.0)}
    certificate = certify(law(system, interconnection=form, **gains), samples=20)
    assert certificate.matching_passed, str(certificate)
    assert certificate.structure_passed
    assert "virtual position supplies energy" in certificate.caveat


def test_force_control_is_the_formula_of_section_5(rng):
    """u = ∂V/∂q − f_d + T A ẇ − C(q̇ − T⁻ᵀA w) on the gripper, whose M is constant: T = √m."""
    system = make_system("pera_gripper")
    q, v, w, force, m = 0.27, -0.4, 0.3, 1.2, 0.5
    law = ForceControl(system, force=[3.5], damping=5.0, coupling=0.8, force_gain=2.0)
    T, A, Y = np.sqrt(m), 0.8, 1.6
    w_rate = Y * (-0.1 * v + force - 3.5) / T
    x = system.at([q], [v])
    expected = x.potential_gradient[0] - 3.5 + T * A * w_rate - 5.0 * (v - A * w / T)
    from phcontrol import Measured

    command = law.evaluate(0.0, x, np.array([w]), Measured(external_force=np.array([force])))
    assert command.torque[0] == pytest.approx(expected)
    assert command.state_rate[0] == pytest.approx(w_rate)


def test_the_approach_speed_limit_holds_in_free_motion_and_yields_to_contact():
    system = make_system("pera_gripper")
    limited = ForceControl(system, force=[3.5], approach_speed=0.2, damping=5.0, coupling=1.0, force_gain=1.0)
    free = simulate(system, limited, duration=0.4, dt=1e-3, q0=[1.0])
    assert -free.velocity.min() <= 0.2 * 1.1
    unlimited = ForceControl(system, force=[3.5], damping=5.0, coupling=1.0, force_gain=1.0)
    assert -simulate(system, unlimited, duration=0.4, dt=1e-3, q0=[1.0]).velocity.min() > 1.0
    assert "passivity across the contact" in limited.caveat


def test_the_virtual_law_goes_to_its_virtual_position_through_any_force():
    """q → q_f whatever f_e: it is cancelled (E15 and theory section 6)."""
    system = make_system("pera_gripper")
    law = ImpedanceGrasping(system, **GRASP | {"stiffness": 3.0}, rest_stiffness=3.0)
    for force in (0.0, 5.0):
        log = simulate(system, law, duration=15.0, dt=1e-2, q0=[0.3], disturbance=[force])
        np.testing.assert_allclose(log.position[-1], 0.2, atol=1e-3)


def test_classical_impedance_is_a_damped_oscillator():
    """m q̈ = −K(q − q_f) − K_d q̇ with friction and spring compensated: the analytic response."""
    system = make_system("pera_gripper")
    log = simulate(system, ClassicalImpedance(system, **GRASP), duration=3.0, dt=1e-3, q0=[0.3])
    fast, slow = np.roots([0.5, 3.0, 1.0])
    expected = 0.2 + 0.1 * (fast * np.exp(slow * log.time) - slow * np.exp(fast * log.time)) / (fast - slow)
    np.testing.assert_allclose(log.position[:, 0], expected, atol=1e-9)


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda s: ForceControl(s, force=[1.0, 2.0], **GAINS), r"force: must have shape \(1,\)"),
        (lambda s: ForceControl(s, force=[1.0], frame="tool", **GAINS), r"force: must have shape \(3,\)"),
        (lambda s: ForceControl(s, force=[1.0], approach_speed=0.0, **GAINS), "approach_speed: must be > 0"),
        (lambda s: ForceControl(s, force=[1.0], feedforward="no", **GAINS), "feedforward: must be True or False"),
        (lambda s: ImpedanceGrasping(s, **GRASP, rest_stiffness=-1.0), "rest_stiffness: must be positive definite"),
        (lambda s: ImpedanceGrasping(s, **GRASP, rest_stiffness=1.0, regulation=0.2), "regulation: must be a ForceReg"),
        (lambda s: ClassicalImpedance(s, **GRASP, regulation=ForceRegulation([1.0, 2.0])), "is for 2 joints"),
        (lambda s: ClassicalImpedance(s, **GRASP, compensate_external_force=1), "must be True or False"),
        (lambda s: ForceRegulation([0.2], gain=0.0), "gain: must be > 0"),
        (lambda s: Holding("tool", s.at([0.3]), [0, 0, 0]), "normal: must not be zero"),
    ],
)
def test_bad_arguments_are_refused(make, complaint):
    with pytest.raises(InvalidArgumentError, match=complaint):
        make(make_system("pera_gripper"))


def test_unknown_frames_are_listed(pera):
    with pytest.raises(UnknownNameError, match="unknown frame 'fingertip'.*tool"):
        ForceControl(pera, force=UP, frame="fingertip", **GAINS)


def test_laws_that_need_the_force_say_so(pera):
    for name in ("force_control", "impedance_grasping", "classical_impedance_compensated"):
        assert make_controller(name, pera).needs == ("external_force",)
