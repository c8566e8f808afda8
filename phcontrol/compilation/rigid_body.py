"""Rigid-body quantities of an arm for any scalar: floats, or symbols.

Everything is written in the axes and about the origin of the world: twists are (linear, angular) of the point there,
a body's inertia is its mass m, h = m c with its centre c, and Ī about that origin. Then the mass matrix is
M_ij = S_iᵀI_jᶜS_j with the inertia I_jᶜ of all that joint j carries, and the Coriolis matrix of the Christoffel symbols

    C_ij = S_iᵀ(I_jᶜṠ_j + B_jᶜS_j),   C_ji = Ṡ_iᵀI_jᶜS_j + S_iᵀB_jᶜᵀS_j        (i before or equal to j)

with B = ½[v×*I + (Iv)×̄* − Iv×] of each body (S. Echeandia and P. Wensing, "Numerical methods to compute the Coriolis
matrix and Christoffel symbols for rigid-body systems", J. Comput. Nonlinear Dyn. 16, 2021). Of one body about the
origin it is B = [[0, −f×], [0, E − ½ k×]], (f, k) = Iv its momentum and E symmetric.
"""

from __future__ import annotations

import copy
from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

Scalar = Any
Vector = tuple[Scalar, Scalar, Scalar]
Rows = tuple[Vector, Vector, Vector]

NOTHING: Vector = (0.0, 0.0, 0.0)
_NO_ROWS: Rows = (NOTHING, NOTHING, NOTHING)


def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def scale(s: Scalar, a: Vector) -> Vector:
    """Return s a."""
    return s * a[0], s * a[1], s * a[2]


def dot(a: Vector, b: Vector) -> Scalar:
    """Return aᵀb."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Return a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def turn(R: Rows, a: Vector) -> Vector:
    """Return R a."""
    return dot(R[0], a), dot(R[1], a), dot(R[2], a)


def turn_back(R: Rows, a: Vector) -> Vector:
    """Return Rᵀa."""
    return turn(transposed(R), a)


def transposed(R: Rows) -> Rows:
    """Return Rᵀ."""
    return tuple(zip(*R, strict=True))  # type: ignore[return-value]


def product(R: Rows, Q: Rows) -> Rows:
    """Return R Q."""
    columns = transposed(Q)
    return tuple(turn(columns, row) for row in R)  # type: ignore[return-value]


def sum_of(A: Rows, B: Rows) -> Rows:
    """Return A + B."""
    return add(A[0], B[0]), add(A[1], B[1]), add(A[2], B[2])


class Twist(NamedTuple):
    """A twist (v, ω), or a wrench (f, τ)."""

    linear: Vector
    angular: Vector

    def __add__(self, other: Twist) -> Twist:  # type: ignore[override]
        return Twist(add(self.linear, other.linear), add(self.angular, other.angular))

    def times(self, s: Scalar) -> Twist:
        """Return it s times."""
        return Twist(scale(s, self.linear), scale(s, self.angular))

    def dot(self, other: Twist) -> Scalar:
        """Return the power of a wrench along a twist."""
        return dot(self.linear, other.linear) + dot(self.angular, other.angular)

    def moved(self, other: Twist) -> Twist:
        """Return self × other: how a twist that is carried along changes."""
        linear = add(cross(self.angular, other.linear), cross(self.linear, other.angular))
        return Twist(linear, cross(self.angular, other.angular))

    def moved_force(self, force: Twist) -> Twist:
        """Return self ×* force: how a wrench that is carried along changes."""
        angular = add(cross(self.angular, force.angular), cross(self.linear, force.linear))
        return Twist(cross(self.angular, force.linear), angular)


STILL = Twist(NOTHING, NOTHING)


class Inertia(NamedTuple):
    """A spatial inertia, or its rate (then the mass is 0)."""

    mass: Scalar
    first: Vector
    """h."""
    second: Rows
    """Ī, symmetric."""

    def __add__(self, other: Inertia) -> Inertia:  # type: ignore[override]
        return Inertia(self.mass + other.mass, add(self.first, other.first), sum_of(self.second, other.second))

    def momentum(self, v: Twist) -> Twist:
        """Return I v."""
        linear = add(scale(self.mass, v.linear), cross(v.angular, self.first))
        return Twist(linear, add(cross(self.first, v.linear), turn(self.second, v.angular)))

    def rate(self, v: Twist) -> Inertia:
        """Return v×*I − I v×: how it changes while it moves along with a twist."""
        h, W = self.first, transposed(tuple(cross(v.angular, row) for row in self.second))  # type: ignore[arg-type]
        first = add(scale(self.mass, v.linear), cross(v.angular, h))
        along = 2.0 * dot(v.linear, h)

        def entry(i: int, j: int) -> Scalar:
            value = W[i][j] + W[j][i] - h[i] * v.linear[j] - h[j] * v.linear[i]
            return value + along if i == j else value

        a, b, c, d, e, f = (entry(*place) for place in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)))
        return Inertia(0.0, first, ((a, b, c), (b, d, e), (c, e, f)))


class Gyration(NamedTuple):
    """B = [[0, −f×], [0, E − ½ k×]] of one body or more."""

    linear: Vector
    """f."""
    angular: Vector
    """k."""
    even: Rows
    """E."""

    @classmethod
    def of(cls, inertia: Inertia, v: Twist) -> Gyration:
        """Return B of a body that moves with a twist."""
        momentum, half = inertia.momentum(v), inertia.rate(v).second
        return cls(momentum.linear, momentum.angular, tuple(scale(0.5, row) for row in half))  # type: ignore[arg-type]

    def __add__(self, other: Gyration) -> Gyration:  # type: ignore[override]
        return Gyration(add(self.linear, other.linear), add(self.angular, other.angular), sum_of(self.even, other.even))

    def along(self, s: Twist) -> Twist:
        """Return B s."""
        odd = scale(-0.5, cross(self.angular, s.angular))
        return Twist(cross(s.angular, self.linear), add(turn(self.even, s.angular), odd))

    def back(self, s: Twist) -> Vector:
        """Return the angular part of Bᵀs; the linear one is 0."""
        odd = scale(0.5, cross(self.angular, s.angular))
        return add(cross(self.linear, s.linear), add(turn(self.even, s.angular), odd))


class Body(NamedTuple):
    """A joint and what it carries, in the joint's own frame."""

    parent: int
    rotation: Rows
    """Of the joint's frame in the parent's, at position 0."""
    translation: Vector
    axis: Vector
    prismatic: bool
    mass: Scalar
    centre: Vector
    inertia: Rows
    """About the centre."""
    armature: float


