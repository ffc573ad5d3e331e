# SPDX-License-Identifier: Apache-2.0
"""Scenes that are singular wherever the camera is, and lines that are given twice."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import cross
from plsing_ros.singularities.scene_frame import SceneFrame

# Unit directions and scene coordinates that differ by less than this are equal.
TOLERANCE = 1e-9


def distinct_rows(frame: SceneFrame) -> list[int]:
    """Return the rows of the lines without those that repeat an earlier one, with either orientation."""
    n = len(frame.direction)
    if not frame.has_near_parallels:
        return list(range(n))
    kept: list[int] = []
    for row in range(n):
        sign = np.sign(frame.direction[kept] @ frame.direction[row])[:, np.newaxis]
        turned = np.abs(frame.direction[row] - sign * frame.direction[kept]).max(axis=1)
        apart = np.abs(frame.point[row] - frame.point[kept]).max(axis=1)
        if not ((turned <= TOLERANCE) & (apart <= TOLERANCE)).any():
            kept.append(row)
    return kept


def singular_everywhere_reason(frame: SceneFrame, distinct: int) -> str | None:
    """Return why every camera position is singular and which motion is lost there, or None if that is not so.

    Args:
        frame: The scene with all its lines.
        distinct: How many of them differ.

    Source: new, docs/theory.md section "Singular everywhere".
    """
    n = len(frame.direction)
    if distinct < 3:
        given = f"{n} line{'s' if n > 1 else ''}" + ("" if distinct == n else f", only {distinct} of them different,")
        return (
            f"{given} cannot fix six degrees of freedom (two for each line): at least {6 - 2 * distinct} motions are "
            "lost everywhere"
        )
    first = frame.direction[0]
    if frame.has_near_parallels and float(np.abs(cross(frame.direction[1:], first)).max()) <= TOLERANCE:
        direction = ", ".join(f"{value:.6g}" for value in first)
        return f"all lines are parallel: translation along their direction ({direction}) is lost everywhere"
    if frame.concurrent:
        point = ", ".join(f"{value:.6g}" for value in frame.center)
        return f"all lines pass through the point ({point}): translation towards or away from it is lost everywhere"
    return None
