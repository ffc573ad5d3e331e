/* The interaction matrix. */

#include "kernels.h"

#include <math.h>

int fill_interaction_matrix(const double *u, const double *l, Py_ssize_t n, double least_depth, double *matrix)
{
    for (; n > 0; n--, u += 3, l += 3, matrix += 18) {
        double depth = hypot(l[0], l[1]);
        if (!(depth >= least_depth * fmax(1.0, largest_element(l))))
            return 0;
        double x = l[0] / depth, y = l[1] / depth, z = l[2] / depth;
        double moment_rate[3][6] = {{0.0, -u[2], u[1], 0.0, -l[2], l[1]},
                                    {u[2], 0.0, -u[0], l[2], 0.0, -l[0]},
                                    {-u[1], u[0], 0.0, -l[1], l[0], 0.0}};
        for (int j = 0; j < 6; j++) {
            double depth_rate = x * moment_rate[0][j] + y * moment_rate[1][j];
            matrix[j] = (moment_rate[0][j] - x * depth_rate) / depth;
            matrix[6 + j] = (moment_rate[1][j] - y * depth_rate) / depth;
            matrix[12 + j] = (moment_rate[2][j] - z * depth_rate) / depth;
        }
    }
    return 1;
}

PyObject *interaction_matrix(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const int columns[] = {3, 3, 18};
    Py_buffer buffers[3];
    (void)self;
    if (!are_arguments(count, 4))
        return NULL;
    double least_depth = PyFloat_AsDouble(args[3]);
    if (least_depth == -1.0 && PyErr_Occurred())
        return NULL;
    Py_ssize_t n = take_arrays(args, columns, 3, 1, buffers);
    if (n < 0)
        return NULL;
    int good = fill_interaction_matrix(buffers[0].buf, buffers[1].buf, n, least_depth, buffers[2].buf);
    release_arrays(buffers, 3);
    return PyBool_FromLong(good);
}
