/* Calls a compiled law from Python: checks, copies and the call in C, without the lock of the interpreter.

   What is not a plain float64 array of finite numbers, a guard that does not hold, and an answer that is not finite all
   lead to `fallback`, the same call in Python: it says what is wrong, or computes by the interpreted law. */
#include "../_arrays.h"
#include <stddef.h>
#include <stdint.h>

typedef int (*Law)(double, const double *, const double *, const double *, const double *, const double *, double *);

#define FIELDS 3 /* of Measured */

typedef struct {
  PyObject *part;   /* (dict, names, values) */
  uint64_t version; /* of the dict, when it was last looked at */
} WatchedDict;

typedef struct {
  PyObject_HEAD
  vectorcallfunc call;
  Law law;
  npy_intp joints, state, numbers;
  npy_intp measured[FIELDS]; /* lengths; 0 for what is not needed */
  npy_intp doubles;          /* of working memory */
  double *values;            /* the law's numbers */
  PyObject *fallback, *command, *owner;
  PyObject *watched; /* (dicts, lists, arrays, others) of watch.py, or NULL */
  WatchedDict *dicts; /* its first part */
  Py_ssize_t dict_count;
  unsigned long long steps, fallbacks;
} Caller;

/* Copy n finite doubles; 0 where there are none such. */
static int take(PyObject *object, npy_intp n, double *out) {
  PyArrayObject *array = (PyArrayObject *)object;
  if (!PyArray_Check(object) || PyArray_NDIM(array) != 1 || PyArray_TYPE(array) != NPY_DOUBLE ||
      PyArray_DIM(array, 0) != n || !PyArray_ISBEHAVED_RO(array))
    return 0;
  read_vector(object, n, out);
  for (npy_intp i = 0; i < n; i++)
    if (!isfinite(out[i])) return 0;
  return 1;
}

/* Whether a dict has what it had; the keys are in its order, and there may be others between them. */
static int dict_is_the_same(PyObject *dict, PyObject *names, PyObject *values) {
  Py_ssize_t place = 0, next = 0, count = PyTuple_GET_SIZE(names);
  PyObject *name, *value;
  while (next < count && PyDict_Next(dict, &place, &name, &value)) {
    if (name != PyTuple_GET_ITEM(names, next)) continue;
    if (value != PyTuple_GET_ITEM(values, next)) return 0;
    next++;
  }
  return next == count;
}

/* Whether a cell, a dict of globals or a class has what it had. */
static int place_is_the_same(PyObject *where, PyObject *name, PyObject *value) {
  if (PyCell_Check(where)) return PyCell_GET(where) == value;
  if (PyDict_Check(where)) {
    PyObject *found = PyDict_GetItemWithError(where, name);
    if (found == NULL) PyErr_Clear();
    return found == value;
  }
  PyObject *found = PyObject_GetAttr(where, name);
  if (found == NULL) PyErr_Clear();
  Py_XDECREF(found);
  return found == value;
}

/* A number that every change of a dict changes, to one that no dict had before; 0 where this Python has none. Python
   3.12 made it internal: there the dicts are looked through. */
static uint64_t version_of(PyObject *dict) {
#if PY_VERSION_HEX < 0x030C0000
  return ((PyDictObject *)dict)->ma_version_tag;
#else
  (void)dict;
  return 0;
#endif
}

static int array_is_the_same(PyArrayObject *array, PyArrayObject *copy) {
  npy_intp bytes = PyArray_ITEMSIZE(copy);
  if (PyArray_NDIM(array) != PyArray_NDIM(copy)) return 0;
  for (int axis = 0; axis < PyArray_NDIM(copy); axis++) {
    if (PyArray_DIM(array, axis) != PyArray_DIM(copy, axis)) return 0;
    bytes *= PyArray_DIM(copy, axis);
  }
  return memcmp(PyArray_DATA(array), PyArray_DATA(copy), (size_t)bytes) == 0;
}

