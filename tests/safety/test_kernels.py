"""The kernels of the torque filter against their definitions, in every implementation that is here."""

from __future__ import annotations

import contextlib
import importlib
from types import SimpleNamespace

import numpy as np
import pytest
from daqp import solve as daqp_solve
from hypothesis import given
from hypothesis import strategies as st

from phcontrol.safety.problem import Problem

IMPLEMENTATIONS = {"numpy": importlib.import_module("phcontrol.safety._numpy")}
with contextlib.suppress(ImportError):  # where no compiler was at hand
    IMPLEMENTATIONS["compiled"] = SimpleNamespace(
        **vars(importlib.import_module("phcontrol.safety._compiled")),
        **{
            name: kernel
            for name, kernel in vars(importlib.import_module("phcontrol.safety._compiled_program")).items()
            if not name.startswith("_")
        },
    )

every_implementation = pytest.mark.parametrize("kernels", IMPLEMENTATIONS.values(), ids=IMPLEMENTATIONS)
seeds = st.integers(0, 2**32 - 1)


@every_implementation
@given(seed=seeds, period=st.floats(1e-4, 0.01))
def test_from_the_speed_bounds_a_joint_just_stops_at_its_limit(kernels, seed, period):
    rng, n = np.random.default_rng(seed), 4
    q, v, most = rng.uniform(-1.0, 1.0, n), rng.normal(size=n), rng.uniform(0.5, 3.0, n)
    upper, lower, braking = np.full(n, 1.2), np.full(n, -1.2), rng.uniform(1.0, 50.0, n)
    upper[0] = np.inf
    back, edges, jerk = np.full(2 * n, -0.25), np.concatenate([upper, -lower]), np.full(2 * n, np.inf)
    offset = rng.choice([0.0, 0.3, 0.6], n)
    low, high = kernels.speed_bounds(
        q, v, period, edges, np.tile(braking, 2), np.tile(offset, 2), jerk, np.tile(most, 2), 0.05, back
    )
    for bound, edge, way in ((high, upper, 1.0), (-low, -lower, -1.0)):
        for joint in range(n):
            room = edge[joint] - way * (q + 0.5 * period * v)[joint]
            squares = (bound[joint] + offset[joint]) ** 2 - offset[joint] ** 2
            needed = 0.5 * period * bound[joint] + squares / (2.0 * braking[joint])
            if room < 0.0:  # outside already: a gentle return
                assert bound[joint] == pytest.approx(max(room / 0.05, -0.25))
            elif bound[joint] < most[joint]:
                assert needed == pytest.approx(room, rel=1e-9, abs=1e-12)
            else:
                assert bound[joint] == most[joint]
                assert needed <= room * (1.0 + 1e-9) + 1e-12


@every_implementation
@given(seed=seeds, period=st.floats(5e-4, 0.005))
def test_from_the_speed_bounds_the_acceleration_can_be_turned_in_time(kernels, seed, period):
    """Drive with the highest velocity there is: limits are kept, and no step asks for more than the jerk to brake."""
    rng = np.random.default_rng(seed)
    jerk, most = rng.uniform(50.0, 2e3), rng.uniform(0.5, 2.0)
    braking = np.sqrt(rng.uniform(0.01, 0.3) * jerk * most)  # what the limits choose
    q, v, a, side = np.zeros(1), np.zeros(1), 0.0, rng.choice([-1.0, 1.0])
    arguments = [np.full(2, value) for value in (1.0, braking, 0.0, jerk, most)]
    for _ in range(int(3.0 / (most * period))):
        low, high = kernels.speed_bounds(q, v, period, *arguments, 0.05, np.full(2, -0.25))
        following = high if side > 0.0 else low
        before, a = a, side * float((following - v)[0]) / period
        if abs(v[0]) > 3.0 * braking * period:  # before the last periods, which land it in steps of αh
            assert before - a <= jerk * period / 0.8  # of which the limits keep 80 %
        q, v = q + 0.5 * period * (v + following), following
        assert abs(v[0]) <= most * (1.0 + 1e-12)
        assert abs(q[0]) <= 1.0 + 0.1 * braking * period**2
    assert abs(q[0]) > 0.9


