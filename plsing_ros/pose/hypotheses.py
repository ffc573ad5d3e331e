"""From first estimates to the few poses that explain an image of lines, with the lines each of them rests on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, BoolArray
from plsing_ros.pose.refinement import Refined, refine
from plsing_ros.pose.residuals import ImageResiduals, Residuals

# Refined first estimates, and how many of the best are looked at to find ones that differ.
_MOST = 6
_MOST_COMPARED = 24
# First estimates that differ by less than this are taken for the same one with different noise.
_SAME_ROTATION = 0.03  # [rad]
# Refined are those whose cost exceeds the best one's by less than this, in squared standard deviations.
_FAR = 1e4
# Iterations, and by how much the cost may then still exceed the best one's.
_STAGES = ((3, _FAR), (8, 1e3), (40, 1e3))
# A pose is given up that would be less likely than the best one by exp(-30 / 2) even if its cost fell by three times
# what its last step promised.
_OPTIMISM = 3.0
_IMPLAUSIBLE = 30.0
# Rounds of refining and choosing the lines anew, and iterations in each.
_OUTLIER_ROUNDS, _OUTLIER_ITERATIONS = 8, 5


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A refined pose T_camera_world.

    Attributes:
        rotation: Shape (3, 3).
        translation: Shape (3,) [m].
        residuals: At this pose alone (k = 1).
        weight: 1 for the lines it rests on, else 0, shape (n,).
        cost: -2 log of its likelihood, up to a constant of the image.
        start: Rotation and translation of the first estimate it comes from.
    """

    rotation: Array
    translation: Array
    residuals: Residuals
    weight: Array
    cost: float
    start: tuple[Array, Array]

    @property
    def center(self) -> Array:
        """The camera centre in the world, shape (3,) [m]."""
        center: Array = -self.rotation.T @ self.translation
        return center

    def plausibility(self, other: Hypothesis) -> float:
        """Return its likelihood over that of another one, at most 1."""
        return float(np.exp(-0.5 * max(0.0, self.cost - other.cost)))

    @property
    def squared_residual(self) -> float:
        """Sum of squared residuals over the lines it rests on."""
        return float(self.residuals.squared[0] @ self.weight)


@dataclass(frozen=True)
class Costs:
    """What a line that does not fit costs, in squared standard deviations: -2 log of probabilities.

    Attributes:
        outlier: Being left out.
        reversal: Being seen against its direction.
    """

    outlier: float
    reversal: float

    def of_lines(self, residuals: Residuals, weight: Array | None = None) -> Array:
        """Return the cost of each line as an inlier, without its covariance's share, shape (k, n).

        Args:
            residuals: At k poses.
            weight: If given, 0 for lines that the poses do not rest on, shape (k, n): for those, the residual is
                compared with its own noise and that of the pose.
        """
        squared = residuals.squared if weight is None else _predicted_squared(residuals, weight)
        cost: Array = squared + self.reversal * residuals.reversed + self.outlier * ~residuals.visible
        return cost

    def of_image(self, residuals: Residuals) -> Array:
        """Return the cost of all lines as inliers, shape (k,)."""
        return np.asarray((self.of_lines(residuals) + residuals.log_determinant).sum(axis=1))


def all_lines_hypotheses(image: ImageResiduals, rotation: Array, translation: Array, costs: Costs) -> list[Hypothesis]:
    """Return refined poses that rest on all lines, best first; see outlier_hypotheses for the arguments."""
    cost = costs.of_image(image.at(rotation, translation))
    start = _different(rotation, cost, _MOST)
    start = start[cost[start] <= cost[start[0]] + _FAR]
    first, now = (rotation[start], translation[start]), (rotation[start], translation[start])
    for iterations, far in _STAGES:
        refined = refine(image, *now, iterations)
        cost = costs.of_image(refined.residuals)
        # What is still to be gained is less certain the more it is.
        promised = cost - np.where(refined.final, 0.0, _OPTIMISM * refined.gain)
        kept = (promised <= cost.min() + _IMPLAUSIBLE) & (cost <= cost.min() + far)
        first = (first[0][kept], first[1][kept])
        now = (refined.rotation[kept], refined.translation[kept])
        if refined.final[kept].all():
            break
    return _sorted(refined, np.flatnonzero(kept), np.ones((len(kept), image.count)), cost, first)


