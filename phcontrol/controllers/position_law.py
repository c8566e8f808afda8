"""The base of laws that hold a position: with a spring on the joints, or about any potential."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from phcontrol._validation import Array
from phcontrol.controllers.joint_damped_law import JointDampedLaw
from phcontrol.controllers.parameters import Gain, Parameter, Vector
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.potentials.joint_spring import JointSpring
from phcontrol.potentials.potential import Potential
from phcontrol.trajectories.frame_path import FramePath
from phcontrol.trajectories.trajectory import Trajectory


def _potential(name: str, value: Any, system: MechanicalSystem) -> Potential:
    if not isinstance(value, Potential):
        raise InvalidArgumentError(name, f"must be a Potential, but is {type(value).__name__}")
    value.check(system)
    return value


class PositionLaw(JointDampedLaw):
    """Laws whose Ψ is given as ``potential``, or for short as a spring on the joints: ``goal`` and ``stiffness``.

    Along a trajectory of the joints no goal is given: the trajectory is it.

    Args:
        goal: q_d [rad].
        stiffness: K_p, scalar, vector or matrix, positive definite [N·m/rad].
        potential: Ψ in place of these two.
    """

    goal: Vector = Vector("q_d", "rad", default=None, tuned=lambda tuning: tuning.goal)
    stiffness: Gain = Gain("K_p", "N·m/rad", default=None, tuned=lambda tuning: tuning.stiffness)
    potential: Parameter[Potential | None, Potential] = Parameter("Ψ", default=None, check=_potential)

    @classmethod
    def default_gains(
        cls, system: MechanicalSystem, goal: Array, *, given: Mapping[str, Any] = MappingProxyType({}), **desired: Any
    ) -> dict[str, Any]:
        """Return gains that suit a robot; a potential or reference that is given takes the place of goal and spring."""
        taken = dict(given)
        if "potential" in taken:
            taken |= {"goal": None, "stiffness": None}
        if "reference" in taken:
            taken["goal"] = None
            if isinstance(taken["reference"], Trajectory):
                goal = taken["reference"].at(taken["reference"].duration).position
        return super().default_gains(system, goal, given=taken, **desired)

    def prepare(self) -> None:
        """See whether Ψ is a spring on the joints: a goal that can move, a rest length, a faster formula."""
        super().prepare()
        self._spring = self.potential if isinstance(self.potential, JointSpring) else None

    def shaped(self) -> Potential:
        """Return the potential that is given, or the spring of the joints."""
        if self.potential is not None:
            if self.goal is not None or self.stiffness is not None:
                raise InvalidArgumentError("potential", "takes the place of goal and stiffness: give it or these two")
            return self.potential
        if isinstance(self.reference, FramePath):
            raise InvalidArgumentError("potential", "must be given with the path of a frame: a spring on that frame")
        if self.stiffness is None:
            raise InvalidArgumentError("stiffness", "must be given, or a potential in place of goal and stiffness")
        if self.reference is not None:
            if self.goal is not None:
                raise InvalidArgumentError("goal", "must not be given beside a reference, which is the goal")
            return JointSpring(self.reference.at(0.0).position, self.stiffness)
        if self.goal is None:
            raise InvalidArgumentError("goal", "must be given, or a reference or a potential in its place")
        return JointSpring(self.goal, self.stiffness)
