"""Joint positions that put a frame where it should be, inside the joint limits; by Pink on ProxQP."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from scipy.linalg import null_space

from phcontrol._validation import Array, count, finite_array, positive, vector
from phcontrol.exceptions import InvalidArgumentError, PHControlError
from phcontrol.mechanics.robot import Robot
from phcontrol.trajectories.pose import Pose, pose
from phcontrol.trajectories.splines import QuinticSpline

_ITERATIONS = 150
_STEP, _FASTEST = 1.0, 0.5  # pseudo-time of an iteration [s], and what a joint may move in it [rad, m]
_ACCURACY = {"eps_abs": 1e-10, "eps_rel": 0.0}


@dataclass(frozen=True)
class Posture:
    """Where inverse kinematics put the joints, and how far the frame still is from its target.

    Example:
        >>> from phcontrol import load_robot, reach
        >>> robot = load_robot("pera")
        >>> found = reach(robot, "tool", robot.placement("tool", robot.near_home()).translation)
        >>> found.position.shape, found.distance < 1e-6  # [m]
        ((7,), True)
    """

    position: Array
    """q, shape (n,) [rad], inside the joint limits."""
    distance: float
    """Of the frame's origin from the target [m]."""
    angle: float
    """Between the frame's orientation and the desired one [rad]; 0 when the orientation is free."""


class UnreachableTargetError(PHControlError):
    """No joint position inside the limits puts a frame at its target. ``nearest`` is the nearest posture found.

    Example:
        >>> from phcontrol import UnreachableTargetError, load_robot, reach
        >>> try:
        ...     reach(load_robot("pera"), "tool", [5.0, 0.0, 0.0], restarts=1)
        ... except UnreachableTargetError as error:
        ...     print(error.nearest.distance > 3.0)  # [m]
        True
    """

    def __init__(self, frame: str, robot: str, which: str, nearest: Posture) -> None:
        away = f"{nearest.distance:.3g} m" + (f" and {nearest.angle:.3g} rad" if nearest.angle else "")
        super().__init__(f"frame '{frame}' of {robot} does not reach its target{which}: it stays {away} away")
        self.nearest = nearest


def reach(
    robot: Robot,
    frame: str,
    target: Pose,
    *,
    start: ArrayLike | None = None,
    tolerance: float = 1e-6,
    restarts: int = 20,
    seed: int = 0,
) -> Posture:
    """Return joint positions inside the limits with a frame at a target: "put the hand there" in one call.

    Damped differential inverse kinematics (Levenberg and Marquardt) with the position limits in its quadratic
    program, from ``start`` and, where that gets stuck, from random postures. Mimic joints follow exactly. The answer is
    checked by forward kinematics, not by what the solver says. Needs Pink: ``pip install 'phcontrol[kinematics]'``.

    Args:
        robot: the arm.
        frame: name of a link or frame of it.
        target: where the frame should be in the world: a pose (pin.SE3, a 4 × 4 matrix, or a point and a rotation
            matrix), or a point of three coordinates [m], which leaves the orientation free.
        start: joint positions to start from, and to stay near to [rad]; by default the robot's home.
        tolerance: largest distance [m] and angle [rad] that counts as reached.
        restarts: how many random postures to start from, after ``start``.
        seed: of the random postures.

    Raises:
        UnreachableTargetError: no posture was found; carries the nearest one.
        PHControlError: Pink is not installed.

    Example:
        >>> import numpy as np
        >>> from phcontrol import load_robot, reach
        >>> robot = load_robot("pera")
        >>> there = robot.placement("tool", robot.near_home()).translation
        >>> found = reach(robot, "tool", there)
        >>> bool(np.linalg.norm(robot.placement("tool", found.position).translation - there) < 1e-6)  # [m]
        True
    """
    first = robot.home if start is None else vector("start", start, robot.n)
    limits = robot.lower, robot.upper
    solver = _Solver(robot, frame, _pose(target), positive("tolerance", tolerance))
    best = solver.solve(first, *limits)
    generator = np.random.default_rng(seed)
    for _ in range(count("restarts", restarts, minimum=0)):
        if solver.reached(best):
            break
        best = min(best, solver.solve(robot.random_position(generator), *limits), key=solver.miss)
    return solver.checked(best, "")


