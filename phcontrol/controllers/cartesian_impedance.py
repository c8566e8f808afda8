"""Cartesian impedance: the hand on a spring and a damper (docs/cartesian-impedance.md)."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from phcontrol._lazy import lazy
from phcontrol._validation import Array, finite_array, vector
from phcontrol.controllers.cartesian_law import CartesianLaw
from phcontrol.controllers.parameters import Parameter
from phcontrol.controllers.shaped_law import out_of_reach
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.pose import Pose, check_pose
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.potentials.frame_potential import Deviation
from phcontrol.trajectories.frame_path import FramePath

_AT_GOAL = 1e-6  # how near counts as there [m, rad]
_STARTS = 8  # postures from which a goal that is not found is looked for again


def _goal(name: str, value: Any, system: MechanicalSystem) -> Pose:
    if not isinstance(value, (Pose, pin.SE3)):
        array = finite_array(name, value)
        if array.shape == (3,):
            return Pose(array, np.full((3, 3), np.nan))  # a point: no orientation is asked for
        value = array
    return check_pose(name, value)


class CartesianImpedance(CartesianLaw):
    """Hold the hand at a pose, as compliant as is desired: spring and damper between frame and goal.

        u = G⁻¹(∂V/∂q − 𝒥ᵀF − Δq̇),   F = (K_t e, R vee(G R_e − R_eᵀG)) − F_d
        e = r − r_d,  R_e = R_dᵀR,  G = ½tr(K_r)1 − K_r,   Δ = 𝒥ᵀD_x𝒥 + d_n(M − 𝒥ᵀΛ𝒥)

    The closed loop on (e, R_e, p̄), with H_d = ½|p̄|² + ½eᵀK_t e + tr(G(1 − R_e)) − F_dᵀe, and f_e entering as [0; T⁻¹],

        [[0, A T⁻ᵀ], [−T⁻¹Aᵀ, J̄₂ − D̄ − T⁻¹ΔT⁻ᵀ]] ∇H_d,    (ė, Ṙ_e) = A q̇.

    A push F_e on the hand moves it by K⁻¹F_e, with the damping ratio ζ in every direction, and with nothing that
    measures it. The arm's inertia stays what it is. See :class:`CartesianLaw` for D_x, Λ, posture and tank.

    A goal out of reach is no error: a warning says by how much, and the hand goes as near as the spring allows.

    Args:
        system: the model of the arm.
        goal: (r_d, R_d), the pose of the hand in the world: ``Pose``, pin.SE3 or (4, 4) matrix; without a rotational
            stiffness a point of three coordinates does [m].
        reference: a ``FramePath`` of the frame in place of the goal.

    Further arguments are those of :class:`CartesianLaw` and :class:`TankedLaw`.

    Example:
        >>> from phcontrol import CartesianImpedance, MechanicalSystem, load_robot
        >>> system = MechanicalSystem(load_robot("panda", locked_joints=["panda_finger_joint1", "panda_finger_joint2"]))
        >>> law = CartesianImpedance.tuned(
        ...     system,
        ...     translational_stiffness=[600.0, 600.0, 200.0],  # [N/m]
        ...     rotational_stiffness=30.0,  # [N·m/rad]
        ...     posture="tank",
        ... )
        >>> law.states
        ('tank',)
    """

    name = "cartesian_impedance"
    run = "cartesian_impedance"

    goal: Parameter[Any, Pose | None] = Parameter("r_d, R_d", "m", default=None, check=_goal)

    def prepare(self) -> None:
        """Check the goal, and say so when it is out of reach."""
        if (self.goal is None) == (self.reference is None):
            raise InvalidArgumentError("goal", "must be given, or a reference in its place")
        if self.goal is not None and np.isnan(self.goal.rotation).any():
            if self.rotational_stiffness is not None:
                raise InvalidArgumentError("goal", "must be a pose for a rotational_stiffness, but is a point")
            self.goal = Pose(self.goal.translation, np.eye(3))
        super().prepare()
        if self.goal is not None and sum(self._nearest[0]) > _AT_GOAL:
            warnings.warn(out_of_reach(self.frame, self._nearest[0]), stacklevel=4)

    def pose_at(self, t: float) -> Pose:
        """Return the goal, or the pose on the path at time t [s]."""
        return super().pose_at(t) if self.goal is None else self.goal

    @property
    def out_of_reach(self) -> Deviation:
        """How far from its goal the hand must stay; next to nothing where it can get there."""
        return Deviation(0.0, 0.0) if self.goal is None else self._nearest[0]

    @property
    def pull_off(self) -> Deviation:
        """How far from its goal the hand rests, pulled by a posture spring and pushed by the wrench."""
        return Deviation(0.0, 0.0) if self.goal is None else self._deviation(self.rest_posture(0.0))

    @property
    def start_posture(self) -> Array:
        """The posture that brings the hand nearest to its goal, of those that are found [rad]."""
        return super().start_posture if self.goal is None else self._nearest[1]

    @lazy
    def _nearest(self) -> tuple[Deviation, Array]:
        """How near the hand gets, and in which posture: from the preferred one on, and if that fails from others."""
        robot, generator = self.system.robot, np.random.default_rng(0)
        spring, found = self.spring(None), (Deviation(np.inf, np.inf), robot.home)
        for attempt in range(1 + _STARTS):
            start = super().start_posture if attempt == 0 else robot.random_position(generator)
            posture = spring.minimum_near(self.system, start)
            found = min(found, (self._deviation(posture), posture), key=lambda pair: sum(pair[0]))
            if sum(found[0]) <= _AT_GOAL:
                break
        return found

    def _deviation(self, posture: Array) -> Deviation:
        return self.hand_spring.deviation(self.system.at(posture), self.pose_at(0.0))

    @property
    def caveat(self) -> str:
        """Say how far the hand rests from its goal where a posture spring pulls at it, or it cannot get there."""
        if self.goal is None or self.posture != "spring":
            return super().caveat
        off = f"the posture spring pulls the hand {self.pull_off.distance:.2g} m and {self.pull_off.angle:.2g} rad off"
        return "; ".join(filter(None, (super().caveat, f"{off} its goal")))

    @classmethod
    def check_goal(cls, system: MechanicalSystem, goal: ArrayLike | None) -> Any:
        """Return a pose, a point, or a posture that tells a pose [rad]; by default one near the arm's home.

        Raises InvalidArgumentError for three numbers with an arm of three joints: they might be either.
        """
        if goal is None:
            return system.robot.near_home()
        if isinstance(goal, (Pose, pin.SE3)) or finite_array("goal", goal).shape != (system.n,):
            return _goal("goal", goal, system)
        if system.n == 3:
            message = (
                f"may be a point or a posture, with the 3 joints of {system.robot.name}: give Pose(point, np.eye(3)), "
                "or system.at(posture).placement(frame)"
            )
            raise InvalidArgumentError("goal", message)
        return vector("goal", goal, system.n)

    @classmethod
    def default_gains(
        cls, system: MechanicalSystem, goal: Any, *, given: Mapping[str, Any] = MappingProxyType({}), **desired: Any
    ) -> dict[str, Any]:
        """Return gains of the base, and the pose of the hand at the goal."""
        made = super().default_gains(system, goal, given=given, **desired)
        reference = given.get("reference")
        is_point = isinstance(goal, Pose) and bool(np.isnan(goal.rotation).any())
        if is_point or (isinstance(reference, FramePath) and reference.at(0.0).rotation is None):
            made.pop("rotational_stiffness", None)  # nothing asks for an orientation
        if "goal" in given or reference is not None:
            return made
        if isinstance(goal, Pose):
            return made | {"goal": goal.translation if is_point else goal}
        placement = system.at(goal).placement(given.get("frame") or system.hand_frame)
        return made | {"goal": Pose(np.array(placement.translation), np.array(placement.rotation))}
