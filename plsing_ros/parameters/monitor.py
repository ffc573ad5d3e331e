"""Parameters of the singularity monitor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from plsing_ros.errors import ParameterError
from plsing_ros.parameters.parameter_set import parameter
from plsing_ros.parameters.task import TaskParameters

# Numbers that are the worse the smaller they are, by their ROS names, and the fields of their thresholds.
_INDICATORS = {
    "inverse_condition_number": "condition",
    "relative_inverse_condition_number": "relative_condition",
    "smallest_singular_value": "singular_value",
    "transversal_distance": "transversal_distance",
    "isolated_point_distance": "point_distance",
    "surface_distance": "surface_distance",
}
_RATIO = {"minimum": 0.0, "maximum": 1.0}
_DISTANCE = {"unit": "m", "minimum": 0.0, "maximum": 1e6}
_NUMBER = {"minimum": 0.0, "maximum": 1e12}
_GROWTH = {"minimum": 0.0, "maximum": 1e6}


def _threshold(level: str, name: str, default: float, condition: str, details: dict[str, Any]) -> Any:
    return parameter(default, f"{level}.{name}", f"{level.upper()} {condition}; 0 switches it off", **details)


def _exit(
    level: str, name: str, details: dict[str, Any], better: str = "at or above", factor: str = "1.2 times"
) -> Any:
    return parameter(
        0.0,
        f"{level}.{name}_exit",
        f"{level.upper()} on this number ends {better} this; 0: {factor} {level}.{name}",
        **details,
    )


@dataclass(frozen=True)
class MonitorParameters(TaskParameters):
    """When to warn, and which input to trust."""

    warn_condition: float = _threshold(
        "warn", "inverse_condition_number", 0.001, "below this raw inverse condition number", _RATIO
    )
    warn_condition_exit: float = _exit("warn", "inverse_condition_number", _RATIO)
    critical_condition: float = _threshold(
        "critical", "inverse_condition_number", 0.0001, "below this raw inverse condition number", _RATIO
    )
    critical_condition_exit: float = _exit("critical", "inverse_condition_number", _RATIO)
    warn_relative_condition: float = _threshold(
        "warn",
        "relative_inverse_condition_number",
        0.02,
        "below this ratio of the inverse condition number to its value at the goal",
        _NUMBER,
    )
    warn_relative_condition_exit: float = _exit("warn", "relative_inverse_condition_number", _NUMBER)
    critical_relative_condition: float = _threshold(
        "critical",
        "relative_inverse_condition_number",
        0.005,
        "below this ratio of the inverse condition number to its value at the goal",
        _NUMBER,
    )
    critical_relative_condition_exit: float = _exit("critical", "relative_inverse_condition_number", _NUMBER)
    warn_singular_value: float = _threshold(
        "warn",
        "smallest_singular_value",
        0.0,
        "below this smallest singular value of the raw interaction matrix",
        _NUMBER,
    )
    warn_singular_value_exit: float = _exit("warn", "smallest_singular_value", _NUMBER)
    critical_singular_value: float = _threshold(
        "critical",
        "smallest_singular_value",
        0.0,
        "below this smallest singular value of the raw interaction matrix",
        _NUMBER,
    )
    critical_singular_value_exit: float = _exit("critical", "smallest_singular_value", _NUMBER)
    warn_transversal_distance: float = _threshold(
        "warn", "transversal_distance", 0.02, "nearer than this to a transversal", _DISTANCE
    )
    warn_transversal_distance_exit: float = _exit("warn", "transversal_distance", _DISTANCE)
    critical_transversal_distance: float = _threshold(
        "critical", "transversal_distance", 0.005, "nearer than this to a transversal", _DISTANCE
    )
    critical_transversal_distance_exit: float = _exit("critical", "transversal_distance", _DISTANCE)
    warn_point_distance: float = _threshold(
        "warn", "isolated_point_distance", 0.02, "nearer than this to an isolated point", _DISTANCE
    )
    warn_point_distance_exit: float = _exit("warn", "isolated_point_distance", _DISTANCE)
    critical_point_distance: float = _threshold(
        "critical", "isolated_point_distance", 0.005, "nearer than this to an isolated point", _DISTANCE
    )
    critical_point_distance_exit: float = _exit("critical", "isolated_point_distance", _DISTANCE)
    warn_surface_distance: float = _threshold(
        "warn", "surface_distance", 0.02, "nearer than this to a plane, quadric or cubic of singular centres", _DISTANCE
    )
    warn_surface_distance_exit: float = _exit("warn", "surface_distance", _DISTANCE)
    critical_surface_distance: float = _threshold(
        "critical",
        "surface_distance",
        0.005,
        "nearer than this to a plane, quadric or cubic of singular centres",
        _DISTANCE,
    )
    critical_surface_distance_exit: float = _exit("critical", "surface_distance", _DISTANCE)
    warn_growth: float = _threshold(
        "warn",
        "speed_growth",
        10.0,
        "when the speed is about to be this many times that at the start of the motion",
        _GROWTH,
    )
    warn_growth_exit: float = _exit("warn", "speed_growth", _GROWTH, "at or below", "1/1.2 of")
    critical_growth: float = _threshold(
        "critical",
        "speed_growth",
        20.0,
        "when the speed is about to be this many times that at the start of the motion",
        _GROWTH,
    )
    critical_growth_exit: float = _exit("critical", "speed_growth", _GROWTH, "at or below", "1/1.2 of")
    condition_thresholds: str = parameter(
        "auto",
        "condition_thresholds",
        "Which thresholds on the inverse condition number rule. auto: relative while the goal is known, else absolute",
        choices=("auto", "absolute", "relative", "both"),
    )
    raise_cycles: int = parameter(
        2, "debounce.raise", "Cycles in a row that must call for a worse level", minimum=1, maximum=10000
    )
    lower_cycles: int = parameter(
        25, "debounce.lower", "Cycles in a row that must allow a better level", minimum=1, maximum=10000
    )
    horizon: float = parameter(
        1.8,
        "prediction.horizon",
        "How far ahead a prediction may raise WARN; 0 switches prediction off",
        unit="s",
        minimum=0.0,
        maximum=60.0,
    )
    preview_rules: bool = parameter(
        True,
        "prediction.preview_rules",
        "While the goal is known and cmd_twist follows the plain law, only the speed expected from a preview of that "
        "law alerts, not that a singularity is near; false: both alert",
    )
    least_speed: float = parameter(
        1e-3,
        "prediction.least_speed",
        "A speed below this is no motion: growth is counted from at least this",
        unit="m/s",
        minimum=1e-9,
        maximum=1e3,
    )
    rate_window: int = parameter(
        10,
        "rate_window",
        "Latest features over which the rate of the inverse condition number is fitted",
        minimum=2,
        maximum=1000,
    )
    target_known: bool = parameter(
        False, "target.known", "Whether target.position and target.orientation are the goal of the task"
    )
    twist_timeout: float = parameter(
        0.3,
        "twist_timeout",
        "A cmd_twist counts for features whose stamp differs by no more than this",
        unit="s",
        minimum=1e-3,
        maximum=60.0,
    )
    characteristic_length: float = parameter(
        1.0,
        "characteristic_length",
        "Length that makes the translation columns of L comparable with the rotation columns",
        unit="m",
        minimum=1e-6,
        maximum=1e6,
    )
    features_timeout: float = parameter(
        0.5,
        "features_timeout",
        "STALE when no usable features have come for this time on the node clock",
        unit="s",
        minimum=1e-3,
        maximum=60.0,
    )
    pose_tolerance: float = parameter(
        0.1,
        "pose_tolerance",
        "A camera_pose counts for features whose stamp differs by no more than this",
        unit="s",
        minimum=0.0,
        maximum=60.0,
    )
    heartbeat_period: float = parameter(
        0.2,
        "heartbeat_period",
        "A status is published at least this often (wall clock)",
        unit="s",
        minimum=0.01,
        maximum=10.0,
        live=False,
    )
    marker_period: float = parameter(
        0.1,
        "marker_period",
        "Time between two drawings of the camera on camera_markers (wall clock)",
        unit="s",
        minimum=0.01,
        maximum=60.0,
        live=False,
    )

    def check(self) -> None:
        """Refuse thresholds in the wrong order, and a target that is no pose."""
        super().check()
        for name in _INDICATORS:
            warn, warn_exit, critical, critical_exit = self.thresholds(name)
            for level, entering, leaving in (("warn", warn, warn_exit), ("critical", critical, critical_exit)):
                if 0.0 < leaving < entering:
                    raise ParameterError(
                        f"parameter '{level}.{name}_exit' is {leaving:g}, below '{level}.{name}' = {entering:g}; "
                        "it must be at least that, or 0"
                    )
            if warn < critical:
                raise ParameterError(
                    f"parameter 'warn.{name}' is {warn:g}, below 'critical.{name}' = {critical:g}; "
                    "it must be at least that, so that the warning comes first"
                )
        for level, growth, leaving in (
            ("warn", self.warn_growth, self.warn_growth_exit),
            ("critical", self.critical_growth, self.critical_growth_exit),
        ):
            if leaving > growth > 0.0:
                raise ParameterError(
                    f"parameter '{level}.speed_growth_exit' is {leaving:g}, above '{level}.speed_growth' = {growth:g}; "
                    "it must be at most that, or 0"
                )
        if 0.0 < self.critical_growth < self.warn_growth:
            raise ParameterError(
                f"parameter 'warn.speed_growth' is {self.warn_growth:g}, above 'critical.speed_growth' = "
                f"{self.critical_growth:g}; it must be at most that, so that the warning comes first"
            )
        self.target_pose()

    def thresholds(self, name: str) -> tuple[float, float, float, float]:
        """Return warn, its exit, critical, its exit of a number by its ROS name, for example "transversal_distance"."""
        field = _INDICATORS[name]
        warn, warn_exit, critical, critical_exit = (
            float(getattr(self, f"{level}_{field}{end}")) for level in ("warn", "critical") for end in ("", "_exit")
        )
        return warn, warn_exit, critical, critical_exit
