/* How the arm moves in a period, compiled: what phcontrol/safety/kernels.py describes. */
#include "_vectors.h"

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

PyDoc_STRVAR(nearest_torque_doc, "nearest_torque(torque, low, high)\n--\n\n"
                                 "Return the torque nearest to one within bounds, and whether it is that torque.");
static PyObject *nearest_torque(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 3);
  RETURN_UNLESS(n >= 0 && is_dense(arguments[0], n, "torque") && is_dense(arguments[1], n, "low") &&
                is_dense(arguments[2], n, "high"));
  const double *torque = values_of(arguments[0]), *low = values_of(arguments[1]), *high = values_of(arguments[2]);
  double *near;
  PyObject *result = new_vector(n, &near);
  if (result == NULL) return NULL;
  int same = 1;
  for (npy_intp i = 0; i < n; i++) {
    near[i] = clip(torque[i], low[i], high[i]);
    if (near[i] != torque[i]) same = 0;
  }
  return Py_BuildValue("NO", result, same ? Py_True : Py_False);
}

PyDoc_STRVAR(torque_range_doc, "torque_range(previous, limit, step)\n--\n\n"
                               "Return the lowest and the highest torque, their middle and half their distance.");
static PyObject *torque_range(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 3);
  RETURN_UNLESS(n >= 0 && is_dense(arguments[0], n, "previous") && is_dense(arguments[1], n, "limit") &&
                is_dense(arguments[2], n, "step"));
  const double *previous = values_of(arguments[0]), *limit = values_of(arguments[1]), *step = values_of(arguments[2]);
  double *values[4];
  PyObject *arrays[4] = {NULL, NULL, NULL, NULL}, *result = NULL;
  for (int k = 0; k < 4; k++)
    if ((arrays[k] = new_vector(n, &values[k])) == NULL) goto done;
  for (npy_intp i = 0; i < n; i++) {
    double start = clip(previous[i], -limit[i], limit[i]), low = start - step[i], high = start + step[i];
    values[0][i] = low = low < -limit[i] ? -limit[i] : low;
    values[1][i] = high = high > limit[i] ? limit[i] : high;
    values[2][i] = 0.5 * (low + high), values[3][i] = 0.5 * (high - low);
  }
  result = PyTuple_Pack(4, arrays[0], arrays[1], arrays[2], arrays[3]);
done:
  for (int k = 0; k < 4; k++) Py_XDECREF(arrays[k]);
  return result;
}

/* The inverse of a symmetric positive-definite matrix, by its Cholesky factor; 0 where it is not that. */
static int invert(const double *matrix, npy_intp n, double *factor, double *inverse) {
  for (npy_intp i = 0; i < n; i++) {
    for (npy_intp j = 0; j <= i; j++) {
      double sum = matrix[i * n + j];
      for (npy_intp k = 0; k < j; k++) sum -= factor[i * n + k] * factor[j * n + k];
      if (i > j) {
        factor[i * n + j] = sum / factor[j * n + j];
      } else {
        if (!(sum > 0.0)) return 0;
        factor[i * n + i] = sqrt(sum);
      }
    }
  }
  for (npy_intp j = 0; j < n; j++) { /* the factor's inverse, into its place */
    factor[j * n + j] = 1.0 / factor[j * n + j];
    for (npy_intp i = j + 1; i < n; i++) {
      double sum = 0.0;
      for (npy_intp k = j; k < i; k++) sum -= factor[i * n + k] * factor[k * n + j];
      factor[i * n + j] = sum / factor[i * n + i];
    }
  }
  for (npy_intp i = 0; i < n; i++)
    for (npy_intp j = 0; j <= i; j++) {
      double sum = 0.0;
      for (npy_intp k = i; k < n; k++) sum += factor[k * n + i] * factor[k * n + j];
      inverse[i * n + j] = inverse[j * n + i] = sum;
    }
  return 1;
}

PyDoc_STRVAR(predicted_motion_doc,
             "predicted_motion(velocity, mass, coriolis, gradient, viscous, implicit, external, period)\n--\n\n"
             "Return inertia, response and force; ArithmeticError unless the inertia is positive definite.");
