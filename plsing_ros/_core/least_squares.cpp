// SPDX-License-Identifier: Apache-2.0
#include "least_squares.hpp"

#include <algorithm>
#include <cmath>

#include "core.hpp"
#include "jacobi.hpp"

namespace plsing {

// Flat, since for matrices this small calls cost a third of the time.
[[gnu::flatten]] Svd::Svd(const Eigen::Ref<const Tall> &matrix, bool with_left)
{
    const Index m = matrix.rows(), k = matrix.cols();
    rows_ = m;
    const double size = matrix.cwiseAbs().sum();
    if (!std::isfinite(size))
        return;
    // The elements become about one, without rounding, so that squares neither over- nor underflow.
    int exponent = 0;
    std::frexp(size, &exponent);
    exponent = std::max(exponent, -1000);
    const double scale = std::ldexp(1.0, -exponent);
    if (m >= k) {
        triangular_.compute(scale * matrix);
    } else {
        Tall padded = Tall::Zero(k, k);
        padded.topRows(m) = scale * matrix;
        triangular_.compute(padded);
    }
    const Small triangle = triangular_.matrixQR().topRows(k).triangularView<Eigen::Upper>();
    Matrix6d transposed = Matrix6d::Zero();
    transposed.topLeftCorner(k, k) = triangle.transpose();
    const JacobiSvd<max_unknowns> svd(transposed, with_left);
    values_ = svd.values.head(k).unaryExpr([exponent](double value) { return std::ldexp(value, exponent); });
    // Zero, not only to rounding.
    values_.tail(std::max(k - m, Index(0))).setZero();
    right_ = triangular_.colsPermutation() * svd.left.topLeftCorner(k, k);
    left_of_triangle_ = svd.right.topLeftCorner(k, k);
    finite_ = std::isfinite(values_(0));
}

Unknowns Svd::solve(const Unknowns &components, double threshold) const
{
    Unknowns along = components.cwiseQuotient(values_);
    along = (values_.array() > threshold * values_(0)).select(along, 0.0);
    return right_ * along;
}

}  // namespace plsing