def follow(
    robot: Robot,
    frame: str,
    targets: Sequence[Pose],
    times: ArrayLike,
    *,
    start: ArrayLike | None = None,
    tolerance: float = 1e-6,
) -> QuinticSpline:
    """Return a joint trajectory along which a frame passes poses or points at given times, at rest at both ends.

    Each posture is found from the one before, no further away than the joints' velocity limits allow in
    between, so that the arm never jumps from one solution to another. The first is found as :func:`reach` does.
    Between the targets the frame is only near the straight path: give them densely. ``check_limits`` says
    what the whole motion asks of the joints.

    Args:
        robot: the arm.
        frame: name of a link or frame of it.
        targets: poses (pin.SE3 or 4 × 4) or points [m] in the world.
        times: when to be there, increasing, as many [s].
        start: as in :func:`reach`, for the first target.
        tolerance: likewise.

    Raises:
        UnreachableTargetError: says which target; carries the nearest posture.

    Example:
        >>> import numpy as np
        >>> from phcontrol import follow, load_robot
        >>> robot = load_robot("pera")
        >>> points = [robot.placement("tool", q).translation for q in (robot.home, robot.near_home())]
        >>> way = follow(robot, "tool", points, [0.0, 2.0])
        >>> error = robot.placement("tool", way.at(2.0).position).translation - points[1]
        >>> bool(np.linalg.norm(error) < 1e-5)  # [m]
        True
    """
    instants = finite_array("times", times)
    if instants.ndim != 1 or len(instants) != len(targets) or len(targets) < 2:
        raise InvalidArgumentError("times", f"must be as many as targets and at least 2, but are {instants.shape}")
    if (np.diff(instants) <= 0.0).any():
        raise InvalidArgumentError("times", "must increase")
    positions = [reach(robot, frame, targets[0], start=start, tolerance=tolerance).position]
    for k, elapsed in enumerate(np.diff(instants), start=1):
        solver, last = _Solver(robot, frame, _pose(targets[k]), tolerance), positions[-1]
        room = elapsed * robot.velocity_limit
        posture = solver.solve(last, np.maximum(robot.lower, last - room), np.minimum(robot.upper, last + room))
        positions.append(solver.checked(posture, f" number {k}, within the velocity limits").position)
    return QuinticSpline(instants, positions)


def _pose(target: Pose) -> tuple[pin.SE3, bool]:
    """Return a pose, and whether its orientation is desired too."""
    position, turn = pose("target", target)
    return pin.SE3(np.eye(3) if turn is None else np.array(turn), np.array(position)), turn is not None


class _Solver:
    """Inverse kinematics of one frame to one target."""

    def __init__(self, robot: Robot, frame: str, pose: tuple[pin.SE3, bool], tolerance: float) -> None:
        self.pink = _load_pink()
        self.robot, self.frame, self.tolerance = robot, frame, tolerance
        self.target, self.oriented = pose
        robot.frame_id(frame)
        self.task = self.pink.FrameTask(frame, position_cost=1.0, orientation_cost=float(self.oriented), lm_damping=0.1)
        self.task.set_target(self.target)
        self.constraints = []
        if robot.coupling is not None:  # all joints are E q + e: what is orthogonal to E's columns is fixed
            fixed = null_space(robot.coupling.matrix.T).T
            origin = np.zeros(robot.model.nq)
            task = self.pink.tasks.LinearHolonomicTask(fixed, fixed @ robot.coupling.offset, origin)
            self.constraints = [task]
        self.index = [list(robot.model.names)[1:].index(name) for name in robot.joint_names]

    def solve(self, start: Array, lower: Array, upper: Array) -> Posture:
        """Return the nearest posture found from one start, inside limits [rad]."""
        pink, model = self.pink, self.robot.model.copy()
        low, high = np.full(model.nq, -np.inf), np.full(model.nq, np.inf)
        low[self.index], high[self.index] = lower, upper
        model.lowerPositionLimit, model.upperPositionLimit = low, high
        limits = [
            pink.limits.ConfigurationLimit(model, config_limit_gain=1.0),
            pink.limits.VelocityLimit(model, np.full(model.nv, _FASTEST / _STEP)),
        ]
        configuration = pink.Configuration(
            model, model.createData(), self.robot.full_position(np.clip(start, lower, upper)), copy_data=False
        )
        best = self._posture(configuration, lower, upper)
        for _ in range(_ITERATIONS):
            if self.reached(best):
                break
            try:
                velocity = pink.solve_ik(
                    configuration,
                    [self.task],
                    _STEP,
                    solver="proxqp",
                    damping=1e-9,
                    limits=limits,
                    constraints=self.constraints or None,
                    safety_break=False,
                    **_ACCURACY,
                )
            except pink.exceptions.PinkError:  # no answer from here; another start may have one
                break
            if not np.isfinite(velocity).all():
                break
            configuration.integrate_inplace(velocity, _STEP)
            best = min(best, self._posture(configuration, lower, upper), key=self.miss)
        return best

    def _posture(self, configuration: Any, lower: Array, upper: Array) -> Posture:
        """Return where the joints are, taken inside the limits, judged by forward kinematics."""
        position = np.clip(np.asarray(configuration.q)[self.index], lower, upper)
        error = self.robot.placement(self.frame, position).actInv(self.target)
        angle = float(np.linalg.norm(pin.log3(error.rotation))) if self.oriented else 0.0
        return Posture(position, float(np.linalg.norm(error.translation)), angle)

    def miss(self, posture: Posture) -> float:
        """Return how far from the target a posture is, in metres and radians alike."""
        return posture.distance + posture.angle

    def reached(self, posture: Posture) -> bool:
        """Whether a posture is at the target."""
        return max(posture.distance, posture.angle) <= self.tolerance

    def checked(self, posture: Posture, which: str) -> Posture:
        """Return the posture if it is at the target. Raises UnreachableTargetError."""
        if not self.reached(posture):
            raise UnreachableTargetError(self.frame, self.robot.name, which, posture)
        return posture


def _load_pink() -> Any:
    try:
        import pink
        import pink.exceptions
        import pink.limits
        import pink.tasks
    except ImportError as error:
        raise PHControlError("inverse kinematics needs Pink: pip install 'phcontrol[kinematics]'") from error
    return pink
