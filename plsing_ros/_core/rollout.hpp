// SPDX-License-Identifier: Apache-2.0
// What a closed-loop roll-out is made of; units, frames and meanings: plsing_ros/planning/rollout.py.
#pragma once

#include <Eigen/Geometry>

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "rollout_law.hpp"

namespace plsing {

// A run is over within these of the target for so long; harm is farther from it than so many times the start, and so
// much more.
constexpr double kArrivedDistance = 0.05, kArrivedAngle = 2.0 * M_PI / 180.0, kArrivedTime = 1.0;
constexpr double kAwayFactor = 1.5, kAwayMargin = 0.05;

// A line of the scene, and what is seen of it at the target.
struct SceneLine {
    Vector3d direction, moment, ends[2];
    Vector3d target_image = Vector3d::Zero();
    Eigen::Matrix<double, 2, 6> target_rows = Eigen::Matrix<double, 2, 6>::Zero();
    bool in_target = false;
    // Lower Cholesky factor of the covariance of (phi, rho): pp, rp, rr.
    double noise[3] = {0.0, 0.0, 0.0};
    // Mean of what was seen of its (phi, rho) minus what the map says, the covariance of that mean, and how much of it
    // is the line's.
    bool has_residual = false;
    Eigen::Vector2d residual = Eigen::Vector2d::Zero();
    Eigen::Matrix2d residual_noise = Eigen::Matrix2d::Zero(), residual_gain = Eigen::Matrix2d::Zero();
};

struct Locus {
    Vector3d point, direction;  // Direction zero: an isolated point.
};

struct Scene {
    std::vector<SceneLine> lines;
    Pose target;
    std::vector<Locus> loci;
    std::vector<Pose> path;  // To the target; empty: straight.
    bool has_loci = false, has_covariances = false;
};

struct Loop {
    double period, later_period, jitter, lag, robot_linear, robot_angular;
    double image_noise, position_noise, rotation_noise, map_noise, focal_error;
    double dropped_frames, dropped_lines, tan_x, tan_y, near, min_length;
    double horizon, deadline, elapsed, start_distance, first_linear, first_angular;
    double demand_linear, demand_angular, path_linear, path_angular, arrived_for;
    int latency;
    bool stops, pose_error_lasts;
    std::optional<Vector6d> answer;
};

enum Kind : int { kArrived = 0, kAway = 1, kFewLines = 2, kLate = 3 };

struct Outcome {
    int kind = kArrived;
    double harm_time = 0.0, demand = 0.0, demand_time = -1.0, speed = 0.0, distance = 0.0, angle = 0.0;
    double first_linear = -1.0, first_angular = -1.0, mean_square = 0.0;
    std::int64_t steps = 0;
};

// Uniform by xoshiro256+, normal by the polar method: as the standard library's, several times as fast.
class Random {
public:
    explicit Random(std::uint64_t seed)
    {
        for (auto &word : state_) {
            seed += 0x9e3779b97f4a7c15ull;
            std::uint64_t z = seed;
            z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
            z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
            word = z ^ (z >> 31);
        }
    }

    double uniform()
    {
        const std::uint64_t result = state_[0] + state_[3], t = state_[1] << 17;
        state_[2] ^= state_[0];
        state_[3] ^= state_[1];
        state_[1] ^= state_[2];
        state_[0] ^= state_[3];
        state_[2] ^= t;
        state_[3] = (state_[3] << 45) | (state_[3] >> 19);
        return static_cast<double>(result >> 11) * 0x1.0p-53;
    }

    double normal()
    {
        if (has_spare_) {
            has_spare_ = false;
            return spare_;
        }
        double x, y, square;
        do {
            x = 2.0 * uniform() - 1.0;
            y = 2.0 * uniform() - 1.0;
            square = x * x + y * y;
        } while (square >= 1.0 || square == 0.0);
        const double factor = std::sqrt(-2.0 * std::log(square) / square);
        spare_ = y * factor;
        has_spare_ = true;
        return x * factor;
    }

    Vector3d normal_vector() { return {normal(), normal(), normal()}; }

private:
    std::array<std::uint64_t, 4> state_;
    double spare_ = 0.0;
    bool has_spare_ = false;
};

// The law in a scene: from a camera to a twist.
class Controller {
public:
    Controller(const Scene &scene, const LawOptions &law, const Loop &loop)
        : scene_(scene), law_(law), loop_(loop), detected_(scene.lines.size(), 1), image_(scene.lines.size())
    {
    }

    // What was measured of each line in this frame: whether it is detected, and its image line.
    std::vector<char> &detected() { return detected_; }
    std::vector<Vector3d> &image() { return image_; }

    // The commanded twist within the controller's limits; zero with fewer than three lines.
    // believed: T_scene_camera that the 3-D lines of the features are made with.
    Vector6d command(const Pose &believed);

    // Begin from here what is left of the path.
    void start_path(const Pose &start);

private:
    Vector6d by_pose(const Pose &believed);
    double path_duration(const Pose &from, const Pose &to) const;
    Vector6d by_image(const Pose &believed);
    void find_reference();
    double guard_scale(const Pose &believed, const Vector6d &twist, double health) const;

    const Scene &scene_;
    const LawOptions &law_;
    const Loop &loop_;
    std::vector<char> detected_, reference_set_;
    std::vector<Vector3d> image_;
    Rows rows_, current_;
    Eigen::VectorXd error_;
    RowSolver solver_, here_;
    Eigen::Vector2d target_values_;
    // When the camera is to be where, and the part of the path it is on.
    std::vector<Pose> path_;
    std::vector<double> path_times_;
    std::size_t path_part_ = 0;
    double path_time_ = 0.0, factor_ = 1.0;
};

// The focal length of a sample, over the one that is assumed.
double draw_focal_length(const Loop &loop, Random &random);

// Find how much of the residuals seen from a pose is due to the map and the focal length, and not to noise.
void weigh_residuals(Scene &scene, const Loop &loop, const Pose &believed);

// The lines as they may truly be, for a sample with the camera at a pose where another one is believed.
std::vector<SceneLine> draw_map(const Scene &scene, const Loop &loop, const Pose &believed, const Pose &camera,
                                double focal, Random &random);

// Run one sample from a start. motion: the robot's twist now; command: the latest one, still on its way.
// believed: where the camera is believed to be.
Outcome roll_out(const Scene &scene, const LawOptions &law, const Loop &loop, const Pose &camera, const Pose &believed,
                 const Vector6d &motion, const Vector6d &command, std::uint64_t seed);

}  // namespace plsing
