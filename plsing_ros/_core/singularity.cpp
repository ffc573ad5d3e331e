// SPDX-License-Identifier: Apache-2.0
// The frame of a scene, and how singular camera centres are.
#include "singularity.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/QR>
#include <cmath>
#include <limits>

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
//
// Both by the largest eigenvalue of a product: of the triangular factor R, and of its inverse.
template <typename Scalar>
double singular_value_ratio(const Eigen::Matrix<Scalar, Dynamic, 6> &xi)
{
    using Square = Eigen::Matrix<Scalar, 6, 6>;
    const Eigen::HouseholderQR<Eigen::Matrix<Scalar, Dynamic, 6>> qr(xi);
    const Square triangle = qr.matrixQR().template topRows<6>().template triangularView<Eigen::Upper>();
    // Also for a matrix of zeros, and for NaN.
    if (!(triangle.diagonal().cwiseAbs().minCoeff() > 1e-100))
        return 0.0;
    const auto largest = [](const Square &matrix) {
        const Eigen::SelfAdjointEigenSolver<Square> solver(matrix * matrix.adjoint(), Eigen::EigenvaluesOnly);
        return std::sqrt(solver.eigenvalues()(5));
    };
    const Square inverse = triangle.template triangularView<Eigen::Upper>().solve(Square::Identity());
    return 1.0 / (largest(triangle) * largest(inverse));
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

// Eigenvalues below this share of the largest leave the centre free: parallel lines, along them.
constexpr double leaves_free = 1e-12;

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
    const Matrix3d total = foot.rows() * Matrix3d::Identity() - direction.transpose() * direction;
    if (!total.allFinite() || !relative.allFinite())
        return std::numeric_limits<double>::quiet_NaN();
    const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(total);
    const Vector3d values = solver.eigenvalues();
    Vector3d along = solver.eigenvectors().transpose() * relative.colwise().sum().transpose();
    for (int i = 0; i < 3; i++)
        along(i) = values(i) > leaves_free * values(2) ? along(i) / values(i) : 0.0;
    const Vector3d offset = solver.eigenvectors() * along;
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

py::array_t<double> rank_basis(const Vectors &direction, const Vectors &point, const View<3> &center, double on_line)
{
    require(direction.rows() == point.rows(), "there must be a point on each line");
    Eigen::Matrix<double, Dynamic, 6> xi = Eigen::Matrix<double, Dynamic, 6>::Constant(
        2 * direction.rows(), 6, std::numeric_limits<double>::quiet_NaN());
    fill_rank_basis<double>(direction, point, Vector3d(center), on_line, xi);
    return array_of(xi);
}

}  // namespace

void bind_singularity(py::module_ &module)
{
    module.def("scene_coordinates", &scene_coordinates);
    module.def("singularity_ratios", &singularity_ratios);
    module.def("rank_basis", &rank_basis);
}

}  // namespace plsing
