/* The inner products of the control step, compiled: what phcontrol/mechanics/kernels.py describes.

   Each function does in one call, without temporaries on the heap, what would take half a dozen calls of
   NumPy and LAPACK, each dearer than the arithmetic of a seven-joint arm. Matrices are copied into row-major
   buffers first, so that any strides are taken. No threads, no state. */
#include "_triangular.h"

/* --- arithmetic on row-major buffers ------------------------------------------------------------------ */

/* Lower triangle of S <- Phi(T^-1 S T^-T) for a symmetric S: lower triangle, diagonal halved. */
static void reduce(const double *T, npy_intp n, double *S) {
  for (npy_intp i = 0; i < n; i++) { /* S <- T^-1 S, row by row */
    double *row = S + i * n;
    for (npy_intp k = 0; k < i; k++) {
      const double factor = T[i * n + k], *above = S + k * n;
      for (npy_intp j = 0; j < n; j++) row[j] -= factor * above[j];
    }
    const double pivot = T[i * n + i];
    for (npy_intp j = 0; j < n; j++) row[j] /= pivot;
  }
  for (npy_intp i = 0; i < n; i++) { /* each row times T^-T, as far as the diagonal */
    forward(T, n, i + 1, S + i * n);
    S[i * n + i] *= 0.5;
  }
}

/* C <- C + C^T */
static void symmetrise(npy_intp n, double *C) {
  for (npy_intp i = 0; i < n; i++)
    for (npy_intp j = 0; j <= i; j++) C[i * n + j] = C[j * n + i] = C[i * n + j] + C[j * n + i];
}

/* --- what Python calls -------------------------------------------------------------------------------- */

PyDoc_STRVAR(factor_doc, "factor(mass_matrix)\n--\n\nReturn T, lower triangular, M = T T^T.");
static PyObject *factor(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 1);
  double *T;
  if (n < 0 || !is_doubles(arguments[0], 2, n, "mass_matrix")) return NULL;
  PyObject *result = new_matrix(n, &T);
  if (result == NULL) return NULL;
  PyArrayObject *array = (PyArrayObject *)arguments[0];
  const char *data = PyArray_BYTES(array);
  npy_intp row = PyArray_STRIDE(array, 0), column = PyArray_STRIDE(array, 1);
  for (npy_intp j = 0; j < n; j++) { /* column by column, as T lies in memory */
    for (npy_intp i = j; i < n; i++) {
      double sum = *(const double *)(data + i * row + j * column);
      for (npy_intp k = 0; k < j; k++) sum -= T[k * n + i] * T[k * n + j];
      if (i > j) {
        T[j * n + i] = sum / T[j * n + j];
      } else if (sum > 0.0 && isfinite(sum)) {
        T[j * n + j] = sqrt(sum);
      } else {
        Py_DECREF(result);
        PyErr_SetString(PyExc_ArithmeticError, "the matrix is not positive definite");
        return NULL;
      }
    }
  }
  return result;
}

static PyObject *solve_either(PyObject *const *arguments, Py_ssize_t given, int transposed) {
  npy_intp n = size_of(arguments, given, 2);
  Workspace space;
  if (n < 0 || !is_doubles(arguments[0], 2, n, "factor")) return NULL;
  int dimensions = PyArray_Check(arguments[1]) ? PyArray_NDIM((PyArrayObject *)arguments[1]) : 0;
  PyArrayObject *right = (PyArrayObject *)arguments[1];
  if (dimensions < 1 || dimensions > 2 || PyArray_TYPE(right) != NPY_DOUBLE || !PyArray_ISBEHAVED_RO(right) ||
      PyArray_DIM(right, 0) != n) {
    PyErr_Format(PyExc_ValueError, "the right-hand side must be a float64 array with 1 or 2 axes, the first of length %zd",
                 (Py_ssize_t)n);
    return NULL;
  }
  npy_intp columns = dimensions == 1 ? 1 : PyArray_DIM(right, 1);
  npy_intp row = PyArray_STRIDE(right, 0), column = dimensions == 1 ? 0 : PyArray_STRIDE(right, 1);
  if (!workspace_open(&space, n * n)) return NULL;
  double *T = workspace_take(&space, n * n);
  PyObject *result = PyArray_EMPTY(dimensions, PyArray_DIMS(right), NPY_DOUBLE, 1);
  if (result != NULL) {
    double *out = PyArray_DATA((PyArrayObject *)result);
    read_matrix(arguments[0], n, T);
    for (npy_intp j = 0; j < columns; j++, out += n) {
      const char *data = PyArray_BYTES(right) + j * column;
      for (npy_intp i = 0; i < n; i++) out[i] = *(const double *)(data + i * row);
      if (transposed) {
        backward(T, n, out);
      } else {
        forward(T, n, n, out);
      }
    }
  }
  workspace_close(&space);
  return result;
}

