/* One step of the plain law ahead of the camera. */

#include "kernels.h"

#include <math.h>

#define LINES_ON_STACK 32

/* Fill R and t of the screw exp(step). */
static void exponential(const double *step, double *rotation, double *t)
{
    double x = step[3], y = step[4], z = step[5], square = x * x + y * y + z * z;
    double a = 1.0 - square / 6.0, b = 0.5 - square / 24.0, c = 1.0 / 6.0 - square / 120.0;
    if (square > 1e-8) {
        double angle = sqrt(square), sine_of_half = sin(0.5 * angle);
        a = sin(angle) / angle;
        /* 1 - cos(angle) would cancel. */
        b = 2.0 * sine_of_half * sine_of_half / square;
        c = (angle - sin(angle)) / (square * angle);
    }
    /* R = I + a K + b K^2 and t = (I + b K + c K^2) v with K = [omega]x and K^2 = omega omega^T - |omega|^2 I. */
    double turn[3] = {x, y, z}, along = c * (x * step[0] + y * step[1] + z * step[2]);
    double skew[3][3] = {{0.0, -z, y}, {z, 0.0, -x}, {-y, x, 0.0}};
    for (int i = 0; i < 3; i++) {
        t[i] = (1.0 - c * square) * step[i] + along * turn[i];
        for (int j = 0; j < 3; j++) {
            rotation[3 * i + j] = (i == j ? 1.0 - b * square : 0.0) + b * turn[i] * turn[j] + a * skew[i][j];
            t[i] += b * skew[i][j] * step[j];
        }
    }
}

/* Fill lines in a frame whose pose is (R, t): u R and (l - t x u) R, in rows. */
static void move_lines(const double *u, const double *l, Py_ssize_t n, const double *R, const double *t, double *new_u,
                       double *new_l)
{
    for (; n > 0; n--, u += 3, l += 3, new_u += 3, new_l += 3) {
        double shift[3], shifted[3];
        cross3(t, u, shift);
        for (int j = 0; j < 3; j++)
            shifted[j] = l[j] - shift[j];
        for (int j = 0; j < 3; j++) {
            new_u[j] = u[0] * R[j] + u[1] * R[3 + j] + u[2] * R[6 + j];
            new_l[j] = shifted[0] * R[j] + shifted[1] * R[3 + j] + shifted[2] * R[6 + j];
        }
    }
}

PyObject *law_step(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const struct signature expected = {5, 2, 4, {6, 3, -6, 6, -6}};
    struct arguments given;
    (void)self;
    if (!take_arguments(args, count, &expected, &given))
        return NULL;
    const double duration = given.number[0], gain = given.number[1], least_depth = given.number[2];
    const double fastest = given.number[3];
    Py_ssize_t n = given.rows;
    const double *lines = given.array[0], *desired = given.array[1], *twist = given.array[2];
    double *u = given.array[3], *l = u + 3 * n, *next = given.array[4];
    double on_stack[21 * LINES_ON_STACK], step[6], R[9], t[3], values[6], right[36], components[6];
    double *matrix = n <= LINES_ON_STACK ? on_stack : PyMem_RawMalloc(21 * n * sizeof(double));
    if (!matrix) {
        release_arguments(&given);
        return PyErr_NoMemory();
    }
    double *error = matrix + 18 * n;
    for (int i = 0; i < 6; i++)
        step[i] = twist[i] * duration;
    exponential(step, R, t);
    move_lines(lines, lines + 3 * n, n, R, t, u, l);
    int good = fill_interaction_matrix(u, l, n, least_depth, matrix);
    for (Py_ssize_t i = 0; good && i < n; i++) {
        double image[3];
        image_line(l + 3 * i, image);
        for (int j = 0; j < 3; j++)
            error[3 * i + j] = image[j] - desired[3 * i + j];
    }
    good = good && solved(matrix, error, 3 * n, 6, -1.0, 0.0, values, right, components, next) &&
           values[5] > SINGULAR * values[0];
    double square = 0.0;
    for (int i = 0; good && i < 6; i++) {
        square += next[i] * next[i];
        next[i] *= gain;
    }
    if (matrix != on_stack)
        PyMem_RawFree(matrix);
    release_arguments(&given);
    return truth(good && square < fastest * fastest);
}

/* The sum of squares of the images of lines of moments `l` minus image lines `s`. */
static double deviation_of(const double *l, const double *s, Py_ssize_t n)
{
    double sum = 0.0;
    for (; n > 0; n--, l += 3, s += 3) {
        double image[3];
        image_line(l, image);
        for (int i = 0; i < 3; i++)
            sum += (image[i] - s[i]) * (image[i] - s[i]);
    }
    return sum;
}

PyObject *lines_seen(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const struct signature expected = {9, 2, 0, {3, 3, -9, -3, 3, 3, 3, 6, 6}};
    struct arguments given;
    (void)self;
    if (!take_arguments(args, count, &expected, &given))
        return NULL;
    Py_ssize_t n = given.rows;
    const double *u = given.array[4], *l = given.array[5];
    double *lines = given.array[7], *error = given.array[8];
    move_lines(given.array[0], given.array[1], n, given.array[2], given.array[3], lines, lines + 3 * n);
    for (Py_ssize_t i = 0; i < 3 * n; i++) {
        error[i] = u[i] - lines[i];
        error[3 * n + i] = l[i] - lines[3 * n + i];
    }
    double deviation = deviation_of(lines + 3 * n, given.array[6], n);
    release_arguments(&given);
    return PyFloat_FromDouble(deviation);
}

PyObject *image_deviation(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const struct signature expected = {2, 0, 0, {3, 3}};
    struct arguments given;
    (void)self;
    if (!take_arguments(args, count, &expected, &given))
        return NULL;
    double deviation = deviation_of(given.array[0], given.array[1], given.rows);
    release_arguments(&given);
    return PyFloat_FromDouble(deviation);
}
