/* Camera rotations from three lines, for many triplets at once, and the translations that go with them. */

#include "kernels.h"

#include <math.h>
#include <string.h>

#define SAMPLES 9
#define DEGREE 8
#define DEGENERATE 1e-10
#define LEAST 1e-15

/* c = a b, or a^T b. */
static void multiply(const double *a, int transposed, const double *b, double *c)
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            c[3 * i + j] = 0.0;
            for (int l = 0; l < 3; l++)
                c[3 * i + j] += a[transposed ? 3 * l + i : 3 * i + l] * b[3 * l + j];
        }
}

/* A rotation that takes a unit vector to the z axis. */
static void frame_of(const double *axis, double *frame)
{
    double sign = copysign(1.0, axis[2]), mirror[3] = {axis[0], axis[1], axis[2] + sign};
    double scale = 2.0 / dot3(mirror, mirror);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            frame[3 * i + j] = (i == 1 ? 1.0 : sign) * (scale * mirror[i] * mirror[j] - (i == j));
}

/* The two equations at an angle beta, both linear in (cos alpha, sin alpha, 1), solved up to the length. */
static void solve_for_alpha(double equations[2][3][3], double cosine, double sine, double *solution)
{
    double at[2][3];
    for (int k = 0; k < 2; k++)
        for (int i = 0; i < 3; i++)
            at[k][i] = equations[k][i][0] + equations[k][i][1] * cosine + equations[k][i][2] * sine;
    cross3(at[0], at[1], solution);
}

/* Fill the rotations (3, 3) of one triplet and return how many there are; -1 for a continuum. */
static int rotations_of(const double *frame, const double *others, const double *normals, const double *samples,
                        double *rotation)
{
    double image_frame[9], equations[2][3][3], size = 1.0, q[SAMPLES], most = 0.0, coefficients[SAMPLES];
    double companion[DEGREE * DEGREE] = {0.0}, real[DEGREE], imaginary[DEGREE], solution[3];
    const double *cosines = samples, *sines = samples + SAMPLES;
    int start = 0, found = 0;
    frame_of(normals, image_frame);
    for (int k = 0; k < 2; k++) {
        const double *n = normals + 3 * (k + 1), *u = others + 3 * k;
        double a = dot3(image_frame, n), b = dot3(image_frame + 3, n), c = dot3(image_frame + 6, n), largest = 0.0;
        const double of_line[3][3] = {
            {a * u[0], b * u[1], -b * u[2]}, {b * u[0], -a * u[1], a * u[2]}, {0.0, c * u[2], c * u[1]}};
        memcpy(equations[k], of_line, sizeof of_line);
        for (int i = 0; i < 9; i++)
            largest = fmax(largest, fabs(of_line[i / 3][i % 3]));
        size *= largest * largest;
    }
    for (int m = 0; m < SAMPLES; m++) {
        solve_for_alpha(equations, cosines[m], sines[m], solution);
        q[m] = solution[0] * solution[0] + solution[1] * solution[1] - solution[2] * solution[2];
        if (fabs(q[m]) > most) {
            most = fabs(q[m]);
            start = m;
        }
    }
    if (!(most > DEGENERATE * size))
        return -1;
    for (int i = 0; i < SAMPLES; i++) {
        coefficients[i] = 0.0;
        for (int m = 0; m < SAMPLES; m++)
            coefficients[i] += samples[SAMPLES * (i + 2) + m] * q[(start + m) % SAMPLES];
    }
    for (int i = 0; i < DEGREE; i++) {
        companion[i] = -coefficients[DEGREE - 1 - i] / coefficients[DEGREE];
        if (i > 0)
            companion[DEGREE * i + i - 1] = 1.0;
    }
    if (!hessenberg_eigenvalues(companion, DEGREE, real, imaginary))
        return 0;
    for (int i = 0; i < DEGREE; i++) {
        if (!(imaginary[i] >= 0.0))
            continue;
        /* Roots are tangents of half of the angle from opposite to `start`, so that the largest q is at infinity. */
        double x = 1.0 - real[i] * real[i] - imaginary[i] * imaginary[i], y = 2.0 * real[i], length = hypot(x, y);
        double c = length > 0.0 ? x / length : 1.0, s = length > 0.0 ? y / length : 0.0;
        double cosine = -(c * cosines[start] - s * sines[start]);
        double sine = -(s * cosines[start] + c * sines[start]);
        solve_for_alpha(equations, cosine, sine, solution);
        double across = hypot(solution[0], solution[1]);
        if (!(across * across > DEGENERATE * size))
            continue;
        double scale = copysign(1.0 / across, solution[2]), ca = solution[0] * scale, sa = solution[1] * scale;
        const double middle[9] = {ca, -sa * cosine, sa * sine, sa, ca * cosine, -ca * sine, 0.0, sine, cosine};
        double turned[9];
        multiply(middle, 0, frame, turned);
        multiply(image_frame, 1, turned, rotation + 9 * found++);
    }
    return found;
}

PyObject *triplet_rotations(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const struct signature expected = {7, 3, 0, {9, 6, 9, -SAMPLES * (SAMPLES + 2), 9 * DEGREE, DEGREE, 1}};
    struct arguments given;
    (void)self;
    if (!take_arguments(args, count, &expected, &given))
        return NULL;
    Py_ssize_t triplets = given.rows;
    const double *frame = given.array[0], *others = given.array[1], *normals = given.array[2];
    double *rotation = given.array[4], *triplet = given.array[5], *degenerate = given.array[6];
    long all = 0;
    for (Py_ssize_t i = 0; i < triplets; i++) {
        int found = rotations_of(frame + 9 * i, others + 6 * i, normals + 9 * i, given.array[3], rotation + 9 * all);
        degenerate[i] = found < 0;
        for (; found > 0; found--)
            triplet[all++] = (double)i;
    }
    release_arguments(&given);
    return PyLong_FromLong(all);
}

PyObject *translations(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    struct arguments given;
    (void)self;
    const int n = are_arguments(count, 4) ? count_lines(args[1]) : -1;
    const struct signature expected = {4, 1, 0, {9, -3 * n, -3 * n, 3}};
    if (n < 0 || !take_arguments(args, count, &expected, &given))
        return NULL;
    const double *rotation = given.array[0], *normals = given.array[1], *points = given.array[2];
    double *t = given.array[3], normal[9] = {LEAST, 0.0, 0.0, 0.0, LEAST, 0.0, 0.0, 0.0, LEAST};
    for (Py_ssize_t i = 0; i < 3 * n; i += 3)
        for (int j = 0; j < 9; j++)
            normal[j] += normals[i + j / 3] * normals[i + j % 3];
    for (Py_ssize_t k = given.rows; k > 0; k--, rotation += 9, t += 3) {
        double matrix[9];
        memcpy(matrix, normal, sizeof matrix);
        t[0] = t[1] = t[2] = 0.0;
        for (Py_ssize_t i = 0; i < 3 * n; i += 3) {
            double off = 0.0;
            for (int j = 0; j < 3; j++)
                off += normals[i + j] * dot3(rotation + 3 * j, points + i);
            for (int j = 0; j < 3; j++)
                t[j] -= normals[i + j] * off;
        }
        if (!eliminate(matrix, t, 3))
            t[0] = t[1] = t[2] = 0.0;
    }
    release_arguments(&given);
    Py_RETURN_NONE;
}
