/* How far from rank-deficient the image velocities are at many camera centres: singularities/residual.py. */

#include "kernels.h"

#include <float.h>
#include <math.h>

#define COLUMNS 6
#define MOST_STEPS 200
#define LINES_ON_STACK 32

/* Return the product of the conjugate of a with b. */
static Complex inner(const Complex *a, const Complex *b, Py_ssize_t n)
{
    Complex sum = {0.0, 0.0};
    for (Py_ssize_t i = 0; i < n; i++) {
        sum.re += a[i].re * b[i].re + a[i].im * b[i].im;
        sum.im += a[i].re * b[i].im - a[i].im * b[i].re;
    }
    return sum;
}

/* Turn `v` into the vector of a Householder reflection that maps it to a multiple of the first axis; return its length
 * and the factor of the reflection. */
static double reflector(Complex *v, Py_ssize_t n, double *factor)
{
    double length = sqrt(inner(v, v, n).re), first = sqrt(square(*v));
    *factor = length > 0.0 ? 1.0 / (length * (length + first)) : 0.0;
    if (first > 0.0) {
        v->re *= 1.0 + length / first;
        v->im *= 1.0 + length / first;
    } else
        v->re = length;
    return length;
}

/* Overwrite columns `x` (6, m), m >= 6, and return the absolute values of a bidiagonal matrix with the same singular
 * values: unitary diagonal matrices would take away its phases. */
static void bidiagonalise(Complex *x, Py_ssize_t m, double *diagonal, double *above)
{
    for (int c = 0; c < COLUMNS; c++) {
        Complex *v = x + c * m + c, row[COLUMNS];
        Py_ssize_t length = m - c;
        double factor;
        diagonal[c] = reflector(v, length, &factor);
        for (int j = c + 1; j < COLUMNS; j++) {
            Complex *column = x + j * m + c, product = inner(v, column, length);
            product.re *= factor, product.im *= factor;
            for (Py_ssize_t i = 0; i < length; i++) {
                column[i].re -= product.re * v[i].re - product.im * v[i].im;
                column[i].im -= product.re * v[i].im + product.im * v[i].re;
            }
            row[j].re = column[0].re, row[j].im = -column[0].im;
        }
        if (c + 1 == COLUMNS)
            break;
        above[c] = reflector(row + c + 1, COLUMNS - c - 1, &factor);
        for (Py_ssize_t i = c + 1; i < m; i++) {
            Complex product = {0.0, 0.0};
            for (int j = c + 1; j < COLUMNS; j++) {
                Complex element = x[j * m + i];
                product.re += element.re * row[j].re - element.im * row[j].im;
                product.im += element.re * row[j].im + element.im * row[j].re;
            }
            product.re *= factor, product.im *= factor;
            for (int j = c + 1; j < COLUMNS; j++) {
                x[j * m + i].re -= product.re * row[j].re + product.im * row[j].im;
                x[j * m + i].im -= product.im * row[j].re - product.re * row[j].im;
            }
        }
    }
}

/* Return the length of (a, b), and the cosine and sine of the rotation that turns it to the first axis. */
static double rotation(double a, double b, double *cosine, double *sine)
{
    double length = sqrt(a * a + b * b);
    *cosine = length > 0.0 ? a / length : 1.0;
    *sine = length > 0.0 ? b / length : 0.0;
    return length;
}

/* One implicit QR step on a bidiagonal block of `n` diagonal elements `d`, shifted by the eigenvalue of the last two
 * rows, or not at all if a diagonal element is as good as zero: then the last `e` becomes zero. */
static void golub_kahan_step(double *d, double *e, int n, double nothing)
{
    double last = d[n - 1], before = d[n - 2], cosine, sine;
    double half = 0.5 * ((before + last) * (before - last) + e[n - 2] * e[n - 2]);
    double product = last * e[n - 2] * last * e[n - 2];
    double root = copysign(sqrt(half * half + product), half);
    double shift = half + root != 0.0 ? product / (half + root) : 0.0;
    double f = (d[0] + last) * (d[0] - last) + shift, g = d[0] * e[0];
    for (int i = 0; i < n; i++)
        if (fabs(d[i]) <= nothing)
            f = d[0], g = e[0];
    for (int i = 0; i < n - 1; i++) {
        double length = rotation(f, g, &cosine, &sine);
        if (i > 0)
            e[i - 1] = length;
        f = cosine * d[i] + sine * e[i];
        e[i] = cosine * e[i] - sine * d[i];
        g = sine * d[i + 1];
        d[i + 1] *= cosine;
        d[i] = rotation(f, g, &cosine, &sine);
        f = cosine * e[i] + sine * d[i + 1];
        d[i + 1] = cosine * d[i + 1] - sine * e[i];
        if (i < n - 2) {
            g = sine * e[i + 1];
            e[i + 1] *= cosine;
        }
    }
    e[n - 2] = f;
}

/* Return the smallest over the largest singular value of a bidiagonal matrix without negative elements, or NaN if it is
 * not finite or the steps do not converge. */
static double ratio_of_bidiagonal(double *d, double *e)
{
    double size = 0.0, total = 0.0;
    for (int i = 0; i < COLUMNS; i++) {
        double beside = i < COLUMNS - 1 ? e[i] : 0.0;
        size = fmax(size, fmax(d[i], beside));
        total += d[i] + beside;
    }
    if (!isfinite(total))
        return NAN;
    int end = COLUMNS, steps = 0;
    while (end > 1) {
        int start = end - 1;
        while (start > 0 && !(fabs(e[start - 1]) <= 0.1 * DBL_EPSILON * size))
            start--;
        if (start == end - 1)
            end--;
        else if (steps++ < MOST_STEPS)
            golub_kahan_step(d + start, e + start, end - start, 0.1 * DBL_EPSILON * size);
        else
            return NAN;
    }
    double least = INFINITY, most = 0.0;
    for (int i = 0; i < COLUMNS; i++) {
        least = fmin(least, fabs(d[i]));
        most = fmax(most, fabs(d[i]));
    }
    return most > 0.0 ? least / most : 0.0;
}

