# SPDX-License-Identifier: Apache-2.0
"""Parameters of the loop that the monitor rolls out: the controller's law, camera, robot and noise."""

from __future__ import annotations

from dataclasses import dataclass

from plsing_ros.errors import ParameterError
from plsing_ros.parameters.law import LawParameters
from plsing_ros.parameters.parameter_set import parameter
from plsing_ros.parameters.tolerance import ToleranceParameters


@dataclass(frozen=True)
class LoopParameters(LawParameters, ToleranceParameters):
    """The law in force by the controller's own parameters, and everything between it and the camera's motion."""

    controller: str = parameter(
        "law",
        "prediction.controller",
        "law: the closed loop is rolled out with the parameters law, gain, ... and what controller/state says; "
        "unknown: only what the twists tell is used",
        choices=("law", "unknown"),
    )
    samples: int = parameter(
        8,
        "prediction.samples",
        "Noise samples of a roll-out: risk is the share that comes to harm",
        minimum=1,
        maximum=1000,
    )
    prediction_period: float = parameter(
        0.2,
        "prediction.period",
        "Time between two roll-outs, by the stamps of features",
        unit="s",
        minimum=1e-3,
        maximum=60.0,
    )
    frames_late: int = parameter(1, "loop.latency", "Frames after which a twist is carried out", minimum=0, maximum=100)
    jitter: float = parameter(
        0.0,
        "loop.jitter",
        "Standard deviation of what comes on top of loop.latency, in frames",
        minimum=0.0,
        maximum=8.0,
    )
    dropped_frames: float = parameter(
        0.0, "loop.dropped_frames", "Share of frames without features", minimum=0.0, maximum=1.0
    )
    robot_lag: float = parameter(
        0.05, "robot.lag", "Time constant of the robot's speed", unit="s", minimum=0.0, maximum=60.0
    )
    robot_linear_speed: float = parameter(
        0.25,
        "robot.linear_speed",
        "The robot's limit of |v|: what demand refers to; 0: none",
        unit="m/s",
        minimum=0.0,
        maximum=1e6,
    )
    robot_angular_speed: float = parameter(
        1.0,
        "robot.angular_speed",
        "The robot's limit of |omega|: what demand refers to; 0: none",
        unit="rad/s",
        minimum=0.0,
        maximum=1e6,
    )
    robot_clamps: bool = parameter(
        True, "robot.clamps", "Whether the robot scales a faster twist down to its limits, or follows it all the same"
    )
    image_noise: float = parameter(
        0.0,
        "camera.image_noise",
        "Standard deviation of the ends of segments across them, in pixels over focal length (0.3 / 600, say)",
        minimum=0.0,
        maximum=1.0,
    )
    nearest: float = parameter(
        0.02, "camera.nearest", "Nothing nearer than this is seen", unit="m", minimum=1e-6, maximum=1e3
    )
    shortest_image: float = parameter(
        0.0,
        "camera.min_length",
        "Shortest image of a segment that is found, in pixels over focal length",
        minimum=0.0,
        maximum=10.0,
    )
    focal_error: float = parameter(
        0.0, "camera.focal_error", "Relative standard deviation of the focal length", minimum=0.0, maximum=0.5
    )
    map_noise: float = parameter(
        0.0,
        "prediction.map_noise",
        "Standard deviation of the map's lines that roll-outs draw, one map for each sample",
        unit="m",
        minimum=0.0,
        maximum=10.0,
    )
    pose_position_noise: float = parameter(
        0.0,
        "pose_noise.position",
        "Standard deviation of the pose that the features' 3-D lines are made with, from frame to frame, each axis",
        unit="m",
        minimum=0.0,
        maximum=10.0,
    )
    pose_rotation_noise: float = parameter(
        0.0, "pose_noise.rotation", "Likewise, about each axis", unit="rad", minimum=0.0, maximum=1.0
    )
    line_ends: tuple[float, ...] = parameter(
        (),
        "lines.ends",
        "Both ends of each segment in the scene frame (x1, y1, z1, x2, y2, z2 of line 1, then line 2, ...); empty: "
        "as the features' ends say, or wherever lines pass",
        unit="m",
    )

    def check_loop(self) -> None:
        """Refuse what does not fit together."""
        self.check_law()
        if self.line_ends and len(self.line_ends) != 2 * len(self.lines_points):
            raise ParameterError(
                f"parameter 'lines.ends' has {len(self.line_ends)} numbers; it must have 6 for each line, "
                f"{2 * len(self.lines_points)}, or none"
            )
