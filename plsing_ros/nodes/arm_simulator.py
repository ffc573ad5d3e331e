# SPDX-License-Identifier: Apache-2.0
"""Node arm_simulator: a six-axis arm with a camera at its wrist that moves by the twists it receives."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from sensor_msgs.msg import CameraInfo, Image, JointState

from plsing_ros.geometry import Pose
from plsing_ros.nodes import qos
from plsing_ros.nodes.conversions import header
from plsing_ros.nodes.image_conversions import camera_info_message, image_message
from plsing_ros.nodes.main import run_node
from plsing_ros.nodes.simulator_node import SimulatorNode
from plsing_ros.parameters.arm_simulator import ArmSimulatorParameters
from plsing_ros.simulation.arm import JOINTS
from plsing_ros.simulation.arm_simulation import ArmSimulation


class ArmSimulatorNode(SimulatorNode[ArmSimulatorParameters]):
    """Publishes image, camera_info and joint_states beside what every simulator does."""

    takes_images = True
    simulation: ArmSimulation

    def __init__(self, **options: Any) -> None:
        super().__init__("arm_simulator", ArmSimulatorParameters, **options)

    def advertise_view(self) -> None:
        """Create the publishers of camera and joints."""
        self._images = self.advertise(Image, "image", qos.SENSOR_DATA)
        self._infos = self.advertise(CameraInfo, "camera_info", qos.SENSOR_DATA)
        self._joints = self.advertise(JointState, "joint_states", qos.SENSOR_DATA)

    def configure(self) -> None:
        """Put the arm at its start."""
        self.simulation = ArmSimulation(self.parameters)

    def activate(self) -> None:
        """Say what it is going to do."""
        parameters = self.parameters
        self.get_logger().info(
            f"{parameters.mode}, an image each {parameters.time_step:g} s, {self.simulation.renderer}; "
            f"{self.topics('cmd_twist', 'image')}"
        )

    def cleanup(self) -> None:
        """Give back what the pictures are drawn in."""
        self.simulation.close()

    def prepare(self, parameters: ArmSimulatorParameters) -> Callable[[], None]:
        """Use changed light, noise and limits from the next frame on, a changed start pose at the next reset."""
        return self.simulation.prepare(parameters)

    def camera_pose(self) -> Pose:
        """Return T_world_camera of the current frame."""
        return self.simulation.T_world_camera

    def publish_view(self, stamp: int) -> None:
        """Publish the image with its calibration, and the joints."""
        simulation, of_camera = self.simulation, header(stamp, self.parameters.camera_frame)
        self._infos.publish(camera_info_message(simulation.camera, of_camera))
        self._images.publish(image_message(simulation.image, of_camera))
        self._joints.publish(
            JointState(
                header=header(stamp, ""),
                name=list(JOINTS),
                position=simulation.joints.tolist(),
                velocity=simulation.speeds.tolist(),
            )
        )


_EXAMPLES = """examples:
  share=$(ros2 pkg prefix --share plsing_ros)
  ros2 run plsing_ros arm_simulator --ros-args --params-file $share/config/camera_arm.yaml
  ros2 run plsing_ros arm_simulator --ros-args --params-file $share/config/camera_arm.yaml -p light:=0.3
  ros2 service call /arm_simulator/reset std_srvs/srv/Trigger

MuJoCo draws where it is installed (pip install 'mujoco>=3.1,<3.4', sudo apt install libosmesa6), else OpenCV.
All parameters with units and ranges: $share/config/arm_simulator.yaml"""


def main() -> int:
    """Run the node."""
    return run_node(ArmSimulatorNode, __doc__.split("\n")[0], _EXAMPLES)


if __name__ == "__main__":
    sys.exit(main())
