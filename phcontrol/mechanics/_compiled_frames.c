/* The products of the control step about a frame, compiled: what phcontrol/mechanics/kernels.py describes.

   As in _compiled.c each function is one call without temporaries on the heap, for matrices of any strides. */
#include "_triangular.h"

/* --- arithmetic on row-major buffers ------------------------------------------------------------------ */

/* out <- A x of an (m, n) A */
static void times(const double *A, npy_intp m, npy_intp n, const double *x, double *out) {
  for (npy_intp i = 0; i < m; i++) {
    double sum = 0.0;
    for (npy_intp j = 0; j < n; j++) sum += A[i * n + j] * x[j];
    out[i] = sum;
  }
}

/* out <- out + s A^T x */
static void add_transposed(const double *A, npy_intp m, npy_intp n, const double *x, double s, double *out) {
  for (npy_intp i = 0; i < m; i++) {
    const double factor = s * x[i];
    for (npy_intp j = 0; j < n; j++) out[j] += factor * A[i * n + j];
  }
}

/* out <- A A^T, (m, m) */
static void square_of(const double *A, npy_intp m, npy_intp n, double *out) {
  for (npy_intp i = 0; i < m; i++)
    for (npy_intp j = 0; j <= i; j++) {
      double sum = 0.0;
      for (npy_intp k = 0; k < n; k++) sum += A[i * n + k] * A[j * n + k];
      out[i * m + j] = out[j * m + i] = sum;
    }
}

/* Lower triangle of A <- L with A = L L^T; 0 where A is not positive definite. */
static int cholesky(npy_intp n, double *A) {
  for (npy_intp j = 0; j < n; j++)
    for (npy_intp i = j; i < n; i++) {
      double sum = A[i * n + j];
      for (npy_intp k = 0; k < j; k++) sum -= A[i * n + k] * A[j * n + k];
      if (i > j) {
        A[i * n + j] = sum / A[j * n + j];
      } else if (sum > 0.0 && isfinite(sum)) {
        A[j * n + j] = sqrt(sum);
      } else {
        return 0;
      }
    }
  return 1;
}

/* A <- its triangular factors, rows taken in an order; 0 where it is singular. */
static int eliminate(npy_intp n, double *A, npy_intp *order) {
  for (npy_intp i = 0; i < n; i++) order[i] = i;
  for (npy_intp j = 0; j < n; j++) {
    npy_intp pivot = j;
    for (npy_intp i = j + 1; i < n; i++)
      if (fabs(A[i * n + j]) > fabs(A[pivot * n + j])) pivot = i;
    if (A[pivot * n + j] == 0.0) return 0;
    if (pivot != j) {
      const npy_intp place = order[j];
      order[j] = order[pivot];
      order[pivot] = place;
      for (npy_intp k = 0; k < n; k++) {
        const double entry = A[j * n + k];
        A[j * n + k] = A[pivot * n + k];
        A[pivot * n + k] = entry;
      }
    }
    for (npy_intp i = j + 1; i < n; i++) {
      const double factor = A[i * n + j] /= A[j * n + j];
      for (npy_intp k = j + 1; k < n; k++) A[i * n + k] -= factor * A[j * n + k];
    }
  }
  return 1;
}

/* out <- A^-1 b of the factors of A */
static void substitute(npy_intp n, const double *A, const npy_intp *order, const double *b, double *out) {
  for (npy_intp i = 0; i < n; i++) {
    double sum = b[order[i]];
    for (npy_intp k = 0; k < i; k++) sum -= A[i * n + k] * out[k];
    out[i] = sum;
  }
  for (npy_intp i = n - 1; i >= 0; i--) {
    double sum = out[i];
    for (npy_intp k = i + 1; k < n; k++) sum -= A[i * n + k] * out[k];
    out[i] = sum / A[i * n + i];
  }
}

static void turn(double *first, double *second, npy_intp n, double c, double s) {
  for (npy_intp i = 0; i < n; i++) {
    const double x = first[i], y = second[i];
    first[i] = c * x - s * y;
    second[i] = s * x + c * y;
  }
}

/* Diagonal of S <- the eigenvalues of a symmetric S, and the rows of X are turned along: X <- U^T X, S = U diag U^T.
   Jacobi's rotations, which for so small matrices are as fast as any method. */
