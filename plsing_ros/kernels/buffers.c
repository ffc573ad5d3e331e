/* What functions are given: arrays through the buffer protocol, and numbers. */

#include "kernels.h"

#include <string.h>

#define MOST_ROWS 1000000

int are_arguments(Py_ssize_t given, Py_ssize_t expected)
{
    if (given == expected)
        return 1;
    PyErr_Format(PyExc_TypeError, "%zd arguments given, %zd expected", given, expected);
    return 0;
}

/* Return whether array i has the type and the size that are expected, or 0 with an exception set. */
static int fits(const struct signature *expected, int i, struct arguments *given)
{
    const Py_buffer *buffer = given->buffers + i;
    Py_ssize_t length = buffer->len / (Py_ssize_t)sizeof(double), columns = expected->columns[i];
    if (columns > 0 && given->rows < 0)
        given->rows = length / columns;
    int doubles = strcmp(buffer->format, "d") == 0 || strcmp(buffer->format, "Zd") == 0;
    if (doubles && given->rows <= MOST_ROWS && length == (columns > 0 ? columns * given->rows : -columns))
        return 1;
    PyErr_Format(PyExc_ValueError, "array %d is neither float64 nor complex128, or of a size that does not fit", i);
    return 0;
}

int take_arguments(PyObject *const *args, Py_ssize_t count, const struct signature *expected, struct arguments *given)
{
    if (!are_arguments(count, expected->arrays + expected->numbers))
        return 0;
    for (int i = 0; i < expected->numbers; i++) {
        given->number[i] = PyFloat_AsDouble(args[expected->arrays + i]);
        if (given->number[i] == -1.0 && PyErr_Occurred())
            return 0;
    }
    given->rows = -1;
    given->arrays = 0;
    for (int i = 0; i < expected->arrays; i++) {
        int writable = i >= expected->arrays - expected->written ? PyBUF_WRITABLE : 0;
        int taken = PyObject_GetBuffer(args[i], given->buffers + i, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | writable) == 0;
        given->arrays += taken;
        if (!taken || !fits(expected, i, given)) {
            release_arguments(given);
            return 0;
        }
        given->array[i] = given->buffers[i].buf;
    }
    return 1;
}

void release_arguments(struct arguments *given)
{
    while (given->arrays > 0)
        PyBuffer_Release(given->buffers + --given->arrays);
}

PyObject *truth(int value)
{
    return PyErr_Occurred() ? NULL : PyBool_FromLong(value);
}

/* Return the length of an array, or -1 with an exception set if there are fewer or more. */
static int length_of(PyObject *array, Py_ssize_t least, Py_ssize_t most, const char *message)
{
    Py_ssize_t length = PyObject_Length(array);
    if (length >= least && length <= most)
        return (int)length;
    if (!PyErr_Occurred())
        PyErr_SetString(PyExc_ValueError, message);
    return -1;
}

int count_columns(PyObject *array)
{
    return length_of(array, 1, MOST_COLUMNS, "there must be 1 to 6 singular values");
}

int count_rows(PyObject *array)
{
    return length_of(array, 0, MOST_ROWS, "there must be up to 1000000 rows");
}

int count_lines(PyObject *array)
{
    return length_of(array, 1, MOST_ROWS, "there must be 1 to 1000000 lines");
}
