// SPDX-License-Identifier: Apache-2.0
// An iterated Kalman filter on SE(3) for image lines whose map has errors of its own.
#pragma once

#include <optional>
#include <utility>
#include <vector>

#include <Eigen/Dense>

#include "lines.hpp"

namespace plsing {

using Matrix12 = Eigen::Matrix<double, 12, 12>;
using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// The lines of a map: each goes through its pivot, which is off by N(0, position_std^2) in both directions across the
// line, and its direction turns about the pivot by N(0, direction_std^2) about both. Four standard normal numbers a line.
struct FilterMap {
    FilterMap(const Rows &direction, const Rows &pivot, const Eigen::VectorXd &position_std,
              const Eigen::VectorXd &direction_std);

    Index count;
    Rows direction, pivot, first, second;  // (n, 3); first and second are unit vectors across the line
    Eigen::VectorXd position_std, direction_std;
    bool exact;  // no line has an error
};

// What one image says about a state, and what an update made of it; k lines were given.
struct Innovation {
    bool good = false;             // false: not finite, or not converged; the state is as it was
    double squared = 0.0;          // squared Mahalanobis distance of all used lines, where the update ended
    Eigen::VectorXd of_line;       // (k) of each line alone, against the state before, with its covariance
    Eigen::VectorXd reversed;      // (k) 1 if seen against its direction
    Eigen::VectorXd log_determinants;  // (k) of the covariance of of_line
    double log_determinant = 0.0;  // of the covariance of the used lines' innovation
    int iterations = 0;

    Eigen::VectorXd removal() const;

    std::vector<Index> used;                 // the m lines that were used
    Eigen::LLT<Eigen::MatrixXd> covariance;  // (2 m, 2 m) of their innovation
    Eigen::VectorXd weighted;                // (2 m) inverse of that times the innovation
};

// Where an image told least about a pose, and how much the misfit there differs from that of a linear image.
struct Curvature {
    double nonlinearity;  // of the misfit two standard deviations away, as a share of what a linear image makes of it
    Vector6d by_pose;     // the direction, as a linear function of the error of the pose before the image
};

// When a state and an image agree.
struct FitGates {
    double of_line;                  // for the squared Mahalanobis distance of each line
    std::vector<double> by_count;    // for that of all, by how many lines are used
    double reversal_cost;            // of a line that is seen against its direction
};

struct Fit;

// The pose T_world_camera, with the drift of the twist: what the camera's twist differs by, for a while, from the one
// given, as predict() is told.
// Errors: (position, rotation about the world's axes, drift), with true position = position + error and
// true rotation = exp(error) rotation, as in geometry_msgs/PoseWithCovariance.
class FilterState {
public:
    FilterState(const Matrix3d &rotation, const Vector3d &position, const Matrix6d &covariance,
                const Matrix6d &drift_covariance, Index map_lines);
    static FilterState mixture(const std::vector<const FilterState *> &states, const std::vector<double> &weights);
    static std::pair<std::vector<FilterState>, std::vector<double>> interact(
        const std::vector<const FilterState *> &states, const std::vector<double> &weights,
        const std::vector<double> &arrivals, const std::vector<double> &drift_std, double negligible);

    void predict(const Vector6d &twist, const Vector6d &noise, const Matrix6d &drift_twist, double drift_std,
                 double duration, double memory);
    void inflate(const Matrix6d &pose);
    void forget_drift(double drift_std);
    FilterState part(const Vector6d &by_pose, double offset, double std) const;
    Curvature curvature(const FilterState &before, const FilterMap &map, const std::vector<Index> &rows,
                        const Rows &image, const Rows &covariances, const std::vector<bool> &used) const;
    double merging_cost(const FilterState &other, double own_weight, double other_weight) const;
    Innovation update(const FilterMap &map, const std::vector<Index> &rows, const Rows &image,
                      const Rows &covariances, const std::vector<bool> &used, int iterations);

    std::optional<Fit> fit(const FilterMap &map, const std::vector<Index> &rows, const Rows &image,
                           const Rows &covariances, int removable, const FitGates &gates, int iterations) const;

    Matrix3d rotation;
    Vector3d position;
    Vector6d drift = Vector6d::Zero();
    Matrix12 covariance = Matrix12::Zero();
    Eigen::MatrixXd with_map;  // (12, 4 n): covariance with the errors of the map; (12, 0) if the map is exact
};

// A state after an image with which it agrees.
struct Fit {
    FilterState state;
    Innovation innovation;
    std::vector<bool> used;
    double cost;  // -2 log likelihood of the image
};

}  // namespace plsing
