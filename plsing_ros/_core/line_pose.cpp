// SPDX-License-Identifier: Apache-2.0
// The pose that fits lines and points: Gauss-Newton with Cauchy's weights first, Tukey's in the end.
#include <algorithm>

#include "lines.hpp"
#include "tracking.hpp"

namespace plsing::tracking {
namespace {

constexpr int ITERATIONS = 12;
constexpr int CAUCHY_ITERATIONS = 6;
constexpr double MIN_STEP = 1e-7, MAX_TURN = 0.5;  // [rad]
constexpr double CAUCHY = 2.385, TUKEY = 4.685;

double weight_of(double residual, bool tukey)
{
    if (!tukey)
        return 1.0 / (1.0 + residual * residual / (CAUCHY * CAUCHY));
    const double u = residual / TUKEY;
    return std::abs(u) < 1.0 ? (1.0 - u * u) * (1.0 - u * u) : 0.0;
}

// Robust scale of the lengths of two-vectors: their median is 1.177 for unit deviations.
double scale_of(std::vector<double> lengths)
{
    if (lengths.empty())
        return 1.0;
    std::nth_element(lengths.begin(), lengths.begin() + lengths.size() / 2, lengths.end());
    return lengths[lengths.size() / 2] / 1.1774;
}

// Gauss-Newton from a pose, drawn to a prior. `fill` makes the residuals, two for each observation in units of their
// standard deviations, and their derivatives by a motion.
template <typename Fill>
PoseFit fit(std::size_t count, Transform pose, const Transform& prior, const Matrix6& prior_information, Fill fill)
{
    PoseFit fit;
    fit.weights = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(count));
    std::vector<Vector2d> residuals(count);
    std::vector<Matrix26> jacobians(count);
    std::vector<double> lengths(count);
    for (int iteration = 0; iteration <= ITERATIONS; ++iteration) {
        const bool tukey = iteration >= CAUCHY_ITERATIONS;
        fill(pose, residuals, jacobians);
        for (std::size_t i = 0; i < count; ++i)
            lengths[i] = residuals[i].norm();
        fit.scale = scale_of(lengths);
        const double scale = std::max(1.0, fit.scale);
        fit.information = prior_information;
        Vector6 gradient = prior_information * motion(pose, prior);
        fit.squares = 0.0;
        for (std::size_t i = 0; i < count; ++i) {
            fit.weights[i] = weight_of(lengths[i] / scale, tukey);
            fit.squares += fit.weights[i] * lengths[i] * lengths[i];
            const double weight = fit.weights[i] / (scale * scale);
            fit.information += weight * jacobians[i].transpose() * jacobians[i];
            gradient += weight * jacobians[i].transpose() * residuals[i];
        }
        if (iteration == ITERATIONS)
            break;
        // Directions that nothing is known about stay where they are.
        Matrix6 damped = fit.information;
        damped.diagonal() += 1e-9 * fit.information.diagonal() + Vector6::Constant(1e-9);
        Vector6 step = damped.ldlt().solve(gradient);
        const double turn = step.tail<3>().norm();
        if (turn > MAX_TURN)
            step *= MAX_TURN / turn;
        if (!step.allFinite())
            break;
        pose = pose.moved(step);
        // On to the next kind of weights, or to the end, where this one has nothing more to say.
        if (step.norm() < MIN_STEP)
            iteration = tukey ? ITERATIONS - 1 : CAUCHY_ITERATIONS - 1;
    }
    fit.pose = pose;
    fit.residuals.resize(static_cast<Eigen::Index>(count), 2);
    for (std::size_t i = 0; i < count; ++i)
        fit.residuals.row(i) = residuals[i].transpose();
    return fit;
}

}  // namespace

