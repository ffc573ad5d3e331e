// SPDX-License-Identifier: Apache-2.0
// Which parts of a model's edges a camera sees, with samples along them.
#include "tracking.hpp"

namespace plsing::tracking {
namespace {

constexpr double NEAR = 1e-3;           // of the depth of the model: what is closer to the focal plane is left out
constexpr double DEPTH_TOLERANCE = 2e-3;  // a face hides only what is farther by this share
constexpr double WIDE = 4.0;            // [px] of the middle of a triangle from an edge beside which it is looked at
constexpr double STEP = 4.0;            // [px] between samples
constexpr double MARGIN = 6.0;          // [px] of samples from the border of the image
constexpr double TRIM = 4.0;            // [px] left out at each end of an edge, where other edges begin

// A triangle in the normalised image, with its inverse depth as a linear function there.
struct Screen {
    Vector2d low, high;
    std::array<Vector3d, 3> sides;  // inside where all are positive
    Vector3d inverse_depth;
    int index;

    bool hides(const Vector2d& p, double inverse) const
    {
        if (p.x() < low.x() || p.x() > high.x() || p.y() < low.y() || p.y() > high.y())
            return false;
        const Vector3d h(p.x(), p.y(), 1.0);
        for (const Vector3d& side : sides)
            if (side.dot(h) <= 0.0)
                return false;
        return inverse_depth.dot(h) > inverse * (1.0 + DEPTH_TOLERANCE);
    }
};

}  // namespace

Vector6 motion(const Transform& from, const Transform& to)
{
    const Matrix3d turn = to.rotation * from.rotation.transpose();
    const Eigen::AngleAxisd angle_axis(turn);
    Vector6 step;
    step.tail<3>() = angle_axis.angle() * angle_axis.axis();
    step.head<3>() = to.translation - turn * from.translation;
    return step;
}

Transform Transform::moved(const Vector6& step) const
{
    const double angle = step.tail<3>().norm();
    const Matrix3d turn = angle > 0.0 ? Eigen::AngleAxisd(angle, step.tail<3>() / angle).toRotationMatrix()
                                      : Matrix3d(Matrix3d::Identity());
    // Through the quaternion, so that rounding does not add up.
    return {Eigen::Quaterniond(Matrix3d(turn * rotation)).normalized().toRotationMatrix(),
            turn * translation + step.head<3>()};
}

EdgeModel::EdgeModel(Rows3 vertices, IntRows2 edges, IntRows3 triangles, std::vector<std::vector<int>> edge_triangles)
    : vertices_(std::move(vertices)), edges_(std::move(edges)), triangles_(std::move(triangles)),
      edge_triangles_(std::move(edge_triangles))
{
    const int n = static_cast<int>(vertices_.rows());
    const auto outside = [n](int i) { return i < 0 || i >= n; };
    if (edges_.unaryExpr(outside).any() || triangles_.unaryExpr(outside).any())
        throw std::invalid_argument("an edge or a triangle names a vertex that is not there");
    if (edge_triangles_.size() != static_cast<std::size_t>(edges_.rows()))
        throw std::invalid_argument("one list of triangles for each edge is needed");
}

std::vector<VisibleEdge> EdgeModel::visible_edges(const Transform& T_camera_model, const Camera& camera, int width,
                                                  int height) const
{
    const Eigen::Index n = vertices_.rows();
    Rows3 points(n, 3);
    for (Eigen::Index i = 0; i < n; ++i)
        points.row(i) = (T_camera_model * Vector3d(vertices_.row(i))).transpose();
    const double nearest = NEAR * std::max(points.col(2).maxCoeff(), 1e-9);

    std::vector<Screen> screens;
    screens.reserve(triangles_.rows());
    for (Eigen::Index i = 0; i < triangles_.rows(); ++i) {
        Matrix3d corners;
        for (int j = 0; j < 3; ++j)
            corners.col(j) = points.row(triangles_(i, j)).transpose();
        if (corners.row(2).minCoeff() < nearest)
            continue;
        Matrix3d image = corners;
        for (int j = 0; j < 3; ++j)
            image.col(j) /= corners(2, j);
        double area = image.determinant();
        if (std::abs(area) < 1e-9)
            continue;  // seen edge on, it hides nothing
        Screen screen;
        screen.index = static_cast<int>(i);
        screen.low = image.topRows<2>().rowwise().minCoeff();
        screen.high = image.topRows<2>().rowwise().maxCoeff();
        for (int j = 0; j < 3; ++j)
            screen.sides[j] = image.col(j).cross(image.col((j + 1) % 3)) * (area > 0.0 ? 1.0 : -1.0);
        screen.inverse_depth = image.transpose().inverse() * corners.row(2).transpose().cwiseInverse();
        screens.push_back(screen);
    }

    std::vector<VisibleEdge> found;
    for (Eigen::Index e = 0; e < edges_.rows(); ++e) {
        Vector3d a = points.row(edges_(e, 0)), b = points.row(edges_(e, 1));
        if (a.z() < nearest && b.z() < nearest)
            continue;
        if (a.z() < nearest)
            a = b + (a - b) * ((b.z() - nearest) / (b.z() - a.z()));
        if (b.z() < nearest)
            b = a + (b - a) * ((a.z() - nearest) / (a.z() - b.z()));
        const Vector3d moment = a.cross(b);
        const double depth = moment.head<2>().norm();
        const Vector2d start = a.head<2>() / a.z(), end = b.head<2>() / b.z();
        const Vector2d span = end - start;
        const double length = span.norm() * camera.focal;
        // An edge seen end on has no image line.
        if (length < 2.0 * TRIM + STEP || depth < 1e-12)
            continue;
        // In a distorted image a line may leave it and come back: each sample is looked at.
        const int count = std::min(static_cast<int>((length - 2.0 * TRIM) / STEP) + 1, 400);
        VisibleEdge visible;
        visible.edge = static_cast<int>(e);
        visible.normal = moment.head<2>() / depth;
        const auto& own = edge_triangles_[e];
        for (int triangle : own) {
            const Vector3d middle = (points.row(triangles_(triangle, 0)) + points.row(triangles_(triangle, 1)) +
                                     points.row(triangles_(triangle, 2))).transpose() / 3.0;
            const double beside = moment.dot(middle) / (middle.z() * depth) * camera.focal;
            if (middle.z() > nearest && std::abs(beside) > WIDE)
                visible.on_object[beside > 0.0] = true;
        }
        for (int i = 0; i < count; ++i) {
            const double share = count > 1 ? (TRIM + (length - 2.0 * TRIM) * i / (count - 1)) / length : 0.5;
            Sample sample;
            sample.point = start + share * span;
            const Vector2d pixel = camera.pixel(sample.point);
            if (!(pixel.x() >= MARGIN && pixel.y() >= MARGIN && pixel.x() <= width - 1 - MARGIN &&
                  pixel.y() <= height - 1 - MARGIN))
                continue;
            const double inverse = (1.0 - share) / a.z() + share / b.z();
            const double at = share / (b.z() * inverse);
            sample.place = std::min(static_cast<int>(at * PLACES_OF_EDGE), PLACES_OF_EDGE - 1);
            bool hidden = false;
            for (const Screen& screen : screens) {
                if (screen.hides(sample.point, inverse) &&
                    std::find(own.begin(), own.end(), screen.index) == own.end()) {
                    hidden = true;
                    break;
                }
            }
            if (!hidden)
                visible.samples.push_back(sample);
        }
        if (visible.samples.size() < 3)
            continue;
        visible.middle = 0.5 * (visible.samples.front().point + visible.samples.back().point);
        const Vector2d tangent = visible.tangent();
        for (Sample& sample : visible.samples)
            sample.along = tangent.dot(sample.point - visible.middle) * camera.focal;
        found.push_back(std::move(visible));
    }
    return found;
}

void EdgeModel::correct_rows(std::vector<VisibleEdge>& visible, const Transform& T_camera_model, const Vector6& motion,
                             double row, double focal) const
{
    for (VisibleEdge& edge : visible) {
        const Vector3d a = T_camera_model * Vector3d(vertices_.row(edges_(edge.edge, 0)));
        const Vector3d side = T_camera_model * Vector3d(vertices_.row(edges_(edge.edge, 1))) - a;
        for (Sample& sample : edge.samples) {
            const Vector3d ray(sample.point.x(), sample.point.y(), 1.0), across = ray.cross(side);
            const Vector3d point = a - across.dot(ray.cross(a)) / across.squaredNorm() * side;
            const Vector3d speed = (motion.head<3>() + motion.tail<3>().cross(point)) / point.z();
            const double flow = edge.normal.dot(speed.head<2>() - speed.z() * sample.point) * focal;
            for (int j = 0; j < sample.count; ++j)
                sample.candidates[j].offset += static_cast<float>((row - sample.point.y()) * flow);
        }
    }
}

}  // namespace plsing::tracking