static void diagonalise(npy_intp n, double *S, double *X) {
  double least = 0.0;
  for (npy_intp i = 0; i < n; i++) least += 1e-42 * S[i * n + i] * S[i * n + i];
  for (int sweep = 0; sweep < 40; sweep++) {
    int busy = 0;
    for (npy_intp p = 0; p < n; p++)
      for (npy_intp q = p + 1; q < n; q++) {
        const double a = S[p * n + q], f = S[p * n + p], g = S[q * n + q];
        if (a * a <= 1e-34 * fabs(f * g) + least) continue; /* smaller ones change nothing, and cost time */
        if (!(isfinite(a) && isfinite(f) && isfinite(g))) {
          for (npy_intp i = 0; i < n * n; i++) X[i] = NAN;
          return;
        }
        busy = 1;
        const double d = g - f, root = sqrt(d * d + 4.0 * a * a);
        const double t = 2.0 * a / (d + copysign(root, d));
        const double c = 1.0 / sqrt(t * t + 1.0), s = t * c;
        turn(S + p * n, S + q * n, n, c, s);
        for (npy_intp k = 0; k < n; k++) {
          S[k * n + p] = S[p * n + k];
          S[k * n + q] = S[q * n + k];
        }
        S[p * n + p] = f - t * a;
        S[q * n + q] = g + t * a;
        S[p * n + q] = S[q * n + p] = 0.0;
        turn(X + p * n, X + q * n, n, c, s);
      }
    if (!busy) return;
  }
}

/* --- what Python calls -------------------------------------------------------------------------------- */

PyDoc_STRVAR(frame_wrench_doc,
             "frame_wrench(r, R, goal_r, goal_R, stiffness, force, turning)\n--\n\n"
             "Return (K (r - r_d) + F, vee(B - B^T)) with B = R_d M R^T; None for what is zero, and for R_d = 1.");
static PyObject *frame_wrench(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  double r[3], R[9], r_d[3], R_d[9], K[9], M[9], B[9], *out;
  if (!is_counted(given, 7)) return NULL;
  PyObject *goal_turn = arguments[3], *stiffness = arguments[4], *force = arguments[5], *turning = arguments[6];
  if (!is_doubles(arguments[0], 1, 3, "r") || !is_matrix(arguments[1], 3, 3, "R") ||
      !is_doubles(arguments[2], 1, 3, "goal_r") || (goal_turn != Py_None && !is_matrix(goal_turn, 3, 3, "goal_R")) ||
      (stiffness != Py_None && !is_matrix(stiffness, 3, 3, "stiffness")) ||
      (force != Py_None && !is_doubles(force, 1, 3, "force")) ||
      (turning != Py_None && !is_matrix(turning, 3, 3, "turning")))
    return NULL;
  PyObject *result = new_vector(6, &out);
  if (result == NULL) return NULL;
  memset(out, 0, 6 * sizeof(double));
  if (stiffness != Py_None) {
    read_vector(arguments[0], 3, r);
    read_vector(arguments[2], 3, r_d);
    read_rows(stiffness, 3, 3, K);
    for (int i = 0; i < 3; i++) r[i] -= r_d[i];
    times(K, 3, 3, r, out);
  }
  if (force != Py_None) {
    read_vector(force, 3, r);
    for (int i = 0; i < 3; i++) out[i] += r[i];
  }
  if (turning != Py_None) {
    read_rows(arguments[1], 3, 3, R);
    read_rows(turning, 3, 3, M);
    if (goal_turn != Py_None) { /* M <- R_d M */
      read_rows(goal_turn, 3, 3, R_d);
      for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
          B[3 * i + j] = 0.0;
          for (int k = 0; k < 3; k++) B[3 * i + j] += R_d[3 * i + k] * M[3 * k + j];
        }
      memcpy(M, B, sizeof B);
    }
    for (int i = 0; i < 3; i++) times(R, 3, 3, M + 3 * i, B + 3 * i); /* rows of M R^T */
    out[3] = B[7] - B[5];
    out[4] = B[2] - B[6];
    out[5] = B[3] - B[1];
  }
  return result;
}

PyDoc_STRVAR(task_space_doc,
             "task_space(jacobian, factor, weight_root)\n--\n\n"
             "Return W = T^-1 J^T, B = W^T W, A = J J^T and (tr Y^4)^(1/2) of Y = H^T A^-1 H; inf where A is singular.");
