# SPDX-License-Identifier: Apache-2.0
"""How exactly a camera could be placed by image lines at many poses: information, covariance, visibility."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from plsing_ros.arrays import Array, BoolArray
from plsing_ros.errors import GeometryError
from plsing_ros.features.image_jacobians import image_jacobians
from plsing_ros.geometry import LineSet, Pose

# Points along a segment that are tested for being in view, and how many of them must be.
_SAMPLES, _IN_VIEW = 9, 3
# Relative to the trace: keeps an exactly singular matrix invertible, far below what makes a difference.
_TINY = 1e-14
MIN_LINES = 3


class Camera(NamedTuple):
    """What a camera measures.

    Attributes:
        image_std: Standard deviation of an image line: of its angle [rad] and of its offset rho.
        max_angle: A line is in view within this angle of the optical axis [rad].
    """

    image_std: float = 1e-3
    max_angle: float = np.pi / 3


class LineInformation(NamedTuple):
    """What each of n lines tells at each of k poses.

    Attributes:
        matrices: Information about the camera's motion (v, omega) in its optical frame, shape (k, n, 6, 6); zero where
            a line is not in view.
        visible: Which lines are in view, shape (k, n).
    """

    matrices: Array
    visible: BoolArray


def line_information(
    lines: LineSet, poses: Sequence[Pose], camera: Camera, ends: Array | None = None
) -> LineInformation:
    """Return what each line tells about the camera's motion at each pose.

    The covariance of an image line is that of the image plus that of the map: with errors e_p of the line's point and
    e_u of its direction, both across the line, the moment about the camera centre changes by e_p x u + CM x e_u.

    Args:
        lines: n lines in the world frame, with their tolerances.
        poses: T_world_camera of k poses.
        camera: Noise and field of view.
        ends: End points of the segments that can be seen, shape (n, 2, 3) [m]; None: the lines have no ends.

    Raises:
        GeometryError: If there is no pose.

    Source: new, docs/results/line_selection.md.
    """
    if not poses:
        raise GeometryError("no pose given; at least one is needed to say how exact it is")
    rotation = np.stack([pose.rotation for pose in poses])
    position = np.stack([pose.translation for pose in poses])
    jacobians = image_jacobians(lines, rotation, position)
    covariance = np.broadcast_to(camera.image_std**2 * np.eye(2), (*jacobians.has_image.shape, 2, 2))
    if not lines.exact:
        covariance = covariance + _map_covariance(lines, rotation, position, jacobians.of_moment)
    J = jacobians.of_twist
    matrices = np.swapaxes(J, -1, -2) @ np.linalg.solve(covariance, J)
    visible = jacobians.has_image & _in_view(jacobians.image_lines, ends, rotation, position, camera.max_angle)
    matrices[~visible] = 0.0
    return LineInformation(matrices, visible)


def position_deviations(information: Array, count: Array) -> Array:
    """Return the standard deviation of the camera's position in its worst direction, shape (m,) [m].

    Args:
        information: Of the lines used together, summed, shape (m, 6, 6).
        count: How many lines that are, shape (m,).

    Returns:
        Infinite for fewer than three lines.
    """
    rotation = information[:, 3:, 3:] + _regular(information[:, 3:, 3:])
    coupling = information[:, :3, 3:]
    schur = information[:, :3, :3] - coupling @ np.linalg.solve(rotation, np.swapaxes(coupling, 1, 2))
    smallest = np.linalg.eigvalsh(schur)[:, 0]
    floor = np.finfo(float).eps * np.trace(information[:, :3, :3], axis1=1, axis2=2)
    deviation: Array = np.where(
        count >= MIN_LINES, 1.0 / np.sqrt(np.maximum(smallest, np.maximum(floor, 1e-300))), np.inf
    )
    return deviation


def _regular(matrices: Array) -> Array:
    size = _TINY * np.trace(matrices, axis1=1, axis2=2) + 1e-300
    regular: Array = size[:, np.newaxis, np.newaxis] * np.eye(3)
    return regular


def _map_covariance(lines: LineSet, rotation: Array, position: Array, of_moment: Array) -> Array:
    """Return the covariance of (phi, rho) by the tolerances of the lines, shape (k, n, 2, 2)."""
    u = lines.direction @ rotation
    offset = (lines.pivot - position[:, np.newaxis]) @ rotation
    across = np.eye(3) - u[..., :, np.newaxis] * u[..., np.newaxis, :]
    x, y, z = np.moveaxis(offset, -1, 0)
    zero = np.zeros_like(x)
    skew = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*offset.shape, 3)
    variance = lines.position_std[:, np.newaxis, np.newaxis] ** 2 * across
    variance = variance + lines.direction_std[:, np.newaxis, np.newaxis] ** 2 * skew @ across @ np.swapaxes(
        skew, -1, -2
    )
    covariance: Array = of_moment @ variance @ np.swapaxes(of_moment, -1, -2)
    return covariance


def _in_view(image: Array, ends: Array | None, rotation: Array, position: Array, max_angle: float) -> BoolArray:
    if ends is None:
        # The angle between the optical axis and the plane of camera centre and line.
        angle = np.arcsin(np.abs(image[..., 2]) / np.sqrt(1.0 + image[..., 2] ** 2))
        lines_in_view: BoolArray = angle <= max_angle
        return lines_in_view
    share = np.linspace(0.0, 1.0, _SAMPLES)[:, np.newaxis]
    points = (1.0 - share) * ends[:, np.newaxis, 0] + share * ends[:, np.newaxis, 1]
    seen = (points - position[:, np.newaxis, np.newaxis]) @ rotation[:, np.newaxis]
    inside = np.arctan2(np.hypot(seen[..., 0], seen[..., 1]), seen[..., 2]) <= max_angle
    in_view: BoolArray = inside.sum(axis=-1) >= _IN_VIEW
    return in_view
