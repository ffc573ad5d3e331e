/* The pose of a camera from lines that it sees and the same lines in the scene. */

#include "kernels.h"

#include <math.h>
#include <string.h>

#define LINES_ON_STACK 64

static double smallest_cosine(const double *u, const double *rotation, const double *seen, Py_ssize_t n)
{
    double least = INFINITY, turned[3];
    for (; n > 0; n--, u += 3, seen += 3) {
        times3(rotation, seen, turned);
        least = fmin(least, dot3(u, turned));
    }
    return least;
}

PyObject *least_cosine(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const struct signature expected = {3, 0, 0, {3, -9, 3}};
    struct arguments given;
    (void)self;
    if (!take_arguments(args, count, &expected, &given))
        return NULL;
    double least = smallest_cosine(given.array[0], given.array[1], given.array[2], given.rows);
    release_arguments(&given);
    return PyFloat_FromDouble(least);
}

/* Fill the rotation that brings the directions `v` together best with `u`, and return the second singular value of
 * their correlation, or -1 if they are not finite. */
static double best_rotation(const double *u, const double *v, Py_ssize_t n, double *rotation)
{
    double correlation[9] = {0.0}, left[9], values[3], right[9];
    struct decomposition d;
    for (; n > 0; n--, u += 3, v += 3)
        for (int i = 0; i < 9; i++)
            correlation[i] += u[i / 3] * v[i % 3];
    int good = decompose(correlation, 3, 3, &d, values, right);
    if (good)
        left_vectors(&d, left);
    release_decomposition(&d);
    if (!good)
        return -1.0;
    double sign = determinant3(left) * determinant3(right) < 0.0 ? -1.0 : 1.0;
    for (int i = 0; i < 9; i++)
        rotation[i] = left[i / 3 * 3] * right[i % 3] + left[i / 3 * 3 + 1] * right[3 + i % 3] +
                      sign * left[i / 3 * 3 + 2] * right[6 + i % 3];
    return values[1];
}

PyObject *align(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const struct signature expected = {7, 3, 0, {3, 3, 3, 3, -9, -3, -3}};
    struct arguments given;
    (void)self;
    if (!take_arguments(args, count, &expected, &given))
        return NULL;
    Py_ssize_t n = given.rows;
    const double *u = given.array[0], *l = given.array[1], *seen_u = given.array[2], *seen_l = given.array[3];
    double *rotation = given.array[4], *t = given.array[5], *quality = given.array[6];
    double on_stack[12 * LINES_ON_STACK];
    double *room = n <= LINES_ON_STACK ? on_stack : PyMem_RawMalloc(12 * n * sizeof(double));
    if (!room) {
        release_arguments(&given);
        return PyErr_NoMemory();
    }
    int good = 0;
    quality[0] = best_rotation(u, seen_u, n, rotation);
    if (quality[0] >= 0.0) {
        quality[1] = smallest_cosine(u, rotation, seen_u, n);
        /* t x u = l - R l_seen, three rows for each line. */
        double *right_side = room + 9 * n, values[3], right[9], components[3];
        for (Py_ssize_t i = 0; i < n; i++) {
            const double *d = u + 3 * i;
            double crossed[9] = {0.0, d[2], -d[1], -d[2], 0.0, d[0], d[1], -d[0], 0.0};
            memcpy(room + 9 * i, crossed, sizeof crossed);
            times3(rotation, seen_l + 3 * i, right_side + 3 * i);
            for (int j = 0; j < 3; j++)
                right_side[3 * i + j] = l[3 * i + j] - right_side[3 * i + j];
        }
        good = solved(room, right_side, 3 * n, 3, 1.0, 0.0, values, right, components, t) &&
               values[2] > SINGULAR * values[0] && isfinite(t[0]) && isfinite(t[1]) && isfinite(t[2]);
        double misfit = 0.0;
        for (Py_ssize_t i = 0; good && i < 3 * n; i++) {
            const double *row = room + 3 * i;
            double off = dot3(row, t) - right_side[i];
            misfit += off * off;
        }
        quality[2] = sqrt(misfit / n);
    }
    if (room != on_stack)
        PyMem_RawFree(room);
    release_arguments(&given);
    return truth(good);
}
