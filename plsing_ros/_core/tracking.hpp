// SPDX-License-Identifier: Apache-2.0
// What the files of the line tracker share: the camera, the samples along visible edges, the lines fitted to them.
#pragma once

#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <tuple>
#include <vector>

#include "core.hpp"

namespace plsing::tracking {

using Eigen::Matrix2d;
using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix26 = Eigen::Matrix<double, 2, 6>;
using Rows3 = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;
using Rows4 = Eigen::Matrix<double, Eigen::Dynamic, 4, Eigen::RowMajor>;
using Rows2 = Eigen::Matrix<double, Eigen::Dynamic, 2, Eigen::RowMajor>;
using IntRows3 = Eigen::Matrix<int, Eigen::Dynamic, 3, Eigen::RowMajor>;
using IntRows2 = Eigen::Matrix<int, Eigen::Dynamic, 2, Eigen::RowMajor>;

// fx, fy, cx, cy [px], then k1 k2 p1 p2 k3 k4 k5 k6 as OpenCV and sensor_msgs/CameraInfo define them.
struct Camera {
    explicit Camera(const Eigen::Matrix<double, 12, 1>& numbers)
        : fx(numbers[0]), fy(numbers[1]), cx(numbers[2]), cy(numbers[3]), k(numbers.tail<8>()),
          distorted(numbers.tail<8>().cwiseAbs().maxCoeff() > 0.0), focal(0.5 * (numbers[0] + numbers[1]))
    {
    }

    Vector2d pixel(Vector2d p) const
    {
        if (distorted) {
            const double x = p.x(), y = p.y(), r2 = x * x + y * y;
            const double radial = (1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))) /
                                  (1.0 + r2 * (k[5] + r2 * (k[6] + r2 * k[7])));
            p = {x * radial + 2.0 * k[2] * x * y + k[3] * (r2 + 2.0 * x * x),
                 y * radial + k[2] * (r2 + 2.0 * y * y) + 2.0 * k[3] * x * y};
        }
        return {fx * p.x() + cx, fy * p.y() + cy};
    }

    double fx, fy, cx, cy;
    Eigen::Matrix<double, 8, 1> k;
    bool distorted;
    double focal;  // pixels for a unit of the normalised image, for lengths and tolerances
};

// A pose T_camera_model: p_camera = rotation * p_model + translation.
struct Transform {
    Matrix3d rotation;
    Vector3d translation;

    Vector3d operator*(const Vector3d& point) const { return rotation * point + translation; }
    // The pose after a small motion of the model in the camera frame, (v, omega).
    Transform moved(const Vector6& step) const;
};

// The motion (v, omega) in the camera frame from one pose to another.
Vector6 motion(const Transform& from, const Transform& to);

struct Candidate {
    float offset;    // along the normal of the projected edge [px]
    float response;  // signed step of brightness across it
    // Grey levels, near and farther, on the side that the normal points away from, then on the one that it points to.
    std::array<float, 4> beside;
};

constexpr int MAX_CANDIDATES = 3;
constexpr int PLACES_OF_EDGE = 24;  // whose brightness is remembered

struct Sample {
    Vector2d point;  // on the projected edge, in the normalised image
    double along;    // from the middle of the visible part, along the tangent [px]
    int place;       // of PLACES_OF_EDGE
    bool covered = false;  // whether the object's faces look otherwise beside it than remembered
    int count = 0;
    std::array<Candidate, MAX_CANDIDATES> candidates;
};

// The visible part of a projected edge: the line normal . p + rho = 0 with normal = (cos phi, sin phi).
struct VisibleEdge {
    int edge;
    Vector2d normal;
    Vector2d middle;  // of the visible part, in the normalised image
    std::array<bool, 2> on_object{};  // whether the object's own faces are on the two sides, as in Candidate
    std::vector<Sample> samples;

