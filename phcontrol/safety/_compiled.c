/* The small linear algebra of the torque filter, compiled: what phcontrol/safety/kernels.py describes. */
#include "../_arrays.h"

#define RETURN_UNLESS(condition) \
  if (!(condition)) return NULL

/* Whether an array is a vector of n doubles that lie side by side; they can then be used as they are. */
static int is_dense(PyObject *object, npy_intp n, const char *name) {
  if (!is_doubles(object, 1, n, name)) return 0;
  if (n <= 1 || PyArray_STRIDE((PyArrayObject *)object, 0) == (npy_intp)sizeof(double)) return 1;
  PyErr_Format(PyExc_ValueError, "%s must be contiguous", name);
  return 0;
}

static double *values_of(PyObject *object) { return PyArray_DATA((PyArrayObject *)object); }

/* A C-ordered (m, n) matrix of doubles, m >= least; returns m or -1. */
static npy_intp rows_of(PyObject *object, npy_intp n, npy_intp least, const char *name) {
  if (PyArray_Check(object)) {
    PyArrayObject *array = (PyArrayObject *)object;
    if (PyArray_NDIM(array) == 2 && PyArray_TYPE(array) == NPY_DOUBLE && PyArray_DIM(array, 1) == n &&
        PyArray_DIM(array, 0) >= least && PyArray_IS_C_CONTIGUOUS(array) && PyArray_ISBEHAVED_RO(array))
      return PyArray_DIM(array, 0);
  }
  PyErr_Format(PyExc_ValueError, "%s must be a C-ordered float64 matrix of %zd columns", name, (Py_ssize_t)n);
  return -1;
}

static double clip(double value, double low, double high) {
  return value < low ? low : (value > high ? high : value);
}

/* The next velocity v + ha with v + ha + a^2/(2j) = bound for a speed v below the bound; else the bound. */
static double anticipating(double bound, double speed, double period, double jerk) {
  double below = bound - speed;
  if (!(below > 0.0) || isinf(jerk)) return bound;
  double next = speed + 2.0 * below / (1.0 + sqrt(1.0 + 2.0 * below / (jerk * period * period)));
  return next < bound ? next : bound;
}

PyDoc_STRVAR(speed_bounds_doc,
             "speed_bounds(position, velocity, period, edges, braking, offset, jerk, velocity_limit, return_time, "
             "return_speed)"
             "\n--\n\nReturn the lowest and the highest next velocity.");
static PyObject *speed_bounds(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 10);
  RETURN_UNLESS(n >= 0 && is_dense(arguments[0], n, "position") && is_dense(arguments[1], n, "velocity") &&
                is_dense(arguments[3], 2 * n, "edges") && is_dense(arguments[4], 2 * n, "braking") &&
                is_dense(arguments[5], 2 * n, "offset") && is_dense(arguments[6], 2 * n, "jerk") &&
                is_dense(arguments[7], 2 * n, "velocity_limit") && is_dense(arguments[9], 2 * n, "return_speed"));
  double period = PyFloat_AsDouble(arguments[2]), return_time = PyFloat_AsDouble(arguments[8]);
  if (PyErr_Occurred()) return NULL;
  const double *q = values_of(arguments[0]), *v = values_of(arguments[1]), *edges = values_of(arguments[3]);
  const double *braking = values_of(arguments[4]), *offset = values_of(arguments[5]), *jerk = values_of(arguments[6]);
  const double *most = values_of(arguments[7]), *back = values_of(arguments[9]);
  double *low, *high;
  PyObject *lowest = new_vector(n, &low), *highest = new_vector(n, &high), *result = NULL;
  if (lowest != NULL && highest != NULL) {
    for (npy_intp i = 0; i < 2 * n; i++) {
      npy_intp joint = i < n ? i : i - n;
      double sign = i < n ? 1.0 : -1.0, speed = sign * v[joint], sinking = 0.0, bound, steady;
      double room = edges[i] - sign * (q[joint] + 0.5 * period * v[joint]);
      if (room < 0.0) {
        bound = room / return_time;
        if (bound < back[i]) bound = back[i];
      } else {
        double lag = offset[i] + 0.5 * period * braking[i], root = sqrt(2.0 * braking[i] * room + lag * lag);
        bound = root - lag;
        if (speed > 0.0) sinking = period * braking[i] * speed / root;
      }
      bound = anticipating(bound, speed - sinking, period, jerk[i]);
      steady = anticipating(most[i], speed, period, jerk[i]);
      if (bound > steady) bound = steady;
      if (i < n) {
        high[joint] = bound;
      } else {
        low[joint] = -bound;
      }
    }
    for (npy_intp joint = 0; joint < n; joint++) { /* a joint that is beyond a bound may brake as hard as that asks */
      if (!(low[joint] > high[joint])) continue;
      if (v[joint] > high[joint]) {
        low[joint] = high[joint];
      } else {
        high[joint] = low[joint];
      }
    }
    result = PyTuple_Pack(2, lowest, highest);
  }
  Py_XDECREF(lowest);
  Py_XDECREF(highest);
  return result;
}

