/* From eigenvectors to the ten isolated points of four lines. */

#include "kernels.h"

#include <math.h>
#include <string.h>

/* Last pivot of the equations of a centre, relative to the one before, from which they leave it free along a line: the
 * axis direction is that of a curve of singular centres. */
#define AMBIGUOUS 1e-3

static void swap(Complex *a, Complex *b)
{
    Complex c = *a;
    *a = *b, *b = c;
}

static Complex ratio(Complex a, Complex b)
{
    double size = square(b);
    return (Complex){(a.re * b.re + a.im * b.im) / size, (a.im * b.re - a.re * b.im) / size};
}

/* Fill the unit vector that a matrix, singular but for rounding, maps to zero, and return whether there is only one:
 * Gaussian elimination with complete pivoting, whose last pivot is that rounding. */
static int null_vector(Complex matrix[4][4], Complex *x)
{
    int order[4] = {0, 1, 2, 3};
    double pivot = 0.0;
    for (int rank = 0; rank < 3; rank++) {
        int row = rank, column = rank;
        for (int i = rank; i < 4; i++)
            for (int j = rank; j < 4; j++)
                if (square(matrix[i][j]) > square(matrix[row][column]))
                    row = i, column = j;
        pivot = square(matrix[row][column]);
        if (!(pivot > 0.0))
            break;
        for (int j = 0; j < 4; j++)
            swap(&matrix[row][j], &matrix[rank][j]);
        for (int i = 0; i < 4; i++)
            swap(&matrix[i][column], &matrix[i][rank]);
        int label = order[column];
        order[column] = order[rank], order[rank] = label;
        for (int i = rank + 1; i < 4; i++) {
            Complex factor = ratio(matrix[i][rank], matrix[rank][rank]);
            for (int j = rank + 1; j < 4; j++) {
                Complex product = times(factor, matrix[rank][j]);
                matrix[i][j].re -= product.re, matrix[i][j].im -= product.im;
            }
        }
    }
    if (!(square(matrix[3][3]) < AMBIGUOUS * AMBIGUOUS * pivot)) {
        memset(x, 0, 4 * sizeof *x);
        return 0;
    }
    Complex unknown[4] = {{0.0, 0.0}, {0.0, 0.0}, {0.0, 0.0}, {1.0, 0.0}};
    double total = 1.0;
    for (int i = 2; i >= 0; i--) {
        Complex sum = {0.0, 0.0};
        for (int j = i + 1; j < 4; j++) {
            Complex product = times(matrix[i][j], unknown[j]);
            sum.re -= product.re, sum.im -= product.im;
        }
        unknown[i] = ratio(sum, matrix[i][i]);
        total += square(unknown[i]);
    }
    for (int i = 0; i < 4; i++)
        x[order[i]] = (Complex){unknown[i].re / sqrt(total), unknown[i].im / sqrt(total)};
    return 1;
}

/* Fill the homogeneous centre of an axis direction, and return whether there is only one. */
static int center_of(const double *u, const double *point, const Complex *w, Complex *h)
{
    Complex rows[4][4];
    for (int i = 0; i < LINES; i++, u += 3, point += 3) {
        Complex along = {0.0, 0.0};
        for (int j = 0; j < 3; j++)
            along.re += u[j] * w[j].re, along.im += u[j] * w[j].im;
        rows[i][0] = (Complex){0.0, 0.0};
        for (int j = 0; j < 3; j++) {
            Complex across = {w[j].re - along.re * u[j], w[j].im - along.im * u[j]};
            rows[i][0].re -= across.re * point[j], rows[i][0].im -= across.im * point[j];
            rows[i][1 + j] = across;
        }
    }
    return null_vector(rows, h);
}

/* Fill the axis direction of an eigenvector: of w times each cubic monomial at w, the largest. */
static void axis_of(const Complex *vector, const double *functionals, const double *multiply, Complex *w)
{
    Complex values[QUARTICS] = {{0.0, 0.0}}, products[3][CUBICS] = {{{0.0, 0.0}}};
    for (int i = 0; i < CUBICS; i++)
        for (int j = 0; j < QUARTICS; j++) {
            values[j].re += vector[i].re * functionals[QUARTICS * i + j];
            values[j].im += vector[i].im * functionals[QUARTICS * i + j];
        }
    int best = 0;
    double most = 0.0;
    for (int axis = 0; axis < 3; axis++)
        for (int i = 0; i < CUBICS; i++, multiply += QUARTICS) {
            Complex *product = &products[axis][i];
            for (int j = 0; j < QUARTICS; j++) {
                product->re += multiply[j] * values[j].re;
                product->im += multiply[j] * values[j].im;
            }
            if (square(*product) > most)
                most = square(*product), best = i;
        }
    for (int axis = 0; axis < 3; axis++) {
        w[axis].re = most > 0.0 ? products[axis][best].re / sqrt(most) : 0.0;
        w[axis].im = most > 0.0 ? products[axis][best].im / sqrt(most) : 0.0;
    }
}

