"""Damped, weighted refinement of camera poses on the image lines, for many start poses at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array, BoolArray
from plsing_ros.pose.residuals import ImageResiduals, Residuals, whitened
from plsing_ros.pose.rotations import rotations_near

_FIRST_DAMPING = 1e-6
_MOST_DAMPING = 1e10
# A step that promises to lower the sum of squared residuals, in standard deviations, by less than this share is the
# last: Newton's steps then leave the square of it.
_SMALLEST_GAIN = 1e-4
_LONGEST_TURN = 0.5  # [rad]
_DIAGONAL = np.arange(6)


@dataclass(frozen=True, eq=False)
class Refined:
    """Poses T_camera_world at, or on their way to, a minimum of the misfit.

    Attributes:
        rotation: Shape (k, 3, 3).
        translation: Shape (k, 3) [m].
        residuals: At these poses.
        gain: By how much the last step would have lowered the sum of squared residuals had they been linear (k,).
        final: Which are at a minimum, (k,).
    """

    rotation: Array
    translation: Array
    residuals: Residuals
    gain: Array
    final: BoolArray


def refine(
    image: ImageResiduals, rotation: Array, translation: Array, iterations: int, weight: Array | None = None
) -> Refined:
    """Return poses after Levenberg-Marquardt steps: virtual visual servoing with a step that cannot diverge.

    Args:
        image: The residuals.
        rotation: Of T_camera_world, shape (k, 3, 3).
        translation: Shape (k, 3) [m].
        iterations: At most so many steps.
        weight: Of each line for each pose, 0 or 1, shape (k, n); None for 1.

    Source: the undamped, unweighted step is Marchand and Chaumette's virtual visual servoing (section "Pose Estimation
    along a quadrifolium trajectory"); the damping is Levenberg's and Marquardt's.
    """
    k = len(rotation)
    damping: Array = np.full(k, _FIRST_DAMPING)
    now = image.at(rotation, translation)
    was = _misfit(now.value, weight)
    gain, final = np.full(k, np.inf), np.zeros(k, dtype=bool)
    for _ in range(iterations):
        value, jacobian = now.value, now.jacobian
        if weight is not None:
            value, jacobian = value * weight[:, np.newaxis], jacobian * weight[:, np.newaxis, np.newaxis]
        jacobian = jacobian.reshape(k, 6, -1)
        normal = jacobian @ jacobian.transpose(0, 2, 1)
        slope = (jacobian @ value.reshape(k, -1, 1))[..., 0]
        diagonal = normal[:, _DIAGONAL, _DIAGONAL]
        normal[:, _DIAGONAL, _DIAGONAL] = diagonal * (1.0 + damping)[:, np.newaxis] + 1e-300
        step = _solved(normal, -slope)
        gain = -np.einsum("ki,ki->k", slope, step)
        final = (gain <= _SMALLEST_GAIN * (1.0 + was)) | (damping > _MOST_DAMPING)
        turn = np.sqrt(np.einsum("ki,ki->k", step[:, 3:], step[:, 3:]))
        step *= np.minimum(1.0, _LONGEST_TURN / np.maximum(turn, _LONGEST_TURN))[:, np.newaxis]
        # The camera moves by the step, so the scene moves by its inverse in the camera's frame.
        back = rotations_near(-step[:, 3:])
        new_rotation = back @ rotation
        new_translation = (back @ (translation - step[:, :3])[..., np.newaxis])[..., 0]
        new = image.at(new_rotation, new_translation)
        # Both by the same measure, as far poses would win by their larger covariance.
        same_measure = whitened(new.raw, now.whitening)
        better = _misfit(same_measure, weight) <= was
        if better.all():
            rotation, translation, now = new_rotation, new_translation, new
            damping *= 0.1
        else:
            rotation = np.where(better[:, np.newaxis, np.newaxis], new_rotation, rotation)
            translation = np.where(better[:, np.newaxis], new_translation, translation)
            damping = np.where(better, 0.1 * damping, np.maximum(100.0 * damping, 1e-4))
            now = image.at(rotation, translation)
        was = _misfit(now.value, weight)
        if final.all():
            break
    return Refined(rotation, translation, now, gain, final)


def _misfit(value: Array, weight: Array | None) -> Array:
    if weight is None:
        return np.asarray(np.einsum("kin,kin->k", value, value))
    return np.asarray(np.einsum("kin,kin,kn->k", value, value, weight))


def _solved(matrix: Array, right: Array) -> Array:
    """Return the solutions (k, 6) of k systems; zero for one that is singular to the last bit."""
    try:
        return np.asarray(np.linalg.solve(matrix, right[..., np.newaxis])[..., 0])
    except np.linalg.LinAlgError:
        return np.asarray((np.linalg.pinv(matrix) @ right[..., np.newaxis])[..., 0])
