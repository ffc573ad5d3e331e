// SPDX-License-Identifier: Apache-2.0
#include "rollout.hpp"

namespace plsing {

namespace {

// The twist over unit time from where the camera should be to where it is, in its own frame.
Vector6d displacement(const Pose &asked, const Pose &here)
{
    Vector6d twist;
    twist.head<3>() = here.rotation.transpose() * (here.translation - asked.translation);
    twist.tail<3>() = rotation_vector(asked.rotation.transpose() * here.rotation);
    return twist;
}

}  // namespace

Vector6d Controller::command(const Pose &believed)
{
    Vector6d twist =
        law_.law == Law::kPosition || law_.law == Law::kPath ? by_pose(believed) : by_image(believed);
    if (!twist.allFinite()) return Vector6d::Zero();
    factor_ = saturate(twist, law_.max_linear, law_.max_angular);
    return twist;
}

double Controller::path_duration(const Pose &from, const Pose &to) const
{
    const Vector6d whole = displacement(to, from);
    return std::max(whole.head<3>().norm() / loop_.path_linear, whole.tail<3>().norm() / loop_.path_angular);
}

void Controller::start_path(const Pose &start)
{
    if (law_.law != Law::kPath) return;
    path_ = {start};
    path_times_ = {0.0};
    path_part_ = 0;
    path_time_ = 0.0;
    // What is nearest by the path's speeds has been passed.
    std::size_t passed = 0;
    for (std::size_t i = 1; i < scene_.path.size(); i++)
        if (path_duration(start, scene_.path[i]) < path_duration(start, scene_.path[passed])) passed = i;
    for (std::size_t i = scene_.path.empty() ? 0 : passed + 1; i <= scene_.path.size(); i++) {
        const Pose &next = i < scene_.path.size() ? scene_.path[i] : scene_.target;
        const double duration = path_duration(path_.back(), next);
        if (duration == 0.0) continue;
        path_times_.push_back(path_times_.back() + duration);
        path_.push_back(next);
    }
}

Vector6d Controller::by_pose(const Pose &believed)
{
    if (law_.law == Law::kPosition) return -law_.gain * displacement(scene_.target, believed);
    path_time_ += loop_.period * factor_;
    while (path_part_ + 1 < path_.size() && path_time_ >= path_times_[path_part_ + 1]) path_part_++;
    if (path_part_ + 1 >= path_.size()) return -law_.gain * displacement(scene_.target, believed);
    const Pose &from = path_[path_part_], &to = path_[path_part_ + 1];
    const double duration = path_times_[path_part_ + 1] - path_times_[path_part_];
    const double done = (path_time_ - path_times_[path_part_]) / duration;
    const Vector3d turn = rotation_vector(from.rotation.transpose() * to.rotation);
    const Vector3d way = to.translation - from.translation;
    Pose asked;
    const double angle = turn.norm();
    asked.rotation = from.rotation;
    if (angle > 0.0) asked.rotation *= Eigen::AngleAxisd(angle * done, turn / angle).toRotationMatrix();
    asked.translation = from.translation + done * way;
    Vector6d twist = -law_.gain * displacement(asked, believed);
    twist.head<3>() += asked.rotation.transpose() * way / duration;
    twist.tail<3>() += turn / duration;
    return twist;
}

void Controller::find_reference()
{
    if (reference_set_ == detected_) return;
    reference_set_ = detected_;
    Rows rows(error_.size(), 6);
    Eigen::Index used = 0;
    for (std::size_t i = 0; i < scene_.lines.size(); i++)
        if (detected_[i]) rows.middleRows<2>(2 * used++) = scene_.lines[i].target_rows;
    solver_.decompose(rows, law_.columns);
    const Vector6d &values = solver_.values();
    target_values_ = {values[0], values[law_.columns - 1]};
}

Vector6d Controller::by_image(const Pose &believed)
{
    Eigen::Index count = 0;
    for (char each : detected_) count += each;
    if (count < 3) return Vector6d::Zero();
    if (rows_.rows() != 2 * count) {
        rows_.resize(2 * count, 6);
        error_.resize(2 * count);
    }
    if (law_.law != Law::kPinv) find_reference();
    const Matrix3d R = believed.rotation.transpose();
    const bool at_target = law_.inverted == Inverted::kTarget;
    double largest = 0.0;
    Eigen::Index used = 0;
    for (std::size_t i = 0; i < scene_.lines.size(); i++) {
        if (!detected_[i]) continue;
        const SceneLine &line = scene_.lines[i];
        const Vector3d u = R * line.direction;
        const Vector3d l = R * (line.moment - believed.translation.cross(line.direction));
        const double depth = image_depth(l);
        if (!has_image(l, depth, min_depth)) return Vector6d::Zero();
        const Vector3d e = image_[i] - line.target_image;
        // The columns of B: at the 3-D line's own image, or at the target's.
        const double c = at_target ? line.target_image[0] : l[0] / depth;
        const double s = at_target ? line.target_image[1] : l[1] / depth;
        error_[2 * used] = c * e[1] - s * e[0];
        error_[2 * used + 1] = e[2];
        if (law_.gain_slope > 0.0) largest = std::max(largest, e.cwiseAbs().maxCoeff());
        fill_line_rows(u, l, depth, rows_, used);
        used++;
    }
    if (law_.columns < 6)
        for (int j = 0; j < 6; j++)
            if (!law_.used[j]) rows_.col(j).setZero();
    double gain = law_.gain;
    if (law_.gain_slope > 0.0) {
        const double span = law_.gain - law_.gain_at_infinity;
        gain = span * std::exp(-law_.gain_slope / span * largest) + law_.gain_at_infinity;
    }
    double health = 1.0;
    if (law_.law == Law::kGuarded) {
        const double onset = law_.onset * healthy_value(target_values_);
        here_.decompose(rows_, law_.columns);
        if (here_.least() < onset) health = here_.smallest() / onset;
    }
    if (law_.inverted != Inverted::kCurrent) {
        const double share = at_target ? 0.0 : 0.5;
        used = 0;
        for (std::size_t i = 0; i < scene_.lines.size(); i++)
            if (detected_[i]) {
                auto rows = rows_.middleRows<2>(2 * used++);
                rows = share * rows + (1.0 - share) * scene_.lines[i].target_rows;
            }
    }
    solver_.decompose(rows_, law_.columns);
    error_ *= -gain;
    solver_.project(error_);
    const double reference = law_.law == Law::kPinv ? 0.0 : healthy_value(target_values_);
    switch (law_.law) {
        case Law::kDls: return solver_.solve_damped(law_.threshold, law_.damping * reference);
        case Law::kAdaptiveDls: return adaptive_twist(law_, solver_, reference);
        case Law::kGuarded: {
            const Vector6d twist = limited_twist(law_, solver_, reference);
            return guard_scale(believed, twist, health) * twist;
        }
        default: return solver_.solve(law_.threshold);
    }
}

double Controller::guard_scale(const Pose &believed, const Vector6d &twist, double health) const
{
    if (health >= 1.0) return 1.0;
    const double ill = 1.0 - smooth_step(health), most = (1.0 - law_.floor) * ill;
    if (!scene_.has_loci) return 1.0 - most;
    const Vector3d velocity = believed.rotation * twist.head<3>();
    const double speed = std::max(velocity.norm(), 1e-12), core = 0.03 * law_.margin;
    double near = 0.0;
    for (const Locus &locus : scene_.loci) {
        const Vector3d from = locus.point - believed.translation;
        const Vector3d offset = from - locus.direction * locus.direction.dot(from);
        const double square = offset.squaredNorm();
        const double approaching = 0.5 + 0.5 * offset.dot(velocity) / (speed * std::sqrt(square + core * core));
        near = std::max(near, approaching * approaching * (1.0 - smooth_step(std::sqrt(square) / law_.margin)));
    }
    return 1.0 - most * near;
}

}  // namespace plsing