static PyObject *task_space(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp m, n;
  Workspace space;
  double *W_out, *B, *A, bound = INFINITY;
  if (!is_counted(given, 3) || !shape_of(arguments[0], "jacobian", &m, &n) || !is_matrix(arguments[1], n, n, "factor") ||
      !is_matrix(arguments[2], m, m, "weight_root"))
    return NULL;
  if (!workspace_open(&space, n * n + 2 * m * n + 4 * m * m)) return NULL;
  double *T = workspace_take(&space, n * n), *J = workspace_take(&space, m * n), *W = workspace_take(&space, m * n);
  double *L = workspace_take(&space, m * m), *H = workspace_take(&space, m * m);
  double *Y = workspace_take(&space, m * m), *Y_square = workspace_take(&space, m * m);
  PyObject *reduced = new_rows(n, m, &W_out), *mobility = new_rows(m, m, &B), *square = new_rows(m, m, &A);
  PyObject *result = NULL;
  if (reduced != NULL && mobility != NULL && square != NULL) {
    read_rows(arguments[0], m, n, J);
    read_rows(arguments[1], n, n, T);
    read_rows(arguments[2], m, m, H);
    memcpy(W, J, (size_t)(m * n) * sizeof(double)); /* rows are T^-1 times those of J */
    for (npy_intp i = 0; i < m; i++) forward(T, n, n, W + i * n);
    for (npy_intp i = 0; i < m; i++)
      for (npy_intp j = 0; j < n; j++) W_out[j * m + i] = W[i * n + j];
    square_of(W, m, n, B);
    square_of(J, m, n, A);
    memcpy(L, A, (size_t)(m * m) * sizeof(double));
    if (cholesky(m, L)) {
      double sum = 0.0;
      for (npy_intp j = 0; j < m; j++) { /* rows are L^-1 times the columns of H */
        for (npy_intp i = 0; i < m; i++) Y[j * m + i] = H[i * m + j];
        forward(L, m, m, Y + j * m);
      }
      square_of(Y, m, m, H);
      square_of(H, m, m, Y_square);
      for (npy_intp i = 0; i < m * m; i++) sum += Y_square[i] * Y_square[i];
      bound = sqrt(sum);
    }
    result = Py_BuildValue("OOOd", reduced, mobility, square, bound);
  }
  Py_XDECREF(reduced);
  Py_XDECREF(mobility);
  Py_XDECREF(square);
  workspace_close(&space);
  return result;
}

static PyObject *not_definite(void) {
  return PyErr_Format(PyExc_ArithmeticError, "the matrix is not positive definite");
}

PyDoc_STRVAR(without_task_doc,
             "without_task(jacobian, factor, reduced, mobility, force)\n--\n\n"
             "Return f - J^T B^-1 W^T T^-1 f: what of a force does not accelerate the frame.");
static PyObject *without_task(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp m, n;
  Workspace space;
  double *out = NULL;
  if (!is_counted(given, 5) || !shape_of(arguments[0], "jacobian", &m, &n) || !is_matrix(arguments[1], n, n, "factor") ||
      !is_matrix(arguments[2], n, m, "reduced") || !is_matrix(arguments[3], m, m, "mobility") ||
      !is_doubles(arguments[4], 1, n, "force"))
    return NULL;
  if (!workspace_open(&space, n * n + 2 * m * n + m * m + m + n)) return NULL;
  double *T = workspace_take(&space, n * n), *J = workspace_take(&space, m * n), *W = workspace_take(&space, m * n);
  double *L = workspace_take(&space, m * m), *y = workspace_take(&space, m), *p = workspace_take(&space, n);
  read_rows(arguments[0], m, n, J);
  read_rows(arguments[1], n, n, T);
  read_rows(arguments[2], n, m, W);
  read_rows(arguments[3], m, m, L);
  PyObject *result = cholesky(m, L) ? new_vector(n, &out) : not_definite();
  if (result != NULL) {
    read_vector(arguments[4], n, out);
    memcpy(p, out, (size_t)n * sizeof(double));
    forward(T, n, n, p);
    memset(y, 0, (size_t)m * sizeof(double));
    add_transposed(W, n, m, p, 1.0, y);
    forward(L, m, m, y);
    backward(L, m, y);
    add_transposed(J, m, n, y, -1.0, out);
  }
  workspace_close(&space);
  return result;
}

