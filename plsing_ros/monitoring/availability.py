# SPDX-License-Identifier: Apache-2.0
"""Whether observations come and can be used, and what is said while they do not."""

from __future__ import annotations

import re
from collections.abc import Callable

from plsing_ros.features import LineObservation, LinesVerdict
from plsing_ros.features.target import MINIMUM_LINES
from plsing_ros.levels import Level
from plsing_ros.monitoring.assessment import Assessment
from plsing_ros.parameters import MonitorParameters
from plsing_ros.stamp_filter import StampFilter

_SECOND = 1_000_000_000
_DISABLED = "switched off by ~/enable"
# Kind of an alert.
_NO_POSE = "no pose"


class Availability:
    """Stamps, dropouts and silence of the features, and the assessments that say so.

    Attributes:
        held: What was said of the latest features that could be used, or None if it holds no more.
    """

    def __init__(self, parameters: MonitorParameters, forget: Callable[[], None]) -> None:
        """Begin; what was before says nothing about what comes next whenever `forget` is called."""
        self.held: Assessment | None = None
        self._forget = forget
        self._stamp_filter = StampFilter("features", parameters.features_timeout, parameters.future_tolerance)
        self._refused_as = Level.STALE
        self._missing = 0
        self._blind_since: int | None = None
        self.use(parameters)

    def use(self, parameters: MonitorParameters) -> None:
        """Judge by other parameters from now on."""
        self._stamp_filter.timeout = parameters.features_timeout
        self._stamp_filter.future_tolerance = parameters.future_tolerance
        self._dropout_cycles, self._no_pose_timeout = parameters.dropout_cycles, parameters.no_pose_timeout

    def jumps_back(self, now: int) -> bool:
        """Return whether the clock has jumped back to now [ns]; what was stamped by it is forgotten then."""
        if not self._stamp_filter.follow_clock(now):
            return False
        self.end_blindness()
        self.forget()
        return True

    def forget(self) -> None:
        """Begin anew."""
        self.held = None
        self._forget()

    def end_blindness(self) -> None:
        """Count the time that a camera has been without a pose from now on."""
        self._blind_since = None

    def refusal(self, stamp: int, now: int) -> str | None:
        """Return why features with this stamp [ns] must not be used now [ns], or None and take note of them."""
        problem = self._stamp_filter.refusal(stamp, now)
        if problem is not None:
            self._refused_as = Level.STALE
        return problem

    def hold(self, assessment: Assessment) -> Assessment:
        """Take and return what is said of features that could be used."""
        self._missing, self._blind_since, self.held = 0, None, assessment
        return assessment

    def hold_or_refuse(self, reason: str, stamp: int, observation: LineObservation, has_target: bool) -> Assessment:
        """Return what was said last while lines or the pose are missing for a few frames, else UNOBSERVABLE.

        CRITICAL once the camera of a task that has a target has seen lines for long and no pose was found: the robot
        stands still.
        """
        self._missing += 1
        held, missing = self.held, self._missing
        blind = self._blind_for(observation, stamp) if has_target else 0.0
        has_source = observation.lines_camera is not None or observation.verdict is not LinesVerdict.GIVEN
        if held is None or not has_source or missing >= self._dropout_cycles:
            refused = self.unusable(reason, stamp)
            if not 0.0 < self._no_pose_timeout <= blind:
                return refused
            words = f"not on its way to the target: lines are seen, but no pose for {blind:.1f} s; {reason}"
            return refused._replace(level=Level.CRITICAL, explain=lambda: words, kind=_NO_POSE)
        return held._replace(
            stamp=stamp, explain=lambda: f"{held.reason}; held for {missing} frame(s), in which {reason}"
        )

    def _blind_for(self, observation: LineObservation, stamp: int) -> float:
        """Return since when lines are seen without their 3-D lines [s]; 0: they are not."""
        if self._blind_since is None:
            if observation.lines_camera is not None or len(observation.usable_ids) < MINIMUM_LINES:
                return 0.0
            self._blind_since = stamp
        return (stamp - self._blind_since) / _SECOND

    def silence(self, now: int) -> Assessment | None:
        """Return what to say when no features can be used now [ns], or None if the last ones are recent enough.

        Its level is that of the messages which come and are refused, if any do, else STALE.
        """
        reason = self._stamp_filter.silence(now)
        if reason is None:
            return None
        return self._unknown(Level.STALE if self._stamp_filter.last_problem is None else self._refused_as, reason, now)

    def unusable(self, reason: str, stamp: int) -> Assessment:
        """Return the UNOBSERVABLE assessment of features that cannot be used."""
        self._stamp_filter.note_problem(reason)
        self._refused_as = Level.UNOBSERVABLE
        return self._unknown(Level.UNOBSERVABLE, reason, stamp)

    def disabled(self, stamp: int) -> Assessment:
        """Return what is said while the monitor is switched off."""
        return self._unknown(Level.DISABLED, _DISABLED, stamp)

    def _unknown(self, level: Level, reason: str, stamp: int) -> Assessment:
        self.forget()
        kind = re.sub(r"[0-9.e+-]+", "", self._stamp_filter.last_problem or reason)
        return Assessment(level, lambda: reason, stamp, kind=kind)
