"""The base of laws that shape a potential along a reference."""

from __future__ import annotations

import warnings
from abc import abstractmethod
from typing import Any, NamedTuple

import numpy as np

from phcontrol._differences import central_difference
from phcontrol._lazy import lazy
from phcontrol._validation import Array
from phcontrol.controllers.aim import Aim, LedAim
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.parameters import Parameter
from phcontrol.controllers.target import DrivenParts
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.pose import Pose
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.potentials.frame_potential import Deviation, FramePotential, skew
from phcontrol.potentials.frame_spring import FrameSpring
from phcontrol.potentials.potential import Potential
from phcontrol.sensors.measured import Measured
from phcontrol.setpoints.live_frame_path import LiveFramePath, Place
from phcontrol.trajectories.frame_path import FramePath, FrameReference, check_frame_path
from phcontrol.trajectories.resolved_motion import NOTHING, missed_share, resolved_motion
from phcontrol.trajectories.trajectory import Trajectory, check_trajectory

_IN_REACH = 1e-4  # how near counts as there [m, rad]
_MINIMA = 33  # along a path, from which postures between them are found

AnyReference = Trajectory | FramePath
"""Along what a law may lead the arm."""


def _reference(name: str, value: Any, system: MechanicalSystem) -> AnyReference:
    if isinstance(value, FramePath):
        system.frame_id(value.frame)
        return check_frame_path(name, value)
    return check_trajectory(name, value, system.n)


def pose_of(reference: FrameReference) -> Pose:
    """Return the pose; where the orientation is free, any."""
    return Pose(reference.position, np.eye(3) if reference.rotation is None else reference.rotation)


def out_of_reach(frame: str, by: Deviation) -> str:
    """Return the words for a goal that the hand cannot get to."""
    return f"the goal of '{frame}' is out of reach, by {by}: the hand goes as near as its spring lets it"


class _Led(NamedTuple):
    """What a path makes of a state: goal, q̇_ref, q̈_ref, what is missed, and v_e, as ``LedAim`` takes them."""

    goal: Pose
    velocity: Array
    acceleration: Array
    missed: Array | None
    error_velocity: Array


def _led(x: MechanicalState, path: FramePath, t: float) -> _Led:
    desired = path.at(t)
    motion = resolved_motion(x, path.frame, desired)
    missed = None if motion.missed is NOTHING[len(motion.missed)] else motion.missed
    return _Led(pose_of(desired), motion.velocity, motion.acceleration, missed, x.velocity - motion.velocity)


class _Reach:
    """Warns of goals out of reach as they are asked for: of the first, and of one that is twice as far out."""

    def __init__(self, system: MechanicalSystem, spring: FramePotential, start: Array) -> None:
        self._system, self._spring, self._start = system, spring, start
        self._found, self._warned = start, 0.0

    def check(self, place: Place) -> None:
        """Look for the goal from where the last one was found, and from the start."""
        system, spring = self._system, self._spring
        goal = Pose(place.position, np.eye(3) if place.rotation is None else place.rotation)
        found = []
        for start in (self._found, self._start):
            posture = spring.minimum_near(system, start, goal)
            found.append((spring.deviation(system.at(posture), goal), posture))
            if sum(found[-1][0]) <= _IN_REACH:
                break
        by, self._found = min(found, key=lambda each: sum(each[0]))
        off = sum(by)
        if off <= _IN_REACH:
            self._warned = 0.0
        elif off > 2.0 * self._warned:
            self._warned = off
            warnings.warn(out_of_reach(spring.frame, by), stacklevel=5)


