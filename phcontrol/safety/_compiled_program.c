/* The torque filter's quadratic programs, compiled: what phcontrol/safety/kernels.py describes. */
#include "_vectors.h"

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

/* By how much z and the rows' multipliers miss the two conditions of optimality. */
static void misses(const Problem *given, const double *z, const double *multipliers, double *result) {
  const Problem problem = *given;
  npy_intp n = problem.n, m = problem.m;
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
  result[0] = sqrt(stationary), result[1] = sqrt(complementary);
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
  double missed[2];
  misses(&problem, z, multipliers, missed);
  workspace_close(&space);
  return Py_BuildValue("dd", missed[0], missed[1]);
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
             "Return x and multipliers with the active constraints of the given ones as equations, x within the box and\n"
             "the residuals that it has there; None if singular.");
static PyObject *active_set_step(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  Problem problem;
  Workspace space;
  if (given != 9) return PyErr_Format(PyExc_TypeError, "takes 9 arguments, but %zd were given", given);
  if (!read_problem(arguments, &problem, &space)) return NULL;
  npy_intp n = problem.n, m = problem.m, active = 0;
  PyObject *result = NULL, *point = NULL, *forces = NULL, *inside = NULL;
  double *x = NULL, *multipliers = NULL, *z = NULL, missed[2];
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
      point = new_vector(n, &x), forces = new_vector(m + n, &multipliers), inside = new_vector(n, &z);
      if (point == NULL || forces == NULL || inside == NULL) goto done;
      for (npy_intp i = 0; i < n; i++) x[i] = equations[i * width + size];
      for (npy_intp i = 0; i < m + n; i++) multipliers[i] = 0.0;
      for (npy_intp k = 0; k < active; k++) multipliers[(npy_intp)which[k]] = scale * equations[(n + k) * width + size];
      for (npy_intp i = 0; i < n; i++) z[i] = clip(x[i], problem.a[i], problem.b[i]);
      misses(&problem, z, multipliers, missed);
      result = Py_BuildValue("OOOdd", point, forces, inside, missed[0], missed[1]);
      goto done;
    }
  }
  result = Py_NewRef(Py_None);
done:
  Py_XDECREF(point);
  Py_XDECREF(inside);
  Py_XDECREF(forces);
  workspace_close(&space);
  return result;
}

PyDoc_STRVAR(bent_doc, "bent(hessian, gradient, weight, curvature, z, slope)\n--\n\n"
                       "Return hessian + weight·curvature, and gradient - weight·curvature·z + weight·slope.");
static PyObject *bent(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  if (given != 6) return PyErr_Format(PyExc_TypeError, "takes 6 arguments, but %zd were given", given);
  npy_intp n = size_of(arguments + 1, 1, 1);
  RETURN_UNLESS(n >= 0 && is_dense(arguments[1], n, "gradient") && is_square(arguments[3], n, "curvature") &&
                is_dense(arguments[4], n, "z"));
  double weight = PyFloat_AsDouble(arguments[2]);
  if (PyErr_Occurred()) return NULL;
  RETURN_UNLESS(arguments[0] == Py_None || is_doubles(arguments[0], 2, n, "hessian"));
  RETURN_UNLESS(arguments[5] == Py_None || is_dense(arguments[5], n, "slope"));
  const double *gradient = values_of(arguments[1]), *curvature = values_of(arguments[3]), *z = values_of(arguments[4]);
  const double *slope = arguments[5] == Py_None ? NULL : values_of(arguments[5]);
  double *H, *g;
  PyObject *hessian = new_square(n, &H), *bowed = new_vector(n, &g), *result = NULL;
  if (hessian != NULL && bowed != NULL) {
    if (arguments[0] == Py_None) {
      for (npy_intp i = 0; i < n * n; i++) H[i] = i % (n + 1) == 0 ? 1.0 : 0.0;
    } else {
      read_matrix(arguments[0], n, H);
    }
    for (npy_intp i = 0; i < n; i++) {
      double sum = gradient[i];
      for (npy_intp j = 0; j < n; j++) {
        double entry = weight * curvature[i * n + j];
        H[i * n + j] += entry;
        sum -= entry * z[j];
      }
      g[i] = slope == NULL ? sum : sum + weight * slope[i];
    }
    result = PyTuple_Pack(2, hessian, bowed);
  }
  Py_XDECREF(hessian);
  Py_XDECREF(bowed);
  return result;
}

