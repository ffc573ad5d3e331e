# SPDX-License-Identifier: Apache-2.0
"""Edges and points of an object put together: LineTracker."""

from __future__ import annotations

import dataclasses
import importlib
import math
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType

import numpy as np
import numpy.typing as npt

from plsing_ros._core import compiled
from plsing_ros.arrays import Array, checked_array
from plsing_ros.errors import GeometryError, ObservationError
from plsing_ros.features import LineObservation
from plsing_ros.geometry import Pose
from plsing_ros.geometry.model import Model
from plsing_ros.geometry.rotations import turned_covariance
from plsing_ros.tracking.alternatives import angle_between, flipped, is_flat, nearby, surroundings, symmetries
from plsing_ros.tracking.camera import PinholeCamera
from plsing_ros.tracking.model_tolerance import model_covariance
from plsing_ros.tracking.points import FacePoints, PointPose
from plsing_ros.tracking.row_reading import RowReading
from plsing_ros.tracking.tracking import Tracking, TrackingState

Image = npt.NDArray[np.uint8]

_RANGES = (8, 4)  # of the search across an edge, pass after pass [px]
_RANGES_WITH_POINTS = (5, 3)  # points say well where to search
_SEARCH_RANGES = (32, 16, 8, 4)
# Squared distance of the pose by all cues from the one by points, in standard deviations: beyond, they do not agree.
_MAX_DISTANCE = 9.0
# Support beyond chance: what is needed, with and without points, and what is good enough to learn from.
_MIN_EXCESS = 0.45
_MIN_EXCESS_WITH_POINTS = 0.2
_GOOD_EXCESS = 0.6
_MIN_GAIN = 0.1
# What ends a search round a pose, and where it begins in an image after the first.
_FOUND_EXCESS = 0.8
_STARTS_PER_IMAGE = 4
# Of fits round a first pose: the support beyond chance that is enough at that pose; how much less is as good; and how
# far a vertex moves at least from one pose to another [px].
_SURE_EXCESS, _AS_MUCH, _APART = 0.8, 0.05, 4.0
# What is enough of a pose found so within reach of the widest search, where lines that could contradict it by so many
# degrees of freedom do not: edges between faces that are equally bright are not seen.
_AGREED_EXCESS, _MIN_AGREED = 0.65, 5.5
# Of a pose found so, what is covered is left out only where what is seen could contradict it.
_MIN_FREEDOM = 3.0
# Of the samples show something else than the object: WEAK beyond, and how many at most do not count.
_WEAK_COVERED, _MAX_COVERED = 0.25, 0.4
# WEAK if the standard deviation of the object's position exceeds this share of its radius, LOST beyond all of it.
_MAX_DEVIATION = 0.3
_MAX_TURN = math.radians(2.5)  # of the rotation's standard deviation: WEAK beyond
# Poses that look the same and differ by less cannot be told apart; more with each image without the object [rad].
_MIN_DOUBT, _DOUBT_PER_LOSS = 0.5, 0.1
# Errors of edges last for some images: the variance of a pose that is carried on by points grows by this each time.
_FORGETTING = 1.3
# Lines that agree better than they claim to, image after image, are better. The pose gives way to what they are off by
# for long, such as by the model or the light: of that part of the variance, this many times more than residuals show.
_LASTING = 2.0
_FOLLOWED = 0.3  # of the last residual, by what is remembered of those of an edge
_REMEMBERED = 0.9  # of what residuals of former images showed, from one image to the next
_CLAIMED = 5.0  # degrees of freedom of residuals as large as claimed that a tracker begins with
_MIN_SHARE = 0.02  # of the variance that is claimed
_LEARNING = 0.1
_REMEMBERED_LOSSES = 30  # images without the object after which its faces may look otherwise
_MIN_SHARE_OF_USUAL = 0.85  # of the excess that images had until now: less, and something is in the way, or wrong
_MAX_SCALE = 1.3  # of residuals, beyond which edges contradict each other
_MIN_SHARE_IF_CONTRADICTED = 0.93  # as _MIN_SHARE_OF_USUAL, where they do and no points confirm the pose
_MAX_READOUT_TIME = 1.0  # [s]
_NOTHING: Array = np.zeros((6, 6))