class ArmModel:
    """What a Pinocchio model of joints with one degree of freedom is made of.

    Args:
        model: the model. Its gravity, armature and inertias (payloads among them) are taken as they are.
    """

    def __init__(self, model: pin.Model) -> None:
        self.gravity: Vector = _vector(model.gravity.linear)
        self.bodies = [self._body(model, index) for index in range(1, model.njoints)]
        self.supports = [[joint - 1 for joint in model.supports[i] if joint > 0] for i in range(model.njoints)]
        """The joints that move what joint ``index`` of the model carries, itself the last."""
        self.frames = model.frames

    def __len__(self) -> int:
        return len(self.bodies)

    @staticmethod
    def _body(model: pin.Model, index: int) -> Body:
        joint, placement, inertia = model.joints[index], model.jointPlacements[index], model.inertias[index]
        if joint.nq != 1 or joint.nv != 1:
            raise NotImplementedError(f"joint '{model.names[index]}' has {joint.nv} degrees of freedom")
        data = joint.createData()
        joint.calc(data, np.zeros(model.nq))
        subspace = np.asarray(data.S).ravel()
        prismatic = not subspace[3:].any()
        axis = subspace[:3] if prismatic else subspace[3:]
        rest = data.M  # of some joints not the identity at 0
        at_rest = placement * rest
        return Body(
            model.parents[index] - 1,
            _rows(at_rest.rotation),
            _vector(at_rest.translation),
            _vector(axis),
            prismatic,
            float(inertia.mass),
            _vector(inertia.lever),
            _rows(inertia.inertia),
            float(model.armature[index - 1]),
        )

    def inertial_numbers(self) -> list[float]:
        """Return mass [kg], centre [m] and the six moments about it [kg·m²], body by body."""
        numbers: list[float] = []
        for body in self.bodies:
            (a, b, c), (_, d, e), (_, _, f) = body.inertia
            numbers += [body.mass, *body.centre, a, b, c, d, e, f]
        return numbers

    def with_inertial_numbers(self, numbers: Any) -> ArmModel:
        """Return the same arm with other inertias, floats or symbols, in the order of ``inertial_numbers``."""
        other = copy.copy(self)
        other.bodies = []
        for k, body in enumerate(self.bodies):
            mass, x, y, z, a, b, c, d, e, f = numbers[10 * k : 10 * k + 10]
            rows: Rows = ((a, b, c), (b, d, e), (c, e, f))
            other.bodies.append(body._replace(mass=mass, centre=(x, y, z), inertia=rows))
        return other

    def with_gravity(self, gravity: Vector) -> ArmModel:
        """Return the same arm under another gravity [m/s²], floats or symbols."""
        other = copy.copy(self)
        other.gravity = gravity
        return other

    def structure(self, inertias: Collection[int], weighed: bool) -> list[Any]:
        """Return all of the arm that is code: joints, frames, armature, inertias but those of some bodies.

        Of gravity only where it is 0, if it is an input (``weighed``).
        """
        bodies = list(self.bodies)
        for k in inertias:
            bodies[k] = bodies[k]._replace(mass=0.0, centre=NOTHING, inertia=_NO_ROWS)
        gravity = [value == 0.0 for value in self.gravity] if weighed else self.gravity
        frames = [(frame.name, frame.parentJoint, frame.placement.homogeneous.tobytes()) for frame in self.frames]
        return [gravity, bodies, self.supports, frames]

    def at(self, position: Any) -> ArmPosture:
        """Return the arm at joint positions, floats or symbols."""
        return ArmPosture(self, position)


