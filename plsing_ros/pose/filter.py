# SPDX-License-Identifier: Apache-2.0
"""The camera pose through a sequence of images: a filter that goes through singularities, and says when it is lost."""

from __future__ import annotations

import math
from itertools import compress
from typing import Any

import numpy as np
import numpy.typing as npt

from plsing_ros import _core
from plsing_ros.arrays import Array, checked_array
from plsing_ros.errors import ObservationError, ParameterError
from plsing_ros.features import LineObservation, checked_observation
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.pose import checked_twist
from plsing_ros.parameters.options import parameters_from_options
from plsing_ros.parameters.pose_estimator import FilterParameters
from plsing_ros.pose.estimate import FROM_FILTER, Alternative, PoseEstimate, Verdict, failed_estimate
from plsing_ros.pose.estimator import PoseEstimator
from plsing_ros.pose.filter_estimate import TrackSummary
from plsing_ros.pose.filter_motion import MEAN_TIME, Agreement
from plsing_ros.pose.filter_track import FilterTrack, TrackUpdate
from plsing_ros.pose.twist_history import MeanTwist, TwistHistory

# Images in a row that a new start must explain before it is believed after the filter was lost.
_CONFIRMATIONS = 3
# How long a filter that was contradicted is followed, in case that the images were wrong and not the filter [s].
_SECOND_CHANCE = 1.0
_MAX_TRACKS = 8
# Of an image line, where all noise is said to be in the scene: what rounding leaves of an exact image.
_MIN_VARIANCE = 1e-16
# A first image further from the filter's clock than this tells what time it is [s].
_OTHER_CLOCK = 10.0


