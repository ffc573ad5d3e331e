# SPDX-License-Identifier: Apache-2.0
"""The camera's pose as a transform on /tf, where tf2_msgs is installed."""

from __future__ import annotations

import importlib
from typing import Any

from geometry_msgs.msg import TransformStamped

from plsing_ros.geometry import Pose
from plsing_ros.nodes import qos
from plsing_ros.nodes.conversions import fill_stamp
from plsing_ros.nodes.managed_node import ManagedNode
from plsing_ros.nodes.pose_conversions import fill_transform


class PoseTransform:
    """Publishes scene frame -> camera frame; nothing unless it is wanted and can be."""

    def __init__(self, node: ManagedNode, wanted: bool, scene_frame: str, camera_frame: str) -> None:
        """Advertise /tf; where tf2_msgs is missing, say so and go on without."""
        self._message: Any = None
        if not wanted:
            return
        try:
            message_type = importlib.import_module("tf2_msgs.msg").TFMessage
        except ImportError:
            node.get_logger().error(
                "publish_tf: nothing goes to /tf, for the package tf2_msgs is not installed: "
                "sudo apt install ros-jazzy-tf2-msgs"
            )
            return
        self._transform = TransformStamped(child_frame_id=camera_frame)
        self._transform.header.frame_id = scene_frame
        self._message = message_type(transforms=[self._transform])
        self._publisher = node.advertise(message_type, "/tf", qos.TRANSFORMS)

    def publish(self, T_world_camera: Pose, stamp: int) -> None:
        """Publish a pose, with its stamp in nanoseconds."""
        if self._message is None:
            return
        fill_stamp(self._transform.header.stamp, stamp)
        fill_transform(self._transform.transform, T_world_camera)
        self._publisher.publish(self._message)
