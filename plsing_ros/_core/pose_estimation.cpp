// SPDX-License-Identifier: Apache-2.0
// From first estimates of a camera pose to the few refined ones that explain an image, and how uncertain those are.
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "image_residuals.hpp"

namespace plsing {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
// Refined first estimates, and how many of the best are looked at to find ones that differ.
constexpr Index max_poses = 6, max_compared = 24;
// First estimates that differ by a rotation of less than 0.03 rad, whose trace this is, are taken for the same one with
// different noise.
constexpr double same_trace = 2.9991000674979751;
// Refined poses that differ by less are the same.
constexpr double same = 1e-3;
// Costs are in squared standard deviations. Refined are first estimates whose cost exceeds the best one's by less than
// `far`; a pose is given up that would be less likely than the best one by exp(-30 / 2) even if its cost fell by three
// times what its last step promised.
constexpr double far = 1e4, optimism = 3.0, implausible = 30.0;
// Iterations, and by how much the cost may then still exceed the best one's.
constexpr struct {
    long iterations;
    double far;
} stages[] = {{3, far}, {8, 1e3}, {40, 1e3}};
// Of a weak motion: below this share of the largest singular value it is not determined at all; where the misfit is
// compared with what the covariance says, in standard deviations; and the largest difference that is told.
constexpr double undetermined = 1e-13, probe = 2.0, max_nonlinearity = 1e6;

using Rotations = Stack<3, 3>;

void require_poses(const Rotations &rotation, const Vectors &translation)
{
    require(rotation.size() == translation.rows(), "there must be a translation for each rotation");
}

struct Candidate {
    Pose T_camera_world;
    Index start;
    double cost = infinity, gain = infinity;
    bool final = false;
};

// -2 log of the likelihood of the image at a pose, up to a constant.
double cost_at(const Image &image, const View<2> &costs, const Pose &pose, Residuals &residuals)
{
    image.fill(pose, residuals);
    double sum = 0.0;
    for (const Residual &line : residuals)
        sum += line.value().squaredNorm() + std::log(line.determinant) + costs(0) * line.hidden +
               costs(1) * line.reversed;
    return std::isfinite(sum) ? sum : infinity;
}

// The rows of up to `most` of the cheapest poses whose rotations differ, cheapest first.
std::vector<Index> cheapest(const Rotations &rotation, const std::vector<double> &cost, Index most)
{
    std::vector<Index> order(cost.size()), chosen;
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(), [&](Index i, Index j) { return cost[i] < cost[j]; });
    order.resize(std::min<std::size_t>(order.size(), max_compared));
    for (Index i : order) {
        const bool differs = std::none_of(chosen.begin(), chosen.end(), [&](Index j) {
            return rotation[i].cwiseProduct(rotation[j]).sum() > same_trace;
        });
        if (differs && static_cast<Index>(chosen.size()) < most)
            chosen.push_back(i);
    }
    return chosen;
}

bool are_same(const Matrix3d &rotation, const Vector3d &center, const Matrix3d &other_rotation,
              const Vector3d &other_center, double tolerance)
{
    return (rotation - other_rotation).cwiseAbs().maxCoeff() < tolerance &&
           (center - other_center).cwiseAbs().maxCoeff() < tolerance * (1.0 + center.cwiseAbs().maxCoeff());
}

bool are_same(const Candidate &one, const Candidate &other)
{
    const Pose &a = one.T_camera_world, &b = other.T_camera_world;
    return are_same(a.rotation, -a.rotation.transpose() * a.translation, b.rotation,
                    -b.rotation.transpose() * b.translation, same);
}

// Refine all candidates in stages, dropping those that cannot catch up any more.
void refine_all(const Image &image, const View<2> &costs, std::vector<Candidate> &all)
{
    const Eigen::VectorXd weight = Eigen::VectorXd::Ones(image.size());
    Residuals residuals;
    for (const auto &stage : stages) {
        double least = infinity;
        for (Candidate &each : all) {
            if (!each.final)
                each.final = refine(image, weight, stage.iterations, each.T_camera_world, each.gain);
            each.cost = cost_at(image, costs, each.T_camera_world, residuals);
            least = std::min(least, each.cost);
        }
        const auto hopeless = [&](const Candidate &each) {
            // What is still to be gained is less certain the more it is.
            const double promised = each.cost - (each.final ? 0.0 : optimism * each.gain);
            return !(promised <= least + implausible && each.cost <= least + stage.far && std::isfinite(each.cost));
        };
        all.erase(std::remove_if(all.begin(), all.end(), hopeless), all.end());
        if (std::all_of(all.begin(), all.end(), [](const Candidate &each) { return each.final; }))
            return;
    }
}

