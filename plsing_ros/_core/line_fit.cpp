// SPDX-License-Identifier: Apache-2.0
// Straight lines through the candidates of a visible edge: RANSAC over pairs, then Tukey's M-estimator.
#include <algorithm>
#include <random>

#include "tracking.hpp"

namespace plsing::tracking {
namespace {

constexpr int MAX_LINES = 3;        // of an edge
constexpr int TRIALS = 40;          // pairs of samples
constexpr double TOLERANCE = 1.5;   // [px] of a candidate from its line
constexpr double MIN_SUPPORT = 5.0; // samples
constexpr double MIN_SHARE = 0.2;   // of an edge's samples
constexpr double MAX_SLOPE = 0.3;   // of a line against its prediction
// What neighbours share does not average out: the variance of the mean of samples is larger than of independent ones.
constexpr double CORRELATION = 4.0;
// What a straight edge, a known model and a calibrated camera are off by in the best case [px].
constexpr double MIN_DEVIATION = 0.06;

struct Straight {
    double offset, slope, score;
};

// The candidate of a sample nearest to a line, or null.
const Candidate* nearest(const Sample& sample, const Straight& line)
{
    const Candidate* best = nullptr;
    double least = TOLERANCE;
    for (int j = 0; j < sample.count; ++j) {
        const double off = std::abs(sample.candidates[j].offset - line.offset - line.slope * sample.along);
        if (off < least) {
            least = off;
            best = &sample.candidates[j];
        }
    }
    return best;
}

double score(const std::vector<Sample>& samples, const Straight& line)
{
    double sum = 0.0;
    for (const Sample& sample : samples) {
        if (const Candidate* candidate = nearest(sample, line)) {
            const double off = (candidate->offset - line.offset - line.slope * sample.along) / TOLERANCE;
            // The first candidate has the brightness step that the edge had before.
            sum += (1.0 - off * off) * (candidate == &sample.candidates[0] ? 1.0 : 0.6);
        }
    }
    return sum;
}

// Refine a line by reweighted least squares; false if too little of the edge agrees.
bool refine(const VisibleEdge& edge, double focal, Straight line, FittedLine& fitted)
{
    double scale = 0.5 * TOLERANCE;
    Matrix2d normal_matrix;
    std::vector<double> residuals;
    double contrast = 0.0;
    for (int iteration = 0; iteration < 5; ++iteration) {
        normal_matrix.setZero();
        Vector2d right = Vector2d::Zero();
        residuals.clear();
        contrast = 0.0;
        for (const Sample& sample : edge.samples) {
            const Candidate* candidate = nearest(sample, line);
            if (!candidate)
                continue;
            const double residual = candidate->offset - line.offset - line.slope * sample.along;
            const double u = residual / (4.685 * scale);
            if (std::abs(u) >= 1.0)
                continue;
            const double weight = (1.0 - u * u) * (1.0 - u * u);
            const Vector2d row(1.0, sample.along);
            normal_matrix += weight * row * row.transpose();
            right += weight * row * candidate->offset;
            residuals.push_back(std::abs(residual));
            contrast += candidate->response;
        }
        if (static_cast<double>(residuals.size()) < std::max(MIN_SUPPORT, MIN_SHARE * edge.samples.size()))
            return false;
        const double determinant = normal_matrix.determinant();
        if (!(determinant > 1e-9 * normal_matrix(0, 0) * normal_matrix(1, 1)))
            return false;
        const Vector2d solution = normal_matrix.inverse() * right;
        line = {solution[0], solution[1], 0.0};
        std::nth_element(residuals.begin(), residuals.begin() + residuals.size() / 2, residuals.end());
        scale = std::max(1.4826 * residuals[residuals.size() / 2], 0.1);
    }
    if (std::abs(line.slope) > MAX_SLOPE)
        return false;
    const double length = std::max(edge.samples.back().along - edge.samples.front().along,
                                   edge.samples.front().along - edge.samples.back().along);
    Matrix2d covariance = CORRELATION * scale * scale * normal_matrix.inverse();
    covariance(0, 0) += MIN_DEVIATION * MIN_DEVIATION;
    covariance(1, 1) += 12.0 * MIN_DEVIATION * MIN_DEVIATION / (length * length);

    // From offset [px] and slope along the projected edge to the line's own angle and offset.
    const double turn = -std::atan(line.slope);
    const Eigen::Rotation2Dd rotation(turn);
    const Vector2d normal = rotation * edge.normal, tangent(-normal.y(), normal.x());
    const Vector2d point = edge.middle + line.offset / focal * edge.normal;
    const double by_slope = -1.0 / (1.0 + line.slope * line.slope);
    Matrix2d jacobian;
    jacobian << 0.0, by_slope, -normal.dot(edge.normal) / focal, -tangent.dot(point) * by_slope;
    fitted.phi = edge.phi() + turn;
    fitted.rho = -normal.dot(point);
    fitted.covariance = jacobian * covariance * jacobian.transpose();
    fitted.support = static_cast<double>(residuals.size());
    fitted.contrast = contrast / fitted.support;
    fitted.offset = line.offset;
    return true;
}

}  // namespace

std::vector<EdgeLines> fit_lines(const std::vector<VisibleEdge>& edges, double focal, int range)
{
    std::vector<EdgeLines> result;
    std::vector<int> filled;
    std::vector<Straight> straights;
    for (const VisibleEdge& edge : edges) {
        const auto& samples = edge.samples;
        filled.clear();
        for (std::size_t i = 0; i < samples.size(); ++i)
            if (samples[i].count > 0)
                filled.push_back(static_cast<int>(i));
        const int n = static_cast<int>(filled.size());
        if (n < std::max(MIN_SUPPORT, MIN_SHARE * samples.size()))
            continue;
        straights.clear();
        std::minstd_rand random(1);  // the same lines for the same image
        for (int trial = 0; trial < TRIALS; ++trial) {
            const int i = static_cast<int>(random() % n);
            const int apart = std::max(n / 3, 1);
            const int j = (i + apart + static_cast<int>(random() % std::max(n - 2 * apart, 1))) % n;
            const Sample &first = samples[filled[i]], &second = samples[filled[j]];
            const double along = second.along - first.along;
            if (std::abs(along) < 1e-9)
                continue;
            const auto pick = [&random](const Sample& sample) {
                return sample.candidates[random() % 2 ? 0 : random() % sample.count].offset;
            };
            const double a = pick(first), b = pick(second);
            Straight line;
            line.slope = (b - a) / along;
            line.offset = a - line.slope * first.along;
            if (std::abs(line.slope) > MAX_SLOPE || std::abs(line.offset) > range + 1.0)
                continue;
            line.score = score(samples, line);
            straights.push_back(line);
        }
        std::sort(straights.begin(), straights.end(), [](const auto& a, const auto& b) { return a.score > b.score; });
        EdgeLines found;
        found.edge = edge.edge;
        std::vector<Straight> taken;
        const double half = 0.5 * std::abs(samples.back().along - samples.front().along);
        for (const Straight& line : straights) {
            if (static_cast<int>(found.lines.size()) == MAX_LINES || line.score < 0.3 * straights.front().score)
                break;
            const bool known = std::any_of(taken.begin(), taken.end(), [&](const Straight& other) {
                const double middle = std::abs(line.offset - other.offset);
                return middle + half * std::abs(line.slope - other.slope) < 2.0 * TOLERANCE;
            });
            if (known)
                continue;
            taken.push_back(line);
            FittedLine fitted;
            if (refine(edge, focal, line, fitted))
                found.lines.push_back(fitted);
        }
        if (!found.lines.empty())
            result.push_back(std::move(found));
    }
    return result;
}

}  // namespace plsing::tracking
