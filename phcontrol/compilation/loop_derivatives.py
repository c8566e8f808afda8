"""Exact derivatives of a closed loop, from the traced law and the traced plant."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from phcontrol._differences import BEND, TINY, central_difference, slope_change
from phcontrol._validation import Array, choice, vector
from phcontrol.compilation.compiled_law import CompiledLaw, need_casadi
from phcontrol.compilation.errors import CompilationError
from phcontrol.compilation.loop_jacobian import LoopJacobian
from phcontrol.controllers.controller import Controller, check_loop
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.sensors.measured import measure_truly
from phcontrol.vision.scene import Scene

if TYPE_CHECKING:
    from phcontrol.compilation.differentiated import Differentiated

TOLERANCE = 1e-6
"""By how much, relatively, exact derivatives may differ from differences of the interpreted loop along a direction."""
_DIRECTIONS = 3  # of that check
_STEPS = (1e-4, 1e-6, 1e-7)  # of its differences: the small ones where a second derivative jumps, as of |v|v at 0
_GAIN_STEP = 1e-3  # of a gain, over which the law's numbers are differentiated
_KEPT = 12  # branches that are kept


class _Branches(NamedTuple):
    """What was differentiated of the law and of the plant so far, branch by branch."""

    law: list[Differentiated]
    plant: list[Differentiated]


class LoopDerivatives:
    """The derivatives of a closed loop ẏ = f(y, f_e, t), y = (q, q̇, controller state), to the last digits.

    Law and plant are traced with symbols (:func:`compile_law` does the same) and CasADi differentiates the expressions;
    no compiler is needed, casadi is (extra ``compile``). At each instant the branches are those that the law takes
    there, and their guards are checked. The result is held against differences of the interpreted loop, which asks
    Pinocchio, along random directions, and refused beyond 1e-6, relatively: in a kink there is no derivative.

    Args:
        controller: the law. A compiled one is taken as the law that it was made of.
        system: the plant; the law's own model where it is not given.
        scene: what there is to see, for laws that need features.

    Raises:
        CompilationError: casadi is not installed.

    Example:
        >>> from phcontrol import LoopDerivatives, MechanicalSystem, load_robot, make_controller
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> law = make_controller("energy_shaping", system)
        >>> found = LoopDerivatives(law).at(0.0, system.robot.home)
        >>> found.state.shape, found.force.shape
        ((4, 4), (4, 2))
    """

    def __init__(
        self, controller: Controller, system: MechanicalSystem | None = None, scene: Scene | None = None
    ) -> None:
        plant = getattr(controller, "system", None) if system is None else system
        check_loop(controller, plant)
        assert plant is not None
        need_casadi()
        self._law = controller.interpreted if isinstance(controller, CompiledLaw) else controller
        self._plant, self._scene = plant, scene
        self._branches = _Branches([], [])

    def at(
        self,
        time: float,
        position: ArrayLike,
        velocity: ArrayLike | None = None,
        state: ArrayLike | None = None,
        force: ArrayLike | None = None,
        *,
        parameters: bool = False,
    ) -> LoopJacobian:
        """Return the derivatives at an instant.

        Args:
            time: t [s].
            position: q [rad].
            velocity: q̇ [rad/s]; 0 if not given.
            state: the law's own; its initial state there if not given.
            force: f_e [N·m]; 0 if not given.
            parameters: those with respect to the law's numbers and the plant's inertias too; the columns are none else.

        Raises:
            NotTraceableError: the law cannot be traced there; names the line.
            CompilationError: there is no derivative there, or what was found is not that of the interpreted loop.
        """
        from phcontrol.compilation.differentiated import differentiated_law, differentiated_plant
        from phcontrol.compilation.trace import Instant

        n, law, plant = self._plant.n, self._law, self._plant
        q = vector("position", position, n)
        v = np.zeros(n) if velocity is None else vector("velocity", velocity, n)
        f = np.zeros(n) if force is None else vector("force", force, n)
        view = law.system.at(q, v)
        z = law.initial_state(view) if state is None else vector("state", state, law.state_size)
        measured = measure_truly(plant.at(q, v), f, law.needs, self._scene)
        instant = Instant(float(time), q, v, z, measured)
        torque = law.evaluate(instant.time, view, z, measured).torque

        def of_law() -> Differentiated:
            return differentiated_law(law, instant)

        def of_plant() -> Differentiated:
            return differentiated_plant(plant, law, self._scene, q, v, torque, f)

        m = np.concatenate([np.zeros(0), *(np.asarray(part) for part in measured if part is not None)])
        lawful = _found(self._branches.law, [np.array([time]), q, v, z, m], of_law)
        bodily = _found(self._branches.plant, [q, v, torque, f], of_plant)
        dt, dq, dv, dz, dm = lawful.slopes([np.array([time]), q, v, z, m])
        pq, pv, pu, pf = bodily.slopes([q, v, torque, f])
        own, inertias = lawful.parameters, bodily.parameters
        d_numbers = own([np.array([time]), q, v, z, m]) if parameters else np.zeros((len(dq), 0))
        d_inertias = inertias([q, v, torque, f]) if parameters else np.zeros((len(pq), 0))
        moving = np.hstack([pq, pv])
        found = LoopJacobian(
            plant=moving[:n],
            plant_torque=pu[:n],
            plant_force=pf[:n],
            measured=moving[n:],
            measured_force=pf[n:],
            law=np.hstack([dq, dv, dz]),
            law_measured=dm,
            law_time=dt[:, 0],
            law_numbers=d_numbers,
            plant_inertias=d_inertias[:n],
            measured_inertias=d_inertias[n:],
        )
        self._check(found, instant.time, np.concatenate([q, v, z]), f)
        return found

    def rate(self, time: float, y: Array, force: Array) -> Array:
        """Return ẏ of the interpreted loop, whose quantities are Pinocchio's."""
        n, law = self._plant.n, self._law
        x = self._plant.at(y[:n], y[n : 2 * n])
        measured = measure_truly(x, force, law.needs, self._scene)
        command = law.evaluate(time, x.seen_by(law.system), y[2 * n :], measured)
        return np.concatenate([x.velocity, x.acceleration(command.torque, force), command.state_rate])

    def number_slope(self, name: str, direction: ArrayLike | None = None) -> Array:
        """Return how the law's numbers change with a gain or another argument of it, along a direction, shape (p,).

        ``found.numbers @ derivatives.number_slope("stiffness")`` is ∂ẏ/∂K_p, for all of K_p as one: direction is K_p
        itself if it is not given. Numbers are what the law's constructor made of its arguments; they are differentiated
        by differences of fourth order, which are exact where they are the arguments themselves.

        Args:
            name: an argument of the law, as its constructor names it.
            direction: of the same shape.
        """
        from phcontrol.compilation.law_inputs import law_numbers

        law = self._law
        choice("name", name, list(law.parameters))
        value = np.asarray(getattr(law, name), dtype=float)
        along = value if direction is None else np.broadcast_to(np.asarray(direction, dtype=float), value.shape)
        step = (
            _GAIN_STEP * max(float(np.abs(value).max(initial=0.0)), 1e-300) / float(np.abs(along).max(initial=1e-300))
        )
        slope: Array = central_difference(lambda h: law_numbers(law.changed(**{name: value + h * along})), step)
        return slope

    def _check(self, found: LoopJacobian, time: float, y: Array, force: Array) -> None:
        """Raise CompilationError unless the derivatives are those of the interpreted loop along random directions."""
        generator, (A, B) = np.random.default_rng(0), (found.state, found.force)
        for _ in range(_DIRECTIONS):
            dy, df = generator.choice([-1.0, 1.0], y.size), generator.choice([-1.0, 1.0], force.size)

            def along(h: float, dy: Array = dy, df: Array = df) -> Array:
                return self.rate(time, y + h * dy, force + h * df)

            slope, size = A @ dy + B @ df, np.abs(A) @ np.abs(dy) + np.abs(B) @ np.abs(df)
            unit = np.maximum(size, 1e-3 * max(float(size.max()), 1e-300))
            off = min(float((np.abs(central_difference(along, h) - slope) / unit).max()) for h in _STEPS)
            bend = float((np.abs(slope_change(along, TINY)) / unit).max())
            if not (off <= TOLERANCE and bend <= BEND):
                raise CompilationError(
                    f"{self._law.name} has no derivative there, or not the one that was found: along a direction it "
                    f"differs from differences of the interpreted loop by {off:.1e}, relatively, ahead from behind by "
                    f"{bend:.1e}"
                )


def _found(known: list[Differentiated], values: list[Array], make: Callable[[], Any]) -> Differentiated:
    """Return what was differentiated on the branches that hold at some inputs, made if there is none yet."""
    for one in known:
        if one.holds(values):
            return one
    made: Differentiated = make()
    if not made.holds(values):
        raise CompilationError("what is to be differentiated is not finite there")
    known.append(made)
    del known[:-_KEPT]
    return made
