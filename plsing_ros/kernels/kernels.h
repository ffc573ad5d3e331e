/* The arithmetic of every cycle, without the cost of a call into numpy for each operation.
 *
 * Each file has a topic; the Python file of the same name says what its functions do, and has twins of them made of
 * numpy, which run where nothing was compiled and which the tests compare these with. Arrays come and go through the
 * buffer protocol, C-contiguous and float64, so that nothing of numpy is needed to compile this; the caller answers for
 * their shapes, and their lengths are checked here.
 */

#ifndef PLSING_KERNELS_H
#define PLSING_KERNELS_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>

#define MOST_COLUMNS 6

/* buffers.c */

/* Return the number of rows of the first array, given its columns, or -1 with an exception set.
 *
 * The arrays have `columns` times that many elements each; negative numbers are lengths that do not depend on it. The
 * last `written` of them are written to.
 */
Py_ssize_t take_arrays(PyObject *const *objects, const int *columns, int count, int written, Py_buffer *buffers);
void release_arrays(Py_buffer *buffers, int count);
/* Return whether that many arguments were given, or 0 with an exception set. */
int are_arguments(Py_ssize_t given, Py_ssize_t expected);

/* lines.c */

/* Return the largest magnitude of three numbers. */
double largest_element(const double *vector);

/* singular_values.c */

/* Decompose `matrix` (m, k); `room` has space for as many numbers. Return whether it and its factors are finite. */
int decompose(const double *matrix, Py_ssize_t m, int k, double *room, double *left, double *values, double *right);

/* What Python calls, listed in compiled.c. */

#define FUNCTION(name) PyObject *name(PyObject *self, PyObject *const *args, Py_ssize_t count)
FUNCTION(are_image_lines);
FUNCTION(are_lines);
FUNCTION(have_images);
FUNCTION(interaction_matrix);
FUNCTION(is_rotation);
FUNCTION(svd);

#endif