@dataclass(frozen=True, eq=False)
class _Fit:
    """Edges fitted to one image."""

    T_camera_model: Pose
    information: Array
    prior: Array  # information of the points
    distance: float  # squared, from the pose of the points, in their standard deviations
    found: compiled.EdgeFit
    by_points_alone: bool = False

    @cached_property
    def support(self) -> float:
        return self._totals[1] / max(self._totals[0], 1.0)

    @cached_property
    def chance(self) -> float:
        return self._totals[2] / max(self._totals[0], 1.0)

    @cached_property
    def excess(self) -> float:
        """Support beyond chance: 1 where all is explained, about 0 where nothing is."""
        return (self.support - self.chance) / max(1.0 - self.chance, 1e-3)

    @cached_property
    def covered(self) -> float:
        """Share that is not explained, and where the object's faces look otherwise than they did."""
        return self._totals[3] / max(self._totals[0], 1.0)

    @cached_property
    def clear_excess(self) -> float:
        """Excess of the part that nothing is in the way of, which is most of the object."""
        support = self.support / (1.0 - min(self.covered, _MAX_COVERED))
        return (support - self.chance) / max(1.0 - self.chance, 1e-3)

    @cached_property
    def freedom(self) -> float:
        """Degrees of freedom of the residuals."""
        return self.found.freedom(self.prior)

    @cached_property
    def scale(self) -> float:
        return self.found.scale

    @cached_property
    def edges(self) -> npt.NDArray[np.int32]:
        """Rows of the model's edges that have a line."""
        return self.found.edges

    @cached_property
    def _totals(self) -> tuple[float, float, float, float]:
        return self.found.totals


