# SPDX-License-Identifier: Apache-2.0
"""What a pose is off by, image after image, as the object is not quite its model."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array, cross, minus_skew

# Of what an estimate knows from former images, this share is as if it were of this one: they had the same errors.
_SAME = 0.98


def model_covariance(ends: Array, lines: Array, weights: Array, information: Array, prior: Array, std: Array) -> Array:
    """Return the covariance of a motion (v, omega) of the model in the camera frame, by what its edges are off by.

    A line that lies beside its place moves the pose by the gain of the least squares. As the error lasts, it does not
    average out over images: the gain is that of the lines of one image.

    Args:
        ends: Of each edge, in the camera frame, shape (k, 2, 3) [m].
        lines: phi, rho, and the variances and covariance of both, of its line in the image: var phi, cov, var rho,
            shape (k, 5).
        weights: Of the lines in the fit, shape (k,).
        information: Of the fit, shape (6, 6).
        prior: The part of it that is from former images, shape (6, 6).
        std: Of each edge: of its middle across it [m], and of its direction [rad], shape (k, 2).

    Source: new; the covariance of a weighted least squares estimate whose weights are not those of the errors.
    """
    a, b = ends[:, 0], ends[:, 1]
    direction, middle, moment = b - a, 0.5 * (a + b), cross(a, b)
    square = (moment[:, :2] ** 2).sum(axis=1)
    depth, zero = np.sqrt(square), np.zeros(len(a))
    by_moment = np.stack(
        [
            np.column_stack([-moment[:, 1] / square, moment[:, 0] / square, zero]),
            np.column_stack([-moment[:, :2] * moment[:, 2:] / (square * depth)[:, np.newaxis], 1.0 / depth]),
        ],
        axis=1,
    )
    jacobian = by_moment @ np.concatenate([minus_skew(direction), minus_skew(moment)], axis=2)
    length = (direction * direction).sum(axis=1)[:, np.newaxis, np.newaxis]
    across = length * np.eye(3) - direction[:, :, np.newaxis] * direction[:, np.newaxis]
    lever = minus_skew(middle)
    of_moment = (std[:, 0, np.newaxis, np.newaxis] ** 2) * across + (std[:, 1, np.newaxis, np.newaxis] ** 2) * (
        lever @ across @ lever.transpose(0, 2, 1)
    )
    of_line = by_moment @ of_moment @ by_moment.transpose(0, 2, 1)
    covariances = lines[:, [2, 3, 3, 4]].reshape(-1, 2, 2)
    gain = weights[:, np.newaxis, np.newaxis] * jacobian.transpose(0, 2, 1) @ np.linalg.inv(covariances)
    scatter = (gain @ of_line @ gain.transpose(0, 2, 1)).sum(axis=0)
    least = 1e-9 * float(np.trace(information)) * np.eye(6)
    inverse = np.linalg.inv(information - _SAME * prior + least)
    result: Array = inverse @ scatter @ inverse
    return result
