# SPDX-License-Identifier: Apache-2.0
"""From images to line features: where a known object with straight edges is, and which lines a camera sees of it.

camera.py: the camera. tracker.py: edges and points put together. points.py: the second cue. support.py: the verdict.
"""

from plsing_ros.tracking.camera import PinholeCamera
from plsing_ros.tracking.tracker import LineTracker
from plsing_ros.tracking.tracking import Tracking, TrackingState

__all__ = ["LineTracker", "PinholeCamera", "Tracking", "TrackingState"]
