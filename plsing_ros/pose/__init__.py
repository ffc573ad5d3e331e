# SPDX-License-Identifier: Apache-2.0
"""Camera poses from image lines, with what is known about their errors."""

from plsing_ros.pose.estimate import Alternative, PoseEstimate, Verdict, failed_estimate
from plsing_ros.pose.estimator import PoseEstimator
from plsing_ros.pose.filter import PoseFilter
from plsing_ros.pose.line_lifting import lift_lines
from plsing_ros.pose.minimal_solver import solve_three_lines

__all__ = [
    "Alternative",
    "PoseEstimate",
    "PoseEstimator",
    "PoseFilter",
    "Verdict",
    "failed_estimate",
    "lift_lines",
    "solve_three_lines",
]
