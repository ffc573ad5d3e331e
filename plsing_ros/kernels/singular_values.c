/* The thin singular value decomposition of a matrix of few columns: Householder's QR, then Jacobi's one-sided
 * rotations of the triangular factor. */

#include "kernels.h"

#include <math.h>
#include <string.h>

#define ROWS_ON_STACK 128
#define MOST_SWEEPS 60
/* Squares below this, of rows of a matrix whose largest element is about one, are as good as zero: far below rounding,
 * far above where products of two of them underflow. */
#define NOTHING 1e-60

static double dot(const double *a, const double *b, Py_ssize_t n)
{
    double sums[4] = {0.0, 0.0, 0.0, 0.0};
    Py_ssize_t i = 0;
    for (; i + 4 <= n; i += 4)
        for (int j = 0; j < 4; j++)
            sums[j] += a[i + j] * b[i + j];
    for (; i < n; i++)
        sums[0] += a[i] * b[i];
    return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

static void add(double *a, double factor, const double *b, Py_ssize_t n)
{
    for (Py_ssize_t i = 0; i < n; i++)
        a[i] += factor * b[i];
}

/* (a, b) <- (c a - s b, s a + c b) */
static void rotate(double *a, double *b, double c, double s, int n)
{
    for (int i = 0; i < n; i++) {
        double x = a[i], y = b[i];
        a[i] = c * x - s * y;
        b[i] = s * x + c * y;
    }
}

/* Overwrite the rows `x` of a matrix's transpose (k, m) by Householder vectors, whose factors are `beta`, and return
 * the triangular factor of the matrix in `r` (k, k). */
static void triangularise(double *x, Py_ssize_t m, int k, double *beta, double *r)
{
    for (int c = 0; c < k; c++) {
        double *v = x + c * m + c;
        Py_ssize_t length = m - c;
        double square = dot(v, v, length), norm = sqrt(square);
        /* A column that is as good as zero is left as it is. */
        double diagonal = square < NOTHING ? v[0] : v[0] > 0.0 ? -norm : norm;
        v[0] -= diagonal;
        beta[c] = square < NOTHING ? 0.0 : -1.0 / (diagonal * v[0]);
        r[c * k + c] = diagonal;
        for (int j = c + 1; j < k; j++) {
            double *column = x + j * m + c;
            add(column, -beta[c] * dot(v, column, length), v, length);
            r[c * k + j] = column[0];
            r[j * k + c] = 0.0;
        }
    }
}

/* Rotate the rows of `r` (k, k) until they are orthogonal, and those of `w` alike; return whether that succeeded.
 *
 * One-sided Jacobi: it leaves no singular value with a larger error than the triangular factor itself has. */
static int orthogonalise_rows(double *r, double *w, int k)
{
    for (int sweep = 0; sweep < MOST_SWEEPS; sweep++) {
        int done = 1;
        for (int p = 0; p < k - 1; p++)
            for (int q = p + 1; q < k; q++) {
                double *a = r + p * k, *b = r + q * k;
                double aa = dot(a, a, k), bb = dot(b, b, k), ab = dot(a, b, k);
                if (!(ab * ab > 1e-31 * aa * bb) || aa < NOTHING || bb < NOTHING)
                    continue;
                done = 0;
                double zeta = (bb - aa) / (2.0 * ab);
                double tangent = copysign(1.0, zeta) / (fabs(zeta) + hypot(1.0, zeta));
                double cosine = 1.0 / sqrt(1.0 + tangent * tangent);
                rotate(a, b, cosine, cosine * tangent, k);
                rotate(w + p * k, w + q * k, cosine, cosine * tangent, k);
            }
        if (done)
            return 1;
    }
    return 0;
}

/* Make row `which` of orthonormal rows `v` (k, k) a unit vector orthogonal to those before it. */
static void complete(double *v, int which, int k)
{
    double *row = v + which * k, best = 0.0, candidate[MOST_COLUMNS];
    for (int axis = 0; axis < k; axis++) {
        memset(candidate, 0, sizeof candidate);
        candidate[axis] = 1.0;
        /* Twice, because the first time leaves rounding errors. */
        for (int j = 0; j < 2 * which; j++) {
            const double *other = v + (j % which) * k;
            add(candidate, -dot(other, candidate, k), other, k);
        }
        double norm = sqrt(dot(candidate, candidate, k));
        if (norm > best) {
            best = norm;
            for (int i = 0; i < k; i++)
                row[i] = candidate[i] / norm;
        }
    }
}

/* For six columns, LAPACK's dgesdd takes two to four times as long, most of it before the first multiplication. */
int decompose(const double *matrix, Py_ssize_t m, int k, double *x, double *left, double *values, double *right)
{
    double beta[MOST_COLUMNS], r[MOST_COLUMNS * MOST_COLUMNS], w[MOST_COLUMNS * MOST_COLUMNS] = {0.0};
    double norms[MOST_COLUMNS], size = 0.0, not_finite = 0.0;
    for (Py_ssize_t i = 0; i < m * k; i++) {
        size = fmax(size, fabs(matrix[i]));
        not_finite += 0.0 * matrix[i];
    }
    if (not_finite != 0.0)
        return 0;
    /* Squares neither over- nor underflow: the largest element becomes about one, without rounding. */
    int exponent = 0;
    frexp(size, &exponent);
    exponent = exponent < -1000 ? -1000 : exponent;
    double scale = ldexp(1.0, -exponent);
    for (Py_ssize_t i = 0; i < m; i++)
        for (int j = 0; j < k; j++)
            x[j * m + i] = matrix[i * k + j] * scale;
    triangularise(x, m, k, beta, r);
    for (int j = 0; j < k; j++)
        w[j * k + j] = 1.0;
    if (!orthogonalise_rows(r, w, k))
        return 0;
    int order[MOST_COLUMNS];
    for (int j = 0; j < k; j++) {
        norms[j] = sqrt(dot(r + j * k, r + j * k, k));
        int place = j;
        for (; place > 0 && norms[order[place - 1]] < norms[j]; place--)
            order[place] = order[place - 1];
        order[place] = j;
    }
    for (int j = 0; j < k; j++) {
        const double *row = r + order[j] * k, norm = norms[order[j]];
        values[j] = ldexp(norm, exponent);
        if (norm * norm < NOTHING)
            complete(right, j, k);
        else
            for (int i = 0; i < k; i++)
                right[j * k + i] = row[i] / norm;
        for (Py_ssize_t i = 0; i < m; i++)
            left[i * k + j] = i < k ? w[order[j] * k + i] : 0.0;
    }
    for (int c = k - 1; c >= 0; c--) {
        const double *v = x + c * m;
        double products[MOST_COLUMNS] = {0.0};
        for (Py_ssize_t i = c; i < m; i++)
            for (int j = 0; j < k; j++)
                products[j] += v[i] * left[i * k + j];
        for (Py_ssize_t i = c; i < m; i++)
            for (int j = 0; j < k; j++)
                left[i * k + j] -= beta[c] * v[i] * products[j];
    }
    return isfinite(values[0]);
}

PyObject *svd(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Py_buffer buffers[4];
    (void)self;
    if (!are_arguments(count, 4))
        return NULL;
    int width = (int)PyObject_Length(args[2]);
    if (width < 1 || width > MOST_COLUMNS) {
        if (!PyErr_Occurred())
            PyErr_SetString(PyExc_ValueError, "there must be 1 to 6 singular values");
        return NULL;
    }
    const int columns[] = {width, width, -width, -width * width};
    Py_ssize_t rows = take_arrays(args, columns, 4, 3, buffers);
    if (rows < 0)
        return NULL;
    double on_stack[MOST_COLUMNS * ROWS_ON_STACK];
    size_t size = rows * width * sizeof(double);
    double *room = size <= sizeof on_stack ? on_stack : PyMem_RawMalloc(size);
    int good = room && rows >= width &&
               decompose(buffers[0].buf, rows, width, room, buffers[1].buf, buffers[2].buf, buffers[3].buf);
    if (room != on_stack)
        PyMem_RawFree(room);
    release_arrays(buffers, 4);
    return PyBool_FromLong(good);
}