/* Value of e + g'(z - c) + (z - c)'K(z - c)/2; where it is wanted, its slope g + K(z - c) too. */
static double parabola_at(const double *z, const double *centre, double excess, const double *slope,
                          const double *curvature, npy_intp n, double *gradient) {
  double value = excess;
  for (npy_intp i = 0; i < n; i++) {
    double bend = 0.0;
    for (npy_intp j = 0; j < n; j++) bend += curvature[i * n + j] * (z[j] - centre[j]);
    value += (z[i] - centre[i]) * (slope[i] + 0.5 * bend);
    if (gradient != NULL) gradient[i] = slope[i] + bend;
  }
  return value;
}

static int is_parabola(PyObject *const *arguments, npy_intp n, double *excess) {
  if (n < 0 || !is_dense(arguments[0], n, "z") || !is_dense(arguments[1], n, "centre") ||
      !is_dense(arguments[3], n, "slope") || !is_square(arguments[4], n, "curvature"))
    return 0;
  *excess = PyFloat_AsDouble(arguments[2]);
  return !PyErr_Occurred();
}

PyDoc_STRVAR(parabola_doc, "parabola(z, centre, excess, slope, curvature)\n--\n\n"
                           "Return excess + slope·(z - centre) + (z - centre)·curvature·(z - centre)/2.");
static PyObject *parabola(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 5);
  double excess;
  RETURN_UNLESS(is_parabola(arguments, n, &excess));
  return PyFloat_FromDouble(parabola_at(values_of(arguments[0]), values_of(arguments[1]), excess,
                                        values_of(arguments[3]), values_of(arguments[4]), n, NULL));
}

PyDoc_STRVAR(tangent_doc, "tangent(z, centre, excess, slope, curvature)\n--\n\n"
                          "Return row, bound and length of the parabola's tangent at z.");
static PyObject *tangent(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 5);
  double excess, *row, square = 0.0, reached = 0.0;
  RETURN_UNLESS(is_parabola(arguments, n, &excess));
  const double *z = values_of(arguments[0]);
  PyObject *result = new_vector(n, &row);
  if (result == NULL) return NULL;
  double value = parabola_at(z, values_of(arguments[1]), excess, values_of(arguments[3]), values_of(arguments[4]), n, row);
  for (npy_intp i = 0; i < n; i++) square += row[i] * row[i], reached += row[i] * z[i];
  double length = sqrt(square), bound = reached - value;
  if (length > 0.0) {
    for (npy_intp i = 0; i < n; i++) row[i] /= length;
    bound /= length;
  }
  return Py_BuildValue("Ndd", result, bound, length);
}

PyDoc_STRVAR(farther_doc, "farther(hessian, gradient, z, highest)\n--\n\n"
                          "Return the most by which z'Hz/2 + g'z can be larger elsewhere in the box |z| <= highest.");
