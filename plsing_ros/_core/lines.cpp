// SPDX-License-Identifier: Apache-2.0
#include "lines.hpp"

#include <cmath>

namespace plsing {

Pose exponential(const Vector6d &step)
{
    const Vector3d v = step.head<3>(), omega = step.tail<3>();
    const double square = omega.squaredNorm();
    double a = 1.0 - square / 6.0, b = 0.5 - square / 24.0, c = 1.0 / 6.0 - square / 120.0;
    if (square > 1e-8) {
        const double angle = std::sqrt(square), sine_of_half = std::sin(0.5 * angle);
        a = std::sin(angle) / angle;
        // 1 - cos(angle) would cancel.
        b = 2.0 * sine_of_half * sine_of_half / square;
        c = (angle - std::sin(angle)) / (square * angle);
    }
    const Matrix3d turn = skew(omega), squared = turn * turn, one = Matrix3d::Identity();
    return {one + a * turn + b * squared, (one + b * turn + c * squared) * v};
}

Lines in_frame(const Rows3Ref &direction, const Rows3Ref &moment, const Pose &T_a_b)
{
    // Row by row, (t cross u)' is u' times the transpose of [t]x.
    return {direction * T_a_b.rotation,
            (moment + direction * skew(T_a_b.translation)) * T_a_b.rotation};
}

bool fill_interaction_matrix(const Rows3Ref &direction, const Rows3Ref &moment, double min_depth, Tall &matrix)
{
    const Index n = direction.rows();
    matrix.resize(3 * n, 6);
    for (Index i = 0; i < n; i++) {
        const Vector3d l = moment.row(i);
        const double depth = std::hypot(l.x(), l.y());
        if (!has_image(l, depth, min_depth))
            return false;
        const Vector3d image = l / depth;
        Eigen::Matrix<double, 3, 6> rate;
        rate << skew(direction.row(i)), skew(l);
        const Eigen::Matrix<double, 1, 6> depth_rate = image.x() * rate.row(0) + image.y() * rate.row(1);
        matrix.middleRows<3>(3 * i) = (rate - image * depth_rate) / depth;
    }
    return true;
}

void fill_image_error(const Rows3Ref &moment, const Rows3Ref &image_lines, Eigen::VectorXd &error)
{
    error.resize(3 * moment.rows());
    for (Index i = 0; i < moment.rows(); i++) {
        const Vector3d l = moment.row(i), image = image_lines.row(i);
        error.segment<3>(3 * i) = l / std::hypot(l.x(), l.y()) - image;
    }
}

}  // namespace plsing