/* Whether all that is watched is the same, so that what was compiled is what the law is. */
static int is_as_it_was(Caller *self) {
  PyObject *watched = self->watched;
  if (watched == NULL) return 1;
  for (Py_ssize_t i = 0; i < self->dict_count; i++) {
    PyObject *part = self->dicts[i].part, *dict = PyTuple_GET_ITEM(part, 0);
    const uint64_t version = version_of(dict);
    if (version != 0 && version == self->dicts[i].version) continue;
    if (!dict_is_the_same(dict, PyTuple_GET_ITEM(part, 1), PyTuple_GET_ITEM(part, 2))) return 0;
    self->dicts[i].version = version;
  }
  PyObject *parts = PyTuple_GET_ITEM(watched, 1);
  for (Py_ssize_t i = 0; i < PyList_GET_SIZE(parts); i++) {
    PyObject *list = PyTuple_GET_ITEM(PyList_GET_ITEM(parts, i), 0), *values = PyTuple_GET_ITEM(PyList_GET_ITEM(parts, i), 1);
    if (PyList_GET_SIZE(list) != PyTuple_GET_SIZE(values)) return 0;
    for (Py_ssize_t k = 0; k < PyList_GET_SIZE(list); k++)
      if (PyList_GET_ITEM(list, k) != PyTuple_GET_ITEM(values, k)) return 0;
  }
  parts = PyTuple_GET_ITEM(watched, 2);
  for (Py_ssize_t i = 0; i < PyList_GET_SIZE(parts); i++) {
    PyObject *part = PyList_GET_ITEM(parts, i);
    if (!array_is_the_same((PyArrayObject *)PyTuple_GET_ITEM(part, 0), (PyArrayObject *)PyTuple_GET_ITEM(part, 1))) return 0;
  }
  parts = PyTuple_GET_ITEM(watched, 3);
  for (Py_ssize_t i = 0; i < PyList_GET_SIZE(parts); i++) {
    PyObject *part = PyList_GET_ITEM(parts, i);
    if (!place_is_the_same(PyTuple_GET_ITEM(part, 0), PyTuple_GET_ITEM(part, 1), PyTuple_GET_ITEM(part, 2))) return 0;
  }
  return 1;
}

/* Whether what is to be watched has the shape that is_as_it_was reads without asking. */
static int can_be_watched(PyObject *watched) {
  static const Py_ssize_t sizes[] = {3, 2, 2, 3};
  if (!PyTuple_Check(watched) || PyTuple_GET_SIZE(watched) != 4) return 0;
  for (int kind = 0; kind < 4; kind++) {
    PyObject *parts = PyTuple_GET_ITEM(watched, kind);
    if (!PyList_Check(parts)) return 0;
    for (Py_ssize_t i = 0; i < PyList_GET_SIZE(parts); i++) {
      PyObject *part = PyList_GET_ITEM(parts, i);
      if (!PyTuple_Check(part) || PyTuple_GET_SIZE(part) != sizes[kind]) return 0;
      PyObject *first = PyTuple_GET_ITEM(part, 0), *second = PyTuple_GET_ITEM(part, 1);
      if (kind == 0 && !(PyDict_Check(first) && PyTuple_Check(second) && PyTuple_Check(PyTuple_GET_ITEM(part, 2)) &&
                         PyTuple_GET_SIZE(second) == PyTuple_GET_SIZE(PyTuple_GET_ITEM(part, 2))))
        return 0;
      if (kind == 1 && !(PyList_Check(first) && PyTuple_Check(second))) return 0;
      if (kind == 2 && !(PyArray_Check(first) && PyArray_Check(second) && PyArray_ISCONTIGUOUS((PyArrayObject *)first) &&
                         PyArray_ISCONTIGUOUS((PyArrayObject *)second)))
        return 0;
    }
  }
  return 1;
}

static PyObject *answer(Caller *self, const double *out) {
  double *place;
  PyObject *torque = new_vector(self->joints, &place);
  if (torque == NULL) return NULL;
  memcpy(place, out, (size_t)self->joints * sizeof(double));
  PyObject *rate = new_vector(self->state, &place);
  if (rate == NULL) {
    Py_DECREF(torque);
    return NULL;
  }
  memcpy(place, out + self->joints, (size_t)self->state * sizeof(double));
  PyObject *pair = PyTuple_Pack(2, torque, rate), *wrapped = NULL, *result = NULL;
  Py_DECREF(torque);
  Py_DECREF(rate);
  if (pair != NULL && (wrapped = PyTuple_Pack(1, pair)) != NULL)
    result = PyTuple_Type.tp_new((PyTypeObject *)self->command, wrapped, NULL);
  Py_XDECREF(pair);
  Py_XDECREF(wrapped);
  return result;
}

