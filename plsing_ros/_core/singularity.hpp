// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "lines.hpp"

namespace plsing {

struct Singularity {
    double ratio;     // smallest over largest singular value of the rank basis; 1 for a centre that is not finite
    double distance;  // of the nearest line, in the root mean square distance; infinite for such a centre
};

// How far from rank-deficient the image velocities of three lines or more are at a camera centre, real or complex. Lines
// nearer than `on_line` have no rows in the rank basis.
Singularity singularity_at(const Rows3Ref &direction, const Rows3Ref &point, const Eigen::Vector3cd &center,
                           double on_line);

}  // namespace plsing