PyDoc_STRVAR(hand_damping_doc,
             "hand_damping(jacobian, root, mobility, mass_matrix, velocity, rate)\n--\n\n"
             "Return J^T (X X^T - d B^-1) J v + d M v.");
static PyObject *hand_damping(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp m, n;
  Workspace space;
  double *out = NULL, d;
  if (!is_counted(given, 6) || !shape_of(arguments[0], "jacobian", &m, &n) || !is_matrix(arguments[1], m, m, "root") ||
      !is_matrix(arguments[2], m, m, "mobility") || !is_matrix(arguments[3], n, n, "mass_matrix") ||
      !is_doubles(arguments[4], 1, n, "velocity") || !number_of(arguments[5], &d))
    return NULL;
  if (!workspace_open(&space, m * n + 2 * m * m + n * n + n + 3 * m)) return NULL;
  double *J = workspace_take(&space, m * n), *X = workspace_take(&space, m * m), *L = workspace_take(&space, m * m);
  double *M = workspace_take(&space, n * n), *v = workspace_take(&space, n), *twist = workspace_take(&space, m);
  double *wrench = workspace_take(&space, m), *y = workspace_take(&space, m);
  read_rows(arguments[0], m, n, J);
  read_rows(arguments[1], m, m, X);
  read_rows(arguments[2], m, m, L);
  PyObject *result = cholesky(m, L) ? new_vector(n, &out) : not_definite();
  if (result != NULL) {
    read_rows(arguments[3], n, n, M);
    read_vector(arguments[4], n, v);
    times(J, m, n, v, twist);
    memset(y, 0, (size_t)m * sizeof(double));
    add_transposed(X, m, m, twist, 1.0, y);
    times(X, m, m, y, wrench);
    forward(L, m, m, twist);
    backward(L, m, twist);
    for (npy_intp i = 0; i < m; i++) wrench[i] -= d * twist[i];
    times(M, n, n, v, out);
    for (npy_intp i = 0; i < n; i++) out[i] *= d;
    add_transposed(J, m, n, wrench, 1.0, out);
  }
  workspace_close(&space);
  return result;
}

PyDoc_STRVAR(damping_root_doc,
             "damping_root(linear, turning, R, mobility, ratio)\n--\n\n"
             "Return X = (2 ratio)^(1/2) L U S^(-1/4), with L^T B L = U S U^T and L the linear root, and R times that of "
             "turning beside it; None for turning and R where the orientation is free.");
static PyObject *damping_root(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  double L[36], B[36], S[36], product[36], part[9], R[9], ratio, *out; /* L: transposed */
  if (!is_counted(given, 5)) return NULL;
  const int n = arguments[1] == Py_None ? 3 : 6;
  if (!is_matrix(arguments[0], 3, 3, "linear") ||
      (n == 6 && !(is_matrix(arguments[1], 3, 3, "turning") && is_matrix(arguments[2], 3, 3, "R"))) ||
      !is_matrix(arguments[3], n, n, "mobility") || !number_of(arguments[4], &ratio))
    return NULL;
  PyObject *result = new_rows(n, n, &out);
  if (result == NULL) return NULL;
  memset(L, 0, sizeof L);
  read_rows(arguments[0], 3, 3, part);
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) L[j * n + i] = part[3 * i + j];
  if (n == 6) {
    read_rows(arguments[1], 3, 3, part);
    read_rows(arguments[2], 3, 3, R);
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++)
        for (int k = 0; k < 3; k++) L[(3 + j) * 6 + 3 + i] += R[3 * i + k] * part[3 * k + j];
  }
  read_rows(arguments[3], n, n, B);
  for (int i = 0; i < n; i++) times(B, n, n, L + i * n, product + i * n); /* rows of (B L)^T */
  for (int i = 0; i < n; i++)                                            /* L^T B L */
    for (int j = 0; j <= i; j++) {
      double sum = 0.0;
      for (int k = 0; k < n; k++) sum += L[i * n + k] * product[j * n + k];
      S[i * n + j] = S[j * n + i] = sum;
    }
  diagonalise(n, S, L);
  double largest = 0.0;
  for (int i = 0; i < n; i++)
    if (!(S[i * n + i] <= largest)) largest = S[i * n + i];
  for (int j = 0; j < n; j++) {
    const double square = S[j * n + j] < 1e-12 * largest ? 1e-12 * largest : S[j * n + j];
    const double scale = sqrt(2.0 * ratio) / sqrt(sqrt(square));
    for (int i = 0; i < n; i++) out[i * n + j] = L[j * n + i] * scale;
  }
  return result;
}