static PyObject *predicted_motion(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 8);
  RETURN_UNLESS(n >= 0 && is_dense(arguments[0], n, "velocity") && is_doubles(arguments[1], 2, n, "mass") &&
                is_doubles(arguments[2], 2, n, "coriolis") && is_doubles(arguments[3], 1, n, "gradient"));
  static const char *names[] = {"viscous", "implicit", "external"};
  const double *optional[3];
  for (int k = 0; k < 3; k++) {
    optional[k] = NULL;
    if (arguments[4 + k] == Py_None) continue;
    RETURN_UNLESS(is_dense(arguments[4 + k], n, names[k]));
    optional[k] = values_of(arguments[4 + k]);
  }
  double period = PyFloat_AsDouble(arguments[7]);
  if (PyErr_Occurred()) return NULL;
  const double *velocity = values_of(arguments[0]);
  Workspace space;
  if (!workspace_open(&space, n * n)) return NULL;
  double *work = workspace_take(&space, n * n), *M = NULL, *A = NULL, *force = NULL;
  PyObject *inertia = new_square(n, &M), *response = new_square(n, &A), *forces = new_vector(n, &force), *result = NULL;
  if (inertia == NULL || response == NULL || forces == NULL) goto done;
  read_matrix(arguments[2], n, work);
  read_vector(arguments[3], n, force);
  for (npy_intp i = 0; i < n; i++) {
    double sum = force[i];
    for (npy_intp j = 0; j < n; j++) sum += work[i * n + j] * velocity[j];
    if (optional[0] != NULL) sum += optional[0][i] * velocity[i];
    force[i] = optional[2] == NULL ? -sum : optional[2][i] - sum;
  }
  read_matrix(arguments[1], n, M);
  for (npy_intp i = 0; optional[1] != NULL && i < n; i++) M[i * n + i] += optional[1][i];
  if (!invert(M, n, work, A)) {
    PyErr_SetString(PyExc_ArithmeticError, "the inertia must be positive definite");
    goto done;
  }
  for (npy_intp i = 0; i < n * n; i++) A[i] *= period;
  result = PyTuple_Pack(3, inertia, response, forces);
done:
  Py_XDECREF(inertia);
  Py_XDECREF(response);
  Py_XDECREF(forces);
  workspace_close(&space);
  return result;
}

PyDoc_STRVAR(moved_doc, "moved(velocity, response, push)\n--\n\nReturn velocity + response·push.");
static PyObject *moved(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 3);
  RETURN_UNLESS(n >= 0 && is_dense(arguments[0], n, "velocity") && is_square(arguments[1], n, "response") &&
                is_dense(arguments[2], n, "push"));
  const double *velocity = values_of(arguments[0]), *A = values_of(arguments[1]), *push = values_of(arguments[2]);
  double *following;
  PyObject *result = new_vector(n, &following);
  for (npy_intp i = 0; result != NULL && i < n; i++) {
    double sum = velocity[i];
    for (npy_intp j = 0; j < n; j++) sum += A[i * n + j] * push[j];
    following[i] = sum;
  }
  return result;
}

PyDoc_STRVAR(braking_torque_doc,
             "braking_torque(velocity, inertia, force, lowest, highest, fastest, period, decay)\n--\n\n"
             "Return the generalised force that brakes, or damps between the bounds.");
static PyObject *braking_torque(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 8);
  RETURN_UNLESS(n >= 0 && is_dense(arguments[0], n, "velocity") && is_square(arguments[1], n, "inertia"));
  static const char *names[] = {"force", "lowest", "highest", "fastest"};
  for (int k = 0; k < 4; k++) RETURN_UNLESS(is_dense(arguments[k + 2], n, names[k]));
  double period = PyFloat_AsDouble(arguments[6]), decay = PyFloat_AsDouble(arguments[7]);
  if (PyErr_Occurred()) return NULL;
  const double *v = values_of(arguments[0]), *M = values_of(arguments[1]), *force = values_of(arguments[2]);
  const double *lowest = values_of(arguments[3]), *highest = values_of(arguments[4]), *fastest = values_of(arguments[5]);
  Workspace space;
  if (!workspace_open(&space, n)) return NULL;
  double *acceleration = workspace_take(&space, n), *wanted;
  for (npy_intp i = 0; i < n; i++) {
    double change = clip(-v[i] * decay, -fastest[i], fastest[i]);
    change = clip(change, lowest[i] - v[i], highest[i] - v[i]);
    acceleration[i] = change / period;
  }
  PyObject *result = new_vector(n, &wanted);
  for (npy_intp i = 0; result != NULL && i < n; i++) {
    double sum = -force[i];
    for (npy_intp j = 0; j < n; j++) sum += M[i * n + j] * acceleration[j];
    wanted[i] = sum;
  }
  workspace_close(&space);
  return result;
}

