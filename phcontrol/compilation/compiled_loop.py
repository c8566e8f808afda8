"""Plant and law as one loop in C: integrated, sampled and recorded there."""

from __future__ import annotations

import copy
import ctypes
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi
import numpy as np

from phcontrol._validation import Array
from phcontrol.compilation.c_code import Function, function, law_source
from phcontrol.compilation.cache import compiled
from phcontrol.compilation.compiler import Compiler
from phcontrol.compilation.errors import CompilationError
from phcontrol.compilation.instants import instants
from phcontrol.compilation.law_inputs import law_numbers, structure_of
from phcontrol.compilation.symbol import Guards, Symbol, SymbolArray, symbols
from phcontrol.compilation.trace import TracedLaw, trace_law
from phcontrol.compilation.traced_state import TracedState, traced_system
from phcontrol.compilation.tracing import classes_of, refusal, tracing
from phcontrol.controllers.controller import Controller
from phcontrol.mechanics.system import MechanicalSystem

METHODS = ("semi_implicit_euler", "rk4")
"""The integrators that there are in C."""
DONE, NOT_COMPILED, NOT_FINITE = 0, 1, 2
"""What a run in C says: whether it came to its end, where a branch is not compiled, where it diverged."""

TRACED = 48
"""At how many instants a law is traced."""
_VECTOR = ctypes.POINTER(ctypes.c_double)

_LOOP = """
#define N {joints}
#define S {states}
#define Y (2 * N + S)

/* Torque of the law, clipped, and the rate of its state. */
static int act(double t, const double *y, const double *f, const double *p, const double *limit, double *u,
               double *rate) {{
  double m[{measured_room}] = {{0}}, out[N + S];
  for (int i = 0; i < Y; i++)
    if (!isfinite(y[i])) return 2;
  {measure}
  if (!phcontrol_law(t, y, y + N, y + 2 * N, m, p, out)) return 1;
  for (int i = 0; i < N + S; i++)
    if (!isfinite(out[i])) return 2;
  for (int i = 0; i < N; i++) u[i] = limit ? fmin(fmax(out[i], -limit[i]), limit[i]) : out[i];
  for (int i = 0; i < S; i++) rate[i] = out[N + i];
  return 0;
}}

/* dy/dt, and the torque that makes it: the held one, or the law's. */
static int field(double t, const double *y, const double *held, const double *f, const double *p, const double *limit,
                 double *u, double *dy) {{
  double m[2 * N];
  for (int i = 0; i < Y - 2 * N; i++) dy[2 * N + i] = 0.0;
  if (held) {{
    for (int i = 0; i < N; i++) u[i] = held[i];
  }} else {{
    const int status = act(t, y, f, p, limit, u, dy + 2 * N);
    if (status) return status;
  }}
  for (int i = 0; i < N; i++) m[i] = u[i], m[N + i] = f[i], dy[i] = y[N + i];
  return plant(t, y, y + N, NULL, m, NULL, dy + N) ? 0 : 1;
}}

int phcontrol_field(double t, const double *y, const double *f, const double *p, const double *limit, double *u,
                    double *dy) {{
  return field(t, y, NULL, f, p, limit, u, dy);
}}

/* Samples first to last of steps + 1: states [k] is given for the first, and made for each that follows.
   stride: of a sampled law; 0 for a continuous one. held: its torque and the rate of its state. */
int phcontrol_run(long first, long last, long steps, double dt, long stride, double period, int method,
                  const double *f, const double *limit, const double *p, double *held, double *states, double *torques,
                  long *reached) {{
  double a[Y], b[Y], c[Y], d[Y], z[Y], u[N];
  for (long k = first; k <= last; k++) {{
    const double t = (double)k * dt;
    double *y = states + k * Y, *next = y + Y;
    int status = 0;
    *reached = k;
    if (stride && k % stride == 0) {{
      for (int i = 0; i < Y - 2 * N; i++) y[2 * N + i] += period * held[N + i];
      status = act(t, y, f, p, limit, held, held + N);
      if (status) return status;
    }}
    const double *torque = stride ? held : NULL;
    if ((status = field(t, y, torque, f, p, limit, torques + k * N, a))) return status;
    if (k == steps) break;
    if (method == 0) {{
      for (int i = 0; i < Y; i++) next[i] = y[i] + dt * a[i];
      for (int i = 0; i < N; i++) next[i] = y[i] + dt * next[N + i];
    }} else {{
      for (int i = 0; i < Y; i++) z[i] = y[i] + 0.5 * dt * a[i];
      if ((status = field(t + 0.5 * dt, z, torque, f, p, limit, u, b))) return status;
      for (int i = 0; i < Y; i++) z[i] = y[i] + 0.5 * dt * b[i];
      if ((status = field(t + 0.5 * dt, z, torque, f, p, limit, u, c))) return status;
      for (int i = 0; i < Y; i++) z[i] = y[i] + dt * c[i];
      if ((status = field(t + dt, z, torque, f, p, limit, u, d))) return status;
      for (int i = 0; i < Y; i++) next[i] = y[i] + dt / 6.0 * ((b[i] + c[i]) * 2.0 + a[i] + d[i]);
    }}
    for (int i = 0; i < Y; i++)
      if (!isfinite(next[i])) return 2;
  }}
  return 0;
}}
"""

_MEASURE = {
    "external_force": "for (int i = 0; i < N; i++) m[{place} + i] = f[i];",
    "total_force": "if (!total(t, y, y + N, NULL, f, NULL, m + {place})) return 1;",
}


