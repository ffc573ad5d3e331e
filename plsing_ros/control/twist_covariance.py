# SPDX-License-Identifier: Apache-2.0
"""How uncertain a twist is, by the errors of the image lines and of the pose that it was made from."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.control.compute_twist import inverted_matrix, law_factors
from plsing_ros.control.inverses import pose_shares
from plsing_ros.features import decompose, interaction_matrix
from plsing_ros.features.target import TargetView
from plsing_ros.geometry import LineSet
from plsing_ros.parameters import ControllerParameters


def image_twist_covariance(
    parameters: ControllerParameters, lines: LineSet, image: Array, view: TargetView, own: Array, pose: Array
) -> Array:
    """Return the covariance of a twist by the image, over the square of its gain, shape (6, 6).

    To first order: errors of L are left out, for they count by the error that is left, and so is the target's own.

    Args:
        parameters: The law and its options.
        lines: In the camera's optical frame, n lines.
        image: Their image lines, shape (3n,).
        view: The target, seen through the same lines.
        own: Covariances of angle and offset of each image line, shape (n, 3) or (3,).
        pose: Covariance of the pose that the 3-D lines stand for, in the camera's axes, shape (6, 6).

    Source: propagation of errors through tau = -lambda V diag(f) U^T (s - s*); f of each law in docs/controller.md.
    """
    columns = list(parameters.columns)
    inverted = inverted_matrix(parameters, interaction_matrix(lines)[:, columns], image, view)
    left, values, right = decompose(inverted)
    factors = law_factors(parameters, values, view)[0]
    # Of the twist by the coordinates of each image line, and by its angle and offset.
    by_image = ((right.T * factors) @ left.T).reshape(len(columns), -1, 3)
    x, y, _ = image.reshape(-1, 3).T
    by_angle, by_offset = x * by_image[..., 1] - y * by_image[..., 0], by_image[..., 2]
    angle, mixed, offset = np.broadcast_to(own, (len(lines), 3)).T
    crossed = (by_angle * mixed) @ by_offset.T
    covariance = (by_angle * angle) @ by_angle.T + crossed + crossed.T + (by_offset * offset) @ by_offset.T
    if parameters.law == "detour":
        by_pose = (right.T * pose_shares(values, factors)) @ right
        covariance = covariance + by_pose @ pose[np.ix_(columns, columns)] @ by_pose.T
    full = np.zeros((6, 6))
    full[np.ix_(columns, columns)] = covariance
    return full
