"""The closed loop in C with its tangents: how each number of it changes with a gain, a gain in each lane."""

from __future__ import annotations

FIELD = """
#define P {numbers}
#define M {measured_room}

/* Where there are numbers, their tangents are behind them: those of y at y + Y, of f at f + N, of u at u + N, of what
   is measured at m + M, of the loop's numbers at p + P. */

static void surroundings(run *c, double t, const real *y, real *f, real *rate) {{
  for (int i = 0; i < N; i++) f[i] = c->steady[i], f[N + i] = SAME(0.0);
  if (c->signals)
    for (int lane = 0; lane < LANES; lane++)
      if (c->signals[lane]) signal(c->signals[lane], t, lane, f);
#if {has_around}
  real out[2 * (N + B)];
  c->uncovered |= c->alive & ~around(c->alive, SAME(t), y, y + N, y + 2 * N + S, NULL, c->p + P_AROUND, out);
  for (int i = 0; i < N; i++) f[i] += out[i], f[N + i] += out[N + B + i];
  for (int i = 0; i < B; i++) rate[S + i] = out[N + i], rate[Y + S + i] = out[2 * N + B + i];
#else
  (void)y; (void)rate;
#endif
}}

#if {has_limits}
static void count_limits(run *c, mask wanted, double t, const real *y, const real *shown, const real *desired,
                         const real *u, real *rate) {{
  enum {{ K = {measured} + S + N }};
  real m[2 * K], counted[2 * S];
  mask clipped = EVERY ^ EVERY;
  for (int i = 0; i < {measured}; i++) m[i] = shown[i], m[K + i] = shown[M + i];
  for (int i = 0; i < S; i++) m[{measured} + i] = rate[i], m[K + {measured} + i] = rate[Y + i];
  for (int i = 0; i < N; i++) {{
    m[{measured} + S + i] = u[i] - desired[i];
    m[K + {measured} + S + i] = u[N + i] - desired[N + S + i];
    clipped |= wanted & TEST(u[i] - desired[i] != 0.0);
  }}
  if (!any(clipped)) return;
  const mask covered = clipped & under_limits(clipped, SAME(t), y, y + N, y + 2 * N, m, c->p, counted);
  c->uncovered |= clipped & ~covered;
  for (int i = 0; i < S; i++) {{
    rate[i] = choose(covered, counted[i], rate[i]);
    rate[Y + i] = choose(covered, counted[S + i], rate[Y + i]);
  }}
}}
#endif

static void act(run *c, double t, const real *y, const real *f, real *u, real *rate) {{
  real m[2 * M], out[2 * (N + S)];
  (void)f;
  {tangent_measure}
  const mask wanted = c->alive, covered = law(wanted, SAME(t), y, y + N, y + 2 * N, m, c->p, out);
  c->uncovered |= wanted & ~covered;
  for (int i = 0; i < N; i++) {{
    const real most = c->limit[i];
    u[i] = choose(TEST(out[i] < -most), -most, choose(TEST(out[i] > most), most, out[i]));
    u[N + i] = choose(TEST(u[i] - out[i] != 0.0), SAME(0.0), out[N + S + i]);
  }}
  for (int i = 0; i < S; i++) rate[i] = out[N + i], rate[Y + i] = out[2 * N + S + i];
#if {has_limits}
  count_limits(c, wanted & covered, t, y, m, out, u, rate);
#endif
}}

static void field(run *c, double t, const real *y, int sampled, real *u, real *dy) {{
  real f[2 * N], m[4 * N], out[2 * N], *rate = dy + 2 * N;
  surroundings(c, t, y, f, rate);
  if (sampled) {{
    for (int i = 0; i < 2 * N; i++) u[i] = c->held[i];
    for (int i = 0; i < S; i++) rate[i] = rate[Y + i] = SAME(0.0);
  }} else {{
    act(c, t, y, f, u, rate);
  }}
  for (int i = 0; i < N; i++) {{
    m[i] = u[i], m[N + i] = f[i], m[2 * N + i] = u[N + i], m[3 * N + i] = f[N + i];
    dy[i] = y[N + i], dy[Y + i] = y[Y + N + i];
  }}
  c->uncovered |= c->alive & ~plant(c->alive, SAME(t), y, y + N, NULL, m, c->p + P_PLANT, out);
  for (int i = 0; i < N; i++) dy[N + i] = out[i], dy[Y + N + i] = out[N + i];
}}

static void step(run *c, int method, double t, const real *y, double dt, int sampled, const real *a, real *next) {{
  real b[2 * Y], d[2 * Y], e[2 * Y], z[2 * Y], u[2 * N];
  if (method == 0) {{
    for (int i = 0; i < 2 * Y; i++) next[i] = y[i] + dt * a[i];
    for (int i = 0; i < N; i++) next[i] = y[i] + dt * next[N + i], next[Y + i] = y[Y + i] + dt * next[Y + N + i];
    return;
  }}
  for (int i = 0; i < 2 * Y; i++) z[i] = y[i] + 0.5 * dt * a[i];
  field(c, t + 0.5 * dt, z, sampled, u, b);
  for (int i = 0; i < 2 * Y; i++) z[i] = y[i] + 0.5 * dt * b[i];
  field(c, t + 0.5 * dt, z, sampled, u, d);
  for (int i = 0; i < 2 * Y; i++) z[i] = y[i] + dt * d[i];
  field(c, t + dt, z, sampled, u, e);
  for (int i = 0; i < 2 * Y; i++) next[i] = y[i] + dt / 6.0 * ((b[i] + d[i]) * 2.0 + a[i] + e[i]);
}}

/* Along the states of a run, steps + 1 rows of Y: the sum of weights (rows of Y + N) times tangents of y and u.
   start: tangents of the first state. */
void phcontrol_tangents(long steps, double dt, long stride, double period, int method, const real *p, const real *limit,
                        const real *steady, const double *const *signals, const double *states, const double *weights,
                        const real *start, real *sum, long long *status, long long *reached) {{
  real held[2 * N], held_rate[2 * Y], a[2 * Y], y[2 * Y], next[2 * Y], u[2 * N], f[2 * N];
  run c = {{.p = p, .limit = limit, .steady = steady, .signals = signals, .held = held, .alive = EVERY}};
  const int sampled = stride > 0;
  for (int i = 0; i < 2 * Y; i++) held_rate[i] = SAME(0.0);
  for (int i = 0; i < Y; i++) y[Y + i] = start[i];
  sum[0] = SAME(0.0);
  for (long k = 0; k <= steps; k++) {{
    const double t = (double)k * dt, *row = weights + k * (Y + N);
    for (int i = 0; i < Y; i++) y[i] = SAME(states[k * Y + i]);
    if (sampled && k % stride == 0) {{
      for (int i = 0; i < S; i++) y[Y + 2 * N + i] += period * held_rate[Y + i];
      surroundings(&c, t, y, f, a + 2 * N);
      act(&c, t, y, f, held, held_rate);
    }}
    field(&c, t, y, sampled, u, a);
    for (int i = 0; i < Y; i++) sum[0] += row[i] * y[Y + i];
    for (int i = 0; i < N; i++) sum[0] += row[Y + i] * u[N + i];
    c.infinite |= ~is_finite(sum[0]);
    *reached = k;
    *status = any(c.uncovered) ? 1 : any(c.infinite) ? 2 : 0;
    if (*status) return;
    if (k < steps) {{
      step(&c, method, t, y, dt, sampled, a, next);
      for (int i = 0; i < Y; i++) y[Y + i] = next[Y + i];
    }}
  }}
}}
"""

MEASURE = {
    "external_force": "for (int i = 0; i < N; i++) m[{place} + i] = f[i], m[M + {place} + i] = f[N + i];",
    "total_force": (
        "real whole[2 * N];\n  "
        "c->uncovered |= c->alive & ~total(c->alive, SAME(t), y, y + N, NULL, f, c->p + P_PLANT, whole);\n  "
        "for (int i = 0; i < N; i++) m[{place} + i] = whole[i], m[M + {place} + i] = whole[N + i];"
    ),
}
"""How a law is shown what it needs measured, with its tangents."""