class LineTracker:
    """Tracks a known object from image to image, and gives its edges as line features.

    Args:
        model: The object; the scene frame is the model's frame.
        camera: The camera.
        use_points: Follow points on the faces as well, where OpenCV is installed.
        gamma: Exponent from grey levels to light: 2.2 of nearly all cameras, 1 of those that are linear.
        readout_time: From the first row of an image to the last, of a rolling shutter; 0 if all are taken at once [s].
        edge_std: How well the edges are known: standard deviation of the middle of each across it [m], and of its
            direction [rad], shape (n, 2), each at least 0; exactly if not given.

    Raises:
        GeometryError: If readout_time is not in 0 to 1 s, or edge_std has another shape, or holds a number that is not
            finite or below 0.
    """

    def __init__(
        self,
        model: Model,
        camera: PinholeCamera,
        use_points: bool = True,
        gamma: float = 2.2,
        readout_time: float = 0.0,
        edge_std: Array | None = None,
    ) -> None:
        self._readout_time = _checked_readout_time(readout_time)
        self._edge_std = None if edge_std is None else _checked_edge_std(edge_std, len(model))
        self._readout: compiled.Readout | None = None  # of this image; None for all rows at once, or if not known
        self._time: float | None = None  # of this image, and of the last one with a pose [s]
        self._last_time: float | None = None
        self.model = model
        self.camera = camera
        self._core = compiled.EdgeTracker(
            model.vertices,
            model.edges,
            model.triangles,
            model.edge_triangles,
            camera.numbers,
            camera.width,
            camera.height,
            gamma,
        )
        cv = _opencv() if use_points else None
        self._points = None if cv is None else FacePoints(model, camera, cv)
        self._last: Pose | None = None  # T_camera_model
        self._trusted: Pose | None = None  # the last one of TRACKING
        self._losses = 0  # images since the last good one
        self._squares = self._freedom = _CLAIMED  # of the residuals of recent images
        self._residuals = np.zeros((len(model), 2))  # of each edge, as remembered
        self._lasting = 0.0  # what residuals share with those remembered, as a sum like the squares
        self._measure = 1.0  # share of the variance of lines that the last image asked for
        self._symmetry: Pose | None
        nothing = Pose(np.eye(3), np.zeros(3))
        turns = sorted(((angle_between(each, nothing), i, each) for i, each in enumerate(symmetries(model))))
        # The smallest turn that maps the model onto itself [rad]; infinite if there is none.
        self.min_symmetry, _, self._symmetry = turns[0] if turns else (math.inf, 0, None)
        self._flat: dict[bytes, bool] = {}  # whether sets of visible edges are
        self._doubt = _MIN_DOUBT  # how far the object may have turned unseen [rad]
        self._usual: float | None = None  # excess of the images until now
        self._found = False  # whether the object was, since the first pose
        self._confirmed = False  # whether an image explained the edges well since the pose was found
        self._noise = 0.0  # of the image [grey levels]

    def start(self, pose: Pose) -> None:
        """Begin anew at a pose that is known from elsewhere; the next image is searched widely round it.

        Args:
            pose: T_world_camera.
        """
        self._last = self._trusted = pose.inverse()
        self._last_time = None
        self._doubt = _MIN_DOUBT
        self._losses = 1
        self._usual = None
        self._found = self._confirmed = False
        self._residuals[:], self._lasting = 0.0, 0.0
        self._core.forget(True)
        if self._points is not None:
            self._points.forget()

    @property
    def T_world_camera(self) -> Pose | None:
        """The last pose that was found, or the first one that was given; None before."""
        return None if self._last is None else self._last.inverse()

    def track(self, image: Image, pose: Pose | None = None, time: float | None = None) -> Tracking:
        """Return where the object is in the next image; of a rolling shutter, when the row of its middle is read.

        Args:
            image: Grey, of the camera's size, dtype uint8.
            pose: T_world_camera expected, by a filter or the twist that was commanded; the last one if not given. The
                object is looked for round the first one, image after image, until it is found.
            time: Of the image, on any clock [s]; a rolling shutter is not corrected where it is not given.

        Raises:
            ObservationError: If the image is not one of this camera, or no pose is given and none is known.
        """
        grey = self._checked(image)
        predicted = pose.inverse() if pose is not None else self._last
        if predicted is None:
            raise ObservationError("no pose to start from: give the first image's pose, or search for it")
        if self._last is None:
            self._last = predicted
        if self._losses % 2 == 0 and self._losses > 0 and self._trusted is not None:
            # The loss may have begun unseen.
            predicted = self._trusted
        self._noise = compiled.image_noise(grey)
        self._time, self._readout = time, None
        last, since = self._last, 0.0 if time is None or self._last_time is None else time - self._last_time
        if self._readout_time > 0.0 and since > 0.0 and last is not None and self._losses == 0:
            share = self._readout_time / since * self.camera.fy / self.camera.height
            self._readout = compiled.Readout(last, share, self.model.center)
        by_points = self._points.follow(grey, predicted, self._reading) if self._points is not None else None
        ranges = _RANGES if self._losses == 0 else _SEARCH_RANGES
        fit = None
        if by_points is not None:
            fit = self._fit(grey, by_points.T_camera_model, _RANGES_WITH_POINTS, by_points)
            if fit is None or fit.distance > _MAX_DISTANCE:
                # Points and edges do not agree: edges are believed only where they explain much more.
                alone = self._at(grey, by_points)
                least = 0.0 if fit is None else min(fit.excess - _MIN_GAIN, _MIN_EXCESS)
                believed = alone is not None and (fit is None or alone.excess > least)
                fit, by_points = (alone, by_points) if believed else (fit, None)
        # From the prediction alone: as usual, and widely where that explains too little.
        enough = max(_GOOD_EXCESS if by_points is None else _MIN_EXCESS, _MIN_SHARE_OF_USUAL * (self._usual or 0.0))
        for reach in dict.fromkeys((ranges, _SEARCH_RANGES)):
            if fit is not None and fit.excess >= enough:
                break
            other = self._fit(grey, predicted, reach, None)
            if other is not None and (fit is None or self._is_better(predicted, other, fit)):
                fit, by_points = other, None
        if not self._found and by_points is None:
            fit, unsure = self._first(grey, predicted, fit)
            if unsure:
                return self._lost("another pose near the expected one explains the edges as well")
        elif self._losses and by_points is None and (fit is None or fit.clear_excess < _FOUND_EXCESS):
            fit = self._search(grey, predicted, fit)
        return self._concluded(grey, predicted, fit, by_points)

    def _first(self, image: Image, predicted: Pose, fit: _Fit | None) -> tuple[_Fit | None, bool]:
        """Return the best fit round a first pose, and whether fits of another pose explain as much.

        The edges that are nearest to those of the model may be those of other things.
        """
        if fit is not None and fit.excess > _SURE_EXCESS and self._moved(predicted, fit.T_camera_model) < _APART:
            return fit, False
        starts = nearby(predicted, self.model.center, self.camera.focal) + self._surroundings(predicted)
        fits = [fit, *(self._fit(image, start, _SEARCH_RANGES[1:], None) for start in starts)]
        found = [each for each in fits if each is not None]
        best = max(found, key=lambda each: each.excess, default=None)
        if best is None:
            return None, False
        good = [each for each in found if each.excess > best.excess - _AS_MUCH]
        for each in good:
            # Of those that explain as much, the first pose tells which.
            if self._moved(predicted, each.T_camera_model) < _APART:
                return each, False
        return best, any(self._moved(best.T_camera_model, each.T_camera_model) > _APART for each in good)

    def _search(self, image: Image, predicted: Pose, fit: _Fit | None) -> _Fit | None:
        """Return the best fit round a pose."""
        for start in self._surroundings(predicted):
            other = self._fit(image, start, _SEARCH_RANGES[1:], None)
            if other is not None and (fit is None or other.excess > fit.excess):
                fit = other
            if fit is not None and fit.clear_excess >= _FOUND_EXCESS:
                break
        return fit

    def _surroundings(self, predicted: Pose) -> list[Pose]:
        """Return poses round one: all of them at first, some in each later image."""
        starts = surroundings(predicted, self.model.center, self.camera.focal)
        if self._losses > 2:
            first = (self._losses - 3) * _STARTS_PER_IMAGE % len(starts)
            starts = starts[first : first + _STARTS_PER_IMAGE]
        return starts

    def _fit(self, image: Image, pose: Pose, ranges: tuple[int, ...], points: PointPose | None) -> _Fit | None:
        """Return the edges fitted with smaller and smaller ranges; None where there are none."""
        return self._fitted(image, pose, ranges, _NOTHING if points is None else self._information(points))

    def _at(self, image: Image, points: PointPose) -> _Fit | None:
        """Return what the edges say at the pose of the points, without moving it."""
        certain = 1e12 * np.eye(6)
        pose = points.T_camera_model
        fit = self._fitted(image, pose, _RANGES_WITH_POINTS[-1:], certain)
        if fit is None:
            return None
        return dataclasses.replace(
            fit, T_camera_model=pose, information=self._information(points), by_points_alone=True
        )

    def _information(self, points: PointPose) -> Array:
        """Return the information of points, in the measure of lines: what they claim is too little or too much."""
        return self._measure * _inverse(points.covariance)

    def _fitted(self, image: Image, start: Pose, ranges: tuple[int, ...], information: Array) -> _Fit | None:
        found = self._core.fit(image, self._noise, start, information, ranges, self._readout)
        if found is None:
            return None
        pose = Pose(*found.pose)
        distance = 0.0
        if information is not _NOTHING:
            off = compiled.motion_between(pose, start)
            distance = float(off @ information @ off) / self._measure
        return _Fit(pose, found.information, information, distance, found)

    def _reading(self, pose: Pose) -> RowReading | None:
        """Return how the rows are read if the object is at a pose; None for all at once, or if it is not known."""
        return None if self._readout is None else RowReading(*self._readout.of(pose))

    def _concluded(self, image: Image, predicted: Pose, fit: _Fit | None, points: PointPose | None) -> Tracking:
        needed, found = self._needed(predicted, fit, points)
        if fit is None or self._evidence(fit, found) < needed:
            share = 0.0 if fit is None else fit.support
            return self._lost(f"the image explains {share:.0%} of the visible edges")
        contradicted = f"the edges fit one pose {fit.scale:.1f} times worse than each fits its line"
        least = _MIN_SHARE_IF_CONTRADICTED * (self._usual or 0.0)
        if points is None and fit.scale > _MAX_SCALE and fit.excess < least:
            return self._lost(f"{contradicted}, and the image explains fewer than until now: {fit.support:.0%}")
        share = self._share(fit)
        pose = fit.T_camera_model
        covariance, deviation, turn = compiled.uncertainty(fit.information, pose, self.model.center, share)
        if not deviation < self.model.radius:
            return self._lost(f"the edges leave the position uncertain by {deviation:.2g} m")
        self._losses = 0
        self._found, self._confirmed = True, self._confirmed and not found
        state, reason = self._verdict(fit, deviation, turn, _FOUND_EXCESS if found else _GOOD_EXCESS, contradicted)
        reading = self._reading(pose)
        self._last, self._last_time = pose, self._time
        if state is TrackingState.TRACKING:
            self._trusted = pose
        self._core.learn(fit.found, pose, fit.excess >= _GOOD_EXCESS)
        if self._points is not None:
            growth = 1.0 if fit.by_points_alone else _FORGETTING
            self._points.anchor(
                image, points, pose, growth * covariance, fit.excess >= _GOOD_EXCESS, self._noise, reading
            )
        # Lines that contradict each other are not off by noise: wrong ones move a pose by more than their scatter says.
        # Points know how it moved all the same.
        contradiction = max(1.0, fit.scale) ** 2
        covariance = contradiction * covariance + self._by_model(fit)
        T_world_camera = pose.inverse()
        return Tracking(
            state,
            reason,
            T_world_camera,
            turned_covariance(covariance, T_world_camera.rotation),
            self._observation(fit, contradiction**2 * share),
            fit.support,
            fit.chance,
            0 if points is None else len(points.points),
        )

    def _by_model(self, fit: _Fit) -> Array:
        """Return the covariance of the pose by what edges are off by, shape (6, 6)."""
        if self._edge_std is None:
            return _NOTHING
        vertices = self.model.vertices @ fit.T_camera_model.rotation.T + fit.T_camera_model.translation
        ends = vertices[self.model.edges[fit.edges]]
        weights = fit.found.weights / max(fit.scale, 1.0) ** 2
        std = self._edge_std[fit.edges]
        return model_covariance(ends, fit.found.lines, weights, fit.information, fit.prior, std)

    def _needed(self, predicted: Pose, fit: _Fit | None, points: PointPose | None) -> tuple[float, bool]:
        """Return the least excess that makes a pose one, and whether it was found by a search."""
        if points is not None:
            # Points carry on a wrong pose as well as a right one.
            return (_MIN_EXCESS_WITH_POINTS if self._confirmed else _MIN_EXCESS), False
        moved = 0.0 if fit is None else self._moved(predicted, fit.T_camera_model)
        agreed = fit is not None and fit.scale < 1.0 and fit.freedom >= _MIN_AGREED and moved < _SEARCH_RANGES[0]
        enough = max(_AGREED_EXCESS if agreed else _FOUND_EXCESS, _MIN_SHARE_OF_USUAL * (self._usual or 0.0))
        if fit is not None and fit.excess < enough and moved > _RANGES[0]:
            # Searched widely, other things are found, too, and other sides of the object.
            return enough, True
        return _GOOD_EXCESS, self._losses > 0

    def _is_better(self, predicted: Pose, other: _Fit, fit: _Fit) -> bool:
        """Return whether edges alone explain more, and enough to be a pose."""
        needed, found = self._needed(predicted, other, None)
        return other.excess > fit.excess + _MIN_GAIN and self._evidence(other, found) >= needed

    @staticmethod
    def _evidence(fit: _Fit, found: bool) -> float:
        return fit.clear_excess if found and fit.freedom >= _MIN_FREEDOM else fit.excess

    def _moved(self, a: Pose, b: Pose) -> float:
        """Return how far the object moved in the image, the most of its vertices [px]."""
        points = [self.model.vertices @ each.rotation.T + each.translation for each in (a, b)]
        if min(each[:, 2].min() for each in points) <= 0.0:
            return math.inf
        return float(np.abs(self.camera.project(points[0]) - self.camera.project(points[1])).max())

    def _share(self, fit: _Fit) -> float:
        """Return the share of the claimed variance of lines that their residuals ask for.

        Source: the variance of M-estimates (Huber 1981) over recent images, or of this one where it is larger.
        """
        if not fit.by_points_alone and fit.scale < _MAX_SCALE:
            residuals = fit.found.residuals
            self._squares = _REMEMBERED * self._squares + fit.found.squares
            self._freedom = _REMEMBERED * self._freedom + fit.freedom
            before = self._residuals[fit.edges]
            self._lasting = _REMEMBERED * self._lasting + float(fit.found.weights @ (residuals * before).sum(axis=1))
            self._residuals[fit.edges] = before + _FOLLOWED * (residuals - before)
        variance = self._squares / self._freedom
        # Residuals at the pose of points are those of that pose as well.
        if fit.freedom > 1.0 and not fit.by_points_alone:
            variance = max(variance, fit.found.squares / fit.freedom)
        variance += _LASTING * max(self._lasting, 0.0) / self._freedom
        # A fit counts a scale above 1 itself.
        scale = 1.0 if fit.by_points_alone else max(fit.scale, 1.0)
        self._measure = max(variance / scale**2, _MIN_SHARE)
        return self._measure

    def _verdict(
        self, fit: _Fit, deviation: float, turn: float, good: float, contradicted: str
    ) -> tuple[TrackingState, str]:
        other = self._alternative(fit)
        if other is not None:
            degrees = math.degrees(angle_between(other, fit.T_camera_model))
            return TrackingState.AMBIGUOUS, f"a pose turned by {degrees:.0f} degrees explains the edges as well"
        if fit.excess < good:
            return TrackingState.WEAK, f"the image explains only {fit.support:.0%} of the visible edges"
        usual = self._usual
        self._confirmed = True
        self._usual = fit.excess if usual is None else usual + _LEARNING * (fit.excess - usual)
        if usual is not None and fit.excess < _MIN_SHARE_OF_USUAL * usual:
            return (
                TrackingState.WEAK,
                f"the image explains {fit.support:.0%} of the visible edges, fewer than until now",
            )
        if fit.covered > _WEAK_COVERED:
            return TrackingState.WEAK, f"something is in the way of {fit.covered:.0%} of the visible edges"
        if fit.scale > _MAX_SCALE:
            return TrackingState.WEAK, contradicted
        if deviation > _MAX_DEVIATION * self.model.radius:
            return TrackingState.WEAK, f"the edges leave the position uncertain by {deviation:.2g} m"
        if turn > _MAX_TURN:
            return TrackingState.WEAK, f"the edges leave the rotation uncertain by {math.degrees(turn):.1f} degrees"
        return TrackingState.TRACKING, ""

    def _alternative(self, fit: _Fit) -> Pose | None:
        """Return another pose that explains the edges and may have been reached since the last certain one."""
        pose = fit.T_camera_model
        if self._symmetry is not None and self.min_symmetry < self._doubt:
            return pose @ self._symmetry
        visible = fit.found.visible
        key = visible.tobytes()
        if key not in self._flat:
            self._flat[key] = is_flat(self.model, visible)
        start = flipped(self.model, visible, pose) if self._flat[key] else None
        if start is None or angle_between(start, pose) > self._doubt:
            return None
        other_pose, explained = self._core.other(fit.found, start)
        other = Pose(*other_pose)
        explains = explained >= (1.0 - _MIN_GAIN) * fit.found.totals[1]
        return other if explains and angle_between(other, pose) > 0.5 * angle_between(start, pose) else None

    def _observation(self, fit: _Fit, share: float) -> LineObservation:
        lines, usable, covariances, ends = self._core.seen_lines(fit.found, fit.T_camera_model, share)
        return LineObservation(self.model.ids, lines, usable, covariances=covariances, ends=ends)

    def _lost(self, reason: str) -> Tracking:
        self._losses += 1
        self._found = self._found and self._confirmed
        if self._losses > _REMEMBERED_LOSSES:
            self._core.forget(False)
        self._doubt = min(self._doubt + _DOUBT_PER_LOSS, math.pi + 0.1)
        n = len(self.model)
        nothing = LineObservation(self.model.ids, np.zeros((n, 3)), np.zeros(n, dtype=bool))
        return Tracking(TrackingState.LOST, reason, None, np.zeros((6, 6)), nothing, 0.0, 0.0, 0)

    def _checked(self, image: Image) -> Image:
        array = np.asarray(image)
        expected = (self.camera.height, self.camera.width)
        if array.dtype != np.uint8 or array.shape != expected:
            raise ObservationError(
                f"the image has shape {array.shape} and type {array.dtype}; the camera's are {expected} and uint8 "
                "(grey)"
            )
        return np.ascontiguousarray(array)


def _inverse(matrix: Array) -> Array:
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def _opencv() -> ModuleType | None:
    try:
        return importlib.import_module("cv2")
    except ImportError:
        return None


def _checked_readout_time(value: float) -> float:
    if not 0.0 <= value <= _MAX_READOUT_TIME:
        raise GeometryError(f"readout_time is {value} s; it must be from 0 to {_MAX_READOUT_TIME:g} s")
    return value


def _checked_edge_std(value: npt.ArrayLike, edges: int) -> Array:
    std = checked_array("edge_std", value, (edges, 2))
    if (std < 0.0).any():
        raise GeometryError(f"edge_std holds {std.min()}; a standard deviation must be at least 0")
    return std
