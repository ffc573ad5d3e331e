# SPDX-License-Identifier: Apache-2.0
"""The laws that know where the camera is: by its pose alone, and by pose and image with their covariances."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.control.departure import Departure
from plsing_ros.control.displacement import composed
from plsing_ros.control.image_mismatch import ImageMismatch, compare_image_lines, mismatch, whitened
from plsing_ros.control.pose_doubt import PoseDoubt
from plsing_ros.errors import GeometryError, ObservationError
from plsing_ros.features import image_depth
from plsing_ros.features.target import Target
from plsing_ros.geometry import LineSet, align_lines
from plsing_ros.geometry.rotations import rotation_vector

# Image lines that differ less from those of their 3-D lines were computed from them.
_EXACT = 1e-9
# By which share of a change of the image it may be wrong where map and focal length are.
_CHANGES = 0.05
# The variances of a doubted pose are so many times those that the image shows along what it sees: what it does not see
# may be farther off.
_FEAR = 24.0
# Steps to where a doubted pose is corrected to: the first is only right for a small correction.
_STEPS = 3
# A displacement of fewer standard deviations of what is doubtful is not gone.
_DEVIATIONS = 2.0


class Displacement(NamedTuple):
    """Where the camera is, seen from the target.

    Attributes:
        twist: That leads from the target to the camera in unit time, straight and about one axis, in the camera frame,
            shape (6,) [m, rad].
        covariance: Returns the covariance of it by the errors of one frame, shape (6, 6).
    """

    twist: Array
    covariance: Callable[[], Array]


class PoseErrors(NamedTuple):
    """How far the pose that 3-D lines stand for may be off.

    Attributes:
        covariance: In one frame, in the camera's axes, shape (6, 6).
        independent: Whether the errors of one frame are independent of the next one's; those of a filter are not.
        of_image: Whether the pose is that which the image of the same frame shows, and no more.
    """

    covariance: Array
    independent: bool
    of_image: bool = False


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
                "desired_line_features, or a target pose"
            )
        self._target, self._lines = target, target.lines
        # Of the lines seen last, which seldom change.
        self._ids: tuple[int, ...] = ()
        self._seen_there = target.lines
        self._taught: Array = np.zeros(0)
        self._computed = False
        self._image_there: Array = np.zeros(0)
        self._shown: Array | None = None
        self._doubt, self._departure = PoseDoubt(), Departure()

    def pause(self) -> None:
        """Take note that the camera was told to stand still in this cycle."""
        self._departure.pause()

    def by_pose(self, lines: LineSet, covariance: Array) -> Displacement:
        """Return the displacement by 3-D lines alone.

        Args:
            lines: In the camera's optical frame, all of them in the target.
            covariance: Of the camera pose they stand for, shape (6, 6).

        Raises:
            ObservationError: If they do not fix a pose.

        Source: position-based control; the rotation is Kabsch's, docs/pose_laws.md.
        """
        self._look_at(lines.ids)
        try:
            T_target_camera = align_lines(self._seen_there, lines).T_world_camera
        except GeometryError as error:
            raise ObservationError(f"where the camera is relative to the target is not known: {error}") from None
        rotation = T_target_camera.rotation
        twist = np.concatenate([rotation.T @ T_target_camera.translation, rotation_vector(rotation)])
        return Displacement(twist, lambda: covariance)

    def by_pose_and_image(
        self, lines: LineSet, image: Array, pose: PoseErrors, own: Array, map_std: float, averaged: float
    ) -> Displacement:
        """Return the displacement by 3-D lines and image, each weighted by its covariance.

        The image's word is r, what it shows beyond the 3-D lines' own image, less what it showed so at the target:
        there errors of map and focal length are the same, and a target that was shown is reached by the image. The
        camera is at exp(delta) of where the 3-D lines put it, with

            delta = argmin |r - J delta|^2 / R + |delta|^2 / P.

        The errors of one frame are averaged by the camera's motion, those of the map and of the frame that showed the
        target are not: R and P are the sums of what is left of either. A pose that the image contradicts beyond its
        covariance, or that led the camera farther away than where it began, is doubted: P grows, and motions that only
        such a pose asks for are not made.

        Args:
            lines: As for by_pose.
            image: Image lines, shape (3n,).
            pose: Errors of the pose that the 3-D lines stand for.
            own: Covariances in one frame of angle [rad] and offset of each image line: (angle angle, angle offset,
                offset offset), shape (n, 3) or (3,).
            map_std: Of a line in the map [m]; for a target that was not shown but computed from the map.
            averaged: What the motion leaves of the variance of errors that are independent from frame to frame, in
                (0, 1].

        Raises:
            ObservationError: As by_pose.

        Source: new, docs/pose_laws.md.
        """
        P, told = pose.covariance, self.by_pose(lines, pose.covariance)
        if self._computed and not pose.independent:
            # A filter has weighed the image already, and so has the map from which the target is.
            return told
        own = np.broadcast_to(own, (len(lines), 3))
        lasting = self._lasting(lines, image, own, map_std)
        shown = 0.0 if self._computed else 1.0
        seen, may_explain = ImageMismatch(lines, image, self._taught), (1.0 + shown) * P
        J, r = seen.J, seen.r
        doubt = self._doubt.update(whitened(seen.rows, own + lasting), may_explain)
        led_away = self._departure.update(seen, own, lasting, may_explain, told.twist)
        believed = ((averaged if pose.independent else 1.0) + shown) * P
        if max(doubt, led_away) == 0.0:
            weights = averaged * own + lasting * self._doubt.noise
            information, pull = _information(J, r, weights)
            information = information + np.linalg.inv(believed)
            delta = np.asarray(np.linalg.solve(information, pull), dtype=float)
            return Displacement(composed(told.twist, delta), lambda: _propagated(J, weights, information, own, P))
        feared = believed + _FEAR * max(doubt, led_away) * may_explain
        # Where the pose is not to be relied on, the image is taken as good as it shows itself.
        weights = averaged * own + lasting * self._doubt.calibration
        if led_away:
            weights = (averaged * own + lasting) * self._departure.scale
        twist = _doubted(seen, told.twist, weights, believed, feared)
        return Displacement(
            twist, lambda: _propagated(J, weights, _information(J, r, weights)[0] + np.linalg.inv(feared), own, feared)
        )

    def _lasting(self, lines: LineSet, image: Array, own: Array, map_std: float) -> Array:
        """Return the covariances of errors of image lines that are the same in all frames, shape (n, 3)."""
        if self._computed:
            lasting: Array = np.square(map_std / image_depth(lines))[:, np.newaxis] * (1.0, 0.0, 1.0)
            return lasting
        # What map and focal length do at the target cancels, and what they do elsewhere grows with the way there.
        changed = np.square(_CHANGES * compare_image_lines(image, self._image_there)).reshape(-1, 2).sum(axis=1)
        of_calibration: Array = changed[:, np.newaxis] * (1.0, 0.0, 1.0)
        return of_calibration + (own if self._shown is None else self._shown)

    def _look_at(self, ids: tuple[int, ...]) -> None:
        if ids == self._ids:
            return
        row_of = {i: row for row, i in enumerate(self._target.ids)}
        rows = [row_of[i] for i in ids]
        self._departure.change_lines()
        self._ids, self._seen_there = ids, self._lines.select(rows)
        image = self._target.observation.usable_image_lines[rows].ravel()
        self._taught = mismatch(image, self._seen_there)
        self._computed = bool(np.abs(self._taught).max() < _EXACT)
        self._image_there = image
        known = self._target.observation.usable_covariances
        self._shown = None if known is None else known[rows]


def _doubted(seen: ImageMismatch, told: Array, weights: Array, believed: Array, feared: Array) -> Array:
    """Return the twist of the displacement with a pose that may be far off, as far as it is sure.

    Args:
        seen: The mismatch of the frame.
        told: By the pose, shape (6,).
        weights: Covariances of image lines that matter.
        believed: Of the pose, as it says.
        feared: Of the pose, as the image says.
    """
    delta: Array = np.zeros(6)
    there: ImageMismatch | None = seen
    for _ in range(_STEPS):
        if there is None:
            break
        normal, pull = _information(there.J, there.r + there.J @ delta, weights)
        covariance = np.linalg.inv(normal + np.linalg.inv(feared))
        delta = covariance @ pull
        there = seen.seen_from(delta)
    twist = composed(told, delta)
    # What the doubt adds is what must not be gone by.
    doubtful, axes = np.linalg.eigh(covariance - np.linalg.inv(normal + np.linalg.inv(believed)))
    along = axes.T @ twist
    share = 1.0 - np.minimum(_DEVIATIONS**2 * np.maximum(doubtful, 0.0) / np.maximum(along**2, 1e-30), 1.0)
    return np.asarray(axes @ (share * along), dtype=float)


def _information(J: Array, r: Array, covariances: Array) -> tuple[Array, Array]:
    """Return J^T R^-1 J and J^T R^-1 r."""
    rows = whitened(np.column_stack([J, r]), covariances)
    return rows[:, :6].T @ rows[:, :6], rows[:, :6].T @ rows[:, 6]


def _propagated(J: Array, weights: Array, information: Array, own: Array, pose: Array) -> Array:
    """Return the covariance of delta and pose together, by the errors of one frame.

    Args:
        J: Shape (2n, 6).
        weights: Covariances of image lines that the weighing took, shape (n, 3).
        information: J^T weights^-1 J + what it took for the pose, shape (6, 6).
        own, pose: Covariances of image lines (n, 3) and pose (6, 6) in one frame.
    """
    n = len(weights)
    # K = information^-1 J^T weights^-1, two columns a line.
    root = np.linalg.cholesky(_matrices(own))
    pulled = np.linalg.solve(_matrices(weights), J.reshape(n, 2, 6))
    by_image = np.linalg.solve(information, np.einsum("nai,nab->inb", pulled, root).reshape(6, -1))
    left = np.eye(6) - np.linalg.solve(information, np.einsum("nai,naj->ij", pulled, J.reshape(n, 2, 6)))
    covariance: Array = by_image @ by_image.T + left @ pose @ left.T
    return covariance


def _matrices(covariances: Array) -> Array:
    """Return covariances of angle and offset, (n, 3), as matrices (n, 2, 2)."""
    return covariances[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
