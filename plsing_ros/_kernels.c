/* The arithmetic of a control step, without the cost of a call into numpy for each operation.
 *
 * kernels.py says what the functions do, and has twins of them made of numpy, which run where this file is not
 * compiled and which the tests compare it with. Arrays come and go through the buffer protocol, C-contiguous and
 * float64, so that nothing of numpy is needed to compile this; the caller answers for their shapes, and their lengths
 * are checked here.
 */

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <string.h>

#define MOST_COLUMNS 6
#define ROWS_ON_STACK 128
#define MOST_ROWS 1000000
#define MOST_SWEEPS 60
/* Squares below this, of rows of a matrix whose largest element is about one, are as good as zero: far below rounding,
 * far above where products of two of them underflow. */
#define NOTHING 1e-60

/* Return the number of rows of the first array, given its columns, or -1 with an exception set.
 *
 * The arrays have `columns` times that many elements each; negative numbers are lengths that do not depend on it. The
 * last `written` of them are written to.
 */
static Py_ssize_t take(PyObject *const *objects, const int *columns, int count, int written, Py_buffer *buffers)
{
    Py_ssize_t rows = 0;
    for (int i = 0; i < count; i++) {
        int flags = PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (i >= count - written ? PyBUF_WRITABLE : 0);
        if (PyObject_GetBuffer(objects[i], &buffers[i], flags) == 0) {
            Py_ssize_t length = buffers[i].len / (Py_ssize_t)sizeof(double);
            if (i == 0 && columns[0] > 0)
                rows = length / columns[0];
            if (strcmp(buffers[i].format, "d") == 0 && rows <= MOST_ROWS &&
                length == (columns[i] > 0 ? columns[i] * rows : -columns[i]))
                continue;
            PyBuffer_Release(&buffers[i]);
            PyErr_Format(PyExc_ValueError, "array %d is not float64 or of a wrong size", i);
        }
        while (i-- > 0)
            PyBuffer_Release(&buffers[i]);
        return -1;
    }
    return rows;
}

static void release(Py_buffer *buffers, int count)
{
    while (count-- > 0)
        PyBuffer_Release(&buffers[count]);
}

static int arguments(Py_ssize_t given, Py_ssize_t expected)
{
    if (given == expected)
        return 1;
    PyErr_Format(PyExc_TypeError, "%zd arguments given, %zd expected", given, expected);
    return 0;
}

static double largest(const double *vector)
{
    return fmax(fmax(fabs(vector[0]), fabs(vector[1])), fabs(vector[2]));
}

static PyObject *are_lines(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const int columns[] = {3, 3};
    Py_buffer buffers[2];
    (void)self;
    if (!arguments(count, 3))
        return NULL;
    double tolerance = PyFloat_AsDouble(args[2]);
    if (tolerance == -1.0 && PyErr_Occurred())
        return NULL;
    Py_ssize_t n = take(args, columns, 2, 0, buffers);
    if (n < 0)
        return NULL;
    const double *u = buffers[0].buf, *l = buffers[1].buf;
    int good = 1;
    /* Written so that a comparison with NaN fails. */
    for (; n > 0 && good; n--, u += 3, l += 3)
        good = fabs(u[0] * u[0] + u[1] * u[1] + u[2] * u[2] - 1.0) <= tolerance && isfinite(l[0]) && isfinite(l[1]) &&
               isfinite(l[2]) && fabs(u[0] * l[0] + u[1] * l[1] + u[2] * l[2]) <= tolerance * (1.0 + largest(l));
    release(buffers, 2);
    return PyBool_FromLong(good);
}

static PyObject *have_images(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const int columns[] = {3};
    Py_buffer buffers[1];
    (void)self;
    if (!arguments(count, 2))
        return NULL;
    double least_depth = PyFloat_AsDouble(args[1]);
    if (least_depth == -1.0 && PyErr_Occurred())
        return NULL;
    Py_ssize_t n = take(args, columns, 1, 0, buffers);
    if (n < 0)
        return NULL;
    const double *l = buffers[0].buf;
    int good = 1;
    for (; n > 0 && good; n--, l += 3)
        good = hypot(l[0], l[1]) >= least_depth * fmax(1.0, largest(l));
    release(buffers, 1);
    return PyBool_FromLong(good);
}

static PyObject *are_image_lines(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const int columns[] = {3};
    Py_buffer buffers[1];
    (void)self;
    if (!arguments(count, 2))
        return NULL;
    double tolerance = PyFloat_AsDouble(args[1]);
    if (tolerance == -1.0 && PyErr_Occurred())
        return NULL;
    Py_ssize_t n = take(args, columns, 1, 0, buffers);
    if (n < 0)
        return NULL;
    const double *s = buffers[0].buf;
    int good = 1;
    for (; n > 0 && good; n--, s += 3)
        good = fabs(hypot(s[0], s[1]) - 1.0) <= tolerance && isfinite(s[2]);
    release(buffers, 1);
    return PyBool_FromLong(good);
}

