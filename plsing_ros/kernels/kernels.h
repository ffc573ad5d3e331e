/* The arithmetic of every cycle, without the cost of a call into numpy for each operation.
 *
 * Each file has a topic; the Python file of the same name says what its functions do, and has twins of them made of
 * numpy, which run where nothing was compiled and which the tests compare these with. Arrays come and go through the
 * buffer protocol, C-contiguous, float64 or complex128, so that nothing of numpy is needed to compile this; the caller
 * answers for their shapes, and their lengths are checked here.
 */

#ifndef PLSING_KERNELS_H
#define PLSING_KERNELS_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>

#define MOST_COLUMNS 6
#define ROWS_ON_STACK 128
/* Squares below this, of rows of a matrix whose largest element is about one, are as good as zero: far below rounding,
 * far above where products of two of them underflow. */
#define NOTHING 1e-60
/* Four lines, and the monomials of two degrees in three variables. */
#define LINES 4
#define CUBICS 10
#define QUARTICS 15
/* Singular values up to this times the largest are zero to working precision. */
#define SINGULAR 2.2e-16

/* buffers.c */

#define MOST_ARRAYS 10
#define MOST_NUMBERS 4

/* What a function takes: arrays, of which the last are written to, then numbers.
 *
 * The arrays have `columns` elements for each of the rows, whose number is that of the first array with any; negative
 * columns are lengths that do not depend on it. A complex number counts as two.
 */
struct signature {
    int arrays, written, numbers, columns[MOST_ARRAYS];
};

struct arguments {
    void *array[MOST_ARRAYS];
    double number[MOST_NUMBERS];
    Py_ssize_t rows;
    Py_buffer buffers[MOST_ARRAYS];
    int arrays;
};

/* Return whether the arguments are as expected, or 0 with an exception set and nothing to release. */
int take_arguments(PyObject *const *args, Py_ssize_t count, const struct signature *expected, struct arguments *given);
void release_arguments(struct arguments *given);
/* Return whether that many arguments were given, or 0 with an exception set. */
int are_arguments(Py_ssize_t given, Py_ssize_t expected);
/* Return a truth value, or NULL if an exception was set. */
PyObject *truth(int value);
/* Return the length of an array that has an element for each column of a matrix, or -1 with an exception set. */
int count_columns(PyObject *array);
/* Return the number of rows of an array, or -1 with an exception set. */
int count_rows(PyObject *array);
/* Likewise, if there must be one for each line and at least one line. */
int count_lines(PyObject *array);

/* vectors of any length */

static inline double dot_product(const double *a, const double *b, Py_ssize_t n)
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

static inline void add_multiple(double *a, double factor, const double *b, Py_ssize_t n)
{
    for (Py_ssize_t i = 0; i < n; i++)
        a[i] += factor * b[i];
}

/* vectors of three, and matrices (3, 3) */

static inline double dot3(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void cross3(const double *a, const double *b, double *c)
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

static inline void times3(const double *matrix, const double *v, double *result)
{
    for (int i = 0; i < 3; i++)
        result[i] = dot3(matrix + 3 * i, v);
}

static inline double determinant3(const double *m)
{
    return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) + m[2] * (m[3] * m[7] - m[4] * m[6]);
}

/* complex numbers */

typedef struct {
    double re, im;
} Complex;

