# SPDX-License-Identifier: Apache-2.0
"""The laws that know where the camera is: by its pose alone, and by pose and image with their covariances."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.errors import GeometryError, ObservationError
from plsing_ros.features import image_depth, interaction_matrix, project_lines
from plsing_ros.features.projection import have_images
from plsing_ros.features.target import Target
from plsing_ros.geometry import LineSet, Pose, align_lines
from plsing_ros.geometry.rotations import exponential, rotation_vector

# A share of each frame in what is known of the errors: twenty frames or so are remembered.
_MEMORY = 0.05
# Image lines that differ less from those of their 3-D lines were computed from them.
_EXACT = 1e-9
# By which share of a change of the image it may be wrong where map and focal length are.
_CHANGES = 0.05
# A pose is doubted when the image explains more than this times what its covariance allows.
_DOUBTFUL = 2.0
# More at first, for chance averages out with the root of the frames: less than one in a million is more than this.
_AT_FIRST = 4.0
# What is left of a doubt after a frame that shows nothing of it: hundreds of frames until a pose is trusted again.
_TRUST_AGAIN = 0.002
_NO_DOUBT = 0.05
# The variances of a doubted pose are so many times those that the image shows along what it sees: what it does not see
# may be farther off.
_FEAR = 24.0
# Degrees of freedom of a pose.
_OF_A_POSE = 6.0
# What is said of lasting errors of the image counts as much as so many degrees of freedom that the image shows.
_SAID = 1.0
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
        # What was seen lately, over what is said: of the image's errors, and of the pose's.
        self._noise, self._explained, self._frames = 1.0, 1.0, 0
        # The same of lasting errors of the image, which may be smaller than is said.
        self._calibration = 1.0
        # By how much the pose is doubted, which is not forgotten where the image shows less of it.
        self._doubt = 0.0

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
        covariance is doubted: P grows, and motions that only such a pose asks for are not made.

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

        Source: new, docs/laws.md.
        """
        P, told = pose.covariance, self.by_pose(lines, pose.covariance)
        if self._computed and not pose.independent:
            # A filter has weighed the image already, and so has the map from which the target is.
            return told
        own = np.broadcast_to(own, (len(lines), 3))
        lasting = self._lasting(lines, image, own, map_std)
        shown = 0.0 if self._computed else 1.0
        J, r = self._seen_error(lines, image)
        doubt = self._update(_whitened(J, own + lasting), _whitened(r[:, np.newaxis], own + lasting)[:, 0], P, shown)
        weights = averaged * own + lasting * self._noise
        believed = ((averaged if pose.independent else 1.0) + shown) * P
        if doubt == 0.0:
            information, pull = _information(J, r, weights)
            information = information + np.linalg.inv(believed)
            delta = np.asarray(np.linalg.solve(information, pull), dtype=float)
            return Displacement(_composed(told.twist, delta), lambda: _propagated(J, weights, information, own, P))
        feared = believed + doubt * (1.0 + shown) * P
        # Where the pose is not to be relied on, the image is taken as good as it shows itself.
        weights = averaged * own + lasting * self._calibration
        twist = self._doubted(lines, image, told.twist, weights, believed, feared)
        return Displacement(
            twist, lambda: _propagated(J, weights, _information(J, r, weights)[0] + np.linalg.inv(feared), own, feared)
        )

    def _doubted(
        self, lines: LineSet, image: Array, told: Array, weights: Array, believed: Array, feared: Array
    ) -> Array:
        """Return the twist of the displacement with a pose that may be far off, as far as it is sure.

        Args:
            lines, image: As for by_pose_and_image.
            told: By the pose, shape (6,).
            weights: Covariances of image lines that matter.
            believed: Of the pose, as it says.
            feared: Of the pose, as the image says.
        """
        delta: Array = np.zeros(6)
        there, known = lines, np.linalg.inv(feared)
        for _ in range(_STEPS):
            J, r = self._seen_error(there, image)
            normal, pull = _information(J, r + J @ delta, weights)
            delta = np.asarray(np.linalg.solve(normal + known, pull), dtype=float)
            moved = lines.transformed(Pose(exponential(delta[3:])[0], _shift(delta)).inverse(), lines.frame)
            if not have_images(moved):
                break
            there = moved
        covariance = np.linalg.inv(normal + known)
        twist = _composed(told, delta)
        # What the doubt adds is what must not be gone by.
        doubtful, axes = np.linalg.eigh(covariance - np.linalg.inv(normal + np.linalg.inv(believed)))
        along = axes.T @ twist
        share = 1.0 - np.minimum(_DEVIATIONS**2 * np.maximum(doubtful, 0.0) / np.maximum(along**2, 1e-30), 1.0)
        return np.asarray(axes @ (share * along), dtype=float)

    def _seen_error(self, lines: LineSet, image: Array) -> tuple[Array, Array]:
        """Return J, shape (2n, 6), and r, shape (2n,)."""
        return polar(interaction_matrix(lines), project_lines(lines)), mismatch(image, lines) - self._taught

    def _lasting(self, lines: LineSet, image: Array, own: Array, map_std: float) -> Array:
        """Return the covariances of errors of image lines that are the same in all frames, shape (n, 3)."""
        if self._computed:
            lasting: Array = np.square(map_std / image_depth(lines))[:, np.newaxis] * (1.0, 0.0, 1.0)
            return lasting
        # What map and focal length do at the target cancels, and what they do elsewhere grows with the way there.
        changed = np.square(_CHANGES * compare_image_lines(image, self._image_there)).reshape(-1, 2).sum(axis=1)
        of_calibration: Array = changed[:, np.newaxis] * (1.0, 0.0, 1.0)
        return of_calibration + (own if self._shown is None else self._shown)

    def _update(self, J: Array, r: Array, pose: Array, shown: float) -> float:
        """Learn from whitened J and r how large the errors are, and return by how much the pose is doubted.

        What the best pose leaves of r speaks against the image, what a pose explains beyond its covariance against it.
        """
        normal, right, square = J.T @ J, J.T @ r, float(r @ r)
        known = np.linalg.inv((1.0 + shown) * pose)
        left = square - float(right @ np.linalg.solve(normal + 1e-6 * known, right))
        explained = square - float(right @ np.linalg.solve(normal + known, right)) - left
        seen = left / max(len(r) - _OF_A_POSE, 1.0)
        self._noise = max(1.0, self._noise + _MEMORY * (seen - self._noise))
        self._frames += 1
        # The mean of the first frames, then of the latest.
        share = max(_MEMORY, 1.0 / self._frames)
        self._calibration += share * ((_SAID + left) / (_SAID + max(len(r) - _OF_A_POSE, 0.0)) - self._calibration)
        self._explained += share * (explained / (_OF_A_POSE * self._noise) - self._explained)
        excess = self._explained - _DOUBTFUL - _AT_FIRST / math.sqrt(self._frames)
        self._doubt = max(0.0, excess, self._doubt * (1.0 - _TRUST_AGAIN))
        return _FEAR * self._doubt if self._doubt > _NO_DOUBT else 0.0

    def _look_at(self, ids: tuple[int, ...]) -> None:
        if ids == self._ids:
            return
        row_of = {i: row for row, i in enumerate(self._target.ids)}
        rows = [row_of[i] for i in ids]
        self._ids, self._seen_there = ids, self._lines.select(rows)
        image = self._target.observation.usable_image_lines[rows].ravel()
        self._taught = mismatch(image, self._seen_there)
        self._computed = bool(np.abs(self._taught).max() < _EXACT)
        self._image_there = image
        known = self._target.observation.usable_covariances
        self._shown = None if known is None else known[rows]


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