PyDoc_STRVAR(expected_friction_doc, "expected_friction(velocity, damping, viscous, response)\n--\n\n"
                                    "Return the dry torque of joints that nothing else moves.");
static PyObject *expected_friction(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 4);
  RETURN_UNLESS(n >= 0 && is_dense(arguments[0], n, "velocity") && is_dense(arguments[1], n, "damping") &&
                is_dense(arguments[2], n, "viscous") && is_doubles(arguments[3], 2, n, "response"));
  const double *velocity = values_of(arguments[0]), *damping = values_of(arguments[1]);
  const double *viscous = values_of(arguments[2]);
  PyArrayObject *response = (PyArrayObject *)arguments[3];
  npy_intp step = PyArray_STRIDE(response, 0) + PyArray_STRIDE(response, 1);
  const char *own = PyArray_BYTES(response);
  double *torque;
  PyObject *result = new_vector(n, &torque);
  if (result == NULL) return NULL;
  for (npy_intp i = 0; i < n; i++) {
    double dry = damping[i] - viscous[i];
    torque[i] = dry * velocity[i] / (1.0 + *(const double *)(own + i * step) * dry);
  }
  return result;
}

PyDoc_STRVAR(passed_velocities_doc,
             "passed_velocities(velocity, lowest, highest, room, slow, fast)\n--\n\n"
             "Write the ends of the velocities passed towards the upper bound, towards the lower, and anywhere,\n"
             "with room beyond the bounds; up to 1e9.");
static PyObject *passed_velocities(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 6);
  RETURN_UNLESS(n >= 0 && is_dense(arguments[0], n, "velocity") && is_dense(arguments[1], n, "lowest") &&
                is_dense(arguments[2], n, "highest") && is_dense(arguments[4], 3 * n, "slow") &&
                is_dense(arguments[5], 3 * n, "fast"));
  double room = PyFloat_AsDouble(arguments[3]);
  if (PyErr_Occurred()) return NULL;
  const double *velocity = values_of(arguments[0]), *lowest = values_of(arguments[1]);
  const double *highest = values_of(arguments[2]);
  double *slow = values_of(arguments[4]), *fast = values_of(arguments[5]);
  for (npy_intp i = 0; i < n; i++) {
    double v = velocity[i], low = lowest[i], high = highest[i];
    double below = low - room, above = high + room;
    slow[i] = v < high ? v : high, fast[i] = fast[2 * n + i] = v > above ? v : above;
    slow[n + i] = slow[2 * n + i] = v < below ? v : below, fast[n + i] = v > low ? v : low;
    for (npy_intp k = i; k < 3 * n; k += n) slow[k] = clip(slow[k], -1e9, 1e9), fast[k] = clip(fast[k], -1e9, 1e9);
  }
  Py_RETURN_NONE;
}

PyDoc_STRVAR(narrowed_bounds_doc,
             "narrowed_bounds(response, expected, least, most, lowest, highest)\n--\n\n"
             "Return the bounds for a velocity predicted with the expected friction torque, whatever the true one\n"
             "does, and whether some are contradictory.");