def _vector(values: Any) -> Vector:
    return tuple(np.asarray(values, dtype=np.float64).ravel().tolist())


def _rows(matrix: Any) -> Rows:
    """Return a (3, 3) matrix by its rows; what rounding left beside 0 and ±1 is taken out."""
    first, second, third = np.asarray(matrix, dtype=np.float64).tolist()
    return _cleaned(first), _cleaned(second), _cleaned(third)


def _cleaned(row: list[float]) -> Vector:
    x, y, z = (near if abs(entry - (near := float(round(entry)))) < 4e-16 else entry for entry in row)
    return x, y, z


class ArmPosture:
    """An arm at one position: where its joints are, and what follows."""

    def __init__(self, arm: ArmModel, position: Any) -> None:
        self.arm = arm
        self.rotations: list[Rows] = []
        self.origins: list[Vector] = []
        self.axes: list[Twist] = []
        """S, by joint."""
        for body, q in zip(arm.bodies, position, strict=True):
            R, p = (body.rotation, body.translation)
            if body.parent >= 0:
                above = self.rotations[body.parent]
                R, p = product(above, R), add(self.origins[body.parent], turn(above, p))
            axis = turn(R, body.axis)
            if body.prismatic:
                p = add(p, scale(q, axis))
                self.axes.append(Twist(axis, NOTHING))
            else:
                R = product(R, _turned(body.axis, q))
                self.axes.append(Twist(cross(p, axis), axis))
            self.rotations.append(R)
            self.origins.append(p)
        self._carried: list[Inertia] | None = None
        self._own: list[Inertia] | None = None

    @property
    def own(self) -> list[Inertia]:
        """The inertia of each body."""
        if self._own is None:
            self._own = [self._inertia(k) for k in range(len(self.arm))]
        return self._own

    def _inertia(self, k: int) -> Inertia:
        body, R = self.arm.bodies[k], self.rotations[k]
        c = add(self.origins[k], turn(R, body.centre))
        h = scale(body.mass, c)
        half = product(R, body.inertia)
        along = dot(h, c)

        def entry(i: int, j: int) -> Scalar:
            value = dot(half[i], R[j]) - h[i] * c[j]
            return value + along if i == j else value

        a, b, d, e, f, g = (entry(*place) for place in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)))
        return Inertia(body.mass, h, ((a, b, d), (b, e, f), (d, f, g)))

    @property
    def carried(self) -> list[Inertia]:
        """The inertia of all that each joint carries."""
        if self._carried is None:
            self._carried = self._gathered(list(self.own))
        return self._carried

    def _gathered(self, parts: list[Any]) -> list[Any]:
        """Return what each joint carries of things that add up."""
        for k in reversed(range(len(parts))):
            parent = self.arm.bodies[k].parent
            if parent >= 0:
                parts[parent] = parts[parent] + parts[k]
        return parts

    def _before(self, k: int) -> list[int]:
        """Return the joints that move joint k, itself the last."""
        return self.arm.supports[k + 1]

    def gravity(self) -> list[Scalar]:
        """Return g, entry by entry."""
        G = self.arm.gravity
        carried = zip(self.axes, self._masses(), strict=True)
        return [-(m * dot(S.linear, G) + dot(cross(h, G), S.angular)) for S, (m, h) in carried]

    def _masses(self) -> list[tuple[Scalar, Vector]]:
        """Return mass and first moment of all that each joint carries; no second moments are formed for it."""
        found = []
        for k, body in enumerate(self.arm.bodies):
            centre = add(self.origins[k], turn(self.rotations[k], body.centre))
            found.append((body.mass, scale(body.mass, centre)))
        for k in reversed(range(len(found))):
            parent = self.arm.bodies[k].parent
            if parent >= 0:
                found[parent] = found[parent][0] + found[k][0], add(found[parent][1], found[k][1])
        return found

    def weight_energy(self) -> Scalar:
        """Return the potential energy of weight [J]."""
        total: Scalar = 0.0
        for k, (_, h) in enumerate(self._masses()):
            if self.arm.bodies[k].parent < 0:
                total = total - dot(h, self.arm.gravity)
        return total

    def mass_matrix(self) -> list[list[Scalar]]:
        """Return M, rows of entries."""
        n = len(self.arm)
        M: list[list[Scalar]] = [[0.0] * n for _ in range(n)]
        for j, (inertia, S) in enumerate(zip(self.carried, self.axes, strict=True)):
            momentum = inertia.momentum(S)
            for i in self._before(j):
                M[i][j] = M[j][i] = self.axes[i].dot(momentum)
            M[j][j] = M[j][j] + self.arm.bodies[j].armature
        return M

    def twists(self, velocity: Any) -> list[Twist]:
        """Return the twist of each body."""
        found: list[Twist] = []
        for k, body in enumerate(self.arm.bodies):
            own = self.axes[k].times(velocity[k])
            found.append(own if body.parent < 0 else found[body.parent] + own)
        return found

    def axis_rates(self, velocity: Any) -> list[Twist]:
        """Return Ṡ, by joint."""
        twists = self.twists(velocity)
        parents = [body.parent for body in self.arm.bodies]
        return [STILL if parents[k] < 0 else twists[parents[k]].moved(S) for k, S in enumerate(self.axes)]

    def coriolis_matrix(self, velocity: Any) -> list[list[Scalar]]:
        """Return C of the Christoffel symbols, rows of entries."""
        n, twists, rates = len(self.arm), self.twists(velocity), self.axis_rates(velocity)
        gyrations = self._gathered([Gyration.of(inertia, v) for inertia, v in zip(self.own, twists, strict=True)])
        C: list[list[Scalar]] = [[0.0] * n for _ in range(n)]
        for j in range(n):
            S, rate, inertia, gyration = self.axes[j], rates[j], self.carried[j], gyrations[j]
            force, momentum, turned = inertia.momentum(rate) + gyration.along(S), inertia.momentum(S), gyration.back(S)
            for i in self._before(j):
                C[i][j] = self.axes[i].dot(force)
                if i != j:
                    C[j][i] = rates[i].dot(momentum) + dot(self.axes[i].angular, turned)
        return C

    def inverse_dynamics(self, velocity: Any, along: Any, acceleration: Any) -> list[Scalar]:
        """Return M a + C(q, q̇)s + g for a velocity s and an acceleration a, entry by entry; no matrix is formed."""
        twists, rates = self.twists(velocity), self.axis_rates(velocity)
        flows = self.twists(along)
        changes: list[Twist] = []
        forces: list[Twist] = []
        for k, body in enumerate(self.arm.bodies):
            own = self.axes[k].times(acceleration[k]) + rates[k].times(along[k])
            fall = Twist(scale(-1.0, self.arm.gravity), NOTHING)
            changes.append(own + (fall if body.parent < 0 else changes[body.parent]))
            gyration = Gyration.of(self.own[k], twists[k])
            forces.append(self.own[k].momentum(changes[k]) + gyration.along(flows[k]))
        forces = self._gathered(forces)
        return [
            S.dot(force) + body.armature * a
            for S, force, body, a in zip(self.axes, forces, self.arm.bodies, acceleration, strict=True)
        ]

    def mass_matrix_derivative(self) -> list[list[list[Scalar]]]:
        """Return ∂M/∂q, [k] of q_k: rows of entries.

        What joint k moves as a whole does not change: ∂M_ij/∂q_k = S_iᵀ(S_k ×* I_jᶜS_j) for i before k before or at j,
        S_iᵀ(S_k×*I_kᶜ − I_kᶜS_k×)S_j for i and j before k, else 0.
        """
        n = len(self.arm)
        D: list[list[list[Scalar]]] = [[[0.0] * n for _ in range(n)] for _ in range(n)]
        momenta = [inertia.momentum(S) for inertia, S in zip(self.carried, self.axes, strict=True)]
        for j in range(n):
            for k in self._before(j):
                force = self.axes[k].moved_force(momenta[j])
                for i in self._before(k)[:-1]:
                    D[k][i][j] = D[k][j][i] = self.axes[i].dot(force)
        for k in range(n):
            before, change = self._before(k)[:-1], self.carried[k].rate(self.axes[k])
            for place, j in enumerate(before):
                force = change.momentum(self.axes[j])
                for i in before[: place + 1]:
                    D[k][i][j] = D[k][j][i] = self.axes[i].dot(force)
        return D

    # --- frames -----------------------------------------------------------------------------------

    def frame(self, index: int) -> tuple[Vector, Rows]:
        """Return where a frame of the model is in the world, and how it is turned."""
        frame = self.arm.frames[index]
        r, R, joint = _vector(frame.placement.translation), _rows(frame.placement.rotation), frame.parentJoint - 1
        if joint < 0:
            return r, R
        above = self.rotations[joint]
        return add(self.origins[joint], turn(above, r)), product(above, R)

    def frame_jacobian(self, index: int, reference: str) -> list[list[Scalar]]:
        """Return 𝒥, six rows of entries, in "local", "local_world_aligned" or "world"."""
        r, R = self.frame(index)
        columns = {j: _seen(self.axes[j], r, R, reference) for j in self._moving(index)}
        return self._rows_of(columns)

    def frame_jacobian_rate(self, index: int, velocity: Any, reference: str) -> list[list[Scalar]]:
        """Return 𝒥̇ along a velocity, six rows of entries."""
        (r, R), rates, moving = self.frame(index), self.axis_rates(velocity), self._moving(index)
        if not moving:
            return self._rows_of({})
        twist = self.twists(velocity)[moving[-1]]
        r_rate = add(twist.linear, cross(twist.angular, r))
        columns = {}
        for j in moving:
            S, change = self.axes[j], rates[j]
            if reference == "world":
                columns[j] = change
                continue
            linear = add(add(change.linear, cross(change.angular, r)), cross(S.angular, r_rate))
            column = Twist(linear, change.angular)
            if reference == "local":
                aligned = _seen(S, r, R, "local_world_aligned")
                back = scale(-1.0, twist.angular)
                column = Twist(
                    turn_back(R, add(linear, cross(back, aligned.linear))),
                    turn_back(R, add(change.angular, cross(back, aligned.angular))),
                )
            columns[j] = column
        return self._rows_of(columns)

    def _moving(self, index: int) -> list[int]:
        return self.arm.supports[self.arm.frames[index].parentJoint]

    def _rows_of(self, columns: dict[int, Twist]) -> list[list[Scalar]]:
        flat = [(*columns.get(j, STILL).linear, *columns.get(j, STILL).angular) for j in range(len(self.arm))]
        return [list(row) for row in zip(*flat, strict=True)]


