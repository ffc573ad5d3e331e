// SPDX-License-Identifier: Apache-2.0
// The frame of a scene, and how singular camera centres are.
#include "singularity.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "jacobi.hpp"

namespace plsing {
namespace {

// As singularity_at, for real or complex centres alone.
template <typename Scalar>
Singularity singularity_about(const Rows3Ref &direction, const Rows3Ref &point,
                              const Eigen::Matrix<Scalar, 3, 1> &center, double on_line)
{
    const Index n = direction.rows();
    const auto u = direction.transpose().template cast<Scalar>().eval();
    Eigen::Matrix<Scalar, 3, Dynamic, Eigen::ColMajor> f(3, n);
    for (Index i = 0; i < n; i++)
        f.col(i) = cross<Scalar>(u.col(i), point.row(i).transpose().template cast<Scalar>() - center);
    const double unit = std::sqrt(f.squaredNorm() / static_cast<double>(n));
    if (!std::isfinite(unit))
        return {1.0, std::numeric_limits<double>::infinity()};
    // In units of length before anything of fourth order is formed, which could over- or underflow.
    f /= unit > 0.0 ? unit : 1.0;
    using Basis = Eigen::Matrix<Scalar, Dynamic, 6>;
    Basis xi = Basis::Zero(2 * n, 6);
    for (Index i = 0; i < n; i++) {
        if (!(f.col(i).norm() > on_line))
            continue;
        const BasisRows<Scalar> rows(u.col(i), f.col(i));
        xi.row(2 * i) = rows.first;
        xi.row(2 * i + 1).template tail<3>() = rows.second;
    }
    // As exact as rounding of xi allows.
    const Eigen::ColPivHouseholderQR<Basis> qr(xi);
    const Eigen::Matrix<Scalar, 6, 6> triangle =
        qr.matrixQR().template topRows<6>().template triangularView<Eigen::Upper>();
    const auto values = JacobiSvd<6, Scalar>(triangle.adjoint(), false).values;
    return {values(0) > 0.0 ? values(5) / values(0) : 0.0, std::sqrt(f.colwise().squaredNorm().minCoeff())};
}

// Singular values up to this share of the largest leave the centre free: parallel lines, along them.
constexpr double leaves_free = 1e-6;

Rows3 across(const Rows3 &vectors, const Rows3Ref &direction)
{
    const Eigen::VectorXd along = vectors.cwiseProduct(direction).rowwise().sum();
    return vectors - along.asDiagonal() * direction;
}

// Fill the point with the smallest sum of squared distances to the lines, and the points of the lines nearest to it, from
// there; return their mean distance.
double center_scene(const Rows3Ref &direction, const Rows3Ref &foot, Vector3d &center, Rows3 &relative)
{
    // Relative to the mean, so that a scene far from the origin loses no digits.
    const Vector3d mean = (foot / static_cast<double>(foot.rows())).colwise().sum();
    relative = across(foot.rowwise() - mean.transpose(), direction);
    Tall sideways(3 * foot.rows(), 3);
    for (Index i = 0; i < foot.rows(); i++)
        sideways.middleRows<3>(3 * i) = Matrix3d::Identity() - direction.row(i).transpose() * direction.row(i);
    const Svd svd(sideways);
    if (!svd.is_finite() || !relative.allFinite())
        return std::numeric_limits<double>::quiet_NaN();
    const Vector3d offset = svd.solve(svd.components(relative.reshaped<Eigen::RowMajor>()), leaves_free);
    center = mean + offset;
    // Twice, because the first time leaves rounding along the line.
    relative = across(across(relative.rowwise() - offset.transpose(), direction), direction);
    return relative.rowwise().norm().mean();
}

py::object scene_coordinates(const Stack<Dynamic, 3> &direction, const Stack<Dynamic, 3> &foot, double concurrent,
                             double smallest)
{
    const Index scenes = direction.size(), n = direction.rows();
    require(foot.size() == scenes && foot.rows() == n && n > 0, "there must be a point on each line");
    py::array_t<double> relative({scenes, n, Index(3)});
    Rows3 centers(scenes, 3), of_scene;
    Eigen::VectorXd lengths(scenes);
    for (Index i = 0; i < scenes; i++) {
        Vector3d center;
        double length = center_scene(direction[i], foot[i], center, of_scene);
        if (!std::isfinite(length))
            return py::none();
        if (length <= std::max(concurrent * center.norm(), smallest))
            length = 0.0;
        centers.row(i) = center;
        lengths(i) = length;
        Eigen::Map<Rows3>(relative.mutable_data() + 3 * n * i, n, 3) = of_scene / (length > 0.0 ? length : 1.0);
    }
    return py::make_tuple(array_of(centers), array_of(lengths), relative);
}

py::tuple singularity_ratios(const Stack<Dynamic, 3> &direction, const Stack<Dynamic, 3> &point,
                             const View<Dynamic, 3, Complex> &centers, double on_line)
{
    const Index k = centers.rows(), scenes = direction.size();
    require(point.size() == scenes && point.rows() == direction.rows() && direction.rows() > 2 &&
                (scenes == 1 || scenes == k),
            "there must be three lines or more, the same for all centres or some for each");
    Eigen::VectorXd ratio(k), distance(k);
    for (Index i = 0; i < k; i++) {
        const Index scene = scenes == 1 ? 0 : i;
        const Singularity found = singularity_at(direction[scene], point[scene], centers.row(i).transpose(), on_line);
        ratio(i) = found.ratio;
        distance(i) = found.distance;
    }
    return py::make_tuple(array_of(ratio), array_of(distance));
}

}  // namespace

Singularity singularity_at(const Rows3Ref &direction, const Rows3Ref &point, const Eigen::Vector3cd &center,
                           double on_line)
{
    if ((center.imag().array() == 0.0).all())
        return singularity_about<double>(direction, point, center.real(), on_line);
    return singularity_about<Complex>(direction, point, center, on_line);
}

void bind_singularity(py::module_ &module)
{
    module.def("scene_coordinates", &scene_coordinates);
    module.def("singularity_ratios", &singularity_ratios);
}

}  // namespace plsing