def _whitened(rows: Array, covariances: Array) -> Array:
    """Return rows of angles and offsets, shape (2n, k), divided by Cholesky's root of their covariances (n, 3)."""
    first = np.sqrt(covariances[:, :1])
    mixed = covariances[:, 1:2] / first
    second = np.sqrt(np.maximum(covariances[:, 2:] - np.square(mixed), 1e-24))
    angle = rows[0::2] / first
    return np.stack([angle, (rows[1::2] - mixed * angle) / second], axis=1).reshape(rows.shape)


def _information(J: Array, r: Array, covariances: Array) -> tuple[Array, Array]:
    """Return J^T R^-1 J and J^T R^-1 r."""
    J, r = _whitened(J, covariances), _whitened(r[:, np.newaxis], covariances)[:, 0]
    return J.T @ J, J.T @ r


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


def _shift(twist: Array) -> Array:
    """Return the translation of exp(twist), shape (3,)."""
    shift: Array = exponential(twist[3:])[1] @ twist[:3]
    return shift


def _composed(first: Array, second: Array) -> Array:
    """Return the displacement of two after each other: the second is seen from where the first has led."""
    rotation, turned = exponential(first[3:])[0], exponential(second[3:])[0]
    # The shift of the first is in the frame that it leads to.
    shift = turned.T @ (first[:3] + _shift(second))
    return np.concatenate([shift, rotation_vector(rotation @ turned)])