PyDoc_STRVAR(right_inverse_motion_doc,
             "right_inverse_motion(matrix, rate, square, square_rate, desired, desired_rate)\n--\n\n"
             "Return B^T A^-1 w and its rate; None for the rate of A where that is B B^T. NaN where A is singular.");
static PyObject *right_inverse_motion(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp m, n;
  Workspace space;
  double *motion, *motion_rate;
  if (!is_counted(given, 6) || !shape_of(arguments[0], "matrix", &m, &n) || !is_matrix(arguments[1], m, n, "rate") ||
      !is_matrix(arguments[2], m, m, "square") ||
      (arguments[3] != Py_None && !is_matrix(arguments[3], m, m, "square_rate")) ||
      !is_doubles(arguments[4], 1, m, "desired") || !is_doubles(arguments[5], 1, m, "desired_rate"))
    return NULL;
  if (!workspace_open(&space, 2 * m * n + 2 * m * m + 5 * m + n)) return NULL;
  double *B = workspace_take(&space, m * n), *B_rate = workspace_take(&space, m * n);
  double *A = workspace_take(&space, m * m), *A_rate = workspace_take(&space, m * m);
  double *w = workspace_take(&space, m), *y = workspace_take(&space, m), *w_rate = workspace_take(&space, m);
  double *y_rate = workspace_take(&space, m), *joints = workspace_take(&space, n);
  npy_intp *order = (npy_intp *)workspace_take(&space, m);
  PyObject *first = new_vector(n, &motion), *second = new_vector(n, &motion_rate), *result = NULL;
  if (first != NULL && second != NULL) {
    read_rows(arguments[0], m, n, B);
    read_rows(arguments[1], m, n, B_rate);
    read_rows(arguments[2], m, m, A);
    if (eliminate(m, A, order)) {
      read_vector(arguments[4], m, w);
      read_vector(arguments[5], m, w_rate);
      substitute(m, A, order, w, y);
      memset(motion, 0, (size_t)n * sizeof(double));
      memset(motion_rate, 0, (size_t)n * sizeof(double));
      add_transposed(B, m, n, y, 1.0, motion);
      add_transposed(B_rate, m, n, y, 1.0, motion_rate);
      if (arguments[3] != Py_None) {
        read_rows(arguments[3], m, m, A_rate);
        times(A_rate, m, m, y, w);
      } else { /* (dB B^T + B dB^T) y */
        times(B_rate, m, n, motion, w);
        times(B, m, n, motion_rate, y_rate);
        for (npy_intp i = 0; i < m; i++) w[i] += y_rate[i];
      }
      for (npy_intp i = 0; i < m; i++) w_rate[i] -= w[i];
      substitute(m, A, order, w_rate, y_rate);
      memset(joints, 0, (size_t)n * sizeof(double));
      add_transposed(B, m, n, y_rate, 1.0, joints);
      for (npy_intp i = 0; i < n; i++) motion_rate[i] += joints[i];
    } else {
      for (npy_intp i = 0; i < n; i++) motion[i] = motion_rate[i] = NAN;
    }
    result = PyTuple_Pack(2, first, second);
  }
  Py_XDECREF(first);
  Py_XDECREF(second);
  workspace_close(&space);
  return result;
}

PyDoc_STRVAR(curve_point_doc,
             "curve_point(table, rate, s, speed, acceleration, turned)\n--\n\n"
             "Return r, R, twist and its rate where (r, phi)(s) is the row (1, s, cos ks.., sin ks..) times the table, with "
             "k = rate, 2 rate..; turned: (R_0, u x R_0, u x u x R_0, u), or None.");
