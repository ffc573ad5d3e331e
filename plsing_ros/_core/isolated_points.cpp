// SPDX-License-Identifier: Apache-2.0
// The ten isolated singularities of four lines: singularities/isolated_points.py says how.
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/QR>
#include <array>
#include <cmath>
#include <limits>

#include "singularity.hpp"

namespace plsing {
namespace {

constexpr int lines = 4, points = 10, monomials = 15;  // of degree 4 in three variables
// Last pivot of the equations of a centre, relative to the one before, from which they leave it free along a line: the
// axis direction is that of a curve of singular centres.
constexpr double ambiguous = 1e-3;

using Lines4 = Eigen::Matrix<double, lines, 3>;
using Functionals = Eigen::Matrix<double, points, monomials>;
using Matrix10 = Eigen::Matrix<double, points, points>;
using Samples = View<monomials, 3>;
using Interpolate = View<monomials, monomials>;
using Multiply = Stack<points, monomials>;

// Fill orthonormal rows that are orthogonal to the columns of a matrix, as many as are left, and return its diagonal's
// smallest over largest element after triangularisation.
template <int Rows, int Columns>
double complement(const Eigen::Matrix<double, Rows, Columns> &matrix,
                  Eigen::Matrix<double, Rows - Columns, Rows> &rows)
{
    const Eigen::HouseholderQR<Eigen::Matrix<double, Rows, Columns>> qr(matrix);
    const Eigen::Matrix<double, Rows, Rows> orthogonal = qr.householderQ();
    rows = orthogonal.template rightCols<Rows - Columns>().transpose();
    const auto diagonal = qr.matrixQR().diagonal().cwiseAbs().eval();
    const double largest = diagonal.template maxCoeff<Eigen::PropagateNaN>();
    return largest == 0.0 ? 0.0 : diagonal.template minCoeff<Eigen::PropagateNaN>() / largest;
}

// Fill the functionals that vanish on the five quartics; return the rank margin.
//
// For each force of an orthonormal basis of those across their lines in balance and without virial there are five
// equations, linear in the axis direction. The quartics are their 4 x 4 minors.
double fill_functionals(const Lines4 &u, const Lines4 &point, const Samples &samples, const Interpolate &interpolate,
                        Functionals &functionals)
{
    Eigen::Matrix<double, 3 * lines, 8> constraints = Eigen::Matrix<double, 3 * lines, 8>::Zero();
    for (int i = 0; i < lines; i++) {
        constraints.block<3, 1>(3 * i, i) = u.row(i);
        constraints.block<3, 3>(3 * i, 4).setIdentity();
        constraints.block<3, 1>(3 * i, 7) = point.row(i);
    }
    Eigen::Matrix<double, 4, 3 * lines> forces;
    complement(constraints, forces);
    std::array<Eigen::Matrix<double, 5, 3>, 4> equations;
    for (int f = 0; f < 4; f++) {
        equations[f].row(4).setZero();
        for (int i = 0; i < lines; i++) {
            const Vector3d direction = u.row(i), force = forces.block<1, 3>(f, 3 * i);
            equations[f].row(i) = direction.cross(force);
            equations[f].row(4) += force.dot(direction.cross(Vector3d(point.row(i)))) * direction.transpose();
        }
    }
    Eigen::Matrix<double, monomials, 5> values;
    for (int s = 0; s < monomials; s++) {
        Eigen::Matrix<double, 4, 5> at;
        for (int f = 0; f < 4; f++)
            at.row(f) = equations[f] * samples.row(s).transpose();
        for (int left_out = 0; left_out < 5; left_out++) {
            Eigen::Matrix4d minor;
            minor << at.leftCols(left_out), at.rightCols(4 - left_out);
            values(s, left_out) = minor.determinant();
        }
    }
    return complement<monomials, 5>(interpolate * values, functionals);
}

template <typename Scalar>
using Vector3 = Eigen::Matrix<Scalar, 3, 1>;
template <typename Scalar>
using Vector4 = Eigen::Matrix<Scalar, 4, 1>;

// The axis direction of an eigenvector: of w times each cubic monomial at w, the largest.
template <typename Scalar>
Vector3<Scalar> axis_of(const Eigen::Matrix<Scalar, points, 1> &vector, const Functionals &functionals,
                        const Multiply &multiply)
{
    const Eigen::Matrix<Scalar, monomials, 1> values = functionals.transpose() * vector;
    Eigen::Matrix<Scalar, points, 3> products;
    for (int axis = 0; axis < 3; axis++)
        products.col(axis) = multiply[axis] * values;
    Index row, column;
    const double largest = products.cwiseAbs().maxCoeff(&row, &column);
    if (!(largest > 0.0))
        return Vector3<Scalar>::Zero();
    return products.row(row).transpose() / largest;
}

// The homogeneous centre (C_0, C) of an axis direction, of unit length: P_i w . (M_i - C) = 0 for each line; zero where
// that leaves more than one.
template <typename Scalar>
Vector4<Scalar> center_of(const Lines4 &u, const Lines4 &point, const Vector3<Scalar> &w)
{
    Eigen::Matrix<Scalar, lines, 4> rows;
    rows.template rightCols<3>() = w.transpose().replicate(lines, 1) - (u * w).asDiagonal() * u;
    rows.col(0) = -rows.template rightCols<3>().cwiseProduct(point).rowwise().sum();
    const Eigen::FullPivLU<Eigen::Matrix<Scalar, lines, 4>> lu(rows);
    const auto &upper = lu.matrixLU();
    if (!(std::abs(upper(3, 3)) < ambiguous * std::abs(upper(2, 2))))
        return Vector4<Scalar>::Zero();
    // Singular but for rounding, which is the last pivot.
    Vector4<Scalar> x = Vector4<Scalar>::Ones();
    x.template head<3>() = upper.template topLeftCorner<3, 3>().template triangularView<Eigen::Upper>().solve(
        -upper.template block<3, 1>(0, 3));
    return lu.permutationQ() * x.normalized();
}

// What is said of a scene's ten points; compiled.pyi has the names.
struct Found {
    Eigen::Map<RowMajor<Complex, points, 3>> w, center;
    Eigen::Map<RowMajor<Complex, points, 4>> h;
    Eigen::Map<Eigen::Matrix<double, points, 1>> residual;
    double on_line, merged, at_infinity;

