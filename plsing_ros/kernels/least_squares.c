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
    static const struct signature expected = {3, 1, 0, {1, 1, 1}};
    struct arguments given;
    (void)self;
    if (!take_arguments(args, count, &expected, &given))
        return NULL;
    double norm = subtracted(given.array[0], given.array[1], given.rows, given.array[2]);
    release_arguments(&given);
    return PyFloat_FromDouble(norm);
}

PyObject *solve(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    struct arguments given;
    (void)self;
    int k = are_arguments(count, 8) ? count_columns(args[2]) : -1;
    const struct signature expected = {6, 4, 2, {k, 1, -k, -k * k, -k, -k}};
    if (k < 0 || !take_arguments(args, count, &expected, &given))
        return NULL;
    int good = solved(given.array[0], given.array[1], given.rows, k, given.number[0], given.number[1], given.array[2],
                      given.array[3], given.array[4], given.array[5]);
    release_arguments(&given);
    return truth(good);
}

PyObject *plain_law(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const struct signature expected = {6, 2, 3, {3, 3, 3, 3, -6, -6}};
    struct arguments given;
    (void)self;
    double on_stack[7 * ROWS_ON_STACK], right[36], components[6], norm = 0.0;
    if (!take_arguments(args, count, &expected, &given))
        return NULL;
    const double least_depth = given.number[0], gain = given.number[1], threshold = given.number[2];
    Py_ssize_t n = given.rows, m = 3 * n;
    double *matrix = m > ROWS_ON_STACK ? PyMem_RawMalloc(7 * m * sizeof(double)) : on_stack;
    if (!matrix)
        PyErr_NoMemory();
    int good = matrix && fill_interaction_matrix(given.array[0], given.array[1], n, least_depth, matrix);
    if (good) {
        double *error = matrix + 6 * m;
        norm = subtracted(given.array[2], given.array[3], m, error);
        good = solved(matrix, error, m, 6, -gain, threshold, given.array[4], right, components, given.array[5]);
    }
    if (matrix != on_stack)
        PyMem_RawFree(matrix);
    release_arguments(&given);
    if (PyErr_Occurred())
        return NULL;
    return good ? PyFloat_FromDouble(norm) : Py_NewRef(Py_None);
}
