# SPDX-License-Identifier: Apache-2.0
"""Errors that stay the same for a whole run: of the map of lines, of the motion, and of the 3-D lines that are seen."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np
from scipy.spatial.transform import Rotation

from benchmark.servo_tasks import Task
from plsing_ros.geometry import LineSet, Pose

# Apart from the tasks' own draws.
_STREAM = 1


@dataclass(frozen=True)
class ErrorSizes:
    """How large the errors are; none by default. Their directions and signs are drawn for each task."""

    map_shift: float = field(
        default=0.0, metadata={"help": "of each line of the map: standard deviation of x, y and z of a shift [m]"}
    )
    map_turn: float = field(
        default=0.0,
        metadata={"help": "likewise: standard deviation of each component of a rotation vector [degrees]"},
    )
    hand_turn: float = field(
        default=0.0, metadata={"help": "angle between the frame that twists are for and the camera [degrees]"}
    )
    hand_arm: float = field(default=0.0, metadata={"help": "distance between the origins of the two [m]"})
    speed: float = field(default=0.0, metadata={"help": "share that the camera moves faster or slower than told"})
    depth: float = field(
        default=0.0, metadata={"help": "share that moments of the 3-D lines are too large or too small; images stay"}
    )

    def __str__(self) -> str:
        given = [f"{each.name} {getattr(self, each.name):g}" for each in fields(self) if getattr(self, each.name)]
        return ", ".join(given) or "none"


@dataclass(frozen=True, eq=False)
class TaskErrors:
    """What one task has of them.

    Attributes:
        map: The lines as the controller knows them, in the scene frame.
        T_told_camera: The true camera in the frame that twists are for.
        speed: Factor on the twist.
        depth: Factor on the moments of lines in the camera frame.
    """

    map: LineSet
    T_told_camera: Pose
    speed: float
    depth: float


def task_errors(sizes: ErrorSizes, seed: int, number: int, task: Task) -> TaskErrors:
    """Return the errors of task `number` of a seed: for every size the same draws, times the size."""
    generator = np.random.default_rng([seed, number, _STREAM])
    lines = task.lines
    shift, turn = generator.normal(size=(2, len(lines), 3))
    axis, arm = generator.normal(size=(2, 3))
    speed, depth = generator.choice((-1.0, 1.0), size=2)
    nearest = np.cross(lines.direction, lines.moment)
    known = LineSet.from_points_directions(
        nearest + sizes.map_shift * shift,
        Rotation.from_rotvec(np.radians(sizes.map_turn) * turn).apply(lines.direction),
        lines.frame,
        lines.ids,
    )
    rotation = Rotation.from_rotvec(np.radians(sizes.hand_turn) * axis / np.linalg.norm(axis))
    told = Pose(rotation.as_matrix(), sizes.hand_arm * arm / np.linalg.norm(arm))
    # Without an error the map is what is true, to the last bit.
    exact = sizes.map_shift == sizes.map_turn == 0.0
    return TaskErrors(lines if exact else known, told, 1.0 + sizes.speed * speed, 1.0 + sizes.depth * depth)
