// SPDX-License-Identifier: Apache-2.0
#include "pose_filter.hpp"

#include <algorithm>
#include <cmath>

namespace plsing {
namespace {

constexpr double smallest_depth = 1e-12;  // [m]
constexpr double longest_turn = 0.5;      // of one step of an update [rad]
constexpr double settled = 0.02;          // a step shorter than this, in standard deviations, ends an update

// Of exp: d log(exp(d) exp(v)) / dd at d = 0.
Matrix3d inverse_left_jacobian(const Vector3d &v)
{
    const double square = v.squaredNorm(), angle = std::sqrt(square);
    double factor = 1.0 / 12.0 + square / 720.0;
    if (angle > 1e-3)
        factor = 1.0 / square - (1.0 + std::cos(angle)) / (2.0 * angle * std::sin(angle));
    const Matrix3d s = skew(v);
    return Matrix3d::Identity() - 0.5 * s + factor * s * s;
}

// Residual (angle, offset) of one image line, directed as it is seen, and its derivatives.
struct SeenLine {
    Eigen::Vector2d residual;               // what the pose makes of it minus what was seen
    Eigen::Matrix<double, 2, 6> by_pose;    // by position and rotation, in the world
    Eigen::Matrix<double, 2, 4> by_map;     // by the errors of the map's line, in standard deviations
    bool reversed;
};

SeenLine seen_line(const FilterMap &map, Index row, const Matrix3d &rotation, const Vector3d &position,
                   const Vector3d &seen)
{
    const Vector3d u = map.direction.row(row), arm = Vector3d(map.pivot.row(row)) - position;
    const Vector3d moment = rotation.transpose() * arm.cross(u);
    const double agreement = seen.x() * moment.x() + seen.y() * moment.y();
    const double depth = std::max(std::hypot(moment.x(), moment.y()), smallest_depth);
    const double scale = std::copysign(1.0 / depth, agreement);
    const Vector3d p = scale * moment;
    SeenLine line;
    line.reversed = agreement < 0.0;
    line.residual << std::atan2(seen.x() * p.y() - seen.y() * p.x(), agreement * scale), p.z() - seen.z();
    // By the moment about the camera's centre, in the world's axes.
    Eigen::Matrix<double, 2, 3> slope;
    slope << -p.y(), p.x(), 0.0, -p.z() * p.x(), -p.z() * p.y(), 1.0;
    slope = scale * slope * rotation.transpose();
    // moment = (pivot - position) x u, and exp(error) before rotation turns the camera, the lines the other way.
    line.by_pose.leftCols<3>() = slope * skew(u);
    line.by_pose.rightCols<3>() = slope * skew(arm.cross(u));
    const Vector3d a = map.first.row(row), b = map.second.row(row);
    line.by_map.col(0) = map.position_std[row] * (slope * a.cross(u));
    line.by_map.col(1) = map.position_std[row] * (slope * b.cross(u));
    line.by_map.col(2) = map.direction_std[row] * (slope * arm.cross(a));
    line.by_map.col(3) = map.direction_std[row] * (slope * arm.cross(b));
    return line;
}

}  // namespace

FilterMap::FilterMap(const Rows &direction_, const Rows &pivot_, const Eigen::VectorXd &position_std_,
                     const Eigen::VectorXd &direction_std_)
    : count(direction_.rows()), direction(direction_), pivot(pivot_), first(count, 3), second(count, 3),
      position_std(position_std_), direction_std(direction_std_),
      exact((position_std_.array() == 0.0).all() && (direction_std_.array() == 0.0).all())
{
    for (Index i = 0; i < count; i++) {
        const Vector3d u = direction.row(i);
        first.row(i) = u.unitOrthogonal();
        second.row(i) = u.cross(Vector3d(first.row(i)));
    }
}

// (k) By how much `squared` would fall without each line; 0 if it is not used.
Eigen::VectorXd Innovation::removal() const
{
    Eigen::VectorXd fall = Eigen::VectorXd::Zero(of_line.size());
    const Index m = static_cast<Index>(used.size());
    if (weighted.size() != 2 * m)
        return fall;
    const Eigen::MatrixXd inverse = covariance.solve(Eigen::MatrixXd::Identity(2 * m, 2 * m));
    for (Index j = 0; j < m; j++) {
        const Eigen::Vector2d w = weighted.segment<2>(2 * j);
        fall[used[j]] = w.dot(inverse.block<2, 2>(2 * j, 2 * j).ldlt().solve(w));
    }
    return fall;
}

FilterState::FilterState(const Matrix3d &rotation_, const Vector3d &position_, const Matrix6d &covariance_,
                         const Matrix6d &drift_covariance, Index map_lines)
    : rotation(rotation_), position(position_), with_map(Eigen::MatrixXd::Zero(12, 4 * map_lines))
{
    covariance.topLeftCorner<6, 6>() = covariance_;
    covariance.bottomRightCorner<6, 6>() = drift_covariance;
}

// twist, noise: (v, omega) in the camera's frame; noise is the standard deviation of this step's own error, drift_twist
// times the drift the lasting one. The drift is forgotten but for `memory` in [0, 1], and goes towards N(0, drift_std^2).
void FilterState::predict(const Vector6d &twist, const Vector6d &noise, const Matrix6d &drift_twist, double drift_std,
                          double duration, double memory)
{
    const Vector6d moving = (twist + drift_twist * drift) * duration;
    Matrix3d turn, mean_turn;
    exponential(moving.tail<3>(), turn, mean_turn);
    const Matrix3d in_world = rotation * mean_turn;
    const Vector3d shift = in_world * moving.head<3>();
    Matrix6d by_twist = Matrix6d::Zero();
    by_twist.topLeftCorner<3, 3>() = duration * in_world;
    by_twist.bottomRightCorner<3, 3>() = duration * in_world;
    // To first order in the duration: a turn bends the way gone in this step.
    by_twist.topRightCorner<3, 3>() = -0.5 * duration * skew(shift) * in_world;
    Matrix12 by_state = Matrix12::Identity();
    by_state.block<3, 3>(0, 3) = -skew(shift);
    by_state.topRightCorner<6, 6>() = by_twist * drift_twist;
    by_state.bottomRightCorner<6, 6>() *= memory;
    covariance = (by_state * covariance * by_state.transpose()).eval();
    covariance.topLeftCorner<6, 6>() += by_twist * noise.cwiseAbs2().asDiagonal() * by_twist.transpose();
    covariance.bottomRightCorner<6, 6>().diagonal().array() += (1.0 - memory * memory) * drift_std * drift_std;
    with_map = (by_state * with_map).eval();
    position += shift;
    // Renormalised, so that millions of steps do not drift off SO(3).
    rotation = Eigen::Quaterniond(rotation * turn).normalized().toRotationMatrix();
    drift *= memory;
}

// Add to the covariance of the pose.
void FilterState::inflate(const Matrix6d &pose)
{
    covariance.topLeftCorner<6, 6>() += pose;
}

// Know nothing of the drift any more, but that it is N(0, drift_std^2).
void FilterState::forget_drift(double drift_std)
{
    covariance.rightCols<6>().setZero();
    covariance.bottomRows<6>().setZero();
    covariance.bottomRightCorner<6, 6>().diagonal().setConstant(drift_std * drift_std);
    with_map.bottomRows<6>().setZero();
    drift.setZero();
}

// What an image that led to this state leaves to be split. `before` is the state before it.
Curvature FilterState::curvature(const FilterState &before, const FilterMap &map, const std::vector<Index> &rows,
                                 const Rows &image, const Rows &covariances, const std::vector<bool> &used) const
{
    const Eigen::LLT<Matrix6d> root(before.covariance.topLeftCorner<6, 6>());
    const Matrix6d L = root.matrixL();
    Matrix6d told = root.matrixL().solve(Matrix6d(covariance.topLeftCorner<6, 6>()));
    told = root.matrixL().solve(Matrix6d(told.transpose())).eval();
    const Eigen::SelfAdjointEigenSolver<Matrix6d> axes(0.5 * (told + told.transpose()));
    Curvature found{0.0, root.matrixU().solve(Vector6d(axes.eigenvectors().col(5)))};
    const Vector6d along = 2.0 * std::sqrt(std::max(axes.eigenvalues()[5], 0.0)) * L * axes.eigenvectors().col(5);
    std::vector<Eigen::Matrix2d> weight(rows.size());
    const auto misfit = [&](const Vector6d &change, bool here) {
        Matrix3d turn, unused;
        exponential(change.tail<3>(), turn, unused);
        const Matrix3d R = turn * rotation;
        const Vector3d p = position + change.head<3>();
        Vector6d from_before;
        from_before << p - before.position, rotation_vector(R * before.rotation.transpose());
        double squared = root.matrixL().solve(from_before).squaredNorm();
        for (std::size_t i = 0; i < rows.size(); i++) {
            if (!used[i])
                continue;
            const SeenLine line = seen_line(map, rows[i], R, p, image.row(i));
            if (here) {
                Eigen::Matrix2d noise = line.by_map * line.by_map.transpose();
                noise += (Eigen::Matrix2d() << covariances(i, 0), covariances(i, 1), covariances(i, 1), covariances(i, 2)).finished();
                weight[i] = noise.inverse();
            }
            squared += line.residual.dot(weight[i] * line.residual);
        }
        return squared;
    };
    const double least = misfit(Vector6d::Zero(), true);
    for (const double side : {-1.0, 1.0})
        found.nonlinearity = std::max(found.nonlinearity, std::abs(misfit(side * along, false) - least - 4.0) / 4.0);
    return found;
}

// Source: iterated extended Kalman filter as Gauss-Newton with the prior (Bell, Cathey 1993), on SO(3) x R^3; the map's
// errors are considered, not estimated (Schmidt 1966). image: (k, 3) l'; covariances: (k, 3) of angle and offset.
Innovation FilterState::update(const FilterMap &map, const std::vector<Index> &rows, const Rows &image,
                               const Rows &covariances, const std::vector<bool> &used, int iterations)
{
    const Index k = static_cast<Index>(rows.size());
    const bool considered = with_map.cols() > 0;
    Innovation found;
    found.of_line = found.reversed = found.log_determinants = Eigen::VectorXd::Zero(k);
    std::vector<Index> &chosen = found.used;
    for (Index i = 0; i < k; i++)
        if (used[i])
            chosen.push_back(i);
    const Index m = static_cast<Index>(chosen.size());
    Matrix3d R = rotation, turn, unused;
    Vector3d p = position;
    Vector6d e = drift;
    Eigen::Matrix<double, Eigen::Dynamic, 6> H(2 * m, 6);
    Eigen::MatrixXd PH(12, 2 * m), S(2 * m, 2 * m), scaled;
    std::vector<Eigen::Matrix<double, 2, 4>> by_map(m);
    Eigen::VectorXd residual(2 * m), y;
    Matrix12 prior = covariance;
    Eigen::MatrixXd cross = with_map;
    Eigen::LLT<Eigen::MatrixXd> &factor = found.covariance;
    std::vector<SeenLine> lines(k);
    for (Index i = 0; i < k; i++) {
        const SeenLine &line = lines[i] = seen_line(map, rows[i], R, p, image.row(i));
        Eigen::Matrix2d spread = line.by_pose * covariance.topLeftCorner<6, 6>() * line.by_pose.transpose();
        spread += line.by_map * line.by_map.transpose();
        if (considered) {
            const Eigen::Matrix2d mixed =
                line.by_pose * with_map.block(0, 4 * rows[i], 6, 4) * line.by_map.transpose();
            spread += mixed + mixed.transpose();
        }
        spread(0, 0) += covariances(i, 0);
        spread(0, 1) += covariances(i, 1);
        spread(1, 0) += covariances(i, 1);
        spread(1, 1) += covariances(i, 2);
        found.of_line[i] = line.residual.dot(spread.inverse() * line.residual);
        found.reversed[i] = line.reversed;
        found.log_determinants[i] = std::log(spread.determinant());
    }
    for (bool final = m == 0; !final;) {
        const Vector3d back = rotation_vector(rotation * R.transpose());
        Eigen::Matrix<double, 12, 1> expected;
        expected << position - p, back, drift - e;
        if (found.iterations > 0) {
            const Matrix3d moved = inverse_left_jacobian(back);
            // exp(d) R is where exp(prior error) rotation is: d = back + J^-1 (prior error).
            prior = covariance;
            prior.middleRows<3>(3) = moved * covariance.middleRows<3>(3);
            prior.middleCols<3>(3) = (prior.middleCols<3>(3) * moved.transpose()).eval();
            if (considered)
                cross.middleRows<3>(3) = moved * with_map.middleRows<3>(3);
            for (const Index i : chosen)
                lines[i] = seen_line(map, rows[i], R, p, image.row(i));
        }
        for (Index j = 0; j < m; j++) {
            const SeenLine &line = lines[chosen[j]];
            residual.segment<2>(2 * j) = line.residual;
            H.middleRows<2>(2 * j) = line.by_pose;
            by_map[j] = line.by_map;
            found.reversed[chosen[j]] = line.reversed;
        }
        y = -residual - H * expected.head<6>();
        PH.noalias() = prior.leftCols<6>() * H.transpose();
        // The lower half of S is used.
        S.noalias() = H * PH.topRows<6>();
        for (Index j = 0; j < m; j++) {
            const auto c = covariances.row(chosen[j]);
            S(2 * j, 2 * j) += c[0];
            S(2 * j + 1, 2 * j) += c[1];
            S(2 * j + 1, 2 * j + 1) += c[2];
            if (!considered)
                continue;
            const Eigen::Matrix<double, 12, 2> with_line = cross.middleCols<4>(4 * rows[chosen[j]]) * by_map[j].transpose();
            PH.middleCols<2>(2 * j) += with_line;
            S.block<2, 2>(2 * j, 2 * j) += by_map[j] * by_map[j].transpose();
            S.bottomRows(2 * (m - j)).middleCols<2>(2 * j) += H.bottomRows(2 * (m - j)) * with_line.topRows<6>();
            S.middleRows<2>(2 * j).leftCols(2 * (j + 1)) +=
                with_line.topRows<6>().transpose() * H.topRows(2 * (j + 1)).transpose();
        }
        factor.compute(S);
        if (factor.info() != Eigen::Success || !y.allFinite())
            return found;
        scaled = factor.matrixL().solve(PH.transpose());
        found.weighted = factor.solve(y);
        Eigen::Matrix<double, 12, 1> step = expected + PH * found.weighted;
        const Eigen::Array<double, 12, 1> variance =
            prior.diagonal().array() - scaled.colwise().squaredNorm().transpose().array();
        if (!step.allFinite() || !(variance > 0.0).all())
            return found;
        const double angle = step.segment<3>(3).norm();
        const bool shortened = angle > longest_turn;
        if (shortened)
            step *= longest_turn / angle;
        const double size = (step.head<6>().array() / variance.head<6>().sqrt()).abs().maxCoeff();
        found.iterations++;
        final = found.iterations >= iterations || (size < settled && !shortened);
        if (found.iterations >= iterations && size > 1.0)
            return found;
        p += step.head<3>();
        exponential(step.segment<3>(3), turn, unused);
        R = (turn * R).eval();
        e += step.tail<6>();
    }
    if (m > 0) {
        found.squared = y.dot(found.weighted);
        found.log_determinant = 2.0 * factor.matrixLLT().diagonal().array().log().sum();
        if (considered) {
            Eigen::MatrixXd explained = H * cross.topRows<6>();
            for (Index j = 0; j < m; j++)
                explained.block<2, 4>(2 * j, 4 * rows[chosen[j]]) += by_map[j];
            const Eigen::MatrixXd gain = factor.matrixU().solve(scaled).transpose();
            with_map = cross;
            with_map.noalias() -= gain * explained;
        }
        covariance = prior;
        covariance.noalias() -= scaled.transpose() * scaled;
        covariance = (0.5 * (covariance + covariance.transpose())).eval();
        position = p;
        rotation = Eigen::Quaterniond(R).normalized().toRotationMatrix();
        drift = e;
    }
    found.good = true;
    return found;
}

// This state after an image, without up to so many lines that do not agree with it, the worst one first.
std::optional<Fit> FilterState::fit(const FilterMap &map, const std::vector<Index> &rows, const Rows &image,
                                    const Rows &covariances, int removable, const FitGates &gates, int iterations) const
{
    const std::size_t k = rows.size();
    std::vector<bool> used(k, true);
    for (int removed = 0; removed <= removable; removed++) {
        FilterState after = *this;
        Innovation found = after.update(map, rows, image, covariances, used, iterations);
        if (found.good) {
            double worst = 0.0, cost = found.squared + found.log_determinant;
            for (std::size_t i = 0; i < k; i++) {
                if (used[i]) {
                    worst = std::max(worst, found.of_line[i]);
                    cost += gates.reversal_cost * found.reversed[i];
                } else {
                    // As if it were just at the gate, so that no kind of robot is preferred for keeping it.
                    cost += gates.of_line + found.log_determinants[i];
                }
            }
            if (worst <= gates.of_line && found.squared <= gates.by_count.at(found.used.size()) && std::isfinite(cost))
                return Fit{std::move(after), std::move(found), std::move(used), cost};
        }
        if (removed == removable)
            break;
        const Eigen::VectorXd suspect = found.good ? found.removal() : found.of_line;
        std::size_t most = k;
        for (std::size_t i = 0; i < k; i++)
            if (used[i] && (most == k || suspect[i] > suspect[most]))
                most = i;
        if (most == k)
            break;
        used[most] = false;
    }
    return std::nullopt;
}

}  // namespace plsing
