# SPDX-License-Identifier: Apache-2.0
"""The laws that know where the camera is: by its pose alone, and by pose and image with their covariances."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.errors import GeometryError, ObservationError
from plsing_ros.features import image_depth, interaction_matrix, project_lines
from plsing_ros.features.target import Target
from plsing_ros.geometry import LineSet, align_lines
from plsing_ros.geometry.rotations import exponential, rotation_vector

# A share of each frame in what is known of the errors: ten frames or so are remembered.
_MEMORY = 0.1
# Image lines that differ less from those of their 3-D lines were computed from them.
_EXACT = 1e-9


class Displacement(NamedTuple):
    """Where the camera is, seen from the target.

    Attributes:
        twist: That leads from the target to the camera in unit time, straight and about one axis, in the camera frame,
            shape (6,) [m, rad].
        covariance: Of it, shape (6, 6).
    """

    twist: Array
    covariance: Array


class PoseLaws:
    """Displacements from one target, as the laws position and fused see them."""

    def __init__(self, target: Target) -> None:
        """Begin with a target.

        Raises:
            ObservationError: If it has no 3-D lines.
        """
        if target.lines is None:
            raise ObservationError(
                "the laws position and fused need the target's 3-D lines: directions and moments of "
                "desired_line_features, or target.source = pose"
            )
        self._target, self._lines = target, target.lines
        # Of the lines seen last, which seldom change.
        self._ids: tuple[int, ...] = ()
        self._seen_there = target.lines
        self._taught: Array = np.zeros(0)
        self._computed = False
        # What was seen lately, over what is said: of the image's errors, and of the pose's.
        self._noise = self._doubt = 1.0

    def by_pose(self, lines: LineSet, covariance: Array) -> Displacement:
        """Return the displacement by 3-D lines alone.

        Args:
            lines: In the camera's optical frame, all of them in the target.
            covariance: Of the camera pose they stand for, shape (6, 6).

        Raises:
            ObservationError: If they do not fix a pose.

        Source: position-based control; the rotation is Kabsch's, docs/laws.md.
        """
        self._look_at(lines.ids)
        try:
            T_target_camera = align_lines(self._seen_there, lines).T_world_camera
        except GeometryError as error:
            raise ObservationError(f"where the camera is relative to the target is not known: {error}") from None
        rotation = T_target_camera.rotation
        twist = np.concatenate([rotation.T @ T_target_camera.translation, rotation_vector(rotation)])
        return Displacement(twist, covariance)

    def by_pose_and_image(
        self, lines: LineSet, image: Array, covariance: Array, image_covariances: Array, map_std: float
    ) -> Displacement:
        """Return the displacement by 3-D lines and image, each weighted by its covariance.

        The image's word is r, what it shows beyond the 3-D lines' own image, less what it showed so at the target:
        there errors of map and focal length are the same, and a target that was shown is reached by the image. The
        camera is at exp(delta) of where the 3-D lines put it, with

            delta = argmin |r - J delta|^2 / R + |delta|^2 / P.

        R and P grow to what was seen lately where r contradicts them: what the best pose leaves of r speaks against R,
        what a pose explains beyond P against P. A target that was not shown but computed from the map has none of its
        errors: there R holds the map's, too.

        Args:
            lines: As for by_pose.
            image: Image lines, shape (3n,).
            covariance: Of the pose, P, shape (6, 6).
            image_covariances: Of angle [rad] and offset of each image line: (angle angle, angle offset, offset offset),
                shape (n, 3) or (3,).
            map_std: Of a line in the map [m].

        Raises:
            ObservationError: As by_pose.

        Source: new, docs/laws.md.
        """
        pose = self.by_pose(lines, covariance)
        there = project_lines(lines)
        J, r = polar(interaction_matrix(lines), there), mismatch(image, lines) - self._taught
        own = np.broadcast_to(image_covariances, (len(lines), 3))
        if self._computed:
            own = own + np.square(map_std / image_depth(lines))[:, np.newaxis] * (1.0, 0.0, 1.0)
        J, r = _whitened(J, own), _whitened(r[:, np.newaxis], own)[:, 0]
        normal, right, square = J.T @ J, J.T @ r, float(r @ r)
        known = np.linalg.inv(covariance)
        left = square - float(right @ np.linalg.solve(normal + 1e-6 * known, right))
        explained = square - float(right @ np.linalg.solve(normal + known, right)) - left
        self._noise += _MEMORY * (left / max(len(r) - 6, 1) - self._noise)
        noise = max(1.0, self._noise)
        # Six degrees of freedom are the pose's.
        self._doubt += _MEMORY * (explained / (6.0 * noise) - self._doubt)
        known = known / max(1.0, self._doubt)
        information = normal / noise + known
        delta = np.asarray(np.linalg.solve(information, right / noise), dtype=float)
        return Displacement(_composed(pose.twist, delta), np.linalg.inv(information))

    def _look_at(self, ids: tuple[int, ...]) -> None:
        if ids == self._ids:
            return
        row_of = {i: row for row, i in enumerate(self._target.ids)}
        rows = [row_of[i] for i in ids]
        self._ids, self._seen_there = ids, self._lines.select(rows)
        image = self._target.observation.usable_image_lines[rows].ravel()
        self._taught = mismatch(image, self._seen_there)
        self._computed = bool(np.abs(self._taught).max() < _EXACT)


def mismatch(image: Array, lines: LineSet) -> Array:
    """Return by which angles and offsets image lines differ from those of 3-D lines, shape (2n,).

    Args:
        image: Shape (3n,).
        lines: In the camera frame.
    """
    (x, y, z), (x0, y0, z0) = image.reshape(-1, 3).T, project_lines(lines).reshape(-1, 3).T
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


def _whitened(rows: Array, covariances: Array) -> Array:
    """Return rows of angles and offsets, shape (2n, k), divided by Cholesky's root of their covariances (n, 3)."""
    first = np.sqrt(covariances[:, :1])
    mixed = covariances[:, 1:2] / first
    second = np.sqrt(np.maximum(covariances[:, 2:] - np.square(mixed), 1e-24))
    angle = rows[0::2] / first
    return np.stack([angle, (rows[1::2] - mixed * angle) / second], axis=1).reshape(rows.shape)


def _composed(first: Array, second: Array) -> Array:
    """Return the displacement of two after each other: the second is seen from where the first has led."""
    rotation, turned = exponential(first[3:])[0], exponential(second[3:])
    # The shift of the first is in the frame that it leads to.
    shift = turned[0].T @ (first[:3] + turned[1] @ second[:3])
    return np.concatenate([shift, rotation_vector(rotation @ turned[0])])
