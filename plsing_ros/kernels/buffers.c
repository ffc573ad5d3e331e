/* Arrays through the buffer protocol. */

#include "kernels.h"

#include <string.h>

#define MOST_ROWS 1000000

Py_ssize_t take_arrays(PyObject *const *objects, const int *columns, int count, int written, Py_buffer *buffers)
{
    Py_ssize_t rows = 0;
    for (int i = 0; i < count; i++) {
        int flags = PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (i >= count - written ? PyBUF_WRITABLE : 0);
        if (PyObject_GetBuffer(objects[i], &buffers[i], flags) == 0) {
            Py_ssize_t length = buffers[i].len / (Py_ssize_t)sizeof(double);
            if (i == 0 && columns[0] > 0)
                rows = length / columns[0];
            int doubles = strcmp(buffers[i].format, "d") == 0 || strcmp(buffers[i].format, "Zd") == 0;
            if (doubles && rows <= MOST_ROWS &&
                length == (columns[i] > 0 ? columns[i] * rows : -columns[i]))
                continue;
            PyBuffer_Release(&buffers[i]);
            PyErr_Format(PyExc_ValueError, "array %d is neither float64 nor complex128, or of a size that does not fit", i);
        }
        while (i-- > 0)
            PyBuffer_Release(&buffers[i]);
        return -1;
    }
    return rows;
}

void release_arrays(Py_buffer *buffers, int count)
{
    while (count-- > 0)
        PyBuffer_Release(&buffers[count]);
}

int are_arguments(Py_ssize_t given, Py_ssize_t expected)
{
    if (given == expected)
        return 1;
    PyErr_Format(PyExc_TypeError, "%zd arguments given, %zd expected", given, expected);
    return 0;
}

PyObject *truth(int value)
{
    return PyErr_Occurred() ? NULL : PyBool_FromLong(value);
}

int count_columns(PyObject *array)
{
    Py_ssize_t length = PyObject_Length(array);
    if (length >= 1 && length <= MOST_COLUMNS)
        return (int)length;
    if (!PyErr_Occurred())
        PyErr_SetString(PyExc_ValueError, "there must be 1 to 6 singular values");
    return -1;
}

int take_number(PyObject *object, double *value)
{
    *value = PyFloat_AsDouble(object);
    return !(*value == -1.0 && PyErr_Occurred());
}

int count_rows(PyObject *array)
{
    Py_ssize_t rows = PyObject_Length(array);
    if (rows > MOST_ROWS)
        PyErr_Format(PyExc_ValueError, "there must be up to %d rows", MOST_ROWS);
    return rows > MOST_ROWS ? -1 : (int)rows;
}
