"""Parameters of the singularity monitor."""

from __future__ import annotations

from dataclasses import dataclass

from plsing_ros.errors import ParameterError
from plsing_ros.parameters.parameter_set import parameter
from plsing_ros.parameters.scene import SceneParameters

_RATIO = {"minimum": 0.0, "maximum": 1.0}
_DISTANCE = {"unit": "m", "minimum": 0.0, "maximum": 1e6}


@dataclass(frozen=True)
class MonitorParameters(SceneParameters):
    """When to warn, and which input to trust."""

    warn_condition: float = parameter(
        1e-3,
        "warn.inverse_condition_number",
        "WARN below this raw inverse condition number; 0 switches it off",
        **_RATIO,
    )
    critical_condition: float = parameter(
        1e-4,
        "critical.inverse_condition_number",
        "CRITICAL below this raw inverse condition number; 0 switches it off",
        **_RATIO,
    )
    warn_distance: float = parameter(
        0.1,
        "warn.distance",
        "WARN nearer than this to a transversal or an isolated point; 0 switches it off",
        **_DISTANCE,
    )
    critical_distance: float = parameter(
        0.02,
        "critical.distance",
        "CRITICAL nearer than this to a transversal or an isolated point; 0 switches it off",
        **_DISTANCE,
    )
    hysteresis: float = parameter(
        1.2,
        "hysteresis",
        "A level is left only when the value is better than its threshold by this factor",
        minimum=1.0,
        maximum=10.0,
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
    future_tolerance: float = parameter(
        0.1,
        "future_tolerance",
        "Features stamped further ahead of the node clock than this are refused",
        unit="s",
        minimum=0.0,
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

    def check(self) -> None:
        """Refuse thresholds in the wrong order."""
        super().check()
        for name, warn, critical in (
            ("inverse_condition_number", self.warn_condition, self.critical_condition),
            ("distance", self.warn_distance, self.critical_distance),
        ):
            if warn < critical:
                raise ParameterError(
                    f"parameter 'warn.{name}' is {warn:g}, below 'critical.{name}' = {critical:g}; "
                    "it must be at least that, so that the warning comes first"
                )
