/* The five plane quartics whose common zeros are the axis directions of the ten isolated points of four lines. */

#include "kernels.h"

#include <math.h>
#include <string.h>

#define EQUATIONS 5
#define FORCES 4

/* Fill the five equations, linear in the axis direction, for each force of an orthonormal basis of those across their
 * lines in balance and without virial. */
static void force_equations(const double *u, const double *point, double equations[FORCES][EQUATIONS][3])
{
    double constraints[8][3 * LINES] = {{0.0}}, beta[8], diagonal[8], forces[FORCES][3 * LINES];
    for (int i = 0; i < LINES; i++)
        for (int j = 0; j < 3; j++) {
            constraints[i][3 * i + j] = u[3 * i + j];
            constraints[4 + j][3 * i + j] = 1.0;
            constraints[7][3 * i + j] = point[3 * i + j];
        }
    reflect_to_triangle(constraints[0], 3 * LINES, 8, beta, diagonal);
    orthogonal_complement(constraints[0], 3 * LINES, 8, beta, forces[0]);
    memset(equations, 0, FORCES * EQUATIONS * 3 * sizeof(double));
    for (int i = 0; i < LINES; i++) {
        double moment[3];
        cross3(u + 3 * i, point + 3 * i, moment);
        for (int f = 0; f < FORCES; f++) {
            cross3(u + 3 * i, forces[f] + 3 * i, equations[f][i]);
            add_multiple(equations[f][4], dot_product(forces[f] + 3 * i, moment, 3), u + 3 * i, 3);
        }
    }
}

/* Return the determinant of four columns, by Laplace's expansion, given the 2 x 2 minors of the first two rows and of
 * the last two. */
static double determinant(double p[EQUATIONS][EQUATIONS], double q[EQUATIONS][EQUATIONS], int a, int b, int c, int d)
{
    return p[a][b] * q[c][d] - p[a][c] * q[b][d] + p[a][d] * q[b][c] + p[b][c] * q[a][d] - p[b][d] * q[a][c] +
           p[c][d] * q[a][b];
}

/* Fill the five 4 x 4 minors at an axis direction, `stride` apart. */
static void minors(double equations[FORCES][EQUATIONS][3], const double *w, double *values, int stride)
{
    double row[FORCES][EQUATIONS], first[EQUATIONS][EQUATIONS], last[EQUATIONS][EQUATIONS];
    for (int f = 0; f < FORCES; f++)
        for (int e = 0; e < EQUATIONS; e++)
            row[f][e] = dot_product(equations[f][e], w, 3);
    for (int i = 0; i < EQUATIONS; i++)
        for (int j = i + 1; j < EQUATIONS; j++) {
            first[i][j] = row[0][i] * row[1][j] - row[0][j] * row[1][i];
            last[i][j] = row[2][i] * row[3][j] - row[2][j] * row[3][i];
        }
    values[0] = determinant(first, last, 1, 2, 3, 4);
    values[stride] = determinant(first, last, 0, 2, 3, 4);
    values[2 * stride] = determinant(first, last, 0, 1, 3, 4);
    values[3 * stride] = determinant(first, last, 0, 1, 2, 4);
    values[4 * stride] = determinant(first, last, 0, 1, 2, 3);
}

/* Fill the orthonormal rows (10, 15) orthogonal to the five quartics; return the rank margin. */
static double functionals_of(const double *u, const double *point, const double *samples, const double *interpolate,
                             double *rows)
{
    double equations[FORCES][EQUATIONS][3], values[EQUATIONS][QUARTICS], quartics[EQUATIONS][QUARTICS];
    double beta[EQUATIONS], diagonal[EQUATIONS], least = INFINITY, most = 0.0;
    force_equations(u, point, equations);
    for (int s = 0; s < QUARTICS; s++)
        minors(equations, samples + 3 * s, values[0] + s, QUARTICS);
    for (int e = 0; e < EQUATIONS; e++)
        for (int s = 0; s < QUARTICS; s++)
            quartics[e][s] = dot_product(interpolate + QUARTICS * s, values[e], QUARTICS);
    reflect_to_triangle(quartics[0], QUARTICS, EQUATIONS, beta, diagonal);
    orthogonal_complement(quartics[0], QUARTICS, EQUATIONS, beta, rows);
    for (int e = 0; e < EQUATIONS; e++) {
        if (isnan(diagonal[e]))
            return NAN;
        least = fmin(least, fabs(diagonal[e]));
        most = fmax(most, fabs(diagonal[e]));
    }
    return most > 0.0 ? least / most : 0.0;
}

PyObject *quartic_functionals(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const struct signature expected = {
        6, 2, 0, {3 * LINES, 3 * LINES, -3 * QUARTICS, -QUARTICS * QUARTICS, CUBICS * QUARTICS, 1}};
    struct arguments given;
    (void)self;
    if (!take_arguments(args, count, &expected, &given))
        return NULL;
    Py_ssize_t scenes = given.rows;
    const double *u = given.array[0], *point = given.array[1];
    double *rows = given.array[4], *margin = given.array[5];
    for (; scenes > 0; scenes--, u += 3 * LINES, point += 3 * LINES, rows += CUBICS * QUARTICS)
        *margin++ = functionals_of(u, point, given.array[2], given.array[3], rows);
    release_arguments(&given);
    Py_RETURN_NONE;
}
