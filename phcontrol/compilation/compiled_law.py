"""A law that runs in C."""

from __future__ import annotations

import ctypes
import importlib.util
import sys
import time
import warnings
from functools import cache
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from phcontrol._validation import Array
from phcontrol.compilation.cache import compiled, discard
from phcontrol.compilation.caller import Caller
from phcontrol.compilation.compiler import find_compiler
from phcontrol.compilation.errors import CompilationError, CompilationWarning
from phcontrol.controllers.command import Command
from phcontrol.controllers.controller import Controller, check_loop
from phcontrol.mechanics.state import MechanicalState
from phcontrol.mechanics.system import MechanicalSystem, check_system
from phcontrol.sensors.measured import NOTHING, Measured

if TYPE_CHECKING:
    from phcontrol.compilation.law_inputs import Bodies
    from phcontrol.compilation.trace import Layout, TracedLaw

TOLERANCE = 1e-9
"""By how much, relatively, a compiled law may differ from the interpreted one, on Pinocchio's numbers."""
INSTALL = "pip install 'phcontrol[compile]'"

_TRACED, _CHECKED = 48, 24  # instants

Law = TypeVar("Law", bound=Controller)


class CompilationReport(NamedTuple):
    """What was compiled, and what it took."""

    ways: int
    """How many ways through the law's branches are in it."""
    operations: int
    """Of arithmetic, in the dearest of them."""
    difference: float
    """Largest relative difference from the interpreted law at random states."""
    covered: float
    """Share of those states at which it did not fall back to the interpreted law."""
    trace_time: float
    """[s]."""
    compile_time: float
    """[s]; that of a look into the cache, where it was there."""
    library: Path
    """The shared object."""


class _ChangedError(CompilationError):
    """A law is not what it was when it was compiled."""


