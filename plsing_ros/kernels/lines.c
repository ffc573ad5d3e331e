/* What lines, image lines and rotations must be, checked over all of them at once. */

#include "kernels.h"

#include <math.h>

static double largest_element(const double *vector)
{
    return fmax(fmax(fabs(vector[0]), fabs(vector[1])), fabs(vector[2]));
}

int has_image(const double *moment, double depth, double least_depth)
{
    /* The depth is infinite also for (infinity, NaN). */
    return isfinite(depth) && isfinite(moment[2]) && depth >= least_depth * fmax(1.0, largest_element(moment));
}

PyObject *are_lines(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const struct signature expected = {2, 0, 1, {3, 3}};
    struct arguments given;
    (void)self;
    if (!take_arguments(args, count, &expected, &given))
        return NULL;
    const double tolerance = given.number[0];
    Py_ssize_t n = given.rows;
    const double *u = given.array[0], *l = given.array[1];
    int good = 1;
    /* Written so that a comparison with NaN fails. */
    for (; n > 0 && good; n--, u += 3, l += 3)
        good = fabs(dot3(u, u) - 1.0) <= tolerance && isfinite(l[0]) && isfinite(l[1]) &&
               isfinite(l[2]) && fabs(dot3(u, l)) <= tolerance * (1.0 + largest_element(l));
    release_arguments(&given);
    return PyBool_FromLong(good);
}

PyObject *have_images(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const struct signature expected = {1, 0, 1, {3}};
    struct arguments given;
    (void)self;
    if (!take_arguments(args, count, &expected, &given))
        return NULL;
    const double least_depth = given.number[0];
    Py_ssize_t n = given.rows;
    const double *l = given.array[0];
    int good = 1;
    for (; n > 0 && good; n--, l += 3)
        good = has_image(l, hypot(l[0], l[1]), least_depth);
    release_arguments(&given);
    return PyBool_FromLong(good);
}

PyObject *are_image_lines(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const struct signature expected = {1, 0, 1, {3}};
    struct arguments given;
    (void)self;
    if (!take_arguments(args, count, &expected, &given))
        return NULL;
    const double tolerance = given.number[0];
    Py_ssize_t n = given.rows;
    const double *s = given.array[0];
    int good = 1;
    for (; n > 0 && good; n--, s += 3)
        good = fabs(hypot(s[0], s[1]) - 1.0) <= tolerance && isfinite(s[2]);
    release_arguments(&given);
    return PyBool_FromLong(good);
}

PyObject *is_rotation(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const struct signature expected = {1, 0, 1, {-9}};
    struct arguments given;
    (void)self;
    if (!take_arguments(args, count, &expected, &given))
        return NULL;
    const double *r = given.array[0], tolerance = given.number[0];
    int good = 1;
    for (int i = 0; i < 3; i++)
        for (int j = i; j < 3; j++) {
            double product = dot3(r + 3 * i, r + 3 * j);
            good = good && fabs(product - (i == j)) <= tolerance;
        }
    good = good && determinant3(r) > 0.0;
    release_arguments(&given);
    return PyBool_FromLong(good);
}
