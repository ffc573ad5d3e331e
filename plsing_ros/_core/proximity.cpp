// SPDX-License-Identifier: Apache-2.0
// How near a camera centre is to a singular one: in standard deviations of the lines, in metres, and in what is left of
// the precision of a pose. singularities/proximity.py says what the results mean, docs/near_singular.md derives them.
#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "singularity.hpp"

namespace plsing {
namespace {

// A direction of the camera is across the locus, not along it, if the slope in it is at least this many times the
// smallest singular value, so that the step is short for the scene, and this many times its standard deviation.
constexpr double steep = 3.0, sure = 5.0;

// The inverse of the Cholesky factor of the covariance of a line's two rows of the image, (about u, along u), from that of
// angle and offset of the image line with the normal n; zero where the line has no image.
Eigen::Matrix2d whitening(const Vector3d &u, const Vector3d &f, const Eigen::Vector3d &covariance)
{
    // l' = (cos phi, sin phi, rho) is along the moment about the centre, which is -f.
    const Vector3d normal = -f.normalized(), about = u.cross(f).normalized();
    const double depth = std::hypot(normal.x(), normal.y());
    const Vector3d by_angle(-normal.y(), normal.x(), 0.0);
    const Vector3d by_offset = depth * (Vector3d::UnitZ() - normal.z() * normal);
    Eigen::Matrix2d slope;
    slope << about.dot(by_angle), about.dot(by_offset), -u.dot(by_angle), -u.dot(by_offset);
    Eigen::Matrix2d given;
    given << covariance(0), covariance(1), covariance(1), covariance(2);
    const Eigen::LLT<Eigen::Matrix2d> factor(slope * given * slope.transpose());
    if (factor.info() != Eigen::Success)
        return Eigen::Matrix2d::Zero();
    return factor.matrixL().solve(Eigen::Matrix2d::Identity());
}

// A line about the centre, with lengths in units of the scene's.
struct Line {
    Matrix3d axes;          // Columns: u, the normal n of its plane with the centre, u x n.
    double distance, along;  // Of the line from the centre; of the pivot, along u.
    double size, shift, turn;  // Of the first row of the rank basis; standard deviations of pivot and direction.
};

// The variance of a singular value of the rank basis, whose vectors are `left` and `motion`, by the errors of the lines;
// in `slope`, if there is one, how each row's product with `motion` changes with the centre. docs/near_singular.md.
[[gnu::flatten]] double variance_of(const std::vector<Line> &lines, const Vector6d &motion,
                                    const Eigen::Ref<const Eigen::VectorXd> &left, Eigen::MatrixX3d *slope)
{
    double variance = 0.0;
    Index row = -2;
    for (const auto &[axes, distance, along, size, shift, turn] : lines) {
        row += 2;
        if (distance == 0.0)
            continue;
        const Vector3d shifts = axes.transpose() * motion.head<3>(), turns = axes.transpose() * motion.tail<3>();
        // How the singular value changes with the pivot (times u x), by the first row along u, n and u x n, and by the
        // second row along u x n.
        const double square = distance * distance, share = 1.0 / size;
        const double across = share * distance * (turns(0) - distance * shifts(1)) / (1.0 + square);
        const Vector3d by_first(share * shifts(0), across, share * shifts(2));
        const double by_second = -turns(1) / distance;
        if (slope != nullptr) {
            slope->row(row) = across * axes.col(2) - by_first(2) * axes.col(1);
            slope->row(row + 1) = -by_second * axes.col(1);
        }
        const double first = left(row), second = left(row + 1), scale = first * square * share;
        Vector3d moved = first * by_first;
        moved(2) += second * by_second;
        const double about_normal = scale * turns(1) - distance * moved(0) - along * moved(2);
        const double about_third = scale * turns(2) - second * turns(0) + along * moved(1);
        variance += shift * shift * (moved(1) * moved(1) + moved(2) * moved(2));
        variance += turn * turn * (about_normal * about_normal + about_third * about_third);
    }
    return variance;
}

py::object proximity(const Vectors &direction, const Vectors &pivot, const Values &position_std,
                     const Values &direction_std, const View<3> &center, double length, double image_std,
                     double normal, const View<3, 3> &rotation, const Vectors &covariance)
{
    const Index n = direction.rows(), rows = std::max<Index>(2 * n, 6);
    require(pivot.rows() == n && position_std.size() == n && direction_std.size() == n, "there must be n lines in each");
    const bool weighted = covariance.rows() > 0;
    require(!weighted || covariance.rows() == n, "there must be a covariance of each line, or none");
    std::vector<Line> lines(n);
    Tall basis = Tall::Zero(rows, 6), image = basis;
    // What a line's errors add to the variance of a singular value is at most this times the squares of the left vector.
    Eigen::VectorXd max_variance = Eigen::VectorXd::Zero(rows);
    for (Index i = 0; i < n; i++) {
        const Vector3d u = direction.row(i), r = (pivot.row(i).transpose() - center) / length, f = u.cross(r);
        const double square = f.squaredNorm(), shift = position_std(i) / length, turn = direction_std(i);
        lines[i] = {Matrix3d::Zero(), 0.0, u.dot(r), 1.0, shift, turn};
        // The rows of a line that the centre is on are zero.
        if (square == 0.0)
            continue;
        const BasisRows<double> own(u, f);
        const double size = own.first_size, distance = own.second_size, reach = r.norm();
        lines[i].axes << u, f / distance, own.second.transpose();
        lines[i].distance = distance;
        lines[i].size = size;
        const double first = (1.0 + 2.0 * distance) / size, second = 1.0 / distance;
        max_variance.segment<2>(2 * i).setConstant(
            shift * shift * (first * first + second * second) +
            turn * turn * (std::pow(square / size + reach * first, 2) + std::pow(1.0 + reach * second, 2)));
        basis.row(2 * i) = own.first;
        image.row(2 * i) = own.first * (size / square);
        basis.row(2 * i + 1).tail<3>() = image.row(2 * i + 1).tail<3>() = own.second;
        if (weighted) {
            const Eigen::Matrix2d white =
                whitening(rotation.transpose() * u, rotation.transpose() * f, covariance.row(i));
            image.middleRows<2>(2 * i) = (white * image.middleRows<2>(2 * i)).eval();
        }
    }
    const Svd decomposed(basis), seen(image, false);
    if (!decomposed.is_finite() || !seen.is_finite())
        return py::none();
    const double smallest = decomposed.values()(5), largest = decomposed.values()(0);
    const double infinite = std::numeric_limits<double>::infinity();
    Eigen::MatrixX3d slope = Eigen::MatrixX3d::Zero(rows, 3);
    const double variance_of_smallest =
        variance_of(lines, decomposed.right().col(5), decomposed.left<1>(5), &slope);
    double z = smallest <= rounding * largest ? 0.0 : infinite;
    if (variance_of_smallest > 0.0)
        z = std::min(z, smallest / std::sqrt(variance_of_smallest));
    // Not the smallest one alone: far away several are small, and another may be the nearest to zero in tolerances.
    if (std::pow(decomposed.values()(4), 2) < z * z * max_variance.maxCoeff()) {
        const Eigen::Matrix<double, Dynamic, 5> left = decomposed.left<5>(0);
        for (int k = 4; k >= 0; k--) {
            const double square = std::pow(decomposed.values()(k), 2);
            if (!(square < z * z * max_variance.dot(left.col(k).cwiseAbs2())))
                continue;
            const double variance = variance_of(lines, decomposed.right().col(k), left.col(k), nullptr);
            if (variance > 0.0)
                z = std::min(z, std::sqrt(square / variance));
        }
    }
    // A change of the rows that the five better observed motions can follow is none of the rank.
    const Eigen::MatrixX3d change = decomposed.coordinates<3>(slope).bottomRows(rows - 5);
    const Vector3d pull = change.row(0);
    const Eigen::SelfAdjointEigenSolver<Matrix3d> across(change.transpose().lazyProduct(change));
    const double least = std::max(steep * steep * smallest * smallest, sure * sure * variance_of_smallest);
    Vector3d step = Vector3d::Zero();
    for (int axis = 0; axis < 3; axis++) {
        const double value = across.eigenvalues()(axis);
        if (value > 0.0 && (axis == 2 || value >= least))
            step -= across.eigenvectors().col(axis) * (smallest * across.eigenvectors().col(axis).dot(pull) / value);
    }
    const Vector6d weakest = seen.right().col(5);
    const double deviation = seen.has_full_rank() ? (weighted ? 1.0 : image_std) / seen.values()(5) : infinite;
    Vector6d motion_in_metres;
    motion_in_metres << length * weakest.head<3>(), weakest.tail<3>();
    const double moved = motion_in_metres.head<3>().norm(), turned = weakest.tail<3>().norm();
    const Vector3d closest = center + length * step;
    const double condition = largest > 0.0 && normal > 0.0 ? smallest / largest / normal : 0.0;
    const bool exact = position_std.isZero(0.0) && direction_std.isZero(0.0);
    return py::make_tuple(exact ? py::object(py::none()) : py::float_(z), length * step.norm(), array_of(closest), condition,
                          moved > 0.0 ? deviation * moved : 0.0, turned > 0.0 ? deviation * turned : 0.0,
                          array_of(motion_in_metres));
}

}  // namespace

void bind_proximity(py::module_ &module)
{
    module.def("proximity", &proximity);
}

}  // namespace plsing
