# SPDX-License-Identifier: Apache-2.0
"""Parameters that the nodes which read features share, and those of a servo task that controller and monitor share."""

from __future__ import annotations

from dataclasses import dataclass

from plsing_ros.geometry import Pose
from plsing_ros.parameters.parameter_set import parameter
from plsing_ros.parameters.scene import SceneParameters, pose_from_parameters


@dataclass(frozen=True)
class FeatureParameters(SceneParameters):
    """The scene, and how far the clocks of those who see it may disagree."""

    future_tolerance: float = parameter(
        0.1,
        "future_tolerance",
        "Features stamped further ahead of the node clock than this are refused",
        unit="s",
        minimum=0.0,
        maximum=60.0,
    )


@dataclass(frozen=True)
class AnswerParameters(FeatureParameters):
    """The scene, and how old features may be for those who answer each."""

    features_timeout: float = parameter(
        0.2,
        "features_timeout",
        "Features older than this on the node clock are refused",
        unit="s",
        minimum=1e-3,
        maximum=60.0,
    )
    watchdog_period: float = parameter(
        0.05,
        "watchdog_period",
        "How often the age of the features is checked (wall clock)",
        unit="s",
        minimum=1e-3,
        maximum=10.0,
        live=False,
    )


@dataclass(frozen=True)
class TaskParameters(FeatureParameters):
    """The scene, how far the clocks may disagree, and the target."""

    target_position: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "target.position", "Camera centre at the target, in the scene frame: x, y, z", unit="m"
    )
    target_orientation: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0, 1.0),
        "target.orientation",
        "Orientation of the optical frame at the target, in the scene frame: unit quaternion x, y, z, w",
    )

    def target_pose(self) -> Pose:
        """Return T_world_camera at the target."""
        return pose_from_parameters("target", self.target_position, self.target_orientation)