    double phi() const { return std::atan2(normal.y(), normal.x()); }
    // A quarter turn from the normal.
    Vector2d tangent() const { return {-normal.y(), normal.x()}; }
};

struct FittedLine {
    double phi, rho;
    Matrix2d covariance;  // of (phi, rho)
    double support;       // samples that agree
    double contrast;      // mean signed response of these
};

// The lines that fit one visible edge, best first.
struct EdgeLines {
    int edge;
    std::vector<FittedLine> lines;
};

class EdgeModel {
public:
    EdgeModel(Rows3 vertices, IntRows2 edges, IntRows3 triangles, std::vector<std::vector<int>> edge_triangles);
    // Return the visible parts of the edges, with samples.
    std::vector<VisibleEdge> visible_edges(const Transform& T_camera_model, const Camera& camera, int width,
                                           int height) const;
    // Move what was found to where it was when one row of the normalised image was read, in a camera that reads row by
    // row; `motion` is that of the model, in the camera frame, while a unit of the normalised image is read.
    void correct_rows(std::vector<VisibleEdge>& visible, const Transform& T_camera_model, const Vector6& motion,
                      double row, double focal) const;
    // The image line of an edge: of unit normal, as in VisibleEdge.
    Vector3d line(int edge, const Transform& T_camera_model) const
    {
        const Vector3d moment = (T_camera_model * Vector3d(vertices_.row(edges_(edge, 0))))
                                    .cross(T_camera_model * Vector3d(vertices_.row(edges_(edge, 1))));
        return moment / moment.head<2>().norm();
    }
    const Rows3& vertices() const { return vertices_; }
    const IntRows2& edges() const { return edges_; }

private:
    Rows3 vertices_;
    IntRows2 edges_;
    IntRows3 triangles_;
    std::vector<std::vector<int>> edge_triangles_;
};

using Image = py::array_t<std::uint8_t, py::array::c_style>;
// Of each grey level, itself and the light that it stands for, on the same scale.
using GreyLevels = std::array<Eigen::Array2d, 256>;

// Of a place [grey levels].
struct Brightness {
    float mean = 0.0F, deviation = 0.0F;

    bool is_known() const { return mean > 0.0F; }
    // In an image that is `gain` times as bright as the memory.
    bool differs(float now, float gain, float least) const;
    void learn(float now, float gain, float rate);
};

class EdgeMemory {
public:
    explicit EdgeMemory(int edges) : levels_(edges) {}
    bool allows(const VisibleEdge& edge, const Sample& sample, const Candidate& candidate) const;
    float ratio(const VisibleEdge& edge, const Sample& sample, const Candidate& candidate) const;
    void set_gain(std::vector<float>& ratios);
    void learn(const EdgeModel& model, const std::vector<VisibleEdge>& edges, const Transform& pose, double focal,
               const std::vector<bool>& agree);  // of all edges

private:
    std::vector<std::array<std::array<Brightness, 4>, PLACES_OF_EDGE>> levels_;
    float gain_ = 1.0F;  // of this image over the memory
};

class FaceMemory {
public:
    // Places on triangles of the object, so far from each other [m].
    FaceMemory(const Rows3& places, const std::vector<int>& triangles, double apart);
    // Circles, x, y and radius, of a part of the image that begins at `left`, `top`, in which something is in the way;
    // learn from the rest. `faces` says which of the triangles is seen at each pixel of the part, from 1; 0 for none.
    IntRows3 covered(const Image& image, const Image& faces, const std::vector<int>& triangles, int left, int top,
                     const Transform& pose, const Camera& camera);

private:
    struct Place {
        Vector3d point;
        int triangle;
        std::array<Brightness, 2> levels;  // mean and scatter round the place
    };
    std::vector<Place> places_;
    double apart_;
};

// Fill the candidates of each sample from the image.
void search_edges(std::vector<VisibleEdge>& edges, const Image& image, const Camera& camera, int range, double noise,
                  const GreyLevels& levels, const Eigen::VectorXd& contrast, EdgeMemory& memory);
