# SPDX-License-Identifier: Apache-2.0
"""How well poses agree with images, told without edges: what is painted on a face must look the same in each image."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from plsing_ros.geometry import Pose
from plsing_ros.geometry.model import Model
from plsing_ros.tracking import PinholeCamera

_SIDE = 48  # of the picture of a face [px]
_SHARE = 0.8  # of a face, without its rim
_MIN_FACING = 0.4  # cosine between the line of sight and the normal
_MIN_IMAGES = 5


def texture_agreement(
    model: Model, camera: PinholeCamera, images: Sequence[Any], poses: Sequence[Pose | None]
) -> np.ndarray:
    """Return the correlation of each picture of a face with the mean of its other pictures; 1 for exact poses.

    Args:
        model: Convex, with faces of four corners.
        camera: Without distortion.
        images: Grey.
        poses: T_camera_model of each image.
    """
    import cv2

    middle, found = model.vertices.mean(axis=0), []
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32) * (_SIDE - 1)
    for face in model.faces:
        corners = model.vertices[list(face)]
        center = corners.mean(axis=0)
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        normal *= np.sign(normal @ (center - middle)) / np.linalg.norm(normal)
        pictures = []
        for image, pose in zip(images, poses, strict=True):
            if pose is None:
                continue
            sight = pose.rotation @ center + pose.translation
            if -(pose.rotation @ normal) @ sight < _MIN_FACING * np.linalg.norm(sight):
                continue
            inner = center + _SHARE * (corners - center)
            seen = camera.project(inner @ pose.rotation.T + pose.translation).astype(np.float32)
            flat = cv2.warpPerspective(image, cv2.getPerspectiveTransform(seen, square), (_SIDE, _SIDE)).astype(float)
            smooth = cv2.GaussianBlur(flat, (0, 0), 0.7)
            pictures.append((smooth - smooth.mean()) / max(smooth.std(), 1e-6))
        if len(pictures) < _MIN_IMAGES:
            continue
        total = np.sum(pictures, axis=0)
        for picture in pictures:
            others = total - picture
            found.append(float(np.mean(picture * (others - others.mean()) / others.std())))
    return np.array(found)
