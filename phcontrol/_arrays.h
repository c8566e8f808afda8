/* How the compiled kernels read NumPy arrays and take working memory. */
#ifndef PHCONTROL_ARRAYS_H
#define PHCONTROL_ARRAYS_H
#define PY_SSIZE_T_CLEAN
#define NPY_NO_DEPRECATED_API NPY_1_20_API_VERSION
#include <Python.h>
#include <math.h>
#include <numpy/arrayobject.h>
#include <string.h>

#define ON_STACK 512 /* doubles: three 12 x 12 matrices and their vectors */

typedef struct {
  double stack[ON_STACK];
  double *start, *next;
} Workspace;

static inline int workspace_open(Workspace *space, npy_intp doubles) {
  space->start = doubles <= ON_STACK ? space->stack : PyMem_Malloc((size_t)doubles * sizeof(double));
  space->next = space->start;
  if (space->start == NULL) {
    PyErr_NoMemory();
    return 0;
  }
  return 1;
}

static inline double *workspace_take(Workspace *space, npy_intp doubles) {
  double *place = space->next;
  space->next += doubles;
  return place;
}

static inline void workspace_close(Workspace *space) {
  if (space->start != space->stack) PyMem_Free(space->start);
}

static inline int is_doubles(PyObject *object, int dimensions, npy_intp size, const char *name) {
  if (PyArray_Check(object)) {
    PyArrayObject *array = (PyArrayObject *)object;
    int right = PyArray_NDIM(array) == dimensions && PyArray_TYPE(array) == NPY_DOUBLE && PyArray_ISBEHAVED_RO(array);
    for (int axis = 0; right && axis < dimensions; axis++) right = PyArray_DIM(array, axis) == size;
    if (right) return 1;
  }
  PyErr_Format(PyExc_ValueError, "%s must be a float64 array with %d axes of length %zd", name, dimensions,
               (Py_ssize_t)size);
  return 0;
}

/* The length that the arrays of one call share, by its first argument; -1 with an error set. */
static inline npy_intp size_of(PyObject *const *arguments, Py_ssize_t given, Py_ssize_t wanted) {
  if (given != wanted) {
    PyErr_Format(PyExc_TypeError, "takes %zd arguments, but %zd were given", wanted, given);
    return -1;
  }
  if (!PyArray_Check(arguments[0]) || PyArray_NDIM((PyArrayObject *)arguments[0]) < 1) {
    PyErr_SetString(PyExc_ValueError, "the first argument must be an array");
    return -1;
  }
  return PyArray_DIM((PyArrayObject *)arguments[0], 0);
}

static inline void read_vector(PyObject *object, npy_intp n, double *out) {
  PyArrayObject *array = (PyArrayObject *)object;
  const char *data = PyArray_BYTES(array);
  npy_intp stride = PyArray_STRIDE(array, 0);
  for (npy_intp i = 0; i < n; i++) out[i] = *(const double *)(data + i * stride);
}

static inline void read_block(const char *data, npy_intp row, npy_intp column, npy_intp n, double *out) {
  for (npy_intp i = 0; i < n; i++)
    for (npy_intp j = 0; j < n; j++) out[i * n + j] = *(const double *)(data + i * row + j * column);
}

static inline void read_matrix(PyObject *object, npy_intp n, double *out) {
  PyArrayObject *array = (PyArrayObject *)object;
  read_block(PyArray_BYTES(array), PyArray_STRIDE(array, 0), PyArray_STRIDE(array, 1), n, out);
}

static inline PyObject *new_vector(npy_intp n, double **data) {
  PyObject *result = PyArray_SimpleNew(1, &n, NPY_DOUBLE);
  if (result != NULL) *data = PyArray_DATA((PyArrayObject *)result);
  return result;
}

/* A zero matrix in Fortran order, the order LAPACK takes without a copy. */
static inline PyObject *new_matrix(npy_intp n, double **data) {
  npy_intp shape[2] = {n, n};
  PyObject *result = PyArray_ZEROS(2, shape, NPY_DOUBLE, 1);
  if (result != NULL) *data = PyArray_DATA((PyArrayObject *)result);
  return result;
}

static inline int is_matrix(PyObject *object, npy_intp rows, npy_intp columns, const char *name) {
  if (PyArray_Check(object)) {
    PyArrayObject *array = (PyArrayObject *)object;
    if (PyArray_NDIM(array) == 2 && PyArray_TYPE(array) == NPY_DOUBLE && PyArray_ISBEHAVED_RO(array) &&
        PyArray_DIM(array, 0) == rows && PyArray_DIM(array, 1) == columns)
      return 1;
  }
  PyErr_Format(PyExc_ValueError, "%s must be a float64 array of shape (%zd, %zd)", name, (Py_ssize_t)rows,
               (Py_ssize_t)columns);
  return 0;
}

static inline int is_counted(Py_ssize_t given, Py_ssize_t wanted) {
  if (given == wanted) return 1;
  PyErr_Format(PyExc_TypeError, "takes %zd arguments, but %zd were given", wanted, given);
  return 0;
}

/* Shape of a matrix that the others are measured by; 0 with an error set. */
static inline int shape_of(PyObject *object, const char *name, npy_intp *rows, npy_intp *columns) {
  if (!PyArray_Check(object) || PyArray_NDIM((PyArrayObject *)object) != 2) {
    PyErr_Format(PyExc_ValueError, "%s must be an array of two axes", name);
    return 0;
  }
  *rows = PyArray_DIM((PyArrayObject *)object, 0);
  *columns = PyArray_DIM((PyArrayObject *)object, 1);
  return is_matrix(object, *rows, *columns, name);
}

static inline void read_rows(PyObject *object, npy_intp rows, npy_intp columns, double *out) {
  PyArrayObject *array = (PyArrayObject *)object;
  const char *data = PyArray_BYTES(array);
  const npy_intp row = PyArray_STRIDE(array, 0), column = PyArray_STRIDE(array, 1);
  for (npy_intp i = 0; i < rows; i++)
    for (npy_intp j = 0; j < columns; j++) out[i * columns + j] = *(const double *)(data + i * row + j * column);
}

static inline PyObject *new_rows(npy_intp rows, npy_intp columns, double **data) {
  npy_intp shape[2] = {rows, columns};
  PyObject *result = PyArray_SimpleNew(2, shape, NPY_DOUBLE);
  if (result != NULL) *data = PyArray_DATA((PyArrayObject *)result);
  return result;
}

static inline int number_of(PyObject *object, double *out) {
  *out = PyFloat_AsDouble(object);
  return !(*out == -1.0 && PyErr_Occurred());
}

#endif
