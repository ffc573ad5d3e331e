/* Residuals of image lines, and their derivatives, for many poses at once. */

#include "kernels.h"

#include <math.h>

#define SMALLEST_DEPTH 1e-12

int take_image(PyObject *const *args, Py_ssize_t count, const struct signature *expected, struct image *image)
{
    if (!take_arguments(args, count, expected, &image->given))
        return 0;
    const double *settings = image->given.array[2];
    image->lines = image->given.array[0];
    image->seen = image->given.array[1];
    image->count = image->given.buffers[1].len / (Py_ssize_t)(3 * sizeof(double));
    image->noise = settings[0] * settings[0];
    image->scene = settings[1] * settings[1];
    image->camera = settings[2] * settings[2];
    image->least_cosine = settings[3];
    image->room = PyMem_RawMalloc(2 * image->count * sizeof *image->room);
    if (image->room)
        return 1;
    PyErr_NoMemory();
    release_arguments(&image->given);
    return 0;
}

void release_image(struct image *image)
{
    PyMem_RawFree(image->room);
    release_arguments(&image->given);
}

/* The factor of the inverse of the covariance of a line's angle and offset; kernels/residuals.py has the source. */
static void whitening_of(const struct image *image, double depth, double q2, double along, struct residual *line)
{
    double s = line->s, vz = line->vz, by_moment = (image->scene + image->camera) * q2, turn = depth * depth * q2;
    double first = s - vz * along, second = q2 * vz + s * along;
    double a = image->noise + by_moment * vz * vz + image->scene * turn * first * first + image->camera * turn * s * s;
    double b = -by_moment * vz * s + image->scene * turn * first * second + image->camera * turn * s * q2 * vz;
    double d = image->noise + by_moment * s * s + image->scene * turn * second * second +
               image->camera * turn * (q2 * vz) * (q2 * vz);
    double d_left = fmax(d - b * b / a, 1e-15 * d);
    line->whitening[0] = 1.0 / sqrt(a);
    line->whitening[2] = 1.0 / sqrt(d_left);
    line->whitening[1] = -b / a * line->whitening[2];
    line->determinant = a * d_left;
}

void residuals_at(const struct image *image, const double *rotation, const double *t, struct residual *lines)
{
    const double *known = image->lines, *seen = image->seen;
    for (Py_ssize_t i = 0; i < image->count; i++, known += 6, seen += 3) {
        struct residual *line = lines + i;
        double u[3], m[3], shift[3];
        times3(rotation, known, u);
        times3(rotation, known + 3, m);
        cross3(t, u, shift);
        add_multiple(m, 1.0, shift, 3);
        double depth = fmax(hypot(m[0], m[1]), SMALLEST_DEPTH), agreement = seen[0] * m[0] + seen[1] * m[1];
        /* Directed as it is seen: whether that is against its own direction is counted apart. */
        double scale = copysign(1.0 / depth, agreement);
        double vx = u[0] * scale, vy = u[1] * scale;
        for (int j = 0; j < 3; j++)
            line->p[j] = m[j] * scale;
        line->vz = u[2] * scale;
        line->s = line->p[0] * vy - line->p[1] * vx;
        line->raw[0] = atan2(seen[0] * line->p[1] - seen[1] * line->p[0], agreement * scale);
        line->raw[1] = line->p[2] - seen[2];
        line->reversed = agreement < 0.0;
        line->hidden = !(line->s < 0.0 || fabs(u[2]) > image->least_cosine);
        double along = t[0] * vx + t[1] * vy + t[2] * line->vz;
        whitening_of(image, depth, 1.0 + line->p[2] * line->p[2], along, line);
    }
}

void whiten(const double *whitening, const double *raw, double *value)
{
    value[0] = whitening[0] * raw[0];
    value[1] = whitening[1] * raw[0] + whitening[2] * raw[1];
}

void jacobian_of(const struct residual *line, double rows[2][6])
{
    const double *p = line->p, q2 = 1.0 + p[2] * p[2];
    for (int j = 0; j < 3; j++) {
        rows[0][j] = line->vz * p[j];
        rows[1][j] = -line->s * p[j];
    }
    rows[0][3] = p[2] * p[0];
    rows[0][4] = p[2] * p[1];
    rows[0][5] = -1.0;
    rows[1][3] = -q2 * p[1];
    rows[1][4] = q2 * p[0];
    rows[1][5] = 0.0;
}

PyObject *image_residuals(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    struct image image;
    (void)self;
    const int n = are_arguments(count, 6) ? count_lines(args[1]) : -1;
    const struct signature expected = {6, 1, 0, {IMAGE(n), 9, 3, RESIDUAL_ROWS * n}};
    if (n < 0 || !take_image(args, count, &expected, &image))
        return NULL;
    const double *rotation = image.given.array[3], *translation = image.given.array[4];
    double *table = image.given.array[5];
    for (Py_ssize_t k = image.given.rows; k > 0; k--, rotation += 9, translation += 3, table += RESIDUAL_ROWS * n) {
        residuals_at(&image, rotation, translation, image.room);
        for (int i = 0; i < n; i++) {
            const struct residual *line = image.room + i;
            double value[2];
            whiten(line->whitening, line->raw, value);
            const double column[RESIDUAL_ROWS] = {
                line->raw[0],       line->raw[1],       value[0],       value[1],     line->whitening[0],
                line->whitening[1], line->whitening[2], line->p[0],     line->p[1],   line->p[2],
                line->s,            line->vz,           line->reversed, line->hidden, log(line->determinant)};
            for (int j = 0; j < RESIDUAL_ROWS; j++)
                table[j * n + i] = column[j];
        }
    }
    release_image(&image);
    Py_RETURN_NONE;
}

PyObject *image_jacobians(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const struct signature expected = {3, 2, 0, {RESIDUAL_ROWS, 12, 12}};
    struct arguments given;
    (void)self;
    int k = are_arguments(count, 3) ? count_rows(args[0]) : -1;
    if (k < 0 || !take_arguments(args, count, &expected, &given))
        return NULL;
    const Py_ssize_t n = k > 0 ? given.rows / k : 0;
    if (n * k != given.rows) {
        release_arguments(&given);
        return PyErr_Format(PyExc_ValueError, "%zd lines for %d poses", given.rows, k);
    }
    const double *table = given.array[0];
    double *raw = given.array[1], *whitened = given.array[2];
    for (; k > 0; k--, table += RESIDUAL_ROWS * n, raw += 12 * n, whitened += 12 * n)
        for (Py_ssize_t i = 0; i < n; i++) {
            struct residual line;
            for (int j = 0; j < 3; j++) {
                line.whitening[j] = table[(4 + j) * n + i];
                line.p[j] = table[(7 + j) * n + i];
            }
            line.s = table[10 * n + i];
            line.vz = table[11 * n + i];
            double rows[2][6];
            jacobian_of(&line, rows);
            for (int j = 0; j < 6; j++) {
                const double column[2] = {rows[0][j], rows[1][j]};
                double value[2];
                whiten(line.whitening, column, value);
                for (int r = 0; r < 2; r++) {
                    raw[6 * (r * n + i) + j] = column[r];
                    whitened[6 * (r * n + i) + j] = value[r];
                }
            }
        }
    release_arguments(&given);
    Py_RETURN_NONE;
}
