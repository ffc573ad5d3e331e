# SPDX-License-Identifier: Apache-2.0
"""A simulated camera, alone: ros2 launch plsing_ros simulator.launch.py params_file:=scene.yaml"""

from plsing_ros.nodes.launch_description import describe_nodes


def generate_launch_description():
    return describe_nodes("feature_simulator", remappings={})