class CompiledLaw(Controller):
    """What a compiled law has beside the law that it was made of. Made by :func:`compile_law`.

    Its promises (storage, target, port) are the law's own, interpreted; its torque comes from C. Where a branch goes
    another way than it was compiled for, where an input is not plain, and for a state of another model, the interpreted
    law answers: ``step.counts`` says how often.
    """

    interpreted: Controller
    """The law that it was made of."""
    report: CompilationReport
    """What was compiled."""
    step: Any
    """``step(t, q, v, state, measured)``: the command for plain arrays, whose checks run in C."""
    _options: dict[str, Any]
    _structure: list[Any]
    _layout: Layout

    def evaluate(self, t: float, x: MechanicalState, state: Array, measured: Measured = NOTHING) -> Command:
        """Return torque and state rate; see :meth:`Controller.evaluate`."""
        if x.system is not self.system:
            return self.interpreted.evaluate(t, x, state, measured)
        command: Command = self.step(float(t), x.position, x.velocity, state, measured)
        return command

    def changed(self, **arguments: Any) -> Any:
        """Return another with these arguments: of other gains or goals without a compiler, else compiled anew."""
        return self._like(self.interpreted.changed(**arguments))

    def on(self, system: MechanicalSystem) -> Any:
        """Return the same law for another plant: one with other inertias without a compiler, if these are inputs.

        A goal or gains that were not given to the law but made to suit its arm stay what they are.
        """
        check_system(system)
        return self._like(type(self.interpreted)(system, **self.interpreted._given))

    def _like(self, other: Controller) -> Any:
        """Return another law compiled: by the same code where that is the same, else anew."""
        from phcontrol.compilation.law_inputs import law_numbers, structure_of

        inertias = _bodies(other, self._options)
        if structure_of(other, inertias) != self._structure:
            return compile_law(other, **self._options)
        made = _made(other, self._layout, law_numbers(other, inertias), self.report.library, self._options)
        try:
            difference, covered = _checked(made)
        except CompilationError:  # a number that decides a branch may have gone another way
            return compile_law(other, **self._options)
        made.report = self.report._replace(difference=difference, covered=covered, trace_time=0.0, compile_time=0.0)
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the interpreted law; it is compiled again, out of the cache, where it is loaded."""
        return _restored, (self.interpreted, self._options)


def compile_law(controller: Law, *, inertias: bool = False, native: bool = False, progress: bool = False) -> Law:
    """Return a law that orders the same as another, computed in C, traced from the law's own file.

    It is a law of the same class with the same promises. Gains, goals and the tables of references are inputs of what
    is compiled: ``changed`` needs no compiler for them. It is held against the interpreted law, on Pinocchio's numbers,
    at random states before it is returned, and refused beyond a relative difference of 1e-9.

    Without a C compiler the law is returned as it is, and a CompilationWarning says so.

    Args:
        controller: any law whose arithmetic NumPy and ``math`` do; what else it does is refused, with the line.
        inertias: make masses, centres and moments of the arm's bodies inputs too, so that ``law.on(system)`` needs no
            compiler for another payload. It costs some operations: what is 0 of them is no longer left out.
        native: compile for this very processor (``-march=native``).
        progress: say on stderr what is being done, and how long it took.

    Raises:
        CompilationError: CasADi is not installed, the compiler fails, the cache is not the user's own, or what was
            compiled is not what the law orders.
        NotTraceableError: the law does what cannot be written as C; names the line.

    Example:
        >>> import numpy as np
        >>> from phcontrol import MechanicalSystem, compile_law, load_robot, make_controller
        >>> system = MechanicalSystem(load_robot("pera_shoulder"))
        >>> interpreted = make_controller("force_feedback", system)
        >>> law = compile_law(interpreted)
        >>> q, v, state = np.array([0.2, 0.1]), np.array([0.1, -0.2]), np.zeros(2)
        >>> torque = interpreted.evaluate(0.0, system.at(q, v), state).torque
        >>> bool(np.allclose(law.step(0.0, q, v, state).torque, torque, atol=1e-10))
        True
    """
    check_loop(controller, getattr(controller, "system", None))
    if isinstance(controller, CompiledLaw):
        return controller
    _check_names(controller)
    need_casadi()
    compiler = find_compiler()
    if compiler is None:
        warnings.warn(
            f"no C compiler was found (cc, gcc, clang, or what CC names): {controller.name} runs interpreted",
            CompilationWarning,
            stacklevel=2,
        )
        return controller
    from phcontrol.compilation.c_code import law_source
    from phcontrol.compilation.law_inputs import law_numbers, structure_of
    from phcontrol.compilation.watch import refuse_clocks_and_dice

    refuse_clocks_and_dice(controller, controller.name)
    say = _Progress(progress)
    start = time.perf_counter()
    say(f"{controller.name}: tracing")
    options = {"inertias": inertias, "native": native, "progress": progress}
    bodies = _bodies(controller, options)
    traced = _trace(controller, bodies)
    source, structure = law_source(traced), structure_of(controller, bodies)
    traced_at = time.perf_counter()
    say(f"{controller.name}: compiling {len(source.text) / 1000:.0f} kB of C")

    def loaded(library: Path) -> tuple[CompiledLaw, float, float]:
        made = _made(controller, traced.layout, traced.numbers, library, options)
        try:
            return made, *_checked(made)
        except _ChangedError as error:
            message = f"{controller.name} cannot be compiled: it changes while it is evaluated"
            raise CompilationError(message) from error

    library = compiled(source.text, compiler, native=native, accept=loaded)
    compiled_at = time.perf_counter()
    try:
        made, difference, covered = loaded(library)
    except CompilationError:
        discard(library)  # of an earlier time
        raise
    if structure_of(controller, bodies) != structure or not np.array_equal(
        law_numbers(controller, bodies), traced.numbers
    ):
        raise CompilationError(f"{controller.name} cannot be compiled: it changes while it is evaluated")
    made.report = CompilationReport(
        len(traced.traces), source.operations, difference, covered, traced_at - start, compiled_at - traced_at, library
    )
    say(f"{controller.name}: {source.operations} operations, {time.perf_counter() - start:.1f} s", last=True)
    return made  # type: ignore[return-value]


def _check_names(law: Controller) -> None:
    """Raise CompilationError where a law has a name that compiled laws have a use for."""
    for name in (*CompiledLaw.__annotations__, "_like"):
        if hasattr(law, name):
            raise CompilationError(f"{law.name} cannot be compiled: '{name}' of it must have another name")


def need_casadi() -> None:
    """Raise CompilationError, with what to install, where CasADi is missing."""
    if importlib.util.find_spec("casadi") is None:
        raise CompilationError(f"casadi is needed to write a law down as C: {INSTALL}")


def _bodies(law: Controller, options: dict[str, Any]) -> Bodies:
    """Return the bodies of a law's arm whose inertias are inputs."""
    from phcontrol.compilation.law_inputs import all_bodies

    return all_bodies(law.system, options.get("inertias", False))


