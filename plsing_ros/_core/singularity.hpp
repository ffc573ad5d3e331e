// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>

#include "lines.hpp"

namespace plsing {

struct Singularity {
    double ratio;     // smallest over largest singular value of the rank basis; 1 for a centre that is not finite
    double distance;  // of the nearest line, in the root mean square distance; infinite for such a centre
};

// How far from rank-deficient the image velocities of three lines or more are at a camera centre, real or complex, with
// lengths in the root mean square distance to them. Lines nearer than `on_line` have no rows in the rank basis.
Singularity singularity_at(const Rows3Ref &direction, const Rows3Ref &point, const Eigen::Vector3cd &center,
                           double on_line);

// The cross product, of which Eigen gives the conjugate for complex vectors.
template <typename Scalar>
Eigen::Matrix<Scalar, 3, 1> cross(const Eigen::Matrix<Scalar, 3, 1> &a, const Eigen::Matrix<Scalar, 3, 1> &b)
{
    return a.cross(b).conjugate();
}

// The two rows of a line in the row-normalised rank basis, [f, f.f u] and [0, u x f], and what they were divided by.
template <typename Scalar>
struct BasisRows {
    Eigen::Matrix<Scalar, 1, 6> first = Eigen::Matrix<Scalar, 1, 6>::Zero();
    Eigen::Matrix<Scalar, 1, 3> second = Eigen::Matrix<Scalar, 1, 3>::Zero();
    double first_size = 1.0, second_size = 1.0;

    BasisRows() = default;

    // f = u x (point - centre), which is not zero. For a complex centre f.f is without conjugation, so that the rows stay
    // polynomial in the centre.
    BasisRows(const Eigen::Matrix<Scalar, 3, 1> &u, const Eigen::Matrix<Scalar, 3, 1> &f) : second_size(f.norm())
    {
        const Scalar along = f.cwiseProduct(f).sum() / second_size;
        // Squares of lengths alone, which do not overflow.
        first_size = second_size * std::sqrt(1.0 + Eigen::numext::abs2(along));
        first << (1.0 / first_size) * f.transpose(), u.transpose() * (along * (second_size / first_size));
        // |u x f| = |f|, since f is across u.
        second = (1.0 / second_size) * cross<Scalar>(u, f).transpose();
    }
};

}  // namespace plsing
