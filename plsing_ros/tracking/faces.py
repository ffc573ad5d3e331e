# SPDX-License-Identifier: Apache-2.0
"""How bright an object's faces are, place by place: what is in the way looks otherwise."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, BoolArray
from plsing_ros.geometry import Pose
from plsing_ros.geometry.model import Model
from plsing_ros.tracking.camera import PinholeCamera

Image = npt.NDArray[np.uint8]

_PLACES = 500  # on all faces
_BLOCK = 5  # side of what is looked at for the brightness of a place [px]
# Of a brightness from the remembered one: in deviations, as a share, and [grey levels].
_MAX_OFF, _MAX_SHARE, _MIN_OFF = 4.0, 0.1, 8.0
_FIRST = 8.0  # deviation of a place seen once [grey levels]
_RATE = 0.3
_FADING = 1.02  # of a deviation, each time that a place looks otherwise
# Something is in the way if more of the known places look otherwise: what is seen for the first time may be that.
_MAX_COVERED = 0.1


class FaceMemory:
    """Places on the faces of a model, and how bright they were.

    Args:
        model: The object.
        camera: The camera.
        cv: OpenCV.
    """

    def __init__(self, model: Model, camera: PinholeCamera, cv: ModuleType) -> None:
        self._camera = camera
        self._cv = cv
        a, b, c = (model.vertices[model.triangles[:, i]] for i in range(3))
        areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        self._apart = float(np.sqrt(areas.sum() / _PLACES)) if len(areas) else 1.0  # places from each other [m]
        counts: npt.NDArray[np.int_] = np.clip(np.ceil(np.sqrt(2.0 * areas) / self._apart).astype(int), 1, 40)
        places: list[Array] = [np.empty((0, 3))]
        triangles: list[npt.NDArray[np.int_]] = [np.empty(0, dtype=int)]
        for row, n in enumerate(counts):
            i, j = (np.ravel(each) for each in np.meshgrid(*2 * [(np.arange(n) + 0.33) / n], indexing="ij"))
            inside = i + j < 1.0
            u, v = i[inside][:, np.newaxis], j[inside][:, np.newaxis]
            places.append((1.0 - u - v) * a[row] + u * b[row] + v * c[row])
            triangles.append(np.full(len(u), row))
        self._places: Array = np.vstack(places)
        self._triangles: npt.NDArray[np.int_] = np.concatenate(triangles)
        self.forget()

    def forget(self) -> None:
        """Know nothing any more."""
        # Mean and scatter of the brightness, and how far these are off from time to time; 0 if unknown [grey levels].
        self._level: Array = np.zeros((len(self._places), 2))
        self._deviation: Array = np.full((len(self._places), 2), _FIRST)

    def covered(self, image: Image, faces: Image, order: npt.NDArray[np.int_], origin: Array, pose: Pose) -> Image:
        """Return where something is in the way, as ones, and learn from the rest.

        Args:
            image: The part of the image that shows the object, grey.
            faces: Which triangle is seen at each of its pixels, from 1, as an index of `order`; 0 for none.
            order: Rows of the model's triangles.
            origin: Pixel of the part's first one, x and y.
            pose: T_camera_model.
        """
        seen = self._places @ pose.rotation.T + pose.translation
        pixels = np.round(self._camera.project(seen) - origin).astype(int)
        reach = image.shape[1] - 1, image.shape[0] - 1
        rows = np.flatnonzero(((pixels >= 0) & (pixels <= reach)).all(axis=1))
        x, y = pixels[rows].T
        labels = np.zeros(len(self._triangles) and int(self._triangles.max()) + 1, dtype=int)
        labels[order] = np.arange(1, len(order) + 1)
        own = faces[y, x] == labels[self._triangles[rows]]
        rows, x, y = rows[own], x[own], y[own]
        block = _BLOCK, _BLOCK
        mean = self._cv.boxFilter(image, self._cv.CV_32F, block)[y, x].astype(float)
        square = self._cv.sqrBoxFilter(image, self._cv.CV_32F, block)[y, x]
        levels = np.maximum(np.column_stack([mean, np.sqrt(np.maximum(square - mean * mean, 0.0))]), 1.0)
        known = self._level[rows, 0] > 0.0
        other = self._other(rows, levels, known)
        result = np.zeros(image.shape, dtype=np.uint8)
        for place, depth in zip(np.flatnonzero(other), seen[rows[other], 2], strict=True):
            radius = int(np.ceil(0.7 * self._apart * self._camera.focal / depth))
            self._cv.circle(result, (int(x[place]), int(y[place])), radius, 1, -1)
        if other.sum() > _MAX_COVERED * known.sum():
            for place in np.flatnonzero(~known):
                self._cv.circle(result, (int(x[place]), int(y[place])), _BLOCK, 1, -1)
            new = np.zeros(len(rows), dtype=bool)
        else:
            new = ~known
        self._learn(rows, levels, known & ~other, other, new)
        return result

    def _other(self, rows: npt.NDArray[np.int_], levels: Array, known: BoolArray) -> BoolArray:
        """Return which known places look otherwise than remembered, in the light of this image."""
        if not known.any():
            return known
        level, deviation = self._level[rows], self._deviation[rows]
        gain = float(np.median(levels[known, 0] / level[known, 0]))
        most = gain * (_MAX_OFF * deviation + _MAX_SHARE * level) + _MIN_OFF
        other: BoolArray = known & (np.abs(levels - gain * level) > most).any(axis=1)
        return other

    def _learn(
        self, rows: npt.NDArray[np.int_], levels: Array, same: BoolArray, other: BoolArray, new: BoolArray
    ) -> None:
        self._level[rows[new]] = levels[new]
        self._deviation[rows[other]] *= _FADING
        off = levels[same] - self._level[rows[same]]
        self._level[rows[same]] += _RATE * off
        self._deviation[rows[same]] += _RATE * (1.25 * np.abs(off) - self._deviation[rows[same]])
