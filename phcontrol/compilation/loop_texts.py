"""The closed loop in C around what is traced: forces, sensor, control, integration and record."""

from __future__ import annotations

DECLARATIONS = """
#define N {joints}
#define S {states}
#define B {bodies}
#define Y (2 * N + S + B)
#define HELD (N + S)               /* torque, rate of the law's state */
#define SENSOR (6 * N + 1)         /* shown, then what the observer keeps: see sense() */
#define CARRY (HELD + SENSOR)
#define P_PLANT {plant_numbers}
#define P_AROUND {around_numbers}
#define P_OBSERVER {observer_numbers}
#define ROUNDING 1.7763568394002505e-15 /* of energies, below which a difference of them is none */
#define ITERATIONS 25

typedef struct {{
  const real *p;                   /* numbers of law, plant, surroundings, observer */
  const real *limit;               /* of torques */
  const real *steady;              /* the force that is constant */
  const double *const *signals;    /* of each lane, forces over time; NULL for none */
  double *const *felt;             /* of each lane, the force sensor: see FEEL; NULL for none */
  double *const *joints;           /* of each lane, the joint sensor: see read_joints(); NULL for none */
  real *held, *shown;
  mask alive, uncovered, infinite, stuck;
}} run;

static mask is_finite(real x) {{ return TEST(x - x == 0.0); }}

/* Add what the signals of a lane are at a time: rows of kind, factor, numbers. */
static void signal(const double *row, double t, int lane, real *f) {{
  double count = *row++;
  for (; count > 0.0; count--) {{
    const int kind = (int)row[0];
    const double factor = row[1];
    const double *force = row + 4;
    if (kind < 3) {{
      double share = kind == 0 ? t >= row[2] : kind == 1 ? row[2] <= t && t < row[3] : sin(row[2] * t + row[3]);
      share *= factor;
      for (int i = 0; i < N; i++) AT(f[i], lane) += share * force[i];
      row += 4 + N;
    }} else {{
      const int rows = (int)row[2], holds = (int)row[3];
      const double *times = force, *table = force + rows;
      if (times[0] <= t && t <= times[rows - 1]) {{
        int low = 0, high = rows - 1; /* times[low] <= t */
        while (high - low > 1) {{
          const int middle = (low + high) / 2;
          if (times[middle] <= t) low = middle;
          else high = middle;
        }}
        if (holds) {{
          const double *held = table + (t < times[rows - 1] ? low : rows - 1) * N;
          for (int i = 0; i < N; i++) AT(f[i], lane) += factor * held[i];
        }} else {{
          const double part = (t - times[low]) / (times[low + 1] - times[low]);
          const double *here = table + low * N;
          for (int i = 0; i < N; i++) AT(f[i], lane) += factor * ((1.0 - part) * here[i] + part * here[N + i]);
        }}
      }}
      row = table + rows * N;
    }}
  }}
}}
"""
"""Lengths, what a run knows, and forces over time."""

