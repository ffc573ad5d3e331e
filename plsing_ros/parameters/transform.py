# SPDX-License-Identifier: Apache-2.0
"""Whether a node says on /tf where the camera is."""

from __future__ import annotations

from dataclasses import dataclass

from plsing_ros.parameters.parameter_set import ParameterSet, parameter


@dataclass(frozen=True)
class TransformParameters(ParameterSet):
    """What a node that knows the camera's pose publishes it on."""

    publish_tf: bool = parameter(
        False,
        "publish_tf",
        "Whether the pose of camera_frame in scene_frame goes to /tf, too; needs tf2_msgs, and that nobody else gives "
        "that frame a parent",
        live=False,
    )
