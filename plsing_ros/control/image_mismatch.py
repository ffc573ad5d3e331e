# SPDX-License-Identifier: Apache-2.0
"""By which angles and offsets image lines differ from others, and what 3-D lines at a wrong pose have to do with it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.control.displacement import moved_lines
from plsing_ros.features import interaction_matrix, project_lines
from plsing_ros.features.projection import have_images
from plsing_ros.geometry import LineSet


class ImageMismatch:
    """What the image shows beyond the image of 3-D lines, less what it showed so at the target.

    It is computed when it is asked for: what several frames show together is only seen from elsewhere.
    """

    def __init__(self, lines: LineSet, image: Array, taught: Array) -> None:
        """Compare.

        Args:
            lines: In the camera's optical frame.
            image: Image lines, shape (3n,).
            taught: The mismatch at the target, shape (2n,).
        """
        self._lines, self._image, self._taught = lines, image, taught

    @cached_property
    def r(self) -> Array:
        """Angle and offset of each line, shape (2n,)."""
        return compare_image_lines(self._image, self._projected) - self._taught

    @cached_property
    def J(self) -> Array:
        """The derivative of r by a motion of the camera, shape (2n, 6)."""
        return polar(interaction_matrix(self._lines), self._projected)

    @cached_property
    def _projected(self) -> Array:
        return project_lines(self._lines)

    @classmethod
    def together(cls, frames: Sequence[ImageMismatch]) -> ImageMismatch:
        """Return the mismatch of several frames as if all their lines were in one, frame after frame."""
        lines = LineSet(
            np.concatenate([each._lines.direction for each in frames]),
            np.concatenate([each._lines.moment for each in frames]),
            frames[0]._lines.frame,
        )
        image, taught = (np.concatenate(parts) for parts in zip(*((e._image, e._taught) for e in frames), strict=True))
        return cls(lines, image, taught)

    @property
    def rows(self) -> Array:
        """J and r side by side, shape (2n, 7)."""
        return np.column_stack([self.J, self.r])

    def seen_from(self, twist: Array) -> ImageMismatch | None:
        """Return the mismatch if the camera were where a twist leads in unit time; None if a line has no image there.

        Args:
            twist: In the camera frame, shape (6,).
        """
        moved = moved_lines(self._lines, twist)
        return ImageMismatch(moved, self._image, self._taught) if have_images(moved) else None


def mismatch(image: Array, lines: LineSet) -> Array:
    """Return by which angles and offsets image lines differ from those of 3-D lines, shape (2n,).

    Args:
        image: Shape (3n,).
        lines: In the camera frame.
    """
    return compare_image_lines(image, project_lines(lines))


def compare_image_lines(image: Array, other: Array) -> Array:
    """Return by which angles and offsets image lines differ from others, both of shape (3n,); shape (2n,)."""
    (x, y, z), (x0, y0, z0) = image.reshape(-1, 3).T, other.reshape(-1, 3).T
    return np.stack([np.arctan2(x0 * y - y0 * x, x0 * x + y0 * y), z - z0], axis=-1).ravel()


def polar(interaction: Array, image: Array) -> Array:
    """Return the rows of L for angle and offset of each image line, shape (2n, 6), from those of its coordinates.

    Args:
        interaction: Shape (3n, 6).
        image: Shape (3n,).
    """
    rows, (x, y, _) = interaction.reshape(-1, 3, 6), image.reshape(-1, 3).T
    turning = x[:, np.newaxis] * rows[:, 1] - y[:, np.newaxis] * rows[:, 0]
    return np.stack([turning, rows[:, 2]], axis=1).reshape(-1, 6)


def covariances_by_motion(J: Array, motion: Array) -> Array:
    """Return what errors of a motion do to each image line, as covariances (angle angle, angle offset, offset offset).

    Args:
        J: Derivatives of angles and offsets, shape (2n, 6).
        motion: Covariance of the motion, shape (6, 6).

    Returns:
        Shape (n, 3).
    """
    angle, offset = J[0::2], J[1::2]
    of_angle, of_offset = angle @ motion, offset @ motion
    return np.stack(
        [(of_angle * angle).sum(axis=1), (of_angle * offset).sum(axis=1), (of_offset * offset).sum(axis=1)], axis=1
    )


def whitened(rows: Array, covariances: Array) -> Array:
    """Return rows of angles and offsets divided by Cholesky's root of their covariances.

    Args:
        rows: Shape (2n,) or (2n, k).
        covariances: (angle angle, angle offset, offset offset) of each line, shape (n, 3).
    """
    table = rows.reshape(len(rows), -1)
    first = np.sqrt(covariances[:, :1])
    mixed = covariances[:, 1:2] / first
    second = np.sqrt(np.maximum(covariances[:, 2:] - np.square(mixed), 1e-24))
    angle = table[0::2] / first
    return np.stack([angle, (table[1::2] - mixed * angle) / second], axis=1).reshape(rows.shape)
