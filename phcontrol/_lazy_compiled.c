/* A quantity computed on first use and once: phcontrol/_lazy.py in C, for it is on the way of every control step. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <structmember.h>

typedef struct {
  PyObject_HEAD PyObject *compute; /* (instance) -> value */
  PyObject *name;
  PyObject *doc;
} Lazy;

static int lazy_init(Lazy *self, PyObject *arguments, PyObject *keywords) {
  PyObject *compute;
  if (keywords != NULL && PyDict_Size(keywords) > 0) {
    PyErr_SetString(PyExc_TypeError, "lazy() takes no keyword arguments");
    return -1;
  }
  if (!PyArg_ParseTuple(arguments, "O", &compute)) return -1;
  PyObject *name = PyObject_GetAttrString(compute, "__name__");
  if (name == NULL) return -1;
  PyObject *doc = PyObject_GetAttrString(compute, "__doc__");
  if (doc == NULL) {
    Py_DECREF(name);
    return -1;
  }
  Py_INCREF(compute);
  Py_XSETREF(self->compute, compute);
  Py_XSETREF(self->name, name);
  Py_XSETREF(self->doc, doc);
  return 0;
}

static int lazy_traverse(Lazy *self, visitproc visit, void *arg) {
  Py_VISIT(self->compute);
  Py_VISIT(self->name);
  Py_VISIT(self->doc);
  return 0;
}

static int lazy_clear(Lazy *self) {
  Py_CLEAR(self->compute);
  Py_CLEAR(self->name);
  Py_CLEAR(self->doc);
  return 0;
}

static void lazy_dealloc(Lazy *self) {
  PyObject_GC_UnTrack(self);
  lazy_clear(self);
  Py_TYPE(self)->tp_free((PyObject *)self);
}

/* A value that is found goes into the instance's __dict__ under the same name: it hides this, which does not set. */
static PyObject *lazy_get(PyObject *object, PyObject *instance, PyObject *owner) {
  Lazy *self = (Lazy *)object;
  if (instance == NULL || instance == Py_None) {
    Py_INCREF(object);
    return object;
  }
  if (self->compute == NULL) {
    PyErr_SetString(PyExc_TypeError, "lazy without a function");
    return NULL;
  }
  PyObject *value = PyObject_CallFunctionObjArgs(self->compute, instance, NULL);
  if (value != NULL && PyObject_SetAttr(instance, self->name, value) < 0) Py_CLEAR(value);
  return value;
}

static PyMemberDef lazy_members[] = {{"compute", T_OBJECT_EX, offsetof(Lazy, compute), READONLY, NULL},
                                     {"name", T_OBJECT_EX, offsetof(Lazy, name), READONLY, NULL},
                                     {"__doc__", T_OBJECT_EX, offsetof(Lazy, doc), 0, NULL},
                                     {NULL, 0, 0, 0, NULL}};

static PyMethodDef lazy_methods[] = {{"__class_getitem__", (PyCFunction)Py_GenericAlias, METH_O | METH_CLASS, NULL},
                                     {NULL, NULL, 0, NULL}};

static PyTypeObject LazyType = {
    PyVarObject_HEAD_INIT(NULL, 0).tp_name = "phcontrol._lazy_compiled.lazy",
    .tp_basicsize = sizeof(Lazy),
    .tp_flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC,
    .tp_new = PyType_GenericNew,
    .tp_init = (initproc)lazy_init,
    .tp_dealloc = (destructor)lazy_dealloc,
    .tp_traverse = (traverseproc)lazy_traverse,
    .tp_clear = (inquiry)lazy_clear,
    .tp_descr_get = lazy_get,
    .tp_members = lazy_members,
    .tp_methods = lazy_methods,
};

static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, "_lazy_compiled",
                                        "A quantity computed on first use and once.", -1, NULL};

PyMODINIT_FUNC PyInit__lazy_compiled(void) {
  if (PyType_Ready(&LazyType) < 0) return NULL;
  PyObject *module = PyModule_Create(&definition);
  if (module == NULL) return NULL;
  Py_INCREF(&LazyType);
  if (PyModule_AddObject(module, "lazy", (PyObject *)&LazyType) < 0) {
    Py_DECREF(&LazyType);
    Py_DECREF(module);
    return NULL;
  }
  return module;
}