/* f = u x (M - C) */
static void interpretation_plane(const double *u, const double *point, const double *center, Complex *f)
{
    double re[3], im[3];
    for (int i = 0; i < 3; i++) {
        re[i] = point[i] - center[2 * i];
        im[i] = -center[2 * i + 1];
    }
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        f[i].re = u[j] * re[k] - u[k] * re[j];
        f[i].im = u[j] * im[k] - u[k] * im[j];
    }
}

/* Fill `x` with the columns (6, 2n) of the row-normalised xi at a centre; return the distance of the nearest line
 * in the root mean square distance, or NaN if that is not finite, with `x` unfinished. */
static double rank_basis(const double *u, const double *point, Py_ssize_t n, const double *center, double on_line,
                         Complex *x)
{
    double total = 0.0, nearest = INFINITY;
    Complex f[3];
    for (Py_ssize_t i = 0; i < n; i++) {
        interpretation_plane(u + 3 * i, point + 3 * i, center, f);
        double size = inner(f, f, 3).re;
        total += size;
        nearest = fmin(nearest, size);
    }
    if (!isfinite(total))
        return NAN;
    double unit_square = total / (double)n, unit = sqrt(unit_square);
    for (Py_ssize_t i = 0; i < n; i++, u += 3, point += 3) {
        interpretation_plane(u, point, center, f);
        /* In units of length before anything of fourth order is formed, which could over- or underflow. */
        for (int j = 0; j < 3; j++)
            f[j] = (Complex){f[j].re / unit, f[j].im / unit};
        double size = inner(f, f, 3).re;
        /* Also for NaN, where all lengths are zero. */
        if (!(size > on_line * on_line)) {
            for (int j = 0; j < COLUMNS; j++)
                x[j * 2 * n + i] = x[j * 2 * n + n + i] = (Complex){0.0, 0.0};
            continue;
        }
        /* Without conjugation, so that xi stays polynomial in the centre. */
        Complex dot = {0.0, 0.0};
        for (int j = 0; j < 3; j++) {
            dot.re += f[j].re * f[j].re - f[j].im * f[j].im;
            dot.im += 2.0 * f[j].re * f[j].im;
        }
        double upper = 1.0 / sqrt(size + dot.re * dot.re + dot.im * dot.im), lower = 1.0 / sqrt(size);
        for (int j = 0; j < 3; j++) {
            int k = (j + 1) % 3, l = (j + 2) % 3;
            Complex *column = x + j * 2 * n, *turning = x + (j + 3) * 2 * n;
            column[i] = (Complex){f[j].re * upper, f[j].im * upper};
            turning[i] = (Complex){u[j] * dot.re * upper, u[j] * dot.im * upper};
            column[n + i] = (Complex){0.0, 0.0};
            turning[n + i].re = (u[k] * f[l].re - u[l] * f[k].re) * lower;
            turning[n + i].im = (u[k] * f[l].im - u[l] * f[k].im) * lower;
        }
    }
    return total > 0.0 ? sqrt(nearest / unit_square) : 0.0;
}

PyObject *singularity_ratios(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    struct arguments given;
    (void)self;
    int scenes = are_arguments(count, 6) ? count_rows(args[0]) : -1, centers = scenes < 0 ? -1 : count_rows(args[2]);
    const struct signature expected = {5, 2, 1, {3, 3, -COLUMNS * centers, -centers, -centers}};
    if (centers < 0 || !take_arguments(args, count, &expected, &given))
        return NULL;
    const double *u = given.array[0], *point = given.array[1], *center = given.array[2];
    double *ratios = given.array[3], *nearest = given.array[4];
    Complex on_stack[COLUMNS * 2 * LINES_ON_STACK], *room = on_stack;
    Py_ssize_t n = scenes > 0 ? given.rows / scenes : 0;
    if (n < 3 || n * scenes != given.rows || (scenes != 1 && scenes != centers))
        PyErr_Format(PyExc_ValueError, "%d sets of %zd lines for %d centres", scenes, n, centers);
    else if (n > LINES_ON_STACK && !(room = PyMem_RawMalloc(COLUMNS * 2 * n * sizeof(Complex))))
        PyErr_NoMemory();
    for (int i = 0; i < centers && !PyErr_Occurred(); i++) {
        Py_ssize_t first = scenes == 1 ? 0 : 3 * n * i;
        double diagonal[COLUMNS], above[COLUMNS];
        nearest[i] = rank_basis(u + first, point + first, n, center + COLUMNS * i, given.number[0], room);
        if (isnan(nearest[i])) {
            ratios[i] = 1.0, nearest[i] = INFINITY;
            continue;
        }
        bidiagonalise(room, 2 * n, diagonal, above);
        ratios[i] = ratio_of_bidiagonal(diagonal, above);
        if (isnan(ratios[i]))
            PyErr_SetString(PyExc_ValueError, "the singular values of a matrix did not converge");
    }
    if (room != on_stack)
        PyMem_RawFree(room);
    release_arguments(&given);
    if (PyErr_Occurred())
        return NULL;
    Py_RETURN_NONE;
}