PyDoc_STRVAR(solve_doc, "solve(factor, right)\n--\n\nReturn T^-1 b for a vector or the columns of a matrix.");
static PyObject *solve(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  return solve_either(arguments, given, 0);
}

PyDoc_STRVAR(solve_transposed_doc, "solve_transposed(factor, right)\n--\n\nReturn T^-T b for a vector or the columns of a matrix.");
static PyObject *solve_transposed(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  return solve_either(arguments, given, 1);
}

PyDoc_STRVAR(relative_factor_rate_doc,
             "relative_factor_rate(factor, coriolis)\n--\n\nReturn T^-1 dT/dt = Phi(T^-1 (C + C^T) T^-T).");
static PyObject *relative_factor_rate(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 2);
  double *out;
  Workspace space;
  if (n < 0 || !is_doubles(arguments[0], 2, n, "factor") || !is_doubles(arguments[1], 2, n, "coriolis")) return NULL;
  if (!workspace_open(&space, 2 * n * n)) return NULL;
  double *T = workspace_take(&space, n * n), *S = workspace_take(&space, n * n);
  PyObject *result = new_matrix(n, &out);
  if (result != NULL) {
    read_matrix(arguments[0], n, T);
    read_matrix(arguments[1], n, S);
    symmetrise(n, S);
    reduce(T, n, S);
    for (npy_intp i = 0; i < n; i++)
      for (npy_intp j = 0; j <= i; j++) out[j * n + i] = S[i * n + j];
  }
  workspace_close(&space);
  return result;
}

PyDoc_STRVAR(transformed_rate_doc,
             "transformed_rate(factor, coriolis, velocity, force)\n--\n\n"
             "Return (dT/dt)^T s + T^-1 (f - C s) for a velocity s.");
static PyObject *transformed_rate(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 4);
  double *out;
  Workspace space;
  if (n < 0 || !is_doubles(arguments[0], 2, n, "factor") || !is_doubles(arguments[1], 2, n, "coriolis") ||
      !is_doubles(arguments[2], 1, n, "velocity") || !is_doubles(arguments[3], 1, n, "force"))
    return NULL;
  if (!workspace_open(&space, 2 * n * n + 2 * n)) return NULL;
  double *T = workspace_take(&space, n * n), *C = workspace_take(&space, n * n);
  double *s = workspace_take(&space, n), *momentum = workspace_take(&space, n);
  PyObject *result = new_vector(n, &out);
  if (result != NULL) {
    read_matrix(arguments[0], n, T);
    read_matrix(arguments[1], n, C);
    read_vector(arguments[2], n, s);
    read_vector(arguments[3], n, out);
    for (npy_intp i = 0; i < n; i++) {
      double sum = 0.0;
      for (npy_intp j = 0; j < n; j++) sum += C[i * n + j] * s[j];
      out[i] -= sum;
      momentum[i] = 0.0;
      for (npy_intp k = i; k < n; k++) momentum[i] += T[k * n + i] * s[k]; /* T^T s */
    }
    forward(T, n, n, out);
    symmetrise(n, C);
    reduce(T, n, C);
    for (npy_intp i = 0; i < n; i++)
      for (npy_intp j = 0; j <= i; j++) out[j] += C[i * n + j] * momentum[i];
  }
  workspace_close(&space);
  return result;
}

PyDoc_STRVAR(momentum_derivative_doc,
             "momentum_derivative(factor, mass_matrix_derivative, momentum)\n--\n\n"
             "Return P: column k is -Phi(T^-1 (dM/dq_k) T^-T) times the transformed momentum.");
