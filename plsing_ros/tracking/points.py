"""Points on the faces of an object, followed from image to image: the cue that edges drowned in texture need.

Source: Lucas and Kanade's method in pyramids, as OpenCV has it; points on known faces are known in space.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from plsing_ros._core import compiled
from plsing_ros.arrays import Array
from plsing_ros.geometry import Pose
from plsing_ros.geometry.model import Model
from plsing_ros.tracking.camera import PinholeCamera

Image = npt.NDArray[np.uint8]

_MAX_POINTS = 80
_MIN_POINTS = 10
# Of a point's image [px].
_DEVIATION = 0.35
# Points of a face err together, by light and by the lens: so many count as one.
_POINTS_PER_INDEPENDENT = 4.0
# Faces are shrunk by this [px], as what is behind an object moves with it at its rim.
_RIM = 6
_WINDOW = (13, 13)
_LEVELS = 3
_MARGIN = 48
_CRITERIA = (3, 12, 0.02)  # count and epsilon


@dataclass(frozen=True, eq=False)
class PointPose:
    """The pose that followed points agree on.

    Attributes:
        T_camera_model: The pose.
        covariance: Of a motion (v, omega) of the model in the camera frame, that of the key image included, (6, 6).
        count: Points that agree.
        share: Of all that were followed.
    """

    T_camera_model: Pose
    covariance: Array
    count: int
    share: float


class FacePoints:
    """Corners on the faces of a model, taken from a key image whose pose is known, and followed."""

    def __init__(self, model: Model, camera: PinholeCamera, cv: ModuleType) -> None:
        self._model = model
        self._camera = camera
        self._cv = cv
        self._points = np.empty((0, 3))
        self._pixels = np.empty((0, 2), dtype=np.float32)
        self._key_covariance = np.zeros((6, 6))
        self._key_count = 0
        self._image: Image | None = None

    def __len__(self) -> int:
        return len(self._points)

    @property
    def is_worn(self) -> bool:
        """Whether too few points of the key image are left."""
        return len(self._points) < max(_MIN_POINTS, 0.6 * self._key_count)

    def forget(self) -> None:
        """Drop all points."""
        self._points, self._pixels = self._points[:0], self._pixels[:0]
        self._image = None
        self._key_count = 0

    def take(self, image: Image, T_camera_model: Pose, covariance: Array) -> None:
        """Take corners from a new key image.

        Args:
            image: Grey.
            T_camera_model: The pose.
            covariance: Of a motion of the model in the camera frame, shape (6, 6).
        """
        self._image = image
        self._key_covariance = covariance
        corners = self._model.vertices @ T_camera_model.rotation.T + T_camera_model.translation
        if corners[:, 2].min() <= 0.0 or not len(self._model.triangles):
            self.forget()
            return
        pixels = self._camera.project(corners)
        top, left, bottom, right = self._window(pixels, image.shape, 0)
        if bottom - top < 16 or right - left < 16:
            self.forget()
            return
        # From far to near, so that near faces cover far ones. 0 is no face.
        faces = np.zeros((bottom - top, right - left), dtype=np.uint8)
        order = np.argsort(-corners[self._model.triangles, 2].mean(axis=1))[-250:]
        for label, row in enumerate(order, 1):
            outline = np.round(pixels[self._model.triangles[row]] - (left, top)).astype(np.int32)
            self._cv.fillConvexPoly(faces, outline, label)
        inside = self._cv.erode(
            (faces > 0).astype(np.uint8), np.ones((2 * _RIM + 1,) * 2, np.uint8), borderType=self._cv.BORDER_CONSTANT,
            borderValue=0,
        )
        found = self._cv.goodFeaturesToTrack(
            image[top:bottom, left:right], _MAX_POINTS, 0.02, 6, mask=inside, blockSize=5
        )
        self._key_count = 0
        if found is None:
            self.forget()
            self._image = image
            return
        seen = found.reshape(-1, 2)
        columns = np.round(seen).astype(int)
        triangle = order[faces[columns[:, 1], columns[:, 0]] - 1]
        seen = seen + np.array((left, top), dtype=np.float32)
        rays = np.column_stack([self._camera.normalised(seen.astype(float)), np.ones(len(seen))])
        a, b, c = (corners[self._model.triangles[triangle, i]] for i in range(3))
        normal = np.cross(b - a, c - a)
        facing = np.einsum("ij,ij->i", rays, normal)
        size = np.linalg.norm(normal, axis=1) * np.linalg.norm(rays, axis=1)
        # Seen too flat, a face is not where it is thought to be.
        good = np.abs(facing) > 0.15 * size
        depth = np.einsum("ij,ij->i", a, normal)[good] / facing[good]
        points = depth[:, np.newaxis] * rays[good]
        self._points = (points - T_camera_model.translation) @ T_camera_model.rotation
        self._pixels = np.ascontiguousarray(seen[good], dtype=np.float32)
        self._key_count = len(self._points)

    def follow(self, image: Image, predicted: Pose) -> PointPose | None:
        """Return the pose by the points in the next image; None where too few can be followed.

        Args:
            image: Grey, of the size of the last one.
            predicted: T_camera_model expected.
        """
        last, self._image = self._image, image
        if last is None or len(self._points) < _MIN_POINTS:
            return None
        expected = self._points @ predicted.rotation.T + predicted.translation
        guess = self._pixels.copy()
        if expected[:, 2].min() > 0.0:
            guess = self._camera.project(expected).astype(np.float32)
        top, left, bottom, right = self._window(np.vstack([self._pixels, guess]), image.shape, _MARGIN)
        if bottom - top < 32 or right - left < 32:
            return None
        origin = np.array((left, top), dtype=np.float32)
        before, now = last[top:bottom, left:right], image[top:bottom, left:right]
        now = self._equalised(before, now)
        moved, status, _ = self._cv.calcOpticalFlowPyrLK(
            before, now, self._pixels - origin, guess - origin, None, winSize=_WINDOW, maxLevel=_LEVELS,
            criteria=_CRITERIA, flags=self._cv.OPTFLOW_USE_INITIAL_FLOW, minEigThreshold=1e-3,
        )
        kept = status.ravel() == 1
        total = len(self._points)
        if kept.sum() < _MIN_POINTS:
            return None
        points, pixels = self._points[kept], (moved + origin)[kept]
        seen = self._camera.normalised(pixels.astype(float))
        rotation, translation, information, scale, _, weights = compiled.fit_points(
            points, seen, _DEVIATION / self._camera.focal, predicted.rotation, predicted.translation
        )
        agree = np.array(weights) > 0.2
        count = int(agree.sum())
        if count < _MIN_POINTS or count < 0.4 * total or not scale * _DEVIATION < 4.0:
            return None
        self._points, self._pixels = points[agree], np.ascontiguousarray(pixels[agree])
        own = _POINTS_PER_INDEPENDENT * np.linalg.inv(information + 1e-9 * np.eye(6))
        return PointPose(_pose(rotation, translation), own + self._key_covariance, count, count / total)

    def _equalised(self, before: Image, now: Image) -> Image:
        """Return the new image as bright as the last one, as a light that changes would mislead."""
        old, new = float(before.mean()), float(now.mean())
        if new < 1.0 or abs(old - new) < 2.0:
            return now
        scaled: Any = self._cv.convertScaleAbs(now, alpha=old / new)
        return scaled

    def _window(self, pixels: Array, shape: tuple[int, ...], margin: int) -> tuple[int, int, int, int]:
        low = np.clip(np.floor(pixels.min(axis=0)) - margin, 0, (shape[1], shape[0]))
        high = np.clip(np.ceil(pixels.max(axis=0)) + margin + 1, 0, (shape[1], shape[0]))
        return int(low[1]), int(low[0]), int(high[1]), int(high[0])


def _pose(rotation: Array, translation: Array) -> Pose:
    return Pose(rotation, translation)
