# SPDX-License-Identifier: Apache-2.0
"""What awaits a camera along a path, at a target or in a workspace: singularities, accuracy, and a verdict in words."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from plsing_ros.analysis.accuracy import Camera, line_information, position_deviations
from plsing_ros.analysis.path_risk import HARM_TEXT, PathRisk
from plsing_ros.arrays import Array, vector_text
from plsing_ros.geometry import Pose
from plsing_ros.singularities import SingularSet

# z below which the lines' tolerances leave it open whether a camera is singular.
_MAY_BE_SINGULAR = 3.0
# Shares of roll-outs that come to harm above which a path is doubtful, and bad.
_POSSIBLE, _LIKELY = 0.1, 0.5


class PathVerdict(enum.Enum):
    """Whether to go there; the words say why."""

    GOOD = "good"
    DOUBTFUL = "doubtful"
    BAD = "bad"


@dataclass(frozen=True, eq=False)
class PathReport:
    """A row for each pose.

    Attributes:
        center: Camera centres, shape (k, 3) [m].
        nearest_distance: To the nearest singular locus by name, shape (k,) [m]; infinite where there is none.
        nearest_name: Its name.
        singular_distance: To the nearest singular centre to first order, also where no locus is named, shape (k,) [m].
        relative_condition: Of normal, shape (k,).
        z: How many standard deviations of the map from a singularity, shape (k,); nan for lines that are known exactly.
        deviation: Standard deviation of the camera's position in its worst direction, shape (k,) [m]; infinite with
            fewer than three lines in view.
        lines_in_view: How many, shape (k,).
        clearance: Distance to loci that was asked for [m].
        accuracy: Deviation that was asked for [m].
        risk: What runs from each pose to the target would come to; None if the target is not known.
    """

    center: Array
    nearest_distance: Array
    nearest_name: tuple[str, ...]
    singular_distance: Array
    relative_condition: Array
    z: Array
    deviation: Array
    lines_in_view: Array
    clearance: float
    accuracy: float
    risk: PathRisk | None = None

    @property
    def verdict(self) -> PathVerdict:
        """BAD where a pose may be singular or sees too few lines, DOUBTFUL where it misses what was asked for."""
        may_be = np.nan_to_num(self.z, nan=math.inf) < _MAY_BE_SINGULAR
        if may_be.any() or (self.nearest_distance == 0.0).any() or not np.isfinite(self.deviation).all():
            return PathVerdict.BAD
        if self.risk is not None and self.risk.probability.max() >= _LIKELY:
            return PathVerdict.BAD
        if self.risk is not None and (self.risk.probability.max() >= _POSSIBLE or self.risk.demand.max() > 1.0):
            return PathVerdict.DOUBTFUL
        if self.nearest_distance.min() < self.clearance or self.deviation.max() > self.accuracy:
            return PathVerdict.DOUBTFUL
        return PathVerdict.GOOD

    def reasons(self) -> list[str]:
        """Return what speaks against going there, a sentence each; empty if nothing does."""
        found = []
        blind = ~np.isfinite(self.deviation)
        if blind.any():
            found.append(
                f"fewer than three lines are in view at {blind.sum()} of {len(blind)} poses, first at "
                f"{vector_text(self.center[np.argmax(blind)])} m: turn the camera, or use more lines"
            )
        near = int(np.argmin(self.nearest_distance))
        if self.nearest_distance[near] < self.clearance:
            found.append(
                f"the camera comes within {self.nearest_distance[near]:.3g} m of {self.nearest_name[near]}, at "
                f"{vector_text(self.center[near])} m; asked were {self.clearance:g} m. There a motion of the camera "
                "changes no image line: keep away, use law detour, position or fused, or add a line"
            )
        z = np.nan_to_num(self.z, nan=math.inf)
        if z.min() < _MAY_BE_SINGULAR:
            row = int(np.argmin(z))
            found.append(
                f"as far as the map of the lines is known, the camera may be singular at "
                f"{vector_text(self.center[row])} m (z = {z[row]:.2g}): measure the lines better, or keep away"
            )
        seen = np.where(blind, 0.0, self.deviation)
        if seen.max() > self.accuracy:
            row = int(np.argmax(seen))
            found.append(
                f"the position is known to {_length(seen[row])} only at {vector_text(self.center[row])} m; "
                f"asked were {1000.0 * self.accuracy:g} mm: use more lines, or others (select_lines)"
            )
        return found + self._risk_reasons()

    def _risk_reasons(self) -> list[str]:
        risk = self.risk
        if risk is None:
            return []
        found, row = [], int(np.argmax(risk.probability))
        if risk.probability[row] >= _POSSIBLE:
            found.append(
                f"a run with law {risk.law} from {vector_text(self.center[row])} m comes to harm in "
                f"{risk.probability[row]:.0%} of the roll-outs: the camera {HARM_TEXT[risk.harm[row]]}. Try another "
                "law (evaluate compares them all), or start elsewhere"
            )
        fast = int(np.argmax(risk.demand))
        if risk.demand[fast] > 1.0:
            found.append(
                f"a run with law {risk.law} from {vector_text(self.center[fast])} m demands "
                f"{risk.demand[fast]:.2g} times the robot's speed limit: set max_linear_speed, or use law guarded"
            )
        return found

    def __str__(self) -> str:
        near = int(np.argmin(self.nearest_distance))
        named = np.isfinite(self.nearest_distance[near])
        where = f"{self.nearest_distance[near]:.3g} m from {self.nearest_name[near]}" if named else "there is none"
        rows = [
            f"{len(self.center)} poses: {self.verdict.value}",
            f"  nearest named locus: {where}",
            f"  nearest singular centre, to first order: {self.singular_distance.min():.3g} m",
            f"  lowest 1/cond, of normal: {self.relative_condition.min():.2g}",
            f"  position known to, at worst: {_length(self.deviation.max())} (one standard deviation)",
        ]
        if self.risk is not None:
            rows.append(
                f"  run with law {self.risk.law}: harm at most {self.risk.probability.max():.0%}, speed at most "
                f"{self.risk.demand.max():.2g} of the robot's limit"
            )
        return "\n".join([*rows, *(f"  - {reason}" for reason in self.reasons())])

    def as_json(self) -> dict[str, Any]:
        """Return what a program needs; None for what is infinite or not known."""
        return {
            "verdict": self.verdict.value,
            "reasons": self.reasons(),
            "law": None if self.risk is None else self.risk.law,
            "poses": [
                {
                    "center": self.center[i].tolist(),
                    "nearest": self.nearest_name[i],
                    "nearest_distance": _number(self.nearest_distance[i]),
                    "singular_distance": _number(self.singular_distance[i]),
                    "relative_condition": _number(self.relative_condition[i]),
                    "z": _number(self.z[i]),
                    "position_deviation": _number(self.deviation[i]),
                    "lines_in_view": int(self.lines_in_view[i]),
                    "risk": None if self.risk is None else float(self.risk.probability[i]),
                    "demand": None if self.risk is None else _number(self.risk.demand[i]),
                }
                for i in range(len(self.center))
            ],
        }


def report_path(
    singular: SingularSet,
    poses: Sequence[Pose],
    camera: Camera,
    ends: Array | None = None,
    clearance: float = 0.1,
    accuracy: float = 0.02,
    risk: PathRisk | None = None,
) -> PathReport:
    """Return what awaits a camera at poses.

    Args:
        singular: The singular set of the lines, with their tolerances.
        poses: T_world_camera of each.
        camera: Noise and field of view.
        ends: End points of the segments that can be seen, shape (n, 2, 3) [m]; None: the lines have no ends.
        clearance: Distance to singular loci to keep [m].
        accuracy: Standard deviation of the position that is good enough [m].
        risk: Of the same poses.

    Raises:
        GeometryError: If there is no pose.
    """
    information = line_information(singular.lines, poses, camera, ends)
    count = information.visible.sum(axis=1)
    near = [singular.proximity(pose) for pose in poses]
    nearest = [singular.nearest_locus(pose) for pose in poses]
    everywhere = singular.singular_everywhere
    none = (0.0, "every camera centre") if everywhere else (math.inf, "")
    named = [none if each is None else (each.distance, each.name) for each in nearest]
    return PathReport(
        center=np.array([pose.translation for pose in poses]),
        nearest_distance=np.array([distance for distance, _ in named]),
        nearest_name=tuple(name for _, name in named),
        singular_distance=np.array([each.distance for each in near]),
        relative_condition=np.array([each.relative_condition for each in near]),
        z=np.array([math.nan if each.z is None else each.z for each in near]),
        deviation=position_deviations(information.matrices.sum(axis=1), count),
        lines_in_view=count,
        clearance=clearance,
        accuracy=accuracy,
        risk=risk,
    )


def _length(value: float) -> str:
    return f"{value:.3g} m" if value >= 1.0 else f"{1000.0 * value:.3g} mm"


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
