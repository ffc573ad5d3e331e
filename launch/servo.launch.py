# SPDX-License-Identifier: Apache-2.0
"""Controller and monitor, for features with 3-D lines: ros2 launch plsing_ros servo.launch.py params_file:=my.yaml"""

from plsing_ros.nodes.launch_description import describe_nodes


def generate_launch_description():
    return describe_nodes("singularity_monitor", "controller", remappings={})