py::list search_poses(const KnownLines &lines, const SeenLines &image_lines, const View<3> &settings,
                      const Rotations &rotation, const Vectors &translation, const View<2> &costs)
{
    require_poses(rotation, translation);
    const Image image(lines, image_lines, settings);
    Residuals residuals;
    std::vector<double> cost(rotation.size());
    for (Index i = 0; i < rotation.size(); i++)
        cost[i] = cost_at(image, costs, {rotation[i], translation.row(i)}, residuals);
    std::vector<Candidate> all;
    for (Index i : cheapest(rotation, cost, max_poses))
        if (all.empty() || cost[i] <= cost[all.front().start] + far)
            all.push_back({{rotation[i], translation.row(i)}, i});
    refine_all(image, costs, all);
    // Costs that are the same but for rounding leave candidates in the order of their first estimates.
    std::stable_sort(all.begin(), all.end(), [](const Candidate &a, const Candidate &b) {
        return std::nearbyint(1e3 * a.cost) < std::nearbyint(1e3 * b.cost);
    });
    py::list found;
    for (auto each = all.begin(); each != all.end(); ++each)
        if (std::none_of(all.begin(), each, [&](const Candidate &other) { return are_same(other, *each); }))
            found.append(py::make_tuple(array_of(each->T_camera_world.rotation),
                                        array_of(each->T_camera_world.translation), each->cost, each->start));
    return found;
}

py::array_t<Index> cheapest_different(const Rotations &rotation, const Values &cost, Index most)
{
    require(rotation.size() == cost.size(), "there must be a cost for each rotation");
    const std::vector<Index> chosen = cheapest(rotation, {cost.data(), cost.data() + cost.size()}, most);
    return py::array_t<Index>(static_cast<Index>(chosen.size()), chosen.data());
}

py::tuple refine_poses(const KnownLines &lines, const SeenLines &image_lines, const View<3> &settings,
                       const View<Dynamic, Dynamic> &weight, const Rotations &rotation, const Vectors &translation,
                       long iterations)
{
    require_poses(rotation, translation);
    const Image image(lines, image_lines, settings);
    const Index k = rotation.size();
    require(weight.rows() == k && weight.cols() == image.size(), "there must be a weight for each line of each pose");
    py::array_t<double> refined({k, Index(3), Index(3)});
    Rows3 moved_to(k, 3);
    double gain;
    for (Index i = 0; i < k; i++) {
        Pose pose{rotation[i], translation.row(i)};
        refine(image, weight.row(i).transpose(), iterations, pose, gain);
        Eigen::Map<RowMajor<double, 3, 3>>(refined.mutable_data() + 9 * i) = pose.rotation;
        moved_to.row(i) = pose.translation;
    }
    return py::make_tuple(refined, array_of(moved_to));
}

// Numbers that image_residuals says of a line.
constexpr Index columns = 7;

py::array_t<double> image_residuals(const KnownLines &lines, const SeenLines &image_lines,
                                    const View<3> &settings, const Rotations &rotation, const Vectors &translation)
{
    require_poses(rotation, translation);
    const Image image(lines, image_lines, settings);
    Residuals residuals;
    py::array_t<double> table({rotation.size(), columns, image.size()});
    for (Index k = 0; k < rotation.size(); k++) {
        image.fill({rotation[k], translation.row(k)}, residuals);
        Eigen::Map<RowMajor<double, columns, Dynamic>> of_pose(table.mutable_data(k), columns, image.size());
        for (Index i = 0; i < image.size(); i++) {
            const Residual &line = residuals[i];
            of_pose.col(i) << line.raw, line.value(), line.reversed, line.hidden, std::log(line.determinant);
        }
    }
    return table;
}

