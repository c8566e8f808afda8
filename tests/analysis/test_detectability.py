"""The largest invariant set without loss, against counts made by hand and simulations."""

from __future__ import annotations

import numpy as np
import pytest

from phcontrol import (
    Controller,
    FrameSpring,
    Gain,
    InvalidArgumentError,
    MechanicalSystem,
    PHControlError,
    Pose,
    Target,
    Vector,
    make_controller,
)
from phcontrol.analysis.detectability import invariant_set
from tests.conftest import make_system


@pytest.mark.parametrize(
    "law", ["energy_shaping", "force_feedback", "force_feedback_measured", "integral_action", "impedance_grasping"]
)
def test_the_rest_is_all_for_the_laws_of_the_thesis(law):
    system = make_system("pera_shoulder")
    found = invariant_set(make_controller(law, system), system)
    assert (found.dimension, found.marginal) == (0, 0)
    assert found.detectable
    assert found.only_rest


def test_integral_action_and_grasping_are_seen_from_their_outputs():
    """ŷ = 0 holds ξ at f_e (Theorem 3.2.5); grasping leaves nothing where ŷ = 0 (Theorem 4.2.3)."""
    system = make_system("pera_shoulder")
    grasping = invariant_set(make_controller("impedance_grasping", system), system)
    assert grasping.detectable
    integral = invariant_set(make_controller("integral_action", system), system)
    assert integral.detectable
    # by hand, for grasping along p̂ = 0 ≡ ŷ: 0 = −T⁻¹K_p e + Ḡ(K_rl q_rl − K_p e), so that 2K_p e = K_rl q_rl (G = 1)
    # leaves q̄̇ = −K_p e and q̇_rl = −K_rl q_rl + K_p e, of which that line must be invariant: only for special gains
    assert grasping.hidden == 0


class OneSided(Controller):
    """Energy shaping that dampens the first joint alone."""

    name = "one_sided"
    goal: Vector = Vector("q_d", "rad")
    stiffness: Gain = Gain("K_p", "N·m/rad")

    @property
    def lacks_minimum(self):
        return "damping in the second joint"

    def storage(self, t, x, state, measured=None):
        error = x.position_error(self.goal)
        return x.kinetic_energy + 0.5 * error @ self.stiffness @ error

    def target(self, t, x, state, measured=None):
        error = x.position_error(self.goal)
        return Target.mechanical(
            x, self.interconnection, error=error, gradient=self.stiffness @ error, damping=np.diag([5.0, 0.0])
        )


def test_a_joint_without_damping_goes_on_swinging():
    """Without friction, at q₁ = 0, the shoulder's second joint swings alone: two dimensions, ±i√(K/b)."""
    system = MechanicalSystem(make_system("pera_shoulder").robot, friction=None)
    law = OneSided(system, goal=[0.0, 0.0], stiffness=20.0)
    found = invariant_set(law, system)
    assert (found.dimension, found.marginal) == (2, 2)
    assert not found.only_rest
    assert found.detectable  # ŷ = q̇ would see it; what is lost does not
    assert found.least_loss < 1e-9  # and not to first order alone
    np.testing.assert_allclose(found.directions[[0, 2]], 0.0, atol=1e-6)  # q₁ and q̇₁ are not in it
    coupled = OneSided(system, goal=[0.0, 0.0], stiffness=[[20.0, 5.0], [5.0, 20.0]])
    assert invariant_set(coupled, system).only_rest  # through the spring the first joint's damper sees it


def test_a_redundant_arm_on_a_spring_of_its_hand_is_free_to_move():
    """Seven joints, six coordinates of the hand: one direction in which it may stay anywhere, an eigenvalue 0."""
    system = make_system("panda")
    frame = "panda_hand"
    pose = system.at(system.robot.home).placement(frame)
    spring = FrameSpring(
        frame, Pose(pose.translation, pose.rotation), translational_stiffness=300.0, rotational_stiffness=20.0
    )
    found = invariant_set(make_controller("energy_shaping", system, potential=spring), system, samples=2)
    assert (found.dimension, found.marginal, found.hidden) == (1, 1, 1)
    assert not found.detectable  # it rests there: ŷ = 0, and does not come back
    jacobian = system.at(system.robot.home).frame_jacobian(frame, "local")
    assert np.abs(jacobian @ found.directions[:7, 0]).max() < 1e-5  # the self-motion
    assert np.abs(found.directions[7:]).max() < 1e-5


def test_laws_without_a_rest_of_their_own_are_refused():
    system = make_system("pera_shoulder")
    with pytest.raises(InvalidArgumentError, match="rests in contact only"):
        invariant_set(make_controller("force_control", system), system)
    with pytest.raises(InvalidArgumentError, match="changes with time"):
        invariant_set(make_controller("tracking", system), system)
    other = MechanicalSystem(system.robot, gravity=[0.0, 0.0, -9.0])
    with pytest.raises(PHControlError, match="rests on the promise"):
        invariant_set(make_controller("energy_shaping", system), other)