PoseFit fit_pose(const EdgeModel& model, const std::vector<EdgeLines>& lines, Transform pose, const Transform& prior,
                 const Matrix6& prior_information)
{
    std::vector<int> chosen(lines.size(), -1);
    std::vector<std::vector<Matrix2d>> whitening(lines.size());
    for (std::size_t i = 0; i < lines.size(); ++i)
        for (const FittedLine& line : lines[i].lines)
            whitening[i].push_back(Eigen::LLT<Matrix2d>(line.covariance).matrixL().solve(Matrix2d::Identity()));
    const auto fill = [&](const Transform& at, std::vector<Vector2d>& residuals, std::vector<Matrix26>& jacobians) {
        for (std::size_t i = 0; i < lines.size(); ++i) {
            const int e = lines[i].edge;
            const Vector3d a = at * Vector3d(model.vertices().row(model.edges()(e, 0)));
            const Vector3d b = at * Vector3d(model.vertices().row(model.edges()(e, 1)));
            const Vector3d moment = a.cross(b), direction = b - a;
            const double square = moment.head<2>().squaredNorm(), depth = std::sqrt(square);
            Eigen::Matrix<double, 3, 6> by_motion;
            by_motion << -skew(direction), -skew(moment);
            Eigen::Matrix<double, 2, 3> by_moment;
            by_moment << -moment.y() / square, moment.x() / square, 0.0,
                -moment.z() * moment.x() / (square * depth), -moment.z() * moment.y() / (square * depth), 1.0 / depth;
            const double phi = std::atan2(moment.y(), moment.x()), rho = moment.z() / depth;
            double least = std::numeric_limits<double>::infinity();
            const double most = lines[i].lines.front().support;
            for (std::size_t j = 0; j < lines[i].lines.size(); ++j) {
                const FittedLine& line = lines[i].lines[j];
                const Vector2d residual = whitening[i][j] * Vector2d(std::remainder(line.phi - phi, 2.0 * M_PI),
                                                                     line.rho - rho);
                // The less of the edge supports a line, the nearer it must be.
                const double cost = residual.norm() * (0.5 + 0.5 * most / line.support);
                if (cost < least) {
                    least = cost;
                    chosen[i] = static_cast<int>(j);
                    residuals[i] = residual;
                    jacobians[i] = whitening[i][j] * by_moment * by_motion;
                }
            }
        }
    };
    PoseFit found = fit(lines.size(), pose, prior, prior_information, fill);
    found.chosen = chosen;
    return found;
}

PoseFit fit_points(const Rows3& points, const Rows2& seen, double deviation, Transform pose)
{
    const auto fill = [&](const Transform& at, std::vector<Vector2d>& residuals, std::vector<Matrix26>& jacobians) {
        for (Eigen::Index i = 0; i < points.rows(); ++i) {
            const Vector3d p = at * Vector3d(points.row(i));
            const double inverse = 1.0 / std::max(p.z(), 1e-9);
            Eigen::Matrix<double, 2, 3> by_point;
            by_point << inverse, 0.0, -p.x() * inverse * inverse, 0.0, inverse, -p.y() * inverse * inverse;
            Eigen::Matrix<double, 3, 6> by_motion;
            by_motion << Matrix3d::Identity(), -skew(p);
            residuals[i] = (seen.row(i).transpose() - p.head<2>() * inverse) / deviation;
            jacobians[i] = by_point * by_motion / deviation;
        }
    };
    return fit(points.rows(), pose, pose, Matrix6::Zero(), fill);
}

Rows4 edge_support(const EdgeModel& model, const std::vector<VisibleEdge>& edges, const Transform& pose, double focal,
                   int range, double tolerance)
{
    Rows4 support = Rows4::Zero(edges.size(), 4);
    for (std::size_t i = 0; i < edges.size(); ++i) {
        const VisibleEdge& edge = edges[i];
        const Vector3d line = model.line(edge.edge, pose);
        const double across = line.head<2>().dot(edge.normal);
        support(i, 0) = static_cast<double>(edge.samples.size());
        if (std::abs(across) < 0.5)
            continue;
        for (const Sample& sample : edge.samples) {
            const double at = -(line.head<2>().dot(sample.point) + line.z()) / across * focal;
            int elsewhere = 0;
            bool here = false;
            for (int j = 0; j < sample.count; ++j)
                (std::abs(sample.candidates[j].offset - at) < tolerance ? here = true : ++elsewhere > 0);
            support(i, 1) += here;
            support(i, 3) += sample.covered && !here;
            support(i, 2) += std::min(1.0, elsewhere * 2.0 * tolerance / (2.0 * range + 1.0));
        }
    }
    return support;
}

}  // namespace plsing::tracking
