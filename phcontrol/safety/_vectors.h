/* Arguments of the torque filter's compiled kernels. */
#ifndef PHCONTROL_SAFETY_VECTORS_H
#define PHCONTROL_SAFETY_VECTORS_H
#include "../_arrays.h"

#define RETURN_UNLESS(condition) \
  if (!(condition)) return NULL

/* Whether an array is a vector of n doubles that lie side by side; they can then be used as they are. */
static inline int is_dense(PyObject *object, npy_intp n, const char *name) {
  if (!is_doubles(object, 1, n, name)) return 0;
  if (n <= 1 || PyArray_STRIDE((PyArrayObject *)object, 0) == (npy_intp)sizeof(double)) return 1;
  PyErr_Format(PyExc_ValueError, "%s must be contiguous", name);
  return 0;
}

static inline double *values_of(PyObject *object) { return PyArray_DATA((PyArrayObject *)object); }

/* A C-ordered (m, n) matrix of doubles, m >= least; returns m or -1. */
static inline npy_intp rows_of(PyObject *object, npy_intp n, npy_intp least, const char *name) {
  if (PyArray_Check(object)) {
    PyArrayObject *array = (PyArrayObject *)object;
    if (PyArray_NDIM(array) == 2 && PyArray_TYPE(array) == NPY_DOUBLE && PyArray_DIM(array, 1) == n &&
        PyArray_DIM(array, 0) >= least && PyArray_IS_C_CONTIGUOUS(array) && PyArray_ISBEHAVED_RO(array))
      return PyArray_DIM(array, 0);
  }
  PyErr_Format(PyExc_ValueError, "%s must be a C-ordered float64 matrix of %zd columns", name, (Py_ssize_t)n);
  return -1;
}

static inline double clip(double value, double low, double high) {
  return value < low ? low : (value > high ? high : value);
}

/* A C-ordered (n, n) matrix whose entries are not set. */
static inline PyObject *new_square(npy_intp n, double **data) {
  npy_intp shape[2] = {n, n};
  PyObject *result = PyArray_SimpleNew(2, shape, NPY_DOUBLE);
  if (result != NULL) *data = PyArray_DATA((PyArrayObject *)result);
  return result;
}

/* A C-ordered (n, n) matrix of doubles, used as it is. */
static inline int is_square(PyObject *object, npy_intp n, const char *name) {
  if (!is_doubles(object, 2, n, name)) return 0;
  if (PyArray_IS_C_CONTIGUOUS((PyArrayObject *)object)) return 1;
  PyErr_Format(PyExc_ValueError, "%s must be C-ordered", name);
  return 0;
}

#define METHOD(name) {#name, (PyCFunction)(void (*)(void))name, METH_FASTCALL, name##_doc}

#endif
