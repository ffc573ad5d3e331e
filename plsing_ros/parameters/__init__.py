# SPDX-License-Identifier: Apache-2.0
"""The nodes' parameters as immutable checked values, without ROS."""

from plsing_ros.parameters.controller import ControllerParameters
from plsing_ros.parameters.monitor import MonitorParameters
from plsing_ros.parameters.parameter_set import ParameterSet, Specification
from plsing_ros.parameters.pose_estimator import EstimationParameters, FilterParameters, PoseEstimatorParameters
from plsing_ros.parameters.scene import SceneParameters
from plsing_ros.parameters.simulator import SimulatorParameters

__all__ = [
    "ControllerParameters",
    "EstimationParameters",
    "FilterParameters",
    "MonitorParameters",
    "ParameterSet",
    "PoseEstimatorParameters",
    "SceneParameters",
    "SimulatorParameters",
    "Specification",
]
