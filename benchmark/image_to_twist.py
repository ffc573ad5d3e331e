# SPDX-License-Identifier: Apache-2.0
"""From an image to the twist that answers it: line tracker in one process, pose estimator and controller in another.

    python3 -m benchmark image_to_twist

Images of 640 x 480 pixels are drawn beforehand; each is published when the one before was answered, 50 ms apart.
"""

from __future__ import annotations

import time

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from sensor_msgs.msg import CameraInfo, Image

from plsing_ros.nodes import qos
from plsing_ros.nodes.conversions import header, nanoseconds
from plsing_ros.nodes.image_conversions import camera_info_message, image_message
from plsing_ros.nodes.pose_conversions import camera_pose_message
from plsing_ros.parameters.arm_simulator import ArmSimulatorParameters
from plsing_ros.parameters.config_files import config_file
from plsing_ros.parameters.parameter_file import read_parameters
from plsing_ros.simulation.arm_simulation import ArmSimulation
from plsing_ros.testing.harness import Harness
from plsing_ros.testing.node_processes import NodeProcesses

_SCENE = "camera_arm.yaml"
_FRAME = "camera_optical_frame"
_IMAGES = 300
_PERIOD = 0.05  # [s]
_PATIENCE = 0.5  # for an answer [s]


def main(quick: bool = False) -> None:
    """Print how long answers took."""
    file = config_file(_SCENE)
    simulation = ArmSimulation(ArmSimulatorParameters.from_values(read_parameters(file, "arm_simulator")))
    pictures = []
    for _ in range(20):
        simulation.look()
        pictures.append(simulation.image)
    waited: list[float] = []
    missing = 0
    with Harness(log_level="FATAL") as ros, NodeProcesses(ros.environment()) as processes:
        processes.start("line_tracker", [file])
        remap = {"controller:line_features": "completed_line_features"}
        processes.start("container", [file], remap=remap, arguments=["pose_estimator", "controller"])
        answers: dict[int, tuple[float, bool]] = {}

        def on_twist(message: TwistStamped) -> None:
            v, w = message.twist.linear, message.twist.angular
            moves = any((v.x, v.y, v.z, w.x, w.y, w.z))
            answers.setdefault(nanoseconds(message.header.stamp), (time.perf_counter(), moves))

        ros.node.create_subscription(TwistStamped, "cmd_twist", on_twist, qos.COMMAND_INPUT)
        images = ros.node.create_publisher(Image, "image", qos.SENSOR_DATA)
        infos = ros.node.create_publisher(CameraInfo, "camera_info", qos.SENSOR_DATA)
        first = ros.node.create_publisher(PoseWithCovarianceStamped, "initial_pose", qos.STATUS)

        def ready() -> bool:
            processes.check()
            names = ros.node.get_node_names()
            return first.get_subscription_count() > 0 and {"pose_estimator", "controller"} <= set(names)

        ros.spin_until(ready, "the nodes to start", 60.0)
        ros.spin_for(1.0)
        first.publish(camera_pose_message(simulation.T_world_camera, header(time.time_ns(), "world")))
        for number in range(-20, 60 if quick else _IMAGES):
            stamp = ros.node.get_clock().now().nanoseconds
            head = header(stamp, _FRAME)
            message = image_message(pictures[number % len(pictures)], head)
            if number < 0:
                infos.publish(camera_info_message(simulation.camera, head))
            begin = time.perf_counter()
            images.publish(message)
            while stamp not in answers and time.perf_counter() - begin < _PATIENCE:
                ros.spin_for(0.002)
            if number >= 0:
                at, moves = answers.get(stamp, (float("nan"), False))
                missing += not moves
                if moves:
                    waited.append(at - begin)
            ros.spin_for(max(0.0, _PERIOD - (time.perf_counter() - begin)))
    simulation.close()
    middle, ninety_nine, most = 1e3 * np.percentile(waited, [50, 99, 100])
    print(
        f"{len(waited)} images of 640 x 480 answered by a moving twist, {missing} not; from publish() to the twist's "
        f"arrival in this process: {middle:.1f} ms in the median, {ninety_nine:.1f} ms for 99 %, {most:.1f} ms at most"
    )
