/* What is orthogonal to the columns of a matrix, by Householder's reflections. */

#include "kernels.h"

#include <math.h>
#include <string.h>

void reflect_to_triangle(double *x, Py_ssize_t m, int k, double *beta, double *diagonal)
{
    for (int c = 0; c < k; c++) {
        double *v = x + c * m + c;
        Py_ssize_t length = m - c;
        double size = dot_product(v, v, length);
        /* A column that is as good as zero is left as it is. */
        int nothing = size < NOTHING;
        diagonal[c] = nothing ? v[0] : -copysign(sqrt(size), v[0]);
        v[0] -= diagonal[c];
        beta[c] = nothing ? 0.0 : -1.0 / (diagonal[c] * v[0]);
        for (int j = c + 1; j < k; j++) {
            double *column = x + j * m + c;
            add_multiple(column, -beta[c] * dot_product(v, column, length), v, length);
        }
    }
}

void orthogonal_complement(const double *x, Py_ssize_t m, int k, const double *beta, double *rows)
{
    memset(rows, 0, (size_t)(m - k) * m * sizeof(double));
    for (Py_ssize_t j = k; j < m; j++, rows += m) {
        rows[j] = 1.0;
        for (int c = k - 1; c >= 0; c--)
            add_multiple(rows + c, -beta[c] * dot_product(x + c * m + c, rows + c, m - c), x + c * m + c, m - c);
    }
}
