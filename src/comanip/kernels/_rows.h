/* Recorder.add: numbers and arrays side by side in one row. The arrays are mostly the same at every tick, and are taken once. */

typedef struct {
    PyObject_HEAD
    Py_ssize_t n;
    Array rows;   /* the block that rows go into */
    Array *slots; /* [n] what comes at each place */
} Rows;

/* The numbers of an array of float64, taken anew when it is another one than last time; NULL for anything else. See `kept`. */
static const Py_buffer *numbers_of(Array *slot, PyObject *object, int writable) {
    Py_buffer *view = &slot->view;
    if (view->obj == object) return view;
    PyBuffer_Release(view);
    if (PyObject_GetBuffer(object, view, PyBUF_FORMAT | PyBUF_C_CONTIGUOUS | (writable ? PyBUF_WRITABLE : 0)) < 0) {
        PyErr_Clear();
        view->obj = NULL;
        return NULL;
    }
    if (view->obj == object && view->format && view->format[0] == 'd' && !view->format[1]) return view;
    PyBuffer_Release(view);
    return NULL;
}

static PyObject *rows_new(PyTypeObject *type, PyObject *args, PyObject *keywords) {
    Py_ssize_t n;
    (void)keywords;
    if (!PyArg_ParseTuple(args, "n", &n)) return NULL;
    if (n < 0 || n > 1 << 16) return PyErr_Format(PyExc_ValueError, "a row has 0 to 65536 places");
    Rows *self = (Rows *)PyType_GenericAlloc(type, 0);
    if (!self) return NULL;
    if (!(self->slots = calloc((size_t)n + 1, sizeof(Array)))) {
        Py_DecRef((PyObject *)self);
        return PyErr_NoMemory();
    }
    self->n = n;
    return (PyObject *)self;
}

static void rows_dealloc(PyObject *object) {
    Rows *self = (Rows *)object;
    PyTypeObject *type = Py_TYPE(object);
    PyBuffer_Release(&self->rows.view);
    for (Py_ssize_t i = 0; i < self->n; i++) PyBuffer_Release(&self->slots[i].view);
    free(self->slots);
    freefunc release_object = (freefunc)PyType_GetSlot(type, Py_tp_free);
    release_object(object);
    Py_DecRef((PyObject *)type);
}

/* (rows (N, width), which, time, [values]) */
static PyObject *rows_lay(PyObject *object, PyObject *const *args, Py_ssize_t n) {
    Rows *self = (Rows *)object;
    if (n != 4 || !PyList_Check(args[3]) || PyList_Size(args[3]) != self->n || !PyFloat_Check(args[2])) Py_RETURN_FALSE;
    const Py_buffer *rows = numbers_of(&self->rows, args[0], 1);
    const Py_ssize_t which = PyLong_AsSsize_t(args[1]);
    if (PyErr_Occurred()) return NULL;
    if (!rows || rows->ndim != 2 || which < 0 || which >= rows->shape[0]) Py_RETURN_FALSE;
    double *to = (double *)rows->buf + which * rows->shape[1], *end = to + rows->shape[1];
    if (to == end) Py_RETURN_FALSE;
    *to++ = PyFloat_AsDouble(args[2]);
    for (Py_ssize_t i = 0; i < self->n; i++) {
        PyObject *value = PyList_GetItem(args[3], i);
        if (PyFloat_Check(value)) {
            if (to == end) Py_RETURN_FALSE;
            *to++ = PyFloat_AsDouble(value);
            continue;
        }
        const Py_buffer *numbers = numbers_of(&self->slots[i], value, 0);
        if (!numbers || numbers->len > (char *)end - (char *)to) Py_RETURN_FALSE;
        memcpy(to, numbers->buf, (size_t)numbers->len);
        to += numbers->len / 8;
    }
    return PyBool_FromLong(to == end);
}

static PyMethodDef rows_methods[] = {
    {"lay", (PyCFunction)(void (*)(void))rows_lay, METH_FASTCALL, "One row; False where numpy has to lay it."},
    {NULL, NULL, 0, NULL},
};
static PyType_Slot rows_slots[] = {{Py_tp_new, rows_new}, {Py_tp_dealloc, rows_dealloc}, {Py_tp_methods, rows_methods}, {0, NULL}};
static PyType_Spec rows_spec = {"comanip.kernels._native.Rows", sizeof(Rows), 0, Py_TPFLAGS_DEFAULT, rows_slots};