static PyObject *narrowed_bounds(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 6);
  RETURN_UNLESS(n >= 0 && is_doubles(arguments[0], 2, n, "response") && is_dense(arguments[1], n, "expected") &&
                is_dense(arguments[2], 3 * n, "least") && is_dense(arguments[3], 3 * n, "most") &&
                is_dense(arguments[4], n, "lowest") && is_dense(arguments[5], n, "highest"));
  const double *expected = values_of(arguments[1]), *own_least = values_of(arguments[2]);
  const double *least = own_least + 2 * n, *most = (const double *)values_of(arguments[3]) + 2 * n, *own_most = most - n;
  const double *lowest = values_of(arguments[4]), *highest = values_of(arguments[5]);
  Workspace space;
  if (!workspace_open(&space, n * n)) return NULL;
  double *A = workspace_take(&space, n * n), *low, *high;
  int contrary = 0;
  read_matrix(arguments[0], n, A);
  PyObject *narrow_low = new_vector(n, &low), *narrow_high = new_vector(n, &high), *result = NULL;
  if (narrow_low != NULL && narrow_high != NULL) {
    for (npy_intp i = 0; i < n; i++) {
      double shift = 0.0, spread = 0.0, own = A[i * n + i];
      for (npy_intp j = 0; j < n; j++) {
        shift += A[i * n + j] * (expected[j] - 0.5 * (least[j] + most[j]));
        spread += fabs(A[i * n + j]) * 0.5 * (most[j] - least[j]);
      }
      low[i] = lowest[i] + (spread - shift - own * (most[i] - own_most[i]));
      high[i] = highest[i] - (spread + shift - own * (own_least[i] - least[i]));
      if (low[i] > high[i]) contrary = 1;
    }
    result = PyTuple_Pack(3, narrow_low, narrow_high, contrary ? Py_True : Py_False);
  }
  Py_XDECREF(narrow_low);
  Py_XDECREF(narrow_high);
  workspace_close(&space);
  return result;
}

PyDoc_STRVAR(bound_excess_doc, "bound_excess(velocity, lowest, highest)\n--\n\n"
                               "Return by how much a velocity leaves its bounds, 0 inside; NaN when there is one inside.");
static PyObject *bound_excess(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 3);
  RETURN_UNLESS(n >= 0 && is_dense(arguments[0], n, "velocity") && is_dense(arguments[1], n, "lowest") &&
                is_dense(arguments[2], n, "highest"));
  const double *velocity = values_of(arguments[0]), *low = values_of(arguments[1]), *high = values_of(arguments[2]);
  double most = 0.0;
  for (npy_intp i = 0; i < n; i++) {
    double above = velocity[i] - high[i], below = low[i] - velocity[i], excess = above > below ? above : below;
    if (isnan(above) || isnan(below)) return PyFloat_FromDouble(NAN);
    if (excess > most) most = excess;
  }
  return PyFloat_FromDouble(most);
}

PyDoc_STRVAR(motion_rows_doc,
             "motion_rows(effect, reach, centre, drift, lowest, highest, preferred, room, rows, lower, upper)\n--\n\n"
             "Write the first n rows of the program, of length one, and their bounds;\n"
             "return whether the preferred torque keeps them.");
static PyObject *motion_rows(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 11);
  RETURN_UNLESS(n >= 0 && is_doubles(arguments[0], 2, n, "effect"));
  static const char *names[] = {"reach", "centre", "drift", "lowest", "highest", "preferred"};
  for (int k = 0; k < 6; k++) RETURN_UNLESS(is_dense(arguments[k + 1], n, names[k]));
  double room = PyFloat_AsDouble(arguments[7]);
  if (PyErr_Occurred()) return NULL;
  npy_intp m = rows_of(arguments[8], n, n, "rows");
  RETURN_UNLESS(m >= 0 && is_dense(arguments[9], m, "lower") && is_dense(arguments[10], m, "upper"));
  const double *reach = values_of(arguments[1]), *centre = values_of(arguments[2]), *drift = values_of(arguments[3]);
  const double *lowest = values_of(arguments[4]), *highest = values_of(arguments[5]);
  const double *preferred = values_of(arguments[6]);
  double *rows = values_of(arguments[8]), *lower = values_of(arguments[9]), *upper = values_of(arguments[10]);
  Workspace space;
  if (!workspace_open(&space, n)) return NULL;
  double *centred = workspace_take(&space, n);
  read_matrix(arguments[0], n, rows);
  int keeps = 1;
  for (npy_intp i = 0; i < n; i++) {
    double *row = rows + i * n, start = drift[i], reached = drift[i], square = 0.0;
    for (npy_intp j = 0; j < n; j++) {
      start += row[j] * centre[j];
      reached += row[j] * preferred[j];
      row[j] *= reach[j];
      square += row[j] * row[j];
    }
    double size = sqrt(square);
    for (npy_intp j = 0; j < n; j++) row[j] /= size;
    lower[i] = (lowest[i] - start) / size;
    upper[i] = (highest[i] - start) / size;
    reached = (reached - start) / size;
    if (!(reached >= lower[i] - room && reached <= upper[i] + room)) keeps = 0;
    centred[i] = reached;
  }
  for (npy_intp i = 0; keeps && i < n; i++) {
    lower[i] = fmin(lower[i], centred[i] - room);
    upper[i] = fmax(upper[i], centred[i] + room);
  }
  workspace_close(&space);
  return PyBool_FromLong(keeps);
}