def _trace(law: Controller, inertias: Bodies) -> TracedLaw:
    from phcontrol.compilation.instants import instants
    from phcontrol.compilation.trace import trace_law

    return trace_law(law, [instant for instant, _ in instants(law, _TRACED, seed=1)], inertias=inertias)


def _made(law: Controller, layout: Layout, numbers: Array, library: Path, options: dict[str, Any]) -> CompiledLaw:
    """Return the compiled law of an interpreted one."""
    from phcontrol.compilation.law_inputs import structure_of
    from phcontrol.compilation.watch import Watch

    made: CompiledLaw = object.__new__(_class_of(type(law)))
    made.__dict__.update(law.__dict__)
    watch = Watch(law, made)
    try:
        loaded = ctypes.CDLL(str(library))
        address = ctypes.cast(loaded.phcontrol_law, ctypes.c_void_p).value
    except (OSError, AttributeError) as error:
        raise CompilationError(f"{library} cannot be loaded: {error}") from error
    sizes = dict(layout.measured)
    system = law.system

    def slowly(t: Any, q: Any, v: Any = None, state: Any = None, measured: Measured = NOTHING) -> Command:
        """Say what is wrong with the arguments, or ask the interpreted law."""
        changed = watch.changed()
        if changed:
            raise _ChangedError(
                f"{law.name} was changed after it was compiled ('{changed}' is not what it was): use changed(…), or "
                "compile it again"
            )
        own = np.zeros(law.state_size) if state is None else state
        return law.evaluate(float(t), system.at(q, v), own, measured)

    made.interpreted, made._layout, made._options = law, layout, options
    made._structure = structure_of(law, _bodies(law, options))
    force, total, features = (sizes.get(name, 0) for name in Measured._fields)
    lengths = force, total, features
    watched = watch.dicts, watch.lists, watch.arrays, watch.others
    made.step = Caller(address or 0, layout.joints, layout.state, lengths, numbers, slowly, Command, loaded, watched)
    return made


@cache
def _class_of(law: type[Controller]) -> type[CompiledLaw]:
    """Return the class of compiled laws of a class."""
    return type(f"Compiled{law.__name__}", (CompiledLaw, law), {"__doc__": law.__doc__, "__module__": law.__module__})


def _restored(law: Controller, options: dict[str, Any]) -> Controller:
    return compile_law(law, **options)


def _checked(made: CompiledLaw) -> tuple[float, float]:
    """Return the largest relative difference from the interpreted law, and at which share of states C answered.

    Asked at the instants at which it was traced, so that each way is looked at, and at others, of which the share is.

    Each difference is taken relative to the largest entry at its state, but at least to a thousandth of the largest at
    any. Raises CompilationError when it is beyond ``TOLERANCE``.
    """
    from phcontrol.compilation.instants import instants

    expected: list[Command] = []
    found: list[Command] = []
    own, counted = list(instants(made.interpreted, _TRACED, seed=1)), (0, 0)
    for instant, command in chain(own, instants(made.interpreted, _CHECKED, seed=2)):
        if len(found) == len(own):
            counted = made.step.counts
        answer = made.step(instant.time, instant.position, instant.velocity, instant.state, instant.measured)
        expected.append(command)
        found.append(answer)
    steps, fallbacks = (after - before for after, before in zip(made.step.counts, counted, strict=True))
    if not steps:
        raise CompilationError(f"{made.name} could not be checked: it answers at no random state")
    if made.step.counts[0] == made.step.counts[1]:
        raise CompilationError(f"{made.name} as compiled answers at no random state")
    worst = 0.0
    for which in range(2):
        sizes = [float(np.abs(command[which]).max(initial=0.0)) for command in expected]
        least = max(1e-3 * max(sizes), 1e-12)
        for size, command, answer in zip(sizes, expected, found, strict=True):
            difference = float(np.abs(answer[which] - command[which]).max(initial=0.0)) / max(size, least)
            worst = max(worst, difference)
    if not worst <= TOLERANCE:
        raise CompilationError(
            f"{made.name} as compiled is refused: it differs from the interpreted law by {worst:.1e}, relatively"
        )
    return worst, 1.0 - fallbacks / steps


class _Progress:
    """One line on stderr that changes."""

    def __init__(self, shown: bool) -> None:
        self._shown = shown

    def __call__(self, text: str, last: bool = False) -> None:
        if self._shown:
            print(f"\r\x1b[K{text}", end="\n" if last else "", file=sys.stderr, flush=True)
