# SPDX-License-Identifier: Apache-2.0
"""From first estimates to the few poses that explain an image of lines, with the lines each of them rests on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from plsing_ros import _core
from plsing_ros.arrays import Array, BoolArray
from plsing_ros.pose.refinement import refine
from plsing_ros.pose.residuals import ImageResiduals, Residuals

# Rounds of refining and choosing the lines anew, and iterations in each.
_OUTLIER_ROUNDS, _OUTLIER_ITERATIONS = 8, 5
_LAST_ITERATIONS = 40
# First estimates that are tried with lines left out.
_MAX_FIRST_ESTIMATES = 12


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A refined pose T_camera_world.

    Attributes:
        image: What it explains.
        rotation: Shape (3, 3).
        translation: Shape (3,) [m].
        weight: 1 for the lines it rests on, else 0, shape (n,).
        cost: -2 log of its likelihood, up to a constant of the image.
        start: Rotation and translation of the first estimate it comes from.
    """

    image: ImageResiduals
    rotation: Array
    translation: Array
    weight: Array
    cost: float
    start: tuple[Array, Array]

    @cached_property
    def center(self) -> Array:
        """The camera centre in the world, shape (3,) [m]."""
        center: Array = -self.translation @ self.rotation
        return center

    @cached_property
    def residuals(self) -> Residuals:
        """At this pose alone (k = 1)."""
        return self.image.at(self.rotation[np.newaxis], self.translation[np.newaxis])

    def likelihood_ratio(self, other: Hypothesis) -> float:
        """Return its likelihood over that of another one, at most 1."""
        return math.exp(-0.5 * max(0.0, self.cost - other.cost))


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
        cost: Array = squared + self.reversal * residuals.reversed + self.outlier * residuals.hidden
        return cost


def all_lines_hypotheses(image: ImageResiduals, rotation: Array, translation: Array, costs: Costs) -> list[Hypothesis]:
    """Return refined poses that rest on all lines, best first; see outlier_hypotheses for the arguments."""
    weight = np.ones(image.count)
    return [
        Hypothesis(image, refined_rotation, refined_translation, weight, cost, (rotation[start], translation[start]))
        for refined_rotation, refined_translation, cost, start in _core.search_poses(
            *image.known, rotation, translation, np.array([costs.outlier, costs.reversal])
        )
    ]


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
    chosen = _core.cheapest_different(rotation, cost, _MAX_FIRST_ESTIMATES)
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
    refined = refine(image, rotation, translation, _LAST_ITERATIONS, weight)
    fits = costs.of_lines(refined.residuals) <= costs.outlier
    weight = weight * fits
    each = np.where(weight > 0.0, costs.of_lines(refined.residuals), costs.outlier)
    cost = (each + refined.residuals.log_determinant).sum(axis=1)
    agreed = weight.sum(axis=1) >= enough
    # Poses that are the same but for rounding stay in the order of their first estimates.
    return [
        Hypothesis(
            image,
            refined.rotation[i],
            refined.translation[i],
            weight[i],
            float(cost[i]),
            (start[0][i], start[1][i]),
        )
        for i in np.argsort(np.round(cost, 3), kind="stable")
        if agreed[i] and np.isfinite(cost[i]) and np.isfinite(refined.translation[i]).all()
    ]


def _predicted_squared(residuals: Residuals, weight: Array) -> Array:
    """Return squared Mahalanobis distances (k, n), with the pose's covariance for lines that it does not rest on."""
    k, n = weight.shape
    jacobian = residuals.jacobian
    used = (jacobian * weight[:, np.newaxis, :, np.newaxis]).reshape(k, 2 * n, 6)
    normal = used.transpose(0, 2, 1) @ used
    scale = np.sqrt(np.einsum("kii->ki", normal) + 1e-300)
    normal = normal / (scale[:, :, np.newaxis] * scale[:, np.newaxis]) + 1e-12 * np.eye(6)
    scaled = (jacobian.reshape(k, 2 * n, 6) / scale[:, np.newaxis]).transpose(0, 2, 1)
    spread = np.linalg.solve(normal, scaled).reshape(k, 6, 2, n)
    covariance = np.einsum("kian,kibn->knab", scaled.reshape(k, 6, 2, n), spread)
    covariance = covariance * (weight == 0.0)[..., np.newaxis, np.newaxis] + np.eye(2)
    value = residuals.value.transpose(0, 2, 1)[..., np.newaxis]
    return np.asarray((value * np.linalg.solve(covariance, value)).sum(axis=(2, 3)))