@every_implementation
def test_a_joint_too_fast_may_brake_as_hard_as_that_asks(kernels):
    """The bound on the other side, which would have it brake gently, gives way; both are never contrary."""
    arguments = [np.full(2, value) for value in (1.0, 5.0, 0.0, 10.0, 1.0)]
    for v in (3.0, -3.0):
        low, high = kernels.speed_bounds(np.zeros(1), np.full(1, v), 1e-3, *arguments, 0.05, np.full(2, -0.25))
        assert low[0] == high[0] == np.sign(v)


@every_implementation
@given(seed=seeds, size=st.integers(1, 9))
def test_motion_rows_bound_the_next_velocity(kernels, seed, size):
    rng = np.random.default_rng(seed)
    effect = np.asfortranarray(rng.normal(size=(size, size)))
    reach, centre, drift = rng.uniform(0.5, 2.0, size), rng.normal(size=size), rng.normal(size=size)
    preferred = centre + reach * rng.uniform(-1.0, 1.0, size)
    reached, room = drift + effect @ preferred, 0.01
    lowest, highest = reached - rng.uniform(-0.2, 1.0, size), reached + rng.uniform(-0.05, 1.0, size)
    rows, lower, upper = np.full((size + 1, size), 7.0), np.full(size + 1, 8.0), np.full(size + 1, 9.0)
    keeps = kernels.motion_rows(effect, reach, centre, drift, lowest, highest, preferred, room, rows, lower, upper)
    np.testing.assert_allclose(np.linalg.norm(rows[:-1], axis=1), 1.0)
    assert (rows[-1] == 7.0).all()
    assert (lower[-1], upper[-1]) == (8.0, 9.0)
    slack = room * np.linalg.norm(effect * reach, axis=1)
    assert keeps == ((reached >= lowest - slack) & (reached <= highest + slack)).all()
    if keeps:  # then with some room around it
        lowest, highest = np.minimum(lowest, reached - slack), np.maximum(highest, reached + slack)
    z = rng.uniform(-2.0, 2.0, size)
    velocity = drift + effect @ (centre + reach * z)
    inside = (velocity >= lowest) & (velocity <= highest)
    values = rows[:-1] @ z
    np.testing.assert_array_equal(inside, (values >= lower[:-1]) & (values <= upper[:-1]))


@every_implementation
def test_the_excess_over_bounds_is_the_largest_of_all_joints(kernels):
    low, high = np.array([-1.0, -2.0, -np.inf]), np.array([1.0, 2.0, np.inf])
    for velocity, excess in (
        ([0.5, -2.0, 1e9], 0.0), ([1.5, 0.0, 0.0], 0.5), ([1.5, -2.75, 0.0], 0.75), ([0.0, np.nan, 0.0], np.nan)
    ):  # fmt: skip
        np.testing.assert_equal(kernels.bound_excess(np.array(velocity), low, high), excess)


def random_problem(seed, *, with_hessian):
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 8)), int(rng.integers(1, 9))
    root = rng.normal(size=(n, n))
    rows = rng.normal(size=(m, n))
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    width = rng.uniform(0.05, 1.0, m)
    return Problem(
        np.eye(n) + root @ root.T if with_hessian else None, 3.0 * rng.normal(size=n), rows, -width, width,
        -np.ones(n), np.ones(n),
    )  # fmt: skip


def exact(problem):
    """Return optimum and multipliers (rows, then box) by DAQP."""
    n = problem.gradient.size
    H = np.eye(n) if problem.hessian is None else problem.hessian
    upper = np.concatenate([problem.highest, problem.upper])
    lower = np.concatenate([problem.lowest, problem.lower])
    z, _, flag, info = daqp_solve(H, problem.gradient, problem.rows, upper, lower, np.zeros(upper.size, dtype=np.int32))
    assert flag == 1
    forces = np.asarray(info["lam"])
    return np.asarray(z), np.concatenate([forces[n:], forces[:n]])


@every_implementation
@given(seed=seeds, with_hessian=st.booleans())
def test_residuals_vanish_at_the_optimum_and_only_there(kernels, seed, with_hessian):
    problem = random_problem(seed, with_hessian=with_hessian)
    z, forces = exact(problem)
    rows = np.ascontiguousarray(forces[: problem.lower.size])
    assert max(kernels.residuals(*problem, z, rows)) < 1e-8
    away = np.clip(z + 0.1 * np.where(z > 0.0, -1.0, 1.0), problem.lowest, problem.highest)
    assert max(kernels.residuals(*problem, away, rows)) > 1e-3
    assert np.isnan(kernels.residuals(*problem, np.full_like(z, np.nan), rows)).any()


