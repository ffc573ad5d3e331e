# SPDX-License-Identifier: Apache-2.0
"""The camera's motion as the motion of a tool that it is fixed to."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array, cross
from plsing_ros.geometry import Pose


def tool_twist(T_tool_camera: Pose, twist_camera: Array) -> Array:
    """Return the twist of the tool, in its own frame, that moves the camera with the given twist.

    Args:
        T_tool_camera: Where the camera is fixed to the tool.
        twist_camera: (v, omega) of the camera in its optical frame, shape (6,) [m/s, rad/s].

    Source: the adjoint of SE(3), omega_tool = R omega, v_tool = R v + t cross R omega.
    """
    omega = T_tool_camera.rotation @ twist_camera[3:]
    v = T_tool_camera.rotation @ twist_camera[:3] + cross(T_tool_camera.translation, omega)
    return np.concatenate([v, omega])
