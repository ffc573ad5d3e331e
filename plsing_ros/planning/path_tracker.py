# SPDX-License-Identifier: Apache-2.0
"""The path to the target: planned when there is none, followed, and planned anew when the camera is elsewhere."""

from __future__ import annotations

import math

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.errors import ObservationError
from plsing_ros.features import LineObservation
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.line_scale import LineScale
from plsing_ros.parameters import ControllerParameters
from plsing_ros.planning.camera_path import SpeedLimits
from plsing_ros.planning.detour import DetourOptions, Plan
from plsing_ros.planning.path_follower import PathFollower, Reference
from plsing_ros.planning.planner import Answer, Planner, PlanNow
from plsing_ros.planning.straight_way import KnownPose, plan_by_risk
from plsing_ros.singularities.scene_loci import SceneLoci

_SECOND = 1_000_000_000
# After a longer gap between two observations the path goes on as if it had been this long [s].
_LONGEST_STEP = 0.5
_SAME = 1e-6  # [m], [rad]
# Share of the speed limits that a path may use: the rest is for the feedback.
_ROOM = 0.9
# A new path is planned after the camera has been elsewhere for so long [s], and so many times for one target.
_PERSISTENCE = 0.3
_MAX_REPLANS = 5


class PathTracker:
    """Plan and follower for one target.

    Attributes:
        plan: The plan in force, or None before the first observation.
    """

    def __init__(
        self, loci: SceneLoci, T_world_target: Pose, lines_target: LineSet, planner: Planner | None = None
    ) -> None:
        """Begin without a plan.

        Args:
            loci: Of the scene: what to keep clear of.
            T_world_target: Where to go.
            lines_target: What is seen from there, in the camera frame there. The path is followed by the images of
                these lines and not of the scene's, so that it ends where they are seen, also where they do not fit the
                scene.
            planner: Who makes the plans; None: they are made when they are needed, and waited for.
        """
        self.plan: Plan | None = None
        self._planner = planner or PlanNow()
        # A plan that is being made, and from where.
        self._planning: tuple[Answer, Pose] | None = None
        self._loci = loci
        self._target = T_world_target
        self._lines = lines_target.transformed(T_world_target, loci.lines.frame)
        self._scale = LineScale(loci.lines)
        self._follower: PathFollower | None = None
        # Where the camera should be: on the path, or where the plan was refused.
        self._expected = T_world_target
        self._stamp = 0
        # Whether the pose was known beside the image when the plan was asked for: a filter begins with an image.
        self._was_known = False
        # Since when the camera is elsewhere, and how many plans were made because it was.
        self._elsewhere_since: int | None = None
        self._replans = 0

    def leads_to(self, T_world_target: Pose) -> bool:
        """Return whether this is the target, to rounding: the same message sent again is no new target."""
        return T_world_target.is_close(self._target, _SAME)

    def reference(
        self,
        parameters: ControllerParameters,
        seen: LineSet,
        image: Array,
        stamp: int,
        factor: float,
        known: KnownPose | None = None,
    ) -> tuple[Reference, Pose] | None:
        """Return what the path asks for now and where the camera is, or None if there is no path to follow.

        Then a plan is being made, says not to go, or says to go straight by the pose.

        Args:
            parameters: How to plan.
            seen: Lines in the camera's optical frame, which are in the target.
            image: Their image lines, shape (3n,).
            stamp: Of the observation [ns].
            factor: What was left of the speed in the latest cycle, in [0, 1]: the path waits for a camera held back.
            known: How well the pose is known beside the image, if it is.

        Raises:
            ObservationError: If the lines do not tell where the camera is, or it is elsewhere than on its path and no
                new one is made yet, or any more; or if too few lines have an image on the path.
        """
        if self.goes_by_pose:
            return None
        pose = self._camera_pose(parameters, seen)
        if pose is None:
            raise ObservationError(
                "the observed lines do not fit the scene, so the camera's place on the path is unknown"
            )
        becomes_known = known is not None and not self._was_known and parameters.detour_risk_margin > 0.0
        if self._planning is None and (
            self.plan is None
            or becomes_known
            or self._is_to_replan(pose, seen.ids, image, stamp, parameters.detour_replan_distance)
        ):
            self._was_known = known is not None
            options = detour_options(parameters)
            asked = self._loci.singular_set, pose, self._target, options, known
            self._planning = self._planner.ask(plan_by_risk, *asked), pose
        if self._planning is not None and not self._take_plan(stamp):
            return None
        if self._follower is None:
            return None
        self._follower.advance(factor * min((stamp - self._stamp) / _SECOND, _LONGEST_STEP))
        self._stamp = stamp
        reference = self._follower.reference()
        self._expected = reference.T_world_camera
        return reference, pose

    @property
    def is_planning(self) -> bool:
        """Whether a plan is being made: nothing should move meanwhile."""
        return self._planning is not None

    @property
    def goes_by_pose(self) -> bool:
        """Whether the plan in force is to go straight by the pose."""
        return self._planning is None and self.plan is not None and self.plan.by_pose

    def _take_plan(self, stamp: int) -> bool:
        """Put the plan in force that was asked for, if it is ready.

        Raises:
            ObservationError: If it could not be made; it is asked for again at the next frame.
        """
        assert self._planning is not None
        answer, start = self._planning
        try:
            plan = answer.result()
        except ObservationError:
            self._planning = None
            raise
        if plan is None:
            return False
        self._planning, self.plan = None, plan
        self._follower = None if plan.path is None or plan.by_pose else PathFollower(plan.path, self._lines)
        self._expected, self._stamp = start, stamp
        return True

    def _camera_pose(self, parameters: ControllerParameters, seen: LineSet) -> Pose | None:
        """Return T_world_camera by lines of the right scale.

        A target that was shown has the wrong scale in it too, and is reached by it.
        """
        pose = self._loci.camera_pose(seen)
        largest = parameters.detour_max_scale_error
        if pose is None or largest == 0.0 or parameters.target_source != "pose":
            return pose
        self._scale.add(seen, pose.rotation)
        factor = self._scale.factor(largest)
        if factor == 1.0:
            return pose
        return self._loci.camera_pose(LineSet(seen.direction, seen.moment / factor, seen.frame, seen.ids))

    def _is_to_replan(self, pose: Pose, ids: tuple[int, ...], image: Array, stamp: int, distance: float) -> bool:
        """Return whether the camera has been elsewhere for long enough: a pose that jumps is no reason for a new plan.

        Raises:
            ObservationError: While it is elsewhere and that is not so.
        """
        if not self._is_elsewhere(pose, ids, image, distance):
            self._elsewhere_since = None
            return False
        if self._elsewhere_since is None or stamp < self._elsewhere_since:
            self._elsewhere_since = stamp
        off = float(np.linalg.norm(pose.translation - self._expected.translation))
        where = f"the camera is {off:.3g} m from its place on the path, allowed are {distance:g} m"
        if self._replans >= _MAX_REPLANS:
            raise ObservationError(
                f"{where}, and {_MAX_REPLANS} new paths have not helped: map, 3-D lines or motion are wrong; "
                "set the target again to go on"
            )
        if stamp - self._elsewhere_since < _PERSISTENCE * _SECOND:
            raise ObservationError(f"{where}: a new path is planned after {_PERSISTENCE:g} s")
        self._replans += 1
        self._elsewhere_since = None
        return True

    def _is_elsewhere(self, pose: Pose, ids: tuple[int, ...], image: Array, distance: float) -> bool:
        """Return whether the camera is farther than a distance from its place on the path.

        A pose may be as far off by itself, with a wrong map or 3-D lines at wrong depths. A new path from there would
        lead away from where the image leads, and be given up in turn: so the image must fit the pose better than the
        place.
        """
        if float(np.linalg.norm(pose.translation - self._expected.translation)) <= distance:
            return False
        if self._follower is None:
            return True
        return self._misfit(pose, ids, image) < self._misfit(self._expected, ids, image)

    def _misfit(self, pose: Pose, ids: tuple[int, ...], image: Array) -> float:
        """Return the root mean square difference of image lines to those that have an image from a pose."""
        there = LineObservation.of_lines(self._lines.transformed(pose.inverse(), "camera"))
        row_of = {i: row for row, i in enumerate(ids)}
        known = [row for row, i in enumerate(there.usable_ids) if i in row_of]
        rows = [row_of[there.usable_ids[row]] for row in known]
        if not rows:
            return math.inf
        apart = image.reshape(-1, 3)[rows] - there.usable_image_lines[known]
        return float(np.sqrt(np.mean(np.square(apart))))


def detour_options(parameters: ControllerParameters) -> DetourOptions:
    """Return how to plan."""
    linear, angular = parameters.speed_limits
    return DetourOptions(
        margin=parameters.detour_margin,
        accept_singular_target=parameters.min_target_condition == 0.0,
        half_view=(parameters.half_view[0], parameters.half_view[1]),
        risk_margin=parameters.detour_risk_margin,
        limits=SpeedLimits(
            min(parameters.detour_linear_speed, _ROOM * linear), min(parameters.detour_angular_speed, _ROOM * angular)
        ),
    )
