# SPDX-License-Identifier: Apache-2.0
"""Images of a known object to a motion: line tracker, pose estimator, controller and monitor.

ros2 launch plsing_ros line_tracker.launch.py params_file:=part.yaml image:=/camera/image_raw \\
    camera_info:=/camera/camera_info
"""

from plsing_ros.nodes.launch_description import COMPLETED, describe_nodes


def generate_launch_description():
    return describe_nodes(
        "line_tracker",
        "pose_estimator",
        "singularity_monitor",
        "controller",
        remappings={"singularity_monitor": COMPLETED, "controller": COMPLETED},
        topics={"line_tracker": ("image", "camera_info", "initial_pose")},
        scene="camera_arm.yaml",
    )
