# SPDX-License-Identifier: Apache-2.0
"""Points on the faces of an object, followed from image to image: the cue that edges drowned in texture need.

Source: Lucas and Kanade's method in pyramids, as OpenCV has it; points on known faces are known in space.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType

import numpy as np
import numpy.typing as npt

from plsing_ros._core import compiled
from plsing_ros.arrays import Array, BoolArray, cross
from plsing_ros.geometry import Pose
from plsing_ros.geometry.model import Model
from plsing_ros.tracking.camera import PinholeCamera
from plsing_ros.tracking.row_reading import RowReading

Image = npt.NDArray[np.uint8]
Pixels = npt.NDArray[np.float32]

_MAX_POINTS = 80
_MIN_POINTS = 10
# Of a point's image [px].
_DEVIATION = 0.35
# Points of a face err together, by light and by the lens: so many count as one.
_POINTS_PER_INDEPENDENT = 4.0
# Faces are shrunk by this [px], as what is behind an object moves with it at its rim.
_RIM = 6
_LOOK_EACH = 5  # images from one in which points are looked for that something covers to the next
_SPARSE = 11  # pixels of which one is looked at to tell how bright an image is
_PLACES = 500  # on all faces whose brightness is remembered
_CELL = 24  # side of a part of the image that gives its share of corners [px]
_APART = 6  # points from each other [px]
_BLOCK = 5  # side of what is looked at to find a corner [px]
# Of the smaller eigenvalue of the squared gradients that noise alone has: less is no corner.
_MIN_CORNER = 3.0
# A point moves by this share towards where its ray meets its face now, as the pose at which it was taken was not exact.
_SETTLING = 0.2
_MIN_SHARE = 0.4  # of the points must agree
_MAX_DEVIATION = 4.0  # of their images [px]
# Sine of the angle between ray and face: seen too flat, a face is not where it is thought to be.
_MIN_FACING = 0.15
_WINDOW = (13, 13)
_LEVELS = 3
# Of a point's surroundings from what they were, in the mean: [grey levels], and in deviations of the image's noise.
_MAX_UNLIKE, _UNLIKE_BY_NOISE = 12.0, 1.5
_MARGIN = 48  # of the part of the image that is looked at [px]
_CRITERIA = (3, 12, 0.02)  # stop after 12 steps, or one below 0.02 px


@dataclass(frozen=True, eq=False)
class PointPose:
    """The pose that followed points agree on.

    Attributes:
        T_camera_model: The pose.
        covariance: Of a motion (v, omega) of the model in the camera frame, that of the anchor included, (6, 6).
        points: Those that agree, in the model frame, shape (k, 3) [m].
        pixels: Where they are in the image, shape (k, 2) [px].
        triangles: Rows of the model's triangles that they lie on, shape (k,).
        share: Of all that look as before.
    """

    T_camera_model: Pose
    covariance: Array
    points: Array
    pixels: Pixels
    triangles: npt.NDArray[np.int_]
    share: float


class FacePoints:
    """Corners on the faces of a model, followed from image to image.

    How they move says very exactly how the object moved; where they are on the object is only as certain as the pose
    at which they were taken. `anchor` corrects them by what the edges say.
    """

    def __init__(self, model: Model, camera: PinholeCamera, cv: ModuleType) -> None:
        self._model = model
        self._camera = camera
        self._cv = cv
        self._places = _places(model)
        a, b, c = (model.vertices[model.triangles[:, i]] for i in range(3))
        normals = cross(b - a, c - a)
        # Planes of the triangles: normal . point = offset.
        self._normals: Array = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        self._offsets: Array = (a * self._normals).sum(axis=1)
        self.forget()

    def forget(self) -> None:
        """Drop all points."""
        self._points: Array = np.empty((0, 3))
        self._pixels: Pixels = np.empty((0, 2), dtype=np.float32)
        self._triangles: npt.NDArray[np.int_] = np.empty(0, dtype=int)
        self._covariance: Array = np.zeros((6, 6))
        self._taken = 0
        self._noise = 0.0
        self._age = 0
        self._memory = compiled.FaceMemory(*self._places)
        self._image: Image | None = None
        self._reading: RowReading | None = None

    @property
    def is_worn(self) -> bool:
        """Whether too few of the points that were taken are left."""
        return len(self._points) < max(_MIN_POINTS, 0.6 * self._taken)

    def follow(
        self, image: Image, predicted: Pose, reading: Callable[[Pose], RowReading | None] = lambda pose: None
    ) -> PointPose | None:
        """Return the pose by the points in another image; None where too few can be followed.

        Args:
            image: Grey, of the size of the one that was anchored.
            predicted: T_camera_model expected.
            reading: How the rows of this image are read if the object is at a pose; None for all at once.
        """
        if self._image is None or len(self._points) < _MIN_POINTS:
            return None
        expected = self._points @ predicted.rotation.T + predicted.translation
        guess = self._pixels
        if expected[:, 2].min() > 0.0:
            guess = self._camera.project(expected).astype(np.float32)
        top, left, bottom, right = self._window(np.vstack([self._pixels, guess]), _MARGIN)
        if bottom - top < 2 * _MARGIN or right - left < 2 * _MARGIN:
            return None
        origin = np.array((left, top), dtype=np.float32)
        before, now = self._image[top:bottom, left:right], image[top:bottom, left:right]
        moved, status, unlike = self._cv.calcOpticalFlowPyrLK(
            before,
            self._as_bright(before, now),
            self._pixels - origin,
            guess - origin,
            None,
            winSize=_WINDOW,
            maxLevel=_LEVELS,
            criteria=_CRITERIA,
            flags=self._cv.OPTFLOW_USE_INITIAL_FLOW,
            minEigThreshold=1e-3,
        )
        kept = (status.ravel() == 1) & (unlike.ravel() < _MAX_UNLIKE + _UNLIKE_BY_NOISE * self._noise)
        if kept.sum() < _MIN_POINTS:
            return None
        points, pixels = self._points[kept], (moved + origin)[kept]
        seen, deviation = self._camera.normalised(pixels.astype(float)), _DEVIATION / self._camera.focal
        pose, read = predicted, reading(predicted)
        for _ in range(1 if read is None else 2):
            there = seen if read is None else read.at_middle(seen, points @ pose.rotation.T + pose.translation)
            rotation, translation, information, scale, weights = compiled.fit_points(points, there, deviation, pose)
            pose = Pose(rotation, translation)
            read = reading(pose)
        agree = weights > 0.2
        share = float(agree.sum()) / len(points)
        if agree.sum() < _MIN_POINTS or share < _MIN_SHARE or scale * _DEVIATION > _MAX_DEVIATION:
            return None
        own = _POINTS_PER_INDEPENDENT * np.linalg.inv(information + 1e-9 * np.eye(6))
        return PointPose(
            pose, own + self._covariance, points[agree], pixels[agree], self._triangles[kept][agree], share
        )

    def anchor(
        self,
        image: Image,
        followed: PointPose | None,
        pose: Pose,
        covariance: Array,
        take: bool,
        noise: float,
        reading: RowReading | None = None,
    ) -> None:
        """Fix the points to the pose of an image.

        Args:
            image: Grey.
            followed: What `follow` said of it.
            pose: T_camera_model by all cues.
            covariance: Of a motion of the model in the camera frame, shape (6, 6).
            take: Take new corners where there are too few; the pose must be a good one.
            noise: Standard deviation of the image's noise [grey levels].
            reading: How the rows of the image were read; None for all at once.
        """
        self._image, self._noise, self._reading = image, noise, reading
        self._covariance = covariance
        self._points = self._points[:0]
        self._pixels, self._triangles = self._pixels[:0], self._triangles[:0]
        if followed is not None:
            there = followed.points @ followed.T_camera_model.rotation.T + followed.T_camera_model.translation
            corrected = (there - pose.translation) @ pose.rotation
            seen, good = self._on_faces(followed.pixels, followed.triangles, pose)
            settled: Array = corrected[good] + _SETTLING * (seen - corrected[good])
            self._points = settled
            self._pixels = np.ascontiguousarray(followed.pixels[good], dtype=np.float32)
            self._triangles = followed.triangles[good]
        self._age += 1
        if take and (self.is_worn or self._age % _LOOK_EACH == 0):
            self._renew(image, pose, noise)

    def _renew(self, image: Image, pose: Pose, noise: float) -> None:
        """Drop points that something covers, and take new ones where there are too few."""
        known = self._taken
        pixels, triangles = self._corners(image, pose, noise)
        points, good = self._on_faces(pixels, triangles, pose)
        self._points = np.vstack([self._points, points])
        self._pixels = np.vstack([self._pixels, pixels[good]])
        self._triangles = np.concatenate([self._triangles, triangles[good]])
        self._taken = len(self._points) if self.is_worn or len(points) else known

    def _on_faces(
        self, pixels: npt.NDArray[np.float32], triangles: npt.NDArray[np.int_], T_camera_model: Pose
    ) -> tuple[Array, BoolArray]:
        """Return where the rays of pixels meet the planes of triangles, in the model frame, and which rays do."""
        rotation, center = T_camera_model.rotation, -T_camera_model.translation @ T_camera_model.rotation
        seen = self._camera.normalised(pixels.astype(float))
        rays = np.column_stack([seen, np.ones(len(pixels))]) @ rotation
        normals = self._normals[triangles]
        facing = (rays * normals).sum(axis=1)
        good = np.abs(facing) > _MIN_FACING * np.sqrt((rays * rays).sum(axis=1))
        distance = (self._offsets[triangles] - normals @ center)[good]
        if self._reading is not None:
            there = distance / facing[good]
            moved = self._reading.at_middle(seen[good], there[:, np.newaxis] * (rays[good] @ rotation.T))
            rays[good] = np.column_stack([moved, np.ones(len(moved))]) @ rotation
            facing[good] = (rays[good] * normals[good]).sum(axis=1)
        points: Array = center + (distance / facing[good])[:, np.newaxis] * rays[good]
        return points, good

    def _corners(
        self, image: Image, T_camera_model: Pose, noise: float
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int_]]:
        """Return the pixels of new corners on the faces, and which triangles they lie on."""
        nothing = np.empty((0, 2), dtype=np.float32), np.empty(0, dtype=int)
        vertices = self._model.vertices @ T_camera_model.rotation.T + T_camera_model.translation
        if vertices[:, 2].min() <= 0.0 or not len(self._model.triangles):
            return nothing
        pixels = self._camera.project(vertices)
        top, left, bottom, right = self._window(pixels, 0)
        if bottom - top < 16 or right - left < 16:
            return nothing
        # From far to near, so that near faces cover far ones. 0 is no face.
        faces = np.zeros((bottom - top, right - left), dtype=np.uint8)
        order = np.argsort(-vertices[self._model.triangles, 2].mean(axis=1))[-250:]
        outlines = np.round(pixels[self._model.triangles[order]] - (left, top)).astype(np.int32)
        for label, outline in enumerate(outlines, 1):
            self._cv.fillConvexPoly(faces, outline, label)
        part = np.ascontiguousarray(image[top:bottom, left:right])
        circles = self._memory.covered(image, faces, order.tolist(), left, top, T_camera_model, self._camera.numbers)
        covered = np.zeros(faces.shape, dtype=np.uint8)
        for x, y, radius in circles.tolist():
            self._cv.circle(covered, (x, y), radius, 1, -1)
        x, y = np.round(self._pixels - (left, top)).astype(int).T
        free = covered[np.clip(y, 0, bottom - top - 1), np.clip(x, 0, right - left - 1)] == 0
        self._points, self._pixels, self._triangles = self._points[free], self._pixels[free], self._triangles[free]
        if not self.is_worn:
            return nothing
        around, nothing_there = np.ones((2 * _RIM + 1,) * 2, np.uint8), self._cv.BORDER_CONSTANT
        inside = self._cv.erode(np.minimum(faces, 1), around, borderType=nothing_there, borderValue=0)
        inside[covered > 0] = 0
        for x, y in np.round(self._pixels - (left, top)).astype(int).tolist():
            self._cv.circle(inside, (x, y), _APART, 0, -1)
        room = _MAX_POINTS - len(self._points)
        # OpenCV's gradients are Sobel's, with 12 times the variance of noise, divided by 4 * 255 and the block's side.
        least = _MIN_CORNER * 12.0 * (noise / (4.0 * 255.0)) ** 2
        inside[self._cv.cornerMinEigenVal(part, _BLOCK) < least] = 0
        found = self._cv.goodFeaturesToTrack(part, 0, 0.02, _APART, mask=inside, blockSize=_BLOCK)
        if found is None:
            return nothing
        seen = self._spread(found.reshape(-1, 2), self._pixels - np.array((left, top), dtype=np.float32), room)
        columns = np.round(seen).astype(int)
        triangles = order[faces[columns[:, 1], columns[:, 0]] - 1]
        return seen + np.array((left, top), dtype=np.float32), triangles

    def _spread(self, corners: Pixels, known: Pixels, room: int) -> Pixels:
        """Return corners where there are few known ones, so that each part of the image has its share."""
        every = np.vstack([known, corners])
        column, row = (every // _CELL).astype(int).T
        cell = column * self._camera.height + row
        order = np.argsort(cell, kind="stable")
        rank = np.empty(len(every), dtype=int)
        rank[order] = np.arange(len(every)) - np.searchsorted(cell[order], cell[order])
        chosen: Pixels = corners[np.argsort(rank[len(known) :], kind="stable")[:room]]
        return chosen

    def _as_bright(self, before: Image, now: Image) -> Image:
        """Return an image as bright as another one, as a light that changes would mislead."""
        # Of medians, as what comes into the way is no light.
        old, new = _median(before), _median(now)
        if new < 1.0 or abs(old - new) < 2.0:
            return now
        scaled: Image = self._cv.convertScaleAbs(now, alpha=old / new)
        return scaled

    def _window(self, pixels: Array, margin: int) -> tuple[int, int, int, int]:
        size, low, high = (
            (self._camera.width, self._camera.height),
            pixels.min(axis=0).tolist(),
            pixels.max(axis=0).tolist(),
        )
        left, top = (int(min(max(each - margin, 0.0), most)) for each, most in zip(low, size, strict=True))
        right, bottom = (
            math.ceil(min(max(each + margin + 1.0, 0.0), most)) for each, most in zip(high, size, strict=True)
        )
        return top, left, bottom, right


def _places(model: Model) -> tuple[Array, list[int], float]:
    """Return places spread over the faces, shape (n, 3) [m], the triangle of each, and how far they are apart [m]."""
    a, b, c = (model.vertices[model.triangles[:, i]] for i in range(3))
    areas = 0.5 * np.linalg.norm(cross(b - a, c - a), axis=1)
    apart = float(np.sqrt(areas.sum() / _PLACES)) if len(areas) else 1.0
    places: list[Array] = [np.empty((0, 3))]
    triangles: list[int] = []
    for row, n in enumerate(np.clip(np.ceil(np.sqrt(2.0 * areas) / apart).astype(int), 1, 40).tolist()):
        u, v = (each.reshape(-1, 1) for each in np.meshgrid(*2 * [(np.arange(n) + 0.33) / n], indexing="ij"))
        inside = ((1.0 - u - v) * a[row] + u * b[row] + v * c[row])[(u + v < 1.0).ravel()]
        places.append(inside)
        triangles += [row] * len(inside)
    return np.vstack(places), triangles, apart


def _median(image: Image) -> float:
    """Return the middle grey level of some of the pixels."""
    pixels = image[::_SPARSE, ::_SPARSE].ravel()
    return float(np.partition(pixels, len(pixels) // 2)[len(pixels) // 2])
