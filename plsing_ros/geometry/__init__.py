# SPDX-License-Identifier: Apache-2.0
"""Lines, poses and scenes: values that check themselves."""

from plsing_ros.geometry.line_alignment import Alignment, align_lines
from plsing_ros.geometry.line_set import LineSet
from plsing_ros.geometry.pose import Pose

__all__ = ["Alignment", "LineSet", "Pose", "align_lines"]
