// SPDX-License-Identifier: Apache-2.0
// The frame of a scene, and how singular camera centres are.
#include "singularity.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
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

// Columns of xi made orthonormal one after the other. The triangular factor of this modified Gram-Schmidt is as exact as
// Householder's, whatever the rank (Bjorck 1967); its diagonal ends with zeros after a column of zeros.
template <typename Scalar>
Eigen::Matrix<Scalar, 6, 6> triangular_factor(Eigen::Matrix<Scalar, Dynamic, 6> &xi)
{
    Eigen::Matrix<Scalar, 6, 6> triangle = Eigen::Matrix<Scalar, 6, 6>::Zero();
    for (int k = 0; k < 6; k++) {
        const double length = xi.col(k).norm();
        if (!(length > 0.0))
            break;
        triangle(k, k) = length;
        xi.col(k) /= length;
        for (int j = k + 1; j < 6; j++) {
            triangle(k, j) = xi.col(k).dot(xi.col(j));
            xi.col(j) -= triangle(k, j) * xi.col(k);
        }
    }
    return triangle;
}

// The largest singular value of a matrix A, too large by at most a share of `tolerance`.
//
// S is a power of A A* with |S| = 1, whose largest eigenvalue is in [1 / tr S, 1]. Where six doublings of the power do
// not bring these together, the eigenvalues are computed.
template <typename Square>
double largest_singular_value(const Square &matrix, double tolerance)
{
    const double size = matrix.norm();
    if (!std::isfinite(size))
        return size;
    // Eigen multiplies a matrix several times as fast as an expression.
    const Square unit = matrix / size, adjoint = unit.adjoint();
    const Square product = unit * adjoint;
    Square power = product;
    double value = size, root = 0.5;
    for (int doubled = 0; doubled < 6; doubled++, root *= 0.5) {
        if (doubled > 0)
            power = (power * power).eval();
        const double norm = power.norm();
        power /= norm;
        value *= std::pow(norm, root);
        if ((std::real(power.trace()) - 1.0) * root <= tolerance)
            return value;
    }
    const Eigen::SelfAdjointEigenSolver<Square> solver(product, Eigen::EigenvaluesOnly);
    return size * std::sqrt(solver.eigenvalues()(5));
}

// Relative errors of the largest singular values, and the absolute one of their ratio, that are rounding.
constexpr double rounding = 1e-15, rounding_of_ratio = 1e-17, coarse = 1e-2;

// The smallest over the largest singular value of xi, which is overwritten, as exact as rounding of xi allows.
//
// Both by the largest one of a matrix: of the triangular factor, and of its inverse.
template <typename Scalar>
double singular_value_ratio(Eigen::Matrix<Scalar, Dynamic, 6> &xi)
{
    using Square = Eigen::Matrix<Scalar, 6, 6>;
    const Square triangle = triangular_factor<Scalar>(xi);
    // Also for a matrix of zeros, and for NaN.
    if (!(triangle.diagonal().cwiseAbs().minCoeff() > 1e-100))
        return 0.0;
    const Square inverse = triangle.template triangularView<Eigen::Upper>().solve(Square::Identity());
    const double smallest = 1.0 / largest_singular_value(inverse, rounding);
    // A ratio that is small itself needs few digits of the largest one.
    const double needed = rounding_of_ratio * triangle.norm() / smallest;
    return smallest / largest_singular_value(triangle, std::clamp(needed, rounding, coarse));
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
