/* The arithmetic of a control step, without the cost of a call into numpy for each operation.
 *
 * kernels.py says what the functions do, and has twins of them made of numpy, which run where this file is not
 * compiled and which the tests compare it with. Arrays come and go through the buffer protocol, C-contiguous and
 * float64, so that nothing of numpy is needed to compile this; the caller answers for their shapes, and their lengths
 * are checked here. The singular value decomposition is LAPACK's, which SciPy exports to compiled code.
 */

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <string.h>

typedef void dgesdd_type(char *, int *, int *, double *, int *, double *, double *, int *, double *, int *, double *,
                         int *, int *, int *);
static dgesdd_type *dgesdd;

/* LAPACK's least is 186 for a matrix of six rows; this is enough for its blocked algorithms. */
#define WORK 1024
#define MOST_COLUMNS 6
#define ROWS_ON_STACK 128
#define MOST_ROWS 1000000

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
    const double *matrix = buffers[0].buf;
    double on_stack[MOST_COLUMNS * ROWS_ON_STACK], work[WORK], not_finite = 0.0;
    size_t size = rows * width * sizeof(double);
    double *copy = size <= sizeof on_stack ? on_stack : PyMem_RawMalloc(size);
    int integers[8 * MOST_COLUMNS], m = (int)rows, length = WORK, info = -1;
    /* LAPACK does not return from a matrix with infinite elements. */
    for (Py_ssize_t i = 0; i < rows * width; i++)
        not_finite += 0.0 * matrix[i];
    if (copy && rows >= width && not_finite == 0.0) {
        memcpy(copy, matrix, size);
        /* Row after row, it is the transpose to Fortran, whose left singular vectors are our right ones. */
        dgesdd("S", &width, &m, copy, &width, buffers[2].buf, buffers[3].buf, &width, buffers[1].buf, &width, work,
               &length, integers, &info);
    }
    if (copy != on_stack)
        PyMem_RawFree(copy);
    release(buffers, 4);
    return PyBool_FromLong(info == 0);
}

#define METHOD(name) {#name, (PyCFunction)(void (*)(void))name, METH_FASTCALL, "See kernels.py."}
static PyMethodDef methods[] = {METHOD(are_lines),   METHOD(are_image_lines),    METHOD(have_images),
                                METHOD(is_rotation), METHOD(interaction_matrix), METHOD(svd),
                                {NULL, NULL, 0, NULL}};
static struct PyModuleDef module = {.m_base = PyModuleDef_HEAD_INIT, .m_name = "_kernels", .m_methods = methods};

/* Return what scipy.linalg.cython_lapack exports, if its type, which names the capsule, is the one expected here. */
static void *lapack(const char *function, const char *integer_type)
{
    PyObject *scipy = PyImport_ImportModule("scipy.linalg.cython_lapack");
    PyObject *exported = scipy ? PyObject_GetAttrString(scipy, "__pyx_capi__") : NULL;
    PyObject *capsule = exported ? PyMapping_GetItemString(exported, function) : NULL;
    const char *name = capsule ? PyCapsule_GetName(capsule) : NULL;
    void *address = name ? PyCapsule_GetPointer(capsule, name) : NULL;
    if (address && strstr(name, integer_type) == NULL) {
        PyErr_Format(PyExc_ImportError, "this SciPy's LAPACK has other integers: %s", name);
        address = NULL;
    }
    Py_XDECREF(capsule);
    Py_XDECREF(exported);
    Py_XDECREF(scipy);
    return address;
}

PyMODINIT_FUNC PyInit__kernels(void)
{
    dgesdd = (dgesdd_type *)lapack("dgesdd", "(char *, int *, int *, ");
    return dgesdd ? PyModule_Create(&module) : NULL;
}
