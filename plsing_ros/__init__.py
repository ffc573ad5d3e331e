# SPDX-License-Identifier: Apache-2.0
"""Singularity-aware visual servoing on straight lines: `import plsing_ros as pl`.

Arrays are numpy's, units SI, frames as in docs/concepts. Printing a result gives a summary. Needs numpy and scipy
alone; what draws, reads images or bags imports its library when it is called.
"""

from plsing_ros.analysis.line_selection import LineSelection, select_lines
from plsing_ros.control.servo_controller import Command, ServoController
from plsing_ros.errors import PlsingError
from plsing_ros.features import LineObservation, project
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.model_files import read_model
from plsing_ros.monitoring.assessment import Assessment
from plsing_ros.monitoring.singularity_monitor import SingularityMonitor
from plsing_ros.pose.estimate import PoseEstimate
from plsing_ros.pose.estimator import estimate_pose
from plsing_ros.pose.filter import PoseFilter
from plsing_ros.simulation.simulate import SimulatedRun, simulate
from plsing_ros.singularities import SingularSet, singular_set
from plsing_ros.tracking import LineTracker, PinholeCamera

__all__ = [
    "Assessment",
    "Command",
    "LineObservation",
    "LineSelection",
    "LineSet",
    "LineTracker",
    "PinholeCamera",
    "PlsingError",
    "Pose",
    "PoseEstimate",
    "PoseFilter",
    "ServoController",
    "SimulatedRun",
    "SingularSet",
    "SingularityMonitor",
    "estimate_pose",
    "project",
    "read_model",
    "select_lines",
    "simulate",
    "singular_set",
]
