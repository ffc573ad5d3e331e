/* Eigenvalues of small matrices, as roots of polynomials. */

#include "kernels.h"

#include <float.h>
#include <math.h>

#define MOST_STEPS 60
#define PATIENCE 15

/* The eigenvalues of the 2 x 2 block that ends at `last`. */
static void block_eigenvalues(const double *h, int n, int last, double *real, double *imaginary)
{
    const double *upper = h + (last - 1) * n + last - 1, *lower = upper + n;
    double half = 0.5 * (upper[0] - lower[1]), product = upper[1] * lower[0], square = half * half + product;
    double root = sqrt(fabs(square)), *x = real + last - 1, *y = imaginary + last - 1;
    if (square >= 0.0) {
        /* The second by their product, as their difference would cancel. */
        double larger = half + copysign(root, half);
        x[0] = lower[1] + larger;
        x[1] = larger == 0.0 ? x[0] : lower[1] - product / larger;
        y[0] = y[1] = 0.0;
    } else {
        x[0] = x[1] = lower[1] + half;
        y[0] = root;
        y[1] = -root;
    }
}

/* One of Francis' steps on the rows and columns from `first` to `last`; its two shifts are the eigenvalues of a matrix
 * with this diagonal and this product of the other two elements. */
static void step(double *h, int n, int first, int last, const double *diagonal, double product)
{
#define H(i, j) h[(i) * n + (j)]
    double r = diagonal[0] - H(first, first), s = diagonal[1] - H(first, first);
    double v[3] = {(r * s - product) / H(first + 1, first) + H(first, first + 1),
                   H(first + 1, first + 1) - H(first, first) - r - s, H(first + 2, first + 1)};
    for (int k = first; k < last; k++) {
        int size = last - k >= 2 ? 3 : 2;
        double largest = fmax(fmax(fabs(v[0]), fabs(v[1])), size == 3 ? fabs(v[2]) : 0.0), square = 0.0;
        for (int i = 0; i < size && largest > 0.0; i++) {
            v[i] /= largest;
            square += v[i] * v[i];
        }
        if (square > 0.0) {
            v[0] += copysign(sqrt(square), v[0]);
            square = v[0] * v[0] + v[1] * v[1] + (size == 3 ? v[2] * v[2] : 0.0);
            for (int j = k > first ? k - 1 : k; j <= last; j++) {
                double along = 0.0;
                for (int i = 0; i < size; i++)
                    along += v[i] * H(k + i, j);
                for (int i = 0; i < size; i++)
                    H(k + i, j) -= 2.0 * along / square * v[i];
            }
            for (int i = first; i <= (k + 3 < last ? k + 3 : last); i++) {
                double along = 0.0;
                for (int j = 0; j < size; j++)
                    along += v[j] * H(i, k + j);
                for (int j = 0; j < size; j++)
                    H(i, k + j) -= 2.0 * along / square * v[j];
            }
        }
        for (int i = 0; i < 3 && k + 1 + i <= last; i++)
            v[i] = H(k + 1 + i, k);
    }
#undef H
}

int hessenberg_eigenvalues(double *h, int n, double *real, double *imaginary)
{
    int last = n - 1, steps = 0;
    double size = 0.0;
    for (int i = 0; i < n * n; i++)
        size = fmax(size, fabs(h[i]));
    while (last >= 0) {
        int first = last;
        for (; first > 0; first--) {
            double *below = h + first * n + first - 1;
            double near = fabs(below[-n]) + fabs(below[1]);
            /* Multiple eigenvalues may not come nearer to each other than rounding of the whole matrix allows. */
            if (fabs(*below) <= DBL_EPSILON * (steps < PATIENCE ? near : near + size)) {
                *below = 0.0;
                break;
            }
        }
        if (first + 1 >= last) {
            if (first == last) {
                real[last] = h[last * n + last];
                imaginary[last] = 0.0;
            } else
                block_eigenvalues(h, n, last, real, imaginary);
            last = first - 1;
            steps = 0;
            continue;
        }
        if (++steps > MOST_STEPS)
            return 0;
        const double *upper = h + (last - 1) * n + last - 1, *lower = upper + n;
        double diagonal[2] = {upper[0], lower[1]}, product = upper[1] * lower[0];
        double half = 0.5 * (upper[0] - lower[1]), square = half * half + product;
        if (steps % 10 == 0) {
            /* Other shifts, where the usual ones go round in circles. */
            double shift = fabs(lower[0]) + fabs(upper[-1]);
            diagonal[0] = diagonal[1] = 0.75 * shift;
            product = -0.4375 * shift * shift;
        } else if (square >= 0.0) {
            /* Of two real shifts the nearer one, twice: both at once would go nowhere where each is a double root. */
            double larger = half + copysign(sqrt(square), half);
            diagonal[0] = diagonal[1] = larger == 0.0 ? lower[1] : lower[1] - product / larger;
            product = 0.0;
        }
        step(h, n, first, last, diagonal, product);
    }
    return 1;
}
