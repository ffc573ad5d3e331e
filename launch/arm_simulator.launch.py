# SPDX-License-Identifier: Apache-2.0
"""An arm with a camera at its wrist, alone, beside line_tracker.launch.py; its true pose is on true_camera_pose.

ros2 launch plsing_ros arm_simulator.launch.py params_file:=part.yaml
"""

from plsing_ros.nodes.launch_description import describe_nodes


def generate_launch_description():
    return describe_nodes(
        "arm_simulator",
        remappings={"arm_simulator": {"camera_pose": "true_camera_pose"}},
        scene="camera_arm.yaml",
    )
