// SPDX-License-Identifier: Apache-2.0
// Mixtures of states: of several kinds of robots, and of parts of one state.
#include <algorithm>
#include <cmath>

#include "pose_filter.hpp"

namespace plsing {

// The one state with mean and covariance of a mixture, whose weights sum to 1. The map's errors have mean 0 in each.
FilterState FilterState::mixture(const std::vector<const FilterState *> &states, const std::vector<double> &weights)
{
    const std::size_t heaviest = std::max_element(weights.begin(), weights.end()) - weights.begin();
    FilterState mean = *states[heaviest];
    const std::size_t n = states.size();
    std::vector<Eigen::Matrix<double, 12, 1>> apart(n);
    Eigen::Matrix<double, 12, 1> shift = Eigen::Matrix<double, 12, 1>::Zero();
    for (std::size_t i = 0; i < n; i++) {
        const FilterState &each = *states[i];
        apart[i] << each.position - mean.position, rotation_vector(each.rotation * mean.rotation.transpose()),
            each.drift - mean.drift;
        shift += weights[i] * apart[i];
    }
    mean.covariance.setZero();
    mean.with_map.setZero();
    for (std::size_t i = 0; i < n; i++) {
        const Eigen::Matrix<double, 12, 1> off = apart[i] - shift;
        mean.covariance += weights[i] * (states[i]->covariance + off * off.transpose());
        mean.with_map += weights[i] * states[i]->with_map;
    }
    Matrix3d turn, unused;
    exponential(shift.segment<3>(3), turn, unused);
    mean.position += shift.head<3>();
    mean.rotation = Eigen::Quaterniond(turn * mean.rotation).normalized().toRotationMatrix();
    mean.drift += shift.tail<6>();
    return mean;
}

// The states, one for each kind of robot, and their weights after robots may have become of another kind: of each kind
// with probability arrivals[j] if they are not of that. What was found of the drift holds for its own kind only; what
// comes from a kind with less than a negligible share changes nothing. Source: Blom, Bar-Shalom (1988).
std::pair<std::vector<FilterState>, std::vector<double>> FilterState::interact(
    const std::vector<const FilterState *> &states, const std::vector<double> &weights,
    const std::vector<double> &arrivals, const std::vector<double> &drift_std, double negligible)
{
    const std::size_t n = states.size();
    double leaving = 0.0;
    for (const double each : arrivals)
        leaving += each;
    std::vector<FilterState> mixed;
    std::vector<double> totals(n, 0.0);
    mixed.reserve(n);
    for (std::size_t j = 0; j < n; j++) {
        std::vector<double> shares(n);
        for (std::size_t i = 0; i < n; i++) {
            shares[i] = weights[i] * (i == j ? 1.0 - leaving + arrivals[j] : arrivals[j]);
            totals[j] += shares[i];
        }
        std::vector<FilterState> newcomers;
        newcomers.reserve(n);
        std::vector<const FilterState *> chosen;
        std::vector<double> of_chosen;
        double total = 0.0;
        for (std::size_t i = 0; i < n; i++) {
            if (shares[i] < negligible * totals[j])
                continue;
            if (i != j) {
                newcomers.push_back(*states[i]);
                newcomers.back().forget_drift(drift_std[j]);
            }
            chosen.push_back(i == j ? states[i] : &newcomers.back());
            of_chosen.push_back(shares[i]);
            total += shares[i];
        }
        for (double &each : of_chosen)
            each /= total;
        mixed.push_back(chosen.size() == 1 ? *chosen[0] : mixture(chosen, of_chosen));
    }
    return {std::move(mixed), std::move(totals)};
}

// A part of this state, whose linear function `by_pose` of the pose's error is off from its mean by so many of its
// standard deviations, and is known to `std` of them. A mixture of parts is the whole if that of the function is.
FilterState FilterState::part(const Vector6d &by_pose, double offset, double std) const
{
    Eigen::Matrix<double, 12, 1> gain = covariance.leftCols<6>() * by_pose;
    const double deviation = std::sqrt(by_pose.dot(gain.head<6>()));
    gain /= deviation;
    FilterState own = *this;
    own.covariance -= (1.0 - std * std) * gain * gain.transpose();
    own.with_map -= (1.0 - std * std) / deviation * gain * (by_pose.transpose() * with_map.topRows<6>());
    own.position += offset * gain.head<3>();
    Matrix3d turn, unused;
    exponential(offset * gain.segment<3>(3), turn, unused);
    own.rotation = turn * rotation;
    own.drift += offset * gain.tail<6>();
    return own;
}

// An upper bound of what is lost, as a divergence, when two parts of a mixture become one. Source: Runnalls (2007).
double FilterState::merging_cost(const FilterState &other, double own_weight, double other_weight) const
{
    const double sum = own_weight + other_weight;
    const FilterState both = mixture({this, &other}, {own_weight / sum, other_weight / sum});
    const auto log_determinant = [](const FilterState &state) {
        const Matrix6d factor = Matrix6d(state.covariance.topLeftCorner<6, 6>()).llt().matrixL();
        return 2.0 * factor.diagonal().array().log().sum();
    };
    return 0.5 * (sum * log_determinant(both) - own_weight * log_determinant(*this) - other_weight * log_determinant(other));
}

}  // namespace plsing
