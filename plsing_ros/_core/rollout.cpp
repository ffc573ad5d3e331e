// SPDX-License-Identifier: Apache-2.0
#include "rollout.hpp"

namespace plsing {

namespace {

constexpr double kDemandFactor = 1.5, kRounding = 1e-9;
constexpr double kFineTime = 1.0;  // In which each frame is a step [s].
constexpr int kFewestLines = 3;

// Move by a constant twist (v, omega) in the camera's frame over unit time.
void move(Pose &camera, const Vector6d &step)
{
    const Pose moved = exponential(step);
    camera.translation += camera.rotation * moved.translation;
    camera.rotation *= moved.rotation;
}

// The part of a segment inside the camera's view, as two points on z = 1; false if there is none.
bool visible_part(const Vector3d &a, const Vector3d &b, const Loop &loop, Eigen::Vector2d &from, Eigen::Vector2d &to)
{
    double start = 0.0, end = 1.0;
    auto clip = [&](double at_a, double at_b) {
        // Keep where the value, linear along the segment, is positive.
        if (at_a < 0.0 && at_b < 0.0) return false;
        if (at_a < 0.0) start = std::max(start, at_a / (at_a - at_b));
        if (at_b < 0.0) end = std::min(end, at_a / (at_a - at_b));
        return start < end;
    };
    if (!clip(a[2] - loop.near, b[2] - loop.near)) return false;
    if (loop.tan_x > 0.0 && !(clip(loop.tan_x * a[2] - a[0], loop.tan_x * b[2] - b[0]) &&
                              clip(loop.tan_x * a[2] + a[0], loop.tan_x * b[2] + b[0])))
        return false;
    if (loop.tan_y > 0.0 && !(clip(loop.tan_y * a[2] - a[1], loop.tan_y * b[2] - b[1]) &&
                              clip(loop.tan_y * a[2] + a[1], loop.tan_y * b[2] + b[1])))
        return false;
    const Vector3d p = a + start * (b - a), q = a + end * (b - a);
    from = p.head<2>() / p[2];
    to = q.head<2>() / q[2];
    return (to - from).norm() >= loop.min_length;
}

class Sample {
public:
    Sample(const Scene &scene, const LawOptions &law, const Loop &loop, const Pose &camera, const Pose &believed,
           const Vector6d &motion, const Vector6d &command, std::uint64_t seed)
        : scene_(scene), law_(law), loop_(loop), controller_(scene, law, loop_), random_(seed), camera_(camera),
          motion_(motion), commands_(loop.latency + kMostJitter + 2, command)
    {
        // T_camera_believed.
        error_.rotation = camera.rotation.transpose() * believed.rotation;
        error_.translation = camera.rotation.transpose() * (believed.translation - camera.translation);
        measure_distance();
        surplus_ = out_.distance;
        camera_ = believed;
        measure_distance();
        surplus_ -= out_.distance;
        camera_ = camera;
        focal_ = draw_focal_length(loop, random_);
        true_lines_ = loop.map_noise > 0.0 || loop.focal_error > 0.0
                          ? draw_map(scene, loop, believed, camera, focal_, random_)
                          : scene.lines;
        first_linear_ = loop.first_linear;
        first_angular_ = loop.first_angular;
        controller_.start_path(this->believed());
    }

    Outcome run()
    {
        // What the pose is off by now, the distance at the start was off by, too.
        const double from = std::max(loop_.start_distance + surplus_, 0.0);
        const double away = std::max(kAwayFactor * from, from + kAwayMargin);
        // It may have been there for a while.
        bool was_there = loop_.arrived_for > 0.0;
        double arrived_since = -loop_.arrived_for;
        measure_distance();
        double time = 0.0;
        for (step_ = 0; time < (1.0 - kRounding) * loop_.horizon; time = time_of(++step_)) {
            if (time >= kFineTime && loop_.later_period > loop_.period) lengthen_steps(time);
            if (out_.distance > away) return harm(kAway, time);
            if (!see()) return harm(kFewLines, time);
            if (2.0 * time >= loop_.horizon) {
                square_ += out_.distance * out_.distance;
                counted_++;
            }
            if (loop_.stops && is_there()) {
                if (!was_there) arrived_since = time;
                was_there = true;
                if (time - arrived_since >= kArrivedTime) return finish();
            } else {
                was_there = false;
            }
            if (time >= loop_.deadline - loop_.elapsed) return harm(kLate, time);
            if (step_ % kRememberEvery == 0) remember(time);
            act(time);
        }
        return loop_.stops && is_late(time) ? harm(kLate, loop_.deadline - loop_.elapsed) : finish();
    }

private:
    static constexpr int kRememberEvery = 8;
    static constexpr long kMostJitter = 8;  // [frames]