/* A problem as Python gives it: hessian (or None), gradient, rows, lower, upper, lowest, highest. */
typedef struct {
  const double *H, *g, *C, *l, *u, *a, *b;
  npy_intp n, m;
} Problem;

static int read_problem(PyObject *const *arguments, Problem *problem, Workspace *space) {
  npy_intp n = PyArray_Check(arguments[1]) && PyArray_NDIM((PyArrayObject *)arguments[1]) == 1
                   ? PyArray_DIM((PyArrayObject *)arguments[1], 0)
                   : 0;
  if (!is_dense(arguments[1], n, "gradient")) return 0;
  npy_intp m = rows_of(arguments[2], n, 0, "rows");
  if (m < 0 || !is_dense(arguments[3], m, "lower") || !is_dense(arguments[4], m, "upper") ||
      !is_dense(arguments[5], n, "lowest") || !is_dense(arguments[6], n, "highest"))
    return 0;
  if (arguments[0] != Py_None && !is_doubles(arguments[0], 2, n, "hessian")) return 0;
  if (!workspace_open(space, n * n + 2 * n * (2 * n + 1) + 2 * (n + m))) return 0; /* H; equations; active ones */
  problem->H = NULL;
  if (arguments[0] != Py_None) {
    double *H = workspace_take(space, n * n);
    read_matrix(arguments[0], n, H);
    problem->H = H;
  }
  problem->g = values_of(arguments[1]), problem->C = values_of(arguments[2]);
  problem->l = values_of(arguments[3]), problem->u = values_of(arguments[4]);
  problem->a = values_of(arguments[5]), problem->b = values_of(arguments[6]);
  problem->n = n, problem->m = m;
  return 1;
}

PyDoc_STRVAR(residuals_doc,
             "residuals(hessian, gradient, rows, lower, upper, lowest, highest, z, multipliers)\n--\n\n"
             "Return by how much z and the rows' multipliers miss the two conditions of optimality.");
static PyObject *residuals(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  Problem problem;
  Workspace space;
  if (given != 9) return PyErr_Format(PyExc_TypeError, "takes 9 arguments, but %zd were given", given);
  if (!read_problem(arguments, &problem, &space)) return NULL;
  npy_intp n = problem.n, m = problem.m;
  if (!is_dense(arguments[7], n, "z") || !is_dense(arguments[8], m, "multipliers")) {
    workspace_close(&space);
    return NULL;
  }
  const double *z = values_of(arguments[7]), *multipliers = values_of(arguments[8]);
  double stationary = 0.0, complementary = 0.0;
  for (npy_intp j = 0; j < n; j++) {
    double downhill = problem.g[j];
    for (npy_intp i = 0; i < m; i++) downhill += multipliers[i] * problem.C[i * n + j];
    if (problem.H == NULL) {
      downhill += z[j];
    } else {
      for (npy_intp k = 0; k < n; k++) downhill += problem.H[j * n + k] * z[k];
    }
    double miss = clip(z[j] - downhill, problem.a[j], problem.b[j]) - z[j];
    stationary += miss * miss;
  }
  for (npy_intp i = 0; i < m; i++) {
    double value = 0.0;
    for (npy_intp j = 0; j < n; j++) value += problem.C[i * n + j] * z[j];
    double miss = clip(value + multipliers[i], problem.l[i], problem.u[i]) - value;
    complementary += miss * miss;
  }
  workspace_close(&space);
  return Py_BuildValue("dd", sqrt(stationary), sqrt(complementary));
}

/* Solve a system of `size` equations in place, augmented with its right-hand side; 0 where it is singular. */
static int eliminate(double *equations, npy_intp size) {
  npy_intp width = size + 1;
  for (npy_intp column = 0; column < size; column++) {
    npy_intp pivot = column;
    for (npy_intp i = column + 1; i < size; i++)
      if (fabs(equations[i * width + column]) > fabs(equations[pivot * width + column])) pivot = i;
    if (!(fabs(equations[pivot * width + column]) > 1e-9)) return 0; /* all rows are of length one */
    if (pivot != column)
      for (npy_intp k = column; k < width; k++) {
        double swap = equations[column * width + k];
        equations[column * width + k] = equations[pivot * width + k];
        equations[pivot * width + k] = swap;
      }
    for (npy_intp i = column + 1; i < size; i++) {
      double factor = equations[i * width + column] / equations[column * width + column];
      if (factor == 0.0) continue;
      for (npy_intp k = column + 1; k < width; k++) equations[i * width + k] -= factor * equations[column * width + k];
    }
  }
  for (npy_intp i = size - 1; i >= 0; i--) {
    double *row = equations + i * width, sum = row[size];
    for (npy_intp k = i + 1; k < size; k++) sum -= row[k] * equations[k * width + size];
    row[size] = sum / row[i];
  }
  return 1;
}

