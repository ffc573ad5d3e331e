// SPDX-License-Identifier: Apache-2.0
// Least squares with up to six unknowns, by the singular value decomposition.
#pragma once

#include <Eigen/Core>
#include <Eigen/QR>

namespace plsing {

constexpr int max_unknowns = 6;
// Singular values up to this times the largest are zero to working precision.
constexpr double rounding = 2.2e-16;

using Small = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, max_unknowns, max_unknowns>;
using Unknowns = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, max_unknowns, 1>;
using Tall = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, Eigen::Dynamic, max_unknowns>;

// The singular value decomposition of a matrix (m, k), k <= 6: a QR decomposition with pivots, and Jacobi's rotations of
// its triangular factor. With m < k the missing singular values are zero.
class Svd {
public:
    // Without `with_left` only values and right vectors are of use, which saves a part of the time.
    explicit Svd(const Eigen::Ref<const Tall> &matrix, bool with_left = true);

    // Whether the matrix and its singular values are finite; if not, nothing else is of use.
    bool is_finite() const { return finite_; }
    // Largest first, (k).
    const Unknowns &values() const { return values_; }
    // Right singular vectors as columns, (k, k).
    const Small &right() const { return right_; }
    // Left singular vectors as columns, (m, k), or those in columns `first` to `first + count - 1`; those of missing
    // values are of no use.
    Tall left() const { return left<Eigen::Dynamic>(0, triangular_.cols()); }
    template <int Columns>
    [[gnu::flatten]] Eigen::Matrix<double, Eigen::Dynamic, Columns> left(Eigen::Index first, Eigen::Index count = Columns) const
    {
        const Eigen::Index k = triangular_.cols();
        Eigen::Matrix<double, Eigen::Dynamic, Columns> left(triangular_.rows(), count);
        left.topRows(k) = left_of_triangle_.middleCols(first, count);
        left.bottomRows(left.rows() - k).setZero();
        left.applyOnTheLeft(triangular_.householderQ().setLength(k));
        left.conservativeResize(rows_, count);
        return left;
    }
    // Their products with a vector (m).
    Unknowns components(const Eigen::Ref<const Eigen::VectorXd> &vector) const
    {
        return coordinates<1>(vector).head(triangular_.cols());
    }
    // Coordinates of the columns of a matrix (m, c) in an orthonormal basis that begins with the left singular vectors.
    template <int Columns>
    [[gnu::flatten]] Eigen::Matrix<double, Eigen::Dynamic, Columns> coordinates(
        const Eigen::Ref<const Eigen::Matrix<double, Eigen::Dynamic, Columns>> &columns) const
    {
        const Eigen::Index k = triangular_.cols();
        Eigen::Matrix<double, Eigen::Dynamic, Columns> found(triangular_.rows(), Columns);
        found.topRows(rows_) = columns;
        found.bottomRows(found.rows() - rows_).setZero();
        found.applyOnTheLeft(triangular_.householderQ().setLength(k).adjoint());
        found.topRows(k) = (left_of_triangle_.transpose() * found.topRows(k)).eval();
        return found;
    }
    // The shortest x for which |matrix x - b| is least, given the components of b; singular values up to `threshold`
    // times the largest are taken as zero.
    Unknowns solve(const Unknowns &components, double threshold = 0.0) const;
    // Whether the columns are independent to working precision.
    bool has_full_rank() const { return finite_ && values_(values_.size() - 1) > rounding * values_(0); }

private:
    bool finite_ = false;
    Eigen::Index rows_ = 0;
    Eigen::ColPivHouseholderQR<Tall> triangular_;
    Unknowns values_;
    Small right_, left_of_triangle_;
};

}  // namespace plsing
