# SPDX-License-Identifier: Apache-2.0
"""Parameters of the control law."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.errors import ParameterError
from plsing_ros.parameters.parameter_set import parameter
from plsing_ros.parameters.task import TaskParameters

LAWS = ("pinv", "dls", "adaptive_dls", "guarded", "detour", "position", "fused")
# Laws that go straight by the pose: image lines are weighed by their covariances, or do not count.
STRAIGHT_LAWS = ("position", "fused")
# Laws that may go by the pose.
POSE_LAWS = (*STRAIGHT_LAWS, "detour")
_RELATIVE = "in units of the target's smallest singular value with the same lines"
# The default limits [m/s, rad/s], and the laws that know none.
_SPEEDS = (0.25, 1.0)
# A loop diverges when gain times a latency that is not looked ahead by is above pi / 2.
_MAX_GAIN_LATENCY = 3.0
_UNLIMITED_LAWS = ("pinv", "dls", "adaptive_dls")
_LIMIT_TEXT = "the whole twist is scaled down to it. 0: none for pinv, dls and adaptive_dls, {:g} for the other laws"


@dataclass(frozen=True)
class LawParameters(TaskParameters):
    """By which law the camera moves, and how fast."""

    law: str = parameter(
        "pinv",
        "law",
        "pinv (the paper's), dls (constant damping), adaptive_dls (damping along the unobservable motion near a "
        "singularity), guarded (slow where a locus is ahead, the unobservable motion limited), detour (along a path "
        "planned round the loci), position (straight by the pose that the 3-D lines stand for), fused (as position, "
        "corrected by the image); see docs/laws.md",
        choices=LAWS,
    )
    interaction: str = parameter(
        "auto",
        "interaction",
        "The L that is inverted: at the current features, at the target (then constant), or the mean of both; "
        "auto: mean for guarded, target for detour (there: on the path), where L at the target is known, else current",
        choices=("auto", "current", "target", "mean"),
    )
    gain: float = parameter(
        0.1, "gain", "lambda of the law tau = -lambda pinv(L) (s - s*)", unit="1/s", minimum=1e-6, maximum=1000.0
    )
    gain_slope: float = parameter(
        0.0,
        "gain_slope",
        "How fast lambda falls with the error: -d lambda / d |s - s*| at zero error; 0: lambda is constant",
        unit="1/s",
        minimum=0.0,
        maximum=1e6,
    )
    gain_at_infinity: float = parameter(
        0.05,
        "gain_at_infinity",
        "lambda for an infinite error, below gain; with gain_slope 0 it has no effect",
        unit="1/s",
        minimum=1e-6,
        maximum=1000.0,
    )
    degrees_of_freedom: tuple[int, ...] = parameter(
        (1, 1, 1, 1, 1, 1),
        "degrees_of_freedom",
        "Which of v_x, v_y, v_z, omega_x, omega_y, omega_z of the camera the law may use: 1 or 0 each",
        minimum=0,
        maximum=1,
    )
    secondary_twist: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        "secondary_twist",
        "Twist of the camera that is wanted as far as it changes no image line: projected on the null space of L; "
        "v in m/s, omega in rad/s",
    )
    integral_gain: float = parameter(
        0.0,
        "integral_gain",
        "Weight of the time integral of s - s* beside s - s* itself; 0: none",
        unit="1/s",
        minimum=0.0,
        maximum=100.0,
    )
    integral_limit: float = parameter(
        0.1,
        "integral_limit",
        "Largest norm of the time integral times integral_gain, in units of s - s*",
        minimum=0.0,
        maximum=100.0,
    )
    pinv_threshold: float = parameter(
        1e-12,
        "pinv_threshold",
        "Singular values of L below this times the largest one are taken as zero by every law",
        minimum=0.0,
        maximum=0.1,
    )
    damping: float = parameter(
        0.3, "damping", f"dls: damping of every singular value, {_RELATIVE}", minimum=0.0, maximum=1000.0
    )
    onset: float = parameter(
        0.5,
        "onset",
        f"adaptive_dls, guarded: a singular value below this is taken as nearly unobservable, {_RELATIVE}",
        minimum=1e-6,
        maximum=1.0,
    )
    max_damping: float = parameter(
        0.5,
        "max_damping",
        f"adaptive_dls: damping of a singular value that is zero, {_RELATIVE}",
        minimum=0.0,
        maximum=1000.0,
    )
    guard_margin: float = parameter(
        0.15,
        "guard.margin",
        "guarded: motion towards a locus is slowed down when nearer than this",
        unit="m",
        minimum=1e-6,
        maximum=1000.0,
    )
    guard_floor: float = parameter(
        0.2,
        "guard.floor",
        "guarded: share of the speed that is always left, also straight towards a locus",
        minimum=1e-3,
        maximum=1.0,
    )
    guard_unobservable_share: float = parameter(
        1.0,
        "guard.unobservable_share",
        "guarded: the nearly unobservable motion may be as fast as this times the rest of the twist when its singular "
        "value is half way down (docs/controller.md)",
        minimum=0.0,
        maximum=1000.0,
    )
    detour_margin: float = parameter(
        0.2,
        "detour.margin",
        "detour: distance that a path keeps from the loci, less where start or target are nearer themselves",
        unit="m",
        minimum=1e-3,
        maximum=1000.0,
    )
    detour_linear_speed: float = parameter(
        0.1, "detour.linear_speed", "detour: |v| along a path", unit="m/s", minimum=1e-6, maximum=1e6
    )
    detour_angular_speed: float = parameter(
        0.2, "detour.angular_speed", "detour: |omega| along a path", unit="rad/s", minimum=1e-6, maximum=1e6
    )
    detour_replan_distance: float = parameter(
        0.3,
        "detour.replan_distance",
        "detour: a new path is planned when the camera is farther than this from where it should be",
        unit="m",
        minimum=1e-3,
        maximum=1000.0,
    )
    detour_pose_onset: float = parameter(
        0.05,
        "detour.pose_onset",
        "detour: motions with this singular value of L are led half by the image and half by the pose from the 3-D "
        "lines, those with a smaller one more by the pose; 0: by the image alone",
        minimum=0.0,
        maximum=1000.0,
    )
    detour_max_scale_error: float = parameter(
        0.2,
        "detour.max_scale_error",
        "detour, to a target pose: a common scale of the 3-D lines that clearly contradicts the scene is corrected, by "
        "this share at most; 0: it is taken as right (docs/laws.md)",
        minimum=0.0,
        maximum=0.9,
    )
    detour_risk_margin: float = parameter(
        0.05,
        "detour.risk_margin",
        "detour, where the pose is known with its covariance beside the image: it goes straight, as fused does, where "
        "the predicted risk of that is at most this above that of a path round; 0: always round (docs/laws.md)",
        minimum=0.0,
        maximum=1.0,
    )
    fused_position_std: float = parameter(
        0.005,
        "fused.position_std",
        "fused: standard deviation of the position that 3-D lines stand for, each coordinate; grows to what is seen",
        unit="m",
        minimum=1e-9,
        maximum=1000.0,
    )
    fused_rotation_std: float = parameter(
        0.005,
        "fused.rotation_std",
        "fused: likewise of the orientation, about each axis",
        unit="rad",
        minimum=1e-9,
        maximum=10.0,
    )
    fused_angle_std: float = parameter(
        0.004,
        "fused.angle_std",
        "fused: standard deviation of an image line's angle; grows to what is seen",
        unit="rad",
        minimum=1e-9,
        maximum=10.0,
    )
    fused_offset_std: float = parameter(
        0.001,
        "fused.offset_std",
        "fused: likewise of its offset, in normalised image coordinates",
        minimum=1e-9,
        maximum=10.0,
    )
    fused_map_std: float = parameter(
        0.02,
        "fused.map_std",
        "fused, to a target that was not shown: standard deviation of a line in the map, focal length included",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
    )
    half_view: tuple[float, ...] = parameter(
        (0.0, 0.0),
        "camera.half_view",
        "Tangents of half the field of view, horizontal and vertical: half the image over focal length; 0: not limited",
        minimum=0.0,
        maximum=1e3,
    )
    latency: float = parameter(
        0.0,
        "latency",
        "From when an image is taken to when the robot moves by it, its lag included: the law looks ahead by the "
        "twists sent meanwhile; 0: it does not",
        unit="s",
        minimum=0.0,
        maximum=2.0,
    )
    max_linear_speed: float = parameter(
        _SPEEDS[0],
        "max_linear_speed",
        f"Limit of |v|; {_LIMIT_TEXT.format(_SPEEDS[0])}",
        unit="m/s",
        minimum=0.0,
        maximum=1e6,
    )
    max_angular_speed: float = parameter(
        _SPEEDS[1],
        "max_angular_speed",
        f"Limit of |omega|; {_LIMIT_TEXT.format(_SPEEDS[1])}",
        unit="rad/s",
        minimum=0.0,
        maximum=1e6,
    )

    def check_law(self) -> None:
        """Refuse values that contradict each other."""
        if self.gain_slope > 0.0 and self.gain_at_infinity >= self.gain:
            raise ParameterError(
                f"parameter 'gain_at_infinity' is {self.gain_at_infinity} 1/s; with a gain_slope it must be below "
                f"gain, {self.gain} 1/s"
            )
        for name, values in (
            ("degrees_of_freedom", self.degrees_of_freedom),
            ("secondary_twist", self.secondary_twist),
        ):
            if len(values) != 6:
                raise ParameterError(f"parameter '{name}' has {len(values)} numbers; it must have 6")
        if self.gain * self.latency > _MAX_GAIN_LATENCY:
            raise ParameterError(
                f"parameter 'gain' {self.gain:g} 1/s times 'latency' {self.latency:g} s is "
                f"{self.gain * self.latency:.3g}; allowed is {_MAX_GAIN_LATENCY:g}, or an error of half the latency "
                "makes the loop diverge"
            )
        if len(self.half_view) != 2:
            raise ParameterError(f"parameter 'camera.half_view' has {len(self.half_view)} numbers; it must have 2")
        if not any(self.degrees_of_freedom):
            raise ParameterError("parameter 'degrees_of_freedom' has no 1; at least one must be left to move")

    @cached_property
    def is_plain(self) -> bool:
        """Whether the law is the paper's, tau = -gain pinv(L) (s - s*) with the present L, and no option is in use."""
        return (
            self.law == "pinv"
            and self.interaction in ("auto", "current")
            and self.gain_slope == 0.0
            and self.integral_gain == 0.0
            and all(self.degrees_of_freedom)
            and not any(self.secondary_twist)
        )

    @cached_property
    def columns(self) -> tuple[int, ...]:
        """Which columns of L belong to the degrees of freedom in use."""
        return tuple(column for column, used in enumerate(self.degrees_of_freedom) if used)

    @cached_property
    def pose_covariance(self) -> Array:
        """Of the pose that 3-D lines stand for: position, then orientation, shape (6, 6) [m^2, rad^2]."""
        return np.diag(np.repeat([self.fused_position_std**2, self.fused_rotation_std**2], 3))

    @cached_property
    def image_covariance(self) -> Array:
        """Of angle [rad] and offset of an image line: (angle angle, angle offset, offset offset), shape (3,)."""
        return np.array([self.fused_angle_std**2, 0.0, self.fused_offset_std**2])

    def selected(self, twist: Array) -> Array:
        """Return a twist (6,) with zeros for the degrees of freedom that may not be used."""
        selected: Array = twist * np.array(self.degrees_of_freedom, dtype=float)
        return selected

    @cached_property
    def speed_limits(self) -> tuple[float, float]:
        """The limits of |v| [m/s] and |omega| [rad/s] in force, infinite where there is none."""
        linear, angular = (float("inf"), float("inf")) if self.law in _UNLIMITED_LAWS else _SPEEDS
        return self.max_linear_speed or linear, self.max_angular_speed or angular
