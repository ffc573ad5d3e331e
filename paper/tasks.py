# SPDX-License-Identifier: Apache-2.0
"""The paper's servo experiments as data: section "Simulation results"."""

from __future__ import annotations

from paper.scenes import five_lines, four_lines
from plsing_ros.geometry import LineSet
from plsing_ros.simulation import near_transversal
from plsing_ros.simulation.servo_task import ServoTask
from plsing_ros.simulation.target_paths import CubicPath, FixedPoint, Path, Quadrifolium, View

# Names of the groups, in the order of the paper.
STARTS_FOUR, TRAJECTORIES, QUADRIFOLIA, STARTS_FIVE = "starts of four", "trajectories", "quadrifolia", "starts of five"

# Eq. traj1_sing crosses L_N at s = 0, eq. traj2_nosing does not.
TRAJECTORY_MIDDLES = ((-1.7551, 0.3992, 10.0), (-3.2551, 0.3992, 10.30))
TRAJECTORY_GAIN, TRAJECTORY_NOISE = 1.0, 2e-3

# Ex. 0 is away from singularities; Ex. 1 to 6 are centred at the isolated points of eq. 4linessims_isolated_points.
QUADRIFOLIUM_MIDDLES = (
    (-8.858, -2.473, -1.841),
    (-9.858, -2.473, -1.841),
    (0.0541, 0.0092, 1.8422),
    (-0.3203, 0.0105, 0.2205),
    (1.0113, 0.7947, -0.8850),
    (0.9387, 0.5681, -2.0225),
    (65.09, -96.57, -0.03639),
)
QUADRIFOLIUM_GAIN, QUADRIFOLIUM_NOISE = 5.0, 1e-3

FIVE_NOISE = 2e-3

# How long a run to a fixed target may take [s].
_START_DURATION = 80.0


def paper_tasks() -> dict[str, tuple[ServoTask, ...]]:
    """Return all servo runs of the paper by group, with our choices for what it leaves open.

    The camera's orientation is constant in each run, with the optical axis from P_M or the path's middle to the origin;
    the noise is on the 3-D lines and not on the image.
    """
    return {
        STARTS_FOUR: _starts(four_lines(), 0.0),
        TRAJECTORIES: tuple(
            _following(f"Trajectory {number}", CubicPath(middle), TRAJECTORY_GAIN, TRAJECTORY_NOISE)
            for number, middle in enumerate(TRAJECTORY_MIDDLES, start=1)
        ),
        QUADRIFOLIA: tuple(
            _following(f"Ex. {number}", Quadrifolium(middle), QUADRIFOLIUM_GAIN, QUADRIFOLIUM_NOISE)
            for number, middle in enumerate(QUADRIFOLIUM_MIDDLES)
        ),
        STARTS_FIVE: _starts(five_lines(), FIVE_NOISE),
    }


def _starts(lines: LineSet, noise: float) -> tuple[ServoTask, ...]:
    x, y, z = near_transversal.POINT_ON_TRANSVERSAL.tolist()
    target = near_transversal.TARGET_POSITION.tolist()
    return tuple(
        ServoTask(
            start.name,
            lines,
            start.position,
            FixedPoint((target[0], target[1], target[2]), _START_DURATION),
            View(seen_from=(x, y, z)),
            near_transversal.GAIN,
            noise=noise,
            arrived=near_transversal.ARRIVED,
        )
        for start in near_transversal.STARTS
    )


def _following(name: str, path: CubicPath | Quadrifolium, gain: float, noise: float) -> ServoTask:
    on_path: Path = path
    return ServoTask(name, four_lines(), on_path.position(0.0), path, View(seen_from=path.middle), gain, noise=noise)
