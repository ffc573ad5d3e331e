// SPDX-License-Identifier: Apache-2.0
// How bright an object was, beside its edges and on its faces: what is in the way looks otherwise.
#include "tracking.hpp"

namespace plsing::tracking {
namespace {

// Of a brightness from the one that is remembered: in deviations, and as a share.
constexpr float MAX_OFF = 4.0F, MAX_SHARE_OFF = 0.1F;
constexpr float FIRST = 8.0F;  // deviation [grey levels]

// Beside edges: how far off a brightness may be [grey levels], rates of learning, and of a deviation where it is not
// the edge that is seen; and how far a step may be from the edge to be this one [px].
constexpr float EDGE_OFF = 6.0F, EDGE_RATE = 0.2F, EDGE_FADING = 1.01F;
constexpr double SAME = 1.0;

// On faces, the same.
constexpr float FACE_OFF = 8.0F, FACE_RATE = 0.3F, FACE_FADING = 1.02F;
constexpr int BLOCK = 2;             // on each side of a place, of what is looked at [px]
constexpr double REACH = 0.7;        // round a place, of the distance between places
constexpr double MAX_COVERED = 0.1;  // of the known places: beyond, new ones may be of what is in the way

// The upper one of the two in the middle.
float median(std::vector<float>& values)
{
    std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
    return values[values.size() / 2];
}

}  // namespace

bool Brightness::differs(float now, float gain, float least) const
{
    return std::abs(now - gain * mean) > gain * (MAX_OFF * deviation + MAX_SHARE_OFF * mean) + least;
}

void Brightness::learn(float now, float gain, float rate)
{
    const float off = now - gain * mean;
    mean += rate * (now - mean);
    deviation += rate * (1.25F * std::abs(off) - deviation);
}

bool EdgeMemory::allows(const VisibleEdge& edge, const Sample& sample, const Candidate& candidate) const
{
    for (int k : {0, 1, 2, 3}) {
        const Brightness& level = levels_[edge.edge][sample.place][k];
        if (edge.on_object[k / 2] && level.is_known() && level.differs(candidate.beside[k], gain_, EDGE_OFF))
            return false;
    }
    return true;
}

float EdgeMemory::ratio(const VisibleEdge& edge, const Sample& sample, const Candidate& candidate) const
{
    for (int k : {0, 1, 2, 3}) {
        const Brightness& level = levels_[edge.edge][sample.place][k];
        if (edge.on_object[k / 2] && level.is_known())
            return candidate.beside[k] / level.mean;
    }
    return 0.0F;
}

void EdgeMemory::set_gain(std::vector<float>& ratios) { gain_ = std::clamp(median(ratios), 0.25F, 4.0F); }

void EdgeMemory::learn(const EdgeModel& model, const std::vector<VisibleEdge>& edges, const Transform& pose,
                       double focal, const std::vector<bool>& agree)
{
    for (const VisibleEdge& edge : edges) {
        const Vector3d line = model.line(edge.edge, pose);
        const double across = line.head<2>().dot(edge.normal);
        for (const Sample& sample : edge.samples) {
            const double at = -(line.head<2>().dot(sample.point) + line.z()) / across * focal;
            const Candidate* nearest = nullptr;
            for (int j = 0; j < sample.count; ++j)
                if (agree[edge.edge] && std::abs(sample.candidates[j].offset - at) < SAME)
                    nearest = &sample.candidates[j];
            for (int k : {0, 1, 2, 3}) {
                Brightness& level = levels_[edge.edge][sample.place][k];
                if (!edge.on_object[k / 2])
                    continue;
                if (nearest == nullptr)
                    level.deviation *= EDGE_FADING;
                else if (!level.is_known())
                    level = {std::max(nearest->beside[k], 1.0F), FIRST};
                else
                    level.learn(nearest->beside[k], gain_, EDGE_RATE);
            }
        }
    }
}

FaceMemory::FaceMemory(const Rows3& places, const std::vector<int>& triangles, double apart) : apart_(apart)
{
    for (Eigen::Index i = 0; i < places.rows(); ++i)
        places_.push_back({places.row(i), triangles.at(i), {{{0.0F, FIRST}, {0.0F, FIRST}}}});
}

IntRows3 FaceMemory::covered(const Image& image, const Image& faces, const std::vector<int>& triangles, int left,
                             int top, const Transform& pose, const Camera& camera)
{
    const auto grey = image.unchecked<2>();
    const auto labels = faces.unchecked<2>();
    const auto last_x = static_cast<int>(grey.shape(1)) - 1, last_y = static_cast<int>(grey.shape(0)) - 1;
    struct Seen {
        Place& place;
        int x, y, radius;
        std::array<float, 2> levels;
        bool known, other;
    };
    std::vector<Seen> seen;
    std::vector<float> ratios;
    for (Place& place : places_) {
        const Vector3d p = pose * place.point;
        const Vector2d pixel = camera.pixel(p.head<2>() / p.z());
        const double x = std::nearbyint(pixel.x() - left), y = std::nearbyint(pixel.y() - top);
        if (!(x >= 0.0 && y >= 0.0 && x < labels.shape(1) && y < labels.shape(0)))
            continue;
        const int label = labels(static_cast<int>(y), static_cast<int>(x));
        if (label == 0 || triangles.at(label - 1) != place.triangle)
            continue;
        float sum = 0.0F, squares = 0.0F;
        for (int i = -BLOCK; i <= BLOCK; ++i) {
            for (int j = -BLOCK; j <= BLOCK; ++j) {
                const float value = grey(std::clamp(static_cast<int>(y) + top + i, 0, last_y),
                                         std::clamp(static_cast<int>(x) + left + j, 0, last_x));
                sum += value;
                squares += value * value;
            }
        }
        constexpr float count = (2 * BLOCK + 1) * (2 * BLOCK + 1);
        const float mean = sum / count, scatter = std::sqrt(std::max(squares / count - mean * mean, 0.0F));
        seen.push_back({place, static_cast<int>(x), static_cast<int>(y),
                        static_cast<int>(std::ceil(REACH * apart_ * camera.focal / p.z())),
                        {std::max(mean, 1.0F), std::max(scatter, 1.0F)}, place.levels[0].is_known(), false});
        if (seen.back().known)
            ratios.push_back(seen.back().levels[0] / place.levels[0].mean);
    }
    const float gain = ratios.empty() ? 1.0F : median(ratios);
    std::size_t others = 0;
    for (Seen& each : seen) {
        for (int k : {0, 1})
            each.other |= each.known && each.place.levels[k].differs(each.levels[k], gain, FACE_OFF);
        others += each.other;
    }
    const bool in_the_way = others > MAX_COVERED * ratios.size();
    std::vector<int> circles;
    for (Seen& each : seen) {
        if (each.other || (in_the_way && !each.known))
            circles.insert(circles.end(), {each.x, each.y, each.other ? each.radius : 2 * BLOCK + 1});
        for (int k : {0, 1}) {
            Brightness& level = each.place.levels[k];
            if (each.other)
                level.deviation *= FACE_FADING;
            else if (each.known)
                level.learn(each.levels[k], 1.0F, FACE_RATE);
            else if (!in_the_way)
                level.mean = each.levels[k];
        }
    }
    return Eigen::Map<const IntRows3>(circles.data(), static_cast<Eigen::Index>(circles.size() / 3), 3);
}

}  // namespace plsing::tracking
