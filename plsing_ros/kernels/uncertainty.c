/* The first-order uncertainty of a pose, and how far it can be believed. */

#include "kernels.h"

#include <math.h>

#define UNDETERMINED 1e-13
#define PROBE 2.0
#define LARGEST 1e6
#define FIGURES 5

/* Fill the singular values and the right singular vectors of a matrix; return whether they are finite. */
static int decomposed(const double *matrix, Py_ssize_t m, int k, double *values, double *right)
{
    struct decomposition d;
    int good = decompose(matrix, m, k, &d, values, right);
    release_decomposition(&d);
    return good;
}

/* The largest eigenvalue of a block of the covariance (6, 6) on its diagonal. */
static double largest_variance(const double *covariance, int first)
{
    double block[9], values[3], right[9];
    for (int i = 0; i < 9; i++)
        block[i] = covariance[6 * (first + i / 3) + first + i % 3];
    return decomposed(block, 3, 3, values, right) ? values[0] : INFINITY;
}

/* The largest relative difference of the misfit from a quadratic at poses along the two weakest motions, both ways. */
static double nonlinearity(const struct image *image, const double *rotation, const double *translation,
                           const double *weight, double here, const double *deviation, const double *axes)
{
    Py_ssize_t n = image->count;
    double worst = 0.0;
    for (int probe = 0; probe < 4; probe++) {
        double motion[6], new_rotation[9], new_translation[3];
        for (int j = 0; j < 6; j++) {
            motion[j] = (probe % 2 ? -PROBE : PROBE) * deviation[probe / 2] * axes[6 * (probe / 2) + j];
            if (j >= 3 && !(fabs(motion[j]) <= 1.0))
                return LARGEST;
        }
        move(motion, rotation, translation, new_rotation, new_translation);
        residuals_at(image, new_rotation, new_translation, image->room + n);
        double change = (misfit(image->room + n, image->room, weight, n) - here) / (PROBE * PROBE);
        double off = fabs(change - 1.0);
        /* Written so that it holds for NaN. */
        if (!(off < LARGEST))
            return LARGEST;
        worst = fmax(worst, off);
    }
    return worst;
}

/* Return whether the motions are determined. `rows` has room for two matrices (2 n, 6). */
static int uncertainty(const struct image *image, const double *rotation, const double *translation,
                       const double *weight, double *rows, double *deviation, double *axes, double *covariance,
                       double *figures)
{
    Py_ssize_t n = image->count;
    double *raw = rows + 12 * n, raw_size[6], size[6], right[36], in_world[36];
    residuals_at(image, rotation, translation, image->room);
    for (Py_ssize_t i = 0; i < n; i++) {
        const struct residual *line = image->room + i;
        double of_line[2][6], value[2];
        jacobian_of(line, of_line);
        for (int j = 0; j < 6; j++) {
            const double column[2] = {weight[i] * of_line[0][j], weight[i] * of_line[1][j]};
            whiten(line->whitening, column, value);
            for (int r = 0; r < 2; r++) {
                raw[12 * i + 6 * r + j] = column[r];
                rows[12 * i + 6 * r + j] = value[r];
            }
        }
    }
    /* Angle and offset are orthonormal coordinates of the image line, so `raw` has the singular values of L. */
    if (!decomposed(raw, 2 * n, 6, raw_size, right) || !decomposed(rows, 2 * n, 6, size, right) ||
        !(size[5] > UNDETERMINED * size[0]))
        return 0;
    figures[3] = raw_size[5] / raw_size[0];
    for (int i = 0; i < 6; i++) {
        deviation[i] = 1.0 / size[5 - i];
        for (int j = 0; j < 6; j++)
            axes[6 * i + j] = right[6 * (5 - i) + j];
    }
    /* The axes in the world frame: position and rotation vector turn alike. */
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) {
            const double *half = axes + 6 * i + j / 3 * 3, *column = rotation + j % 3;
            in_world[6 * i + j] = half[0] * column[0] + half[1] * column[3] + half[2] * column[6];
        }
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) {
            covariance[6 * i + j] = 0.0;
            for (int a = 0; a < 6; a++)
                covariance[6 * i + j] += in_world[6 * a + i] * in_world[6 * a + j] * deviation[a] * deviation[a];
        }
    figures[0] = sqrt(largest_variance(covariance, 0));
    figures[1] = sqrt(largest_variance(covariance, 3));
    figures[4] = misfit(image->room, image->room, weight, n);
    figures[2] = nonlinearity(image, rotation, translation, weight, figures[4], deviation, axes);
    return 1;
}

PyObject *pose_uncertainty(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    struct image image;
    (void)self;
    const int n = are_arguments(count, 10) ? count_lines(args[1]) : -1;
    const struct signature expected = {10, 4, 0, {IMAGE(n), -9, -3, -n, -6, -36, -36, -FIGURES}};
    if (n < 0 || !take_image(args, count, &expected, &image))
        return NULL;
    void *const *array = image.given.array;
    double *rows = PyMem_RawMalloc(24 * image.count * sizeof *rows);
    if (!rows)
        PyErr_NoMemory();
    int good = rows && n >= 3 && uncertainty(&image, array[3], array[4], array[5], rows, array[6], array[7], array[8],
                                             array[9]);
    PyMem_RawFree(rows);
    release_image(&image);
    return truth(good);
}
