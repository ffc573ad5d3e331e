// SPDX-License-Identifier: Apache-2.0
#include "core.hpp"

namespace plsing {
void bind_lines(py::module_ &module);
void bind_features(py::module_ &module);
void bind_monitoring(py::module_ &module);
void bind_minimal_solver(py::module_ &module);
void bind_pose_estimation(py::module_ &module);
void bind_tracking(py::module_ &module);
void bind_proximity(py::module_ &module);
void bind_pose_filter(py::module_ &module);
void bind_singularity(py::module_ &module);
void bind_isolated_points(py::module_ &module);
void bind_rollout(py::module_ &module);
}  // namespace plsing

PYBIND11_MODULE(compiled, module)
{
    module.doc() = "Inner loops of every cycle; plsing_ros/_core says what is in which file.";
    plsing::bind_lines(module);
    plsing::bind_features(module);
    plsing::bind_monitoring(module);
    plsing::bind_minimal_solver(module);
    plsing::bind_pose_estimation(module);
    plsing::bind_tracking(module);
    plsing::bind_proximity(module);
    plsing::bind_pose_filter(module);
    plsing::bind_singularity(module);
    plsing::bind_isolated_points(module);
    plsing::bind_rollout(module);
}