@every_implementation
@given(seed=seeds, with_hessian=st.booleans())
def test_the_right_active_constraints_give_the_optimum(kernels, seed, with_hessian):
    problem = random_problem(seed, with_hessian=with_hessian)
    z, forces = exact(problem)
    if np.count_nonzero(forces) and np.abs(forces[forces != 0.0]).min() < 1e-6:
        return  # on the edge of activity
    moved = problem._replace(gradient=problem.gradient * (1.0 + 1e-9))  # the constraints are those of a moment ago
    step = kernels.active_set_step(*moved, z, forces)
    assert step is not None
    np.testing.assert_allclose(step[0], z, atol=1e-7)
    np.testing.assert_allclose(step[1], forces, atol=1e-6)
    np.testing.assert_array_equal(step[2], np.clip(step[0], moved.lowest, moved.highest))
    rows = np.ascontiguousarray(step[1][: moved.lower.size])
    np.testing.assert_allclose(step[3:], kernels.residuals(*moved, step[2], rows), atol=1e-15)


@every_implementation
def test_dependent_active_constraints_are_said(kernels):
    problem = Problem(
        None, np.array([-5.0, 0.0]), np.array([[1.0, 0.0]]), -np.ones(1), np.ones(1), -np.ones(2), np.ones(2)
    )
    assert kernels.active_set_step(*problem, np.ones(2), np.array([4.0, 4.0, 0.0])) is None


@pytest.mark.skipif("compiled" not in IMPLEMENTATIONS, reason="the kernels were not compiled")
def test_the_compiled_kernels_refuse_what_they_cannot_read():
    compiled = IMPLEMENTATIONS["compiled"]
    problem = random_problem(1, with_hessian=True)
    n, m = problem.gradient.size, problem.lower.size
    z, forces = np.zeros(n), np.zeros(m + n)
    for bad in (
        problem._replace(gradient=None),
        problem._replace(gradient=np.zeros(n + 1)),
        problem._replace(hessian=np.eye(n + 1)),
        problem._replace(rows=np.asfortranarray(np.ones((m + 1, n + 1)))),
        problem._replace(lower=np.zeros(m, dtype=np.float32)),
        problem._replace(highest=np.zeros(2 * n)[::2] if n > 1 else np.zeros(n + 1)),
    ):
        with pytest.raises(ValueError, match=r"must be"):
            compiled.active_set_step(*bad, z, forces)
        with pytest.raises(ValueError, match=r"must be"):
            compiled.residuals(*bad, z, forces[:m])
    with pytest.raises(ValueError, match="multipliers"):
        compiled.active_set_step(*problem, z, forces[:-1])
    with pytest.raises(TypeError, match="takes 9"):
        compiled.residuals(*problem, z)
    with pytest.raises(ValueError, match="least"):
        compiled.narrowed_bounds(np.eye(n), z, z, z, z, z)
    with pytest.raises(ValueError, match="slow"):
        compiled.passed_velocities(z, z, z, 0.0, np.zeros(n + 1), np.zeros(3 * n))
    with pytest.raises(ValueError, match="response"):
        compiled.expected_friction(z, z, z, np.eye(n + 1))
    with pytest.raises(ValueError, match="inertia must be C-ordered"):
        compiled.braking_torque(z, np.asfortranarray(np.ones((n, n))), z, z, z, z, 1e-3, 0.1)
    with pytest.raises(ValueError, match="external"):
        compiled.predicted_motion(z, np.eye(n), np.eye(n), z, None, None, np.zeros(n + 1), 1e-3)
    with pytest.raises(ValueError, match="push"):
        compiled.moved(z, np.eye(n), np.zeros(n + 1))
    for kernel, arguments in (
        (compiled.nearest_torque, [z] * 3), (compiled.torque_range, [z] * 3), (compiled.effort_metric, [z] * 2),
        (compiled.torque_at, [z] * 5), (compiled.widen, [np.eye(n), z, 0.1, z, z]),
        (compiled.elastic_bounds, [np.eye(n), z, z, z, z]), (compiled.farther, [None, z, z, z]),
        (compiled.mean_power, [z, z, 0.0, z, z, z]), (compiled.parabola, [z, z, 0.0, z, np.eye(n)]),
        (compiled.tangent, [z, z, 0.0, z, np.eye(n)]), (compiled.bent, [None, z, 1.0, np.eye(n), z, None]),
        (compiled.storage_parabola, [z, z, z, z, np.eye(n), np.eye(n), z]), (compiled.scaled, [z, z, z, 1.0]),
    ):  # fmt: skip
        with pytest.raises(TypeError, match="arguments"):
            kernel(*arguments[:-1])
        for place, value in enumerate(arguments):
            if isinstance(value, np.ndarray):
                wrong = [*arguments[:place], np.ones(tuple(k + 1 for k in value.shape)), *arguments[place + 1 :]]
                with pytest.raises(ValueError, match="must be"):
                    kernel(*wrong)
    with pytest.raises(ValueError, match="edges"):
        compiled.speed_bounds(z, z, 1e-3, z, z, z, z, z, 0.05, z)


