"""The monitor's cycle without ROS: an observation in, an assessment out."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from plsing_ros.arrays import Array
from plsing_ros.errors import ObservationError
from plsing_ros.features import Conditioning, LineObservation, conditioning, interaction_matrix
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters import MonitorParameters
from plsing_ros.servoing.freshness import Freshness
from plsing_ros.servoing.levels import Indicator, Level, worst
from plsing_ros.servoing.line_servo import MINIMUM_LINES
from plsing_ros.singularities import Kind, LocusDistance, SingularSet, singular_set

_SECOND = 1_000_000_000
# Poses and features come on two topics: enough poses to find the one that belongs to features that were overtaken.
_REMEMBERED_POSES = 10


@dataclass(frozen=True, eq=False)
class Assessment:
    """How near to a singularity the camera is.

    Attributes:
        level: Level of concern.
        reason: Why, in words.
        stamp: Of the features it speaks of [ns]; of the clock when there are none.
        line_count: Lines that took part.
        conditioning: Of the interaction matrix, or None without usable features.
        inverse_condition_number_rate: [1/s], or None if there was no earlier value.
        locus_distances: Distances of the camera centre [m] in the order of SingularSet.locus_names, shape (m,), or
            None if the camera position is not known.
        nearest: The nearest locus other than the observed lines, or None if there is none or the position is not known.
    """

    level: Level
    reason: str
    stamp: int
    line_count: int = 0
    conditioning: Conditioning | None = None
    inverse_condition_number_rate: float | None = None
    locus_distances: Array | None = None
    nearest: LocusDistance | None = None


class SingularityMonitor:
    """Assesses each observation against the singular set of the scene, computed once for each scene.

    Attributes:
        found: The singular set of the scene.
    """

    def __init__(self, parameters: MonitorParameters) -> None:
        self.found: SingularSet = singular_set(parameters.lines())
        self._parameters = parameters
        self._freshness = Freshness("features", parameters.features_timeout, parameters.future_tolerance)
        self._indicator_levels: list[Level] = []
        self._last: Assessment | None = None
        self._poses: deque[tuple[int, Pose]] = deque(maxlen=_REMEMBERED_POSES)

    @property
    def parameters(self) -> MonitorParameters:
        """The parameters in force; setting them takes effect at the next assessment."""
        return self._parameters

    @parameters.setter
    def parameters(self, parameters: MonitorParameters) -> None:
        before = self._parameters
        scene = (parameters.lines_points, parameters.lines_directions, parameters.lines_ids)
        if scene != (before.lines_points, before.lines_directions, before.lines_ids):
            self.found = singular_set(parameters.lines())
        self._freshness.timeout = parameters.features_timeout
        self._freshness.future_tolerance = parameters.future_tolerance
        self._parameters = parameters

    def receive_pose(self, T_world_camera: Pose, stamp: int) -> None:
        """Take the camera's pose in the scene frame at a stamp [ns], for features of about that time."""
        self._poses.append((stamp, T_world_camera))

    def forget_poses(self) -> None:
        """Trust no pose received so far: the latest one was refused."""
        self._poses.clear()

    def assess(self, observation: LineObservation, stamp: int, now: int) -> Assessment | None:
        """Return the assessment of an observation, or None if it is refused (too old, out of order) among good ones.

        Args:
            observation: What the camera sees, with 3-D lines.
            stamp: Of the observation [ns].
            now: Of the node clock [ns].
        """
        refusal = self._freshness.refusal(stamp, now)
        if refusal is not None:
            # One bad message among good ones changes nothing; a stream of them is as good as silence.
            silence = self._freshness.silence(now)
            return None if silence is None else self._remember(Assessment(Level.STALE, silence, now))
        try:
            lines = self._usable_lines(observation)
        except ObservationError as error:
            return self.unusable(str(error), stamp)
        parameters = self.parameters
        numbers = conditioning(interaction_matrix(lines), parameters.characteristic_length)
        inverse = numbers.inverse_condition_number
        indicators = [
            Indicator(
                inverse,
                parameters.warn_condition,
                parameters.critical_condition,
                f"inverse condition number {inverse:.4g}",
            )
        ]
        distances, nearest = None, None
        camera_center = self._camera_center(stamp)
        if camera_center is not None:
            distances, nearest = self._distances(camera_center)
            if nearest is not None:
                indicators.append(
                    Indicator(
                        nearest.distance,
                        parameters.warn_distance,
                        parameters.critical_distance,
                        f"distance {nearest.distance:.3f} m from {nearest.name}",
                        " m",
                    )
                )
        previous = self._indicator_levels + [Level.OK] * (len(indicators) - len(self._indicator_levels))
        level, reason, self._indicator_levels = worst(indicators, parameters.hysteresis, previous[: len(indicators)])
        if self.found.singular_everywhere:
            level, reason = Level.UNOBSERVABLE, f"the scene is singular for every camera: {self.found.description}"
        if level == Level.OK:
            reason = f"inverse condition number {inverse:.4g}"
        if camera_center is None:
            reason += f"; distances not known: no camera_pose within {parameters.pose_tolerance:g} s of the features"
        elif nearest is not None and nearest.name not in reason:
            reason += f"; {nearest.distance:.3f} m from {nearest.name}"
        return self._remember(
            Assessment(level, reason, stamp, len(lines), numbers, self._rate(inverse, stamp), distances, nearest)
        )

    def silence(self, now: int) -> Assessment | None:
        """Return the STALE assessment if no usable features have come for too long (now in ns), else None."""
        reason = self._freshness.silence(now)
        return None if reason is None else self._remember(Assessment(Level.STALE, reason, now))

    def unusable(self, reason: str, stamp: int) -> Assessment:
        """Return the UNOBSERVABLE assessment of features that cannot be used."""
        self._freshness.note_problem(reason)
        return self._remember(Assessment(Level.UNOBSERVABLE, reason, stamp))

    def _usable_lines(self, observation: LineObservation) -> LineSet:
        unknown = sorted(set(observation.ids) - set(self.found.lines.ids))
        if unknown:
            raise ObservationError(
                f"line id {unknown[0]} is not in the scene, whose ids are {list(self.found.lines.ids)}"
            )
        if observation.lines_camera is None and observation.usable_ids:
            raise ObservationError("features have no 3-D lines (directions and moments are empty)")
        if observation.lines_camera is None or len(observation.lines_camera) < MINIMUM_LINES:
            raise ObservationError(
                f"{len(observation.usable_ids)} of {len(observation.ids)} lines are usable "
                f"({list(observation.usable_ids)}); at least {MINIMUM_LINES} are needed"
            )
        return observation.lines_camera

    def _camera_center(self, stamp: int) -> Array | None:
        if not self._poses:
            return None
        pose_stamp, T_world_camera = min(self._poses, key=lambda each: abs(each[0] - stamp))
        near = abs(pose_stamp - stamp) <= self.parameters.pose_tolerance * _SECOND
        return T_world_camera.translation if near else None

    def _distances(self, camera_center: Array) -> tuple[Array, LocusDistance | None]:
        arrays = self.found.distance_arrays(camera_center)
        singular = [row for row, kind in enumerate(self.found.locus_kinds) if kind is not Kind.OBSERVED_LINE]
        if not singular:
            return arrays.distance, None
        row = min(singular, key=lambda each: float(arrays.distance[each]))
        return arrays.distance, LocusDistance(
            self.found.locus_kinds[row],
            self.found.locus_names[row],
            float(arrays.distance[row]),
            arrays.closest_point[row],
        )

    def _rate(self, inverse: float, stamp: int) -> float | None:
        if self._last is None or self._last.conditioning is None or stamp <= self._last.stamp:
            return None
        change = inverse - self._last.conditioning.inverse_condition_number
        return change / ((stamp - self._last.stamp) / _SECOND)

    def _remember(self, assessment: Assessment) -> Assessment:
        self._last = assessment
        return assessment
