"""One source for one run at a time and for several in the lanes of a vector: what its words mean in C."""

from __future__ import annotations

LANES = 8
"""Runs in one vector of doubles: one register of AVX-512, two of AVX, four of SSE or NEON."""

_COMMON = """
#include <math.h>
#include <stddef.h>
"""

_ONE = (
    _COMMON
    + """
typedef double real;
typedef long long mask; /* all bits, or none */
#define LANES 1
#define EVERY (-1LL)
#define SAME(x) (x)
#define AT(x, lane) (x)
#define WAY(found) (-(mask)(found))
#define TEST(condition) (-(mask)(condition))
static inline int any(mask m) { return m != 0; }
static inline real choose(mask m, real a, real b) { return m ? a : b; }
static inline mask chosen(mask m, mask a, mask b) { return m ? a : b; }
static inline real v_fabs(real x) { return fabs(x); }
"""
)

_UNARY = ("exp", "log", "tan", "asin", "acos", "atan", "tanh", "floor", "ceil", "log1p", "expm1", "sqrt", "asinh")
_BINARY = ("fmod", "atan2", "pow", "hypot", "copysign")


def _each(names: tuple[str, ...], arguments: str, call: str) -> str:
    """Return functions that ask C's own in each lane: what a lane computes is what one run computes."""
    return "\n".join(
        f"static inline real v_{name}({arguments}) {{ real r; "
        f"for (int i = 0; i < LANES; i++) r[i] = {name}({call}); return r; }}"
        for name in names
    )


_MANY = (
    _COMMON
    + f"""
#define LANES {LANES}
typedef double real __attribute__((vector_size(8 * LANES)));
typedef long long mask __attribute__((vector_size(8 * LANES)));
#define NONE ((mask){{0}})
#define EVERY (~NONE)
#define SAME(x) ((real){{{", ".join(["(x)"] * LANES)}}})
#define AT(x, lane) ((x)[lane])
#define WAY(found) (found)
#define TEST(condition) ((mask)(condition))
#define TRUTH(condition) ((real)((mask)(condition) & (NONE + 0x3ff0000000000000LL)))
static inline int any(mask m) {{
  long long found = 0;
  for (int i = 0; i < LANES; i++) found |= m[i];
  return found != 0;
}}
static inline mask chosen(mask m, mask a, mask b) {{ return (a & m) | (b & ~m); }}
static inline real choose(mask m, real a, real b) {{ return (real)chosen(m, (mask)a, (mask)b); }}
static inline real v_fabs(real x) {{ return (real)((mask)x & (NONE + 0x7fffffffffffffffLL)); }}
static inline real v_fmin(real a, real b) {{ return choose((mask)(a < b), a, b); }}
static inline real v_fmax(real a, real b) {{ return choose((mask)(a > b), a, b); }}
static inline void v_sincos(real x, real *s, real *c) {{
  for (int i = 0; i < LANES; i++) {{
    const double a = x[i];
    (*s)[i] = sin(a);
    (*c)[i] = cos(a);
  }}
}}
static inline real v_sin(real x) {{ real r; for (int i = 0; i < LANES; i++) r[i] = sin(x[i]); return r; }}
static inline real v_cos(real x) {{ real r; for (int i = 0; i < LANES; i++) r[i] = cos(x[i]); return r; }}
{_each(_UNARY, "real x", "x[i]")}
{_each(_BINARY, "real x, real y", "x[i], y[i]")}
"""
)


def prelude(lanes: bool) -> str:
    """Return the head of a C file: ``real`` and ``mask`` as numbers, or as vectors of ``LANES`` of them.

    A mask has all bits of a lane set, or none. Vectors are GCC's and Clang's; no function of C's library is replaced,
    and nothing is reordered, so that each lane computes what a run by itself does.
    """
    return _MANY if lanes else _ONE