// The standard deviation of the noise of an image [grey levels].
double image_noise(const Image& image);

std::vector<EdgeLines> fit_lines(const std::vector<VisibleEdge>& edges, double focal, int range);

struct PoseFit {
    Transform pose;
    Matrix6 information;     // of a motion of the model in the camera frame
    double scale;            // robust residual in standard deviations: 1 if the covariances are right
    std::vector<int> chosen; // which line of each edge; -1 for none
    Eigen::VectorXd weights;
    double squares = 0.0;    // weighted sum of the squared residuals
    Rows2 residuals;         // of each observation, in its standard deviations
};

PoseFit fit_pose(const EdgeModel& model, const std::vector<EdgeLines>& lines, Transform pose, const Transform& prior,
                 const Matrix6& prior_information);
// The pose that fits points seen in the normalised image, each with the same standard deviation.
PoseFit fit_points(const Rows3& points, const Rows2& seen, double deviation, Transform pose);
// Of each visible edge: its samples, those with a candidate at the pose, by chance, and without one but covered.
Rows4 edge_support(const EdgeModel& model, const std::vector<VisibleEdge>& edges, const Transform& pose, double focal,
                   int range, double tolerance);

// How the rows of an image are read if the object moved evenly since the one before.
struct Readout {
    Transform before;
    double share;     // of the time from image to image in which a unit of the normalised image is read
    Vector3d center;  // of the object

    // The motion while a unit of the normalised image is read, and the row of the object's middle there.
    std::pair<Vector6, double> of(const Transform& pose) const;
};

// What the edges of an image say of the pose.
struct EdgeFit {
    PoseFit fit;
    std::vector<VisibleEdge> visible;
    std::vector<EdgeLines> lines;
    Rows4 counts;  // as edge_support has them

    const FittedLine& line(std::size_t i) const { return lines[i].lines[fit.chosen[i]]; }
    bool agrees(std::size_t i) const { return fit.weights[i] > 0.5; }
    // Degrees of freedom of the residuals: what lines decide of the pose they cannot contradict.
    double freedom(const Matrix6& prior) const;
};

// The covariance of a motion of the model in the camera frame that an information stands for, times `share`; the standard
// deviations of the center's position, where it is largest, and of the rotation.
std::tuple<Matrix6, double, double> uncertainty(const Matrix6& information, const Transform& pose,
                                                const Vector3d& center, double share);

class EdgeTracker {
public:
    EdgeTracker(EdgeModel model, const Camera& camera, int width, int height, double gamma);
    void forget(bool contrast);
    std::vector<VisibleEdge> visible_edges(const Transform& T_camera_model) const
    {
        return model_.visible_edges(T_camera_model, camera_, width_, height_);
    }
    // Fit with one search range after another, from a pose with this information; nothing where no edge is in sight.
    std::optional<EdgeFit> fit(const Image& image, double noise, const Transform& start, const Matrix6& information,
                               const std::vector<int>& ranges, const Readout* readout);
    // The pose near another start that fits the same lines, and how many samples it explains.
    std::pair<Transform, double> other(const EdgeFit& fit, const Transform& start) const;
    void learn(const EdgeFit& fit, const Transform& pose, bool contrast);
    // Lines, usable, covariances times `share`, and ends for a LineObservation, a row for each edge; else zeros.
    std::tuple<Rows3, Eigen::Array<bool, Eigen::Dynamic, 1>, Rows3, Rows4> seen_lines(
        const EdgeFit& fit, const Transform& pose, double share) const;

private:
    EdgeModel model_;
    Camera camera_;
    int width_, height_;
    GreyLevels levels_;
    Eigen::VectorXd contrast_;  // signed step of brightness of each edge, 0 if unknown
    EdgeMemory memory_;
};

}  // namespace plsing::tracking
