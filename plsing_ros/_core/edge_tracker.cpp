// SPDX-License-Identifier: Apache-2.0
// From an image to a pose by the edges of an object, and what is learnt from it.
#include "lines.hpp"
#include "tracking.hpp"

namespace plsing::tracking {
namespace {

constexpr double TOLERANCE = 1.5;  // of an edge in the image from the projected one [px]
constexpr double RATE = 0.3;       // of learning contrast

}  // namespace

EdgeTracker::EdgeTracker(EdgeModel model, const Camera& camera, int width, int height, double gamma)
    : model_(std::move(model)), camera_(camera), width_(width), height_(height),
      contrast_(Eigen::VectorXd::Zero(model_.edges().rows())), memory_(static_cast<int>(model_.edges().rows()))
{
    for (int i = 0; i < 256; ++i)
        levels_[i] = {i, 255.0 * std::pow(i / 255.0, gamma)};
}

void EdgeTracker::forget(bool contrast)
{
    memory_ = EdgeMemory(static_cast<int>(contrast_.size()));
    if (contrast)
        contrast_.setZero();
}

std::optional<EdgeFit> EdgeTracker::fit(const Image& image, double noise, const Transform& start,
                                        const Matrix6& information, const std::vector<int>& ranges,
                                        const Readout* readout)
{
    std::optional<EdgeFit> found;
    Transform pose = start;
    for (int range : ranges) {
        auto visible = visible_edges(pose);
        if (visible.empty() && !found)
            return {};
        if (visible.empty())
            continue;
        search_edges(visible, image, camera_, range, noise, levels_, contrast_, memory_);
        if (readout) {
            const auto [motion, row] = readout->of(pose);
            model_.correct_rows(visible, pose, motion, row, camera_.focal);
        }
        auto lines = fit_lines(visible, camera_.focal, range);
        PoseFit fitted = fit_pose(model_, lines, pose, start, information);
        pose = fitted.pose;
        Rows4 counts = edge_support(model_, visible, pose, camera_.focal, range, TOLERANCE);
        found = EdgeFit{std::move(fitted), std::move(visible), std::move(lines), std::move(counts)};
    }
    return found;
}

std::pair<Transform, double> EdgeTracker::other(const EdgeFit& fit, const Transform& start) const
{
    const Transform pose = fit_pose(model_, fit.lines, start, start, Matrix6::Zero()).pose;
    const Rows4 counts = edge_support(model_, fit.visible, pose, camera_.focal, 1, TOLERANCE);
    return {pose, counts.col(1).sum()};
}

void EdgeTracker::learn(const EdgeFit& fit, const Transform& pose, bool contrast)
{
    std::vector<bool> agree(contrast_.size(), false);
    for (std::size_t i = 0; i < fit.lines.size(); ++i) {
        if (!fit.agrees(i))
            continue;
        const int edge = fit.lines[i].edge;
        const double now = fit.line(i).contrast;
        double& known = contrast_[edge];
        agree[edge] = true;
        if (contrast)
            known = known == 0.0 ? now : known + RATE * (now - known);
    }
    memory_.learn(model_, fit.visible, pose, camera_.focal, agree);
}

std::tuple<Rows3, Eigen::Array<bool, Eigen::Dynamic, 1>, Rows3, Rows4> EdgeTracker::seen_lines(
    const EdgeFit& fit, const Transform& pose, double share) const
{
    const Eigen::Index n = model_.edges().rows();
    Rows3 lines = Rows3::Zero(n, 3), covariances = Rows3::Zero(n, 3);
    Rows4 ends = Rows4::Zero(n, 4);
    Eigen::Array<bool, Eigen::Dynamic, 1> usable = decltype(usable)::Zero(n);
    for (std::size_t i = 0; i < fit.lines.size(); ++i) {
        if (!fit.agrees(i))
            continue;
        const int e = fit.lines[i].edge;
        const FittedLine& line = fit.line(i);
        usable[e] = true;
        lines.row(e) << std::cos(line.phi), std::sin(line.phi), line.rho;
        covariances.row(e) << line.covariance(0, 0), line.covariance(0, 1), line.covariance(1, 1);
        const Vector3d a = pose * Vector3d(model_.vertices().row(model_.edges()(e, 0)));
        const Vector3d b = pose * Vector3d(model_.vertices().row(model_.edges()(e, 1)));
        if (a.z() > 0.0 && b.z() > 0.0)
            ends.row(e) << a.x() / a.z(), a.y() / a.z(), b.x() / b.z(), b.y() / b.z();
    }
    return {lines, usable, share * covariances, ends};
}

double EdgeFit::freedom(const Matrix6& prior) const
{
    const double from_prior = prior.isZero(0.0) ? 0.0 : Matrix6(fit.information.partialPivLu().solve(prior)).trace();
    return std::max(2.0 * fit.weights.sum() - (6.0 - from_prior), 0.0);
}

std::pair<Vector6, double> Readout::of(const Transform& pose) const
{
    const Vector3d middle = pose * center;
    return {share * motion(before, pose), middle.y() / middle.z()};
}

std::tuple<Matrix6, double, double> uncertainty(const Matrix6& information, const Transform& pose,
                                                const Vector3d& center, double share)
{
    // What nothing is known about is very uncertain, and not infinitely.
    const double little = 1e-12 * information.trace() + 1e-9;
    const Matrix6 covariance = share * (information + little * Matrix6::Identity()).inverse();
    Eigen::Matrix<double, 3, 6> lever;
    lever << Matrix3d::Identity(), -skew(pose * center);
    const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(lever * covariance * lever.transpose(), Eigen::EigenvaluesOnly);
    return {covariance, std::sqrt(solver.eigenvalues()[2]), std::sqrt(covariance.bottomRightCorner<3, 3>().trace())};
}

}  // namespace plsing::tracking
