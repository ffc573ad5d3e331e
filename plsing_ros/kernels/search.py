"""From first estimates of a camera pose to the few refined ones that explain an image: twin of search.c."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array
from plsing_ros.kernels.refinement import refine_poses
from plsing_ros.kernels.residuals import RESIDUAL_ROWS, image_residuals

# Refined first estimates, and how many of the best are looked at to find ones that differ.
MOST_FOUND = 6
_MOST_COMPARED = 24
# Of a pose that is found: rotation (9), translation (3), cost, and which first estimate it comes from.
FOUND_COLUMNS = 14
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
# Refined poses that differ by less, as same_pose has it, are the same.
EQUAL = 1e-3


def search_poses(
    lines: Array,
    image_lines: Array,
    settings: Array,
    rotation: Array,
    translation: Array,
    costs: Array,
    found: Array,
) -> int:
    """Refine the best of k first estimates of T_camera_world on all lines; return how many poses explain the image.

    Cheap ones that differ are refined together, in stages; those that cannot catch up any more are dropped.

    Args:
        lines: As for image_residuals, like the next two.
        image_lines: Of n lines.
        settings: Noise and field of view.
        rotation: First estimates, shape (k, 3, 3).
        translation: Shape (k, 3) [m].
        costs: Of a line that cannot be seen, and of one that is seen against its direction, shape (2,).
        found: Filled from the first row on, best first, shape (MOST_FOUND, FOUND_COLUMNS). Costs are -2 log of the
            likelihood of the image, up to a constant.
    """

    def cost_of(rotation: Array, translation: Array) -> Array:
        table = np.empty((len(rotation), RESIDUAL_ROWS, len(lines)))
        image_residuals(lines, image_lines, settings, rotation, translation, table)
        cost = table[:, 2] ** 2 + table[:, 3] ** 2 + table[:, 14] + costs[0] * table[:, 13] + costs[1] * table[:, 12]
        total: Array = cost.sum(axis=1)
        return np.where(np.isfinite(total), total, np.inf)

    if len(rotation) == 0:
        return 0
    cost = cost_of(rotation, translation)
    start = different_poses(rotation, cost, MOST_FOUND)
    start = start[cost[start] <= cost[start[0]] + _FAR]
    rotation, translation, final = rotation[start], translation[start], np.zeros(len(start))
    gain = np.full(len(start), np.inf)
    for iterations, far in _STAGES:
        moving = final == 0.0
        moved = rotation[moving], translation[moving], gain[moving], final[moving]
        refine_poses(lines, image_lines, settings, np.ones((moving.sum(), len(lines))), *moved, iterations)
        rotation[moving], translation[moving], gain[moving], final[moving] = moved
        cost = cost_of(rotation, translation)
        # What is still to be gained is less certain the more it is.
        promised = cost - np.where(final > 0.0, 0.0, _OPTIMISM * gain)
        kept = (promised <= cost.min() + _IMPLAUSIBLE) & (cost <= cost.min() + far)
        rotation, translation, cost, gain, final, start = (
            each[kept] for each in (rotation, translation, cost, gain, final, start)
        )
        if final.all():
            break
    center = -np.einsum("kji,kj->ki", rotation, translation)
    rows: list[int] = []
    # Costs that are the same but for rounding leave poses in the order of their first estimates.
    for i in np.argsort(np.round(cost, 3), kind="stable"):
        if np.isfinite(cost[i]) and not any(
            same_pose((rotation[j], center[j]), (rotation[i], center[i]), EQUAL) for j in rows
        ):
            rows.append(int(i))
    parts = rotation[rows].reshape(-1, 9), translation[rows], cost[rows, np.newaxis], start[rows, np.newaxis]
    found[: len(rows)] = np.concatenate(parts, axis=1)
    return len(rows)


def same_pose(first: tuple[Array, Array], second: tuple[Array, Array], tolerance: float) -> bool:
    """Return whether two poses differ by less than a tolerance, in every element.

    Args:
        first: Rotation, shape (3, 3), and camera centre, shape (3,) [m].
        second: Likewise.
        tolerance: Of the rotation; the centre's is this times (1 m + the first centre's largest element).
    """
    (rotation, center), (other_rotation, other_center) = first, second
    return bool(
        np.abs(rotation - other_rotation).max() < tolerance
        and np.abs(center - other_center).max() < tolerance * (1.0 + np.abs(center).max())
    )


def different_poses(rotation: Array, cost: Array, most: int) -> npt.NDArray[np.intp]:
    """Return up to `most` of the cheapest candidates whose rotations (k, 3, 3) differ, cheapest first."""
    order = np.argsort(cost, kind="stable")[:_MOST_COMPARED]
    cosine = np.einsum("aij,bij->ab", rotation[order], rotation[order])
    near = cosine > 1.0 + 2.0 * np.cos(_SAME_ROTATION)
    chosen: list[int] = []
    for i in range(len(order)):
        if len(chosen) < most and not near[i, chosen].any():
            chosen.append(i)
    return order[chosen]
