# SPDX-License-Identifier: Apache-2.0
"""Parameters of the singularity monitor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

from plsing_ros.errors import ParameterError
from plsing_ros.parameters.loop import LoopParameters
from plsing_ros.parameters.parameter_set import parameter

_RATIO = {"minimum": 0.0, "maximum": 1.0}
_DISTANCE = {"unit": "m", "minimum": 0.0, "maximum": 1e6}
_ANGLE = {"unit": "rad", "minimum": 0.0, "maximum": 1e6}
_NUMBER = {"minimum": 0.0, "maximum": 1e12}
_GROWTH = {"minimum": 0.0, "maximum": 1e6}


class _Monitored(NamedTuple):
    """A number that levels are judged by: its thresholds are four parameters, made from this one row.

    Attributes:
        field: Its name in fields of the dataclass.
        warn: Default of warn.<name>.
        critical: Default of critical.<name>.
        condition: When a level is entered, in words.
        details: Unit and range.
        rises: Whether it is the worse the larger it is; the others are the worse the smaller they are.
    """

    field: str
    warn: float
    critical: float
    condition: str
    details: dict[str, Any]
    rises: bool = False


_MONITORED = {
    "inverse_condition_number": _Monitored("condition", 1e-3, 1e-4, "below this raw inverse condition number", _RATIO),
    "relative_inverse_condition_number": _Monitored(
        "relative_condition",
        0.02,
        0.005,
        "below this ratio of the inverse condition number to its value at the target",
        _NUMBER,
    ),
    "smallest_singular_value": _Monitored(
        "singular_value", 0.0, 0.0, "below this smallest singular value of the raw interaction matrix", _NUMBER
    ),
    "z": _Monitored(
        "z", 3.0, 0.0, "fewer than this many tolerances of the scene's lines from an exactly singular pose", _NUMBER
    ),
    "distance": _Monitored(
        "distance",
        0.0,
        0.0,
        "nearer than this to the nearest singular pose to first order, whether or not a locus is known there",
        _DISTANCE,
    ),
    "position_std": _Monitored(
        "position_std",
        0.0,
        0.0,
        "when the features' covariances, or else 1 mrad of each image line, put the position off by this along "
        "the least observable motion",
        _DISTANCE,
        rises=True,
    ),
    "rotation_std": _Monitored(
        "rotation_std",
        0.0,
        0.0,
        "when the features' covariances, or else 1 mrad of each image line, turn the pose by this in "
        "the least observable motion",
        _ANGLE,
        rises=True,
    ),
    "transversal_distance": _Monitored(
        "transversal_distance", 0.02, 0.005, "nearer than this to a transversal", _DISTANCE
    ),
    "isolated_point_distance": _Monitored(
        "point_distance", 0.02, 0.005, "nearer than this to an isolated point", _DISTANCE
    ),
    "surface_distance": _Monitored(
        "surface_distance", 0.02, 0.005, "nearer than this to a surface or curve of singular centres", _DISTANCE
    ),
    "speed_growth": _Monitored(
        "growth",
        9.0,
        20.0,
        "when, by an unknown controller's twists, the speed is about to be this many times that at the start",
        _GROWTH,
        rises=True,
    ),
    "risk": _Monitored("risk", 0.72, 0.9, "when the probability of harm is above this", _RATIO, rises=True),
    "demand": _Monitored(
        "demand",
        1.0,
        3.0,
        "when the speed expected is this many times the robot's limit (or 1.5 times the first speed if that is more)",
        _GROWTH,
        rises=True,
    ),
    "shaking": _Monitored(
        "shaking",
        0.05,
        0.0,
        "when noise is expected to shake the camera at the target by this, root mean square",
        _DISTANCE,
        rises=True,
    ),
    "time_to_harm": _Monitored(
        "time_to_harm", 0.0, 0.0, "when harm is expected within this", {"unit": "s", "minimum": 0.0, "maximum": 1e3}
    ),
}


def _threshold_fields() -> Iterator[tuple[str, Any]]:
    """Yield the fields of all thresholds: of each number warn, its exit, critical, its exit."""
    for name, (field, warn, critical, condition, details, rises) in _MONITORED.items():
        better, factor = ("at or below", "1/1.2 of") if rises else ("at or above", "1.2 times")
        for level, default in (("warn", warn), ("critical", critical)):
            text = f"{level.upper()} {condition}; 0 switches it off"
            yield f"{level}_{field}", parameter(default, f"{level}.{name}", text, **details)
            text = f"{level.upper()} on this number ends {better} this; 0: {factor} {level}.{name}"
            yield f"{level}_{field}_exit", parameter(0.0, f"{level}.{name}_exit", text, **details)


def _with_thresholds(cls: type[MonitorParameters]) -> type[MonitorParameters]:
    """Declare the thresholds before the other fields of a class that is about to become a dataclass."""
    fields = dict(_threshold_fields())
    cls.__annotations__ = dict.fromkeys(fields, "float") | cls.__annotations__
    for field, declared in fields.items():
        setattr(cls, field, declared)
    return cls


@dataclass(frozen=True)
@_with_thresholds
class MonitorParameters(LoopParameters):
    """When to warn, and which input to trust; thresholds are fields too: warn_condition, warn_condition_exit, ..."""

    condition_thresholds: str = parameter(
        "auto",
        "condition_thresholds",
        "Which thresholds on the inverse condition number rule; auto: relative while the target is known, else "
        "absolute",
        choices=("auto", "absolute", "relative", "both"),
    )
    raise_cycles: int = parameter(
        2, "debounce.raise", "Cycles in a row that must call for a worse level", minimum=1, maximum=10000
    )
    lower_cycles: int = parameter(
        25, "debounce.lower", "Cycles in a row that must allow a better level", minimum=1, maximum=10000
    )
    dropout_cycles: int = parameter(
        4,
        "debounce.dropout",
        "UNOBSERVABLE after so many frames in a row with fewer than three usable lines; before, the last level holds",
        minimum=1,
        maximum=10000,
    )
    horizon: float = parameter(
        1.4,
        "prediction.horizon",
        "How far ahead a prediction may raise WARN; 0 switches prediction off",
        unit="s",
        minimum=0.0,
        maximum=60.0,
    )
    rollout_rules: bool = parameter(
        True,
        "prediction.rollout_rules",
        "While cmd_twist follows the plain law, only the speed expected from a roll-out of that law alerts, not that a "
        "singularity is near; false: both alert",
    )
    min_speed: float = parameter(
        1e-3,
        "prediction.min_speed",
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
        False, "target.known", "Whether target.position and target.orientation are the target of the task"
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
    no_pose_timeout: float = parameter(
        2.0,
        "no_pose_timeout",
        "CRITICAL when the target is known and lines have been seen for this time, but without 3-D lines: the camera "
        "is not on its way; 0 switches it off",
        unit="s",
        minimum=0.0,
        maximum=1000.0,
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
        self.check_loop()
        for name, monitored in _MONITORED.items():
            warn, warn_exit, critical, critical_exit = self.thresholds(name)
            least, side = ("most", "above") if monitored.rises else ("least", "below")
            for level, entering, leaving in (("warn", warn, warn_exit), ("critical", critical, critical_exit)):
                if entering > 0.0 and leaving > 0.0 and _is_worse(leaving, entering, monitored.rises):
                    raise ParameterError(
                        f"parameter '{level}.{name}_exit' is {leaving:g}, {side} '{level}.{name}' = {entering:g}; "
                        f"it must be at {least} that, or 0"
                    )
            if critical > 0.0 and _is_worse(warn, critical, monitored.rises):
                raise ParameterError(
                    f"parameter 'warn.{name}' is {warn:g}, {side} 'critical.{name}' = {critical:g}; "
                    f"it must be at {least} that, so that the warning comes first"
                )
        self.target_pose()

    def thresholds(self, name: str) -> tuple[float, float, float, float]:
        """Return warn, its exit, critical, its exit of a number by its ROS name, for example "transversal_distance"."""
        field = _MONITORED[name].field
        warn, warn_exit, critical, critical_exit = (
            float(getattr(self, f"{level}_{field}{end}")) for level in ("warn", "critical") for end in ("", "_exit")
        )
        return warn, warn_exit, critical, critical_exit


def _is_worse(one: float, other: float, rises: bool) -> bool:
    return one > other if rises else one < other