static PyObject *call(PyObject *object, PyObject *const *arguments, size_t flags, PyObject *keywords) {
  Caller *self = (Caller *)object;
  Py_ssize_t given = PyVectorcall_NARGS(flags);
  int done = 0;
  PyObject *result = NULL;
  Workspace space;
  if (keywords != NULL || given < 4 || given > 5 || self->law == NULL) goto otherwise;
  if (!PyFloat_Check(arguments[0])) goto otherwise;
  if (!workspace_open(&space, self->doubles)) return NULL;
  {
    double t = PyFloat_AS_DOUBLE(arguments[0]);
    double *q = workspace_take(&space, self->joints), *v = workspace_take(&space, self->joints);
    double *s = workspace_take(&space, self->state);
    double *m = workspace_take(&space, self->measured[0] + self->measured[1] + self->measured[2]);
    double *out = workspace_take(&space, self->joints + self->state), *next = m;
    int right = is_as_it_was(self) && isfinite(t) && take(arguments[1], self->joints, q) && take(arguments[2], self->joints, v) &&
                take(arguments[3], self->state, s);
    for (int field = 0; right && field < FIELDS; field++) {
      if (self->measured[field] == 0) continue;
      right = given == 5 && PyTuple_Check(arguments[4]) && PyTuple_GET_SIZE(arguments[4]) == FIELDS &&
              take(PyTuple_GET_ITEM(arguments[4], field), self->measured[field], next);
      next += self->measured[field];
    }
    if (right) {
      Py_BEGIN_ALLOW_THREADS
      done = self->law(t, q, v, s, m, self->values, out);
      for (npy_intp i = 0; done && i < self->joints + self->state; i++) done = isfinite(out[i]) != 0;
      Py_END_ALLOW_THREADS
    }
    if (done) result = answer(self, out);
  }
  workspace_close(&space);
otherwise:
  self->steps++;
  if (done) return result;
  self->fallbacks++;
  return PyObject_Vectorcall(self->fallback, arguments, (size_t)given, keywords);
}

static int traverse(PyObject *object, visitproc visit, void *arg) {
  Caller *self = (Caller *)object;
  Py_VISIT(self->fallback);
  Py_VISIT(self->command);
  Py_VISIT(self->owner);
  Py_VISIT(self->watched);
  for (Py_ssize_t i = 0; i < self->dict_count; i++) Py_VISIT(self->dicts[i].part);
  return 0;
}

static int clear(PyObject *object) {
  Caller *self = (Caller *)object;
  Py_CLEAR(self->fallback);
  Py_CLEAR(self->command);
  Py_CLEAR(self->owner);
  Py_CLEAR(self->watched);
  const Py_ssize_t count = self->dict_count;
  self->dict_count = 0;
  for (Py_ssize_t i = 0; i < count; i++) Py_CLEAR(self->dicts[i].part);
  return 0;
}

static void dealloc(PyObject *object) {
  PyObject_GC_UnTrack(object);
  clear(object);
  PyMem_Free(((Caller *)object)->values);
  PyMem_Free(((Caller *)object)->dicts);
  Py_TYPE(object)->tp_free(object);
}

