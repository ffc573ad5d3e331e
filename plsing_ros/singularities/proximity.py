# SPDX-License-Identifier: Apache-2.0
"""How near any camera centre is to a singular one, whatever the scene: in tolerances, in metres, in precision."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.stats import qmc

from plsing_ros import _core
from plsing_ros.arrays import Array, checked_array
from plsing_ros.errors import GeometryError
from plsing_ros.features.rank_basis import rank_bases
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.pose import checked_center
from plsing_ros.singularities.scene_frame import SceneFrame

# Where the normal condition of a scene is taken, in scene lengths from its centre.
_NEAREST, _FARTHEST, _PLACES = 1.0, 3.0, 1000
_ANY_ROTATION, _NO_COVARIANCES = np.eye(3), np.empty((0, 3))


class Proximity(NamedTuple):
    """How near a camera centre is to a singular one.

    The interaction matrix is taken as the row-normalised rank basis, with translations in units of the scene's length
    (SceneFrame), so that nothing depends on the orientation of the camera, the unit, or the orientation of the lines.

    Attributes:
        z: The least of the singular values, each over its standard deviation for the errors of the lines: below 3, the
            camera may be singular as far as is known of the lines. None if all lines are known exactly.
        distance: To the nearest singular centre, to first order [m].
        closest_point: That centre, shape (3,) [m].
        relative_condition: Inverse condition number over the scene's normal one (normal_condition).
        position_std: Standard deviation of the camera's position along the least observable motion [m]; infinite at a
            singular centre.
        rotation_std: Standard deviation of its orientation along that motion [rad]; likewise.
        least_observable_motion: (v, omega) of the camera in the frame of the lines, shape (6,) [m, rad]: moves the
            images least, for rotations in radians and translations in units of the scene's length.
    """

    z: float | None
    distance: float
    closest_point: Array
    relative_condition: float
    position_std: float
    rotation_std: float
    least_observable_motion: Array

    def __str__(self) -> str:
        x, y, z = self.closest_point.tolist()
        known = "" if self.z is None else f"z {self.z:.3g}; "
        return (
            f"{known}about {self.distance:.3g} m from a singular centre near ({x:.4g}, {y:.4g}, {z:.4g}) m; 1/cond "
            f"{self.relative_condition:.2g} of normal; standard deviation {self.position_std:.3g} m and "
            f"{self.rotation_std:.3g} rad along the least observable motion"
        )


def proximity(
    lines: LineSet,
    frame: SceneFrame,
    normal: float,
    pose_or_center: Pose | npt.ArrayLike,
    image_std: float,
    covariances: Array | None = None,
) -> Proximity:
    """Return how near a camera is to a singular centre.

    Args:
        lines: The observed lines, with their standard deviations.
        frame: Their scene frame.
        normal: Their normal_condition.
        pose_or_center: T_world_camera, or the camera centre, shape (3,) [m]; in the frame of the lines.
        image_std: Standard deviation of the normals of the interpretation planes, about each axis across them, that
            position_std and rotation_std are for [rad]: about that of a pixel over the focal length.
        covariances: Of angle and offset of the image lines, as LineObservation has them, shape (n, 3), for a pose; then
            position_std and rotation_std are for these.

    Raises:
        GeometryError: If the centre is not three finite numbers or beyond 1e50 m, if image_std is not positive, if
            covariances come with a centre alone, in another shape or not finite, or if the rank basis overflows.

    Source: new, docs/near_singular.md.
    """
    if not 0.0 < image_std < math.inf:
        raise GeometryError(f"image_std is {image_std} rad; it must be positive and finite")
    center = checked_center("pose_or_center", pose_or_center)
    rotation: Array = _ANY_ROTATION
    weights: Array = _NO_COVARIANCES
    if covariances is not None:
        if not isinstance(pose_or_center, Pose):
            raise GeometryError("covariances of image lines are given with a camera centre alone; give the pose")
        rotation = pose_or_center.rotation
        weights = checked_array("covariances", covariances, (len(lines), 3))
    found = _core.proximity(
        lines.direction,
        lines.pivot,
        lines.position_std,
        lines.direction_std,
        center,
        frame.length,
        image_std,
        normal,
        rotation,
        weights,
    )
    if found is None:
        raise GeometryError(f"a camera at {center.tolist()} m is too far from the lines to compute with")
    return Proximity._make(found)


def normal_condition(frame: SceneFrame) -> float:
    """Return the median inverse condition number at 1000 Halton points one to three scene lengths from the centre."""
    return float(np.median(conditions_at(frame, halton_shell())))


def conditions_at(frame: SceneFrame, centers: Array) -> Array:
    """Return the inverse condition number of the row-normalised xi at scene coordinates (k, 3), shape (k,).

    Accurate to about 1e-8, the root of the rounding. Rows of a line that a centre is on are zero.
    """
    rows = rank_bases(frame.direction, frame.point, centers, normalized=True)
    values = np.linalg.eigvalsh(rows.transpose(0, 2, 1) @ rows)
    smallest, largest = np.maximum(values[:, 0], 0.0), values[:, 5]
    share = np.divide(smallest, largest, out=np.zeros(len(values)), where=largest > 0.0)
    found: Array = np.sqrt(share)
    return found


@lru_cache(maxsize=1)
def halton_shell() -> Array:
    """Return 1000 Halton points one to three units from the origin, shape (1000, 3)."""
    # The first of the sequence is at a corner.
    radius, height, turn = qmc.Halton(3, scramble=False).random(_PLACES + 1)[1:].T
    height, turn = 2.0 * height - 1.0, 2.0 * np.pi * turn
    flat = np.sqrt(1.0 - height**2)
    way = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1)
    return np.ascontiguousarray(way * (_NEAREST + (_FARTHEST - _NEAREST) * radius)[:, np.newaxis])
