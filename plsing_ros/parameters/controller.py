"""Parameters of the controller."""

from __future__ import annotations

from dataclasses import dataclass

from plsing_ros.errors import ParameterError
from plsing_ros.parameters.parameter_set import parameter
from plsing_ros.parameters.task import TaskParameters


@dataclass(frozen=True)
class ControllerParameters(TaskParameters):
    """Where to go, by which law, and when not to move."""

    target_source: str = parameter(
        "pose",
        "target.source",
        "pose: the features of the lines seen from the target pose; topic: desired_line_features",
        choices=("pose", "topic"),
        live=False,
    )
    gain: float = parameter(
        0.1, "gain", "lambda of the law tau = -lambda pinv(L) (s - s*)", unit="1/s", minimum=1e-6, maximum=1000.0
    )
    pinv_threshold: float = parameter(
        1e-12,
        "pinv_threshold",
        "Singular values of L below this times the largest one are taken as zero by pinv",
        minimum=0.0,
        maximum=0.1,
    )
    converged_error: float = parameter(
        1e-6, "converged_error", "Error norm |s - s*| below which the state says CONVERGED", minimum=0.0, maximum=1.0
    )
    features_timeout: float = parameter(
        0.2,
        "features_timeout",
        "Features older than this on the node clock are refused, and zero twist is commanded",
        unit="s",
        minimum=1e-3,
        maximum=60.0,
    )
    watchdog_period: float = parameter(
        0.05,
        "watchdog_period",
        "How often the age of the features is checked (wall clock)",
        unit="s",
        minimum=1e-3,
        maximum=10.0,
        live=False,
    )

    def check(self) -> None:
        """Refuse a scene or target that is not one; a target from a topic needs no scene."""
        if self.target_source == "topic" and not self.lines_points and not self.lines_directions:
            return
        super().check()
        if self.target_source == "pose" and len(self.lines_points) < 9:
            raise ParameterError(
                f"parameter 'lines.points' gives {len(self.lines_points) // 3} line(s); at least 3 are needed to "
                "control a camera pose"
            )
        self.target_pose()
