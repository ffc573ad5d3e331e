// SPDX-License-Identifier: Apache-2.0
#include "image_residuals.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <cmath>
#include <limits>

namespace plsing {
namespace {

constexpr double min_depth = 1e-12;
// A step that promises to lower the sum of squares by less than this share is the last: Newton's steps then leave the
// square of it.
constexpr double min_gain = 1e-6;
constexpr double first_damping = 1e-6, max_damping = 1e10, max_turn = 0.5;
// By how much the cost, -2 log of the likelihood, may exceed the lowest one on the path.
constexpr double slack = 1.0;

double log_determinant(const Residuals &residuals, const Weights &weight)
{
    double sum = 0.0;
    for (Index i = 0; i < weight.size(); i++)
        sum += weight(i) * std::log(residuals[i].determinant);
    return sum;
}

// Fill the normal equations and half of the gradient of the misfit.
void fill_normal_equations(const Residuals &residuals, const Weights &weight, Matrix6d &normal, Vector6d &slope)
{
    normal.setZero();
    slope.setZero();
    for (Index i = 0; i < weight.size(); i++) {
        const Eigen::Matrix<double, 2, 6> rows = weight(i) * residuals[i].whitening * residuals[i].jacobian();
        normal += rows.transpose() * rows;
        slope += rows.transpose() * residuals[i].value();
    }
}

Eigen::Matrix2d matrix_of(const Eigen::RowVector3d &covariance)
{
    Eigen::Matrix2d matrix;
    matrix << covariance(0), covariance(1), covariance(1), covariance(2);
    return matrix;
}

// The covariance of angle and offset by the errors of the line in the world, in closed form: docs/pose.md.
Eigen::Matrix2d by_map(const Residual &line, double scale, const Vector3d &u, const Eigen::Matrix<double, 1, 11> &known,
                       const Pose &T_camera_world)
{
    const double position = known(9) * known(9), direction = known(10) * known(10);
    if (position == 0.0 && direction == 0.0)
        return Eigen::Matrix2d::Zero();
    const Vector3d p = line.image;
    const Vector3d pivot =
        T_camera_world.rotation * known.segment<3>(6).transpose() + T_camera_world.translation;
    // Rows: the derivatives of angle and offset by the moment. They are normal to it.
    Eigen::Matrix<double, 2, 3> slope, turned;
    slope << -p.y(), p.x(), 0.0, -p.z() * p.x(), -p.z() * p.y(), 1.0;
    slope *= scale;
    const Eigen::Vector2d along = slope * u;
    for (int i = 0; i < 2; i++)
        turned.row(i) = Vector3d(slope.row(i)).cross(pivot);
    return position * (slope * slope.transpose() - along * along.transpose()) +
           direction * turned * turned.transpose();
}

}  // namespace

Eigen::Matrix<double, 2, 6> Residual::jacobian() const
{
    const double squared = 1.0 + image.z() * image.z();
    Eigen::Matrix<double, 2, 6> rows;
    rows << along_z * image.transpose(), image.z() * image.x(), image.z() * image.y(), -1.0,
        -along * image.transpose(), -squared * image.y(), squared * image.x(), 0.0;
    return rows;
}

Image::Image(const KnownLines &lines, const SeenLines &image_lines, const View<3> &settings)
    : lines_(lines), image_lines_(image_lines), scene_(settings(0) * settings(0)),
      camera_(settings(1) * settings(1)), min_cosine_(settings(2))
{
    require(lines.rows() > 0 && lines.rows() == image_lines.rows(), "there must be an image line for each line");
}

void Image::fill(const Pose &T_camera_world, Residuals &residuals) const
{
    residuals.resize(size());
    for (Index i = 0; i < size(); i++) {
        Residual &line = residuals[i];
        const auto known = lines_.row(i);
        const auto seen = image_lines_.row(i);
        const Vector3d observed = seen.head<3>();
        const Vector3d u = T_camera_world.rotation * known.head<3>().transpose();
        const Vector3d l = T_camera_world.rotation * known.segment<3>(3).transpose() +
                           T_camera_world.translation.cross(u);
        const double depth = std::max(std::hypot(l.x(), l.y()), min_depth);
        const double agreement = observed.x() * l.x() + observed.y() * l.y();
        // Directed as it is seen: whether that is against its own direction is counted apart.
        const double scale = std::copysign(1.0 / depth, agreement);
        const Vector3d v = scale * u;
        line.image = scale * l;
        line.along = line.image.x() * v.y() - line.image.y() * v.x();
        line.along_z = v.z();
        line.raw << std::atan2(observed.x() * line.image.y() - observed.y() * line.image.x(), agreement * scale),
            line.image.z() - observed.z();
        line.reversed = agreement < 0.0;
        // The point closest to the camera is in front if `along` is negative: docs/pose.md.
        line.hidden = !(line.along < 0.0 || std::abs(u.z()) > min_cosine_);
        // The covariance by the moment of the line, and by its direction, in the plane normal to u only.
        const double squared = 1.0 + line.image.z() * line.image.z(), turn = depth * depth * squared;
        const double by_moment = (scene_ + camera_) * squared, t_along = T_camera_world.translation.dot(v);
        const Eigen::Vector2d moment(line.along_z, -line.along), camera(line.along, squared * line.along_z);
        const Eigen::Vector2d scene(line.along - line.along_z * t_along, camera.y() + line.along * t_along);
        const Eigen::Matrix2d covariance =
            matrix_of(seen.tail<3>()) + by_map(line, scale, u, known, T_camera_world) +
            by_moment * moment * moment.transpose() + scene_ * turn * scene * scene.transpose() + camera_ * turn * camera * camera.transpose();
        const double a = covariance(0, 0), b = covariance(1, 0), d = covariance(1, 1);
        const double rest = std::max(d - b * b / a, 1e-15 * d), root = 1.0 / std::sqrt(rest);
        line.whitening << 1.0 / std::sqrt(a), 0.0, -b / a * root, root;
        line.determinant = a * rest;
    }
}

Pose move(const Pose &T_camera_world, const Vector6d &motion)
{
    const Vector3d half = -0.5 * motion.tail<3>();
    const Matrix3d turn = skew(half);
    const Matrix3d back = Matrix3d::Identity() + 2.0 / (1.0 + half.squaredNorm()) * (turn + turn * turn);
    return {back * T_camera_world.rotation, back * (T_camera_world.translation - motion.head<3>())};
}

double misfit(const Residuals &residuals, const Residuals &measure, const Weights &weight)
{
    double sum = 0.0;
    for (Index i = 0; i < weight.size(); i++)
        sum += weight(i) * (measure[i].whitening * residuals[i].raw).squaredNorm();
    return sum;
}

bool refine(const Image &image, const Weights &weight, long iterations, Pose &T_camera_world, double &gain)
{
    Residuals now, next;
    image.fill(T_camera_world, now);
    double was = misfit(now, now, weight), lowest = was + log_determinant(now, weight), damping = first_damping;
    bool final = false;
    gain = std::numeric_limits<double>::infinity();
    for (; iterations > 0 && !final; iterations--) {
        Matrix6d normal;
        Vector6d slope;
        fill_normal_equations(now, weight, normal, slope);
        normal.diagonal() = normal.diagonal() * (1.0 + damping) + Vector6d::Constant(1e-300);
        Vector6d step = -normal.ldlt().solve(slope);
        gain = -slope.dot(step);
        final = gain <= min_gain * (1.0 + was) || damping > max_damping;
        const double turn = step.tail<3>().norm();
        if (turn > max_turn)
            step *= max_turn / turn;
        const Pose candidate = move(T_camera_world, step);
        image.fill(candidate, next);
        const double is = misfit(next, next, weight), cost = is + log_determinant(next, weight);
        // Both by the same measure, and not much less likely, as poses would win by their larger covariance.
        if (misfit(next, now, weight) <= was && cost <= lowest + slack) {
            was = is;
            lowest = std::min(lowest, cost);
            std::swap(now, next);
            T_camera_world = candidate;
            damping *= 0.1;
        } else
            damping = std::max(100.0 * damping, 1e-4);
    }
    return final;
}

}  // namespace plsing
