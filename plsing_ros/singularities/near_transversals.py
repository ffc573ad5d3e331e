# SPDX-License-Identifier: Apache-2.0
"""Straight lines that meet five or more measured lines as far as is known of them."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array, cross
from plsing_ros.geometry import LineSet
from plsing_ros.singularities.residual import singularity_residuals
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.transversals import TOLERANCE, Transversal, places_along, transversals_of_pencil

# Misses in standard deviations, root mean square over the conditions, up to which a line may meet all lines.
_MAX_EXACTNESS = 3.0
_STEPS = 6


def near_transversals(lines: LineSet) -> list[Transversal]:
    """Return the lines that meet n >= 5 measured lines within their tolerances, without names, nearest misses first.

    A line misses each observed line by a product l . d + u . m with a variance that follows from the tolerances. Four
    of n such misses can always be zero, so that the root mean square is over the other n - 4.

    Args:
        lines: The measured lines.

    Source: new, docs/near_singular.md section "Transversals of measured lines".
    """
    frame = SceneFrame.of(lines)
    conditions = len(lines) - 4
    if conditions < 1 or frame.concurrent:
        return []
    found: list[Transversal] = []
    # A line that all lines meet within tolerances is near one that the two weakest right singular vectors allow.
    right = np.linalg.svd(frame.plucker_matrix)[2]
    for start in (*transversals_of_pencil(right[-2:]).lines, right[-1]):
        if np.linalg.norm(start[:3]) <= TOLERANCE:
            continue
        line, exactness = _weighted_best(lines, frame, start)
        foot = cross(line[:3], line[3:])
        same = any(
            abs(line[:3] @ other.direction) > 1.0 - 1e-9
            and np.linalg.norm(cross(frame.to_scene(other.point) - foot, line[:3])) < 1e-4
            for other in found
        )
        if exactness <= _MAX_EXACTNESS and not same:
            residual = singularity_residuals(
                frame.point, frame.direction, places_along(foot[np.newaxis], line[np.newaxis, :3])
            )
            sign = 1.0 if line[np.abs(line[:3]).argmax()] > 0.0 else -1.0
            found.append(Transversal(frame.from_scene(foot), sign * line[:3], float(residual.max()), "", exactness))
    return sorted(found, key=lambda transversal: transversal.exactness)


def _weighted_best(lines: LineSet, frame: SceneFrame, start: Array) -> tuple[Array, float]:
    """Return the line (d, m) that misses all lines by the fewest standard deviations, near one, and how many."""
    rows, pivot = frame.plucker_matrix, frame.to_scene(lines.pivot)
    position_std, direction_std = lines.position_std / frame.length, lines.direction_std
    line = start / np.linalg.norm(start[:3])
    line[3:] -= (line[:3] @ line[3:]) * line[:3]
    for _ in range(_STEPS):
        d, m = line[:3], line[3:]
        foot = cross(d, m)
        # The miss changes by dp . (u x d) and by du . ((x - p) x d), x on the line.
        shift = np.linalg.norm(cross(frame.direction, d), axis=1)
        lever = cross(foot - pivot, d)
        lever = lever - (lever * frame.direction).sum(axis=1, keepdims=True) * frame.direction
        std = np.hypot(position_std * shift, direction_std * np.linalg.norm(lever, axis=1)) + 1e-15
        miss = (rows @ line) / std
        tangent = np.linalg.svd(np.array([[*d, 0.0, 0.0, 0.0], [*m, *d]]))[2][2:].T
        line = line - tangent @ np.linalg.lstsq((rows / std[:, np.newaxis]) @ tangent, miss, rcond=1e-9)[0]
        length = np.linalg.norm(line[:3])
        line = line / length
        line[3:] -= (line[:3] @ line[3:]) * line[:3]
    return line, float(np.sqrt((miss**2).sum() / (len(rows) - 4)))