class PoseFilter:
    """Follows the camera in one scene: an iterated Kalman filter on SE(3), new in how it treats lines (docs/filter.md).

    It starts from a given pose, or from the first image whose pose can be trusted; several poses that explain the first
    image alike are followed until all but one are contradicted. Images that contradict it make it LOST, until they, or
    single images that agree with each other, say where the camera is.

    Args:
        lines: The scene, in the world frame, with how well each line is known.
        settings: Noise, gates and thresholds; or each of them as an option.
        start: T_world_camera at the start, if it is known.
        start_covariance: Of position and orientation as in geometry_msgs/PoseWithCovariance, shape (6, 6); needed with
            a start.
        start_time: When that is, on the clock of the images [s].
        options: Every parameter by its name (docs/reference), nested where it has dots: noise={"image": 1e-3}.

    Raises:
        ParameterError: If a start has no covariance, or one that is not positive definite.

    Example:
        >>> import plsing_ros as pl
        >>> pose_filter = pl.PoseFilter(lines)
        >>> estimate = pose_filter.update(observation, time=0.0)
        >>> pose_filter.predict(twist, dt=0.04)
        >>> estimate = pose_filter.update(next_observation, time=0.04)
        >>> estimate.verdict, estimate.pose, estimate.covariance
    """

    def __init__(
        self,
        lines: LineSet,
        settings: FilterParameters | None = None,
        *,
        start: Pose | None = None,
        start_covariance: npt.ArrayLike | None = None,
        start_time: float = 0.0,
        **options: Any,
    ) -> None:
        self.lines = lines
        self.settings = parameters_from_options(FilterParameters, options) if settings is None else settings
        self._row_of = {i: row for row, i in enumerate(lines.ids)}
        # Noise of the scene's Plücker coordinates is a tolerance of its lines.
        std = (np.hypot(each, self.settings.noise_scene) for each in (lines.position_std, lines.direction_std))
        self._map = _core.FilterMap(lines.direction, lines.pivot, *std)
        self._estimator = PoseEstimator(lines, self.settings)
        self._twists = TwistHistory(self.settings.twist_hold, self.settings.twist_latency)
        self._mean_twist = MeanTwist(MEAN_TIME)
        self._clock = float(start_time)
        self._tracks: list[FilterTrack] = []
        self._lost = ""
        self._lost_since = 0.0
        self._candidate: FilterTrack | None = None
        self._confirmed = 0
        self._time: float | None = None
        self._agreed = float(start_time)
        self._latest: PoseEstimate | None = None
        if start is not None:
            self._tracks = [self._track(start, _checked_covariance(start_covariance))]
            self._time = float(start_time)

    def predict(self, twist: npt.ArrayLike | None, dt: float) -> None:
        """Move the filter's clock on by dt [s], in which the camera moved with a twist.

        Args:
            twist: (v, omega) of the camera in its own frame, shape (6,) [m/s, rad/s]; None: any motion within
                motion.linear_speed and motion.angular_speed.
            dt: At least 0 [s].

        Raises:
            GeometryError: If the twist is not six finite numbers.
            ObservationError: If dt is negative or not finite.
        """
        if not 0.0 <= dt < math.inf:
            raise ObservationError(f"dt is {dt} s; a filter can only be predicted forward")
        self._twists.add(None if twist is None else checked_twist("twist", twist), self._clock, dt)
        self._clock += dt

    def receive_twist(self, twist: npt.ArrayLike, time: float) -> None:
        """Take note of a twist that holds from a time [s] until the next one: instead of predict, where it has a stamp.

        Raises:
            GeometryError: If the twist is not six finite numbers.
        """
        self._twists.add(checked_twist("twist", twist), time)
        self._clock = max(self._clock, time)

    def update(self, observation: LineObservation, time: float | None = None) -> PoseEstimate:
        """Return what all images up to this one say about the camera pose, at the time of this one.

        Args:
            observation: Image lines with ids; without covariances they have noise.image.
            time: When the image was taken, on the filter's clock [s]; None: now. One that is not later than the last
                image changes nothing: the answer is that of the last one.

        Raises:
            ObservationError: If a line is not in the scene, or the time is not finite.
        """
        time = self._clock if time is None else float(time)
        if not math.isfinite(time):
            raise ObservationError(f"the time of the image is {time} s")
        rows = self._rows(checked_observation(observation))
        if self._latest is None and abs(time - self._clock) > _OTHER_CLOCK:
            self._set_clock(time)
        if self._latest is not None and self._time is not None and time <= self._time:
            return self._latest
        self._move_to(time)
        self._latest = self._updated(observation, rows, time)
        return self._latest

    def pose_at(self, time: float) -> Pose | None:
        """Return the most plausible T_world_camera at a time [s] after the last image, by the twists; None if LOST."""
        if not self._tracks or self._lost or self._time is None:
            return None
        pose = self._tracks[0].pose
        for duration, twist in self._twists.between(self._time, time):
            pose = pose if twist is None else pose.integrate(twist, duration)
        return pose

    def _rows(self, observation: LineObservation) -> list[int]:
        unknown = [i for i in observation.ids if i not in self._row_of]
        if unknown:
            raise ObservationError(f"line id {unknown[0]} is not in the scene, whose ids are {list(self.lines.ids)}")
        return [self._row_of[i] for i in observation.usable_ids]

    def _set_clock(self, time: float) -> None:
        """Begin anew at a time of another clock, with the pose of the start, if there is one."""
        self._twists.clear()
        self._clock = self._agreed = time
        if self._time is not None:
            self._time = time

    def _move_to(self, time: float) -> None:
        if self._time is not None:
            for duration, twist in self._twists.between(self._time, time):
                mean = self._mean_twist.after(twist, duration)
                for track in self._all_tracks():
                    track.predict(twist, mean, duration)
        self._time = time
        self._clock = max(self._clock, time)

    def _all_tracks(self) -> list[FilterTrack]:
        return self._tracks if self._candidate is None else [*self._tracks, self._candidate]

    def _updated(self, observation: LineObservation, rows: list[int], time: float) -> PoseEstimate:
        if self._lost:
            return self._found_again(observation, rows, time)
        if not self._tracks:
            return self._started(observation, time)
        if not rows:
            return self._unseen("no line is seen", observation, time)
        image, covariances = observation.usable_image_lines, self._covariances(observation)
        updates = [(track, track.update(rows, image, covariances)) for track in self._tracks]
        agreeing = [each for each in updates if each[1].agreement is not Agreement.CONTRADICTS]
        if not agreeing:
            return self._lose("the image contradicts where the camera is expected", time)
        if agreeing[0][1].agreement is Agreement.MOVED and self._is_open(observation, agreeing[0][0]):
            return self._lose("the camera did not move as the twist says, and the image alone does not say how", time)
        self._agreed = time
        least = min(track.cost for track, _ in agreeing)
        likely = -2.0 * math.log(self.settings.min_likelihood_ratio)
        agreeing = sorted((e for e in agreeing if e[0].cost - least <= likely), key=lambda each: each[0].cost)
        self._tracks = [track for track, _ in agreeing]
        return self._described(*agreeing[0], observation, "")

    def _is_open(self, observation: LineObservation, track: FilterTrack) -> bool:
        """Whether an image alone has another pose than that of a track."""
        estimate = self._estimator.estimate(observation)
        if estimate.T_world_camera is None:
            return True
        poses = [estimate.T_world_camera, *(each.T_world_camera for each in estimate.alternatives)]
        summary = TrackSummary(track, self._estimator)
        return any(summary.differs(pose, self.settings) for pose in poses)

    def _covariances(self, observation: LineObservation) -> Array:
        if observation.usable_covariances is not None:
            return observation.usable_covariances
        # Of lines in the camera's frame, as far as one number can say what it makes of their images.
        noise = max(self.settings.noise_image**2 + self.settings.noise_camera**2, _MIN_VARIANCE)
        return np.tile((noise, 0.0, noise), (len(observation.usable_ids), 1))

    def _track(self, pose: Pose, covariance: Array) -> FilterTrack:
        return FilterTrack(self.lines, self._map, pose, covariance, self.settings)

    def _started(self, observation: LineObservation, time: float) -> PoseEstimate:
        """Start from one image: its pose, or all poses that explain it."""
        estimate = self._estimator.estimate(observation)
        self._tracks = self._tracks_of(estimate)
        if self._tracks:
            self._agreed = time
        return estimate

    def _tracks_of(self, estimate: PoseEstimate) -> list[FilterTrack]:
        if estimate.T_world_camera is None:
            return []
        if not estimate.alternatives:
            return [self._track(estimate.T_world_camera, estimate.covariance)] if estimate.covariance_trusted else []
        poses = [estimate.T_world_camera, *(each.T_world_camera for each in estimate.alternatives)]
        # The covariance of an alternative is about that of the estimate, seen from the other side: so a wide one.
        size = np.array([estimate.position_deviation**2] * 3 + [estimate.rotation_deviation**2] * 3)
        covariances = [estimate.covariance, *([4.0 * np.diag(size)] * (len(poses) - 1))]
        return [self._track(*each) for each in zip(poses[:_MAX_TRACKS], covariances, strict=False)]

    def _unseen(self, what: str, observation: LineObservation, time: float) -> PoseEstimate:
        seconds = time - self._agreed
        if seconds > self.settings.max_dead_reckoning:
            return self._lose(f"{what} for {seconds:.3g} s", time)
        nothing = TrackUpdate(Agreement.AGREES, [], np.zeros(0), 0.0, 0.0)
        return self._described(self._tracks[0], nothing, observation, f"{what} for {seconds:.3g} s: dead reckoning")

    def _lose(self, reason: str, time: float) -> PoseEstimate:
        self._lost, self._lost_since = reason, time
        self._candidate, self._confirmed = None, 0
        return failed_estimate(reason, Verdict.LOST, FROM_FILTER)

    def _found_again(self, observation: LineObservation, rows: list[int], time: float) -> PoseEstimate:
        """Go on where the filter was, if images agree with that again, or where single images see the camera."""
        since = f"LOST for {time - self._lost_since:.3g} s, as {self._lost}"
        if not rows:
            return failed_estimate(f"{since}; no line is seen", Verdict.LOST, FROM_FILTER)
        image, covariances = observation.usable_image_lines, self._covariances(observation)
        if time - self._agreed <= _SECOND_CHANCE and len(rows) >= 3:
            for track in self._tracks:
                expected = track.update_as_expected(rows, image, covariances)
                if expected is not None:
                    return self._resume(track, expected, observation, time)
        if self._candidate is not None:
            update = self._candidate.update(rows, image, covariances)
            if update.agreement is Agreement.AGREES:
                self._confirmed += 1
                if self._confirmed >= _CONFIRMATIONS:
                    return self._resume(self._candidate, update, observation, time)
                return failed_estimate(f"{since}; a new start is being confirmed", Verdict.LOST, FROM_FILTER)
            self._candidate = None
        estimate = self._estimator.estimate(observation)
        if estimate.covariance_trusted and estimate.T_world_camera is not None:
            self._candidate, self._confirmed = self._track(estimate.T_world_camera, estimate.covariance), 1
            return failed_estimate(f"{since}; a new start is being confirmed", Verdict.LOST, FROM_FILTER)
        why = estimate.reason or "its covariance cannot be trusted"
        return failed_estimate(f"{since}; no start from this image alone: {why}", Verdict.LOST, FROM_FILTER)

    def _resume(
        self, track: FilterTrack, update: TrackUpdate, observation: LineObservation, time: float
    ) -> PoseEstimate:
        self._tracks, self._candidate, self._lost, self._agreed = [track], None, "", time
        return self._described(track, update, observation, "")

    def _described(
        self, track: FilterTrack, update: TrackUpdate, observation: LineObservation, note: str
    ) -> PoseEstimate:
        """Return the estimate of a track; LOST if it has become too uncertain to say where to look for the lines."""
        summary = TrackSummary(track, self._estimator)
        limits = self.settings
        if summary.position_deviation > limits.lost_position_deviation:
            return self._lose(
                f"the position has become uncertain by {summary.position_deviation:.3g} m, above "
                f"{limits.lost_position_deviation:g} m",
                self._agreed,
            )
        if summary.rotation_deviation > limits.lost_rotation_deviation:
            return self._lose(
                f"the orientation has become uncertain by {summary.rotation_deviation:.3g} rad, above "
                f"{limits.lost_rotation_deviation:g} rad",
                self._agreed,
            )
        alternatives = tuple(
            Alternative(other.pose, math.exp(-0.5 * (other.cost - track.cost)))
            for other in self._tracks
            if other is not track and summary.differs(other.pose, limits)
        )
        if len(self._tracks) > 1 and not alternatives:
            # They have met.
            self._tracks = [track]
        ids = observation.usable_ids
        used = tuple(compress(ids, update.used))
        return summary.estimate(
            update,
            note,
            alternatives,
            used_ids=used,
            outlier_ids=tuple(i for i, use in zip(ids, update.used, strict=False) if not use),
            reversed_ids=tuple(
                i for i, use, turned in zip(ids, update.used, update.reversed, strict=False) if use and turned
            ),
        )


def _checked_covariance(covariance: npt.ArrayLike | None) -> Array:
    if covariance is None:
        raise ParameterError("start_covariance is missing; a start needs one, shape (6, 6) [m^2, m rad, rad^2]")
    checked = checked_array("start_covariance", covariance, (6, 6), ParameterError)
    least = float(np.linalg.eigvalsh(0.5 * (checked + checked.T))[0])
    if not least > 0.0 or np.abs(checked - checked.T).max() > 1e-9 * np.abs(checked).max():
        raise ParameterError(
            f"start_covariance must be symmetric and positive definite; its smallest eigenvalue is {least:.3g}"
        )
    return checked