    double time_of(std::int64_t step) const { return since_ + (step - since_step_) * loop_.period; }

    void lengthen_steps(double time)
    {
        since_ = time;
        since_step_ = step_;
        const double ratio = loop_.period / loop_.later_period;
        loop_.latency = std::lround(ratio * loop_.latency);
        loop_.jitter *= ratio;
        loop_.period = loop_.later_period;
    }

    bool is_there() const { return error() <= 1.0; }

    Outcome finish()
    {
        out_.steps = step_;
        out_.first_linear = first_linear_;
        out_.first_angular = first_angular_;
        out_.mean_square = counted_ > 0 ? square_ / counted_ : 0.0;
        return out_;
    }

    Outcome harm(Kind kind, double time)
    {
        out_.kind = kind;
        out_.harm_time = std::max(time, 0.0);
        return finish();
    }

    // The horizon ends before the deadline: whether the error, falling as in the last half, is too large then.
    void remember(double time) { history_.push_back({time, error()}); }

    double error() const { return std::max(out_.distance / kArrivedDistance, out_.angle / kArrivedAngle); }

    bool is_late(double time)
    {
        const double left = loop_.deadline - loop_.elapsed - time - kArrivedTime;
        const double now = error();
        if (now <= 1.0) return false;
        if (left <= 0.0) return true;
        const auto &before = history_[history_.size() / 2];
        const double span = time - before[0];
        if (span <= 0.0 || before[1] <= now) return true;
        return now * std::exp(-left / span * std::log(before[1] / now)) > 1.0;
    }

    void measure_distance()
    {
        if (law_.columns < 6) {
            // Along motions that nobody asked for the camera is neither near nor far.
            Vector3d shift = camera_.rotation.transpose() * (camera_.translation - scene_.target.translation);
            Vector3d turn = rotation_vector(scene_.target.rotation.transpose() * camera_.rotation);
            for (int j = 0; j < 3; j++) {
                if (!law_.used[j]) shift[j] = 0.0;
                if (!law_.used[j + 3]) turn[j] = 0.0;
            }
            out_.distance = shift.norm();
            out_.angle = turn.norm();
            return;
        }
        out_.distance = (camera_.translation - scene_.target.translation).norm();
        const double trace = (camera_.rotation.transpose() * scene_.target.rotation).trace();
        out_.angle = std::acos(std::min(std::max(0.5 * (trace - 1.0), -1.0), 1.0));
    }

    // Fill what the controller detects; return whether enough lines are in view.
    bool see()
    {
        const Matrix3d R = camera_.rotation.transpose();
        int in_view = 0;
        for (std::size_t i = 0; i < true_lines_.size(); i++) {
            const SceneLine &line = true_lines_[i];
            controller_.detected()[i] = 0;
            if (!line.in_target) continue;
            const Vector3d a = R * (line.ends[0] - camera_.translation), b = R * (line.ends[1] - camera_.translation);
            Eigen::Vector2d from, to;
            if (!visible_part(a, b, loop_, from, to)) continue;
            const Vector3d l = R * (line.moment - camera_.translation.cross(line.direction));
            const double depth = image_depth(l);
            if (!has_image(l, depth, min_depth)) continue;
            in_view++;
            if (loop_.dropped_lines > 0.0 && random_.uniform() < loop_.dropped_lines) continue;
            controller_.detected()[i] = 1;
            controller_.image()[i] = measured(l / depth, from, to, scene_.lines[i].noise);
        }
        return in_view >= kFewestLines;
    }

