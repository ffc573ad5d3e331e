// SPDX-License-Identifier: Apache-2.0
// What a monitor asks in every cycle: distances to loci, the closest approach, and a step of the law ahead.
#include <cmath>
#include <limits>

#include "lines.hpp"

namespace plsing {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

// Direction and moment of n lines as one array (2, n, 3).
py::array_t<double> stacked(const Lines &lines)
{
    const Index n = lines.direction.rows();
    py::array_t<double> both({Index(2), n, Index(3)});
    Eigen::Map<Rows3>(both.mutable_data(), n, 3) = lines.direction;
    Eigen::Map<Rows3>(both.mutable_data() + 3 * n, n, 3) = lines.moment;
    return both;
}

py::object step_law(const Stack<Dynamic, 3> &lines, const Vectors &target_image, const View<6> &twist,
                    double duration, double gain, double min_depth, double max_speed)
{
    require(lines.size() == 2 && lines.rows() > 1 && target_image.rows() == lines.rows(),
            "there must be direction and moment of the same lines, two or more, as there are image lines");
    const Lines moved = in_frame(lines[0], lines[1], exponential(twist * duration));
    Tall rows;
    if (!fill_rows(moved.direction, moved.moment, min_depth, rows))
        return py::none();
    const Svd decomposed(rows);
    if (!decomposed.has_full_rank())
        return py::none();
    const Eigen::VectorXd error = reduce(moved.moment, image_error(moved.moment, target_image));
    const Vector6d next = -decomposed.solve(decomposed.components(error));
    if (!(next.norm() < max_speed))
        return py::none();
    return py::make_tuple(stacked(moved), array_of(gain * next));
}

py::tuple compare_lines(const Vectors &direction, const Vectors &moment, const View<3, 3> &rotation,
                        const View<3> &translation, const Vectors &seen_direction, const Vectors &seen_moment)
{
    const Index n = direction.rows();
    require(moment.rows() == n && seen_direction.rows() == n && seen_moment.rows() == n,
            "there must be n lines in each");
    const Lines expected = in_frame(direction, moment, {rotation, translation});
    return py::make_tuple(stacked(expected),
                          stacked({seen_direction - expected.direction, seen_moment - expected.moment}));
}

py::object pose_covariance(const View<6, 6> &values)
{
    const Matrix6d symmetric = 0.5 * (values + values.transpose());
    if (!symmetric.allFinite() || symmetric.isZero(0.0)) return py::none();
    // Rounding may leave a variance just below zero.
    const Matrix6d lifted = symmetric + 1e-9 * Matrix6d::Identity();
    if (Eigen::LLT<Matrix6d>(lifted).info() != Eigen::Success) return py::none();
    return array_of(symmetric);
}

double image_deviation(const Vectors &moment, const Vectors &image_lines)
{
    require(moment.rows() == image_lines.rows(), "there must be an image line for each moment");
    return image_error(moment, image_lines).squaredNorm();
}

py::tuple closest_points(const Vectors &point, const Vectors &direction, const View<3> &center)
{
    require(point.rows() == direction.rows(), "there must be a point for each direction");
    Rows3 closest = point;
    for (Index i = 0; i < point.rows(); i++)
        closest.row(i) += (center.transpose() - point.row(i)).dot(direction.row(i)) * direction.row(i);
    const Eigen::VectorXd distance = (closest.rowwise() - center.transpose()).rowwise().norm();
    return py::make_tuple(array_of(closest), array_of(distance));
}

py::tuple closest_approach(const Vectors &closest, const Values &distance, const Vectors &direction,
                           const Values &role, const View<3, 3> &rotation, const View<3> &center,
                           const View<6> &twist, double horizon, double at_rest, double along_share)
{
    const Index k = closest.rows();
    require(distance.size() == k && direction.rows() == k && role.size() == k, "there must be k loci in each");
    const Vector3d velocity = rotation * twist.head<3>();
    const double speed = velocity.norm();
    double nearest = std::numeric_limits<double>::infinity(), least = nearest;
    double nearest_time = nan, nearest_rate = nan, time_ahead = nan;
    Index row = -1;
    for (Index i = 0; i < k && speed >= at_rest; i++) {
        if (role(i) < 0.0)
            continue;
        // Only what moves the camera across a locus changes its distance, and the path to the closest point is across.
        const double closing = (closest.row(i) - center.transpose()).dot(velocity);
        const double rate = closing / std::max(distance(i), 1e-300), along = direction.row(i).dot(velocity);
        // To a plane the distance changes along its normal only.
        const double square = role(i) == 1.0 ? rate * rate : speed * speed - along * along;
        const bool across = square > along_share * speed * along_share * speed;
        const double time = across ? closing / square : nan;
        // Pythagoras: of the offset, what the motion does not close.
        const double rest = distance(i) * distance(i) - time * closing;
        if (distance(i) < nearest) {
            nearest = distance(i);
            nearest_time = time;
            nearest_rate = across ? rate / speed : nan;
        }
        if (time > 0.0 && time <= horizon && rest < least) {
            least = rest;
            time_ahead = time;
            row = i;
        }
    }
    const double distance_ahead = row < 0 ? nan : std::sqrt(std::max(least, 0.0));
    return py::make_tuple(row, nearest_time, nearest_rate, time_ahead, distance_ahead);
}

}  // namespace

void bind_monitoring(py::module_ &module)
{
    module.def("step_law", &step_law);
    module.def("compare_lines", &compare_lines);
    module.def("image_deviation", &image_deviation);
    module.def("pose_covariance", &pose_covariance);
    module.def("closest_points", &closest_points);
    module.def("closest_approach", &closest_approach);
}

}  // namespace plsing
