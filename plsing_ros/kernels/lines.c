/* What lines, image lines and rotations must be, checked over all of them at once. */

#include "kernels.h"

#include <math.h>

static double largest_element(const double *vector)
{
    return fmax(fmax(fabs(vector[0]), fabs(vector[1])), fabs(vector[2]));
}

double depth_of_image(const double *moment, double least_depth)
{
    /* Infinite also for (infinity, NaN). */
    double depth = hypot(moment[0], moment[1]);
    int good = isfinite(depth) && isfinite(moment[2]) && depth >= least_depth * fmax(1.0, largest_element(moment));
    return good ? depth : -1.0;
}

PyObject *are_lines(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const int columns[] = {3, 3};
    Py_buffer buffers[2];
    (void)self;
    double tolerance;
    if (!are_arguments(count, 3) || !take_number(args[2], &tolerance))
        return NULL;
    Py_ssize_t n = take_arrays(args, columns, 2, 0, buffers);
    if (n < 0)
        return NULL;
    const double *u = buffers[0].buf, *l = buffers[1].buf;
    int good = 1;
    /* Written so that a comparison with NaN fails. */
    for (; n > 0 && good; n--, u += 3, l += 3)
        good = fabs(dot3(u, u) - 1.0) <= tolerance && isfinite(l[0]) && isfinite(l[1]) &&
               isfinite(l[2]) && fabs(dot3(u, l)) <= tolerance * (1.0 + largest_element(l));
    release_arrays(buffers, 2);
    return PyBool_FromLong(good);
}

PyObject *have_images(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const int columns[] = {3};
    Py_buffer buffers[1];
    (void)self;
    double least_depth;
    if (!are_arguments(count, 2) || !take_number(args[1], &least_depth))
        return NULL;
    Py_ssize_t n = take_arrays(args, columns, 1, 0, buffers);
    if (n < 0)
        return NULL;
    const double *l = buffers[0].buf;
    int good = 1;
    for (; n > 0 && good; n--, l += 3)
        good = depth_of_image(l, least_depth) >= 0.0;
    release_arrays(buffers, 1);
    return PyBool_FromLong(good);
}

PyObject *are_image_lines(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const int columns[] = {3};
    Py_buffer buffers[1];
    (void)self;
    double tolerance;
    if (!are_arguments(count, 2) || !take_number(args[1], &tolerance))
        return NULL;
    Py_ssize_t n = take_arrays(args, columns, 1, 0, buffers);
    if (n < 0)
        return NULL;
    const double *s = buffers[0].buf;
    int good = 1;
    for (; n > 0 && good; n--, s += 3)
        good = fabs(hypot(s[0], s[1]) - 1.0) <= tolerance && isfinite(s[2]);
    release_arrays(buffers, 1);
    return PyBool_FromLong(good);
}

PyObject *is_rotation(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const int columns[] = {-9};
    Py_buffer buffers[1];
    (void)self;
    double tolerance;
    if (!are_arguments(count, 2) || !take_number(args[1], &tolerance) || take_arrays(args, columns, 1, 0, buffers) < 0)
        return NULL;
    const double *r = buffers[0].buf;
    int good = 1;
    for (int i = 0; i < 3; i++)
        for (int j = i; j < 3; j++) {
            double product = dot3(r + 3 * i, r + 3 * j);
            good = good && fabs(product - (i == j)) <= tolerance;
        }
    good = good && determinant3(r) > 0.0;
    release_arrays(buffers, 1);
    return PyBool_FromLong(good);
}
