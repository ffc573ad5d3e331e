# SPDX-License-Identifier: Apache-2.0
"""A servo run in a few lines: a free-flying camera that sees lines and obeys a controller."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.control.servo_controller import ServoController
from plsing_ros.errors import ParameterError, PlsingError
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters import SimulatorParameters
from plsing_ros.parameters.options import parameters_from_options
from plsing_ros.simulation.servo_run import servo_frames
from plsing_ros.simulation.simulation import Simulation


@dataclass(frozen=True, eq=False)
class SimulatedRun:
    """A run, a row for each frame.

    Attributes:
        poses: T_world_camera of each frame.
        twists: Commanded (v, omega) in the camera's optical frame, shape (k, 6) [m/s, rad/s].
        times: Since the start, shape (k,) [s].
        arrived: Whether the last pose is the target, within the tolerances of simulate.
        reason: Why the run ended, in words.
        target: T_world_camera of the target.
        inverse_condition_numbers: Of the matrix that the controller inverted, shape (k,).
    """

    poses: tuple[Pose, ...]
    twists: Array
    times: Array
    arrived: bool
    reason: str
    target: Pose
    inverse_condition_numbers: Array

    @property
    def distances(self) -> Array:
        """Distance of the camera centre from the target, shape (k,) [m]."""
        return np.array([np.linalg.norm(pose.translation - self.target.translation) for pose in self.poses])

    def __str__(self) -> str:
        speed = np.linalg.norm(self.twists[:, :3], axis=1)
        return (
            f"{'arrived' if self.arrived else 'not arrived'} after {self.times[-1]:.3g} s: {self.reason}; distance "
            f"from {self.distances[0]:.3g} to {self.distances[-1]:.3g} m, at most {self.distances.max():.3g} m; "
            f"|v| at most {speed.max():.3g} m/s; lowest inverse condition number "
            f"{self.inverse_condition_numbers.min():.2g}"
        )

    def plot(self, file: str | Path | None = None) -> Any:
        """Draw path, distance, speed and inverse condition number; return the figure of matplotlib.

        Args:
            file: Where to save it as well; None: nowhere.

        Raises:
            PlsingError: If matplotlib is not installed.
        """
        try:
            from matplotlib.figure import Figure
        except ImportError:
            raise PlsingError(
                "a run is drawn with matplotlib, which is not installed: sudo apt install python3-matplotlib, "
                "or pip install matplotlib"
            ) from None

        figure = Figure(figsize=(11, 6), layout="constrained")
        centers = np.array([pose.translation for pose in self.poses])
        space = figure.add_subplot(1, 2, 1, projection="3d")
        space.plot(*centers.T, label="camera centre")
        space.plot(*centers[0], "o", label="start")
        space.plot(*self.target.translation, "*", color="black", markersize=10, label="target")
        space.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
        space.legend()
        for row, (label, values, scale) in enumerate(
            (
                ("distance to target [m]", self.distances, "linear"),
                ("|v| [m/s]", np.linalg.norm(self.twists[:, :3], axis=1), "linear"),
                ("inverse condition number", self.inverse_condition_numbers, "log"),
            )
        ):
            axes = figure.add_subplot(3, 2, 2 * row + 2)
            axes.plot(self.times, values)
            axes.set(ylabel=label, yscale=scale)
        axes.set_xlabel("time [s]")
        if file is not None:
            figure.savefig(file, dpi=110)
        return figure


def simulate(
    lines: LineSet,
    start: Pose,
    target: Pose,
    law: str = "pinv",
    gain: float = 0.5,
    noise: float = 0.0,
    *,
    seed: int = 0,
    time_step: float = 0.04,
    max_time: float = 60.0,
    tolerance: tuple[float, float] = (1e-3, 1e-3),
    **options: Any,
) -> SimulatedRun:
    """Let a camera servo from a start to a target, and record it.

    Args:
        lines: The scene, in the world frame.
        start: T_world_camera at the start.
        target: T_world_camera at the target.
        law: Control law: "pinv", "guarded", "detour", ...
        gain: lambda [1/s].
        noise: Standard deviation of the noise on each Pluecker coordinate of the seen lines.
        seed: Of the noise.
        time_step: Between two frames [s].
        max_time: When the run is given up [s].
        tolerance: Distance [m] and angle [rad] from the target at which it has arrived.
        options: Further parameters of the controller by name, nested where they have dots.

    Raises:
        ParameterError: If an argument is not allowed.
    """
    if not time_step < max_time < math.inf:
        raise ParameterError(f"argument 'max_time' is {max_time} s; it must be a number above time_step, {time_step} s")
    values = {"start": start, "mode": "lockstep", "time_step": time_step, "noise": noise, "seed": seed}
    simulation = Simulation(parameters_from_options(SimulatorParameters, values, lines))
    controller = ServoController(lines, target, law=law, gain=gain, **options)
    poses, twists, conditions = [], [], []
    arrived, reason = False, f"not there after {max_time:g} s"
    for pose, command in servo_frames(simulation, controller):
        poses.append(pose)
        twists.append(command.twist)
        conditions.append(command.inverse_condition_number)
        arrived = _is_there(pose, target, *tolerance)
        if arrived or len(poses) * time_step > max_time:
            break
    else:
        reason = simulation.reason
    if arrived:
        reason = "at the target"
    elif not command.mode.moves:
        reason = command.reason
    return SimulatedRun(
        tuple(poses),
        np.array(twists),
        np.arange(len(poses), dtype=float) * time_step,
        arrived,
        reason,
        target,
        np.array(conditions),
    )


def _is_there(pose: Pose, target: Pose, distance: float, angle: float) -> bool:
    turn = (np.trace(pose.rotation.T @ target.rotation) - 1.0) / 2.0
    near = np.linalg.norm(pose.translation - target.translation) <= distance
    return bool(near and math.acos(min(max(turn, -1.0), 1.0)) <= angle)