PyDoc_STRVAR(active_set_step_doc,
             "active_set_step(hessian, gradient, rows, lower, upper, lowest, highest, x, multipliers)\n--\n\n"
             "Return x and multipliers with the active constraints of the given ones as equations; None if singular.");
static PyObject *active_set_step(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  Problem problem;
  Workspace space;
  if (given != 9) return PyErr_Format(PyExc_TypeError, "takes 9 arguments, but %zd were given", given);
  if (!read_problem(arguments, &problem, &space)) return NULL;
  npy_intp n = problem.n, m = problem.m, active = 0;
  PyObject *result = NULL, *point = NULL, *forces = NULL;
  double *x, *multipliers;
  if (!is_dense(arguments[7], n, "x") || !is_dense(arguments[8], m + n, "multipliers")) goto done;
  const double *old = values_of(arguments[7]), *pressed = values_of(arguments[8]);
  double *bound = workspace_take(&space, n + m), *which = workspace_take(&space, n + m);
  for (npy_intp i = 0; i < m + n; i++) {
    double value, low = i < m ? problem.l[i] : problem.a[i - m], high = i < m ? problem.u[i] : problem.b[i - m];
    if (i < m) {
      value = 0.0;
      for (npy_intp j = 0; j < n; j++) value += problem.C[i * n + j] * old[j];
    } else {
      value = old[i - m];
    }
    value += pressed[i];
    if (value > high || value < low) {
      bound[active] = value > high ? high : low;
      which[active++] = (double)i;
    }
  }
  if (active <= n) {
    npy_intp size = n + active, width = size + 1;
    double *equations = workspace_take(&space, size * width), scale = 1.0; /* of the objective: to order one */
    for (npy_intp i = 0; problem.H != NULL && i < n * n; i++)
      if (fabs(problem.H[i]) > scale) scale = fabs(problem.H[i]);
    memset(equations, 0, (size_t)(size * width) * sizeof(double));
    for (npy_intp i = 0; i < n; i++) {
      if (problem.H == NULL) {
        equations[i * width + i] = 1.0;
      } else {
        for (npy_intp j = 0; j < n; j++) equations[i * width + j] = problem.H[i * n + j] / scale;
      }
      equations[i * width + size] = -problem.g[i] / scale;
    }
    for (npy_intp k = 0; k < active; k++) {
      npy_intp i = (npy_intp)which[k];
      for (npy_intp j = 0; j < n; j++) {
        double entry = i < m ? problem.C[i * n + j] : (i - m == j ? 1.0 : 0.0);
        equations[(n + k) * width + j] = equations[j * width + n + k] = entry;
      }
      equations[(n + k) * width + size] = bound[k];
    }
    if (eliminate(equations, size)) {
      point = new_vector(n, &x), forces = new_vector(m + n, &multipliers);
      if (point == NULL || forces == NULL) goto done;
      for (npy_intp i = 0; i < n; i++) x[i] = equations[i * width + size];
      for (npy_intp i = 0; i < m + n; i++) multipliers[i] = 0.0;
      for (npy_intp k = 0; k < active; k++) multipliers[(npy_intp)which[k]] = scale * equations[(n + k) * width + size];
      result = PyTuple_Pack(2, point, forces);
      goto done;
    }
  }
  result = Py_NewRef(Py_None);
done:
  Py_XDECREF(point);
  Py_XDECREF(forces);
  workspace_close(&space);
  return result;
}

#define METHOD(name) {#name, (PyCFunction)(void (*)(void))name, METH_FASTCALL, name##_doc}
static PyMethodDef methods[] = {
    METHOD(speed_bounds),    METHOD(expected_friction), METHOD(passed_velocities), METHOD(narrowed_bounds), METHOD(bound_excess),   METHOD(motion_rows),
    METHOD(residuals),       METHOD(active_set_step), {NULL, NULL, 0, NULL}};

static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, "_compiled",
                                        "The small linear algebra of the torque filter, compiled.", -1, methods};

PyMODINIT_FUNC PyInit__compiled(void) {
  import_array();
  return PyModule_Create(&definition);
}
