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

/* Fill `difference` (n) with a - b, and return its norm. */
static double subtracted(const double *a, const double *b, Py_ssize_t n, double *difference)
{
    for (Py_ssize_t i = 0; i < n; i++)
        difference[i] = a[i] - b[i];
    return norm_of(difference, n);
}

int solved(const double *matrix, const double *right_side, Py_ssize_t m, int k, double factor, double threshold,
           double *values, double *right, double *components, double *solution)
{
    struct decomposition d;
    int good = decompose(matrix, m, k, &d, values, right);
    if (good) {
        along_left_vectors(&d, right_side, components);
        for (int i = 0; i < k; i++)
            solution[i] = 0.0;
        for (int j = 0; j < k; j++) {
            components[j] *= factor;
            double along = values[j] > threshold * values[0] ? components[j] / values[j] : 0.0;
            for (int i = 0; i < k; i++)
                solution[i] += along * right[j * k + i];
        }
    }
    release_decomposition(&d);
    return good;
}

PyObject *subtract(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const int columns[] = {1, 1, 1};
    Py_buffer buffers[3];
    (void)self;
    Py_ssize_t n = are_arguments(count, 3) ? take_arrays(args, columns, 3, 1, buffers) : -1;
    if (n < 0)
        return NULL;
    double norm = subtracted(buffers[0].buf, buffers[1].buf, n, buffers[2].buf);
    release_arrays(buffers, 3);
    return PyFloat_FromDouble(norm);
}

PyObject *solve(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Py_buffer buffers[6];
    (void)self;
    double factor, threshold;
    if (!are_arguments(count, 8) || !take_number(args[6], &factor) || !take_number(args[7], &threshold))
        return NULL;
    int k = count_columns(args[2]);
    const int columns[] = {k, 1, -k, -k * k, -k, -k};
    Py_ssize_t m = k > 0 ? take_arrays(args, columns, 6, 4, buffers) : -1;
    if (m < 0)
        return NULL;
    int good = solved(buffers[0].buf, buffers[1].buf, m, k, factor, threshold, buffers[2].buf, buffers[3].buf,
                      buffers[4].buf, buffers[5].buf);
    release_arrays(buffers, 6);
    return truth(good);
}

PyObject *plain_law(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const int columns[] = {3, 3, 3, 3, -6, -6};
    double on_stack[7 * ROWS_ON_STACK], right[36], components[6], norm = 0.0;
    Py_buffer buffers[6];
    (void)self;
    double least_depth, gain, threshold;
    if (!are_arguments(count, 9) || !take_number(args[6], &least_depth) || !take_number(args[7], &gain) ||
        !take_number(args[8], &threshold))
        return NULL;
    Py_ssize_t n = take_arrays(args, columns, 6, 2, buffers), m = 3 * n;
    if (n < 0)
        return NULL;
    double *matrix = m > ROWS_ON_STACK ? PyMem_RawMalloc(7 * m * sizeof(double)) : on_stack;
    if (!matrix)
        PyErr_NoMemory();
    int good = matrix && fill_interaction_matrix(buffers[0].buf, buffers[1].buf, n, least_depth, matrix);
    if (good) {
        double *error = matrix + 6 * m;
        norm = subtracted(buffers[2].buf, buffers[3].buf, m, error);
        good = solved(matrix, error, m, 6, -gain, threshold, buffers[4].buf, right, components, buffers[5].buf);
    }
    if (matrix != on_stack)
        PyMem_RawFree(matrix);
    release_arrays(buffers, 6);
    if (PyErr_Occurred())
        return NULL;
    return good ? PyFloat_FromDouble(norm) : Py_NewRef(Py_None);
}