PyObject *axis_centers(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    struct arguments given;
    (void)self;
    int points = are_arguments(count, 10) ? count_rows(args[5]) : -1, found = 0;
    const struct signature expected = {
        9, 3, 1, {CUBICS, CUBICS * QUARTICS, -3 * CUBICS * QUARTICS, 3 * LINES, 3 * LINES, -2 * CUBICS * points,
                  -6 * points, -8 * points, -6 * points}};
    if (points < 0 || !take_arguments(args, count, &expected, &given))
        return NULL;
    const double *imaginary = given.array[0], *functionals = given.array[1], at_infinity = given.number[0];
    const Complex *vector = given.array[5];
    Complex *w = given.array[6], *h = given.array[7], *center = given.array[8];
    for (Py_ssize_t slot = 0; slot < CUBICS * given.rows; slot++) {
        if (!(imaginary[slot] >= 0.0) || ++found > points)
            continue;
        Py_ssize_t scene = slot / CUBICS;
        axis_of(vector, functionals + CUBICS * QUARTICS * scene, given.array[2], w);
        const double *u = (double *)given.array[3] + 3 * LINES * scene;
        const double *point = (double *)given.array[4] + 3 * LINES * scene;
        int finite = center_of(u, point, w, h) && square(h[0]) > at_infinity * at_infinity;
        for (int j = 0; j < 3; j++)
            center[j] = finite ? ratio(h[1 + j], h[0]) : (Complex){NAN, NAN};
        vector += CUBICS, w += 3, h += 4, center += 3;
    }
    release_arguments(&given);
    if (found != points)
        return PyErr_Format(PyExc_ValueError, "%d eigenvectors for %d eigenvalues", points, found);
    Py_RETURN_NONE;
}

/* Return the modulus of the inner product of unit vectors, or of one with the other's conjugate. */
static double overlap_of(const Complex *a, const Complex *b, double conjugate)
{
    Complex sum = {0.0, 0.0};
    for (int i = 0; i < 4; i++) {
        sum.re += a[i].re * b[i].re + conjugate * a[i].im * b[i].im;
        sum.im += a[i].re * b[i].im * conjugate - a[i].im * b[i].re;
    }
    return sqrt(square(sum));
}

/* Fill the ten of one scene, of which the first is given. */
static void ten_of(const double *imaginary, const Complex *h, const Complex *center, const double *residual,
                  double is_real, Complex *ten, double *residuals, double *real, double *overlap)
{
    int source = -1;
    *overlap = 0.0;
    for (int slot = 0; slot < CUBICS; slot++, ten += 3) {
        double conjugate = imaginary[slot] >= 0.0 ? 1.0 : -1.0;
        source += conjugate > 0.0;
        const Complex *own = center + 3 * source;
        double size = 0.0, out_of_real = 0.0;
        for (int j = 0; j < 3; j++) {
            ten[j] = (Complex){own[j].re, conjugate * own[j].im};
            size = fmax(size, sqrt(square(own[j])));
            out_of_real = fmax(out_of_real, fabs(own[j].im));
        }
        residuals[slot] = residual[source];
        /* Not for NaN. */
        real[slot] = isfinite(own[0].re) && out_of_real <= is_real * (1.0 + size);
        if (conjugate < 0.0)
            *overlap = fmax(*overlap, overlap_of(h + 4 * source, h + 4 * source, -1.0));
        else
            for (int other = 0; other < source; other++) {
                *overlap = fmax(*overlap, overlap_of(h + 4 * source, h + 4 * other, 1.0));
                *overlap = fmax(*overlap, overlap_of(h + 4 * source, h + 4 * other, -1.0));
            }
    }
}

PyObject *with_conjugates(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    struct arguments given;
    (void)self;
    int points = are_arguments(count, 9) ? count_rows(args[1]) : -1, used = 0;
    const struct signature expected = {
        8, 4, 1, {CUBICS, -8 * points, -6 * points, -points, 6 * CUBICS, CUBICS, CUBICS, 1}};
    if (points < 0 || !take_arguments(args, count, &expected, &given))
        return NULL;
    const double *imaginary = given.array[0], *residual = given.array[3];
    const Complex *h = given.array[1], *center = given.array[2];
    Complex *ten = given.array[4];
    double *residuals = given.array[5], *real = given.array[6], *overlap = given.array[7];
    for (Py_ssize_t i = 0; i < given.rows && used >= 0; i++, imaginary += CUBICS) {
        int needed = 0;
        for (int slot = 0; slot < CUBICS; slot++)
            needed += imaginary[slot] >= 0.0;
        if (!(imaginary[0] >= 0.0) || used + needed > points) {
            used = -1;
            break;
        }
        ten_of(imaginary, h + 4 * used, center + 3 * used, residual + used, given.number[0], ten + 3 * CUBICS * i,
               residuals + CUBICS * i, real + CUBICS * i, overlap + i);
        used += needed;
    }
    release_arguments(&given);
    if (used != points)
        return PyErr_Format(PyExc_ValueError, "%d points do not belong to the eigenvalues", points);
    Py_RETURN_NONE;
}
