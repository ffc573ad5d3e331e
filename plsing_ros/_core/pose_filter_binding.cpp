// SPDX-License-Identifier: Apache-2.0
#include <pybind11/eigen.h>
#include <pybind11/stl.h>

#include "pose_filter.hpp"

namespace plsing {

void bind_pose_filter(py::module_ &module)
{
    py::class_<FilterMap>(module, "FilterMap", "Lines with their tolerances, as the filter needs them.")
        .def(py::init<const Rows &, const Rows &, const Eigen::VectorXd &, const Eigen::VectorXd &>(),
             py::arg("direction"), py::arg("pivot"), py::arg("position_std"), py::arg("direction_std"))
        .def_readonly("count", &FilterMap::count)
        .def_readonly("exact", &FilterMap::exact);
    py::class_<Innovation>(module, "Innovation", "What one image says about a state.")
        .def_readonly("good", &Innovation::good)
        .def_readonly("squared", &Innovation::squared)
        .def_readonly("of_line", &Innovation::of_line)
        .def("removal", &Innovation::removal)
        .def_readonly("reversed", &Innovation::reversed)
        .def_readonly("log_determinants", &Innovation::log_determinants)
        .def_readonly("log_determinant", &Innovation::log_determinant)
        .def_readonly("iterations", &Innovation::iterations);
    py::class_<FitGates>(module, "FitGates", "When a state and an image agree.")
        .def(py::init([](double of_line, std::vector<double> by_count, double reversal_cost) {
                 return FitGates{of_line, std::move(by_count), reversal_cost};
             }),
             py::arg("of_line"), py::arg("by_count"), py::arg("reversal_cost"));
    py::class_<Curvature>(module, "Curvature", "Where an image told least, and how far from linear it is there.")
        .def_readonly("nonlinearity", &Curvature::nonlinearity)
        .def_readonly("by_pose", &Curvature::by_pose);
    py::class_<FilterState>(module, "FilterState", "A pose T_world_camera with the drift of the twist.")
        .def(py::init<const Matrix3d &, const Vector3d &, const Matrix6d &, const Matrix6d &, Index>(), py::arg("rotation"),
             py::arg("position"), py::arg("covariance"), py::arg("drift_covariance"), py::arg("map_lines"))
        .def_static("mixture", &FilterState::mixture, py::arg("states"), py::arg("weights"))
        .def_static("interact", &FilterState::interact, py::arg("states"), py::arg("weights"), py::arg("arrivals"),
                    py::arg("drift_std"), py::arg("negligible"))
        .def("copy", [](const FilterState &state) { return FilterState(state); })
        .def("predict", &FilterState::predict, py::arg("twist"), py::arg("noise"), py::arg("drift_twist"),
             py::arg("drift_std"), py::arg("duration"), py::arg("memory"))
        .def("inflate", &FilterState::inflate, py::arg("pose"))
        .def("forget_drift", &FilterState::forget_drift, py::arg("drift_std"))
        .def("part", &FilterState::part, py::arg("by_pose"), py::arg("offset"), py::arg("std"))
        .def("curvature", &FilterState::curvature, py::arg("before"), py::arg("map_lines"), py::arg("rows"),
             py::arg("image"), py::arg("covariances"), py::arg("used"))
        .def("merging_cost", &FilterState::merging_cost, py::arg("other"), py::arg("own_weight"), py::arg("other_weight"))
        .def("update", &FilterState::update, py::arg("map_lines"), py::arg("rows"), py::arg("image"), py::arg("covariances"),
             py::arg("used"), py::arg("iterations"))
        .def("fit", &FilterState::fit, py::arg("map_lines"), py::arg("rows"), py::arg("image"), py::arg("covariances"),
             py::arg("removable"), py::arg("gates"), py::arg("iterations"))
        .def_readonly("rotation", &FilterState::rotation)
        .def_readonly("position", &FilterState::position)
        .def_readonly("drift", &FilterState::drift)
        .def_property_readonly("covariance",
                               [](const FilterState &state) -> Matrix6d { return state.covariance.topLeftCorner<6, 6>(); })
        .def_property_readonly("drift_covariance", [](const FilterState &state) -> Matrix6d {
            return state.covariance.bottomRightCorner<6, 6>();
        });
    py::class_<Fit>(module, "Fit", "A state after an image with which it agrees.")
        .def_readonly("state", &Fit::state)
        .def_readonly("innovation", &Fit::innovation)
        .def_readonly("used", &Fit::used)
        .def_readonly("cost", &Fit::cost);
}

}  // namespace plsing
