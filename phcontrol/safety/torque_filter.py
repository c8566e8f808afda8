"""The torque that is nearest to a law's and keeps the arm inside its limits."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._validation import Array, flag, gain, positive
from phcontrol.controllers.passive_port import PassivePort
from phcontrol.exceptions import InvalidArgumentError
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem, check_system
from phcontrol.safety import kernels
from phcontrol.safety.filter_status import FilterStatus
from phcontrol.safety.friction_prediction import ROOM, FrictionPrediction
from phcontrol.safety.least_excess import LeastExcess
from phcontrol.safety.limits import Limits
from phcontrol.safety.problem import UNBOUNDED, Problem
from phcontrol.safety.quadratic_program import SolverName
from phcontrol.safety.storage_condition import StorageCondition
from phcontrol.safety.torque_program import TorqueProgram
from phcontrol.safety.torque_range import RobotShare, torque_range

_ANYWHERE = math.inf  # how far a scaled torque may be
_FARTHEST = 1e6  # a desired torque beyond this many times the effort limit is taken as that
_NO_EFFORT_LIMIT = 100.0  # scale of a joint without an effort limit [N·m]
_DAMPING_TIME = 0.1  # in which the fallback's damping stops a joint [s]
_ROOM = 1e-4  # by which the velocity bounds are at least wider than what braking reaches, of the torques' effect


class FilteredTorque(NamedTuple):
    """A torque that may leave, and what it cost.

    Example:
        >>> import numpy as np
        >>> from phcontrol import FilterStatus, FilteredTorque
        >>> found = FilteredTorque(np.array([1.0, 0.0]), FilterStatus.PASSED, 0.0, 0.0)
        >>> found.torque, found.status.name
        (array([1., 0.]), 'PASSED')
    """

    torque: Array
    """u, shape (n,) [N·m], exactly inside effort and rate limits."""
    status: FilterStatus
    motion_excess: float
    """By how much the next velocity may leave its bounds, whatever dry friction does, ≥ 0 [rad/s]."""
    storage_excess: float
    """By how much the mean rate of H_d in the period exceeds what :class:`StorageCondition` allows, ≥ 0 [W]."""


class _Motion(NamedTuple):
    """How the arm moves in one period."""

    inertia: Array
    """M + hθF_v."""
    response: Array
    """h(M + hθF_v)⁻¹."""
    force: Array
    """f_e − C q̇ − F_v q̇ − s − ∂V/∂q [N·m]: what moves the arm beside the motors."""
    dry: Array
    """s: the dry friction that is expected [N·m]."""
    drift: Array
    """The next velocity without motors [rad/s]."""
    effect: Array
    """∂v⁺/∂u = h(M + hθF_v)⁻¹G."""

    def next_velocity(self, torque: Array) -> Array:
        """Return v⁺ under a torque [rad/s]."""
        return kernels.moved(self.drift, self.effect, torque)


class _Bounds(NamedTuple):
    """Between which velocities the arm must be after a period, each a lowest and a highest one [rad/s]."""

    true: tuple[Array, Array]
    """Those of the limits."""
    predicted: tuple[Array, Array]
    """Those for the predicted velocity: narrower by what dry friction may do; they can be contradictory."""
    aimed: tuple[Array, Array]
    """The same without contradictions."""


class _Box(NamedTuple):
    """The torques that effort and rate allow, and z = (u − centre)/reach, in which the program is written."""

    low: Array
    high: Array
    centre: Array
    reach: Array
    lowest: Array
    """The smallest z: −1, but where there is no effort limit."""
    highest: Array
    """The largest z: 1, but where there is no effort limit."""

    def scaled(self, torque: Array) -> Array:
        """Return z of a torque [N·m]."""
        return kernels.scaled(torque, self.centre, self.reach, _ANYWHERE)[0]

    def torque(self, z: Array) -> Array:
        """Return the torque of z, exactly inside the box [N·m]."""
        return kernels.torque_at(z, self.centre, self.reach, self.low, self.high)


class TorqueFilter:
    """The torque nearest to the law's u★ with which the arm keeps its limits and the storage function falls.

        min ½(u − u★)ᵀW(u − u★)   subject to, in this order of priority,

        1. |u| ≤ effort                                always, exactly
        2. |u − u_previous| ≤ h · torque rate          always, exactly
        3. v_min ≤ v⁺ ≤ v_max                          as far as the motors can keep it
        4. P(u) ≤ max(0, P(u★))                        unless 1 to 3 forbid it

    v⁺ = q̇ + h(M + hθF_v)⁻¹(G u + f_e − C q̇ − F_v q̇ − s − ∂V/∂q) is the velocity after one period h, and its bounds are
    those of :class:`Limits`: velocity limits, and speeds from which each joint can still stop in front of its position
    limits. F_v is the viscous friction, and of the dry friction s only an interval is known: 3 is asked for with the s
    that is worst for each bound (:class:`FrictionPrediction`), ``motion_excess`` is reported for the worst.
    P is the mean rate of H_d over the period, but for the power of f_e, see :class:`StorageCondition`: by 4 the storage
    function still does not grow by itself.

    Where the braking torque cannot keep 3 with 1 and 2, the bounds are widened by the least excess there is, if any
    (:class:`LeastExcess`: least squares, relative to what the motors can do to each joint's velocity). So 1 to 3 always
    have a solution. Where 4 cannot be kept, the answer weighs P with 10⁶ against the scaled distance, which brings it
    to the smallest excess there is.

    How far the true velocity can be beyond bounds and reported excess all the same: by what inertia, load and unknown
    forces do within a period, seen up to 4.1 % of the fastest joint's change of velocity in it (``python -m
    tests.safety.true_motion --cases 1000000 --seed 24``). In closed loops of arms with dry friction speeds kept within
    1.001 of their limits without a torque rate. With one, another joint's friction that turns brought them to 1.007,
    and on a Panda with 2 to 3 N·m of it to 1.04, which was reported (``python -m tests.safety.friction_loops
    --seeds 3``).

    That is for a friction that is not less than the model's. **Friction that the arm lacks accelerates it**: with 30 %
    less, speeds came to 1.13 of their limits, and with a torque rate to several times those, since the motors cannot
    turn by what is missing (``--error -0.3``). So give the filter a system with the least friction that the arm may
    have (``StribeckFriction.scaled``): with 0.7 of the nominal one, on plants with 0.7 and with 1.3 of it, speeds
    stayed within 1.03 (``--model 0.7 --error 0.3``).

    Most of the time u★ passes, or its projection on 1 and 2 does. Otherwise :class:`TorqueProgram` solves the scaled
    problem, started from its last answer; the residual of the optimality conditions is checked, and an answer that
    does not pass is replaced by the braking torque and reported.

    Args:
        system: the model of the arm.
        period: h [s].
        limits: by default those of the robot's description.
        metric: W: "effort" for the torques relative to their limits, "inertia" for M⁻¹ (nearest acceleration),
            or a positive-definite matrix.
        storage: False to leave out the storage condition.
        solver: that is asked first, "daqp" (a dual active-set method) or "proxqp" (a proximal method); the other one
            solves again what does not pass the check.

    Example:
        >>> from phcontrol import EnergyShaping, Limits, MechanicalSystem, TorqueFilter, load_robot, simulate
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = EnergyShaping.tuned(system, system.robot.upper + 0.1)  # outside the limits
        >>> guard = TorqueFilter(system, period=1e-3, limits=Limits(system, velocity_margin=0.1))
        >>> log = simulate(system, law, duration=0.3, torque_filter=guard)
        >>> bool((abs(log.velocity).max(axis=0) / system.robot.velocity_limit).max() < 0.91)
        True
    """

    def __init__(
        self,
        system: MechanicalSystem,
        *,
        period: float,
        limits: Limits | None = None,
        metric: Literal["effort", "inertia"] | ArrayLike = "effort",
        storage: bool = True,
        solver: SolverName = "daqp",
    ) -> None:
        check_system(system)
        self.system = system
        self.period = positive("period", period)
        self.limits = Limits(system) if limits is None else limits
        if not isinstance(self.limits, Limits) or self.limits.effort.size != system.n:
            raise InvalidArgumentError("limits", f"must be Limits made for this system of {system.n} joints")
        self.storage = flag("storage", storage)
        n = system.n
        effort = self.limits.effort
        bounded = np.isfinite(effort)
        self._scale: Array = np.where(bounded, effort, _NO_EFFORT_LIMIT)
        self._zero, self._unlimited = np.zeros(n), np.full(n, np.inf)
        highest: Array = np.where(bounded, 1.0, UNBOUNDED)
        self._effort_box = _Box(-effort, effort, self._zero, self._scale, -highest, highest)
        self._friction = None if system.friction is None else FrictionPrediction(system, period, self.limits.velocity)
        self._dry = self._friction if self._friction is not None and self._friction.is_dry else None
        self._has_infinite_bounds = not (bounded.all() and np.isfinite(self.limits.velocity).all())
        self._braking_step = self.period * self.limits.braking_acceleration
        self._rate_bound = self.period * self.limits.torque_rate
        self._has_rate = bool(np.isfinite(self._rate_bound).any())
        self._inertial = isinstance(metric, str) and metric == "inertia"
        self._metric: Array | None = None
        if isinstance(metric, str):
            if metric not in ("effort", "inertia"):
                raise InvalidArgumentError("metric", f"must be 'effort', 'inertia' or a matrix, but is '{metric}'")
        else:
            self._metric = np.array(gain("metric", metric, n))
        self._inverse_input = None if system.input_matrix is None else np.linalg.inv(system.input_matrix)
        self._program, self._least_excess = TorqueProgram(n, solver), LeastExcess(n, solver)
        self._rows = self._program.rows[:-1], self._program.lower[:-1], self._program.upper[:-1]
        self._is_separable = self._metric is None and not self._inertial
        self.reset()

    def __repr__(self) -> str:
        return f"<TorqueFilter for {self.system.robot.name}, every {self.period:g} s>"

    def reset(self) -> None:
        """Forget the solver's last answer and set the counts to zero."""
        self.counts: dict[FilterStatus, int] = dict.fromkeys(FilterStatus, 0)
        """How often each status occurred."""
        self._program.reset()
        self._least_excess.reset()

    def filter(
        self,
        x: MechanicalState,
        torque: Array,
        *,
        previous: Array | None = None,
        share: RobotShare | None = None,
        external_force: Array | None = None,
        port: PassivePort | None = None,
    ) -> FilteredTorque:
        """Return the torque to apply during the next period.

        Args:
            x: the state now.
            torque: u★, what the law desires [N·m], finite.
            previous: the torque applied until now [N·m], for the rate limit; None for a start without one.
            share: what the robot adds itself: 1 and 2 hold for what the motors carry, and for what is sent.
            external_force: f_e [N·m] as far as it is known, for the prediction.
            port: of the law (``Controller.passive_port``); None leaves condition 4 out.
        """
        torque = np.ascontiguousarray(torque, dtype=float)
        box = self._box(previous, share)
        nearest, unchanged = kernels.nearest_torque(torque, box.low, box.high)
        motion = self._motion(x, external_force)
        bounds = self._bounds(x, motion)
        velocity = motion.next_velocity(nearest)
        condition = StorageCondition(port, self.system.input_matrix) if port is not None and self.storage else None
        if (
            (unchanged or self._is_separable)
            and kernels.bound_excess(velocity, *bounds.predicted) == 0.0
            and (unchanged or condition is None or condition.power(nearest - torque, velocity - x.velocity) <= 0.0)
        ):
            status = FilterStatus.PASSED if unchanged else FilterStatus.CLIPPED
            self.counts[status] += 1
            return FilteredTorque(nearest, status, 0.0, 0.0)
        return self._solve(x, torque, box, motion, bounds, condition, nearest, velocity)

    def _box(self, previous: Array | None, share: RobotShare | None) -> _Box:
        """Return the torques that effort and rate allow, with their scales."""
        if share is not None:
            return self._shared_box(previous, share)
        if not self._has_rate:
            return self._effort_box
        if previous is None:
            previous, step = self._zero, self._unlimited
        else:
            previous, step = np.ascontiguousarray(previous, dtype=float), self._rate_bound
        return self._scaled_box(*kernels.torque_range(previous, self.limits.effort, step))

    def _shared_box(self, previous: Array | None, share: RobotShare) -> _Box:
        """Return the same where a robot adds to what is sent."""
        low, high = torque_range(self.limits.effort, self._rate_bound, previous if self._has_rate else None, share)
        return self._scaled_box(low, high, 0.5 * (low + high), 0.5 * (high - low))

    def _scaled_box(self, low: Array, high: Array, centre: Array, reach: Array) -> _Box:
        """Return the box of these torques; where there is no bound it has a scale all the same."""
        if not self._has_infinite_bounds:
            return _Box(low, high, centre, reach, self._effort_box.lowest, self._effort_box.highest)
        free = np.isinf(reach)
        highest = np.where(free, UNBOUNDED, 1.0)
        centre, reach = np.where(free, 0.0, centre), np.where(free, _NO_EFFORT_LIMIT, reach)
        return _Box(low, high, centre, reach, -highest, highest)

    def _motion(self, x: MechanicalState, external_force: Array | None) -> _Motion:
        """Return what the prediction needs."""
        friction, velocity, matrix = self._friction, x.velocity, self.system.input_matrix
        viscous = implicit = None
        if friction is not None:
            viscous, implicit = friction.viscous, friction.implicit
        if external_force is not None:
            external_force = np.ascontiguousarray(external_force, dtype=float)
        inertia, response, force = kernels.predicted_motion(
            velocity, x.mass_matrix, x.coriolis_matrix, x.potential_gradient, viscous, implicit, external_force,
            self.period,
        )  # fmt: skip
        dry = self._zero
        if self._dry is not None:
            dry = self._dry.expected(velocity, x.damping, response)
            force -= dry
        effect = response if matrix is None else response.dot(matrix)
        return _Motion(inertia, response, force, dry, kernels.moved(velocity, response, force), effect)

    def _bounds(self, x: MechanicalState, motion: _Motion) -> _Bounds:
        """Return the bounds of the next velocity."""
        true = self.limits.velocity_bounds(x.position, x.velocity, self.period)
        if self._dry is None:
            return _Bounds(true, true, true)
        lowest, highest, contrary = self._dry.narrowed(x.velocity, motion.dry, motion.response, *true)
        predicted = aimed = lowest, highest
        if contrary:
            aimed = _reconciled(x.velocity, true, predicted)
        return _Bounds(true, predicted, aimed)

    def _braking(self, x: MechanicalState, motion: _Motion, bounds: tuple[Array, Array], box: _Box) -> Array:
        """Return the braking torque: to the velocity bounds, or damping inside them; inside the box [N·m]."""
        wanted = kernels.braking_torque(
            x.velocity, motion.inertia, motion.force, *bounds, self._braking_step, self.period,
            self.period / _DAMPING_TIME,
        )  # fmt: skip
        if self._inverse_input is not None:
            wanted = self._inverse_input.dot(wanted)
        return kernels.nearest_torque(wanted, box.low, box.high)[0]

    def _widen(self, rows: Array, lower: Array, upper: Array, box: _Box, preferred: Array) -> Array:
        """Widen the velocity bounds as far as they cannot be kept; return a z that keeps them then.

        It is the one with the least excess, near the preferred z, which takes its place where there is no answer.
        """
        found = self._least_excess.solve(rows, lower, upper, box.highest, preferred)
        z = preferred if found is None else found
        kernels.widen(rows, z, _ROOM, lower, upper)
        return z

    def _hessian(self, motion: _Motion, reach: Array) -> Array | None:
        """Return the metric for z, of order one; None for the identity."""
        if self._inertial:
            metric = motion.response
        elif self._metric is not None:
            metric = self._metric
        elif reach is self._scale:
            return None
        else:
            return kernels.effort_metric(reach, self._scale)
        hessian = metric * reach[:, None] * reach
        result: Array = hessian * (self.system.n / np.trace(hessian))
        return result

    def _solve(
        self,
        x: MechanicalState,
        desired: Array,
        box: _Box,
        motion: _Motion,
        bounds: _Bounds,
        condition: StorageCondition | None,
        nearest: Array,
        velocity: Array,
    ) -> FilteredTorque:
        program, centre, reach = self._program, box.centre, box.reach
        wanted, is_near = kernels.scaled(desired, centre, reach, _FARTHEST)
        if not is_near:
            desired = centre + reach * wanted
        effect, drift = motion.effect, motion.drift
        rows, lower, upper = self._rows
        safe = self._braking(x, motion, bounds.aimed, box)
        keeps = kernels.motion_rows(effect, reach, centre, drift, *bounds.aimed, safe, _ROOM, rows, lower, upper)
        if self._has_infinite_bounds:
            np.maximum(lower, -UNBOUNDED, out=lower)
            np.minimum(upper, UNBOUNDED, out=upper)
        feasible = box.scaled(safe)
        if not keeps:
            feasible = self._widen(rows, lower, upper, box, feasible)
        hessian, gradient = self._hessian(motion, reach), -wanted
        if hessian is not None:
            gradient = hessian.dot(gradient)
        problem = Problem(hessian, gradient, rows, lower, upper, box.lowest, box.highest)

        def result(status: FilterStatus, answer: Array | None) -> FilteredTorque:
            torque = box.torque(feasible if answer is None else answer)
            reached, growth = motion.next_velocity(torque), 0.0
            if condition is not None:
                growth = max(0.0, condition.power(torque - desired, reached - x.velocity) - allowed)
            return FilteredTorque(torque, status, kernels.bound_excess(reached, *bounds.predicted), growth)

        if condition is None:
            found = result(*program.solve(problem, feasible))
        else:
            allowed = condition.allowed(motion.next_velocity(desired) - x.velocity)
            without = None if program.is_constrained else result(*program.solve(problem, feasible))
            if without is None or without.storage_excess > 0.0:
                change, kick = nearest - desired, velocity - x.velocity
                surplus = condition.power(change, kick) - allowed
                constraint = condition.scaled(surplus, change, kick, effect, box.scaled(nearest), reach)
                found = result(*program.solve(problem, feasible, constraint))
            else:
                found = without
        self.counts[found.status] += 1
        if self._dry is None or not found.motion_excess > ROOM:
            return found
        reached = motion.next_velocity(found.torque)
        excess = self._dry.excess(x.velocity, motion.dry, motion.response, *bounds.true, reached, found.motion_excess)
        return found._replace(motion_excess=excess)


def _reconciled(velocity: Array, true: tuple[Array, Array], predicted: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return bounds without contradictions: in their middle, and for a joint that is too fast at that which brakes."""
    lowest, highest = predicted
    contrary = lowest > highest
    middle = np.where(velocity > true[1], highest, np.where(velocity < true[0], lowest, 0.5 * (lowest + highest)))
    return np.where(contrary, middle, lowest), np.where(contrary, middle, highest)
