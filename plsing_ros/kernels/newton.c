/* Newton's method on A(h) k = 0 for four lines. */

#include "kernels.h"

#include <math.h>
#include <string.h>

#define EQUATIONS 8
#define UNKNOWNS 10

/* Solve a system in place, by Gaussian elimination with partial pivoting; return whether no pivot is zero. */
static int solve_in_place(Complex matrix[UNKNOWNS][UNKNOWNS + 1])
{
    for (int c = 0; c < UNKNOWNS; c++) {
        int pivot = c;
        for (int i = c + 1; i < UNKNOWNS; i++)
            if (square(matrix[i][c]) > square(matrix[pivot][c]))
                pivot = i;
        double size = square(matrix[pivot][c]);
        if (size == 0.0)
            return 0;
        Complex inverse = {matrix[pivot][c].re / size, -matrix[pivot][c].im / size};
        for (int j = c; j <= UNKNOWNS; j++) {
            Complex element = matrix[pivot][j];
            matrix[pivot][j] = matrix[c][j];
            matrix[c][j] = times(element, inverse);
        }
        for (int i = c + 1; i < UNKNOWNS; i++) {
            Complex factor = matrix[i][c];
            for (int j = c + 1; j <= UNKNOWNS; j++) {
                Complex product = times(factor, matrix[c][j]);
                matrix[i][j].re -= product.re, matrix[i][j].im -= product.im;
            }
        }
    }
    for (int c = UNKNOWNS - 1; c > 0; c--)
        for (int i = 0; i < c; i++) {
            Complex product = times(matrix[i][c], matrix[c][UNKNOWNS]);
            matrix[i][UNKNOWNS].re -= product.re, matrix[i][UNKNOWNS].im -= product.im;
        }
    return 1;
}

/* Fill the equations' Jacobian at (h, k), with rows that keep both lengths, and their values beside it; return the
 * sum of squares of the values. */
static double equations(const Complex *tensor, const Complex *h, const Complex *k,
                        Complex system[UNKNOWNS][UNKNOWNS + 1])
{
    double total = 0.0;
    memset(system, 0, UNKNOWNS * (UNKNOWNS + 1) * sizeof(Complex));
    for (int i = 0; i < EQUATIONS; i++) {
        Complex *row = system[i], *value = row + UNKNOWNS;
        for (int a = 0; a < 4; a++) {
            const Complex *part = tensor + (a * EQUATIONS + i) * 6;
            for (int j = 0; j < 6; j++) {
                Complex of_h = times(part[j], k[j]), of_k = times(part[j], h[a]);
                row[a].re += of_h.re, row[a].im += of_h.im;
                row[4 + j].re += of_k.re, row[4 + j].im += of_k.im;
            }
            Complex term = times(row[a], h[a]);
            value->re += term.re, value->im += term.im;
        }
        total += square(*value);
    }
    for (int a = 0; a < 4; a++)
        system[EQUATIONS][a] = (Complex){h[a].re, -h[a].im};
    for (int j = 0; j < 6; j++)
        system[EQUATIONS + 1][4 + j] = (Complex){k[j].re, -k[j].im};
    return total;
}

/* Move a unit vector by minus a step and back to unit length. */
static void step_back(Complex *vector, Complex system[UNKNOWNS][UNKNOWNS + 1], int first, int n)
{
    double total = 0.0;
    for (int i = 0; i < n; i++) {
        vector[i].re -= system[first + i][UNKNOWNS].re;
        vector[i].im -= system[first + i][UNKNOWNS].im;
        total += square(vector[i]);
    }
    for (int i = 0; i < n; i++)
        vector[i].re /= sqrt(total), vector[i].im /= sqrt(total);
}

PyObject *bilinear_newton(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    static const struct signature expected = {3, 2, 4, {2 * 4 * EQUATIONS * 6, 2 * 4, 2 * 6}};
    struct arguments given;
    (void)self;
    if (!take_arguments(args, count, &expected, &given))
        return NULL;
    const double steps = given.number[0], enough = given.number[1], small = given.number[2], longest = given.number[3];
    Py_ssize_t starts = given.rows;
    const Complex *tensor = given.array[0];
    Complex *h = given.array[1], *k = given.array[2], system[UNKNOWNS][UNKNOWNS + 1];
    int good = 1;
    for (Py_ssize_t i = 0; i < starts && good; i++, tensor += 4 * EQUATIONS * 6, h += 4, k += 6)
        for (int step = 0; step < steps && good; step++) {
            double left = equations(tensor, h, k, system), size = 0.0;
            good = solve_in_place(system);
            for (int j = 0; j < UNKNOWNS; j++)
                size += square(system[j][UNKNOWNS]);
            /* Where the Jacobian is numerically singular the step is huge or undefined and says nothing: stay. */
            if (!good || !(size < longest * longest))
                break;
            step_back(h, system, 0, 4);
            step_back(k, system, 4, 6);
            if (left <= enough * enough || size <= small * small)
                break;
        }
    release_arguments(&given);
    return PyBool_FromLong(good);
}
