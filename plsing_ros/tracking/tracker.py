"""Edges and points of an object put together: LineTracker."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from types import ModuleType

import numpy as np
import numpy.typing as npt

from plsing_ros._core import compiled
from plsing_ros.arrays import Array
from plsing_ros.errors import ObservationError
from plsing_ros.features import LineObservation
from plsing_ros.geometry import Pose
from plsing_ros.geometry.model import Model
from plsing_ros.tracking.camera import PinholeCamera
from plsing_ros.tracking.points import FacePoints, PointPose
from plsing_ros.tracking.tracking import Tracking, TrackingState

Image = npt.NDArray[np.uint8]

_STEP = 4.0  # between samples along an edge [px]
_MARGIN = 6.0  # of samples from the border of the image [px]
_RANGES = (8, 4)  # of the search across an edge, pass after pass [px]
_SEARCH_RANGES = (32, 16, 8, 4)
_TOLERANCE = 1.5  # of an edge in the image from the projected one [px]
_NOTHING = np.zeros((6, 6))


@dataclass(frozen=True, eq=False)
class _Fit:
    """Edges fitted to one image."""

    T_camera_model: Pose
    information: Array
    scale: float
    edges: npt.NDArray[np.int_]  # rows of the model's edges that have a line
    lines: Array  # phi, rho, var phi, cov, var rho, support, contrast, offset of each
    weights: Array
    visible: npt.NDArray[np.int_]
    counts: Array  # samples, explained and by chance of each visible edge

    @property
    def support(self) -> float:
        return float(self.counts[:, 1].sum() / max(self.counts[:, 0].sum(), 1.0))

    @property
    def chance(self) -> float:
        return float(self.counts[:, 2].sum() / max(self.counts[:, 0].sum(), 1.0))

    @property
    def excess(self) -> float:
        """Support beyond chance: 1 where all is explained, about 0 where nothing is."""
        return (self.support - self.chance) / max(1.0 - self.chance, 1e-3)


class LineTracker:
    """Tracks a known object from image to image, and gives its edges as line features.

    Args:
        model: The object; the scene frame is the model's frame.
        camera: The camera.
        use_points: Follow points on the faces as well, where OpenCV is installed.
    """

    def __init__(self, model: Model, camera: PinholeCamera, use_points: bool = True) -> None:
        self.model = model
        self.camera = camera
        self._core = compiled.EdgeModel(model.vertices, model.edges, model.triangles, model.edge_triangles)
        cv = _opencv() if use_points else None
        self._points = None if cv is None else FacePoints(model, camera, cv)
        self._contrast = np.zeros(len(model))
        self._last: Pose | None = None  # T_camera_model

    def track(self, image: Image, pose: Pose | None = None) -> Tracking:
        """Return where the object is in the next image.

        Args:
            image: Grey, of the camera's size, dtype uint8.
            pose: T_world_camera expected, by a filter or the twist that was commanded; the last one if not given.

        Raises:
            ObservationError: If the image is not one of this camera, or no pose is given and none is known.
        """
        grey = self._checked(image)
        predicted = pose.inverse() if pose is not None else self._last
        if predicted is None:
            raise ObservationError("no pose to start from: give the first image's pose, or search for it")
        noise = compiled.image_noise(grey)
        by_points = self._points.follow(grey, predicted) if self._points is not None else None
        fit = None
        if by_points is not None:
            fit = self._fit(grey, noise, by_points.T_camera_model, _RANGES, by_points)
        if fit is None or fit.excess < 0.5:
            other = self._fit(grey, noise, predicted, _RANGES, None)
            if fit is None or (other is not None and other.excess > fit.excess + 0.1):
                fit, by_points = other, None
        return self._concluded(grey, fit, by_points)

    def _fit(
        self, image: Image, noise: float, pose: Pose, ranges: tuple[int, ...], points: PointPose | None
    ) -> _Fit | None:
        information = _NOTHING if points is None else np.linalg.inv(points.covariance)
        prior = pose
        fit = None
        for search_range in ranges:
            fit = self._pass(image, noise, pose, search_range, prior, information) or fit
            if fit is None:
                return None
            pose = fit.T_camera_model
        return fit

    def _pass(
        self, image: Image, noise: float, pose: Pose, search_range: int, prior: Pose, information: Array
    ) -> _Fit | None:
        camera = self.camera
        visible = self._core.visible_edges(
            pose.rotation, pose.translation, camera.numbers, camera.width, camera.height, _STEP, _MARGIN
        )
        if not len(visible):
            return None
        compiled.search_edges(visible, image, camera.numbers, search_range, noise, 2.2, self._contrast)
        lines = compiled.fit_edge_lines(visible, camera.focal, search_range)
        rotation, translation, found, scale, chosen, weights = self._core.fit_pose(
            lines, pose.rotation, pose.translation, prior.rotation, prior.translation, information
        )
        counts = self._core.support(visible, rotation, translation, camera.focal, search_range, _TOLERANCE)
        return _Fit(
            Pose(rotation, translation), found, scale, np.array(lines.edges, dtype=int), lines.chosen(chosen),
            np.array(weights), np.array(visible.edges, dtype=int), counts,
        )

    def _concluded(self, image: Image, fit: _Fit | None, points: PointPose | None) -> Tracking:
        if fit is None or fit.excess < 0.3:
            if self._points is not None:
                self._points.forget()
            share = 0.0 if fit is None else fit.support
            return self._lost(f"the image explains {share:.0%} of the visible edges")
        state, reason = TrackingState.TRACKING, ""
        pose = fit.T_camera_model
        covariance = np.linalg.inv(fit.information + 1e-9 * np.eye(6))
        self._last = pose
        good = fit.weights > 0.5
        rows, contrast = fit.edges[good], fit.lines[good, 6]
        before = self._contrast[rows]
        self._contrast[rows] = np.where(before == 0.0, contrast, 0.7 * before + 0.3 * contrast)
        if self._points is not None and (points is None or self._points.is_worn):
            self._points.take(image, pose, covariance)
        T_world_camera = pose.inverse()
        turn = T_world_camera.rotation
        to_scene = np.zeros((6, 6))
        to_scene[:3, :3] = to_scene[3:, 3:] = turn
        return Tracking(
            state, reason, T_world_camera, to_scene @ covariance @ to_scene.T, self._observation(fit, good),
            fit.support, fit.chance, 0 if points is None else points.count,
        )

    def _observation(self, fit: _Fit, good: npt.NDArray[np.bool_]) -> LineObservation:
        n = len(self.model)
        image_lines = np.zeros((n, 3))
        usable = np.zeros(n, dtype=bool)
        for row, line in zip(fit.edges[good], fit.lines[good], strict=True):
            image_lines[row] = np.cos(line[0]), np.sin(line[0]), line[1]
            usable[row] = True
        return LineObservation(self.model.ids, image_lines, usable, None)

    def _lost(self, reason: str) -> Tracking:
        n = len(self.model)
        nothing = LineObservation(self.model.ids, np.zeros((n, 3)), np.zeros(n, dtype=bool), None)
        return Tracking(TrackingState.LOST, reason, None, np.zeros((6, 6)), nothing, 0.0, 0.0, 0)

    def _checked(self, image: Image) -> Image:
        array = np.asarray(image)
        expected = (self.camera.height, self.camera.width)
        if array.dtype != np.uint8 or array.shape != expected:
            raise ObservationError(
                f"the image has shape {array.shape} and type {array.dtype}; the camera's are {expected} and uint8 (grey)"
            )
        return np.ascontiguousarray(array)


def _opencv() -> ModuleType | None:
    try:
        return importlib.import_module("cv2")
    except ImportError:
        return None