def _seen(S: Twist, r: Vector, R: Rows, reference: str) -> Twist:
    """Return a joint's twist at a frame's origin, in one of the frames of reference."""
    if reference == "world":
        return S
    linear = add(S.linear, cross(S.angular, r))
    if reference == "local_world_aligned":
        return Twist(linear, S.angular)
    return Twist(turn_back(R, linear), turn_back(R, S.angular))


def _turned(axis: Vector, q: Scalar) -> Rows:
    """Return the rotation by q about a unit axis."""
    from phcontrol.compilation.symbol import Symbol

    sine, cosine = (q.sin(), q.cos()) if type(q) is Symbol else (float(np.sin(q)), float(np.cos(q)))
    x, y, z = axis
    rest = 1.0 - cosine

    def entry(i: int, j: int, odd: Scalar) -> Scalar:
        if i == j:
            square = axis[i] * axis[i]
            return 1.0 if square == 1.0 else cosine + square * rest
        return axis[i] * axis[j] * rest + odd * sine

    return (
        (entry(0, 0, 0.0), entry(0, 1, -z), entry(0, 2, y)),
        (entry(1, 0, z), entry(1, 1, 0.0), entry(1, 2, -x)),
        (entry(2, 0, -y), entry(2, 1, x), entry(2, 2, 0.0)),
    )