static PyObject *momentum_derivative(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 3);
  double *out;
  Workspace space;
  if (n < 0 || !is_doubles(arguments[0], 2, n, "factor") ||
      !is_doubles(arguments[1], 3, n, "mass_matrix_derivative") || !is_doubles(arguments[2], 1, n, "momentum"))
    return NULL;
  if (!workspace_open(&space, 2 * n * n + n)) return NULL;
  double *T = workspace_take(&space, n * n), *S = workspace_take(&space, n * n), *p = workspace_take(&space, n);
  PyObject *result = new_matrix(n, &out);
  if (result != NULL) {
    PyArrayObject *tensor = (PyArrayObject *)arguments[1];
    read_matrix(arguments[0], n, T);
    read_vector(arguments[2], n, p);
    for (npy_intp k = 0; k < n; k++) {
      read_block(PyArray_BYTES(tensor) + k * PyArray_STRIDE(tensor, 0), PyArray_STRIDE(tensor, 1),
                 PyArray_STRIDE(tensor, 2), n, S);
      reduce(T, n, S);
      for (npy_intp i = 0; i < n; i++)
        for (npy_intp j = 0; j <= i; j++) out[k * n + i] -= S[i * n + j] * p[j];
    }
  }
  workspace_close(&space);
  return result;
}

PyDoc_STRVAR(feedback_doc,
             "feedback(force, stiffness, error, damping, velocity, desired)\n--\n\n"
             "Return f - K e - C (v - s).");
static PyObject *feedback(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp n = size_of(arguments, given, 6);
  double *out;
  Workspace space;
  if (n < 0 || !is_doubles(arguments[0], 1, n, "force") || !is_doubles(arguments[1], 2, n, "stiffness") ||
      !is_doubles(arguments[2], 1, n, "error") || !is_doubles(arguments[3], 2, n, "damping") ||
      !is_doubles(arguments[4], 1, n, "velocity") || !is_doubles(arguments[5], 1, n, "desired"))
    return NULL;
  if (!workspace_open(&space, n * n + 2 * n)) return NULL;
  double *A = workspace_take(&space, n * n), *e = workspace_take(&space, n), *s = workspace_take(&space, n);
  PyObject *result = new_vector(n, &out);
  if (result != NULL) {
    read_vector(arguments[0], n, out);
    for (int pass = 0; pass < 2; pass++) { /* the spring, then the damper */
      read_matrix(arguments[1 + 2 * pass], n, A);
      read_vector(arguments[2 + 2 * pass], n, e);
      if (pass == 1) {
        read_vector(arguments[5], n, s);
        for (npy_intp i = 0; i < n; i++) e[i] -= s[i];
      }
      for (npy_intp i = 0; i < n; i++) {
        double sum = 0.0;
        for (npy_intp j = 0; j < n; j++) sum += A[i * n + j] * e[j];
        out[i] -= sum;
      }
    }
  }
  workspace_close(&space);
  return result;
}

PyDoc_STRVAR(finite_copy_doc,
             "finite_copy(value, size)\n--\n\n"
             "Return a copy of a plain float64 vector of finite numbers, None for anything else.");
static PyObject *finite_copy(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  if (given != 2) {
    PyErr_Format(PyExc_TypeError, "takes 2 arguments, but %zd were given", given);
    return NULL;
  }
  npy_intp n = PyLong_AsSsize_t(arguments[1]);
  if (n == -1 && PyErr_Occurred()) return NULL;
  PyArrayObject *array = (PyArrayObject *)arguments[0];
  if (!PyArray_CheckExact(arguments[0]) || PyArray_NDIM(array) != 1 || PyArray_TYPE(array) != NPY_DOUBLE ||
      PyArray_DIM(array, 0) != n || !PyArray_ISBEHAVED_RO(array))
    Py_RETURN_NONE;
  double *out;
  PyObject *result = new_vector(n, &out);
  if (result == NULL) return NULL;
  read_vector(arguments[0], n, out);
  for (npy_intp i = 0; i < n; i++)
    if (!isfinite(out[i])) {
      Py_DECREF(result);
      Py_RETURN_NONE;
    }
  return result;
}

#define METHOD(name) {#name, (PyCFunction)(void (*)(void))name, METH_FASTCALL, name##_doc}
static PyMethodDef methods[] = {METHOD(factor),
                                METHOD(solve),
                                METHOD(solve_transposed),
                                METHOD(relative_factor_rate),
                                METHOD(transformed_rate),
                                METHOD(momentum_derivative),
                                METHOD(feedback),
                                METHOD(finite_copy),
                                {NULL, NULL, 0, NULL}};

static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, "_compiled",
                                        "The inner products of the control step, compiled.", -1, methods};

PyMODINIT_FUNC PyInit__compiled(void) {
  import_array();
  return PyModule_Create(&definition);
}
