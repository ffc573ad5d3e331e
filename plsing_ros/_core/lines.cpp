// SPDX-License-Identifier: Apache-2.0
// Lines and poses: moved, projected, checked and aligned.
#include "lines.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
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

Eigen::VectorXd image_error(const Rows3Ref &moment, const Rows3Ref &image_lines)
{
    Eigen::VectorXd error(3 * moment.rows());
    for (Index i = 0; i < moment.rows(); i++) {
        const Vector3d l = moment.row(i), image = image_lines.row(i);
        error.segment<3>(3 * i) = l / std::hypot(l.x(), l.y()) - image;
    }
    return error;
}

namespace {

// Comparisons are written so that they fail for what is not a number.

bool are_lines(const Vectors &direction, const Vectors &moment, double tolerance)
{
    require(direction.rows() == moment.rows(), "there must be a moment for each direction");
    for (Index i = 0; i < direction.rows(); i++) {
        const Vector3d u = direction.row(i), l = moment.row(i);
        if (!(std::abs(u.squaredNorm() - 1.0) <= tolerance && l.allFinite() &&
              std::abs(u.dot(l)) <= tolerance * (1.0 + l.cwiseAbs().maxCoeff())))
            return false;
    }
    return true;
}

bool are_image_lines(const Vectors &image_lines, double tolerance)
{
    for (Index i = 0; i < image_lines.rows(); i++)
        if (!(std::abs(std::hypot(image_lines(i, 0), image_lines(i, 1)) - 1.0) <= tolerance &&
              std::isfinite(image_lines(i, 2))))
            return false;
    return true;
}

bool have_images(const Vectors &moment, double min_depth)
{
    for (Index i = 0; i < moment.rows(); i++)
        if (!has_image(moment.row(i), std::hypot(moment(i, 0), moment(i, 1)), min_depth))
            return false;
    return true;
}

bool is_rotation(const View<3, 3> &rotation, double tolerance)
{
    const Matrix3d error = rotation * rotation.transpose() - Matrix3d::Identity();
    return (error.array().abs() <= tolerance).all() && rotation.determinant() > 0.0;
}

py::object align_lines(const Vectors &direction, const Vectors &moment, const Vectors &seen_direction,
                       const Vectors &seen_moment)
{
    const Index n = direction.rows();
    require(n > 0 && moment.rows() == n && seen_direction.rows() == n && seen_moment.rows() == n,
            "there must be n lines in each");
    const Matrix3d correlation = direction.transpose() * seen_direction;
    if (!correlation.allFinite())
        return py::none();
    const Eigen::JacobiSVD<Matrix3d> svd(correlation, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Matrix3d left = svd.matrixU();
    if (left.determinant() * svd.matrixV().determinant() < 0.0)
        left.col(2) *= -1.0;
    const Matrix3d rotation = left * svd.matrixV().transpose();
    const Rows3 turned = seen_direction * rotation.transpose();
    const double min_cosine = (direction.array() * turned.array()).rowwise().sum().minCoeff();
    // t x u = l - R l_seen, three rows for each line.
    Tall matrix(3 * n, 3);
    for (Index i = 0; i < n; i++)
        matrix.middleRows<3>(3 * i) = -skew(direction.row(i));
    const Rows3 difference = moment - seen_moment * rotation.transpose();
    const Eigen::Map<const Eigen::VectorXd> right_side(difference.data(), 3 * n);
    const Svd decomposed(matrix);
    if (!decomposed.has_full_rank() || !right_side.allFinite())
        return py::none();
    const Vector3d t = decomposed.solve(decomposed.components(right_side));
    const double offset = (matrix * t - right_side).norm() / std::sqrt(static_cast<double>(n));
    return py::make_tuple(array_of(rotation), array_of(t), svd.singularValues()(1), min_cosine, offset);
}

}  // namespace

void bind_lines(py::module_ &module)
{
    module.def("are_lines", &are_lines);
    module.def("are_image_lines", &are_image_lines);
    module.def("have_images", &have_images);
    module.def("is_rotation", &is_rotation);
    module.def("align_lines", &align_lines);
}

}  // namespace plsing