static PyObject *farther(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  if (given != 4) return PyErr_Format(PyExc_TypeError, "takes 4 arguments, but %zd were given", given);
  npy_intp n = size_of(arguments + 1, 1, 1);
  RETURN_UNLESS(n >= 0 && is_dense(arguments[1], n, "gradient") && is_dense(arguments[2], n, "z") &&
                is_dense(arguments[3], n, "highest"));
  RETURN_UNLESS(arguments[0] == Py_None || is_doubles(arguments[0], 2, n, "hessian"));
  const double *gradient = values_of(arguments[1]), *z = values_of(arguments[2]), *highest = values_of(arguments[3]);
  Workspace space;
  if (!workspace_open(&space, n * n)) return NULL;
  double *H = workspace_take(&space, n * n), more = 0.0;
  if (arguments[0] != Py_None) read_matrix(arguments[0], n, H);
  for (npy_intp i = 0; i < n; i++) {
    more += fabs(gradient[i]) * highest[i] - gradient[i] * z[i];
    if (arguments[0] == Py_None) more += 0.5 * (highest[i] * highest[i] - z[i] * z[i]);
    for (npy_intp j = 0; arguments[0] != Py_None && j < n; j++)
      more += 0.5 * (highest[i] * fabs(H[i * n + j]) * highest[j] - z[i] * H[i * n + j] * z[j]);
  }
  workspace_close(&space);
  return PyFloat_FromDouble(more);
}

PyDoc_STRVAR(mean_power_doc, "mean_power(output, resistance, dissipated, change, kick, push)\n--\n\n"
                             "Return output·change - dissipated + kick·(push - resistance)/2.");
static PyObject *mean_power(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 6);
  RETURN_UNLESS(n >= 0 && is_doubles(arguments[0], 1, n, "output") && is_doubles(arguments[1], 1, n, "resistance") &&
                is_dense(arguments[3], n, "change") && is_dense(arguments[4], n, "kick") &&
                is_dense(arguments[5], n, "push"));
  double power = -PyFloat_AsDouble(arguments[2]);
  if (PyErr_Occurred()) return NULL;
  Workspace space;
  if (!workspace_open(&space, 2 * n)) return NULL;
  double *output = workspace_take(&space, n), *resistance = workspace_take(&space, n);
  read_vector(arguments[0], n, output);
  read_vector(arguments[1], n, resistance);
  const double *change = values_of(arguments[3]), *kick = values_of(arguments[4]), *push = values_of(arguments[5]);
  for (npy_intp i = 0; i < n; i++) power += output[i] * change[i] + 0.5 * kick[i] * (push[i] - resistance[i]);
  workspace_close(&space);
  return PyFloat_FromDouble(power);
}

PyDoc_STRVAR(storage_parabola_doc,
             "storage_parabola(output, resistance, push, kick, effect, curvature, reach)\n--\n\n"
             "Return size, slope and curvature of the mean power for z, of order one, times size.");
static PyObject *storage_parabola(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 7);
  RETURN_UNLESS(n >= 0 && is_doubles(arguments[0], 1, n, "output") && is_doubles(arguments[1], 1, n, "resistance") &&
                is_dense(arguments[2], n, "push") && is_dense(arguments[3], n, "kick") &&
                is_square(arguments[4], n, "effect") && is_square(arguments[5], n, "curvature") &&
                is_dense(arguments[6], n, "reach"));
  const double *push = values_of(arguments[2]), *kick = values_of(arguments[3]), *effect = values_of(arguments[4]);
  const double *bend = values_of(arguments[5]), *reach = values_of(arguments[6]);
  Workspace space;
  if (!workspace_open(&space, 2 * n)) return NULL;
  double *output = workspace_take(&space, n), *resistance = workspace_take(&space, n), *slope, *curvature, size = 0.0;
  read_vector(arguments[0], n, output);
  read_vector(arguments[1], n, resistance);
  PyObject *slopes = new_vector(n, &slope), *curvatures = new_square(n, &curvature), *result = NULL;
  if (slopes != NULL && curvatures != NULL) {
    for (npy_intp j = 0; j < n; j++) {
      double sum = kick[j];
      for (npy_intp i = 0; i < n; i++) {
        sum += (push[i] - resistance[i]) * effect[i * n + j];
        curvature[j * n + i] = bend[j * n + i] * reach[i] * reach[j];
      }
      slope[j] = reach[j] * (0.5 * sum + output[j]);
      size += fabs(slope[j]) + curvature[j * n + j];
    }
    for (npy_intp i = 0; size > 0.0 && i < n * n; i++) curvature[i] /= size;
    for (npy_intp i = 0; size > 0.0 && i < n; i++) slope[i] /= size;
    result = Py_BuildValue("dOO", size, slopes, curvatures);
  }
  Py_XDECREF(slopes);
  Py_XDECREF(curvatures);
  workspace_close(&space);
  return result;
}