py::array_t<double> image_jacobians(const KnownLines &lines, const SeenLines &image_lines, const View<3> &settings,
                                    const Rotations &rotation, const Vectors &translation)
{
    require_poses(rotation, translation);
    const Image image(lines, image_lines, settings);
    Residuals residuals;
    py::array_t<double> whitened({rotation.size(), Index(2), image.size(), Index(6)});
    for (Index k = 0; k < rotation.size(); k++) {
        image.fill({rotation[k], translation.row(k)}, residuals);
        for (Index i = 0; i < image.size(); i++) {
            const RowMajor<double, 2, 6> rows = residuals[i].whitening * residuals[i].jacobian();
            for (Index r = 0; r < 2; r++)
                std::copy_n(rows.row(r).data(), 6, whitened.mutable_data(k, r, i));
        }
    }
    return whitened;
}

double max_deviation(const Matrix3d &covariance)
{
    return std::sqrt(Eigen::SelfAdjointEigenSolver<Matrix3d>(covariance, Eigen::EigenvaluesOnly).eigenvalues()(2));
}

// The largest relative difference of the misfit from a quadratic at poses along the two least observable motions, both ways.
double nonlinearity(const Image &image, const Pose &pose, const Residuals &here, const Weights &weight,
                    const Vector6d &deviation, const Matrix6d &axes)
{
    Residuals there;
    const double squared = misfit(here, here, weight);
    double worst = 0.0;
    for (Index i = 0; i < 2; i++)
        for (double size : {probe, -probe}) {
            const Vector6d motion = size * deviation(i) * axes.row(i).transpose();
            if (!(motion.tail<3>().cwiseAbs().maxCoeff() <= 1.0))
                return max_nonlinearity;
            image.fill(move(pose, motion), there);
            const double off = std::abs((misfit(there, here, weight) - squared) / (probe * probe) - 1.0);
            // Written so that it holds for NaN.
            if (!(off < max_nonlinearity))
                return max_nonlinearity;
            worst = std::max(worst, off);
        }
    return worst;
}

py::object pose_uncertainty(const KnownLines &lines, const SeenLines &image_lines, const View<3> &settings,
                            const View<3, 3> &rotation, const View<3> &translation, const Values &weight)
{
    const Image image(lines, image_lines, settings);
    const Index n = image.size();
    require(weight.size() == n, "there must be a weight for each line");
    const Pose pose{rotation, translation};
    Residuals here;
    image.fill(pose, here);
    Tall raw(2 * n, 6), whitened(2 * n, 6);
    for (Index i = 0; i < n; i++) {
        raw.middleRows<2>(2 * i) = weight(i) * here[i].jacobian();
        whitened.middleRows<2>(2 * i) = here[i].whitening * raw.middleRows<2>(2 * i);
    }
    // Angle and offset are orthonormal coordinates of the image line, so `raw` has the singular values of L.
    const Svd of_raw(raw, false), decomposed(whitened, false);
    if (!of_raw.is_finite() || !decomposed.is_finite() ||
        !(decomposed.values()(5) > undetermined * decomposed.values()(0)))
        return py::none();
    const Vector6d deviation = decomposed.values().reverse().cwiseInverse();
    const Matrix6d axes = decomposed.right().rowwise().reverse().transpose();
    // The axes in the world frame: position and rotation vector turn alike.
    Matrix6d in_world;
    in_world << axes.leftCols<3>() * rotation, axes.rightCols<3>() * rotation;
    const Matrix6d covariance = in_world.transpose() * deviation.cwiseAbs2().asDiagonal() * in_world;
    return py::make_tuple(array_of(deviation), array_of(axes), array_of(covariance),
                          max_deviation(covariance.topLeftCorner<3, 3>()),
                          max_deviation(covariance.bottomRightCorner<3, 3>()),
                          nonlinearity(image, pose, here, weight, deviation, axes),
                          of_raw.values()(5) / of_raw.values()(0), misfit(here, here, weight));
}

bool same_pose(const View<3, 3> &rotation, const View<3> &center, const View<3, 3> &other_rotation,
               const View<3> &other_center, double tolerance)
{
    return are_same(rotation, center, other_rotation, other_center, tolerance);
}

}  // namespace

void bind_pose_estimation(py::module_ &module)
{
    module.def("search_poses", &search_poses);
    module.def("cheapest_different", &cheapest_different);
    module.def("refine_poses", &refine_poses);
    module.def("image_residuals", &image_residuals);
    module.def("image_jacobians", &image_jacobians);
    module.def("pose_uncertainty", &pose_uncertainty);
    module.def("same_pose", &same_pose);
}

}  // namespace plsing
