# SPDX-License-Identifier: Apache-2.0
"""Parameters of the pose estimator."""

from __future__ import annotations

from dataclasses import dataclass

from plsing_ros.errors import ParameterError
from plsing_ros.parameters.parameter_set import ParameterSet, parameter
from plsing_ros.parameters.task import AnswerParameters
from plsing_ros.parameters.transform import TransformParameters


@dataclass(frozen=True)
class EstimationParameters(ParameterSet):
    """How a camera pose is estimated from image lines, and when it is called good; without the scene."""

    noise_image: float = parameter(
        1e-3,
        "noise.image",
        "Standard deviation of an image line l': of its angle in radians, and of its offset l'_z from the optical axis",
        minimum=0.0,
        maximum=1.0,
    )
    noise_scene: float = parameter(
        0.0,
        "noise.scene",
        "Standard deviation of each Plücker coordinate of the scene's lines in the scene frame (directions without "
        "unit, moments in m): how well the scene is known",
        minimum=0.0,
        maximum=1.0,
    )
    noise_camera: float = parameter(
        0.0,
        "noise.camera",
        "Standard deviation of each Plücker coordinate of the lines in the camera frame that the images are made of, "
        "as the noise of feature_simulator",
        minimum=0.0,
        maximum=1.0,
    )
    backend: str = parameter(
        "numpy",
        "backend",
        "Solver for three lines: numpy, or poselib if that package is installed",
        choices=("numpy", "poselib"),
        live=False,
    )
    max_angle: float = parameter(
        1.5707963267948966,
        "max_angle",
        "A line is visible within this angle of the optical axis; half of the diagonal field of view, "
        "or pi/2 if not known",
        unit="rad",
        minimum=0.01,
        maximum=1.5707963267948966,
    )
    max_triplets: int = parameter(
        40,
        "max_triplets",
        "Triplets of lines that are tried, the best conditioned ones, when some lines do not agree with the others",
        minimum=4,
        maximum=1000,
        live=False,
    )
    outlier_gate: float = parameter(
        4.5,
        "outlier_gate",
        "With five lines or more, one that is off by more than this many standard deviations is left out",
        minimum=2.0,
        maximum=100.0,
    )
    reversal_cost: float = parameter(
        12.0,
        "reversal_cost",
        "What a line seen against its direction counts, in squared standard deviations: -2 log of its probability",
        minimum=0.0,
        maximum=100.0,
    )
    max_position_deviation: float = parameter(
        0.03,
        "poor.position_deviation",
        "POOR above this standard deviation of the position in its worst direction",
        unit="m",
        minimum=1e-9,
        maximum=1e6,
    )
    max_rotation_deviation: float = parameter(
        0.03,
        "poor.rotation_deviation",
        "POOR above this standard deviation of the orientation about its worst axis",
        unit="rad",
        minimum=1e-9,
        maximum=10.0,
    )
    max_nonlinearity: float = parameter(
        0.5,
        "poor.nonlinearity",
        "POOR, and the covariance not to be trusted, when the misfit two standard deviations away differs by more than "
        "this share from what the covariance says",
        minimum=0.01,
        maximum=10.0,
    )
    max_residual: float = parameter(
        3.0,
        "poor.residual",
        "POOR when the root mean square residual exceeds this many standard deviations",
        minimum=1.0,
        maximum=1e3,
    )
    failed_residual: float = parameter(
        30.0,
        "failed.residual",
        "FAILED when the root mean square residual exceeds this many standard deviations",
        minimum=1.0,
        maximum=1e6,
    )
    min_likelihood_ratio: float = parameter(
        1e-3,
        "ambiguous.likelihood_ratio",
        "AMBIGUOUS when another pose is at least this plausible against the best one, as a ratio of likelihoods",
        minimum=1e-6,
        maximum=1.0,
    )

    def check(self) -> None:
        """Refuse a noise of zero and thresholds in the wrong order."""
        super().check()
        if self.noise_image == self.noise_scene == self.noise_camera == 0.0:
            raise ParameterError(
                "parameters 'noise.image', 'noise.scene' and 'noise.camera' are all 0; at least one must be positive, "
                "or no error could be told from the other"
            )
        if self.failed_residual < self.max_residual:
            raise ParameterError(
                f"parameter 'failed.residual' is {self.failed_residual}; it must be at least 'poor.residual', "
                f"{self.max_residual}"
            )


