# SPDX-License-Identifier: Apache-2.0
"""From camera data in any order to a state for every image: what the node line_tracker does, without ROS."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array
from plsing_ros.errors import PlsingError
from plsing_ros.geometry import Pose
from plsing_ros.geometry.model import Model
from plsing_ros.geometry.tag import Tag
from plsing_ros.tracking.camera import PinholeCamera
from plsing_ros.tracking.tag_finder import TagFinder
from plsing_ros.tracking.tracker import LineTracker
from plsing_ros.tracking.tracking import Tracking, TrackingState

# An image that is darker or brighter than these all over shows nothing [grey levels].
_DARK, _BRIGHT = 8, 247


class SessionState(enum.Enum):
    """What the latest image, or the lack of one, means."""

    WAITING_FOR_CAMERA_INFO = "no calibration yet"
    WAITING_FOR_POSE = "no first pose yet"
    SEARCHING = "a first pose is given, the object not yet found"
    TRACKING = "lines can be used"
    WEAK = "lines can be used, with care"
    AMBIGUOUS = "another pose explains the edges as well"
    LOST = "the object, or the image, is not there"


_OF_TRACKING = {
    TrackingState.TRACKING: SessionState.TRACKING,
    TrackingState.WEAK: SessionState.WEAK,
    TrackingState.AMBIGUOUS: SessionState.AMBIGUOUS,
    TrackingState.LOST: SessionState.LOST,
}


@dataclass(frozen=True, eq=False)
class SessionReport:
    """A state with a sentence, and what was tracked.

    Attributes:
        state: What the image means.
        reason: Why, as a sentence; empty if TRACKING.
        tracking: The result; None where the image was not looked at.
    """

    state: SessionState
    reason: str
    tracking: Tracking | None = None

    @property
    def usable(self) -> bool:
        """Whether lines may be acted on."""
        return self.state in (SessionState.TRACKING, SessionState.WEAK)


class TrackingSession:
    """Keeps a LineTracker through calibration, first pose, loss and search.

    Args:
        model: The object.
        use_points: See LineTracker.
        gamma: See LineTracker.
        max_repeats: Images in a row that are equal in every pixel, beyond which the camera is taken for frozen.
        tag: Where a tag is that gives the first pose, and a new one after a loss.
        readout_time: See LineTracker.
        edge_std: See LineTracker.

    Raises:
        ParameterError: If the tag cannot be looked for.
    """

    def __init__(
        self,
        model: Model,
        use_points: bool = True,
        gamma: float = 2.2,
        max_repeats: int = 30,
        tag: Tag | None = None,
        readout_time: float = 0.0,
        edge_std: Array | None = None,
    ) -> None:
        self._model, self._max_repeats = model, max_repeats
        self._options: dict[str, Any] = {
            "use_points": use_points,
            "gamma": gamma,
            "readout_time": readout_time,
            "edge_std": edge_std,
        }
        self._tag = None if tag is None else TagFinder(tag)
        self._tracker: LineTracker | None = None
        self._camera_problem = "no camera_info has come"
        self._pose: Pose | None = None
        self._found = False
        self._repeats = 0
        self._last: npt.NDArray[np.uint8] | None = None

    @property
    def camera(self) -> PinholeCamera | None:
        """The camera in use."""
        return None if self._tracker is None else self._tracker.camera

    @property
    def T_world_camera(self) -> Pose | None:
        """The last pose that was found or given."""
        return self._pose

    def set_camera(self, camera: PinholeCamera) -> None:
        """Use a calibration; another one than before begins anew from the last pose."""
        if self.camera == camera:
            return
        self._tracker = LineTracker(self._model, camera, **self._options)
        self._found = False
        if self._pose is not None:
            self._tracker.start(self._pose)

    def refuse_camera(self, reason: str) -> None:
        """Forget the calibration, as a new one cannot be used."""
        self._tracker, self._camera_problem = None, reason

    def set_pose(self, pose: Pose) -> None:
        """Search for the object round a pose, from the next image on.

        Args:
            pose: T_world_camera.
        """
        self._pose, self._found = pose, False
        if self._tracker is not None:
            self._tracker.start(pose)

    def process(
        self, image: npt.NDArray[np.uint8], predicted: Pose | None = None, time: float | None = None
    ) -> SessionReport:
        """Return what an image means; never raises for what an image holds.

        Args:
            image: Grey, shape (height, width).
            predicted: T_world_camera by the twist that was commanded since the last image, if known.
            time: Of the image, on any clock, if known [s].
        """
        if self._tracker is None:
            return SessionReport(SessionState.WAITING_FOR_CAMERA_INFO, self._camera_problem)
        problem = self._problem(image)
        if self._pose is None and self._tag is None:
            return SessionReport(SessionState.WAITING_FOR_POSE, "no initial_pose has come")
        if problem:
            return SessionReport(SessionState.LOST if self._found else SessionState.SEARCHING, problem)
        try:
            tracking = self._tracked(self._tracker, image, predicted if self._found else None, time)
        except PlsingError as error:
            return SessionReport(SessionState.LOST, str(error))
        if tracking is None:
            return SessionReport(SessionState.WAITING_FOR_POSE, "no initial_pose has come, and the tag is not seen")
        state, reason = _OF_TRACKING[tracking.state], tracking.reason
        if state is SessionState.LOST:
            reason = f"{reason}; searching from the last good pose"
            state = state if self._found else SessionState.SEARCHING
        elif state is not SessionState.AMBIGUOUS:
            self._found = True
            self._pose = tracking.T_world_camera
        return SessionReport(state, reason, tracking)

    def _tracked(
        self, tracker: LineTracker, image: npt.NDArray[np.uint8], predicted: Pose | None, time: float | None
    ) -> Tracking | None:
        """Return what the tracker says; where it is lost, from the tag; None where it has nothing to begin with."""
        tracking = None if self._pose is None else tracker.track(image, predicted, time)
        if self._tag is None or (tracking is not None and tracking.state is not TrackingState.LOST):
            return tracking
        for pose in self._tag.find(image, tracker.camera):
            tracker.start(pose)
            tracking = tracker.track(image, None, time)
            if tracking.state is not TrackingState.LOST:
                break
        return tracking

    def _problem(self, image: npt.NDArray[np.uint8]) -> str:
        """Return why an image shows nothing, or an empty text."""
        camera = self._tracker.camera if self._tracker is not None else None
        if camera is not None and image.shape != (camera.height, camera.width):
            height, width = image.shape
            return f"the image is {width} x {height}, the calibration is for {camera.width} x {camera.height}"
        # A frozen driver repeats an image to the last bit; noise makes that impossible for a camera that lives.
        same = self._last is not None and self._last.shape == image.shape and np.array_equal(self._last, image)
        self._repeats = self._repeats + 1 if same else 0
        self._last = image
        if self._repeats >= self._max_repeats:
            return f"the image has been the same in every pixel {self._repeats + 1} times: the camera stands still"
        if int(image.max()) <= _DARK:
            return f"the image is black: no pixel is above {_DARK} of 255"
        if int(image.min()) >= _BRIGHT:
            return f"the image is overexposed: no pixel is below {_BRIGHT} of 255"
        return ""