HEAD = """
/* The external force, and the rates of the bodies' states. */
static void surroundings(run *c, double t, const real *y, real *f, real *rate) {{
  for (int i = 0; i < N; i++) f[i] = c->steady[i];
  if (c->signals)
    for (int lane = 0; lane < LANES; lane++)
      if (c->signals[lane]) signal(c->signals[lane], t, lane, f);
#if {has_around}
  real out[N + B];
  c->uncovered |= c->alive & ~around(c->alive, SAME(t), y, y + N, y + 2 * N + S, NULL, c->p + P_AROUND, out);
  for (int i = 0; i < N; i++) f[i] += out[i];
  for (int i = 0; i < B; i++) rate[i] = out[N + i];
#else
  (void)y; (void)rate;
#endif
}}

#if {has_limits}
/* The rate of the law's state in the lanes whose torque is clipped from what it desires to u. */
static void count_limits(run *c, mask wanted, double t, const real *y, const real *shown, const real *desired,
                         const real *u, real *rate) {{
  real m[{measured} + S + N], counted[S];
  mask clipped = EVERY ^ EVERY, well = EVERY;
  for (int i = 0; i < {measured}; i++) m[i] = shown[i];
  for (int i = 0; i < S; i++) m[{measured} + i] = rate[i];
  for (int i = 0; i < N; i++) {{
    m[{measured} + S + i] = u[i] - desired[i];
    clipped |= wanted & TEST(u[i] - desired[i] != 0.0);
  }}
  if (!any(clipped)) return;
  const mask covered = clipped & under_limits(clipped, SAME(t), y, y + N, y + 2 * N, m, c->p, counted);
  for (int i = 0; i < S; i++) well &= is_finite(counted[i]);
  c->uncovered |= clipped & ~covered;
  c->infinite |= covered & ~well;
  for (int i = 0; i < S; i++) rate[i] = choose(covered, counted[i], rate[i]);
}}
#endif

/* What the joint sensor of each lane shows of q and q' at sample k. Its row: samples until one is shown, whether there
   is noise, bias, resolution, the readings that are on their way, noise of each. */
static void read_joints(run *c, long k, const real *y, real *shown) {{
  for (int lane = 0; lane < LANES; lane++) {{
    double *row = c->joints[lane];
    const long late = (long)row[0];
    const double *bias = row + 2, *resolution = bias + 2 * N;
    double *way = row + 2 + 4 * N, *now = way + k % (late + 1) * 2 * N;
    const double *noise = way + (late + 1) * 2 * N + k * 2 * N;
    for (int i = 0; i < 2 * N; i++) {{
      double value = AT(y[i], lane) + bias[i];
      if (row[1] != 0.0) value += noise[i];
      now[i] = resolution[i] > 0.0 ? resolution[i] * rint(value / resolution[i]) : value;
    }}
    const double *ripe = way + (k < late ? 0 : (k - late) % (late + 1)) * 2 * N;
    for (int i = 0; i < 2 * N; i++) AT(shown[i], lane) = ripe[i];
  }}
}}

/* Torque of the law, clipped, and the rate of its state: at y, of which it sees q and q' as in seen. */
static void act(run *c, double t, const real *y, const real *seen, const real *f, real *u, real *rate) {{
  real m[{measured_room}], out[N + S];
  mask well = EVERY;
  for (int i = 0; i < 2 * N + S; i++) well &= is_finite(seen[i]);
  c->infinite |= c->alive & ~well;
  (void)f; (void)y;
  {measure}
  const mask wanted = c->alive & well, covered = law(wanted, SAME(t), seen, seen + N, seen + 2 * N, m, c->p, out);
  c->uncovered |= wanted & ~covered;
  well = EVERY;
  for (int i = 0; i < N + S; i++) well &= is_finite(out[i]);
  c->infinite |= wanted & covered & ~well;
  for (int i = 0; i < N; i++) {{
    const real most = c->limit[i];
    u[i] = choose(TEST(out[i] < -most), -most, choose(TEST(out[i] > most), most, out[i]));
  }}
  for (int i = 0; i < S; i++) rate[i] = out[N + i];
#if {has_limits}
  count_limits(c, wanted & covered & well, t, seen, m, out, u, rate);
#endif
}}

/* What drives the arm at an instant: torque (the held one, or the law's), force, rates of law and bodies. */
static void drive(run *c, double t, const real *y, int sampled, real *u, real *f, real *rate) {{
  surroundings(c, t, y, f, rate + S);
  if (sampled) {{
    for (int i = 0; i < N; i++) u[i] = c->held[i];
    for (int i = 0; i < S; i++) rate[i] = SAME(0.0);
  }} else {{
    act(c, t, y, y, f, u, rate);
  }}
}}

/* dy/dt, and the torque and the force that make it. */
static void field(run *c, double t, const real *y, int sampled, real *u, real *f, real *dy) {{
  real m[2 * N];
  drive(c, t, y, sampled, u, f, dy + 2 * N);
  for (int i = 0; i < N; i++) m[i] = u[i], m[N + i] = f[i], dy[i] = y[N + i];
  c->uncovered |= c->alive & ~plant(c->alive, SAME(t), y, y + N, NULL, m, c->p + P_PLANT, dy + N);
}}
"""

SENSE = """
/* The momentum observer at sample k: shown, sum of torques, last torque, then time, momentum, modeled, estimate. */
static void sense(run *c, long k, double t, const real *y, const real *seen, int sampled, long due, real *kept) {
  real *sum = kept + N, *last = kept + 2 * N, *own = kept + 3 * N, u[N], f[N], rate[S + B + 1];
  if (k == 0) {
    for (int i = 0; i < SENSOR; i++) kept[i] = SAME(0.0);
    c->uncovered |= c->alive & ~begin(c->alive, SAME(t), seen, seen + N, NULL, NULL, c->p + P_OBSERVER, own + 1);
  } else {
    drive(c, t, y, sampled, u, f, rate);
    for (int i = 0; i < N; i++) sum[i] += 0.5 * (last[i] + u[i]);
    if (k % due == 0) {
      real out[3 * N + 1];
      for (int i = 0; i < N; i++) sum[i] = sum[i] / (double)due;
      c->uncovered |= c->alive & ~observe(c->alive, SAME(t), seen, seen + N, own, sum, c->p + P_OBSERVER, out);
      for (int i = 0; i < 3 * N + 1; i++) own[i] = out[i];
      for (int i = 0; i < N; i++) sum[i] = SAME(0.0);
    }
  }
  for (int i = 0; i < N; i++) kept[i] = own[1 + 2 * N + i];
}
"""