@dataclass(frozen=True)
class FilterParameters(EstimationParameters):
    """How camera poses are followed through images and twists; without the scene."""

    noise_twist: float = parameter(
        0.05,
        "noise.twist",
        "How wrong the twist is: standard deviation of each component of the linear velocity as a share of the speed, "
        "and of each component of the angular velocity as a share of the rate of turn",
        minimum=1e-6,
        maximum=1.0,
    )
    noise_linear_velocity: float = parameter(
        1e-4,
        "noise.linear_velocity",
        "What is added to that of the linear velocity, also at rest",
        unit="m/s",
        minimum=0.0,
        maximum=10.0,
    )
    noise_angular_velocity: float = parameter(
        1e-4,
        "noise.angular_velocity",
        "What is added to that of the angular velocity, also at rest",
        unit="rad/s",
        minimum=0.0,
        maximum=10.0,
    )
    twist_latency: float = parameter(
        0.0,
        "twist_latency",
        "How much later than its stamp a twist moves the camera",
        unit="s",
        minimum=0.0,
        maximum=10.0,
    )
    twist_hold: float = parameter(
        0.2,
        "twist_hold",
        "How long a twist holds if no other one follows; after that the motion is unknown",
        unit="s",
        minimum=0.001,
        maximum=60.0,
    )
    max_linear_speed: float = parameter(
        1.0,
        "motion.linear_speed",
        "The camera moves no faster than this: poses that it cannot have reached since the last one are ruled out, and "
        "nothing more is known of it where no twist is given",
        unit="m/s",
        minimum=0.0,
        maximum=1e6,
    )
    max_angular_speed: float = parameter(
        2.0,
        "motion.angular_speed",
        "The camera turns no faster than this, likewise",
        unit="rad/s",
        minimum=0.0,
        maximum=1e6,
    )

    max_dead_reckoning: float = parameter(
        5.0,
        "lost.dead_reckoning",
        "LOST when no line was seen that agrees for so long",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    lost_position_deviation: float = parameter(
        0.5,
        "lost.position_deviation",
        "LOST above this standard deviation of the position in its worst direction",
        unit="m",
        minimum=1e-6,
        maximum=1e6,
    )
    lost_rotation_deviation: float = parameter(
        0.5,
        "lost.rotation_deviation",
        "LOST above this standard deviation of the orientation about its worst axis",
        unit="rad",
        minimum=1e-6,
        maximum=10.0,
    )


@dataclass(frozen=True)
class PoseEstimatorParameters(FilterParameters, AnswerParameters, TransformParameters):
    """The scene, how to estimate in it, and how the node treats time."""

    last_pose_timeout: float = parameter(
        1.0,
        "last_pose_timeout",
        "How long a pose that is OK or POOR is used as a start for the next ones",
        unit="s",
        minimum=0.0,
        maximum=60.0,
    )
    filter: bool = parameter(
        True,
        "filter",
        "Whether camera_pose and the completed features come from all images and the motion between them; if not, from "
        "each image alone",
        live=False,
    )
    twist_source: str = parameter(
        "cmd_twist",
        "twist_source",
        "Topic that says how the camera moves, a TwistStamped in the optical frame: cmd_twist as commanded, odom_twist "
        "as measured",
        choices=("cmd_twist", "odom_twist"),
        live=False,
    )

    def check(self) -> None:
        """Refuse a scene that is not one, or has too few lines for a pose."""
        super().check()
        self.require_three_lines("for a camera pose")