class CompiledLoop:
    """A plant under a law, in C. Raises CompilationError or NotTraceableError when it cannot be made.

    Args:
        plant: the arm.
        law: the interpreted law; its own model may differ from the plant.
        compiler: makes it.
        native: compile for this very processor.
    """

    def __init__(self, plant: MechanicalSystem, law: Controller, compiler: Compiler, native: bool = False) -> None:
        if any(name not in _MEASURE for name in law.needs):
            raise CompilationError(f"{law.name} needs more measured than forces, which no loop in C gives it")
        traced = trace_law(law, [instant for instant, _ in instants(law, TRACED, seed=1)])
        self.n, self.numbers = plant.n, traced.numbers
        self.plant, self.structure = plant, structure_of(law)
        self.library = compiled(_source(plant, law, traced), compiler, native=native, accept=_loaded)
        self._loaded = _loaded(self.library)
        self._run, self._field = self._loaded.phcontrol_run, self._loaded.phcontrol_field
        self._run.argtypes = [
            ctypes.c_long, ctypes.c_long, ctypes.c_long, ctypes.c_double, ctypes.c_long, ctypes.c_double, ctypes.c_int,
            *[_VECTOR] * 6, ctypes.POINTER(ctypes.c_long),
        ]  # fmt: skip
        self._field.argtypes = [ctypes.c_double, *[_VECTOR] * 6]

    def under(self, law: Controller) -> CompiledLoop | None:
        """Return the same loop under a law of other gains or goals, by the same code; None where that is another."""
        if structure_of(law) != self.structure:
            return None
        other = copy.copy(self)
        other.numbers = law_numbers(law)
        return other

    def is_of(self, law: Controller) -> bool:
        """Whether a law is still what was compiled: none of it was changed in place."""
        return structure_of(law) == self.structure and np.array_equal(law_numbers(law), self.numbers)

    def field(self, t: float, y: Array, force: Array, limit: Array | None) -> tuple[int, Array, Array]:
        """Return what a run would say there, ẏ and the torque."""
        rate, torque = np.zeros(y.size), np.zeros(self.n)
        pointers = [_pointer(value) for value in (y, force, self.numbers, limit, torque, rate)]
        return self._field(t, *pointers), rate, torque

    def run(
        self,
        steps: int,
        dt: float,
        method: str,
        force: Array,
        limit: Array | None,
        states: Array,
        torques: Array,
        *,
        stride: int = 0,
        period: float = 0.0,
        chunk: int = 5000,
        after: Callable[[int], None] = lambda k: None,
    ) -> tuple[int, int]:
        """Fill states (steps + 1, y) after the first row, and torques (steps + 1, n); return what and how far.

        The lock of the interpreter is free meanwhile. ``after`` is called after each ``chunk`` of samples.
        """
        held, reached = np.zeros(states.shape[1] - self.n), ctypes.c_long(0)
        for first in range(0, steps + 1, chunk):
            status = self._run(
                first, min(first + chunk - 1, steps), steps, dt, stride, period, METHODS.index(method),
                _pointer(force), _pointer(limit), _pointer(self.numbers), _pointer(held), _pointer(states),
                _pointer(torques), ctypes.byref(reached),
            )  # fmt: skip
            if status != DONE:
                return status, reached.value
            after(reached.value)
        return DONE, steps


def _loaded(library: Path) -> Any:
    """Return a library that has a loop in it."""
    try:
        found = ctypes.CDLL(str(library))
        _ = found.phcontrol_run, found.phcontrol_field
    except (OSError, AttributeError) as error:
        raise CompilationError(f"{library} cannot be loaded: {error}") from error
    return found


def _pointer(array: Array | None) -> Any:
    if array is None:
        return None
    if not array.flags.c_contiguous or array.dtype != np.float64:
        raise CompilationError("a loop in C takes contiguous arrays of float64")
    return array.ctypes.data_as(_VECTOR)


def _source(plant: MechanicalSystem, law: Controller, traced: TracedLaw) -> str:
    layout, place, measure = traced.layout, 0, []
    for name, size in layout.measured:
        measure.append(_MEASURE[name].format(place=place))
        place += size
    parts = [_of_plant(plant, law, "plant", lambda x, n, m: x.acceleration(m[:n], m[n:]), 2 * plant.n)]
    if "total_force" in law.needs:
        parts.append(_of_plant(plant, law, "total", lambda x, n, m: x.total_force(m), plant.n))
    loop = _LOOP.format(
        joints=layout.joints, states=layout.state, measured_room=max(1, place), measure="\n  ".join(measure)
    )
    return "\n".join([law_source(traced).text, "#include <stddef.h>", *(part.text for part in parts), loop])


def _of_plant(plant: MechanicalSystem, law: Controller, name: str, make: Callable[..., Any], size: int) -> Function:
    """Return a function of q, q̇ and forces of the plant as C."""
    guards, n = Guards(), plant.n
    inputs = [casadi.SX.sym(letter, count) for letter, count in zip("tqvsmp", (1, n, n, 0, size, 0), strict=True)]
    generator = np.random.default_rng(0)
    samples = {1: plant.robot.random_position(generator), 2: generator.normal(size=n), 4: generator.normal(size=size)}

    def entries(which: int) -> SymbolArray:
        pairs = zip(casadi.vertsplit(inputs[which]), samples[which], strict=True)
        return symbols([Symbol(part, float(value), guards) for part, value in pairs])

    q, v, m = entries(1), entries(2), entries(4)
    try:
        with tracing(classes_of(law, plant.friction, plant.potentials)):
            found = make(TracedState(traced_system(plant), q, v), n, m)
    except Exception as error:
        raise refusal(f"the plant {plant.robot.name}", error) from error
    outputs = [entry.expression if type(entry) is Symbol else casadi.SX(float(entry)) for entry in found]
    return function(name, inputs, guards.conditions, outputs)
