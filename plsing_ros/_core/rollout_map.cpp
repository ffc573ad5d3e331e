// SPDX-License-Identifier: Apache-2.0
// The true lines and focal length of a roll-out: drawn about the map, and drawn to where the lines were seen.
#include "rollout.hpp"

namespace plsing {

namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;

// Draws from which the spread of a line's image is taken.
constexpr int kDraws = 64;

// Angle and offset of a line's image; false without one.
bool image_of(const SceneLine &line, const Pose &camera, Vector2d &image)
{
    const Vector3d l =
        camera.rotation.transpose() * (line.moment - camera.translation.cross(line.direction));
    const double depth = image_depth(l);
    if (!has_image(l, depth, min_depth)) return false;
    image = {std::atan2(l[1], l[0]), l[2] / depth};
    return true;
}

// What is seen of a line through a lens whose focal length is off, minus what is expected of the map's line.
bool residual_of(const SceneLine &map, const Pose &believed, const SceneLine &line, const Pose &camera, double focal,
                 Vector2d &residual, Vector2d &image)
{
    Vector2d expected;
    if (!image_of(map, believed, expected) || !image_of(line, camera, image)) return false;
    residual[0] = std::remainder(image[0] - expected[0], 2.0 * M_PI);
    residual[1] = image[1] * focal - expected[1];
    return true;
}

void set_ends(SceneLine &line, const Vector3d &first, const Vector3d &second)
{
    const Vector3d along = (second - first).normalized();
    const double sign = line.direction.dot(line.ends[1] - line.ends[0]) < 0.0 ? -1.0 : 1.0;
    line.ends[0] = first;
    line.ends[1] = second;
    line.direction = sign * along;
    line.moment = first.cross(line.direction);
}

void disturb(SceneLine &line, double deviation, Random &random)
{
    if (deviation == 0.0) return;
    const Vector3d first = random.normal_vector(), second = random.normal_vector();
    set_ends(line, line.ends[0] + deviation * first, line.ends[1] + deviation * second);
}

}  // namespace

double draw_focal_length(const Loop &loop, Random &random)
{
    return loop.focal_error > 0.0 ? 1.0 + loop.focal_error * random.normal() : 1.0;
}

void weigh_residuals(Scene &scene, const Loop &loop, const Pose &believed)
{
    Random random(1);
    for (SceneLine &line : scene.lines) {
        if (!line.has_residual) continue;
        Matrix2d spread = Matrix2d::Zero();
        for (int draw = 0; draw < kDraws; draw++) {
            SceneLine other = line;
            disturb(other, loop.map_noise, random);
            Vector2d residual, image;
            if (residual_of(line, believed, other, believed, draw_focal_length(loop, random), residual, image))
                spread += residual * residual.transpose() / kDraws;
        }
        line.residual_gain = spread * (spread + line.residual_noise).inverse();
        if (!line.residual_gain.allFinite()) line.has_residual = false;
    }
}

std::vector<SceneLine> draw_map(const Scene &scene, const Loop &loop, const Pose &believed, const Pose &camera,
                                double focal, Random &random)
{
    std::vector<SceneLine> lines = scene.lines;
    for (SceneLine &line : lines) {
        const SceneLine map = line;
        disturb(line, loop.map_noise, random);
        Vector2d residual, image;
        if (!line.has_residual || !residual_of(map, believed, line, camera, focal, residual, image)) continue;
        // A draw of what comes before the images, corrected by what they say about it: a draw of what comes after.
        const Matrix2d factor = line.residual_noise.llt().matrixL();
        const double first = random.normal(), second = random.normal();
        const Vector2d off = line.residual_gain * (line.residual - residual - factor * Vector2d(first, second));
        const double angle = image[0] + off[0], offset = image[1] + off[1] / focal;
        const Vector3d normal =
            camera.rotation * Vector3d(std::cos(angle), std::sin(angle), offset).normalized();
        Vector3d ends[2];
        for (int k = 0; k < 2; k++)
            ends[k] = line.ends[k] - normal * normal.dot(line.ends[k] - camera.translation);
        if ((ends[1] - ends[0]).norm() > 0.5 * (line.ends[1] - line.ends[0]).norm()) set_ends(line, ends[0], ends[1]);
    }
    return lines;
}

}  // namespace plsing
