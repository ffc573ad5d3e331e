// SPDX-License-Identifier: Apache-2.0
// Lines (u, l) with l = x cross u, and poses T_a_b: p_a = rotation p_b + translation.
#pragma once

#include <Eigen/Geometry>

#include "core.hpp"
#include "least_squares.hpp"

namespace plsing {

// One vector of three a row, as numpy has them.
using Rows3 = RowMajor<double, Dynamic, 3>;
using Rows3Ref = Eigen::Ref<const Rows3>;

struct Pose {
    Matrix3d rotation = Matrix3d::Identity();
    Vector3d translation = Vector3d::Zero();
};

struct Lines {
    Rows3 direction, moment;
};

inline Matrix3d skew(const Vector3d &v)
{
    return (Matrix3d() << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0).finished();
}

// exp([omega]x) and its left Jacobian.
void exponential(const Vector3d &omega, Matrix3d &turn, Matrix3d &jacobian);

// The pose of a frame, in what it was before, that moved by the screw exp(step), (v, omega) [m, rad].
Pose exponential(const Vector6d &step);

// Of which the rotation is the exponential, no longer than pi.
inline Vector3d rotation_vector(const Matrix3d &rotation)
{
    const Eigen::AngleAxisd turn(rotation);
    return turn.angle() * turn.axis();
}

// Lines in the frame b of T_a_b: u R and (l - t cross u) R, in rows.
Lines in_frame(const Rows3Ref &direction, const Rows3Ref &moment, const Pose &T_a_b);

// Whether a line of this moment in the camera frame has an image: |(l_x, l_y)|, its depth, is no less than min_depth
// times the larger of 1 m and the moment's largest element, and all is finite.
inline bool has_image(const Vector3d &moment, double depth, double min_depth)
{
    // The depth is infinite also for (infinity, NaN).
    return std::isfinite(depth) && std::isfinite(moment.z()) &&
           depth >= min_depth * std::max(1.0, moment.cwiseAbs().maxCoeff());
}

// Fill the rows of line_rows.hpp, (2n, 6), for n lines in the camera frame; false, unfinished, if one has no image.
bool fill_rows(const Rows3Ref &direction, const Rows3Ref &moment, double min_depth, Tall &rows);

// B of line_rows.hpp times two rows for each line of these moments: three rows for each.
Tall expand(const Rows3Ref &moment, const Tall &rows);

// B' times three numbers for each line: two numbers for each.
Eigen::VectorXd reduce(const Rows3Ref &moment, const Eigen::Ref<const Eigen::VectorXd> &values);

// The images of lines of these moments minus image lines, (3n); not finite if a line has no image.
Eigen::VectorXd image_error(const Rows3Ref &moment, const Rows3Ref &image_lines);

}  // namespace plsing