    Vector3d measured(Vector3d image, const Eigen::Vector2d &from, const Eigen::Vector2d &to, const double* noise)
    {
        double turn = 0.0, offset = 0.0;
        if (scene_.has_covariances) {
            const double first = random_.normal(), second = random_.normal();
            turn = noise[0] * first;
            offset = noise[1] * first + noise[2] * second;
        } else if (loop_.image_noise > 0.0) {
            // Both ends are off across the line; the offset is that at the foot of the principal point.
            const Eigen::Vector2d along(-image[1], image[0]);
            const double s = along.dot(from), t = along.dot(to);
            const double at_from = loop_.image_noise * random_.normal(), at_to = loop_.image_noise * random_.normal();
            const double slope = (at_to - at_from) / (t - s);
            turn = -slope;
            offset = -(at_from - slope * s);
        }
        if (turn != 0.0) {
            const double c = std::cos(turn), d = std::sin(turn), x = image[0], y = image[1];
            image[0] = c * x - d * y;
            image[1] = d * x + c * y;
        }
        image[2] = (image[2] + offset) * focal_;
        return image;
    }

    Pose believed()
    {
        Pose pose = camera_;
        if (loop_.pose_error_lasts) {
            pose.translation += camera_.rotation * error_.translation;
            pose.rotation *= error_.rotation;
        }
        if (loop_.position_noise == 0.0 && loop_.rotation_noise == 0.0) return pose;
        pose.translation += loop_.position_noise * random_.normal_vector();
        Vector6d turn = Vector6d::Zero();
        turn.tail<3>() = loop_.rotation_noise * random_.normal_vector();
        pose.rotation *= exponential(turn).rotation;
        return pose;
    }

    void act(double time)
    {
        Vector6d command = commands_[latest_ % commands_.size()];
        if (loop_.dropped_frames == 0.0 || random_.uniform() >= loop_.dropped_frames)
            command = controller_.command(believed());
        if (step_ == 0 && loop_.answer) command = *loop_.answer;
        note_demand(command, time);
        // The command for frame k is carried out from frame k + latency on, later with jitter.
        latest_++;
        commands_[latest_ % commands_.size()] = command;
        std::int64_t delay = loop_.latency;
        if (loop_.jitter > 0.0) delay += std::min(kMostJitter, std::lround(std::abs(loop_.jitter * random_.normal())));
        carried_out_ = std::max(carried_out_, latest_ - delay);
        Vector6d asked = commands_[carried_out_ % commands_.size()];
        saturate(asked, loop_.robot_linear, loop_.robot_angular);
        Vector6d step = loop_.period * asked;
        if (loop_.lag > 0.0) {
            const double left = std::exp(-loop_.period / loop_.lag);
            step += (loop_.lag * (1.0 - left)) * (motion_ - asked);
            motion_ = asked + left * (motion_ - asked);
        }
        move(camera_, step);
        if (step_ % 64 == 63) camera_.rotation = Eigen::Quaterniond(camera_.rotation).normalized().toRotationMatrix();
        measure_distance();
    }

    void note_demand(const Vector6d &command, double time)
    {
        const double v = command.head<3>().norm(), w = command.tail<3>().norm();
        if (first_linear_ < 0.0) {
            first_linear_ = v;
            first_angular_ = w;
        }
        // A command that a limit has scaled is that limit but for rounding, and no demand.
        const double demand = std::max(v / std::max(loop_.demand_linear, kDemandFactor * first_linear_),
                                       w / std::max(loop_.demand_angular, kDemandFactor * first_angular_)) *
                              (1.0 - kRounding);
        if (demand > 1.0 && out_.demand_time < 0.0) out_.demand_time = time;
        out_.demand = std::max(out_.demand, demand);
        out_.speed = std::max({out_.speed, v / loop_.demand_linear, w / loop_.demand_angular});
    }

    const Scene &scene_;
    const LawOptions &law_;
    Loop loop_;
    Controller controller_;
    Random random_;
    Pose camera_, error_;
    Vector6d motion_;
    std::vector<SceneLine> true_lines_;
    std::vector<Vector6d> commands_;
    std::vector<std::array<double, 2>> history_;
    std::int64_t latest_ = 0, carried_out_ = 0, step_ = 0, since_step_ = 0, counted_ = 0;
    double since_ = 0.0, surplus_ = 0.0, square_ = 0.0, focal_ = 1.0, first_linear_ = -1.0, first_angular_ = -1.0;
    Outcome out_;
};

}  // namespace

Outcome roll_out(const Scene &scene, const LawOptions &law, const Loop &loop, const Pose &camera, const Pose &believed,
                 const Vector6d &motion, const Vector6d &command, std::uint64_t seed)
{
    return Sample(scene, law, loop, camera, believed, motion, command, seed).run();
}

}  // namespace plsing