PyDoc_STRVAR(scaled_doc, "scaled(torque, centre, reach, most)\n--\n\n"
                         "Return (torque - centre)/reach, as far as most, and whether it is no farther.");
static PyObject *scaled(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 4);
  RETURN_UNLESS(n >= 0 && is_dense(arguments[0], n, "torque") && is_dense(arguments[1], n, "centre") &&
                is_dense(arguments[2], n, "reach"));
  double most = PyFloat_AsDouble(arguments[3]);
  if (PyErr_Occurred()) return NULL;
  const double *torque = values_of(arguments[0]), *centre = values_of(arguments[1]), *reach = values_of(arguments[2]);
  double *z;
  PyObject *result = new_vector(n, &z);
  if (result == NULL) return NULL;
  int inside = 1;
  for (npy_intp i = 0; i < n; i++) {
    double value = (torque[i] - centre[i]) / reach[i];
    if (!(fabs(value) <= most)) inside = 0;
    z[i] = clip(value, -most, most);
  }
  return Py_BuildValue("NO", result, inside ? Py_True : Py_False);
}

PyDoc_STRVAR(torque_at_doc, "torque_at(z, centre, reach, low, high)\n--\n\n"
                            "Return centre + reach·z, exactly within the bounds.");
static PyObject *torque_at(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 5);
  static const char *names[] = {"z", "centre", "reach", "low", "high"};
  RETURN_UNLESS(n >= 0);
  for (int k = 0; k < 5; k++) RETURN_UNLESS(is_dense(arguments[k], n, names[k]));
  const double *z = values_of(arguments[0]), *centre = values_of(arguments[1]), *reach = values_of(arguments[2]);
  const double *low = values_of(arguments[3]), *high = values_of(arguments[4]);
  double *torque;
  PyObject *result = new_vector(n, &torque);
  for (npy_intp i = 0; result != NULL && i < n; i++) torque[i] = clip(centre[i] + reach[i] * z[i], low[i], high[i]);
  return result;
}

PyDoc_STRVAR(effort_metric_doc, "effort_metric(reach, scale)\n--\n\n"
                                "Return the diagonal matrix of (reach/scale)^2, divided by their mean.");
static PyObject *effort_metric(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 2);
  RETURN_UNLESS(n >= 0 && is_dense(arguments[0], n, "reach") && is_dense(arguments[1], n, "scale"));
  const double *reach = values_of(arguments[0]), *scale = values_of(arguments[1]);
  double *H, sum = 0.0;
  PyObject *result = new_square(n, &H);
  if (result == NULL) return NULL;
  memset(H, 0, (size_t)(n * n) * sizeof(double));
  for (npy_intp i = 0; i < n; i++) {
    double weight = reach[i] / scale[i];
    sum += H[i * n + i] = weight * weight;
  }
  for (npy_intp i = 0; i < n; i++) H[i * n + i] *= (double)n / sum;
  return result;
}

static PyMethodDef methods[] = {
    METHOD(speed_bounds),   METHOD(expected_friction), METHOD(passed_velocities), METHOD(narrowed_bounds),
    METHOD(bound_excess),   METHOD(motion_rows),       METHOD(nearest_torque),    METHOD(torque_range),
    METHOD(predicted_motion), METHOD(moved),           METHOD(braking_torque),    METHOD(scaled),
    METHOD(torque_at),      METHOD(effort_metric),     {NULL, NULL, 0, NULL}};

static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, "_compiled",
                                        "How the arm moves in a period, compiled.", -1, methods};

PyMODINIT_FUNC PyInit__compiled(void) {
  import_array();
  return PyModule_Create(&definition);
}
