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
_FAR = 1e6
# Iterations, and by how much the cost may then still exceed the best one's.
_STAGES = ((3, _FAR), (8, 1e3), (40, 1e3))
# A pose is given up that would be less likely than the best one by exp(-30 / 2) even if its cost fell by three times
# what its last step promised.
_OPTIMISM = 3.0
_IMPLAUSIBLE = 30.0
_OUTLIER_STAGES = (6, 3, 6, 40)


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

    def of_lines(self, residuals: Residuals) -> Array:
        """Return the cost of each line as an inlier, without its covariance's share, shape (k, n)."""
        cost: Array = residuals.squared + self.reversal * residuals.reversed + self.outlier * ~residuals.visible
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
    for iterations in _OUTLIER_STAGES:
        refined = refine(image, rotation, translation, iterations, weight)
        rotation, translation = refined.rotation, refined.translation
        fits: BoolArray = costs.of_lines(refined.residuals) <= costs.outlier
        if iterations != _OUTLIER_STAGES[-1]:
            # Never fewer than enough, so that a first estimate may still come nearer.
            rank = np.argsort(np.argsort(costs.of_lines(refined.residuals), axis=1), axis=1)
            weight = (fits | (rank < enough)).astype(float)
    weight = weight * fits
    each = np.where(weight > 0.0, costs.of_lines(refined.residuals), costs.outlier)
    cost = (each + refined.residuals.log_determinant).sum(axis=1)
    kept = np.flatnonzero(weight.sum(axis=1) >= enough)
    return _sorted(refined, kept, weight, cost, (start[0][kept], start[1][kept]))


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