FEEL = """
/* The force sensor of each lane at sample k. Its row: samples between two updates, updates until one is shown,
   whether there is noise, bias, largest magnitude, the updates that are on their way, noise of each update. */
static void sense(run *c, long k, double t, const real *y, const real *seen, int sampled, long due, real *kept) {
  real f[N], rate[S + B + 1];
  surroundings(c, t, y, f, rate + S);
  for (int lane = 0; lane < LANES; lane++) {
    double *row = c->felt[lane];
    const long every = (long)row[0], late = (long)row[1], update = k / every;
    const double *bias = row + 3, *most = bias + N;
    double *way = row + 3 + 2 * N, *now = way + update % (late + 1) * N;
    const double *noise = way + (late + 1) * N + update * N;
    if (k % every) continue;
    for (int i = 0; i < N; i++) {
      double value = AT(f[i], lane) + bias[i];
      if (row[2] != 0.0) value += noise[i];
      now[i] = value < -most[i] ? -most[i] : value > most[i] ? most[i] : value;
    }
    if (update < late) continue;
    const double *shown = way + (update - late) % (late + 1) * N;
    for (int i = 0; i < N; i++) AT(kept[i], lane) = shown[i];
  }
  (void)seen; (void)sampled; (void)due;
}
"""

IMPLICIT = """
typedef struct {
  run *c;
  double t, dt;
  int sampled;
  const real *y;
  real momentum[N], before[1];
} implicit;

/* The rate of the momentum, and of the states of law and bodies. */
static void momentum_rate(implicit *s, double t, const real *y, real *p_rate, real *rate) {
  run *c = s->c;
  real m[2 * N];
  drive(c, t, y, s->sampled, m, m + N, rate);
  c->uncovered |= c->alive & ~forces(c->alive, SAME(t), y, y + N, NULL, m, c->p + P_PLANT, p_rate);
}

static void velocity_of(implicit *s, const real *q, const real *p, real *v) {
  run *c = s->c;
  c->uncovered |= c->alive & ~velocity(c->alive, SAME(0.0), q, p, NULL, NULL, c->p + P_PLANT, v);
}

static void midpoint(implicit *s, const real *middle, real *better) {
  const double half = 0.5 * s->dt;
  real rate[N], p[N];
  momentum_rate(s, s->t + half, middle, rate, better + 2 * N);
  for (int i = 0; i < N; i++) better[i] = s->y[i] + half * middle[N + i], p[i] = s->momentum[i] + half * rate[i];
  velocity_of(s, better, p, better + N);
  for (int i = 2 * N; i < Y; i++) better[i] = s->y[i] + half * better[i];
}

static void gradient(implicit *s, const real *z, real *better) {
  run *c = s->c;
  real middle[Y], v[N], rate[N], slope[N + N * N], after[1], gained[N], linear = SAME(0.0), square = SAME(0.0);
  for (int i = 0; i < N; i++) middle[i] = 0.5 * (s->y[i] + z[i]), v[i] = 0.5 * (s->momentum[i] + z[N + i]);
  for (int i = 2 * N; i < Y; i++) middle[i] = 0.5 * (s->y[i] + z[i]);
  velocity_of(s, middle, v, middle + N);
  for (int i = 0; i < N; i++) v[i] = middle[N + i];
  momentum_rate(s, s->t + 0.5 * s->dt, middle, rate, better + 2 * N);
  c->uncovered |= c->alive & ~slopes(c->alive, SAME(0.0), middle, middle + N, NULL, NULL, c->p + P_PLANT, slope);
  c->uncovered |= c->alive & ~energy(c->alive, SAME(0.0), z, z + N, NULL, NULL, c->p + P_PLANT, after);
  for (int i = 0; i < N; i++) {
    const real moved = z[i] - s->y[i];
    gained[i] = z[N + i] - s->momentum[i];
    linear += slope[i] * moved + v[i] * gained[i];
    square += moved * moved + gained[i] * gained[i];
  }
  real bend = after[0] - s->before[0] - linear;
  const real size = v_fabs(after[0]) + v_fabs(s->before[0]) + v_fabs(linear);
  bend = choose(TEST(v_fabs(bend) > ROUNDING * size), bend / square, SAME(0.0));
  for (int i = 0; i < N; i++) {
    real damped = SAME(0.0);
    for (int k = 0; k < N; k++) damped += slope[N + i * N + k] * gained[k];
    better[i] = s->y[i] + s->dt * (v[i] + bend * gained[i]);
    better[N + i] = s->momentum[i] + s->dt * (rate[i] - bend * (z[i] - s->y[i] + damped));
  }
  for (int i = 2 * N; i < Y; i++) better[i] = s->y[i] + s->dt * better[i];
}

/* z = improve(z), by iteration, in the lanes that are alive. */
static void fixed_point(implicit *s, void (*improve)(implicit *, const real *, real *), real *value, double converged) {
  run *c = s->c;
  const mask alive = c->alive;
  real last = SAME(INFINITY), better[Y];
  for (int turn = 0; turn < ITERATIONS && any(c->alive); turn++) {
    real change = SAME(0.0), size = SAME(0.0);
    improve(s, value, better);
    for (int i = 0; i < Y; i++) {
      const real by = v_fabs(better[i] - value[i]), large = v_fabs(better[i]);
      change = choose(TEST(by <= change), change, by); /* a NaN stays */
      size = choose(TEST(large <= size), size, large);
      value[i] = choose(c->alive, better[i], value[i]);
    }
    change = change / (1.0 + size);
    c->alive &= ~(TEST(change <= converged) | (TEST(change < 1e-11) & TEST(change >= last)));
    last = change;
  }
  c->stuck |= c->alive;
  c->alive = alive;
}

static void implicit_step(run *c, int method, double t, const real *y, double dt, int sampled, const real *rate,
                          real *next) {
  implicit s = {c, t, dt, sampled, y, {{0}}, {{0}}};
  real z[Y], p_rate[N];
  c->uncovered |= c->alive & ~momenta(c->alive, SAME(t), y, y + N, NULL, NULL, c->p + P_PLANT, s.momentum);
  if (method == 2) {
    for (int i = 0; i < Y; i++) z[i] = y[i] + 0.5 * dt * rate[i];
    fixed_point(&s, midpoint, z, 1e-13);
    momentum_rate(&s, t + 0.5 * dt, z, p_rate, next + 2 * N);
    for (int i = 0; i < N; i++) next[i] = y[i] + dt * z[N + i], p_rate[i] = s.momentum[i] + dt * p_rate[i];
    velocity_of(&s, next, p_rate, next + N);
    for (int i = 2 * N; i < Y; i++) next[i] = y[i] + dt * next[i];
    return;
  }
  c->uncovered |= c->alive & ~energy(c->alive, SAME(t), y, s.momentum, NULL, NULL, c->p + P_PLANT, s.before);
  for (int i = 0; i < Y; i++) next[i] = y[i] + dt * rate[i];
  for (int i = 0; i < Y; i++) z[i] = next[i];
  c->uncovered |= c->alive & ~momenta(c->alive, SAME(t), next, next + N, NULL, NULL, c->p + P_PLANT, z + N);
  fixed_point(&s, gradient, z, 1e-15);
  for (int i = 0; i < Y; i++) next[i] = z[i];
  velocity_of(&s, z, z + N, next + N);
}
"""

