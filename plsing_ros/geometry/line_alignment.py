# SPDX-License-Identifier: Apache-2.0
"""Where a camera is, from oriented 3-D lines that it sees and the same lines in the scene: in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from plsing_ros import _core
from plsing_ros.errors import GeometryError, ObservationError
from plsing_ros.geometry.line_set import LineSet
from plsing_ros.geometry.pose import Pose

# Below this second singular value (of directions with unit weight each) the directions are taken as parallel.
_PARALLEL = 1e-6
# Features whose directions fit the scene no better than this do not belong to it [rad].
_MAX_MISFIT = 0.5


@dataclass(frozen=True, eq=False)
class Alignment:
    """A camera pose from lines.

    Attributes:
        T_world_camera: Where the camera is.
        angle: Largest angle between a seen and an expected direction [rad].
        offset: Root mean square misfit of the moments [m].
    """

    T_world_camera: Pose
    angle: float
    offset: float


def align_lines(scene: LineSet, seen: LineSet) -> Alignment:
    """Return the pose of the camera that sees lines of the scene; rows are matched by id, in any order.

    The rotation is the one that brings the directions together best (SVD of their correlation, Kabsch); given it, the
    translation t of l_scene - R l_camera = t x u_scene is a linear least-squares solution.

    Args:
        scene: The lines in the scene frame; may have more lines than are seen.
        seen: Lines in the camera frame.

    Raises:
        GeometryError: If a seen line is not in the scene, or the seen lines are fewer than two or all parallel, so
            that they do not fix a pose.

    Source: new, docs/monitor.md; the rotation is Kabsch's.
    """
    expected = matched(scene, seen)
    aligned = _core.align_lines(expected.direction, expected.moment, seen.direction, seen.moment)
    # The third is the second singular value of the directions' correlation.
    if aligned is None or len(seen) < 2 or aligned[2] < _PARALLEL:
        raise GeometryError(f"the {len(seen)} seen line(s) are all parallel; they do not fix a camera pose")
    rotation, translation, _, cosine, offset = aligned
    return Alignment(Pose(rotation, translation), math.acos(min(max(cosine, -1.0), 1.0)), offset)


def matched(scene: LineSet, seen: LineSet) -> LineSet:
    """Return the lines of the scene that are seen, in the order they are seen.

    Raises:
        GeometryError: If a seen line is not in the scene.
    """
    return scene if seen.ids == scene.ids else scene.select(matched_rows(scene, seen))


def matched_rows(scene: LineSet, seen: LineSet) -> list[int]:
    """Return the row of each seen line in the scene.

    Raises:
        GeometryError: If a seen line is not in the scene.
    """
    row_of = {i: row for row, i in enumerate(scene.ids)}
    unknown = [i for i in seen.ids if i not in row_of]
    if unknown:
        raise GeometryError(f"line id {unknown[0]} is not in the scene, whose ids are {list(scene.ids)}")
    return [row_of[i] for i in seen.ids]


def lines_to_reverse(scene: LineSet, seen: LineSet, angle: float) -> tuple[int, ...]:
    """Return the id of the one line to reverse so that all fit within an angle [rad]; nothing if there is none.

    For a camera whose pose is not known: every line is tried.
    """
    for row, identity in enumerate(seen.ids):
        sign = np.ones((len(seen), 1))
        sign[row] = -1.0
        turned = LineSet(seen.direction * sign, seen.moment * sign, seen.frame, seen.ids)
        if align_lines(scene, turned).angle <= angle:
            return (identity,)
    return ()


def pose_by_lines(scene: LineSet, lines: LineSet) -> Pose | None:
    """Return T_world_camera by the lines that are seen, or None if they do not tell.

    Args:
        scene: The lines in the scene frame.
        lines: Those that are seen, in the camera frame.

    Raises:
        ObservationError: If a line is reversed with respect to the scene.
    """
    try:
        aligned = align_lines(scene, lines)
    except GeometryError:
        return None
    if aligned.angle > _MAX_MISFIT:
        if ids := lines_to_reverse(scene, lines, _MAX_MISFIT):
            raise ObservationError(
                f"line {ids[0]} is reversed with respect to the scene: the sign of its direction must agree with the "
                "scene's"
            )
        return None
    return aligned.T_world_camera
