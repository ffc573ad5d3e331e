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
    Py_buffer buffers[5];
    (void)self;
    double share, smallest;
    if (!are_arguments(count, 7) || !take_number(args[5], &share) || !take_number(args[6], &smallest))
        return NULL;
    int scenes = count_rows(args[0]);
    if (scenes < 0)
        return NULL;
    const int columns[] = {3, 3, -3 * scenes, -scenes, 3};
    Py_ssize_t lines = take_arrays(args, columns, 5, 3, buffers);
    if (lines < 0)
        return NULL;
    Py_ssize_t n = scenes > 0 ? lines / scenes : 0;
    if (n * scenes != lines) {
        release_arrays(buffers, 5);
        return PyErr_Format(PyExc_ValueError, "%zd lines for %d scenes", lines, scenes);
    }
    const double *direction = buffers[0].buf, *foot = buffers[1].buf;
    double *center = buffers[2].buf, *length = buffers[3].buf, *relative = buffers[4].buf;
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
    release_arrays(buffers, 5);
    return PyBool_FromLong(good);
}