@every_implementation
@given(seed=seeds, size=st.integers(1, 8))
def test_narrowed_bounds_hold_for_every_friction_in_its_range(kernels, seed, size):
    """At the narrowed bounds, the worst corner of the torques' ranges just reaches the true ones, joint by joint."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(size, size))
    response = np.asfortranarray(np.eye(size) + root @ root.T)
    expected, lowest, highest = rng.normal(size=size), -rng.uniform(0.1, 2.0, size), rng.uniform(0.1, 2.0, size)
    ends = np.sort(rng.normal(size=(2, size)), axis=0)
    inside = ends[0] + rng.uniform(size=(2, 2, size)) * (ends[1] - ends[0])
    least = np.vstack([*inside.min(axis=1), ends[0]])  # towards either bound each joint's own is known better
    most = np.vstack([*inside.max(axis=1), ends[1]])
    low, high, contrary = kernels.narrowed_bounds(response, expected, least.ravel(), most.ravel(), lowest, highest)
    assert contrary == bool((low > high).any())
    for i in range(size):
        corners = np.array(np.meshgrid(*zip(ends[0], ends[1], strict=True))).reshape(size, -1)
        for bound, true, own, side in ((high, highest, least[0], 1.0), (low, lowest, most[1], -1.0)):
            corners[i] = own[i]
            reached = bound[i] + response[i] @ (expected[:, None] - corners)
            assert (side * reached).max() == pytest.approx(side * true[i], abs=1e-9)


@every_implementation
@given(seed=seeds, size=st.integers(1, 8), room=st.sampled_from([0.0, 1e-3, 0.5, np.inf]))
def test_the_velocities_passed_are_those_between_now_and_the_bounds(kernels, seed, size, room):
    rng = np.random.default_rng(seed)
    v, low, high = rng.normal(size=size), -rng.uniform(0.0, 2.0, size), rng.uniform(0.0, 2.0, size)
    high[0] = rng.choice([high[0], np.inf])
    slow, fast = np.full(3 * size, np.nan), np.full(3 * size, np.nan)
    kernels.passed_velocities(v, low, high, room, slow, fast)
    for i in range(size):
        ways = ([v[i], high[i], high[i] + room], [v[i], low[i], low[i] - room], [v[i], low[i] - room, high[i] + room])
        for k, speeds in enumerate(ways):
            finite = np.clip(speeds, -1e9, 1e9)
            assert (slow[k * size + i], fast[k * size + i]) == (finite.min(), finite.max())


@every_implementation
@given(seed=seeds, size=st.integers(1, 8))
def test_the_expected_friction_balances_the_velocity_it_leaves(kernels, seed, size):
    """s = (d − F_v)(v − A_ii s): each joint is slowed by its own friction, and by nothing else."""
    rng = np.random.default_rng(seed)
    v, viscous = rng.normal(size=size), rng.uniform(0.0, 1.0, size)
    damping = viscous + rng.uniform(0.0, 50.0, size)
    response = np.asfortranarray(rng.uniform(0.0, 0.2, (size, size)))
    torque = kernels.expected_friction(v, damping, viscous, response)
    np.testing.assert_allclose(torque, (damping - viscous) * (v - response.diagonal() * torque), atol=1e-9)


def positive_definite(rng, size):
    root = rng.normal(size=(size, size))
    return np.eye(size) + root @ root.T


@every_implementation
@given(seed=seeds, size=st.integers(1, 9), has=st.tuples(st.booleans(), st.booleans()))
def test_the_predicted_motion_obeys_newton(kernels, seed, size, has):
    """M⁺ v⁺ = M⁺ v + h(f_e + push − C v − F_v v − ∂V/∂q)."""
    rng = np.random.default_rng(seed)
    M, C, gradient, v, push = positive_definite(rng, size), *(rng.normal(size=s) for s in ((size, size), *[size] * 3))
    viscous, implicit = rng.uniform(0.0, 1.0, (2, size))
    force = rng.normal(size=size)
    inertia, response, own = kernels.predicted_motion(
        v, M, np.asfortranarray(C), gradient, viscous if has[0] else None, implicit if has[0] else None,
        force if has[1] else None, 2e-3,
    )  # fmt: skip
    total = push - C @ v - gradient
    if has[0]:
        M, total = M + np.diag(implicit), total - viscous * v
    if has[1]:
        total = total + force
    np.testing.assert_allclose(inertia, M)
    following = kernels.moved(v, response, own + push)
    np.testing.assert_allclose(M @ (following - v) / 2e-3, total, rtol=1e-9, atol=1e-9)


@every_implementation
def test_an_inertia_that_is_not_positive_definite_is_said(kernels):
    zero, M = np.zeros(2), np.array([[1.0, 2.0], [2.0, 1.0]])
    for bad in (M, np.full((2, 2), np.nan)):
        with pytest.raises(ArithmeticError, match="positive definite"):
            kernels.predicted_motion(zero, bad, np.eye(2), zero, None, None, None, 1e-3)


@every_implementation
@given(seed=seeds, size=st.integers(1, 9))
def test_the_braking_force_changes_the_velocity_into_its_bounds(kernels, seed, size):
    rng = np.random.default_rng(seed)
    M, (v, force) = positive_definite(rng, size), rng.normal(size=(2, size))
    lowest, fastest, h = rng.normal(size=size), rng.uniform(0.0, 0.5, size), 1e-3
    highest = lowest + rng.uniform(0.0, 1.0, size)
    wanted = kernels.braking_torque(v, M, force, lowest, highest, fastest, h, 0.1)
    following = v + h * np.linalg.solve(M, wanted + force)
    for i in range(size):
        alone = v[i] - np.clip(0.1 * v[i], -fastest[i], fastest[i])
        assert following[i] == pytest.approx(np.clip(alone, lowest[i], highest[i]), abs=1e-9)


@every_implementation
@given(seed=seeds, size=st.integers(1, 9))
def test_torques_and_what_they_are_scaled_to(kernels, seed, size):
    rng = np.random.default_rng(seed)
    limit, step = rng.uniform(0.5, 2.0, size), rng.choice([0.01, 0.3, np.inf], size)
    previous, torque = 2.0 * rng.normal(size=(2, size))
    low, high, centre, reach = kernels.torque_range(previous, limit, step)
    nearest, same = kernels.nearest_torque(torque, low, high)
    for i in range(size):
        start = min(max(previous[i], -limit[i]), limit[i])
        assert (low[i], high[i]) == (max(start - step[i], -limit[i]), min(start + step[i], limit[i]))
        assert nearest[i] == min(max(torque[i], low[i]), high[i])
    assert same == (nearest.tolist() == torque.tolist())
    assert kernels.nearest_torque(nearest, low, high)[1]
    z, inside = kernels.scaled(torque, centre, reach, np.inf)
    assert inside
    np.testing.assert_allclose(kernels.torque_at(z, centre, reach, low, high), nearest, atol=1e-12)
    near, inside = kernels.scaled(torque, centre, reach, 1.5)
    assert inside == (np.abs(z) <= 1.5).all()
    np.testing.assert_array_equal(near, np.clip(z, -1.5, 1.5))
    scale = rng.uniform(0.5, 2.0, size)
    metric = kernels.effort_metric(reach, scale)
    ratio = (z @ metric @ z) / ((reach * z / scale) ** 2).sum() if z.any() else 0.0
    assert metric.trace() == pytest.approx(size)
    if z.any():
        assert ratio == pytest.approx(size / ((reach / scale) ** 2).sum())


@every_implementation
@given(seed=seeds, with_hessian=st.booleans())
def test_a_bent_objective_and_the_parabola_that_bends_it(kernels, seed, with_hessian):
    """Up to a constant it is φ(y) + w(½(y − z)ᵀK(y − z) + sᵀy), and a tangent touches its parabola and stays below."""
    rng = np.random.default_rng(seed)
    problem = random_problem(seed, with_hessian=with_hessian)
    n, weight = problem.gradient.size, float(rng.uniform(0.1, 10.0))
    K, (z, slope, centre) = positive_definite(rng, n), rng.normal(size=(3, n))
    H = np.eye(n) if problem.hessian is None else problem.hessian

    def distance(y):
        return 0.5 * y @ H @ y + problem.gradient @ y

    def left_side(y):
        return 0.3 + slope @ (y - centre) + 0.5 * (y - centre) @ K @ (y - centre)

    for added in (None, slope):
        hessian, gradient = kernels.bent(problem.hessian, problem.gradient, weight, K, z, added)
        ys = rng.normal(size=(3, n))
        values = [
            0.5 * y @ hessian @ y + gradient @ y - distance(y) - weight * 0.5 * (y - z) @ K @ (y - z)
            - (0.0 if added is None else weight * slope @ y)
            for y in ys
        ]  # fmt: skip
        np.testing.assert_allclose(values, values[0], rtol=1e-9, atol=1e-9)
    assert kernels.parabola(z, centre, 0.3, slope, K) == pytest.approx(left_side(z))
    row, bound, length = kernels.tangent(z, centre, 0.3, slope, K)
    for y in (z, *ys):
        below = length * (row @ y - bound)
        assert below <= left_side(y) + 1e-9
    assert length * (row @ z - bound) == pytest.approx(left_side(z), abs=1e-9)
    assert np.linalg.norm(row) == pytest.approx(1.0)
    flat = kernels.tangent(centre, centre, 0.3, np.zeros(n), K)
    assert (flat[0].tolist(), flat[1:]) == ([0.0] * n, (-0.3, 0.0))
    inside = rng.uniform(-1.0, 1.0, n)
    more = kernels.farther(problem.hessian, problem.gradient, inside, problem.highest)
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * n)).reshape(n, -1)
    assert more >= max(distance(corner) for corner in corners.T) - distance(inside) - 1e-9
    if problem.hessian is None:
        assert more == pytest.approx(max(distance(corner) for corner in corners.T) - distance(inside))


@every_implementation
@given(seed=seeds, size=st.integers(1, 8))
def test_the_scaled_mean_power_is_the_mean_power(kernels, seed, size):
    rng = np.random.default_rng(seed)
    output, resistance, change, base = rng.normal(size=(4, size))
    effect, reach = positive_definite(rng, size), rng.uniform(0.5, 2.0, size)

    def power(delta):
        kick = base + effect @ delta
        return kernels.mean_power(output, resistance, 0.7, delta, kick, delta)

    expected = output @ change - 0.7 + 0.5 * (base + effect @ change) @ (change - resistance)
    assert power(change) == pytest.approx(expected)
    kick = base + effect @ change
    size_of, slope, curvature = kernels.storage_parabola(output, resistance, change, kick, effect, effect, reach)
    step = rng.normal(size=size)
    parabola = power(change) + size_of * (slope @ step + 0.5 * step @ curvature @ step)
    assert parabola == pytest.approx(power(change + reach * step), rel=1e-9, abs=1e-9)
    assert np.abs(slope).sum() + curvature.trace() == pytest.approx(1.0)
    zero = np.zeros(size)
    assert kernels.storage_parabola(zero, zero, zero, zero, 0.0 * effect, 0.0 * effect, reach)[0] == 0.0


@every_implementation
@given(seed=seeds, size=st.integers(1, 8))
def test_elastic_bounds_are_met_by_the_point_beside_them(kernels, seed, size):
    rng = np.random.default_rng(seed)
    rows, lower, preferred = rng.normal(size=(size, size)), 3.0 * rng.normal(size=size), 2.0 * rng.normal(size=size)
    upper, extent = lower + rng.uniform(0.0, 1.0, size), rng.uniform(0.5, 2.0, size)
    low, high, point = kernels.elastic_bounds(rows, lower, upper, extent, preferred)
    z, s = point[:size], point[size:]
    np.testing.assert_array_equal(z, np.clip(preferred, -extent, extent))
    assert ((rows @ z + s >= low - 1e-12) & (rows @ z + s <= high + 1e-12)).all()
    reach = np.abs(rows) @ extent + 1.0
    np.testing.assert_allclose(low, np.minimum(lower, reach))
    np.testing.assert_allclose(high, np.maximum(upper, -reach))
    wide_low, wide_high = low.copy(), high.copy()
    kernels.widen(rows, z, 0.01, wide_low, wide_high)
    np.testing.assert_allclose(wide_low, np.minimum(low, rows @ z - 0.01))
    np.testing.assert_allclose(wide_high, np.maximum(high, rows @ z + 0.01))
