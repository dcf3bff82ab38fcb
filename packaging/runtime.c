/* The module: how arrays come in and go out, and the table of the kernels. */

static PyObject *array_class, *kinds[KINDS];
static const int64_t sizes[KINDS] = {8, 4, 8, 4, 1, 1};

Array array_of(Call *call, PyObject *object) {
    Array a = {0};
    Py_buffer *view = &call->views[call->count];
    if (call->failed || PyObject_GetBuffer(object, view, PyBUF_STRIDES) < 0) {
        call->failed = 1;
        return a;
    }
    call->objects[call->count++] = object;
    a.p = view->buf;
    if (view->ndim > 0) a.n0 = view->shape[0], a.s0 = view->strides[0];
    if (view->ndim > 1) a.n1 = view->shape[1], a.s1 = view->strides[1];
    if (view->ndim > 2) a.n2 = view->shape[2], a.s2 = view->strides[2];
    return a;
}

PyObject *end_call(Call *call, PyObject *result) {
    while (call->count) PyBuffer_Release(&call->views[--call->count]);
    return result;
}

void raise(int bad) {
    if (PyErr_Occurred()) return;
    if (bad == DIVISION) PyErr_SetString(PyExc_ZeroDivisionError, "division by zero");
    else if (bad == EMPTY) PyErr_SetString(PyExc_ValueError, "zero-size array to reduction operation");
    else if (bad == NEGATIVE) PyErr_SetString(PyExc_ValueError, "negative dimensions not allowed");
    else PyErr_NoMemory();
}

/* The array as a caller gets it: the one that was passed, if it is that, else one on the memory of `a`. */
PyObject *box_array(Call *call, Array a, int axes, int kind) {
    int64_t n[3] = {a.n0, a.n1, a.n2}, s[3] = {a.s0, a.s1, a.s2};
    for (int i = 0; !a.owner && i < call->count; i++) {
        Py_buffer *view = &call->views[i];
        int same = view->buf == a.p && view->ndim == axes;
        for (int axis = 0; same && axis < axes; axis++)
            same = view->shape[axis] == n[axis] && view->strides[axis] == s[axis];
        if (same) {
            Py_INCREF(call->objects[i]);
            return call->objects[i];
        }
    }
    if (!a.owner) { /* a part of what was passed: a copy */
        int bad = 0;
        Array copy = shaped(sizes[kind], axes, a.n0, a.n1, a.n2, &bad);
        for (int64_t i = 0; !bad && i < a.n0; i++)
            for (int64_t j = 0; j < (axes > 1 ? a.n1 : 1); j++)
                for (int64_t k = 0; k < (axes > 2 ? a.n2 : 1); k++)
                    memcpy(copy.p + i * copy.s0 + (axes > 1 ? j * copy.s1 : 0) + (axes > 2 ? k * copy.s2 : 0),
                           a.p + i * a.s0 + (axes > 1 ? j * a.s1 : 0) + (axes > 2 ? k * a.s2 : 0),
                           (size_t)sizes[kind]);
        if (bad) return raise(bad), NULL;
        a = copy, s[0] = a.s0, s[1] = a.s1, s[2] = a.s2;
    }
    PyObject *shape = PyTuple_New(axes), *steps = PyTuple_New(axes), *made = NULL;
    if (shape && steps) {
        for (int axis = 0; axis < axes; axis++) {
            PyTuple_SetItem(shape, axis, PyLong_FromLongLong(n[axis]));
            PyTuple_SetItem(steps, axis, PyLong_FromLongLong(s[axis]));
        }
        PyObject *offset = PyLong_FromLongLong(a.p - PyByteArray_AsString(a.owner));
        made = PyObject_CallFunctionObjArgs(array_class, shape, kinds[kind], a.owner, offset, steps, NULL);
        Py_XDECREF(offset);
    }
    Py_XDECREF(shape);
    Py_XDECREF(steps);
    Py_DECREF(a.owner);
    return made;
}

PyObject *pack(int count, ...) {
    PyObject *tuple = PyTuple_New(count);
    int complete = tuple != NULL;
    va_list items;
    va_start(items, count);
    for (int i = 0; i < count; i++) {
        PyObject *item = va_arg(items, PyObject *);
        complete = complete && item;
        if (tuple && item) PyTuple_SetItem(tuple, i, item);
        else Py_XDECREF(item);
    }
    va_end(items);
    if (complete) return tuple;
    Py_XDECREF(tuple);
    return NULL;
}

static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, "compiled", "Kernels, compiled.", -1, table,
                                        NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit_compiled(void) {
    static const char *names[KINDS] = {"f8", "f4", "i8", "i4", "u1", "?"};
    PyObject *numpy = PyImport_ImportModule("numpy");
    if (!numpy) return NULL;
    array_class = PyObject_GetAttrString(numpy, "ndarray");
    for (int kind = 0; kind < KINDS; kind++)
        if (!(kinds[kind] = PyObject_CallMethod(numpy, "dtype", "s", names[kind]))) return NULL;
    Py_DECREF(numpy);
    return array_class ? PyModule_Create(&definition) : NULL;
}