RUN = """
static void step(run *c, int method, double t, const real *y, double dt, int sampled, const real *a, real *next) {{
  real b[Y], d[Y], e[Y], z[Y], u[N], f[N];
  if (method == 0) {{
    for (int i = 0; i < Y; i++) next[i] = y[i] + dt * a[i];
    for (int i = 0; i < N; i++) next[i] = y[i] + dt * next[N + i];
    return;
  }}
#if {has_implicit}
  if (method > 1) {{
    implicit_step(c, method, t, y, dt, sampled, a, next);
    return;
  }}
#endif
  for (int i = 0; i < Y; i++) z[i] = y[i] + 0.5 * dt * a[i];
  field(c, t + 0.5 * dt, z, sampled, u, f, b);
  for (int i = 0; i < Y; i++) z[i] = y[i] + 0.5 * dt * b[i];
  field(c, t + 0.5 * dt, z, sampled, u, f, d);
  for (int i = 0; i < Y; i++) z[i] = y[i] + dt * d[i];
  field(c, t + dt, z, sampled, u, f, e);
  for (int i = 0; i < Y; i++) next[i] = y[i] + dt / 6.0 * ((b[i] + d[i]) * 2.0 + a[i] + e[i]);
}}

/* One instant: what a run would find there. */
void phcontrol_field(double t, const real *y, const real *p, const real *limit, const real *steady,
                     const double *const *signals, real *u, real *f, real *dy, long long *status) {{
  run c = {{.p = p, .limit = limit, .steady = steady, .signals = signals, .alive = EVERY}};
  real shown[N + 1];
  for (int i = 0; i < N; i++) shown[i] = SAME(0.0);
  c.shown = shown;
  field(&c, t, y, 0, u, f, dy);
  for (int lane = 0; lane < LANES; lane++)
    status[lane] = AT(c.infinite, lane) ? 2 : AT(c.uncovered, lane) ? 1 : 0;
}}

/* Samples first to last of steps + 1. Row 0 of each record is that of sample first; of states it is given, and a row
   is made for the sample after last. Where there are fewer rows than samples, they are written over, again and again.
   stride: of a sampled law; 0 for a continuous one. late: samples until a torque that was ordered acts; line: room for
   those that are on their way, late / stride + 1. due: of the sensor. A lane whose status is not 0 has ended, at the
   sample that it has reached; ends: the states of all lanes there. */
void phcontrol_run(long first, long last, long rows, long steps, double dt, long stride, double period, long late,
                   long due, int method, const real *p, const real *limit, const real *steady,
                   const double *const *signals, double *const *felt, double *const *joints, real *carry, real *line,
                   real *states, real *torques, real *external, real *readings, real *read, real *ends,
                   long long *status, long long *reached) {{
  run c = {{.p = p, .limit = limit, .steady = steady, .signals = signals, .felt = felt, .joints = joints,
           .held = carry, .shown = carry + HELD, .alive = EVERY}};
  const int sampled = stride > 0;
  const long places = sampled ? late / stride + 1 : 0;
  real a[Y], rate[S + B + 1], view[2 * N + S];
  for (int lane = 0; lane < LANES; lane++) AT(c.alive, lane) = status[lane] ? 0 : -1;
  (void)due; (void)readings; (void)rate;
  for (long k = first; k <= last && any(c.alive); k++) {{
    const double t = (double)k * dt;
    const long row = (k - first) % rows;
    real *y = states + row * Y, *u = torques + row * N, *f = external + row * N;
    const real *seen = y;
    if (joints) {{
      real *shown = read + row * 2 * N;
      read_joints(&c, k, y, shown);
      for (int i = 0; i < 2 * N; i++) view[i] = shown[i];
      seen = view;
    }}
#if {has_sensor}
    sense(&c, k, t, y, seen, sampled, due, c.shown);
    for (int i = 0; i < N; i++) readings[row * N + i] = c.shown[i];
#endif
    if (sampled && k % stride == 0) {{
      for (int i = 0; i < S; i++) y[2 * N + i] += period * c.held[N + i];
      for (int i = 0; i < S; i++) view[2 * N + i] = y[2 * N + i];
      surroundings(&c, t, y, f, rate + S);
      act(&c, t, y, seen, f, line + k / stride % places * N, c.held + N);
    }}
    if (sampled && k >= late && (k - late) % stride == 0) {{
      const real *acts = line + (k - late) / stride % places * N;
      for (int i = 0; i < N; i++) c.held[i] = acts[i];
    }}
    field(&c, t, y, sampled, u, f, a);
#if {has_sensor}
    for (int i = 0; i < N; i++) c.shown[2 * N + i] = u[i];
#endif
    if (k < steps) {{
      real *next = y + Y;
      step(&c, method, t, y, dt, sampled, a, next);
      mask well = EVERY;
      for (int i = 0; i < Y; i++) well &= is_finite(next[i]);
      c.infinite |= c.alive & ~well & ~c.uncovered & ~c.stuck;
    }}
    const mask ended = c.alive & (c.uncovered | c.infinite | c.stuck);
    for (int lane = 0; lane < LANES; lane++) {{
      if (!AT(c.alive, lane)) continue;
      reached[lane] = k;
      if (k == last || AT(ended, lane)) for (int i = 0; i < Y; i++) AT(ends[i], lane) = AT(y[i], lane);
      if (AT(ended, lane)) status[lane] = AT(c.infinite, lane) ? 2 : AT(c.uncovered, lane) ? 1 : 3;
    }}
    c.alive &= ~ended;
    for (int i = 0; i < Y && row + 1 == rows && k < last; i++) states[i] = y[Y + i];
  }}
}}
"""

MEASURE = {
    "external_force": "for (int i = 0; i < N; i++) m[{place} + i] = f[i];",
    "total_force": (
        "c->uncovered |= c->alive & ~total(c->alive, SAME(t), y, y + N, NULL, f, c->p + P_PLANT, m + {place});"
    ),
    "shown": "for (int i = 0; i < N; i++) m[{place} + i] = c->shown[i];",
}
"""How a law is shown what it needs measured: the truth, or what a sensor shows."""
