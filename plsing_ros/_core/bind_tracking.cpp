// SPDX-License-Identifier: Apache-2.0
// The line tracker's inner loops, as plsing_ros/tracking/ calls them.
#include "tracking.hpp"

namespace plsing {

using namespace tracking;

namespace {

Transform transform(const Matrix3d& rotation, const Vector3d& translation) { return {rotation, translation}; }

void check(const Image& image)
{
    if (image.ndim() != 2)
        throw std::invalid_argument("the image has " + std::to_string(image.ndim()) + " dimensions, expected 2");
}

py::tuple result_of(const PoseFit& fit)
{
    const Rows2 residuals = Eigen::Map<const Rows2>(fit.residuals.empty() ? nullptr : fit.residuals.front().data(),
                                                    static_cast<Eigen::Index>(fit.residuals.size()), 2);
    return py::make_tuple(fit.pose.rotation, fit.pose.translation, fit.information, fit.scale, fit.chosen,
                          fit.weights, fit.squares, residuals);
}

struct Visible { std::vector<VisibleEdge> edges; };
struct Lines { std::vector<EdgeLines> edges; };

template <typename Edges>
std::vector<int> rows_of(const Edges& edges)
{
    std::vector<int> rows;
    for (const auto& edge : edges)
        rows.push_back(edge.edge);
    return rows;
}

}  // namespace

void bind_tracking(pybind11::module_& module)
{
    py::class_<Visible>(module, "VisibleEdges", "Visible parts of edges, their samples, and what was found there.")
        .def("__len__", [](const Visible& visible) { return visible.edges.size(); })
        .def_property_readonly("edges", [](const Visible& visible) { return rows_of(visible.edges); })
        .def("points", [](const Visible& visible, int i) {
            const auto& samples = visible.edges.at(i).samples;
            Rows2 points(samples.size(), 2);
            for (std::size_t j = 0; j < samples.size(); ++j)
                points.row(j) = samples[j].point.transpose();
            return points;
        });
    py::class_<Lines>(module, "EdgeLines", "The lines that fit each visible edge, best first.")
        .def("__len__", [](const Lines& lines) { return lines.edges.size(); })
        .def_property_readonly("edges", [](const Lines& lines) { return rows_of(lines.edges); })
        .def("chosen", [](const Lines& lines, const std::vector<int>& chosen) {
            // Rows of phi, rho, var phi, cov, var rho, support, contrast, offset.
            Eigen::Matrix<double, Eigen::Dynamic, 8, Eigen::RowMajor> rows(chosen.size(), 8);
            for (std::size_t i = 0; i < chosen.size(); ++i) {
                const FittedLine& line = lines.edges.at(i).lines.at(chosen[i]);
                rows.row(i) << line.phi, line.rho, line.covariance(0, 0), line.covariance(0, 1), line.covariance(1, 1),
                    line.support, line.contrast, line.offset;
            }
            return rows;
        });
    py::class_<EdgeModel>(module, "EdgeModel", "Vertices, edges and triangles of an object.")
        .def(py::init<Rows3, IntRows2, IntRows3, std::vector<std::vector<int>>>())
        .def("visible_edges", [](const EdgeModel& model, const Matrix3d& rotation, const Vector3d& translation,
                                 const Eigen::Matrix<double, 12, 1>& camera, int width, int height, double step,
                                 double margin) {
            return Visible{model.visible_edges(transform(rotation, translation), Camera(camera), width, height, step,
                                               margin)};
        })
        .def("correct_rows", [](const EdgeModel& model, Visible& visible, const Matrix3d& rotation,
                                const Vector3d& translation, const Vector6& motion, double row, double focal) {
            model.correct_rows(visible.edges, transform(rotation, translation), motion, row, focal);
        })
        .def("fit_pose", [](const EdgeModel& model, const Lines& lines, const Matrix3d& rotation,
                            const Vector3d& translation, const Matrix3d& prior_rotation,
                            const Vector3d& prior_translation, const Matrix6& prior_information) {
            return result_of(fit_pose(model, lines.edges, transform(rotation, translation),
                                      transform(prior_rotation, prior_translation), prior_information));
        })
        .def("support", [](const EdgeModel& model, const Visible& visible, const Matrix3d& rotation,
                           const Vector3d& translation, double focal, int range, double tolerance) {
            return edge_support(model, visible.edges, transform(rotation, translation), focal, range, tolerance);
        });
    py::class_<EdgeMemory>(module, "EdgeMemory", "How bright an object's own faces are beside its edges.")
        .def(py::init<int>())
        .def("forget", &EdgeMemory::forget)
        .def("learn", [](EdgeMemory& memory, const EdgeModel& model, const Visible& visible, const Matrix3d& rotation,
                         const Vector3d& translation, double focal, const std::vector<bool>& agree) {
            memory.learn(model, visible.edges, transform(rotation, translation), focal, agree);
        });
    module.def("search_edges", [](Visible& visible, const Image& image, const Eigen::Matrix<double, 12, 1>& camera,
                                  int range, double noise, double gamma, const Eigen::VectorXd& contrast,
                                  EdgeMemory& memory) {
        check(image);
        search_edges(visible.edges, image, Camera(camera), range, noise, gamma, contrast, memory);
    });
    module.def("fit_edge_lines", [](const Visible& visible, double focal, int range) {
        return Lines{fit_lines(visible.edges, focal, range)};
    });
    module.def("fit_points", [](const Rows3& points, const Rows2& seen, double deviation, const Matrix3d& rotation,
                                const Vector3d& translation) {
        if (points.rows() != seen.rows())
            throw std::invalid_argument("as many points as images of them are needed");
        return result_of(fit_points(points, seen, deviation, transform(rotation, translation)));
    });
    module.def("motion_between", [](const Matrix3d& rotation, const Vector3d& translation, const Matrix3d& to_rotation,
                                    const Vector3d& to_translation) {
        return motion(transform(rotation, translation), transform(to_rotation, to_translation));
    });
    module.def("image_noise", [](const Image& image) {
        check(image);
        return image_noise(image);
    });
}

}  // namespace plsing
