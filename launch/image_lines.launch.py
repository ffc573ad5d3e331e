# SPDX-License-Identifier: Apache-2.0
"""Image lines of a tracker to a motion: pose estimator, controller and monitor, which use the estimated 3-D lines.

ros2 launch plsing_ros image_lines.launch.py params_file:=my.yaml container:=true
"""

from plsing_ros.nodes.launch_description import COMPLETED, describe_nodes


def generate_launch_description():
    return describe_nodes(
        "pose_estimator",
        "singularity_monitor",
        "controller",
        remappings={"singularity_monitor": COMPLETED, "controller": COMPLETED},
    )
