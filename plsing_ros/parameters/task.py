"""Parameters of a servo task that controller and monitor share: where to, and which features count as present."""

from __future__ import annotations

from dataclasses import dataclass

from plsing_ros.geometry import Pose
from plsing_ros.parameters.parameter_set import parameter
from plsing_ros.parameters.scene import SceneParameters, pose_from_parameters


@dataclass(frozen=True)
class TaskParameters(SceneParameters):
    """The scene, the target in it, and how far the clocks may disagree."""

    target_position: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "target.position", "Camera centre at the target, in the scene frame: x, y, z", unit="m"
    )
    target_orientation: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0, 1.0),
        "target.orientation",
        "Orientation of the optical frame at the target, in the scene frame: unit quaternion x, y, z, w",
    )
    future_tolerance: float = parameter(
        0.1,
        "future_tolerance",
        "Features stamped further ahead of the node clock than this are refused",
        unit="s",
        minimum=0.0,
        maximum=60.0,
    )

    def target_pose(self) -> Pose:
        """Return T_world_camera at the target."""
        return pose_from_parameters("target", self.target_position, self.target_orientation)
