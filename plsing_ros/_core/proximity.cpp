// SPDX-License-Identifier: Apache-2.0
// How near a camera centre is to a singular one: in standard deviations of the lines, in metres, and in what is left of
// the precision of a pose. singularities/proximity.py says what the results mean, docs/near_singular.md derives them.
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "core.hpp"
#include "least_squares.hpp"

namespace plsing {
namespace {

// A direction of the camera is across the locus, not along it, if the slope in it is at least this many times the
// smallest singular value, so that the step is short for the scene, and this many times its standard deviation.
constexpr double steep = 3.0, sure = 5.0;

py::object proximity(const Vectors &direction, const Vectors &pivot, const Values &position_std,
                     const Values &direction_std, const View<3> &center, double length, double image_std)
{
    const Index n = direction.rows(), rows = std::max<Index>(2 * n, 6);
    require(pivot.rows() == n && position_std.size() == n && direction_std.size() == n, "there must be n lines in each");
    Tall basis = Tall::Zero(rows, 6), image = Tall::Zero(rows, 6);
    Eigen::VectorXd size = Eigen::VectorXd::Ones(rows);
    Eigen::Matrix3Xd normal(3, n), arm(3, n);
    for (Index i = 0; i < n; i++) {
        const Vector3d u = direction.row(i);
        arm.col(i) = (pivot.row(i).transpose() - center) / length;
        const Vector3d f = u.cross(arm.col(i)), m = u.cross(f);
        normal.col(i) = f;
        const double square = f.squaredNorm(), distance = std::sqrt(square);
        // The rows of a line that the centre is on are zero.
        if (distance == 0.0)
            continue;
        size(2 * i) = distance * std::sqrt(1.0 + square);
        size(2 * i + 1) = distance;
        basis.row(2 * i) << f.transpose() / size(2 * i), u.transpose() * (square / size(2 * i));
        basis.row(2 * i + 1).tail<3>() = m / distance;
        image.row(2 * i) << f.transpose() / square, u.transpose();
        image.row(2 * i + 1).tail<3>() = m / distance;
    }
    const Svd decomposed(basis), seen(image);
    if (!decomposed.is_finite() || !seen.is_finite())
        return py::none();
    const Tall left = decomposed.left();
    const Vector6d motion = decomposed.right().col(5);
    const double smallest = decomposed.values()(5), largest = decomposed.values()(0);
    double variance = 0.0;
    Eigen::MatrixX3d slope = Eigen::MatrixX3d::Zero(rows, 3);
    for (Index i = 0; i < n; i++) {
        const Vector3d u = direction.row(i), f = normal.col(i), r = arm.col(i);
        const double square = f.squaredNorm();
        if (square == 0.0)
            continue;
        // How the last singular value changes with the pivot (times u x) and with the direction of this line.
        Vector3d moved = Vector3d::Zero(), turned = Vector3d::Zero();
        for (Index row = 2 * i; row < 2 * i + 2; row++) {
            const Vector6d unit = basis.row(row);
            const Vector6d weight = (motion - unit.dot(motion) * unit) / size(row);
            const Vector3d spin = weight.tail<3>();
            const bool first = row == 2 * i;
            const Vector3d by_normal = first ? Vector3d(weight.head<3>() + 2.0 * spin.dot(u) * f) : spin.cross(u);
            const Vector3d by_direction = first ? Vector3d(square * spin) : f.cross(spin);
            slope.row(row) = u.cross(by_normal);
            moved += left(row, 5) * by_normal;
            turned += left(row, 5) * (by_direction + r.cross(by_normal));
        }
        const double shift = position_std(i) / length;
        variance += shift * shift * moved.cross(u).squaredNorm();
        variance += direction_std(i) * direction_std(i) * (turned - turned.dot(u) * u).squaredNorm();
    }
    // A change of the rows that the five better observed motions can follow is none of the rank.
    slope -= left.leftCols<5>() * (left.leftCols<5>().transpose() * slope).eval();
    const Vector3d pull = slope.transpose() * left.col(5);
    const Eigen::SelfAdjointEigenSolver<Matrix3d> across(slope.transpose() * slope);
    const double least = std::max(steep * steep * smallest * smallest, sure * sure * variance);
    Vector3d step = Vector3d::Zero();
    for (int axis = 0; axis < 3; axis++) {
        const double value = across.eigenvalues()(axis);
        if (value > 0.0 && (axis == 2 || value >= least))
            step -= across.eigenvectors().col(axis) * (smallest * across.eigenvectors().col(axis).dot(pull) / value);
    }
    const double infinite = std::numeric_limits<double>::infinity();
    const bool singular = smallest <= rounding * largest;
    const double z = singular ? 0.0 : variance > 0.0 ? smallest / std::sqrt(variance) : infinite;
    const Vector6d weakest = seen.right().col(5);
    const double deviation = seen.has_full_rank() ? image_std / seen.values()(5) : infinite;
    const double moved = length * weakest.head<3>().norm(), turned = weakest.tail<3>().norm();
    Vector6d motion_in_metres;
    motion_in_metres << length * weakest.head<3>(), weakest.tail<3>();
    const Vector3d closest = center + length * step;
    return py::make_tuple(z, length * step.norm(), array_of(closest), largest > 0.0 ? smallest / largest : 0.0,
                          moved > 0.0 ? deviation * moved : 0.0, turned > 0.0 ? deviation * turned : 0.0,
                          array_of(motion_in_metres));
}

py::array_t<double> scene_conditions(const Vectors &direction, const Vectors &point, const Vectors &centers)
{
    require(point.rows() == direction.rows(), "there must be n lines in each");
    Eigen::VectorXd ratio(centers.rows());
    for (Index k = 0; k < centers.rows(); k++) {
        Matrix6d gram = Matrix6d::Zero();
        for (Index i = 0; i < direction.rows(); i++) {
            const Vector3d u = direction.row(i), f = u.cross((point.row(i) - centers.row(k)).transpose());
            const double square = f.squaredNorm();
            if (square == 0.0)
                continue;
            Vector6d row;
            row << f, square * u;
            gram += row * row.transpose() / (square * (1.0 + square));
            const Vector3d m = u.cross(f);
            gram.bottomRightCorner<3, 3>() += m * m.transpose() / square;
        }
        const Vector6d values = Eigen::SelfAdjointEigenSolver<Matrix6d>(gram, Eigen::EigenvaluesOnly).eigenvalues();
        ratio(k) = values(5) > 0.0 ? std::sqrt(std::max(values(0), 0.0) / values(5)) : 0.0;
    }
    return array_of(ratio);
}

}  // namespace

void bind_proximity(py::module_ &module)
{
    module.def("proximity", &proximity);
    module.def("scene_conditions", &scene_conditions);
}

}  // namespace plsing
