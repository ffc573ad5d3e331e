"""Where a camera is, from oriented 3-D lines that it sees and the same lines in the scene: in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array, cross
from plsing_ros.errors import GeometryError
from plsing_ros.geometry.line_set import LineSet
from plsing_ros.geometry.pose import Pose

# Below this second singular value (of directions with unit weight each) the directions are taken as parallel.
_PARALLEL = 1e-6
# A direction whose cosine to the expected one is below this points the other way, whatever the noise.
_REVERSED = -0.5


@dataclass(frozen=True, eq=False)
class Alignment:
    """A camera pose from lines.

    Attributes:
        T_scene_camera: Where the camera is.
        angle: Largest angle between a seen and an expected direction [rad].
        offset: Root mean square misfit of the moments [m].
    """

    T_scene_camera: Pose
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
    u = expected.direction
    left, values, right = np.linalg.svd(u.T @ seen.direction)
    if len(seen) < 2 or values[1] < _PARALLEL:
        raise GeometryError(f"the {len(seen)} seen line(s) are all parallel; they do not fix a camera pose")
    if np.linalg.det(left) * np.linalg.det(right) < 0.0:
        left = left * (1.0, 1.0, -1.0)
    R = left @ right
    difference = expected.moment - seen.moment @ R.T
    # Normal equations of sum |t x u - difference|^2: sum (I - u u^T) t = sum u x difference.
    normal = len(u) * np.eye(3) - u.T @ u
    t = np.linalg.solve(normal, cross(u, difference).sum(axis=0))
    cosine = np.einsum("ij,ij->i", u, seen.direction @ R.T)
    misfit = difference - cross(t, u)
    return Alignment(
        Pose(R, t),
        float(np.arccos(np.clip(cosine.min(), -1.0, 1.0))),
        float(np.sqrt(np.einsum("ij,ij->", misfit, misfit) / len(u))),
    )


def matched(scene: LineSet, seen: LineSet) -> LineSet:
    """Return the lines of the scene that are seen, in the order they are seen.

    Raises:
        GeometryError: If a seen line is not in the scene.
    """
    if seen.ids == scene.ids:
        return scene
    row_of = {i: row for row, i in enumerate(scene.ids)}
    unknown = [i for i in seen.ids if i not in row_of]
    if unknown:
        raise GeometryError(f"line id {unknown[0]} is not in the scene, whose ids are {list(scene.ids)}")
    return scene.select([row_of[i] for i in seen.ids])


def reversed_lines(scene: LineSet, seen: LineSet, rotation: Array) -> tuple[int, ...]:
    """Return the ids of seen lines that point against those of the scene.

    Args:
        scene: In the scene frame.
        seen: In the camera frame.
        rotation: Of T_scene_camera, shape (3, 3); the noise of both may be large.
    """
    cosine = np.einsum("ij,ij->i", matched(scene, seen).direction @ rotation, seen.direction)
    if cosine.min() >= _REVERSED:
        return ()
    return tuple(seen.ids[row] for row in np.flatnonzero(cosine < _REVERSED))


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
