// SPDX-License-Identifier: Apache-2.0
// Steps of brightness across projected edges: the moving-edge search of Bouthemy (1989), with several candidates.
#include <algorithm>

#include "tracking.hpp"

namespace plsing::tracking {
namespace {

// Derivative of a Gaussian of 1 px, scaled so that a step of height 1 answers 1.
constexpr int HALF = 3;
const std::array<double, 2 * HALF + 1> TAPS = [] {
    std::array<double, 2 * HALF + 1> taps{};
    double sum = 0.0;
    for (int i = -HALF; i <= HALF; ++i)
        taps[i + HALF] = i * std::exp(-0.5 * i * i);
    for (int i = 1; i <= HALF; ++i)
        sum += taps[i + HALF];
    for (double& tap : taps)
        tap /= sum;
    return taps;
}();
constexpr double NOISE_GAIN = 0.69;     // of the filter, after the mean of three neighbours
constexpr double THRESHOLD = 3.5;       // standard deviations of the answer to noise
constexpr double MIN_RESPONSE = 0.7;    // [grey levels], above the rounding to whole ones
constexpr double MIN_SEEN = 0.4;        // of the samples

using Level = Eigen::Array2d;

struct Pixels {
    const std::uint8_t* data;
    int width, height;
    const GreyLevels& levels;

    // Zero outside, which only strongly distorted images reach.
    Level at(const Vector2d& p) const
    {
        const int x = static_cast<int>(p.x()), y = static_cast<int>(p.y());
        if (!(p.x() >= 0.0 && p.y() >= 0.0 && x + 1 < width && y + 1 < height))
            return Level::Zero();
        const double fx = p.x() - x, fy = p.y() - y;
        const std::uint8_t* top = data + static_cast<std::ptrdiff_t>(y) * width + x;
        const std::uint8_t* low = top + width;
        return (1.0 - fy) * ((1.0 - fx) * levels[top[0]] + fx * levels[top[1]]) +
               fy * ((1.0 - fx) * levels[low[0]] + fx * levels[low[1]]);
    }
};

// The place of the extremum of a parabola through three values, from the middle one.
double vertex(double left, double here, double right)
{
    const double curvature = left - 2.0 * here + right;
    return curvature < 0.0 ? std::clamp(0.5 * (left - right) / curvature, -0.5, 0.5) : 0.0;
}

}  // namespace

double image_noise(const Image& image)
{
    // Median of |I * N| for the operator N of Immerkaer (1996), whose answer to noise of unit deviation is 6.
    const auto pixels = image.unchecked<2>();
    std::array<int, 8 * 255 + 1> counts{};
    int total = 0;
    for (py::ssize_t y = 1; y + 1 < pixels.shape(0); y += 7)
        for (py::ssize_t x = 1 + y % 5; x + 1 < pixels.shape(1); x += 11, ++total)
            ++counts[std::abs(
                pixels(y - 1, x - 1) + pixels(y - 1, x + 1) + pixels(y + 1, x - 1) + pixels(y + 1, x + 1) -
                2 * (pixels(y - 1, x) + pixels(y + 1, x) + pixels(y, x - 1) + pixels(y, x + 1)) + 4 * pixels(y, x))];
    int median = 0;
    for (int below = counts[0]; below <= total / 2 && total > 0; below += counts[median])
        ++median;
    return 1.4826 * median / 6.0;
}

void search_edges(std::vector<VisibleEdge>& edges, const Image& image, const Camera& camera, int range, double noise,
                  const GreyLevels& levels, const Eigen::VectorXd& contrast, EdgeMemory& memory)
{
    const Pixels pixels{image.data(), static_cast<int>(image.shape(1)), static_cast<int>(image.shape(0)), levels};
    const double threshold = std::max(THRESHOLD * NOISE_GAIN * noise / std::sqrt(3.0), MIN_RESPONSE);
    const int reach = range + HALF + 1;
    std::vector<Level> profile(2 * reach + 1), response(2 * range + 3);
    std::vector<float> ratios;
    std::size_t samples = 0;
    for (VisibleEdge& edge : edges) {
        const Vector2d normal = edge.normal / camera.focal, tangent = edge.tangent() / camera.focal;
        const double remembered = contrast[edge.edge];
        for (Sample& sample : edge.samples) {
            for (int i = -reach; i <= reach; ++i) {
                const Vector2d p = sample.point + i * normal;
                profile[i + reach] = (pixels.at(camera.pixel(p - tangent)) + pixels.at(camera.pixel(p)) +
                                      pixels.at(camera.pixel(p + tangent))) / 3.0;
            }
            for (int i = -range - 1; i <= range + 1; ++i) {
                Level sum = Level::Zero();
                for (int j = -HALF; j <= HALF; ++j)
                    sum += TAPS[j + HALF] * profile[i + j + reach];
                response[i + range + 1] = sum;
            }
            const auto level = [&](int at) { return static_cast<float>(profile[at + HALF][0]); };
            const auto beside = [&](int at) {
                return std::array<float, 4>{level(at - 2), level(at - 4), level(at + 2), level(at + 4)};
            };
            sample.covered = !memory.allows(edge, sample, {0.0F, 0.0F, beside(range + 1)});
            sample.count = 0;
            std::array<double, MAX_CANDIDATES> scores{};
            double best = 0.0;
            float ratio = 0.0F;
            for (int i = 1; i <= 2 * range + 1; ++i) {
                const double left = std::abs(response[i - 1][0]), here = std::abs(response[i][0]),
                             right = std::abs(response[i + 1][0]);
                if (here < threshold || here < left || here <= right)
                    continue;
                // Lenses blur light, not grey levels: where the light has its step, the edge is.
                int light = i;
                for (int j : {i - 1, i + 1})
                    if (j > 0 && j < 2 * range + 2 && std::abs(response[j][1]) > std::abs(response[light][1]))
                        light = j;
                const double shift = vertex(std::abs(response[light - 1][1]), std::abs(response[light][1]),
                                            std::abs(response[light + 1][1]));
                const double step = response[i][0];
                const Candidate candidate{static_cast<float>(light - range - 1 + shift), static_cast<float>(step),
                                          beside(i)};
                double score = here;
                if (remembered != 0.0) {
                    const double off = (step - remembered) / (std::abs(remembered) + threshold);
                    score = 0.2 * std::min(here / std::abs(remembered), 1.0) + std::exp(-2.0 * off * off);
                }
                if (score > best) {
                    best = score;
                    ratio = memory.ratio(edge, sample, candidate);
                }
                if (!memory.allows(edge, sample, candidate))
                    continue;
                // Insert in order of the score; the weakest falls out.
                int place = std::min(sample.count, MAX_CANDIDATES);
                while (place > 0 && scores[place - 1] < score)
                    --place;
                if (place >= MAX_CANDIDATES)
                    continue;
                sample.count = std::min(sample.count + 1, MAX_CANDIDATES);
                for (int j = sample.count - 1; j > place; --j) {
                    scores[j] = scores[j - 1];
                    sample.candidates[j] = sample.candidates[j - 1];
                }
                scores[place] = score;
                sample.candidates[place] = candidate;
            }
            if (ratio > 0.0F)
                ratios.push_back(ratio);
        }
        samples += edge.samples.size();
    }
    // Elsewhere than at the object's edges steps are few, and tell nothing about its light.
    if (ratios.size() > MIN_SEEN * samples)
        memory.set_gain(ratios);
}

}  // namespace plsing::tracking
