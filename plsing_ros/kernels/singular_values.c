/* The thin singular value decomposition of a matrix of few columns: Householder's QR with pivots, then Jacobi's
 * one-sided rotations of the triangular factor. */

#include "kernels.h"

#include <math.h>
#include <string.h>

#define MOST_SWEEPS 60

/* Vectors have MOST_COLUMNS elements, the last ones zero for a matrix of fewer columns, so that these loops become a
 * few instructions each. */
static double dot(const double *a, const double *b)
{
    double even = 0.0, odd = 0.0;
    for (int i = 0; i < MOST_COLUMNS; i += 2) {
        even += a[i] * b[i];
        odd += a[i + 1] * b[i + 1];
    }
    return even + odd;
}

static void subtract_multiple(double *a, double factor, const double *b)
{
    for (int i = 0; i < MOST_COLUMNS; i++)
        a[i] -= factor * b[i];
}

/* (a, b) <- (c a - s b, s a + c b) */
static void rotate(double *restrict a, double *restrict b, double c, double s)
{
    for (int i = 0; i < 2 * MOST_COLUMNS; i++) {
        double x = a[i], y = b[i];
        a[i] = c * x - s * y;
        b[i] = s * x + c * y;
    }
}

/* Multiply `x` (m, width) by 1 - beta v v' from the left. */
static inline void reflect(const double *restrict v, double beta, double *restrict x, int width, Py_ssize_t m)
{
    double products[MOST_COLUMNS] = {0.0};
    for (Py_ssize_t i = 0; i < m; i++)
        for (int j = 0; j < width; j++)
            products[j] += v[i] * x[i * width + j];
    for (int j = 0; j < width; j++)
        products[j] *= beta;
    for (Py_ssize_t i = 0; i < m; i++)
        for (int j = 0; j < width; j++)
            x[i * width + j] -= v[i] * products[j];
}

/* Reflect `x` (m, MOST_COLUMNS) until it is triangular but for the order of its columns; note the reflections, and the
 * triangular factor in the first half of `rows`.
 *
 * With the longest column first, Jacobi's rotations have a third less to do. */
static void triangularise(double *x, struct decomposition *d)
{
    double squares[MOST_COLUMNS] = {0.0};
    int done[MOST_COLUMNS] = {0};
    for (Py_ssize_t i = 0; i < d->m; i++)
        for (int j = 0; j < MOST_COLUMNS; j++)
            squares[j] += x[i * MOST_COLUMNS + j] * x[i * MOST_COLUMNS + j];
    for (int c = 0; c < d->k; c++) {
        int pivot = -1;
        for (int j = 0; j < d->k; j++)
            if (!done[j] && (pivot < 0 || squares[j] > squares[pivot]))
                pivot = j;
        done[pivot] = 1;
        Py_ssize_t length = d->m - c;
        double *top = x + c * MOST_COLUMNS, *v = d->vectors + c * d->m, square = 0.0;
        for (Py_ssize_t i = 0; i < length; i++) {
            v[i] = top[i * MOST_COLUMNS + pivot];
            square += v[i] * v[i];
        }
        /* A column that is as good as zero is left as it is. */
        int nothing = square < NOTHING;
        double diagonal = nothing ? v[0] : -copysign(sqrt(square), v[0]);
        v[0] -= diagonal;
        d->beta[c] = nothing ? 0.0 : -1.0 / (diagonal * v[0]);
        reflect(v, d->beta[c], top, MOST_COLUMNS, length);
        for (int j = 0; j < MOST_COLUMNS; j++) {
            d->rows[c][j] = j == pivot ? diagonal : done[j] ? 0.0 : top[j];
            /* Inexact, but nothing depends on it except the order of columns. */
            squares[j] -= top[j] * top[j];
        }
    }
}

static void exchange(double *restrict a, double *restrict b)
{
    for (int i = 0; i < 2 * MOST_COLUMNS; i++) {
        double x = a[i];
        a[i] = b[i];
        b[i] = x;
    }
}

/* Rotate the `rows` until their first halves are orthogonal, the longest first, and return whether that succeeded;
 * `squares` become those of their lengths.
 *
 * One-sided Jacobi: it leaves no singular value with a larger error than the triangular factor itself has. */
static int orthogonalise(double rows[][2 * MOST_COLUMNS], double *squares, int k)
{
    for (int sweep = 0; sweep < MOST_SWEEPS; sweep++) {
        int done = 1;
        for (int p = 0; p < k; p++)
            squares[p] = dot(rows[p], rows[p]);
        for (int p = 0; p < k - 1; p++)
            for (int q = p + 1; q < k; q++) {
                double aa = squares[p], bb = squares[q];
                if (aa < bb) {
                    aa = squares[q];
                    bb = squares[p];
                    exchange(rows[p], rows[q]);
                    done = 0;
                }
                double ab = dot(rows[p], rows[q]), tangent = 0.0;
                if (ab * ab > 1e-31 * aa * bb && bb >= NOTHING) {
                    double zeta = (bb - aa) / (2.0 * ab);
                    tangent = copysign(1.0, zeta) / (fabs(zeta) + sqrt(1.0 + zeta * zeta));
                    double cosine = 1.0 / sqrt(1.0 + tangent * tangent);
                    rotate(rows[p], rows[q], cosine, cosine * tangent);
                    done = 0;
                }
                squares[p] = aa - tangent * ab;
                squares[q] = bb + tangent * ab;
            }
        if (done)
            return 1;
    }
    return 0;
}

