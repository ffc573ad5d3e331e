/* Differences of features, and the motion that makes up for them best. */

#include "kernels.h"

#include <math.h>

static double norm_of(const double *vector, Py_ssize_t n)
{
    double square = 0.0, norm = 0.0;
    for (Py_ssize_t i = 0; i < n; i++)
        square += vector[i] * vector[i];
    if (square > 1e-280 && square < 1e280)
        return sqrt(square);
    /* Too large or too small for squares. */
    for (Py_ssize_t i = 0; i < n; i++)
        norm = hypot(norm, vector[i]);
    return norm;
}

PyObject *subtract(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const int columns[] = {1, 1, 1};
    Py_buffer buffers[3];
    (void)self;
    Py_ssize_t n = are_arguments(count, 3) ? take_arrays(args, columns, 3, 1, buffers) : -1;
    if (n < 0)
        return NULL;
    const double *a = buffers[0].buf, *b = buffers[1].buf;
    double *difference = buffers[2].buf;
    for (Py_ssize_t i = 0; i < n; i++)
        difference[i] = a[i] - b[i];
    double norm = norm_of(difference, n);
    release_arrays(buffers, 3);
    return PyFloat_FromDouble(norm);
}

PyObject *solve(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Py_buffer buffers[6];
    (void)self;
    if (!are_arguments(count, 8))
        return NULL;
    double factor = PyFloat_AsDouble(args[6]), threshold = PyFloat_AsDouble(args[7]);
    if (PyErr_Occurred())
        return NULL;
    int k = count_columns(args[2]);
    const int columns[] = {k, 1, -k, -k * k, -k, -k};
    Py_ssize_t m = k > 0 ? take_arrays(args, columns, 6, 4, buffers) : -1;
    if (m < 0)
        return NULL;
    const double *right_side = buffers[1].buf;
    double *values = buffers[2].buf, *right = buffers[3].buf, *components = buffers[4].buf, *solution = buffers[5].buf;
    struct decomposition d;
    int good = decompose(buffers[0].buf, m, k, &d, values, right);
    if (good)
        along_left_vectors(&d, right_side, components);
    for (int i = 0; i < k && good; i++)
        solution[i] = 0.0;
    for (int j = 0; j < k && good; j++) {
        components[j] *= factor;
        double along = values[j] > threshold * values[0] ? components[j] / values[j] : 0.0;
        for (int i = 0; i < k; i++)
            solution[i] += along * right[j * k + i];
    }
    release_decomposition(&d);
    release_arrays(buffers, 6);
    return PyBool_FromLong(good);
}
