// SPDX-License-Identifier: Apache-2.0
// What camera poses make of image lines of known lines, and the damped steps towards them.
#pragma once

#include <vector>

#include "lines.hpp"

namespace plsing {

// One line at one pose T_camera_world.
struct Residual {
    Eigen::Vector2d raw;        // angle [rad] and offset minus the observed ones
    Eigen::Matrix2d whitening;  // turns them into uncorrelated numbers in standard deviations
    double determinant;         // of their covariance
    Vector3d image;             // the image line, directed as it is seen
    double along, along_z;      // its direction over |(l_x, l_y)|: along the image line, and along z [1/m]
    bool reversed, hidden;      // seen against its direction; without a part that can be seen

    Eigen::Vector2d value() const { return whitening * raw; }
    // The derivative of raw by the twist (v, omega) of the camera in its own frame.
    Eigen::Matrix<double, 2, 6> jacobian() const;
};
using Residuals = std::vector<Residual>;

// Lines in the world: direction, moment, and how well they are known: the pivot of their errors, its standard deviation
// across the line, and that of the direction.
using KnownLines = View<Dynamic, 11>;
// Image lines l', and the covariance of angle and offset of each: angle angle, angle offset, offset offset.
using SeenLines = View<Dynamic, 6>;

// An image of known lines, with its noise: compiled.pyi says what the settings are.
class Image {
public:
    Image(const KnownLines &lines, const SeenLines &image_lines, const View<3> &settings);
    Index size() const { return lines_.rows(); }
    void fill(const Pose &T_camera_world, Residuals &residuals) const;

private:
    KnownLines lines_;
    SeenLines image_lines_;
    double scene_, camera_, min_cosine_;  // the first two are variances
};

using Weights = Eigen::Ref<const Eigen::VectorXd>;

// The camera's pose after a motion (v, omega) in its frame: the scene moves by the inverse. The rotation is Cayley's.
Pose move(const Pose &T_camera_world, const Vector6d &motion);
// The weighted sum of squares of residuals, by the covariances of others.
double misfit(const Residuals &residuals, const Residuals &measure, const Weights &weight);
// Refine a pose by up to so many damped steps; return whether it is at a minimum, and what the last step promised.
bool refine(const Image &image, const Weights &weight, long iterations, Pose &T_camera_world, double &gain);

}  // namespace plsing
