// SPDX-License-Identifier: Apache-2.0
// The line tracker's inner loops, as plsing_ros/tracking/ calls them.
#include "tracking.hpp"

namespace pybind11::detail {

// A Pose of Python, or what has its attributes; back it goes as rotation and translation.
template <>
struct type_caster<plsing::tracking::Transform> {
    PYBIND11_TYPE_CASTER(plsing::tracking::Transform, const_name("Pose"));

    bool load(handle source, bool)
    {
        if (!hasattr(source, "rotation") || !hasattr(source, "translation"))
            return false;
        value = {source.attr("rotation").cast<Eigen::Matrix3d>(), source.attr("translation").cast<Eigen::Vector3d>()};
        return true;
    }
    static handle cast(const plsing::tracking::Transform& pose, return_value_policy, handle)
    {
        return make_tuple(pose.rotation, pose.translation).release();
    }
};

}  // namespace pybind11::detail

namespace plsing {

using namespace tracking;

namespace {

using Numbers = Eigen::Matrix<double, 12, 1>;  // of a camera

Image checked(const Image& image)
{
    if (image.ndim() != 2)
        throw std::invalid_argument("the image has " + std::to_string(image.ndim()) + " dimensions, expected 2");
    return image;
}

template <typename Edges>
py::array_t<int> rows_of(const Edges& edges)
{
    py::array_t<int> rows(static_cast<py::ssize_t>(edges.size()));
    for (std::size_t i = 0; i < edges.size(); ++i)
        rows.mutable_at(i) = edges[i].edge;
    return rows;
}

}  // namespace

void bind_tracking(pybind11::module_& module)
{
    py::class_<EdgeFit>(module, "EdgeFit", "What the edges of an image say of the pose.")
        .def_property_readonly("pose", [](const EdgeFit& fit) { return fit.fit.pose; })
        .def_property_readonly("information", [](const EdgeFit& fit) { return fit.fit.information; })
        .def_property_readonly("scale", [](const EdgeFit& fit) { return fit.fit.scale; })
        .def_property_readonly("squares", [](const EdgeFit& fit) { return fit.fit.squares; })
        .def_property_readonly("weights", [](const EdgeFit& fit) { return fit.fit.weights; })
        .def_property_readonly("edges", [](const EdgeFit& fit) { return rows_of(fit.lines); })
        .def_property_readonly("visible", [](const EdgeFit& fit) { return rows_of(fit.visible); })
        .def_property_readonly("residuals", [](const EdgeFit& fit) { return fit.fit.residuals; })
        .def_property_readonly("lines", [](const EdgeFit& fit) {
            Eigen::Matrix<double, Eigen::Dynamic, 5, Eigen::RowMajor> rows(fit.lines.size(), 5);
            for (std::size_t i = 0; i < fit.lines.size(); ++i) {
                const FittedLine& line = fit.line(i);
                rows.row(i) << line.phi, line.rho, line.covariance(0, 0), line.covariance(0, 1), line.covariance(1, 1);
            }
            return rows;
        })
        .def_property_readonly("totals", [](const EdgeFit& fit) {
            const Eigen::Vector4d sum = fit.counts.colwise().sum();
            return std::make_tuple(sum[0], sum[1], sum[2], sum[3]);
        })
        .def("freedom", &EdgeFit::freedom);
    py::class_<EdgeTracker>(module, "EdgeTracker", "Edges of an object followed in the images of one camera.")
        .def(py::init([](Rows3 vertices, IntRows2 edges, IntRows3 triangles, std::vector<std::vector<int>> of_edges,
                         const Numbers& camera, int width, int height, double gamma) {
            return EdgeTracker({std::move(vertices), std::move(edges), std::move(triangles), std::move(of_edges)},
                               Camera(camera), width, height, gamma);
        }))
        .def("forget", &EdgeTracker::forget)
        .def("samples", [](const EdgeTracker& tracker, const Transform& pose) {
            std::vector<std::pair<int, std::vector<Vector2d>>> points;
            for (const VisibleEdge& edge : tracker.visible_edges(pose)) {
                points.push_back({edge.edge, {}});
                for (const Sample& sample : edge.samples)
                    points.back().second.push_back(sample.point);
            }
            return points;
        })
        .def("fit", [](EdgeTracker& tracker, const Image& image, double noise, const Transform& start,
                       const Matrix6& information, const std::vector<int>& ranges, const Readout* readout) {
            return tracker.fit(checked(image), noise, start, information, ranges, readout);
        })
        .def("other", &EdgeTracker::other)
        .def("learn", &EdgeTracker::learn)
        .def("seen_lines", &EdgeTracker::seen_lines);
    py::class_<FaceMemory>(module, "FaceMemory", "How bright an object's faces were, place by place.")
        .def(py::init<const Rows3&, const std::vector<int>&, double>())
        .def("covered", [](FaceMemory& memory, const Image& image, const Image& faces, const std::vector<int>& triangles,
                           int left, int top, const Transform& pose, const Numbers& camera) {
            return memory.covered(checked(image), checked(faces), triangles, left, top, pose, Camera(camera));
        });
    py::class_<Readout>(module, "Readout", "How the rows of an image are read if the object moved evenly.")
        .def(py::init([](const Transform& before, double share, const Vector3d& center) {
            return Readout{before, share, center};
        }))
        .def("of", &Readout::of);
    module.def("project", [](const Rows3& points, const Numbers& numbers) {
        const Camera camera(numbers);
        Rows2 pixels(points.rows(), 2);
        for (Eigen::Index i = 0; i < points.rows(); ++i)
            pixels.row(i) = camera.pixel(points.row(i).head<2>().transpose() / points(i, 2)).transpose();
        return pixels;
    });
    module.def("uncertainty", &uncertainty);
    module.def("fit_points", [](const Rows3& points, const Rows2& seen, double deviation, const Transform& pose) {
        if (points.rows() != seen.rows())
            throw std::invalid_argument("as many points as images of them are needed");
        const PoseFit fit = fit_points(points, seen, deviation, pose);
        return py::make_tuple(fit.pose.rotation, fit.pose.translation, fit.information, fit.scale, fit.weights);
    });
    module.def("motion_between", &motion);
    module.def("image_noise", [](const Image& image) { return image_noise(checked(image)); });
}

}  // namespace plsing
