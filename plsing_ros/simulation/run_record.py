# SPDX-License-Identifier: Apache-2.0
"""What happened in one servo run, and its summary."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.levels import Level


@dataclass(frozen=True)
class Alert:
    """A change of level: when [s since the start of the run], to which level, and the alert's text."""

    time: float
    level: Level
    text: str


@dataclass(frozen=True, eq=False)
class RunRecord:
    """One servo run, a row for each frame.

    Attributes:
        name: For tables and legends.
        time: Since the start of the run, shape (k,) [s].
        position: Camera centre in the scene frame, shape (k, 3) [m].
        twist: Commanded (v, omega) in the optical frame, shape (k, 6) [m/s, rad/s].
        error_norm: |s - s*|, shape (k,).
        inverse_condition_number: Raw, shape (k,).
        target: Camera centre at the target, shape (3,), or where it should be at each time, shape (k, 3) [m].
        arrived: Whether the run ended at the target.
        alerts: Changes of level, the initial level included.
        ended: Why the run ended, in words, or empty.
        changes: What was changed of the path to be followed, in words.
    """

    name: str
    time: Array
    position: Array
    twist: Array
    error_norm: Array
    inverse_condition_number: Array
    target: Array
    arrived: bool
    alerts: tuple[Alert, ...]
    ended: str = ""
    changes: tuple[str, ...] = ()

    @property
    def distance(self) -> Array:
        """Distance of the camera centre to the target, shape (k,) [m]."""
        return np.asarray(np.linalg.norm(self.position - self.target, axis=1))

    @property
    def linear_speed(self) -> Array:
        """|v|, shape (k,) [m/s]."""
        return np.asarray(np.linalg.norm(self.twist[:, :3], axis=1))

    @property
    def distance_is_monotone(self) -> bool:
        """Whether no step took the camera away from the target."""
        return bool((np.diff(self.distance) <= 1e-9).all())

    @property
    def time_of_peak(self) -> float:
        """When |v| was largest [s]."""
        return float(self.time[np.argmax(self.linear_speed)])

    @property
    def first_alert(self) -> Alert | None:
        """The first alert of level WARN or CRITICAL, or None."""
        return next((each for each in self.alerts if each.level in (Level.WARN, Level.CRITICAL)), None)


_HEADINGS = (
    "start",
    "iterations",
    "peak |v| [m/s]",
    "lowest 1/cond",
    "longest distance [m]",
    "monotone",
    "first alert",
    "before peak [s]",
)


def summary_table(records: list[RunRecord]) -> str:
    """Return a table of runs as text, a row for each."""
    rows = [_HEADINGS] + [_summary_row(record) for record in records]
    widths = [max(len(row[column]) for row in rows) for column in range(len(_HEADINGS))]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    return "\n".join([lines[0], "-" * len(lines[0]), *lines[1:]])


def _summary_row(record: RunRecord) -> tuple[str, ...]:
    alert = record.first_alert
    return (
        record.name,
        f"{len(record.time)}" if record.arrived else f"{len(record.time)}, not arrived",
        f"{record.linear_speed.max():.3g}",
        f"{record.inverse_condition_number.min():.2g}",
        f"{record.distance.max():.3g}",
        "yes" if record.distance_is_monotone else "no",
        "none" if alert is None else f"{alert.level.name} at {alert.time:.2f} s",
        "-" if alert is None else f"{record.time_of_peak - alert.time:.2f}",
    )