static PyObject *make(PyTypeObject *type, PyObject *arguments, PyObject *keywords) {
  static char *names[] = {"address", "joints", "state", "measured", "numbers", "fallback", "command", "owner", "watched", NULL};
  unsigned long long address;
  Py_ssize_t joints, state, measured[FIELDS];
  PyObject *numbers, *fallback, *command, *owner, *watched = NULL;
  if (!PyArg_ParseTupleAndKeywords(arguments, keywords, "Knn(nnn)OOO!O|O", names, &address, &joints, &state, &measured[0],
                                   &measured[1], &measured[2], &numbers, &fallback, &PyType_Type, &command, &owner, &watched))
    return NULL;
  if (!PyArray_Check(numbers) || PyArray_NDIM((PyArrayObject *)numbers) != 1 ||
      !is_doubles(numbers, 1, PyArray_DIM((PyArrayObject *)numbers, 0), "numbers"))
    return PyErr_Occurred() ? NULL : (PyErr_SetString(PyExc_ValueError, "numbers must be a vector"), NULL);
  if (watched != NULL && !can_be_watched(watched)) {
    PyErr_SetString(PyExc_ValueError, "what is watched must be lists of dicts, lists, contiguous arrays and others");
    return NULL;
  }
  if (joints < 1 || state < 0 || !PyType_IsSubtype((PyTypeObject *)command, &PyTuple_Type)) {
    PyErr_SetString(PyExc_ValueError, "the layout is wrong");
    return NULL;
  }
  Caller *self = (Caller *)type->tp_alloc(type, 0);
  if (self == NULL) return NULL;
  self->call = call;
  self->law = (Law)(uintptr_t)address;
  self->joints = joints;
  self->state = state;
  self->doubles = 3 * joints + 2 * state;
  for (int field = 0; field < FIELDS; field++) self->doubles += self->measured[field] = measured[field];
  self->numbers = PyArray_DIM((PyArrayObject *)numbers, 0);
  self->values = PyMem_Malloc((size_t)(self->numbers + 1) * sizeof(double));
  PyObject *dicts = watched == NULL ? NULL : PyTuple_GET_ITEM(watched, 0);
  const Py_ssize_t count = dicts == NULL ? 0 : PyList_GET_SIZE(dicts);
  self->dicts = PyMem_Calloc((size_t)count + 1, sizeof(WatchedDict));
  if (self->values == NULL || self->dicts == NULL) {
    Py_DECREF(self);
    return PyErr_NoMemory();
  }
  read_vector(numbers, self->numbers, self->values);
  Py_INCREF(self->fallback = fallback);
  Py_INCREF(self->command = command);
  Py_INCREF(self->owner = owner);
  Py_XINCREF(self->watched = watched);
  self->dict_count = count;
  for (Py_ssize_t i = 0; i < count; i++) Py_INCREF(self->dicts[i].part = PyList_GET_ITEM(dicts, i)); /* version 0: unseen */
  return (PyObject *)self;
}

static PyObject *counts(PyObject *object, void *unused) {
  Caller *self = (Caller *)object;
  (void)unused;
  return Py_BuildValue("KK", self->steps, self->fallbacks);
}

static PyGetSetDef properties[] = {
    {"counts", counts, NULL, "How many steps were asked for, and how many of them were left to the fallback.", NULL},
    {NULL, NULL, NULL, NULL, NULL}};

static PyTypeObject caller_type = {
    PyVarObject_HEAD_INIT(NULL, 0).tp_name = "phcontrol.compilation._caller.Caller",
    .tp_basicsize = sizeof(Caller),
    .tp_flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC | Py_TPFLAGS_HAVE_VECTORCALL,
    .tp_vectorcall_offset = offsetof(Caller, call),
    .tp_call = PyVectorcall_Call,
    .tp_new = make,
    .tp_dealloc = dealloc,
    .tp_traverse = traverse,
    .tp_clear = clear,
    .tp_getset = properties,
    .tp_doc = "Caller(address, joints, state, measured, numbers, fallback, command, owner, watched)\n--\n\n"
              "Call it with (t, q, v, state, measured); returns the command.",
};

static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, "_caller", "Calls compiled laws.", -1, NULL};

PyMODINIT_FUNC PyInit__caller(void) {
  import_array();
  if (PyType_Ready(&caller_type) < 0) return NULL;
  PyObject *module = PyModule_Create(&definition);
  if (module == NULL) return NULL;
  Py_INCREF(&caller_type);
  if (PyModule_AddObject(module, "Caller", (PyObject *)&caller_type) < 0) {
    Py_DECREF(&caller_type);
    Py_DECREF(module);
    return NULL;
  }
  return module;
}
