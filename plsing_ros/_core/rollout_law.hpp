// SPDX-License-Identifier: Apache-2.0
// The controller's laws as functions of rows of L and an error, for roll-outs: the same twists, without its words.
#pragma once

#include <Eigen/QR>
#include <Eigen/SVD>

#include <algorithm>
#include <limits>

#include "line_rows.hpp"

namespace plsing {

enum class Law { kPinv, kDls, kAdaptiveDls, kGuarded, kPosition, kPath };
enum class Inverted { kCurrent, kTarget, kMean };

struct LawOptions {
    Law law = Law::kPinv;
    Inverted inverted = Inverted::kCurrent;
    int columns = 6;  // Degrees of freedom in use; the others' columns of L are zero.
    bool used[6] = {true, true, true, true, true, true};
    double gain = 0.1, gain_slope = 0.0, gain_at_infinity = 0.0;
    double threshold = 1e-12, damping = 0.3, onset = 0.5, max_damping = 0.5;
    double margin = 0.15, floor = 0.2, unobservable_share = 1.0;
    double max_linear = 0.0, max_angular = 0.0;  // Infinite where there is none.
};

// Least squares with rows of L: by pivoted QR where that is as good as the singular value decomposition, else by that.
class RowSolver {
public:
    // Take the rows (m, 6), m >= 6.
    void decompose(const Rows &rows, int columns)
    {
        columns_ = columns;
        qr_.compute(rows);
        triangle_.setZero();
        triangle_.triangularView<Eigen::Upper>() = qr_.matrixR().topRows<6>();
        has_values_ = false;
        if (ratio() > 0.0) {
            // No singular value is smaller than 1 / |R^-1|.
            Matrix6d inverse = Matrix6d::Identity();
            const int k = columns;
            triangle_.topLeftCorner(k, k).triangularView<Eigen::Upper>().solveInPlace(inverse.topLeftCorner(k, k));
            least_ = 1.0 / inverse.topLeftCorner(k, k).norm();
        } else {
            least_ = 0.0;
        }
    }

    // What the smallest singular value is at least.
    double least() const { return least_; }

    double smallest()
    {
        find_values();
        return values_[columns_ - 1];
    }

    // Take the right side (m).
    void project(const Eigen::VectorXd &right_side)
    {
        scratch_ = right_side;
        scratch_.applyOnTheLeft(qr_.householderQ().adjoint());
        projected_ = scratch_.head<6>();
        if (columns_ < 6) projected_.tail(6 - columns_).setZero();
    }

    // The pseudo-inverse times the right side.
    Vector6d solve(double threshold)
    {
        if (ratio() > std::max(kGoodRatio, 100.0 * threshold)) return solve_triangle();
        find_values();
        Vector6d along = components();
        for (int i = 0; i < 6; i++)
            along[i] = i < columns_ && values_[i] > threshold * values_[0] ? along[i] / values_[i] : 0.0;
        return from_right(along);
    }

    const Vector6d &values()
    {
        find_values();
        return values_;
    }
    Vector6d components() const { return svd_.matrixU().transpose() * projected_; }
    Vector6d from_right(const Vector6d &along) const { return qr_.colsPermutation() * Vector6d(svd_.matrixV() * along); }

    // Damped alike in all directions: the minimum of |L x - b|^2 + mu^2 |x|^2.
    Vector6d solve_damped(double threshold, double damping)
    {
        find_values();
        Vector6d along = components();
        for (int i = 0; i < 6; i++) {
            const double s = values_[i];
            along[i] = i < columns_ && s > threshold * values_[0] ? along[i] * s / (s * s + damping * damping) : 0.0;
        }
        return from_right(along);
    }

private:
    static constexpr double kGoodRatio = 1e-3;

    double ratio() const
    {
        const double first = std::abs(triangle_(0, 0));
        return first > 0.0 ? std::abs(triangle_(columns_ - 1, columns_ - 1)) / first : 0.0;
    }

    Vector6d solve_triangle()
    {
        Vector6d solution = Vector6d::Zero();
        const int k = columns_;
        solution.head(k) = triangle_.topLeftCorner(k, k).triangularView<Eigen::Upper>().solve(projected_.head(k));
        return qr_.colsPermutation() * solution;
    }

    void find_values()
    {
        if (has_values_) return;
        svd_.compute(triangle_, Eigen::ComputeFullU | Eigen::ComputeFullV);
        values_ = svd_.singularValues();
        has_values_ = true;
    }

    Eigen::ColPivHouseholderQR<Rows> qr_;
    Eigen::JacobiSVD<Matrix6d, Eigen::NoQRPreconditioner> svd_;
    Matrix6d triangle_;
    Vector6d values_, projected_;
    Eigen::VectorXd scratch_;
    double least_ = 0.0;
    int columns_ = 6;
    bool has_values_ = false;
};

inline double smooth_step(double ratio)
{
    const double r = std::min(std::max(ratio, 0.0), 1.0);
    return r * r * (3.0 - 2.0 * r);
}

// The smallest singular value that is healthy, from that of L at the target, largest and smallest.
inline double healthy_value(const Eigen::Vector2d &target)
{
    return std::max({target[1], 1e-6 * target[0], std::numeric_limits<double>::denorm_min()});
}

// The laws that damp nearly unobservable motions: adaptive_dls by its profile.
inline Vector6d adaptive_twist(const LawOptions &law, RowSolver &solver, double reference)
{
    const double onset = law.onset * reference, most = law.max_damping * reference;
    if (solver.least() >= onset) return solver.solve(law.threshold);
    const Vector6d values = solver.values();
    Vector6d along = solver.components();
    for (int i = 0; i < 6; i++) {
        const double s = values[i], share = std::min(s / onset, 1.0), mu_square = most * most * (1.0 - share * share);
        const bool kept = i < law.columns && s > law.threshold * values[0];
        along[i] = kept ? along[i] * s / (s * s + mu_square) : 0.0;
    }
    return solver.from_right(along);
}

// guarded without its scale: nearly unobservable motions are limited, the others unchanged.
inline Vector6d limited_twist(const LawOptions &law, RowSolver &solver, double reference)
{
    const double onset = law.onset * reference;
    if (solver.least() >= onset || solver.smallest() >= onset) return solver.solve(law.threshold);
    const Vector6d values = solver.values();
    Vector6d along = solver.components(), health;
    double rest = 0.0;
    for (int i = 0; i < law.columns; i++) {
        along[i] = values[i] > law.threshold * values[0] ? along[i] / values[i] : 0.0;
        health[i] = smooth_step(values[i] / onset);
        if (health[i] >= 1.0) rest += along[i] * along[i];
    }
    rest = law.unobservable_share * std::sqrt(rest) + 0.01 * law.max_linear;
    for (int i = 0; i < law.columns; i++) {
        if (health[i] >= 1.0) continue;
        const double limit = rest * health[i] / (1.0 - health[i]);
        along[i] = std::min(std::max(along[i], -limit), limit);
    }
    for (int i = law.columns; i < 6; i++) along[i] = 0.0;
    return solver.from_right(along);
}

// Scale a twist as a whole to limits of |v| and |omega|, and return the factor.
inline double saturate(Vector6d &twist, double linear, double angular)
{
    double factor = 1.0;
    const double v = twist.head<3>().norm(), w = twist.tail<3>().norm();
    if (v > linear) factor = linear / v;
    if (w > angular) factor = std::min(factor, angular / w);
    if (factor < 1.0) twist *= factor;
    return factor;
}

}  // namespace plsing