static PyObject *curve_point(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
  npy_intp rows, columns;
  double k, s, speed, acceleration, value[4], slope[4], bend[4], *r, *twist, *twist_rate, *R = NULL;
  if (!is_counted(given, 6) || !shape_of(arguments[0], "table", &rows, &columns) || !number_of(arguments[1], &k) ||
      !number_of(arguments[2], &s) || !number_of(arguments[3], &speed) || !number_of(arguments[4], &acceleration))
    return NULL;
  PyObject *turned = arguments[5];
  if (columns != 4 || rows < 2 || rows % 2)
    return PyErr_Format(PyExc_ValueError, "table must be an array of an even number of rows, and 4 columns");
  if (turned != Py_None) {
    if (!PyTuple_Check(turned) || PyTuple_GET_SIZE(turned) != 4)
      return PyErr_Format(PyExc_ValueError, "turned must be a tuple of three matrices and a vector: arrays");
    for (int part = 0; part < 3; part++)
      if (!is_matrix(PyTuple_GET_ITEM(turned, part), 3, 3, "turned")) return NULL;
    if (!is_doubles(PyTuple_GET_ITEM(turned, 3), 1, 3, "axis")) return NULL;
  }
  const PyArrayObject *table = (const PyArrayObject *)arguments[0];
  const npy_intp row = PyArray_STRIDE(table, 0), column = PyArray_STRIDE(table, 1), waves = rows / 2 - 1;
#define ENTRY(i, j) (*(const double *)(PyArray_BYTES(table) + (i) * row + (j) * column))
  for (int j = 0; j < 4; j++) {
    slope[j] = ENTRY(1, j);
    value[j] = ENTRY(0, j) + s * slope[j];
    bend[j] = 0.0;
  }
  for (npy_intp wave = 0; wave < waves; wave++) {
    const double often = (double)(wave + 1) * k, cosine = cos(often * s), sine = sin(often * s);
    for (int j = 0; j < 4; j++) {
      const double a = ENTRY(2 + wave, j), b = ENTRY(2 + waves + wave, j), out = cosine * a + sine * b;
      value[j] += out;
      slope[j] += often * (cosine * b - sine * a);
      bend[j] -= often * often * out;
    }
  }
  const npy_intp size = turned == Py_None ? 3 : 6;
  PyObject *position = new_vector(3, &r), *first = new_vector(size, &twist), *second = new_vector(size, &twist_rate);
  PyObject *rotation = turned == Py_None ? Py_NewRef(Py_None) : new_rows(3, 3, &R), *result = NULL;
  if (position != NULL && first != NULL && second != NULL && rotation != NULL) {
    for (int j = 0; j < 3; j++) {
      r[j] = value[j];
      twist[j] = slope[j] * speed;
      twist_rate[j] = bend[j] * speed * speed + slope[j] * acceleration;
    }
    if (turned != Py_None) {
      double parts[3][9], axis[3];
      const double sine = sin(value[3]), rest = 1.0 - cos(value[3]);
      for (int part = 0; part < 3; part++) read_rows(PyTuple_GET_ITEM(turned, part), 3, 3, parts[part]);
      read_vector(PyTuple_GET_ITEM(turned, 3), 3, axis);
      for (int i = 0; i < 9; i++) R[i] = parts[0][i] + sine * parts[1][i] + rest * parts[2][i];
      for (int j = 0; j < 3; j++) {
        twist[3 + j] = slope[3] * speed * axis[j];
        twist_rate[3 + j] = (bend[3] * speed * speed + slope[3] * acceleration) * axis[j];
      }
    }
    result = PyTuple_Pack(4, position, rotation, first, second);
  }
  Py_XDECREF(position);
  Py_XDECREF(rotation);
  Py_XDECREF(first);
  Py_XDECREF(second);
  return result;
}

#define METHOD(name) {#name, (PyCFunction)(void (*)(void))name, METH_FASTCALL, name##_doc}
static PyMethodDef methods[] = {METHOD(frame_wrench), METHOD(task_space),   METHOD(without_task),
                                METHOD(hand_damping), METHOD(damping_root), METHOD(right_inverse_motion),
                                METHOD(curve_point),
                                {NULL, NULL, 0, NULL}};

static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, "_compiled_frames",
                                        "The products of the control step about a frame, compiled.", -1, methods};

PyMODINIT_FUNC PyInit__compiled_frames(void) {
  import_array();
  return PyModule_Create(&definition);
}
