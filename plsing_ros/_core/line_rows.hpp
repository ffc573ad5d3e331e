// SPDX-License-Identifier: Apache-2.0
// Two rows of L a line instead of three: how its angle phi and its offset rho change with the camera's twist.
// An image line (cos a, sin a, r) changes only along (-sin a, cos a, 0) and (0, 0, 1). With these as columns of B,
// L = B rows, B has orthonormal columns, so pinv(L) e = pinv(rows) B' e and the singular values are the same.
#pragma once

#include "lines.hpp"

namespace plsing {

using Rows = Eigen::Matrix<double, Eigen::Dynamic, 6>;

// A line whose |(l_x, l_y)| is below this times the larger of 1 m and |l| has no image.
constexpr double min_depth = 1e-9;

inline double image_depth(const Vector3d &moment) { return std::sqrt(moment[0] * moment[0] + moment[1] * moment[1]); }

// Fill rows 2 i and 2 i + 1 for a line (u, l) in the camera frame with image line s = l / depth.
template <typename Matrix>
void fill_line_rows(const Vector3d &u, const Vector3d &l, double depth, Matrix &rows, Eigen::Index i)
{
    const Vector3d s = l / depth;
    // dl/dt = -(v x u + omega x l): its parts across the image line, and along the normal.
    const double c = s[0] / depth, d = s[1] / depth, z = s[2];
    const double rate[3][6] = {{0.0, -u[2], u[1], 0.0, -l[2], l[1]},
                               {u[2], 0.0, -u[0], l[2], 0.0, -l[0]},
                               {-u[1], u[0], 0.0, -l[1], l[0], 0.0}};
    for (int j = 0; j < 6; j++) {
        rows(2 * i, j) = c * rate[1][j] - d * rate[0][j];
        rows(2 * i + 1, j) = rate[2][j] / depth - z * (c * rate[0][j] + d * rate[1][j]);
    }
}

}  // namespace plsing
