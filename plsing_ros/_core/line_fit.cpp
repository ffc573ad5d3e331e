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
constexpr double SURE = 0.9;        // of the best score that is possible: no better line is looked for
constexpr double MIN_SUPPORT = 5.0; // samples
constexpr double MIN_SHARE = 0.2;   // of an edge's samples
constexpr double SAME = 1.0;        // [px] within which the lines of two edges are the same step of the image
constexpr double MIN_BESIDE = 0.3;  // of the shorter one of two edges that are side by side
constexpr double MAX_SLOPE = 0.3;   // of a line against its prediction
// What neighbours share does not average out: the variance of the mean of samples is larger than of independent ones.
constexpr double CORRELATION = 4.0;
// What a straight edge, a known model and a calibrated camera are off by in the best case [px].
constexpr double MIN_DEVIATION = 0.06;

struct Straight {
    double offset, slope, score;
};

// The samples of an edge that have a candidate, side by side, as all of them are looked at for every line.
struct Filled {
    std::vector<double> along;
    std::array<std::vector<double>, MAX_CANDIDATES> offsets;  // far away where there is no candidate
    std::vector<const Sample*> samples;

    int size() const { return static_cast<int>(along.size()); }

    void fill(const std::vector<Sample>& all)
    {
        along.clear();
        samples.clear();
        for (auto& each : offsets)
            each.clear();
        for (const Sample& sample : all) {
            if (sample.count == 0)
                continue;
            along.push_back(sample.along);
            samples.push_back(&sample);
            for (int j = 0; j < MAX_CANDIDATES; ++j)
                offsets[j].push_back(j < sample.count ? sample.candidates[j].offset : 1e9);
        }
    }

    // How far the candidate nearest to a line is from it, and which one that is.
    double distance(int i, const Straight& line, int& which) const
    {
        const double at = line.offset + line.slope * along[i];
        double least = offsets[0][i] - at;
        which = 0;
        for (int j = 1; j < MAX_CANDIDATES; ++j) {
            const double off = offsets[j][i] - at;
            const bool nearer = std::abs(off) < std::abs(least);
            least = nearer ? off : least;
            which = nearer ? j : which;
        }
        return least;
    }
};

double score(const Filled& filled, const Straight& line)
{
    double sum = 0.0;
    for (int i = 0; i < filled.size(); ++i) {
        int which;
        const double off = filled.distance(i, line, which) * (1.0 / TOLERANCE);
        // The first candidate has the brightness step that the edge had before.
        sum += std::max(1.0 - off * off, 0.0) * (which == 0 ? 1.0 : 0.6);
    }
    return sum;
}

// Refine a line by reweighted least squares; false if too little of the edge agrees.
bool refine(const VisibleEdge& edge, const Filled& filled, double focal, Straight line, FittedLine& fitted)
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
        const double reach = std::min(TOLERANCE, 4.685 * scale);
        for (int i = 0; i < filled.size(); ++i) {
            int which;
            const double residual = filled.distance(i, line, which);
            if (std::abs(residual) >= reach)
                continue;
            const double u = residual / (4.685 * scale);
            const double weight = (1.0 - u * u) * (1.0 - u * u);
            const Vector2d row(1.0, filled.along[i]);
            normal_matrix += weight * row * row.transpose();
            right += weight * row * filled.offsets[which][i];
            residuals.push_back(std::abs(residual));
            contrast += filled.samples[i]->candidates[which].response;
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
    const double length = std::abs(edge.samples.back().along - edge.samples.front().along);
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
    return true;
}

// Of a face that is seen nearly edge-on two edges take the same step of the image, which is of one of them: a pose that
// makes it quite edge-on would explain both, and is wrong. Their lines are as uncertain as steps are merged.
void widen_shared(const std::vector<const VisibleEdge*>& edges, std::vector<EdgeLines>& found, double focal)
{
    for (std::size_t i = 0; i < found.size(); ++i) {
        const VisibleEdge& edge = *edges[i];
        const Vector2d tangent = edge.tangent();
        const double half = std::abs(edge.samples.back().along);
        for (FittedLine& line : found[i].lines) {
            const Vector2d normal(std::cos(line.phi), std::sin(line.phi));
            for (std::size_t j = 0; j < found.size(); ++j) {
                const auto [a, b] = std::minmax({tangent.dot(edges[j]->samples.front().point - edge.middle) * focal,
                                                 tangent.dot(edges[j]->samples.back().point - edge.middle) * focal});
                const double low = std::max(a, -half), high = std::min(b, half);
                if (i == j || high - low < MIN_BESIDE * std::min(2.0 * half, b - a))
                    continue;
                const FittedLine& other = found[j].lines.front();
                const auto apart = [&](double at) {
                    const Vector2d beside = edge.middle + at / focal * tangent;
                    const Vector2d p = beside - (normal.dot(beside) + line.rho) * normal;
                    return std::abs(std::cos(other.phi) * p.x() + std::sin(other.phi) * p.y() + other.rho) * focal;
                };
                if (apart(low) > SAME || apart(high) > SAME)
                    continue;
                const Vector2d turned = TOLERANCE / half * Vector2d(1.0, -tangent.dot(edge.middle));
                line.covariance += turned * turned.transpose();
                line.covariance(1, 1) += TOLERANCE * TOLERANCE / (focal * focal);
                break;
            }
        }
    }
}

}  // namespace

std::vector<EdgeLines> fit_lines(const std::vector<VisibleEdge>& edges, double focal, int range)
{
    std::vector<EdgeLines> result;
    std::vector<const VisibleEdge*> with_lines;
    Filled filled;
    std::vector<Straight> straights;
    for (const VisibleEdge& edge : edges) {
        const auto& samples = edge.samples;
        filled.fill(samples);
        const int n = filled.size();
        const double needed = std::max(MIN_SUPPORT, MIN_SHARE * samples.size());
        // Where hardly a sample has a second candidate, there is no second line.
        const bool alone = std::count_if(filled.samples.begin(), filled.samples.end(),
                                         [](const Sample* each) { return each->count > 1; }) < needed;
        if (n < needed)
            continue;
        straights.clear();
        std::minstd_rand random(1);  // the same lines for the same image
        for (int trial = 0; trial < TRIALS; ++trial) {
            const int i = static_cast<int>(random() % n);
            const int apart = std::max(n / 3, 1);
            const int j = (i + apart + static_cast<int>(random() % std::max(n - 2 * apart, 1))) % n;
            const Sample &first = *filled.samples[i], &second = *filled.samples[j];
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
            line.score = score(filled, line);
            straights.push_back(line);
            if (alone && line.score > SURE * n)
                break;
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
            if (refine(edge, filled, focal, line, fitted))
                found.lines.push_back(fitted);
        }
        if (!found.lines.empty()) {
            result.push_back(std::move(found));
            with_lines.push_back(&edge);
        }
    }
    widen_shared(with_lines, result, focal);
    return result;
}

}  // namespace plsing::tracking