/* Make the first half of row `which`, the others being orthonormal, a unit vector orthogonal to those before it. */
static void complete(double rows[][2 * MOST_COLUMNS], int which, int k)
{
    double best = 0.0;
    for (int axis = 0; axis < k; axis++) {
        double candidate[MOST_COLUMNS] = {0.0};
        candidate[axis] = 1.0;
        /* Twice, because the first time leaves rounding errors. */
        for (int j = 0; j < 2 * which; j++) {
            const double *other = rows[j % which];
            subtract_multiple(candidate, dot(other, candidate), other);
        }
        double norm = sqrt(dot(candidate, candidate));
        if (norm > best) {
            best = norm;
            for (int i = 0; i < MOST_COLUMNS; i++)
                rows[which][i] = candidate[i] / norm;
        }
    }
}

/* LAPACK's dgesdd takes more than twice as long for four lines, most of it before the first multiplication. */
int decompose(const double *matrix, Py_ssize_t m, int k, struct decomposition *d, double *values, double *right)
{
    double size = 0.0, not_finite = 0.0;
    for (Py_ssize_t i = 0; i < m * k; i++) {
        double magnitude = fabs(matrix[i]);
        size = magnitude > size ? magnitude : size;
        not_finite += 0.0 * magnitude;
    }
    d->room = m > ROWS_ON_STACK ? PyMem_RawMalloc(2 * MOST_COLUMNS * m * sizeof(double)) : d->on_stack;
    if (!d->room)
        PyErr_NoMemory();
    if (m < k || not_finite != 0.0 || !d->room)
        return 0;
    /* Squares neither over- nor underflow: the largest element becomes about one, without rounding. */
    int exponent = 0;
    frexp(size, &exponent);
    exponent = exponent < -1000 ? -1000 : exponent;
    double scale = ldexp(1.0, -exponent), *x = d->room, squares[MOST_COLUMNS];
    for (Py_ssize_t i = 0; i < m; i++)
        for (int j = 0; j < MOST_COLUMNS; j++)
            x[i * MOST_COLUMNS + j] = j < k ? matrix[i * k + j] * scale : 0.0;
    d->m = m;
    d->k = k;
    d->vectors = x + m * MOST_COLUMNS;
    triangularise(x, d);
    for (int i = 0; i < k; i++)
        for (int j = 0; j < MOST_COLUMNS; j++)
            d->rows[i][MOST_COLUMNS + j] = i == j;
    if (!orthogonalise(d->rows, squares, k))
        return 0;
    for (int j = 0; j < k; j++) {
        double norm = sqrt(squares[j]);
        values[j] = ldexp(norm, exponent);
        if (squares[j] < NOTHING)
            complete(d->rows, j, k);
        else
            for (int i = 0; i < k; i++)
                d->rows[j][i] /= norm;
        for (int i = 0; i < k; i++)
            right[j * k + i] = d->rows[j][i];
    }
    return isfinite(values[0]);
}

void release_decomposition(struct decomposition *d)
{
    if (d->room != d->on_stack)
        PyMem_RawFree(d->room);
}

void left_vectors(const struct decomposition *d, double *left)
{
    int k = d->k;
    for (Py_ssize_t i = 0; i < d->m; i++)
        for (int j = 0; j < k; j++)
            left[i * k + j] = i < k ? d->rows[j][MOST_COLUMNS + i] : 0.0;
    for (int c = k - 1; c >= 0; c--) {
        const double *v = d->vectors + c * d->m;
        if (k == MOST_COLUMNS)
            reflect(v, d->beta[c], left + c * MOST_COLUMNS, MOST_COLUMNS, d->m - c);
        else
            reflect(v, d->beta[c], left + c * k, k, d->m - c);
    }
}

void along_left_vectors(struct decomposition *d, const double *vector, double *components)
{
    double *reflected = d->room;
    memcpy(reflected, vector, d->m * sizeof(double));
    for (int c = 0; c < d->k; c++)
        reflect(d->vectors + c * d->m, d->beta[c], reflected + c, 1, d->m - c);
    for (int j = 0; j < d->k; j++) {
        components[j] = 0.0;
        for (int i = 0; i < d->k; i++)
            components[j] += d->rows[j][MOST_COLUMNS + i] * reflected[i];
    }
}

PyObject *svd(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    struct arguments given;
    (void)self;
    int k = are_arguments(count, 4) ? count_columns(args[2]) : -1;
    const struct signature expected = {4, 3, 0, {k, k, -k, -k * k}};
    if (k < 0 || !take_arguments(args, count, &expected, &given))
        return NULL;
    struct decomposition d;
    int good = decompose(given.array[0], given.rows, k, &d, given.array[2], given.array[3]);
    if (good)
        left_vectors(&d, given.array[1]);
    release_decomposition(&d);
    release_arguments(&given);
    return truth(good);
}

PyObject *interaction_svd(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const struct signature expected = {5, 3, 1, {3, 3, 18, -6, -36}};
    struct arguments given;
    (void)self;
    if (!take_arguments(args, count, &expected, &given))
        return NULL;
    Py_ssize_t n = given.rows;
    double *left = given.array[2];
    int good = n > 1 && fill_interaction_matrix(given.array[0], given.array[1], n, given.number[0], left);
    if (good) {
        struct decomposition d;
        good = decompose(left, 3 * n, 6, &d, given.array[3], given.array[4]);
        if (good)
            left_vectors(&d, left);
        release_decomposition(&d);
    }
    release_arguments(&given);
    return truth(good);
}