static PyObject *is_rotation(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const int columns[] = {-9};
    Py_buffer buffers[1];
    (void)self;
    if (!arguments(count, 2))
        return NULL;
    double tolerance = PyFloat_AsDouble(args[1]);
    if ((tolerance == -1.0 && PyErr_Occurred()) || take(args, columns, 1, 0, buffers) < 0)
        return NULL;
    const double *r = buffers[0].buf;
    int good = 1;
    for (int i = 0; i < 3; i++)
        for (int j = i; j < 3; j++) {
            double product = r[3 * i] * r[3 * j] + r[3 * i + 1] * r[3 * j + 1] + r[3 * i + 2] * r[3 * j + 2];
            good = good && fabs(product - (i == j)) <= tolerance;
        }
    good = good && r[0] * (r[4] * r[8] - r[5] * r[7]) - r[1] * (r[3] * r[8] - r[5] * r[6]) +
                           r[2] * (r[3] * r[7] - r[4] * r[6]) > 0.0;
    release(buffers, 1);
    return PyBool_FromLong(good);
}

static PyObject *interaction_matrix(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const int columns[] = {3, 3, 18};
    Py_buffer buffers[3];
    (void)self;
    if (!arguments(count, 4))
        return NULL;
    double least_depth = PyFloat_AsDouble(args[3]);
    if (least_depth == -1.0 && PyErr_Occurred())
        return NULL;
    Py_ssize_t n = take(args, columns, 3, 1, buffers);
    if (n < 0)
        return NULL;
    const double *u = buffers[0].buf, *l = buffers[1].buf;
    double *matrix = buffers[2].buf;
    int good = 1;
    for (; n > 0; n--, u += 3, l += 3, matrix += 18) {
        double depth = hypot(l[0], l[1]);
        good = depth >= least_depth * fmax(1.0, largest(l));
        if (!good)
            break;
        double x = l[0] / depth, y = l[1] / depth, z = l[2] / depth;
        double moment_rate[3][6] = {{0.0, -u[2], u[1], 0.0, -l[2], l[1]},
                                    {u[2], 0.0, -u[0], l[2], 0.0, -l[0]},
                                    {-u[1], u[0], 0.0, -l[1], l[0], 0.0}};
        for (int j = 0; j < 6; j++) {
            double depth_rate = x * moment_rate[0][j] + y * moment_rate[1][j];
            matrix[j] = (moment_rate[0][j] - x * depth_rate) / depth;
            matrix[6 + j] = (moment_rate[1][j] - y * depth_rate) / depth;
            matrix[12 + j] = (moment_rate[2][j] - z * depth_rate) / depth;
        }
    }
    release(buffers, 3);
    return PyBool_FromLong(good);
}

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

/* Decompose `matrix` (m, k); `x` has room for as many numbers. Return whether it and its factors are finite.
 *
 * For six columns, LAPACK's dgesdd takes two to four times as long, most of it before the first multiplication. */
static int decompose(const double *matrix, Py_ssize_t m, int k, double *x, double *left, double *values, double *right)
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

static PyObject *svd(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Py_buffer buffers[4];
    (void)self;
    if (!arguments(count, 4))
        return NULL;
    int width = (int)PyObject_Length(args[2]);
    if (width < 1 || width > MOST_COLUMNS) {
        if (!PyErr_Occurred())
            PyErr_SetString(PyExc_ValueError, "there must be 1 to 6 singular values");
        return NULL;
    }
    const int columns[] = {width, width, -width, -width * width};
    Py_ssize_t rows = take(args, columns, 4, 3, buffers);
    if (rows < 0)
        return NULL;
    double on_stack[MOST_COLUMNS * ROWS_ON_STACK];
    size_t size = rows * width * sizeof(double);
    double *room = size <= sizeof on_stack ? on_stack : PyMem_RawMalloc(size);
    int good = room && rows >= width &&
               decompose(buffers[0].buf, rows, width, room, buffers[1].buf, buffers[2].buf, buffers[3].buf);
    if (room != on_stack)
        PyMem_RawFree(room);
    release(buffers, 4);
    return PyBool_FromLong(good);
}

#define METHOD(name) {#name, (PyCFunction)(void (*)(void))name, METH_FASTCALL, "See kernels.py."}
static PyMethodDef methods[] = {METHOD(are_lines),   METHOD(are_image_lines),    METHOD(have_images),
                                METHOD(is_rotation), METHOD(interaction_matrix), METHOD(svd),
                                {NULL, NULL, 0, NULL}};
static struct PyModuleDef module = {.m_base = PyModuleDef_HEAD_INIT, .m_name = "_kernels", .m_methods = methods};

PyMODINIT_FUNC PyInit__kernels(void)
{
    return PyModule_Create(&module);
}
