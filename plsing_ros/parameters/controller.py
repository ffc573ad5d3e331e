# SPDX-License-Identifier: Apache-2.0
"""Parameters of the controller."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from plsing_ros.errors import ParameterError
from plsing_ros.geometry import Pose
from plsing_ros.parameters.law import LawParameters
from plsing_ros.parameters.parameter_set import parameter
from plsing_ros.parameters.scene import pose_from_parameters
from plsing_ros.parameters.task import AnswerParameters
from plsing_ros.parameters.tolerance import ToleranceParameters

_TRUST = ("halt", "slow", "ignore")


@dataclass(frozen=True)
class ControllerParameters(LawParameters, ToleranceParameters, AnswerParameters):
    """Where to go, by which law, and when not to move."""

    target_source: str = parameter(
        "pose",
        "target.source",
        "pose: the features of the lines seen from the target pose; topic: desired_line_features",
        choices=("pose", "topic"),
        live=False,
    )
    min_target_condition: float = parameter(
        1e-6,
        "target.min_inverse_condition_number",
        "A target whose inverse condition number is below this is refused; 0: every target is accepted",
        minimum=0.0,
        maximum=1.0,
    )
    converged_error: float = parameter(
        1e-6, "converged_error", "Error norm |s - s*| below which the state says CONVERGED", minimum=0.0, maximum=1.0
    )
    stall_error: float = parameter(
        0.05, "stall.error", "An error norm below this is never called a stall", minimum=0.0, maximum=1000.0
    )
    stall_ratio: float = parameter(
        1e-3,
        "stall.ratio",
        "STALLED when the twist changes the image by less than this times what lambda asks for; 0: never",
        minimum=0.0,
        maximum=1.0,
    )
    stall_time: float = parameter(
        1.0, "stall.time", "STALLED when it lasts this long", unit="s", minimum=0.0, maximum=1000.0
    )
    ambiguous_lines: str = parameter(
        "halt",
        "ambiguous_lines",
        "What to do when the features say that their 3-D lines are AMBIGUOUS",
        choices=_TRUST,
    )
    poor_lines: str = parameter(
        "slow", "poor_lines", "What to do when the features say that their 3-D lines are POOR", choices=_TRUST
    )
    enabled: bool = parameter(
        True,
        "enabled",
        "Whether it may move from the start on; false: only after the service ~/enable",
        live=False,
    )
    slow_scale: float = parameter(
        0.3, "slow_scale", "Share of the speed for lines not to be trusted fully", minimum=0.0, maximum=1.0
    )
    gate: str = parameter(
        "none",
        "gate",
        "status: move only with a recent singularity_status of a level allowed by gate_level, or slowly out of a "
        "singularity; risk: likewise, and not before it says a risk; none: do not ask",
        choices=("none", "status", "risk"),
        live=False,
    )
    gate_level: str = parameter(
        "WARN", "gate_level", "Worst level of singularity_status to move at", choices=("OK", "WARN", "CRITICAL")
    )
    gate_timeout: float = parameter(
        0.5,
        "gate_timeout",
        "A singularity_status older than this on the node clock does not count",
        unit="s",
        minimum=1e-3,
        maximum=60.0,
    )
    zero_twists: int = parameter(
        -1,
        "zero_twists",
        "Zero twists in a row that are published while it must not move, then none until it moves again; -1: no end",
        minimum=-1,
        maximum=1_000_000,
    )
    tool_frame: str = parameter(
        "",
        "tool_frame",
        "Name of a frame fixed to the camera that cmd_twist is given in and for; empty: the camera's optical frame",
        live=False,
    )
    tool_source: str = parameter(
        "parameters",
        "T_tool_camera.source",
        "parameters: the camera is in tool_frame where the next two say; tf: where TF says, and the robot stands until "
        "it does; needs tf2_ros",
        choices=("parameters", "tf"),
        live=False,
    )
    tool_position: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "T_tool_camera.position", "Camera centre in tool_frame: x, y, z", unit="m"
    )
    tool_orientation: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0, 1.0),
        "T_tool_camera.orientation",
        "Orientation of the optical frame in tool_frame: unit quaternion x, y, z, w",
    )

    def check(self) -> None:
        """Refuse values that contradict each other; a target from a topic needs no scene."""
        self.check_law()
        _ = self.T_tool_camera
        if self.tool_source == "tf" and not self.tool_frame:
            raise ParameterError("parameter 'T_tool_camera.source' is tf, and 'tool_frame' is empty; name the frame")
        if self.target_source == "topic" and not self.lines_points and not self.lines_directions:
            return
        super().check()
        if self.target_source == "pose":
            self.require_three_lines("to control a camera pose")
        self.target_pose()

    @cached_property
    def T_tool_camera(self) -> Pose:
        """Where the camera is in tool_frame."""
        return pose_from_parameters("T_tool_camera", self.tool_position, self.tool_orientation)