PyDoc_STRVAR(elastic_bounds_doc,
             "elastic_bounds(rows, lower, upper, highest, preferred)\n--\n\n"
             "Return bounds that are at most 1 beyond the box's reach, and z and s that meet them.");
static PyObject *elastic_bounds(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = given == 5 ? size_of(arguments + 1, 1, 1) : size_of(arguments, given, 5);
  RETURN_UNLESS(n >= 0 && is_square(arguments[0], n, "rows"));
  static const char *names[] = {"lower", "upper", "highest", "preferred"};
  for (int k = 0; k < 4; k++) RETURN_UNLESS(is_dense(arguments[k + 1], n, names[k]));
  const double *rows = values_of(arguments[0]), *lower = values_of(arguments[1]), *upper = values_of(arguments[2]);
  const double *highest = values_of(arguments[3]), *preferred = values_of(arguments[4]);
  double *low, *high, *point;
  PyObject *lows = new_vector(n, &low), *highs = new_vector(n, &high), *start = new_vector(2 * n, &point), *result = NULL;
  if (lows != NULL && highs != NULL && start != NULL) {
    for (npy_intp i = 0; i < n; i++) point[i] = clip(preferred[i], -highest[i], highest[i]);
    for (npy_intp i = 0; i < n; i++) {
      double beyond = 1.0, reached = 0.0;
      for (npy_intp j = 0; j < n; j++) {
        beyond += fabs(rows[i * n + j]) * highest[j];
        reached += rows[i * n + j] * point[j];
      }
      low[i] = lower[i] < beyond ? lower[i] : beyond;
      high[i] = upper[i] > -beyond ? upper[i] : -beyond;
      point[n + i] = clip(reached, low[i], high[i]) - reached;
    }
    result = PyTuple_Pack(3, lows, highs, start);
  }
  Py_XDECREF(lows);
  Py_XDECREF(highs);
  Py_XDECREF(start);
  return result;
}

PyDoc_STRVAR(widen_doc, "widen(rows, z, room, lower, upper)\n--\n\n"
                        "Widen the bounds so far that z is within them by room.");
static PyObject *widen(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = given == 5 ? size_of(arguments + 1, 1, 1) : size_of(arguments, given, 5);
  RETURN_UNLESS(n >= 0 && is_square(arguments[0], n, "rows") && is_dense(arguments[1], n, "z") &&
                is_dense(arguments[3], n, "lower") && is_dense(arguments[4], n, "upper"));
  double room = PyFloat_AsDouble(arguments[2]);
  if (PyErr_Occurred()) return NULL;
  const double *rows = values_of(arguments[0]), *z = values_of(arguments[1]);
  double *lower = values_of(arguments[3]), *upper = values_of(arguments[4]);
  for (npy_intp i = 0; i < n; i++) {
    double reached = 0.0;
    for (npy_intp j = 0; j < n; j++) reached += rows[i * n + j] * z[j];
    lower[i] = fmin(lower[i], reached - room);
    upper[i] = fmax(upper[i], reached + room);
  }
  Py_RETURN_NONE;
}

static PyMethodDef methods[] = {
    METHOD(residuals), METHOD(active_set_step), METHOD(bent),           METHOD(parabola), METHOD(tangent),
    METHOD(farther),   METHOD(mean_power),      METHOD(storage_parabola), METHOD(elastic_bounds), METHOD(widen),
    {NULL, NULL, 0, NULL}};

static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, "_compiled_program",
                                        "The torque filter's quadratic programs, compiled.", -1, methods};

PyMODINIT_FUNC PyInit__compiled_program(void) {
  import_array();
  return PyModule_Create(&definition);
}
