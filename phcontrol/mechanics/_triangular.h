/* Solving with a lower triangular matrix of doubles, in place. */
#ifndef PHCONTROL_TRIANGULAR_H
#define PHCONTROL_TRIANGULAR_H
#include "../_arrays.h"

/* b <- T^-1 b for the leading n rows of a T whose rows are `stride` long. */
static inline void forward(const double *T, npy_intp stride, npy_intp n, double *b) {
  for (npy_intp i = 0; i < n; i++) {
    double sum = b[i];
    for (npy_intp k = 0; k < i; k++) sum -= T[i * stride + k] * b[k];
    b[i] = sum / T[i * stride + i];
  }
}

/* b <- T^-T b */
static inline void backward(const double *T, npy_intp n, double *b) {
  for (npy_intp i = n - 1; i >= 0; i--) {
    const double value = b[i] /= T[i * n + i];
    for (npy_intp k = 0; k < i; k++) b[k] -= T[i * n + k] * value;
  }
}

#endif
