// SPDX-License-Identifier: Apache-2.0
// Camera rotations from three lines, and the translations that go with them.
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <vector>

#include "lines.hpp"

namespace plsing {
namespace {

constexpr int samples = 9, degree = 8;
// Below this, relative to what generic lines give, the polynomial or a cross product counts as zero.
constexpr double degenerate = 1e-10;

using Coefficients = Eigen::Matrix<double, samples, 1>;

// From samples q(2 pi m / 9) to coefficients, lowest first, of q (1 + t^2)^4.
using Interpolate = View<samples, samples>;

double angle_of(int sample)
{
    return 2.0 * M_PI * sample / samples;
}

// A rotation that takes a unit vector to the z axis.
Matrix3d rotation_to_z(const Vector3d &axis)
{
    const Vector3d across = axis.unitOrthogonal();
    Matrix3d rows;
    rows << across.transpose(), axis.cross(across).transpose(), axis.transpose();
    return rows;
}

// Both equations, n_i . (Rz(alpha) Rx(beta) u_i) = 0, are linear in (cos alpha, sin alpha, 1), with coefficients that are
// linear in (1, cos beta, sin beta).
struct Equations {
    std::array<Matrix3d, 2> of_line;

    // What solves both at an angle beta, up to the length.
    Vector3d solve(double cosine, double sine) const
    {
        const Vector3d basis(1.0, cosine, sine);
        return (of_line[0] * basis).cross(of_line[1] * basis);
    }
};

// Append the rotations of one triplet; return whether there is a continuum instead.
//
// With the first normal as the z axis and its direction as the x axis, R = Rz(alpha) Rx(beta). That the solution's first
// two components have the length of the third is a trigonometric polynomial of degree 4 in beta, which is sampled and
// turned into a polynomial of degree 8 in t = tan of half an angle whose infinity is where it is largest.
bool append_rotations(const Matrix3d &directions, const Matrix3d &normals, const Interpolate &interpolate,
                      std::vector<Matrix3d> &rotations)
{
    Matrix3d frame;
    frame << rotation_to_z(directions.row(0)).row(2), rotation_to_z(directions.row(0)).topRows<2>();
    const Matrix3d image_frame = rotation_to_z(normals.row(0));
    Equations equations;
    double size = 1.0;
    for (int k = 0; k < 2; k++) {
        const Vector3d n = image_frame * normals.row(k + 1).transpose(), u = frame * directions.row(k + 1).transpose();
        equations.of_line[k] << n.x() * u.x(), n.y() * u.y(), -n.y() * u.z(),
            n.y() * u.x(), -n.x() * u.y(), n.x() * u.z(),
            0.0, n.z() * u.z(), n.z() * u.y();
        const double largest = equations.of_line[k].cwiseAbs().maxCoeff();
        size *= largest * largest;
    }
    Coefficients q;
    for (int m = 0; m < samples; m++) {
        const Vector3d solution = equations.solve(std::cos(angle_of(m)), std::sin(angle_of(m)));
        q(m) = solution.head<2>().squaredNorm() - solution.z() * solution.z();
    }
    int start = 0;
    if (!(q.cwiseAbs().maxCoeff(&start) > degenerate * size))
        return true;
    Coefficients from_start;
    from_start << q.tail(samples - start), q.head(start);
    const Coefficients coefficients = interpolate * from_start;
    Eigen::Matrix<double, degree, degree> companion = Eigen::Matrix<double, degree, degree>::Zero();
    companion.row(0) = -coefficients.head<degree>().reverse().transpose() / coefficients(degree);
    companion.diagonal<-1>().setOnes();
    const auto roots = companion.eigenvalues().eval();
    for (int i = 0; i < degree; i++) {
        // A pair of complex roots counts as one, its nearest real rotation: noise turns the two solutions near a
        // singularity of the triplet into such a pair.
        if (!(roots(i).imag() >= 0.0))
            continue;
        const double beta = angle_of(start) + M_PI + std::atan2(2.0 * roots(i).real(), 1.0 - std::norm(roots(i)));
        const double cosine = std::cos(beta), sine = std::sin(beta);
        const Vector3d solution = equations.solve(cosine, sine);
        const double across = std::hypot(solution.x(), solution.y());
        if (!(across * across > degenerate * size))
            continue;
        const double scale = std::copysign(1.0 / across, solution.z());
        const double a = scale * solution.x(), b = scale * solution.y();
        Matrix3d middle;
        middle << a, -b * cosine, b * sine, b, a * cosine, -a * sine, 0.0, sine, cosine;
        rotations.push_back(image_frame.transpose() * middle * frame);
    }
    return false;
}

py::tuple triplet_rotations(const Stack<3, 3> &directions, const Stack<3, 3> &normals, const Interpolate &interpolate)
{
    require(directions.size() == normals.size(), "there must be normals for each triplet of directions");
    std::vector<Matrix3d> rotations;
    std::vector<Index> triplet;
    py::array_t<bool> continuum(directions.size());
    for (Index i = 0; i < directions.size(); i++) {
        continuum.mutable_at(i) = append_rotations(directions[i], normals[i], interpolate, rotations);
        triplet.resize(rotations.size(), i);
    }
    const Index count = rotations.size();
    py::array_t<double> stacked({count, Index(3), Index(3)});
    for (Index i = 0; i < count; i++)
        Eigen::Map<RowMajor<double, 3, 3>>(stacked.mutable_data() + 9 * i) = rotations[i];
    return py::make_tuple(stacked, py::array_t<Index>(count, triplet.data()), continuum);
}

py::array_t<double> translations(const Stack<3, 3> &rotation, const Vectors &normals, const Vectors &points)
{
    require(normals.rows() > 0 && normals.rows() == points.rows(), "there must be a point for each normal");
    // As it is the same for all rotations; where the planes leave a direction open, the component along it is zero.
    const Eigen::Matrix<double, 3, Dynamic> inverse =
        Eigen::CompleteOrthogonalDecomposition<Eigen::Matrix<double, Dynamic, 3>>(normals).pseudoInverse();
    Rows3 t(rotation.size(), 3);
    for (Index k = 0; k < rotation.size(); k++)
        t.row(k) = -inverse * (normals.array() * (points * rotation[k].transpose()).array()).rowwise().sum().matrix();
    return array_of(t);
}

}  // namespace

void bind_minimal_solver(py::module_ &module)
{
    module.def("triplet_rotations", &triplet_rotations);
    module.def("translations", &translations);
}

}  // namespace plsing
