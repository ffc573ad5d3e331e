# SPDX-License-Identifier: Apache-2.0
"""The pose estimator's cycle without ROS: image lines in, a camera pose with its verdict and completed features out."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

from plsing_ros.arrays import Array
from plsing_ros.features import LineObservation, LinesVerdict
from plsing_ros.geometry import Pose
from plsing_ros.parameters import PoseEstimatorParameters
from plsing_ros.pose import PoseEstimate, PoseEstimator, PoseFilter, Verdict, failed_estimate, lift_lines
from plsing_ros.stamp_filter import StampFilter

_SECOND = 1_000_000_000
# Standard deviations that the last pose may be off by.
_DEVIATIONS = 3.0
_LINES_VERDICTS = {
    Verdict.OK: LinesVerdict.OK,
    Verdict.POOR: LinesVerdict.POOR,
    Verdict.AMBIGUOUS: LinesVerdict.AMBIGUOUS,
}


@dataclass(frozen=True, eq=False)
class TrackedPose:
    """What came of one image.

    Attributes:
        estimate: The pose, with how far it can be trusted.
        completed: The image lines with their 3-D lines at that pose, carrying the verdict; without 3-D lines where no
            pose was found, and None where there is no image to speak of.
    """

    estimate: PoseEstimate
    completed: LineObservation | None


class PoseTracker:
    """Estimates one pose after the other; says FAILED and why whenever it cannot trust its input."""

    def __init__(self, parameters: PoseEstimatorParameters) -> None:
        self._stamp_filter = StampFilter("features", parameters.features_timeout, parameters.future_tolerance)
        self._parameters: PoseEstimatorParameters | None = None
        self._filter: PoseFilter | None = None
        self._origin: int | None = None
        self._last_stamp = 0
        self._latest: PoseEstimate | None = None
        self.parameters = parameters

    @property
    def parameters(self) -> PoseEstimatorParameters:
        """The parameters in force; setting them takes effect at the next image."""
        assert self._parameters is not None
        return self._parameters

    @parameters.setter
    def parameters(self, parameters: PoseEstimatorParameters) -> None:
        self.prepare(parameters)()

    def prepare(self, parameters: PoseEstimatorParameters) -> Callable[[], None]:
        """Return what puts changed parameters in force; a PlsingError if they are refused, with nothing changed."""
        estimator = PoseEstimator(parameters.lines(), parameters)
        before = self._parameters

        def put_in_force() -> None:
            self._estimator = estimator
            self._last: tuple[int, PoseEstimate] | None = None
            self._stamp_filter.timeout = parameters.features_timeout
            self._stamp_filter.future_tolerance = parameters.future_tolerance
            self._parameters = parameters
            self._filter = self._new_filter(before is not None and before.scene == parameters.scene)

        return put_in_force

    def track(self, observation: LineObservation, stamp: int, now: int) -> TrackedPose:
        """Return the pose of an image.

        Args:
            observation: Image lines with ids; 3-D lines in it are not used.
            stamp: Of the image [ns].
            now: Of the node clock [ns].

        Raises:
            ObservationError: If a line is not in the scene; call fail with the reason.
        """
        refusal = self._stamp_filter.refusal(stamp, now)
        if refusal is not None:
            return TrackedPose(failed_estimate(refusal), None)
        estimate = self._estimate(observation, stamp)
        if estimate.T_world_camera is None:
            self._stamp_filter.note_problem(estimate.reason)
            return TrackedPose(estimate, _without_lines(observation, estimate.reason))
        completed = lift_lines(self._estimator.lines, estimate, observation)
        verdict = _LINES_VERDICTS[estimate.verdict]
        completed = dataclasses.replace(
            completed, verdict=verdict, verdict_reason=estimate.reason, lines_source=estimate.source
        )
        return TrackedPose(estimate, completed)

    def receive_twist(self, twist: Array, stamp: int) -> None:
        """Take note of how the camera moves from a time on [ns], as (v, omega) in the optical frame, shape (6,)."""
        if self._filter is not None:
            self._filter.receive_twist(twist, self._seconds(stamp))

    def fail(self, reason: str) -> TrackedPose:
        """Return a failure with its reason, for features that cannot be used."""
        self._stamp_filter.note_problem(reason)
        return TrackedPose(failed_estimate(reason), None)

    def silence(self, now: int) -> TrackedPose | None:
        """Return a failure for input that has stopped, or None while it is recent enough (now in ns)."""
        reason = self._stamp_filter.silence(now)
        return None if reason is None else TrackedPose(failed_estimate(reason), None)

    def _estimate(self, observation: LineObservation, stamp: int) -> PoseEstimate:
        if self._filter is None:
            estimate = self._estimator.estimate(observation, *self._last_pose(stamp))
            if estimate.T_world_camera is not None and estimate.verdict is not Verdict.AMBIGUOUS:
                self._last = (stamp, estimate)
            return estimate
        if stamp < self._last_stamp:
            # The clock has jumped back, or the stamp filter would have refused it.
            self._origin, self._filter = None, self._new_filter(False)
            assert self._filter is not None
        self._last_stamp = stamp
        self._latest = self._filter.update(observation, self._seconds(stamp))
        return self._latest

    def _new_filter(self, same_scene: bool) -> PoseFilter | None:
        """Return a filter for the parameters, which goes on where the one before was if the scene is the same."""
        parameters, latest = self.parameters, self._latest
        if not parameters.filter:
            return None
        if not same_scene or latest is None or latest.T_world_camera is None or latest.alternatives:
            return PoseFilter(parameters.lines(), parameters)
        return PoseFilter(
            parameters.lines(),
            parameters,
            start=latest.T_world_camera,
            start_covariance=latest.covariance,
            start_time=self._seconds(self._last_stamp),
        )

    def _seconds(self, stamp: int) -> float:
        """Return a stamp [ns] as a time that has digits left for nanoseconds [s]."""
        if self._origin is None:
            self._origin = stamp
        return (stamp - self._origin) / _SECOND

    def _last_pose(self, stamp: int) -> tuple[Pose | None, tuple[float, float]]:
        """Return the last pose if it is recent enough, and how far the camera can be from there [m, rad]."""
        if self._last is None:
            return None, (0.0, 0.0)
        parameters = self.parameters
        seconds = (stamp - self._last[0]) / _SECOND
        if not 0.0 <= seconds <= parameters.last_pose_timeout:
            return None, (0.0, 0.0)
        last = self._last[1]
        return last.T_world_camera, (
            parameters.max_linear_speed * seconds + _DEVIATIONS * last.position_deviation,
            parameters.max_angular_speed * seconds + _DEVIATIONS * last.rotation_deviation,
        )


def _without_lines(observation: LineObservation, reason: str) -> LineObservation:
    """Return image lines for which no pose was found: whoever waits for 3-D lines learns that none come, and why."""
    return dataclasses.replace(
        observation, lines_camera=None, verdict=LinesVerdict.POOR, verdict_reason=f"no pose: {reason}"
    )