    template <typename Scalar>
    void fill(int i, const Eigen::Matrix<Scalar, points, 1> &vector, const Lines4 &u, const Lines4 &point,
              const Functionals &functionals, const Multiply &multiply)
    {
        const Vector3<Scalar> axis = axis_of(vector, functionals, multiply);
        const Vector4<Scalar> homogeneous = center_of<Scalar>(u, point, axis);
        w.row(i) = axis.transpose().template cast<Complex>();
        h.row(i) = homogeneous.transpose().template cast<Complex>();
        if (!(std::abs(homogeneous(0)) > at_infinity))
            return;
        const Vector3<Scalar> finite = homogeneous.template tail<3>() / homogeneous(0);
        center.row(i) = finite.transpose().template cast<Complex>();
        const Singularity found = singularity_at(u, point, center.row(i).transpose(), on_line);
        // On an observed line, or merged with it, it is a singularity of another kind.
        if (found.distance > on_line && found.ratio <= merged * found.distance)
            residual(i) = found.ratio;
    }
};

py::tuple isolated_points(const Stack<lines, 3> &direction, const Stack<lines, 3> &point, const View<2, 3> &forms,
                          const Samples &samples, const Interpolate &interpolate, const Multiply &multiply,
                          double on_line, double merged, double at_infinity)
{
    const Index scenes = direction.size();
    require(point.size() == scenes && multiply.size() == 3, "there must be a point on each line, and three maps");
    py::array_t<Complex> w({scenes, Index(points), Index(3)}), h({scenes, Index(points), Index(4)});
    py::array_t<Complex> center({scenes, Index(points), Index(3)});
    py::array_t<double> residual({scenes, Index(points)});
    Eigen::VectorXd margin(scenes);
    for (Index s = 0; s < scenes; s++) {
        Found found{{w.mutable_data(s), points, 3}, {center.mutable_data(s), points, 3},
                    {h.mutable_data(s), points, 4}, {residual.mutable_data(s), points, 1}, on_line, merged,
                    at_infinity};
        found.w.setZero();
        found.h.setZero();
        found.center.setConstant(std::numeric_limits<double>::quiet_NaN());
        found.residual.setOnes();
        const Lines4 u = direction[s], m = point[s];
        Functionals functionals;
        margin(s) = fill_functionals(u, m, samples, interpolate, functionals);
        // Multiplication by one linear form over another on the space of functionals.
        Matrix10 of_form[2];
        for (int form = 0; form < 2; form++)
            of_form[form] = (forms(form, 0) * multiply[0] + forms(form, 1) * multiply[1] + forms(form, 2) * multiply[2]) *
                            functionals.transpose();
        const Matrix10 quotient = of_form[1].partialPivLu().solve(of_form[0]);
        if (!quotient.allFinite())
            continue;
        const Eigen::EigenSolver<Matrix10> solver(quotient);
        if (solver.info() != Eigen::Success)
            continue;
        const auto &values = solver.eigenvalues();
        const Eigen::Matrix<Complex, points, points> vectors = solver.eigenvectors();
        for (int i = 0; i < points; i++)
            if (values(i).imag() == 0.0)
                found.fill<double>(i, vectors.col(i).real(), u, m, functionals, multiply);
            else if (values(i).imag() > 0.0)
                found.fill<Complex>(i, vectors.col(i), u, m, functionals, multiply);
            else {
                // The conjugate of the one before.
                found.w.row(i) = found.w.row(i - 1).conjugate();
                found.h.row(i) = found.h.row(i - 1).conjugate();
                found.center.row(i) = found.center.row(i - 1).conjugate();
                found.residual(i) = found.residual(i - 1);
            }
    }
    return py::make_tuple(center, h, w, residual, array_of(margin));
}

}  // namespace

void bind_isolated_points(py::module_ &module)
{
    module.def("isolated_points", &isolated_points);
}

}  // namespace plsing
