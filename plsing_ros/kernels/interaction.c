/* The interaction matrix, and the mean of two. */

#include "kernels.h"

#include <math.h>

int fill_interaction_matrix(const double *u, const double *l, Py_ssize_t n, double least_depth, double *matrix)
{
    for (; n > 0; n--, u += 3, l += 3, matrix += 18) {
        double image[3], depth = image_line(l, image);
        if (!has_image(l, depth, least_depth))
            return 0;
        double moment_rate[3][6] = {{0.0, -u[2], u[1], 0.0, -l[2], l[1]},
                                    {u[2], 0.0, -u[0], l[2], 0.0, -l[0]},
                                    {-u[1], u[0], 0.0, -l[1], l[0], 0.0}};
        for (int j = 0; j < 6; j++) {
            double depth_rate = image[0] * moment_rate[0][j] + image[1] * moment_rate[1][j];
            matrix[j] = (moment_rate[0][j] - image[0] * depth_rate) / depth;
            matrix[6 + j] = (moment_rate[1][j] - image[1] * depth_rate) / depth;
            matrix[12 + j] = (moment_rate[2][j] - image[2] * depth_rate) / depth;
        }
    }
    return 1;
}

PyObject *interaction_matrix(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const struct signature expected = {3, 1, 1, {3, 3, 18}};
    struct arguments given;
    (void)self;
    if (!take_arguments(args, count, &expected, &given))
        return NULL;
    int good = fill_interaction_matrix(given.array[0], given.array[1], given.rows, given.number[0], given.array[2]);
    release_arguments(&given);
    return PyBool_FromLong(good);
}

PyObject *mean_interaction(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    struct arguments given;
    (void)self;
    if (!are_arguments(count, 6))
        return NULL;
    long k = PyLong_AsLong(args[5]);
    if (PyErr_Occurred())
        return NULL;
    if (k < 1 || k > MOST_COLUMNS)
        return PyErr_Format(PyExc_ValueError, "%ld columns given, allowed are 1 to 6", k);
    const struct signature expected = {5, 1, 0, {3, 3, 3 * k, 3 * k, 3 * k}};
    if (!take_arguments(args, 5, &expected, &given))
        return NULL;
    const double *s = given.array[0], *s_desired = given.array[1], *L = given.array[2], *L_desired = given.array[3];
    double *mean = given.array[4];
    for (Py_ssize_t n = given.rows; n > 0; n--, s += 3, s_desired += 3, L += 3 * k, L_desired += 3 * k, mean += 3 * k)
        for (int j = 0; j < k; j++) {
            double turn = s_desired[0] * L_desired[k + j] - s_desired[1] * L_desired[j];
            mean[j] = 0.5 * (L[j] - s[1] * turn);
            mean[k + j] = 0.5 * (L[k + j] + s[0] * turn);
            mean[2 * k + j] = 0.5 * (L[2 * k + j] + L_desired[2 * k + j]);
        }
    release_arguments(&given);
    Py_RETURN_NONE;
}
