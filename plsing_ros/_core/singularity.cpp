// SPDX-License-Identifier: Apache-2.0
// The frame of a scene, and how singular camera centres are.
#include "singularity.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "jacobi.hpp"

namespace plsing {
namespace {

// The cross product, of which Eigen gives the conjugate for complex vectors.
template <typename Scalar>
Eigen::Matrix<Scalar, 3, 1> cross(const Eigen::Matrix<Scalar, 3, 1> &a, const Eigen::Matrix<Scalar, 3, 1> &b)
{
    return a.cross(b).conjugate();
}

// Fill the row-normalised rank basis xi (2n, 6) about a centre, and return the distance of the nearest line.
//
// First the n rows [f_i, |f_i|^2 u_i], then the n rows [0, m_i], lengths in the root mean square distance from the centre
// to the lines. For a complex centre |f|^2 is f . f, without conjugation, so that xi stays polynomial in the centre. The
// rows of a line that the centre is on, nearer than `on_line`, are zero. NaN where products of lengths overflow.
template <typename Scalar>
double fill_rank_basis(const Rows3Ref &direction, const Rows3Ref &point, const Eigen::Matrix<Scalar, 3, 1> &center,
                       double on_line, Eigen::Matrix<Scalar, Dynamic, 6> &xi)
{
    using Vector = Eigen::Matrix<Scalar, 3, 1>;
    const Index n = direction.rows();
    Eigen::Matrix<Scalar, 3, Dynamic, Eigen::ColMajor> f(3, n);
    for (Index i = 0; i < n; i++) {
        const Vector u = direction.row(i).transpose().template cast<Scalar>();
        f.col(i) = cross<Scalar>(u, point.row(i).transpose().template cast<Scalar>() - center);
    }
    const double unit = std::sqrt(f.squaredNorm() / static_cast<double>(n));
    if (!std::isfinite(unit))
        return std::numeric_limits<double>::quiet_NaN();
    // In units of length before anything of fourth order is formed, which could over- or underflow.
    f /= unit > 0.0 ? unit : 1.0;
    xi = Eigen::Matrix<Scalar, Dynamic, 6>::Zero(2 * n, 6);
    for (Index i = 0; i < n; i++) {
        const Vector u = direction.row(i).transpose().template cast<Scalar>();
        const double length = f.col(i).norm();
        if (!(length > on_line))
            continue;
        const Scalar dot = f.col(i).cwiseProduct(f.col(i)).sum();
        // |u x f| = |f|, since f is across u.
        const double upper = std::hypot(length, std::abs(dot));
        xi.row(i) << f.col(i).transpose() / upper, u.transpose() * (dot / upper);
        xi.row(n + i).template tail<3>() = cross<Scalar>(u, f.col(i)).transpose() / length;
    }
    return std::sqrt(f.colwise().squaredNorm().minCoeff());
}

// The smallest over the largest singular value of xi, as exact as rounding of xi allows.
template <typename Scalar>
double singular_value_ratio(const Eigen::Matrix<Scalar, Dynamic, 6> &xi)
{
    const Eigen::ColPivHouseholderQR<Eigen::Matrix<Scalar, Dynamic, 6>> qr(xi);
    const Eigen::Matrix<Scalar, 6, 6> triangle =
        qr.matrixQR().template topRows<6>().template triangularView<Eigen::Upper>();
    const JacobiSvd<6, Scalar> svd(triangle.adjoint(), false);
    return svd.values(0) > 0.0 ? svd.values(5) / svd.values(0) : 0.0;
}

template <typename Scalar>
Singularity ratio_and_distance(const Rows3Ref &direction, const Rows3Ref &point,
                               const Eigen::Matrix<Scalar, 3, 1> &center, double on_line)
{
    Eigen::Matrix<Scalar, Dynamic, 6> xi;
    const double distance = fill_rank_basis<Scalar>(direction, point, center, on_line, xi);
    if (std::isnan(distance))
        return {1.0, std::numeric_limits<double>::infinity()};
    return {singular_value_ratio<Scalar>(xi), distance};
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

}  // namespace

Singularity singularity_at(const Rows3Ref &direction, const Rows3Ref &point, const Eigen::Vector3cd &center,
                           double on_line)
{
    if ((center.imag().array() == 0.0).all())
        return ratio_and_distance<double>(direction, point, center.real(), on_line);
    return ratio_and_distance<Complex>(direction, point, center, on_line);
}

namespace {

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

void bind_singularity(py::module_ &module)
{
    module.def("scene_coordinates", &scene_coordinates);
    module.def("singularity_ratios", &singularity_ratios);
}

}  // namespace plsing
