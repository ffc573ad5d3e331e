// SPDX-License-Identifier: Apache-2.0
#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <stdexcept>

#include "core.hpp"
#include "rollout.hpp"

namespace plsing {

namespace {

using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;

double number(const py::object &from, const char* name) { return from.attr(name).cast<double>(); }

template <typename Enum>
Enum choice(const std::string &given, std::initializer_list<std::pair<const char*, Enum>> known)
{
    for (const auto& [name, value] : known)
        if (given == name) return value;
    throw std::invalid_argument("unknown choice '" + given + "'");
}

Pose pose_from(const py::object &from)
{
    // T_scene_camera as a Pose: rotation (3, 3), translation (3,).
    return {from.attr("rotation").cast<Matrix3d>(), from.attr("translation").cast<Vector3d>()};
}

LawOptions law_from(const py::object &from)
{
    LawOptions law;
    const auto name = from.attr("law").cast<std::string>();
    law.law = choice<Law>(name, {{"pinv", Law::kPinv},
                                 {"dls", Law::kDls},
                                 {"adaptive_dls", Law::kAdaptiveDls},
                                 {"guarded", Law::kGuarded},
                                 {"position", Law::kPosition},
                                 {"fused", Law::kPosition},
                                 {"detour", Law::kPath}});
    law.inverted = choice<Inverted>(
        from.attr("interaction").cast<std::string>(),
        {{"current", Inverted::kCurrent}, {"target", Inverted::kTarget}, {"mean", Inverted::kMean}});
    const auto used = from.attr("degrees_of_freedom").cast<std::vector<int>>();
    if (used.size() != 6) throw std::invalid_argument("degrees_of_freedom must have 6 values");
    law.columns = 0;
    for (int j = 0; j < 6; j++) law.columns += law.used[j] = used[j] != 0;
    if (law.columns == 0) throw std::invalid_argument("no degree of freedom is in use");
    law.gain = number(from, "gain");
    law.gain_slope = number(from, "gain_slope");
    law.gain_at_infinity = number(from, "gain_at_infinity");
    law.threshold = number(from, "pinv_threshold");
    law.damping = number(from, "damping");
    law.onset = number(from, "onset");
    law.max_damping = number(from, "max_damping");
    law.margin = number(from, "guard_margin");
    law.floor = number(from, "guard_floor");
    law.unobservable_share = number(from, "guard_unobservable_share");
    law.max_linear = number(from, "max_linear_speed");
    law.max_angular = number(from, "max_angular_speed");
    return law;
}

Loop loop_from(const py::object &from)
{
    Loop loop;
    loop.period = number(from, "period");
    loop.later_period = std::max(number(from, "later_period"), loop.period);
    loop.latency = from.attr("latency").cast<int>();
    loop.jitter = number(from, "jitter");
    loop.lag = number(from, "lag");
    loop.robot_linear = number(from, "robot_linear_speed");
    loop.robot_angular = number(from, "robot_angular_speed");
    loop.demand_linear = number(from, "demand_linear_speed");
    loop.demand_angular = number(from, "demand_angular_speed");
    loop.image_noise = number(from, "image_noise");
    loop.position_noise = number(from, "position_noise");
    loop.rotation_noise = number(from, "rotation_noise");
    loop.map_noise = number(from, "map_noise");
    loop.focal_error = number(from, "focal_error");
    loop.dropped_frames = number(from, "dropped_frames");
    loop.dropped_lines = number(from, "dropped_lines");
    const auto half_view = from.attr("half_view").cast<std::vector<double>>();
    if (half_view.size() != 2) throw std::invalid_argument("half_view must have 2 values");
    loop.tan_x = half_view[0];
    loop.tan_y = half_view[1];
    loop.near = number(from, "near");
    loop.min_length = number(from, "min_length");
    loop.path_linear = number(from, "path_linear_speed");
    loop.path_angular = number(from, "path_angular_speed");
    loop.horizon = number(from, "horizon");
    loop.stops = from.attr("stops").cast<bool>();
    loop.pose_error_lasts = from.attr("pose_error_lasts").cast<bool>();
    if (!(loop.period > 0.0 && loop.horizon / loop.period <= 1e7 && loop.latency >= 0 && loop.latency <= 1000))
        throw std::invalid_argument("period, horizon or latency is out of range");
    return loop;
}

Scene scene_from(const Rows3 &direction, const Rows3 &moment, const Rows3 &ends, const Pose &target,
                 const Array &covariances, const LawOptions &law)
{
    const auto n = static_cast<std::size_t>(direction.rows());
    if (static_cast<std::size_t>(moment.rows()) != n || static_cast<std::size_t>(ends.rows()) != 2 * n || n < 3)
        throw std::invalid_argument("lines: at least 3 directions, as many moments, and twice as many ends");
    if (covariances.size() != 0 && static_cast<std::size_t>(covariances.size()) != 3 * n)
        throw std::invalid_argument("covariances must be empty, or 3 numbers a line");
    Scene scene;
    scene.target = target;
    scene.has_covariances = covariances.size() != 0;
    const Matrix3d R = target.rotation.transpose();
    Rows rows(2, 6);
    for (std::size_t i = 0; i < n; i++) {
        SceneLine line;
        line.direction = direction.row(i);
        line.moment = moment.row(i);
        line.ends[0] = ends.row(2 * i);
        line.ends[1] = ends.row(2 * i + 1);
        const Vector3d u = R * line.direction, l = R * (line.moment - target.translation.cross(line.direction));
        const double depth = image_depth(l);
        line.in_target = has_image(l, depth, min_depth);
        if (line.in_target) {
            line.target_image = l / depth;
            fill_line_rows(u, l, depth, rows, 0);
            for (int j = 0; j < 6; j++)
                if (!law.used[j]) rows.col(j).setZero();
            line.target_rows = rows;
        }
        if (scene.has_covariances) {
            // Lower Cholesky factor of [[pp, pr], [pr, rr]].
            const double pp = covariances.data()[3 * i], pr = covariances.data()[3 * i + 1];
            const double rr = covariances.data()[3 * i + 2];
            line.noise[0] = std::sqrt(std::max(pp, 0.0));
            line.noise[1] = line.noise[0] > 0.0 ? pr / line.noise[0] : 0.0;
            line.noise[2] = std::sqrt(std::max(rr - line.noise[1] * line.noise[1], 0.0));
        }
        scene.lines.push_back(line);
    }
    return scene;
}

// Rows of what was seen of each line: residual (phi, rho) and the covariance of that mean (pp, pr, rr), NaN where nothing was.
void add_residuals(Scene &scene, const py::object &residuals)
{
    if (residuals.is_none()) return;
    const auto rows = residuals.cast<Eigen::Matrix<double, Eigen::Dynamic, 5, Eigen::RowMajor>>();
    if (static_cast<std::size_t>(rows.rows()) != scene.lines.size())
        throw std::invalid_argument("residuals must be one row a line");
    for (Eigen::Index i = 0; i < rows.rows(); i++) {
        SceneLine &line = scene.lines[i];
        line.has_residual = rows.row(i).allFinite();
        line.residual = rows.row(i).head<2>().transpose();
        line.residual_noise << rows(i, 2), rows(i, 3), rows(i, 3), rows(i, 4);
    }
}

void add_loci(Scene &scene, const py::object &loci)
{
    if (loci.is_none()) return;
    // Rows of a point and a direction.
    const auto rows = loci.cast<Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::RowMajor>>();
    for (Eigen::Index i = 0; i < rows.rows(); i++)
        scene.loci.push_back({rows.row(i).head<3>().transpose(), rows.row(i).tail<3>().transpose()});
    scene.has_loci = true;
}

bool is_without_noise(const Scene &scene, const Loop &loop)
{
    for (double each : {loop.image_noise, loop.position_noise, loop.rotation_noise, loop.map_noise, loop.focal_error,
                        loop.dropped_frames, loop.dropped_lines, loop.jitter})
        if (each > 0.0) return false;
    return !scene.has_covariances;
}

py::dict roll_out_all(const Rows3 &direction, const Rows3 &moment, const Rows3 &ends,
                      const py::object &target, const Array &covariances, const py::object &residuals,
                      const py::object &believed, const py::object &loci, const py::sequence &path,
                      const py::object &law_options, const py::object &loop_model, const py::object &state,
                      const Array &rotations, const Rows3 &translations, std::uint64_t seed)
{
    const LawOptions law = law_from(law_options);
    Loop loop = loop_from(loop_model);
    loop.deadline = number(state, "deadline");
    loop.elapsed = number(state, "elapsed");
    loop.start_distance = number(state, "start_distance");
    loop.first_linear = number(state, "first_linear_speed");
    loop.first_angular = number(state, "first_angular_speed");
    loop.arrived_for = number(state, "arrived_for");
    const py::object answer = state.attr("answer");
    if (!answer.is_none()) loop.answer = answer.cast<Vector6d>();
    const auto motion = state.attr("motion").cast<Vector6d>(), command = state.attr("command").cast<Vector6d>();
    Scene scene = scene_from(direction, moment, ends, pose_from(target), covariances, law);
    add_loci(scene, loci);
    add_residuals(scene, residuals);
    for (const auto &each : path) scene.path.push_back(pose_from(py::reinterpret_borrow<py::object>(each)));
    const Eigen::Index k = translations.rows();
    if (rotations.size() != 9 * k) throw std::invalid_argument("rotations must be (k, 3, 3) for k translations");
    std::vector<Pose> starts(k);
    for (Eigen::Index i = 0; i < k; i++) {
        using RowMajorMatrix = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
        starts[i].rotation = Eigen::Map<const RowMajorMatrix>(rotations.data() + 9 * i);
        starts[i].translation = translations.row(i);
    }
    std::vector<Outcome> outcomes(k);
    const Pose here = believed.is_none() && k > 0 ? starts[0] : pose_from(believed);
    {
        py::gil_scoped_release without_interpreter;
        weigh_residuals(scene, loop, here);
        const bool is_exact = is_without_noise(scene, loop);
        for (Eigen::Index i = 0; i < k; i++) {
            if (is_exact && i > 0 && starts[i].rotation == starts[0].rotation &&
                starts[i].translation == starts[0].translation) {
                // Nothing tells this sample from the first one.
                outcomes[i] = outcomes[0];
                outcomes[i].steps = 0;
                continue;
            }
            const auto own_seed = seed + 7919u * static_cast<std::uint64_t>(i);
            outcomes[i] = roll_out(scene, law, loop, starts[i], here, motion, command, own_seed);
        }
    }
    Eigen::VectorXi kind(k);
    Eigen::VectorXd harm_time(k), demand(k), demand_time(k), speed(k), distance(k), angle(k);
    Eigen::VectorXd first_linear(k), first_angular(k), mean_square(k);
    std::int64_t steps = 0;
    for (Eigen::Index i = 0; i < k; i++) {
        const Outcome &each = outcomes[i];
        kind[i] = each.kind;
        harm_time[i] = each.harm_time;
        demand[i] = each.demand;
        demand_time[i] = each.demand_time;
        speed[i] = each.speed;
        distance[i] = each.distance;
        angle[i] = each.angle;
        first_linear[i] = each.first_linear;
        first_angular[i] = each.first_angular;
        mean_square[i] = each.mean_square;
        steps += each.steps;
    }
    py::dict result;
    result["kind"] = kind;
    result["harm_time"] = harm_time;
    result["demand"] = demand;
    result["demand_time"] = demand_time;
    result["speed"] = speed;
    result["distance"] = distance;
    result["angle"] = angle;
    result["first_linear_speed"] = first_linear;
    result["first_angular_speed"] = first_angular;
    result["mean_square_distance"] = mean_square;
    result["steps"] = steps;
    return result;
}

// The twist of the law for image lines, rows of zeros where a line is not detected, or for what an undisturbed camera
// sees if there are none: for comparison with the controller.
Vector6d compute_rollout_twist(const Rows3 &direction, const Rows3 &moment, const Rows3 &ends, const py::object &target,
                               const py::object &loci, const py::object &law_options, const py::object &loop_model,
                               const py::object &camera, const Rows3 &image)
{
    if (image.rows() != 0 && image.rows() != direction.rows())
        throw std::invalid_argument("image lines must be none, or one row a line");
    const LawOptions law = law_from(law_options);
    const Loop loop = loop_from(loop_model);
    Scene scene = scene_from(direction, moment, ends, pose_from(target), Array(0), law);
    add_loci(scene, loci);
    Controller controller(scene, law, loop);
    const Pose pose = pose_from(camera);
    for (std::size_t i = 0; i < scene.lines.size(); i++) {
        const SceneLine &line = scene.lines[i];
        const Vector3d l = pose.rotation.transpose() * (line.moment - pose.translation.cross(line.direction));
        controller.detected()[i] = line.in_target && has_image(l, image_depth(l), min_depth);
        controller.image()[i] = l / image_depth(l);
        if (image.rows() == 0) continue;
        controller.image()[i] = image.row(i);
        controller.detected()[i] = controller.detected()[i] && controller.image()[i].head<2>().norm() > 0.5;
    }
    return controller.command(pose);
}

}  // namespace

void bind_rollout(py::module_ &module)
{
    module.attr("ARRIVED_DISTANCE") = kArrivedDistance;
    module.attr("ARRIVED_ANGLE") = kArrivedAngle;
    module.attr("ARRIVED_TIME") = kArrivedTime;
    module.attr("AWAY_FACTOR") = kAwayFactor;
    module.attr("AWAY_MARGIN") = kAwayMargin;
    module.def("roll_out", &roll_out_all, py::arg("direction"), py::arg("moment"), py::arg("ends"), py::arg("target"),
               py::arg("covariances"), py::arg("residuals"), py::arg("believed"), py::arg("loci"), py::arg("path"),
               py::arg("law"), py::arg("loop"), py::arg("state"), py::arg("rotations"), py::arg("translations"), py::arg("seed"),
               "Run the closed loop ahead from k starts; plsing_ros/planning/rollout.py says what is what.");
    module.def("compute_rollout_twist", &compute_rollout_twist, py::arg("direction"), py::arg("moment"), py::arg("ends"),
               py::arg("target"), py::arg("loci"), py::arg("law"), py::arg("loop"), py::arg("camera"), py::arg("image"),
               "The twist that a roll-out commands for image lines, or for what an undisturbed camera sees.");
}

}  // namespace plsing