def outlier_hypotheses(image: ImageResiduals, rotation: Array, translation: Array, costs: Costs) -> list[Hypothesis]:
    """Return refined poses that leave out lines that do not agree, best first.

    The best half of the lines, at least four, decides which first estimates are refined; then the lines within the
    gate. Poses that fewer than four lines, or fewer than half, agree with are dropped.

    Args:
        image: The residuals; of five lines or more.
        rotation: First estimates of T_camera_world, shape (k, 3, 3), k >= 1.
        translation: Shape (k, 3) [m].
        costs: Of lines that do not fit.
    """
    n = image.count
    enough = max(4, (n + 1) // 2)
    residuals = image.at(rotation, translation)
    each = costs.of_lines(residuals) + residuals.log_determinant
    cost = np.sort(each, axis=1)[:, :enough].sum(axis=1)
    chosen = _different(rotation, cost, 2 * _MOST)
    rotation, translation = rotation[chosen], translation[chosen]
    start = (rotation, translation)
    weight = (np.argsort(np.argsort(each[chosen], axis=1), axis=1) < enough).astype(float)
    for _ in range(_OUTLIER_ROUNDS):
        refined = refine(image, rotation, translation, _OUTLIER_ITERATIONS, weight)
        before, cost_of_each = weight, costs.of_lines(refined.residuals, weight)
        fits: BoolArray = cost_of_each <= costs.outlier
        # Never fewer than enough, so that a first estimate may still come nearer, as long as there is no better one.
        rank = np.argsort(np.argsort(cost_of_each, axis=1), axis=1)
        weight = (fits | (rank < enough)).astype(float)
        agreed = fits.sum(axis=1) >= enough
        kept = agreed if agreed.any() else np.ones(len(agreed), dtype=bool)
        rotation, translation, weight = refined.rotation[kept], refined.translation[kept], weight[kept]
        start = (start[0][kept], start[1][kept])
        if (weight == before[kept]).all():
            break
    refined = refine(image, rotation, translation, _STAGES[-1][0], weight)
    fits = costs.of_lines(refined.residuals) <= costs.outlier
    weight = weight * fits
    each = np.where(weight > 0.0, costs.of_lines(refined.residuals), costs.outlier)
    cost = (each + refined.residuals.log_determinant).sum(axis=1)
    agreeing = np.flatnonzero(weight.sum(axis=1) >= enough)
    return _sorted(refined, agreeing, weight, cost, (start[0][agreeing], start[1][agreeing]))


def _predicted_squared(residuals: Residuals, weight: Array) -> Array:
    """Return squared Mahalanobis distances (k, n), with the pose's covariance for lines that it does not rest on."""
    k, n = weight.shape
    jacobian = residuals.jacobian
    used = (jacobian * weight[:, np.newaxis, np.newaxis]).reshape(k, 6, 2 * n)
    normal = used @ used.transpose(0, 2, 1)
    scale = np.sqrt(np.einsum("kii->ki", normal) + 1e-300)
    normal = normal / (scale[:, :, np.newaxis] * scale[:, np.newaxis]) + 1e-12 * np.eye(6)
    scaled = jacobian / scale[:, :, np.newaxis, np.newaxis]
    spread = np.linalg.solve(normal, scaled.reshape(k, 6, 2 * n)).reshape(k, 6, 2, n)
    covariance = np.einsum("kian,kibn->knab", scaled, spread) * (weight == 0.0)[..., np.newaxis, np.newaxis] + np.eye(2)
    value = residuals.value.transpose(0, 2, 1)[..., np.newaxis]
    return np.asarray((value * np.linalg.solve(covariance, value)).sum(axis=(2, 3)))


def _different(rotation: Array, cost: Array, most: int) -> npt.NDArray[np.intp]:
    """Return up to `most` of the cheapest candidates whose rotations differ, cheapest first."""
    order = np.argsort(cost)[:_MOST_COMPARED]
    cosine = np.einsum("aij,bij->ab", rotation[order], rotation[order])
    near = cosine > 1.0 + 2.0 * np.cos(_SAME_ROTATION)
    chosen: list[int] = []
    for i in range(len(order)):
        if len(chosen) < most and not near[i, chosen].any():
            chosen.append(i)
    return order[chosen]


def _sorted(
    refined: Refined, kept: npt.NDArray[np.intp], weight: Array, cost: Array, first: tuple[Array, Array]
) -> list[Hypothesis]:
    """Return the kept ones of the refined poses as hypotheses; first has one pose for each of the kept."""
    # Poses that are the same but for rounding stay in the order of their first estimates.
    order = np.argsort(np.round(cost[kept], 3), kind="stable")
    return [
        Hypothesis(
            refined.rotation[i],
            refined.translation[i],
            refined.residuals.of_pose(int(i)),
            weight[i],
            float(cost[i]),
            (first[0][j], first[1][j]),
        )
        for j, i in zip(order, kept[order], strict=True)
        if np.isfinite(cost[i]) and np.isfinite(refined.translation[i]).all()
    ]
