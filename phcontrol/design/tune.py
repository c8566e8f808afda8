"""Gains that make an objective small over scenarios."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from scipy.optimize import differential_evolution, minimize

from phcontrol._validation import Array, choice, count, finite_array, flag, positive
from phcontrol.analysis.linearization import linearize
from phcontrol.compilation.errors import CompilationWarning
from phcontrol.controllers.controller import Controller
from phcontrol.controllers.parameters import Gain
from phcontrol.controllers.registry import make_controller
from phcontrol.design.drawn_loops import DrawnLoops
from phcontrol.design.trial import Trial
from phcontrol.design.tuned_gains import TunedGains
from phcontrol.exceptions import InvalidArgumentError, PHControlError, UnknownNameError
from phcontrol.mechanics.system import MechanicalSystem
from phcontrol.simulation.closed_loop import simulate
from phcontrol.simulation.simulate_many import simulate_many

_REFUSED = 1e30  # in place of infinity, with which a search cannot calculate
_FIRST = 0.4  # of the logarithm of a factor: the search's first step
_TOLERANCE, _CHANGE = 1e-3, 1e-5  # of that logarithm, and of the objective, at which it ends

Runner = Callable[[Controller, Any], Any]


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
    method: Literal["nelder-mead", "evolution"] = "nelder-mead",
    evaluations: int = 150,
    period: float | None = None,
    delay: int = 1,
    seed: int = 0,
) -> TunedGains:
    """Make gains that minimise an objective over scenarios, without ever taking some whose loop is unstable.

    Each gain is multiplied by a factor, or by one a joint (F^½K F^½, which stays positive definite); the search is in
    the factors' logarithms, inside bounds. It is derivative-free: Nelder and Mead's simplex, or differential evolution
    for objectives with several minima. Gains whose loop about its rest has a mode that grows, with ``period`` as a
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
        method: "nelder-mead" or "evolution".
        evaluations: how many sets of gains are tried at most.
        period: for which torques are held [s].
        delay: by how many periods they are late.
        seed: of the evolution.

    Raises:
        InvalidArgumentError: no scenarios, no gains, a sweep that varies gains or is of another law or arm, or the
            gains to begin with are refused.

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
        scenarios, run = _drawn(law, over), run or _compiled
    else:
        scenarios = list(over)
    if not scenarios:
        raise InvalidArgumentError("over", "has no scenarios")
    choice("combine", combine, ("mean", "max"))
    choice("method", method, ("nelder-mead", "evolution"))
    most = count("evaluations", evaluations, minimum=2)
    if period is not None:
        positive("period", period)
    low, high = _bounds(bounds)
    search = _Search(
        law, _names(law, gains, per_joint), flag("per_joint", per_joint), scenarios, objective, run or _simulated,
        combine, period, count("delay", delay, minimum=0),
    )  # fmt: skip
    start = np.zeros(search.size)
    if search.cost(start) >= _REFUSED:
        raise InvalidArgumentError("controller", f"begins with gains that are refused: {search.history[0].reason}")
    limits = [(low, high)] * search.size
    if method == "nelder-mead":
        simplex = np.vstack([start, np.clip(start + _FIRST * np.eye(search.size), low, high)])
        options = {
            "maxfev": most - 1, "xatol": _TOLERANCE, "fatol": _CHANGE * abs(search.history[0].value),
            "initial_simplex": simplex,
        }  # fmt: skip
        found = minimize(search.cost, start, method="Nelder-Mead", bounds=limits, options=options)
    else:
        population = max(2, min(15, most // (4 * search.size)))
        generations = max(1, (most - 1) // (population * search.size) - 1)
        found = differential_evolution(
            search.cost, limits, x0=start, seed=seed, popsize=population, maxiter=generations, tol=_TOLERANCE,
            polish=False,
        )  # fmt: skip
    best = min(search.history, key=lambda trial: trial.value)
    changed = search.gains(np.log(np.concatenate([best.factors[name] for name in search.names])))
    return TunedGains(
        law.changed(**changed), changed, best.value, search.history[0].value, tuple(search.history), bool(found.success)
    )


class _Search:
    """The objective as a function of the factors' logarithms, with a memory."""

    def __init__(
        self,
        law: Controller,
        names: tuple[str, ...],
        per_joint: bool,
        scenarios: list[Any],
        objective: Callable[[Any], float],
        run: Runner,
        combine: str,
        period: float | None,
        delay: int,
    ) -> None:
        self.law, self.names, self._scenarios, self._objective, self._run = law, names, scenarios, objective, run
        self._combine = np.mean if combine == "mean" else np.max
        self._period, self._delay = period, delay
        self._begun = {name: np.array(getattr(law, name), dtype=float) for name in names}
        self._each = law.system.n if per_joint else 1
        self.history: list[Trial] = []

    @property
    def size(self) -> int:
        """How many factors there are."""
        return self._each * len(self.names)

    def gains(self, logarithms: Array) -> dict[str, Array]:
        """Return the gains."""
        made = {}
        for name, part in zip(self.names, np.split(np.asarray(logarithms), len(self.names)), strict=True):
            root = np.exp(0.5 * part)
            made[name] = self._begun[name] * (root[:, None] * root if len(root) > 1 else float(root[0]) ** 2)
        return made

    def cost(self, logarithms: Array) -> float:
        """Return the objective of all scenarios."""
        parts = np.split(np.exp(np.asarray(logarithms)), len(self.names))
        factors = {name: tuple(map(float, part)) for name, part in zip(self.names, parts, strict=True)}
        value, reason = self._valued(self.gains(logarithms))
        self.history.append(Trial(factors, value, reason))
        return value if math.isfinite(value) else _REFUSED

    def _valued(self, gains: dict[str, Array]) -> tuple[float, str]:
        try:
            law = self.law.changed(**gains)
            reason = self._unstable(law)
            if reason:
                return math.inf, reason
            values = [float(self._objective(self._run(law, scenario))) for scenario in self._scenarios]
        except PHControlError as error:
            return math.inf, str(error)
        value = float(self._combine(values))
        return (value, "") if math.isfinite(value) else (math.inf, "the objective is not finite")

    def _unstable(self, law: Controller) -> str:
        """Return why a loop is not to be run; laws that follow something have no rest to look about."""
        if law.time_span or law.lacks_minimum.startswith("stability in contact"):
            return ""
        loop = linearize(law, law.system, exact=False)
        if (loop.eigenvalues.real - loop.uncertainty > 0.0).any():
            return "a mode of the loop about its rest grows"
        if self._period is not None and not loop.sampled(self._period, self._delay).stable:
            return f"the loop is not stable with a torque held for {self._period:g} s and {self._delay} periods late"
        return ""


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


def _compiled(law: Controller, scenario: Any) -> Any:
    """Return the log of a run of a sweep. Raises PHControlError where it failed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CompilationWarning)
        (outcome,) = simulate_many(**scenario, controller=law, workers=1, progress=False)
    if outcome.error:
        raise PHControlError(outcome.error)
    return outcome.value


def _simulated(law: Controller, scenario: Any) -> Any:
    """Return the log of the law on its own model, or on the scenario's ``system``."""
    if not isinstance(scenario, Mapping):
        raise InvalidArgumentError(
            "over", f"must hold dictionaries for simulate(), but one is {type(scenario).__name__}"
        )
    return simulate(**({"system": law.system, "controller": law} | dict(scenario)))