static inline Complex times(Complex a, Complex b)
{
    return (Complex){a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
}

static inline double square(Complex a)
{
    return a.re * a.re + a.im * a.im;
}

/* complements.c */

/* Overwrite the rows `x` of a matrix's transpose (k, m) by Householder vectors, whose factors are `beta`, and return
 * the diagonal of the triangular factor. */
void reflect_to_triangle(double *x, Py_ssize_t m, int k, double *beta, double *diagonal);
/* Fill `rows` (m - k, m) with an orthonormal basis of what is orthogonal to the columns of a matrix (m, k), given what
 * reflect_to_triangle made of it. */
void orthogonal_complement(const double *x, Py_ssize_t m, int k, const double *beta, double *rows);

/* lines.c */

/* Fill the image of a line of this moment in the camera frame, of use only if it has one, and return |(l_x, l_y)|. */
static inline double image_line(const double *moment, double *image)
{
    double depth = hypot(moment[0], moment[1]);
    for (int i = 0; i < 3; i++)
        image[i] = moment[i] / depth;
    return depth;
}

/* Return whether a line of this moment and this |(l_x, l_y)| has an image. */
int has_image(const double *moment, double depth, double least_depth);

/* interaction.c */

/* Fill `matrix` (3n, 6) of n lines (u, l), and return whether all have an image. */
int fill_interaction_matrix(const double *u, const double *l, Py_ssize_t n, double least_depth, double *matrix);

/* least_squares.c */

/* Fill the decomposition of `matrix` (m, k), and `factor` times: `components` (k) along the left singular vectors, and
 * the `solution` (k) of least squares. Return whether the matrix and its factors are finite; without memory, 0 with an
 * exception set. */
int solved(const double *matrix, const double *right_side, Py_ssize_t m, int k, double factor, double threshold,
           double *values, double *right, double *components, double *solution);

/* singular_values.c */

/* The thin singular value decomposition of a matrix (m, k), its left singular vectors as a product of reflections. */
struct decomposition {
    Py_ssize_t m;
    int k;
    double beta[MOST_COLUMNS];
    double rows[MOST_COLUMNS][2 * MOST_COLUMNS]; /* right singular vectors, then left ones of the triangular factor */
    double *vectors;                             /* of the reflections */
    double *room, on_stack[2 * MOST_COLUMNS * ROWS_ON_STACK];
};

/* Fill `values` (k) and `right` (k, k), and return whether the matrix and they are finite; without memory, 0 with an
 * exception set. Then, or else, release. */
int decompose(const double *matrix, Py_ssize_t m, int k, struct decomposition *d, double *values, double *right);
void release_decomposition(struct decomposition *d);
/* Fill `left` (m, k). */
void left_vectors(const struct decomposition *d, double *left);
/* Fill `components` (k) with the transpose of `left` times `vector` (m). */
void along_left_vectors(struct decomposition *d, const double *vector, double *components);

/* residuals.c */

/* Numbers that kernels.image_residuals says of a line at a pose. */
#define RESIDUAL_ROWS 15

/* An image of known lines. Variances: of the image, of the lines in the scene and in the camera frame. */
struct image {
    const double *lines; /* (count, 6): directions and moments in the world */
    const double *seen;  /* (count, 3) */
    Py_ssize_t count;
    double noise, scene, camera, least_cosine;
    struct residual *room; /* for 2 count residuals */
    struct arguments given;
};

/* A line at a pose; kernels/residuals.py has the names. */
struct residual {
    double raw[2], whitening[3], p[3], s, vz, determinant;
    int reversed, hidden;
};

/* Columns of the first three arguments: n lines, their image, and its settings. */
#define IMAGE(n) -6 * (n), -3 * (n), -4
/* Take arguments that begin with these; return 0 with an exception set, and nothing to release, if they do not fit. */
int take_image(PyObject *const *args, Py_ssize_t count, const struct signature *expected, struct image *image);
void release_image(struct image *image);
/* Fill the residuals of all lines at a pose T_camera_world. */
void residuals_at(const struct image *image, const double *rotation, const double *translation, struct residual *lines);
/* Turn an angle and an offset into uncorrelated numbers in standard deviations. */
void whiten(const double *whitening, const double *raw, double *value);
/* Fill the derivatives of angle and offset by the camera's twist. */
void jacobian_of(const struct residual *line, double rows[2][6]);

/* refinement.c */

/* Solve a x = b, n <= 6, by elimination; a and b are overwritten, b by x. Return 0 if a is singular to the last bit. */
int eliminate(double *a, double *b, int n);
/* Move a camera by a motion (v, w) in its frame: the scene moves by the inverse. The rotation is Cayley's. */
void move(const double *motion, const double *rotation, const double *translation, double *new_rotation,
          double *new_translation);
/* The sum of squares of residuals, by the measure of others. Weights of lines, 0 or 1, here and below: NULL for 1. */
double misfit(const struct residual *lines, const struct residual *measure, const double *weight, Py_ssize_t count);
/* Refine one pose in place; return whether it is at a minimum, and the gain of the last step. */
int refine(const struct image *image, const double *weight, long iterations, double *rotation, double *translation,
           double *gain);

/* eigenvalues.c */

/* Find the eigenvalues of an upper Hessenberg matrix (n, n), which is overwritten. Return whether all were found. */
int hessenberg_eigenvalues(double *matrix, int n, double *real, double *imaginary);

/* What Python calls: X(name) for each. */

#define KERNELS(X)                                                                                               \
    X(align) X(approach) X(are_image_lines) X(are_lines) X(axis_centers) X(bilinear_newton) X(distances)         \
    X(have_images) X(image_deviation) X(image_jacobians) X(image_residuals) X(interaction_matrix)                \
    X(interaction_svd) X(is_rotation)                                                                            \
    X(law_step) X(least_cosine) X(lines_seen) X(mean_interaction) X(plain_law) X(pose_uncertainty)               \
    X(quartic_functionals) X(refine_poses) X(scene_coordinates) X(search_poses) X(singularity_ratios) X(solve)   \
    X(subtract) X(svd) X(translations) X(triplet_rotations) X(with_conjugates)
#define DECLARE(name) PyObject *name(PyObject *self, PyObject *const *args, Py_ssize_t count);
KERNELS(DECLARE)

#endif
