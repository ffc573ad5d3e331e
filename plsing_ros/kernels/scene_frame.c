/* Coordinates centred on the lines of a scene, in units of their mean distance. */

#include "kernels.h"

#include <math.h>
#include <string.h>

/* Singular values below this share of the largest leave the centre free: parallel lines, along them. */
#define FREE 1e-12

/* Take away the component of `vector` along a unit direction. */
static void project_across(double *vector, const double *direction)
{
    add_multiple(vector, -dot_product(vector, direction, 3), direction, 3);
}

/* Fill the centre, its offset from the mean of the feet, and return the mean distance of the lines to it, with the
 * vectors from it to the lines in `relative`. */
static double centred(const double *direction, const double *foot, Py_ssize_t n, double *center, double *relative)
{
    double mean[3] = {0.0}, total[9] = {0.0}, target[3] = {0.0}, offset[3] = {0.0};
    double values[3], right[9], sum = 0.0;
    struct decomposition decomposed;
    for (Py_ssize_t i = 0; i < n; i++)
        add_multiple(mean, 1.0 / (double)n, foot + 3 * i, 3);
    for (Py_ssize_t i = 0; i < n; i++) {
        const double *u = direction + 3 * i;
        double *across = relative + 3 * i;
        for (int j = 0; j < 3; j++) {
            across[j] = foot[3 * i + j] - mean[j];
            total[4 * j] += 1.0;
            add_multiple(total + 3 * j, -u[j], u, 3);
        }
        project_across(across, u);
        add_multiple(target, 1.0, across, 3);
    }
    /* Symmetric and not negative, so that its singular vectors are eigenvectors. */
    int good = decompose(total, 3, 3, &decomposed, values, right);
    release_decomposition(&decomposed);
    if (!good)
        return NAN;
    for (int j = 0; j < 3; j++)
        if (values[j] > FREE * values[0])
            add_multiple(offset, dot_product(right + 3 * j, target, 3) / values[j], right + 3 * j, 3);
    for (Py_ssize_t i = 0; i < n; i++) {
        double *across = relative + 3 * i;
        add_multiple(across, -1.0, offset, 3);
        /* Twice, because the first time leaves rounding along the line. */
        project_across(across, direction + 3 * i);
        project_across(across, direction + 3 * i);
        sum += sqrt(dot_product(across, across, 3));
    }
    for (int j = 0; j < 3; j++)
        center[j] = mean[j] + offset[j];
    return sum / (double)n;
}

PyObject *scene_coordinates(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    struct arguments given;
    (void)self;
    int scenes = are_arguments(count, 7) ? count_rows(args[0]) : -1;
    const struct signature expected = {5, 3, 2, {3, 3, -3 * scenes, -scenes, 3}};
    if (scenes < 0 || !take_arguments(args, count, &expected, &given))
        return NULL;
    Py_ssize_t n = scenes > 0 ? given.rows / scenes : 0;
    if (n * scenes != given.rows) {
        release_arguments(&given);
        return PyErr_Format(PyExc_ValueError, "%zd lines for %d scenes", given.rows, scenes);
    }
    const double *direction = given.array[0], *foot = given.array[1], share = given.number[0];
    const double smallest = given.number[1];
    double *center = given.array[2], *length = given.array[3], *relative = given.array[4];
    int good = 1;
    for (Py_ssize_t i = 0; i < scenes && good; i++, center += 3) {
        length[i] = centred(direction, foot, n, center, relative);
        good = isfinite(length[i]);
        if (!good)
            break;
        if (length[i] <= fmax(share * sqrt(dot_product(center, center, 3)), smallest))
            length[i] = 0.0;
        else
            for (Py_ssize_t j = 0; j < 3 * n; j++)
                relative[j] /= length[i];
        direction += 3 * n, foot += 3 * n, relative += 3 * n;
    }
    release_arguments(&given);
    return PyBool_FromLong(good);
}
