/* Damped, weighted steps of camera poses towards their image lines. */

#include "kernels.h"

#include <math.h>
#include <string.h>

#define FIRST_DAMPING 1e-6
#define MOST_DAMPING 1e10
#define SMALLEST_GAIN 1e-6
#define LONGEST_TURN 0.5
#define SLACK 1.0

int eliminate(double *a, double *b, int n)
{
    for (int c = 0; c < n; c++) {
        int pivot = c;
        for (int i = c + 1; i < n; i++)
            if (fabs(a[i * n + c]) > fabs(a[pivot * n + c]))
                pivot = i;
        if (a[pivot * n + c] == 0.0)
            return 0;
        if (pivot != c) {
            for (int j = c; j < n; j++) {
                double other = a[c * n + j];
                a[c * n + j] = a[pivot * n + j];
                a[pivot * n + j] = other;
            }
            double other = b[c];
            b[c] = b[pivot];
            b[pivot] = other;
        }
        for (int i = c + 1; i < n; i++) {
            double factor = a[i * n + c] / a[c * n + c];
            for (int j = c + 1; j < n; j++)
                a[i * n + j] -= factor * a[c * n + j];
            b[i] -= factor * b[c];
        }
    }
    for (int c = n - 1; c >= 0; c--) {
        for (int j = c + 1; j < n; j++)
            b[c] -= a[c * n + j] * b[j];
        b[c] /= a[c * n + c];
    }
    return 1;
}

void move(const double *motion, const double *rotation, const double *t, double *new_rotation, double *new_t)
{
    const double *v = motion, w[3] = {-0.5 * motion[3], -0.5 * motion[4], -0.5 * motion[5]};
    double square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2], scale = 2.0 / (1.0 + square), back[9];
    const double skew[9] = {0.0, -w[2], w[1], w[2], 0.0, -w[0], -w[1], w[0], 0.0};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            back[3 * i + j] = (i == j) + scale * (skew[3 * i + j] + w[i] * w[j] - (i == j) * square);
    for (int i = 0; i < 3; i++) {
        const double *row = back + 3 * i;
        for (int j = 0; j < 3; j++)
            new_rotation[3 * i + j] = row[0] * rotation[j] + row[1] * rotation[3 + j] + row[2] * rotation[6 + j];
        new_t[i] = row[0] * (t[0] - v[0]) + row[1] * (t[1] - v[1]) + row[2] * (t[2] - v[2]);
    }
}

double misfit(const struct residual *lines, const struct residual *measure, const double *weight, Py_ssize_t n)
{
    double sum = 0.0;
    for (Py_ssize_t i = 0; i < n; i++) {
        double value[2];
        whiten(measure[i].whitening, lines[i].raw, value);
        sum += (weight ? weight[i] : 1.0) * (value[0] * value[0] + value[1] * value[1]);
    }
    return sum;
}

/* The logarithm of the determinant of the covariance of all lines. */
static double log_determinant(const struct residual *lines, const double *weight, Py_ssize_t n)
{
    double sum = 0.0;
    for (Py_ssize_t i = 0; i < n; i++)
        sum += (weight ? weight[i] : 1.0) * log(lines[i].determinant);
    return sum;
}

/* Fill the normal equations (6, 6) and half of the gradient of the misfit. */
static void normal_equations(const struct residual *lines, const double *weight, Py_ssize_t n, double *normal,
                             double *slope)
{
    memset(normal, 0, 36 * sizeof *normal);
    memset(slope, 0, 6 * sizeof *slope);
    for (Py_ssize_t i = 0; i < n; i++) {
        double rows[2][6], value[2], factor = weight ? weight[i] : 1.0;
        jacobian_of(lines + i, rows);
        whiten(lines[i].whitening, lines[i].raw, value);
        for (int j = 0; j < 6; j++) {
            const double column[2] = {rows[0][j], rows[1][j]};
            double whitened[2];
            whiten(lines[i].whitening, column, whitened);
            rows[0][j] = factor * whitened[0];
            rows[1][j] = factor * whitened[1];
        }
        for (int j = 0; j < 6; j++) {
            for (int l = 0; l <= j; l++)
                normal[6 * j + l] += rows[0][j] * rows[0][l] + rows[1][j] * rows[1][l];
            slope[j] += rows[0][j] * value[0] + rows[1][j] * value[1];
        }
    }
    for (int j = 0; j < 6; j++)
        for (int l = 0; l < j; l++)
            normal[6 * l + j] = normal[6 * j + l];
}

int refine(const struct image *image, const double *weight, long iterations, double *rotation, double *t, double *gain)
{
    Py_ssize_t n = image->count;
    struct residual *now = image->room, *next = image->room + n;
    double damping = FIRST_DAMPING;
    int final = 0;
    *gain = INFINITY;
    residuals_at(image, rotation, t, now);
    double was = misfit(now, now, weight, n), lowest = was + log_determinant(now, weight, n);
    for (; iterations > 0 && !final; iterations--) {
        double normal[36], slope[6], step[6], new_rotation[9], new_t[3];
        normal_equations(now, weight, n, normal, slope);
        for (int j = 0; j < 6; j++) {
            normal[7 * j] = normal[7 * j] * (1.0 + damping) + 1e-300;
            step[j] = -slope[j];
        }
        if (!eliminate(normal, step, 6))
            memset(step, 0, sizeof step);
        *gain = 0.0;
        for (int j = 0; j < 6; j++)
            *gain -= slope[j] * step[j];
        final = *gain <= SMALLEST_GAIN * (1.0 + was) || damping > MOST_DAMPING;
        double turn = sqrt(step[3] * step[3] + step[4] * step[4] + step[5] * step[5]);
        for (int j = 0; j < 6 && turn > LONGEST_TURN; j++)
            step[j] *= LONGEST_TURN / turn;
        move(step, rotation, t, new_rotation, new_t);
        residuals_at(image, new_rotation, new_t, next);
        double is = misfit(next, next, weight, n), cost = is + log_determinant(next, weight, n);
        /* Both by the same measure, and not much less likely, as poses would win by their larger covariance. */
        if (misfit(next, now, weight, n) <= was && cost <= lowest + SLACK) {
            was = is;
            lowest = fmin(lowest, cost);
            struct residual *other = now;
            now = next;
            next = other;
            memcpy(rotation, new_rotation, sizeof new_rotation);
            memcpy(t, new_t, sizeof new_t);
            damping *= 0.1;
        } else
            damping = fmax(100.0 * damping, 1e-4);
    }
    return final;
}

PyObject *refine_poses(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    struct image image;
    (void)self;
    if (!are_arguments(count, 9))
        return NULL;
    long iterations = PyLong_AsLong(args[8]);
    const int n = iterations == -1 && PyErr_Occurred() ? -1 : count_lines(args[1]);
    const struct signature expected = {8, 4, 0, {IMAGE(n), n, 9, 3, 1, 1}};
    if (n < 0 || !take_image(args, 8, &expected, &image))
        return NULL;
    const double *weight = image.given.array[3];
    double *rotation = image.given.array[4], *translation = image.given.array[5];
    double *gain = image.given.array[6], *final = image.given.array[7];
    for (Py_ssize_t k = image.given.rows; k > 0; k--, weight += n, rotation += 9, translation += 3)
        *final++ = refine(&image, weight, iterations, rotation, translation, gain++);
    release_image(&image);
    Py_RETURN_NONE;
}
