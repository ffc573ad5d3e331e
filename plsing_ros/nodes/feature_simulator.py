# SPDX-License-Identifier: Apache-2.0
"""Node feature_simulator: the line features of a free-flying camera that moves by the twists it receives."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from std_msgs.msg import Header

from plsing_msgs.msg import LineFeatureArray
from plsing_ros.geometry import Pose
from plsing_ros.nodes import qos
from plsing_ros.nodes.conversions import fill_features, fill_stamp
from plsing_ros.nodes.main import run_node
from plsing_ros.nodes.simulator_node import SimulatorNode
from plsing_ros.parameters import SimulatorParameters
from plsing_ros.simulation.simulation import Simulation


class FeatureSimulatorNode(SimulatorNode[SimulatorParameters]):
    """Publishes line_features beside what every simulator does."""

    simulation: Simulation

    def __init__(self, **options: Any) -> None:
        super().__init__("feature_simulator", SimulatorParameters, **options)

    def advertise_view(self) -> None:
        """Create the publisher of line_features."""
        self._features_message = LineFeatureArray(header=Header(frame_id=self.parameters.camera_frame))
        self._features = self.advertise(LineFeatureArray, "line_features", qos.SENSOR_DATA)

    def configure(self) -> None:
        """Put the camera at its start."""
        self.simulation = Simulation(self.parameters)

    def activate(self) -> None:
        """Say what it is going to do."""
        parameters = self.parameters
        self.get_logger().info(
            f"{parameters.mode}, a frame each {parameters.time_step:g} s, noise {parameters.noise:g}; "
            f"{len(parameters.lines_points) // 3} lines in {parameters.scene_frame}; "
            f"{self.topics('cmd_twist', 'line_features')}"
        )

    def prepare(self, parameters: SimulatorParameters) -> Callable[[], None]:
        """Use a changed scene or noise from the next frame on, a changed start pose at the next reset."""
        return self.simulation.prepare(parameters)

    def camera_pose(self) -> Pose:
        """Return T_world_camera of the current frame."""
        return self.simulation.T_world_camera

    def publish_view(self, stamp: int) -> None:
        """Publish line_features."""
        fill_stamp(self._features_message.header.stamp, stamp)
        fill_features(self._features_message, self.simulation.observation)
        self._features.publish(self._features_message)


_EXAMPLES = """examples:
  share=$(ros2 pkg prefix --share plsing_ros)
  ros2 run plsing_ros feature_simulator --ros-args --params-file $share/config/paper_p4l.yaml
  ros2 run plsing_ros feature_simulator --ros-args --params-file $share/config/paper_p4l.yaml -p noise:=0.002
  ros2 service call /feature_simulator/reset std_srvs/srv/Trigger

All parameters with units and ranges: $share/config/feature_simulator.yaml"""


def main() -> int:
    """Run the node."""
    return run_node(FeatureSimulatorNode, __doc__.split("\n")[0], _EXAMPLES)


if __name__ == "__main__":
    sys.exit(main())