class ShapedLaw(Controller):
    """Laws about a potential Ψ, along a reference: any of them goes with any of these.

    The goal of Ψ moves with ``reference``: a trajectory of the joints, or the path of a frame that a spring pulls at.
    Target and storage function are those of the error state (:class:`Aim`), so that they do not know the time.

    Args:
        reference: along what, by default a goal at rest.
    """

    reference: Parameter[AnyReference | None, AnyReference | None] = Parameter(default=None, check=_reference)

    def prepare(self) -> None:
        """Check that potential and reference fit the arm and each other."""
        super().prepare()
        reference = self.reference
        self._path = reference if isinstance(reference, FramePath) else None
        self._trajectory = reference if isinstance(reference, Trajectory) else None
        self.potential: Potential = self.shaped()
        """Ψ."""
        self.potential.check(self.system)
        self.potential.check_posture(self.system)
        self._found: dict[float, Array] = {}
        if self._path is not None and self._path.frame not in self.potential.follows:
            raise InvalidArgumentError(
                "reference", f"is a path of '{self._path.frame}': the potential must have a spring on that frame"
            )
        if self._trajectory is not None and "joints" not in self.potential.follows:
            raise InvalidArgumentError("reference", "moves the joints: the potential must be a spring on them")
        if self._path is not None and self._path.at(0.0).rotation is None and self._turns(self._path):
            raise InvalidArgumentError(
                "reference",
                f"leaves the orientation of '{self._path.frame}' free, and the potential turns it: give a path of "
                "poses, or leave the rotational stiffness out",
            )
        if self.reference is not None:
            self._check_that_it_is_carried_along()
        spring = self.leading_spring
        if isinstance(self._path, LiveFramePath) and spring is not None:
            self._path.heard_by(_Reach(self.system, spring, self.start_posture).check)

    @property
    def leading_spring(self) -> FramePotential | None:
        """The spring on the frame that a path leads; None for none."""
        return next(
            (term for term in self.potential.terms if isinstance(term, FrameSpring) and self._leads(term)), None
        )

    def _leads(self, spring: FrameSpring) -> bool:
        return self._path is not None and spring.frame == self._path.frame

    def _turns(self, path: FramePath) -> bool:
        """Return whether Ψ asks for an orientation of the path's goal."""
        goal, x = pose_of(path.at(0.0)), self.system.at(self.system.robot.near_home())
        turned = Pose(goal.translation, skew(np.ones(3)) @ goal.rotation)
        return not np.array_equal(self.potential.coordinates(x, goal), self.potential.coordinates(x, turned))

    def _check_that_it_is_carried_along(self) -> None:
        """Raise InvalidArgumentError unless all coordinates of Ψ change by A v_e, and so move with the reference."""
        generator, robot = np.random.default_rng(0), self.system.robot
        position, velocity = robot.random_position(generator, margin=0.25), generator.normal(size=self.system.n)
        for t in np.array([0.3, 0.6]) * self.time_span:
            aim = self.aim(t, self.system.at(position, velocity))

            def coordinates(step: float, t: float = t) -> Array:
                return self.aim(t + step, self.system.at(position + step * velocity)).error[0]

            rate, expected = central_difference(coordinates, 1e-4), aim.coordinate_map @ aim.velocity
            if aim.missed is not None:
                expected -= self.potential.twist_map(aim.x, aim.goal)[:, : len(aim.missed)] @ aim.missed
            if np.abs(rate - expected).max(initial=0.0) > 1e-5 * (1.0 + np.abs(expected).max(initial=0.0)):
                message = f"leaves a part of the potential behind: {self.potential!r} must move with it as a whole"
                raise InvalidArgumentError("reference", message)

    @abstractmethod
    def shaped(self) -> Potential:
        """Return Ψ, made of the law's arguments."""

    def aim(self, t: float, x: MechanicalState, potential: Potential | None = None) -> Aim:
        """Return what potential (Ψ, or another) and reference make of a state at time t [s]."""
        shaped = self.potential if potential is None else potential
        if self.reference is None:
            return Aim(x, shaped)
        if self._path is not None:
            known: tuple[float, _Led] | None = x.kept.get((self, "led"))
            if known is None or known[0] is not t:
                known = x.kept[self, "led"] = t, _led(x, self._path, t)
            return LedAim(x, shaped, *known[1])
        assert self._trajectory is not None
        desired = self._trajectory.at(t)
        return LedAim(x, shaped, desired.position, desired.velocity, desired.acceleration)

    def drive(self, t: float, x: MechanicalState, measured: Measured) -> DrivenParts | None:
        """Return how what drives the law enters the parts of its target, and that signal; None for nothing.

        Here the twist of a path near a singularity: its part that the joints cannot follow moves the error.
        """
        if self._path is None:
            return None
        desired = self._path.at(t)
        share = missed_share(x, self._path.frame, len(desired.twist))
        return {"error": -self.potential.twist_map(x, pose_of(desired))[:, : len(share)] @ share}, desired.twist

    @property
    def driven_by(self) -> str:
        """Along a path, what of it the joints cannot follow."""
        return "" if self._path is None else "the path's twist where the arm is near a singularity and cannot follow"

    @property
    def lacks_minimum(self) -> str:
        """What the potential has instead of a strict minimum."""
        return self.potential.lacks_minimum(self.system)

    @property
    def time_span(self) -> float:
        """The reference's duration [s]."""
        return 0.0 if self.reference is None else max(self.reference.duration, 1e-3)

    @property
    def other_rests(self) -> str:
        """An arm has its hand at one pose in more than one posture, a whole turn away at least."""
        frames = any(isinstance(term, FramePotential) for term in self.potential.terms)
        return "a frame is at its goal in more than one posture" if frames else ""

    def target_posture(self, t: float) -> Array | None:
        """Return q_d at time t [s]: the law's goal, or the potential's posture where it tells one; else None."""
        if self._trajectory is not None:
            return self._trajectory.at(t).position
        if self.reference is not None:
            return None
        goal: Any = getattr(self, "goal", None)  # of a law on a frame it is a pose
        given = isinstance(goal, np.ndarray) and goal.shape == (self.system.n,)
        return goal if given else self._posture

    @lazy
    def _posture(self) -> Array | None:
        """The posture that Ψ knows, if it is smallest there."""
        posture = self.potential.posture
        if posture is None:
            return None
        x = self.system.at(posture)
        beside = self.potential.gradient(self.system.at(posture + 0.1))
        return posture if np.abs(self.potential.gradient(x)).max() <= 1e-9 * np.abs(beside).max() else None

    @property
    def start_posture(self) -> Array:
        """From which the postures are looked for where the law rests [rad]: the arm's home."""
        return self.system.robot.home

    @property
    def _least_at_rest(self) -> Potential:
        """What is smallest where the law rests: Ψ."""
        return self.potential

    @property
    def led_along(self) -> Trajectory | None:
        """The reference, where it is a trajectory of the joints."""
        return self._trajectory

    def rest_posture(self, t: float) -> Array:
        """Return q_d, or a posture near the arm's home at which Ψ is smallest, shape (n,) [rad]."""
        posture = self.target_posture(t)
        if posture is not None:
            return posture
        if self._path is None:
            return self._minima[0]
        step = max(0, min(_MINIMA - 1, int(t / self.time_span * (_MINIMA - 1))))
        if t not in self._found:
            self._found[t] = self._least_at_rest.minimum_near(
                self.system, self._minima[step], pose_of(self._path.at(t))
            )
        return self._found[t]

    @lazy
    def _minima(self) -> list[Array]:
        """Postures at which Ψ is smallest, at times spread over the reference, each from the one before."""
        system, found = self.system, [self.start_posture]
        for share in np.linspace(0.0, 1.0, 1 if self._path is None else _MINIMA):
            goal = None if self._path is None else pose_of(self._path.at(share * self.time_span))
            found.append(self._least_at_rest.minimum_near(system, found[-1], goal))
        return found[1:]

    def reference_velocity(self, t: float, x: MechanicalState) -> Array:
        """Return q̇_ref, shape (n,) [rad/s]."""
        velocity = self.aim(t, x).reference_velocity
        return np.zeros(self.system.n) if velocity is None else velocity

    def _motion_rate(self, x: MechanicalState, velocity: Array, force: Array) -> Array:
        """Return T⁻¹f + (J̄₂ − D̄)Tᵀv, shape (n,)."""
        if velocity is x.velocity:
            return x.transformed_rate(force)
        return x.structure_rate(self.interconnection, velocity, force)
