"""Gains that make an objective small over scenarios."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Literal

import numpy as np
from scipy.optimize import differential_evolution, minimize

from phcontrol._validation import Array, choice, count, finite_array, flag, positive
from phcontrol.compilation.errors import CompilationWarning
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.parameters import Gain
from phcontrol.controllers.registry import make_controller
from phcontrol.design.drawn_loops import DrawnLoops
from phcontrol.design.gain_search import REFUSED, GainSearch, Runner
from phcontrol.design.scenario_runs import compiled
from phcontrol.design.smooth_objective import SmoothObjective
from phcontrol.design.tuned_gains import TunedGains
from phcontrol.exceptions import InvalidArgumentError, PHControlError, UnknownNameError
from phcontrol.mechanics.system import MechanicalSystem

_FIRST = 0.4  # of the logarithm of a factor: the search's first step
_TOLERANCE, _CHANGE = 1e-3, 1e-5  # of that logarithm, and of the objective, at which it ends
_DESCENT = 1e-6  # of the objective, over what it began with: a change at which a descent ends


def tune(
    controller: Controller | str,
    objective: Callable[[Any], float],
    over: Iterable[Any] | DrawnLoops,
    *,
    system: MechanicalSystem | None = None,
    goal: Any = None,
    gains: Sequence[str] | None = None,
    per_joint: bool = False,
    bounds: tuple[float, float] = (0.1, 10.0),
    run: Runner | None = None,
    combine: Literal["mean", "max"] = "mean",
    method: Literal["gradient", "nelder-mead", "evolution"] | None = None,
    evaluations: int = 150,
    period: float | None = None,
    delay: int = 1,
    seed: int = 0,
) -> TunedGains:
    """Make gains that minimise an objective over scenarios, without ever taking some whose loop is unstable.

    Each gain is multiplied by a factor, or by one a joint (F^½K F^½, which stays positive definite); the search is in
    the factors' logarithms, inside bounds. An objective that says its slopes (:class:`SmoothObjective`, as
    :class:`QuadraticCost` does) is followed down its gradient by sequential quadratic programming (SciPy's SLSQP): the
    tangents of the compiled loop are carried along each run, and their gradient is held against differences of the
    objective before anything else (1e-6, relatively). For all others, and where the loop cannot be differentiated, the
    search is derivative-free: Nelder and Mead's simplex, or differential evolution for objectives with several minima;
    ``TunedGains.reason`` says why. Gains whose loop about its rest has a mode that grows, with ``period`` as a
    sampled loop too, are refused before anything is run, and so are runs that fail and objectives that are not finite.

    Args:
        controller: the law to begin with, or the name of one, with ``system`` and ``goal``.
        objective: of what ``run`` returns; smaller is better.
        over: the scenarios: for the default ``run`` dictionaries of keyword arguments of :func:`simulate`; or a
            :class:`Sweep`, each of whose runs is one, with the law that is tuned in place of its own. They are
            simulated compiled where that is possible.
        system: the model of the arm, for a name.
        goal: for a name.
        gains: which arguments are tuned; by default all positive definite gains that the law has.
        per_joint: a factor for each joint, and not one for each gain.
        bounds: of the factors.
        run: (law, scenario) -> what the objective is of; by default simulates the law on its own model.
        combine: "mean" or "max" of the objectives of all scenarios.
        method: "gradient", "nelder-mead" or "evolution"; None for gradients where there are some, and else the simplex.
        evaluations: how many sets of gains are tried at most, gradients counted too.
        period: for which torques are held [s].
        delay: by how many periods they are late.
        seed: of the evolution.

    Raises:
        InvalidArgumentError: no scenarios, no gains, a sweep that varies gains or is of another law or arm, the gains
            to begin with are refused, or gradients are asked for and there are none.

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, load_robot, tune
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> goal, start = system.robot.near_home(), system.robot.home
        >>> def error(log):
        ...     return float(np.abs(log.position - goal).mean())
        >>> scenarios = [{"q0": start, "duration": 0.3, "dt": 2e-3}]
        >>> found = tune("energy_shaping", error, scenarios, system=system, goal=goal, evaluations=15)
        >>> found.value < found.start_value
        True
    """
    law = _law(controller, system, goal)
    if isinstance(over, DrawnLoops):
        scenarios, run = _drawn(law, over), run or compiled
    else:
        scenarios = list(over)
    if not scenarios:
        raise InvalidArgumentError("over", "has no scenarios")
    choice("combine", combine, ("mean", "max"))
    if method is not None:
        choice("method", method, ("gradient", "nelder-mead", "evolution"))
    most = count("evaluations", evaluations, minimum=2)
    if period is not None:
        positive("period", period)
    limits = _bounds(bounds)
    search = GainSearch(
        law, _names(law, gains, per_joint), flag("per_joint", per_joint), scenarios, objective, run, combine, period,
        count("delay", delay, minimum=0),
    )  # fmt: skip
    start = np.zeros(search.size)
    if search.cost(start) >= REFUSED:
        raise InvalidArgumentError("controller", f"begins with gains that are refused: {search.history[0].reason}")
    used, reason, converged = method or "gradient", "", False
    if used == "gradient":
        converged, reason = _descended(search, limits, most)
        if reason and method == "gradient":
            raise InvalidArgumentError("method", f"is by gradients, and there are none: {reason}")
        if reason:
            used = "nelder-mead"
            if isinstance(objective, SmoothObjective):
                warnings.warn(f"the gains are tuned without gradients: {reason}", CompilationWarning, stacklevel=2)
    if used == "nelder-mead":
        converged = _by_simplex(search, limits, most)
    elif used == "evolution":
        converged = _evolved(search, limits, most, seed)
    best = min(search.history, key=lambda trial: trial.value)
    changed = search.gains(_point(search))
    return TunedGains(
        law.changed(**changed), changed, best.value, search.history[0].value, tuple(search.history), converged, used,
        reason, search.gradients, search.simulations,
    )  # fmt: skip


class _EnoughError(Exception):
    """All evaluations that were allowed have been used."""


def _descended(search: GainSearch, limits: tuple[float, float], most: int) -> tuple[bool, str]:
    """Go down the gradient; return whether that came to an end by itself, and why it could not be gone, or ""."""
    start = np.zeros(search.size)
    try:
        first = {start.tobytes(): (search.history[0].value, search.checked_gradient(start))}
    except PHControlError as error:
        return False, str(error)
    scale = abs(search.history[0].value) or 1.0

    def spend() -> None:
        if len(search.history) + search.gradients >= most:
            raise _EnoughError

    def cost(x: Array) -> float:
        if x.tobytes() in first:
            return first[x.tobytes()][0] / scale
        spend()
        return search.cost(x) / scale

    def gradient(x: Array) -> Array:
        if x.tobytes() in first:
            return first[x.tobytes()][1] / scale
        spend()
        return search.gradient(x) / scale

    try:
        found = minimize(
            cost, start, jac=gradient, method="SLSQP", bounds=[limits] * search.size,
            options={"ftol": _DESCENT, "maxiter": most},
        )  # fmt: skip
    except _EnoughError:
        return False, ""
    except PHControlError as error:
        return False, str(error)
    return bool(found.success), ""


def _by_simplex(search: GainSearch, limits: tuple[float, float], most: int) -> bool:
    """Search from the best point so far by Nelder and Mead's simplex; return whether that came to an end by itself."""
    start, left = _point(search), most - len(search.history) - search.gradients
    if left < 1:
        return False
    simplex = np.vstack([start, np.clip(start + _FIRST * np.eye(search.size), *limits)])
    options = {
        "maxfev": left, "xatol": _TOLERANCE, "fatol": _CHANGE * abs(search.history[0].value),
        "initial_simplex": simplex,
    }  # fmt: skip
    found = minimize(search.cost, start, method="Nelder-Mead", bounds=[limits] * search.size, options=options)
    return bool(found.success)


def _evolved(search: GainSearch, limits: tuple[float, float], most: int, seed: int) -> bool:
    """Search by differential evolution; return whether that came to an end by itself."""
    population = max(2, min(15, most // (4 * search.size)))
    generations = max(1, (most - 1) // (population * search.size) - 1)
    found = differential_evolution(
        search.cost, [limits] * search.size, x0=np.zeros(search.size), seed=seed, popsize=population,
        maxiter=generations, tol=_TOLERANCE, polish=False,
    )  # fmt: skip
    return bool(found.success)


def _point(search: GainSearch) -> Array:
    """Return the logarithms of the best factors so far."""
    best = min(search.history, key=lambda trial: trial.value)
    found: Array = np.log(np.concatenate([best.factors[name] for name in search.names]))
    return found


def _law(controller: Controller | str, system: MechanicalSystem | None, goal: Any) -> Controller:
    if isinstance(controller, str):
        if system is None:
            raise InvalidArgumentError("system", f"must be given with the name of a law, '{controller}'")
        return make_controller(controller, system, goal)
    if not isinstance(controller, Controller):
        raise InvalidArgumentError("controller", f"must be a law or its name, but is {type(controller).__name__}")
    if system is not None or goal is not None:
        raise InvalidArgumentError("system", "and goal go with the name of a law, and the law is given")
    return controller


def _names(law: Controller, gains: Sequence[str] | None, per_joint: bool) -> tuple[str, ...]:
    """Return which arguments are tuned: matrices that scale things, of all joints for a factor a joint."""
    known = []
    for name, parameter in law.parameters.items():
        value = getattr(law, name)
        if isinstance(value, np.ndarray) and value.ndim == 2 and (isinstance(parameter, Gain) or "stiffness" in name):
            known += [name] if not per_joint or len(value) == law.system.n else []
        elif isinstance(value, float) and value > 0.0 and "damping" in name and not per_joint:
            known.append(name)
    if isinstance(gains, str):
        raise InvalidArgumentError("gains", f"must be a list of names, but is '{gains}'")
    for name in gains or ():
        if name not in known:
            raise UnknownNameError("gain", name, known, f" of {law.name} that can be tuned")
    if not known or (gains is not None and not gains):
        raise InvalidArgumentError("gains", f"of {law.name} that can be tuned are {', '.join(known) or 'none'}")
    return tuple(known if gains is None else gains)


def _bounds(bounds: Any) -> tuple[float, float]:
    both = finite_array("bounds", bounds)
    if both.shape != (2,) or not 0.0 < both[0] <= 1.0 <= both[1] or both[0] == both[1]:
        raise InvalidArgumentError("bounds", f"must be two factors about 1, like (0.1, 10), but are {bounds}")
    return float(np.log(both[0])), float(np.log(both[1]))


def _drawn(law: Controller, sweep: DrawnLoops) -> list[Any]:
    """Return the runs of a sweep without their law, which must be one of the same kind, arm and goal in all."""
    loops = [sweep.loop(run) for run in range(sweep.runs)]
    own = [loop.pop("controller") for loop in loops]
    if any(each is not own[0] for each in own):
        raise InvalidArgumentError("over", "varies gains of the law, and those are what is tuned")
    first, arm = own[0], own[0].system.robot
    if first.name != law.name or arm.joint_names != law.system.robot.joint_names:
        raise InvalidArgumentError(
            "over", f"is of {first.name} on {arm.name}, and what is tuned is {law.name} on {law.system.robot.name}"
        )
    return loops
