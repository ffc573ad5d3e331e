// SPDX-License-Identifier: Apache-2.0
// Lines and poses: moved, projected, checked and aligned.
#include "lines.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>

#include "jacobi.hpp"
#include "line_rows.hpp"

namespace plsing {

void exponential(const Vector3d &omega, Matrix3d &turn, Matrix3d &jacobian)
{
    const double square = omega.squaredNorm();
    double a = 1.0 - square / 6.0, b = 0.5 - square / 24.0, c = 1.0 / 6.0 - square / 120.0;
    if (square > 1e-8) {
        const double angle = std::sqrt(square), sine_of_half = std::sin(0.5 * angle);
        a = std::sin(angle) / angle;
        // 1 - cos(angle) would cancel.
        b = 2.0 * sine_of_half * sine_of_half / square;
        c = (angle - std::sin(angle)) / (square * angle);
    }
    const Matrix3d cross = skew(omega), squared = cross * cross, one = Matrix3d::Identity();
    turn = one + a * cross + b * squared;
    jacobian = one + b * cross + c * squared;
}

Pose exponential(const Vector6d &step)
{
    Matrix3d turn, jacobian;
    exponential(step.tail<3>(), turn, jacobian);
    return {turn, jacobian * step.head<3>()};
}

Lines in_frame(const Rows3Ref &direction, const Rows3Ref &moment, const Pose &T_a_b)
{
    // Row by row, (t cross u)' is u' times the transpose of [t]x.
    return {direction * T_a_b.rotation,
            (moment + direction * skew(T_a_b.translation)) * T_a_b.rotation};
}

bool fill_rows(const Rows3Ref &direction, const Rows3Ref &moment, double min_depth, Tall &rows)
{
    require(direction.rows() == moment.rows(), "there must be a moment for each direction");
    rows.resize(2 * direction.rows(), 6);
    for (Index i = 0; i < direction.rows(); i++) {
        const Vector3d l = moment.row(i);
        const double depth = std::hypot(l.x(), l.y());
        if (!has_image(l, depth, min_depth))
            return false;
        fill_line_rows(direction.row(i), l, depth, rows, i);
    }
    return true;
}

Tall expand(const Rows3Ref &moment, const Tall &rows)
{
    Tall matrix(3 * moment.rows(), rows.cols());
    for (Index i = 0; i < moment.rows(); i++) {
        const double depth = std::hypot(moment(i, 0), moment(i, 1));
        matrix.row(3 * i) = -moment(i, 1) / depth * rows.row(2 * i);
        matrix.row(3 * i + 1) = moment(i, 0) / depth * rows.row(2 * i);
        matrix.row(3 * i + 2) = rows.row(2 * i + 1);
    }
    return matrix;
}

Eigen::VectorXd reduce(const Rows3Ref &moment, const Eigen::Ref<const Eigen::VectorXd> &values)
{
    Eigen::VectorXd two(2 * moment.rows());
    for (Index i = 0; i < moment.rows(); i++) {
        const double depth = std::hypot(moment(i, 0), moment(i, 1));
        two(2 * i) = (moment(i, 0) * values(3 * i + 1) - moment(i, 1) * values(3 * i)) / depth;
        two(2 * i + 1) = values(3 * i + 2);
    }
    return two;
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

// As _PARALLEL in geometry/line_alignment.py.
constexpr double min_spread = 1e-6;
// Of the pivots of the normal equations of a translation: the square of a ratio of singular values.
constexpr double parallel = 1e-15;
// Of two lines, from which on it is more than rounding.
constexpr double min_misfit = 1e-12;
// Squared standard deviations up to which what two lines are off by is noise, and no exchange.
constexpr double max_noise = 25.0;

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

// The pose of a camera that sees lines: the rotation that brings directions together best (Kabsch), and the translation
// of least squares for it.
struct Alignment {
    bool is_fixed = false;  // Whether anything but `spread` is of use.
    Pose pose;
    // Second singular value of the directions' correlation; least cosine between a direction and the seen one; root mean
    // square misfit of the moments.
    double spread = 0.0, min_cosine = 1.0, offset = 0.0;
};

Alignment align(const Rows3Ref &direction, const Rows3Ref &moment, const Rows3Ref &seen_direction,
                const Rows3Ref &seen_moment)
{
    const Index n = direction.rows();
    Alignment found;
    const Matrix3d correlation = direction.transpose() * seen_direction;
    if (!correlation.allFinite())
        return found;
    const JacobiSvd<3> svd(correlation);
    found.spread = svd.values(1);
    // The third pair follows from the others by the rule of the right hand.
    Matrix3d left = svd.left, right = svd.right;
    left.col(2) = left.col(0).cross(left.col(1));
    right.col(2) = right.col(0).cross(right.col(1));
    found.pose.rotation = left * right.transpose();
    // t x u = l - R l_seen, three equations for each line.
    Rows3 misfit = moment - seen_moment * found.pose.rotation.transpose();
    if (!misfit.allFinite())
        return found;
    Matrix3d normal = Matrix3d::Zero();
    for (Index i = 0; i < n; i++) {
        const Vector3d u = direction.row(i);
        found.min_cosine = std::min(found.min_cosine, u.dot(found.pose.rotation * seen_direction.row(i).transpose()));
        normal += u.squaredNorm() * Matrix3d::Identity() - u * u.transpose();
    }
    const Eigen::LDLT<Matrix3d> solver(normal);
    // Lines that are parallel to rounding leave the translation along them open.
    if (!(solver.vectorD().minCoeff() > parallel * static_cast<double>(n)))
        return found;
    // The second step takes away what the squares in `normal` cost of accuracy.
    for (int step = 0; step < 2; step++) {
        Vector3d right_side = Vector3d::Zero();
        for (Index i = 0; i < n; i++) right_side += direction.row(i).cross(misfit.row(i));
        const Vector3d moved = solver.solve(right_side);
        found.pose.translation += moved;
        for (Index i = 0; i < n; i++) misfit.row(i) -= moved.cross(direction.row(i).transpose());
    }
    found.offset = misfit.norm() / std::sqrt(static_cast<double>(n));
    found.is_fixed = true;
    return found;
}

py::object align_lines(const Vectors &direction, const Vectors &moment, const Vectors &seen_direction,
                       const Vectors &seen_moment)
{
    const Index n = direction.rows();
    require(n > 0 && moment.rows() == n && seen_direction.rows() == n && seen_moment.rows() == n,
            "there must be n lines in each");
    const Alignment found = align(direction, moment, seen_direction, seen_moment);
    if (!found.is_fixed)
        return py::none();
    return py::make_tuple(array_of(found.pose.rotation), array_of(found.pose.translation), found.spread,
                          found.min_cosine, found.offset);
}

// Whether image lines and 3-D lines are certain to agree with each other, with the lines of a scene if there are any, and
// with where these put the camera, each misfit being within its bound; 2 if, besides, no two lines hold so much of the
// misfit of the images that exchanging them could leave the share `frame_ratio` of it.
int are_consistent(const Vectors &image_lines, const Vectors &direction, const Vectors &moment,
                    const Vectors &scene_direction, const Vectors &scene_moment, double min_image_cosine,
                    double min_cosine, double max_offset, const View<3, 3> &rotation, const View<3> &translation,
                    double min_turn_cosine, double max_distance, double frame_ratio)
{
    const Index n = image_lines.rows(), expected = scene_direction.rows();
    require(direction.rows() == n && moment.rows() == n && scene_moment.rows() == expected &&
                (expected == n || expected == 0),
            "there must be n lines in each, or none of the scene");
    double total = 0.0, worst = 0.0, second = 0.0;
    for (Index i = 0; i < n; i++) {
        const double size = std::sqrt(image_lines.row(i).squaredNorm() * moment.row(i).squaredNorm());
        const double product = image_lines.row(i).dot(moment.row(i));
        if (!(product > min_image_cosine * size))
            return 0;
        const double misfit = 2.0 - 2.0 * product / size;
        total += misfit;
        second = std::max(second, std::min(worst, misfit));
        worst = std::max(worst, misfit);
    }
    const int good = total > min_misfit && total - worst - second < frame_ratio * total ? 1 : 2;
    if (expected == 0)
        return good;
    const Alignment found = align(scene_direction, scene_moment, direction, moment);
    const double turn_cosine = 0.5 * (found.pose.rotation.cwiseProduct(rotation).sum() - 1.0);
    const bool agree = found.is_fixed && found.spread >= min_spread && found.min_cosine >= min_cosine &&
                       found.offset * std::sqrt(static_cast<double>(n)) <= max_offset &&
                       turn_cosine >= min_turn_cosine && (found.pose.translation - translation).norm() <= max_distance;
    return agree ? good : 0;
}

py::object exchanged_pair(const Vectors &image_lines, const Vectors &moment, const Vectors &covariances, double map_std,
                          double min_cosine, double log_ratio, double pair_ratio, double frame_ratio)
{
    const Eigen::Index n = image_lines.rows();
    const bool known = covariances.rows() != 0;
    require(moment.rows() == n && (!known || covariances.rows() == n), "there must be a moment for each line");
    const auto apart = [](const Vector3d &a, const Vector3d &b) { return (a - b).squaredNorm(); };
    double total = 0.0;
    struct Line { Vector3d normal, direction, seen, expected, variance; };
    std::vector<Line> lines;
    lines.reserve(n);
    for (Eigen::Index i = 0; i < n; i++) {
        const Vector3d own = moment.row(i), seen = image_lines.row(i);
        const double depth = std::hypot(own[0], own[1]);
        lines.push_back({own / own.norm(), seen / seen.norm(), seen, own / depth, Vector3d::Zero()});
        total += apart(lines.back().direction, lines.back().normal);
        if (!known) continue;
        const Vector3d each = covariances.row(i);
        // Of the ends of the piece that is seen, which the image has with this variance.
        const double ends = 2.0 * (each[2] - each[1] * each[1] / each[0]), share = map_std / depth;
        lines.back().variance = each * (1.0 + share * share / ends);
    }
    const auto turn = [](auto &a, auto &b) { return std::atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]); };
    py::object found = py::none();
    double most = 1.0;
    for (Eigen::Index i = 0; i < n; i++)
        for (Eigen::Index j = i + 1; j < n; j++) {
            const Line &one = lines[i], &other = lines[j];
            if (!(one.normal.dot(other.normal) > min_cosine)) continue;
            const double own = apart(one.direction, one.normal) + apart(other.direction, other.normal);
            const double swapped = apart(one.direction, other.normal) + apart(other.direction, one.normal);
            const double x = turn(other.seen, one.seen), y = one.seen[2] - other.seen[2];
            const double x0 = turn(other.expected, one.expected), y0 = one.expected[2] - other.expected[2];
            const Vector3d s = one.variance + other.variance;
            // d' S^-1 d0 |S| for S = (s[0] s[1]; s[1] s[2]).
            const double product = s[2] * x * x0 - s[1] * (x * y0 + y * x0) + s[0] * y * y0;
            const double dx = x - x0, dy = y - y0, square = s[2] * dx * dx - 2.0 * s[1] * dx * dy + s[0] * dy * dy;
            const bool explains = total - own + swapped < frame_ratio * total && own > min_misfit &&
                                  !(known && square < max_noise * (s[0] * s[2] - s[1] * s[1]));
            const double score = std::max(explains ? pair_ratio * own / swapped : 0.0,
                                          known ? -2.0 * product / (log_ratio * (s[0] * s[2] - s[1] * s[1])) : 0.0);
            if (!(score > most)) continue;
            most = score;
            found = py::make_tuple(i, j);
        }
    return found;
}

}  // namespace

void bind_lines(py::module_ &module)
{
    module.def("are_lines", &are_lines);
    module.def("are_image_lines", &are_image_lines);
    module.def("have_images", &have_images);
    module.def("is_rotation", &is_rotation);
    module.def("align_lines", &align_lines);
    module.def("are_consistent", &are_consistent);
    module.def("exchanged_pair", &exchanged_pair);
}

}  // namespace plsing
