# SPDX-License-Identifier: Apache-2.0
"""Where the camera is fixed to the tool, from TF, where tf2_ros is installed."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from rclpy.parameter import Parameter
from rclpy.time import Time

from plsing_ros.errors import ParameterError, PlsingError
from plsing_ros.geometry import Pose
from plsing_ros.nodes.parameterized_node import ParameterizedNode
from plsing_ros.parameters import ControllerParameters

# A transform that differs by less than this is the same [m, and of the quaternion].
_SAME = 1e-9


class ToolTransformError(PlsingError):
    """TF does not say where the camera is in the tool's frame."""


class ToolTransform:
    """Keeps the parameters T_tool_camera.* at what TF says; nothing unless T_tool_camera.source is tf."""

    def __init__(self, node: ParameterizedNode[ControllerParameters]) -> None:
        """Listen to TF."""
        self._node = node
        self._wanted = node.parameters.tool_source == "tf"
        self._tf2_ros: Any = None
        if not self._wanted:
            return
        try:
            self._tf2_ros = importlib.import_module("tf2_ros")
        except ImportError:
            return
        self._buffer: Any = self._tf2_ros.Buffer()
        self._listener = self._tf2_ros.TransformListener(self._buffer, node)

    def check(self) -> None:
        """Refuse a source that is not installed."""
        if self._wanted and self._tf2_ros is None:
            raise ParameterError(
                "parameter 'T_tool_camera.source' is tf, and the package tf2_ros is not installed: "
                "sudo apt install ros-jazzy-tf2-ros-py, or give T_tool_camera.position and .orientation"
            )

    def update(self) -> None:
        """Put the latest transform in force.

        Raises:
            ToolTransformError: If there is none.
        """
        if not self._wanted:
            return
        parameters = self._node.parameters
        tool, camera = parameters.tool_frame, parameters.camera_frame
        try:
            found = self._buffer.lookup_transform(tool, camera, Time()).transform
        except self._tf2_ros.TransformException as error:
            raise ToolTransformError(f"TF has no transform from '{tool}' to '{camera}': {error}") from None
        p, q = found.translation, found.rotation
        position, orientation = np.array([p.x, p.y, p.z]), np.array([q.x, q.y, q.z, q.w])
        if np.abs(position - parameters.tool_position).max() < _SAME and (
            np.abs(orientation - parameters.tool_orientation).max() < _SAME
        ):
            return
        changes = [
            Parameter("T_tool_camera.position", value=position.tolist()),
            Parameter("T_tool_camera.orientation", value=orientation.tolist()),
        ]
        answer = self._node.set_parameters_atomically(changes)
        if not answer.successful:
            raise ToolTransformError(f"the transform from '{tool}' to '{camera}' on TF is refused: {answer.reason}")
        pose = Pose.from_quaternion(position, orientation)
        self._node.get_logger().info(f"camera at {pose.translation.tolist()} m in '{tool}', from TF")
