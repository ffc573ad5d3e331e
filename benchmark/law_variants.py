# SPDX-License-Identifier: Apache-2.0
"""The control laws that are compared: their numbers, and what they make of L, for many cameras at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

GAIN = 0.1  # lambda [1/s]


@dataclass(frozen=True)
class Law:
    """A control law and its numbers, as the parameters of the controller.

    Attributes:
        name: For tables.
        inverse: "pinv", "dls", "adaptive_dls", "guarded" or "image_and_pose".
        interaction: Which L is inverted: "current", "target" (on a path that is followed: there) or "mean".
        threshold: Of pinv.
        damping: Of dls; onset and max_damping: of adaptive_dls and guarded.
        pose_onset: Of image_and_pose.
        max_scale_error: Of image_and_pose; 0: the scale of 3-D lines is taken as right.
        limits: Of |v| [m/s] and |omega| [rad/s], one factor for both.
        follows: Whether a planned path is followed.
    """

    name: str
    inverse: str = "pinv"
    interaction: str = "current"
    threshold: float = 1e-12
    damping: float = 0.3
    onset: float = 0.5
    max_damping: float = 0.5
    guard_margin: float = 0.15
    guard_floor: float = 0.2
    guard_unobservable_share: float = 1.0
    pose_onset: float = 0.05
    max_scale_error: float = 0.2
    limits: tuple[float, float] = (np.inf, np.inf)
    follows: bool = False

    @property
    def parameters(self) -> dict[str, object]:
        """The values of the controller's parameters that make it this law."""
        return {
            "law": "detour" if self.follows else self.inverse,
            "interaction": self.interaction,
            "pinv_threshold": self.threshold,
            "damping": self.damping,
            "onset": self.onset,
            "max_damping": self.max_damping,
            "guard.margin": self.guard_margin,
            "guard.floor": self.guard_floor,
            "guard.unobservable_share": self.guard_unobservable_share,
            "detour.pose_onset": self.pose_onset,
            "detour.max_scale_error": self.max_scale_error,
            "max_linear_speed": 0.0 if np.isinf(self.limits[0]) else self.limits[0],
            "max_angular_speed": 0.0 if np.isinf(self.limits[1]) else self.limits[1],
            "gain": GAIN,
        }


# What a limit is where there is one [m/s], [rad/s]: the defaults of guarded and detour.
LIMITS = (0.15, 0.5)
LAWS = (
    Law("pinv"),
    Law("pinv, threshold 1e-4", threshold=1e-4),
    Law("pinv, threshold 1e-3", threshold=1e-3),
    Law("pinv, DESIRED", interaction="target"),
    Law("pinv, MEAN", interaction="mean"),
    Law("pinv, limited", limits=LIMITS),
    Law("dls", "dls"),
    Law("adaptive_dls", "adaptive_dls"),
    Law("guarded", "guarded", "mean", limits=LIMITS),
    Law("detour", "image_and_pose", "target", limits=LIMITS, follows=True),
)


def feedback(
    law: Law, parts: tuple[np.ndarray, ...], error: np.ndarray, reference: np.ndarray, away: np.ndarray
) -> np.ndarray:
    """Return the twists of a law before guard and limits, shape (k, 6).

    Args:
        law: The law.
        parts: Singular value decompositions of the matrices to invert.
        error: s - s*, shape (k, 3m).
        reference: Smallest singular values at the targets, shape (k,).
        away: Twists that lead from where the cameras should be to where they are in unit time, shape (k, 6).
    """
    left, values, right = parts
    kept = values > law.threshold * values[:, :1]
    factors = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
    onset = (law.onset * reference)[:, np.newaxis]
    if law.inverse == "dls":
        factors /= 1.0 + (law.damping * reference[:, np.newaxis] * factors) ** 2
    elif law.inverse == "adaptive_dls":
        square = (1.0 - np.minimum(values / onset, 1.0) ** 2) * (law.max_damping * reference[:, np.newaxis]) ** 2
        factors = np.where(kept, values / np.maximum(values**2 + square, 1e-300), 0.0)
    amplitude = -GAIN * factors * np.einsum("kij,ki->kj", left, error)
    if law.inverse == "image_and_pose":
        image_share = kept * values**2 / (values**2 + law.pose_onset**2)
        by_pose = -GAIN * np.einsum("kij,kj->ki", right, away)
        amplitude = image_share * amplitude + (1.0 - image_share) * by_pose
    if law.inverse == "guarded":
        health = _smooth(values / onset)
        lost = health < 1.0
        rest = np.sqrt(np.where(lost, 0.0, amplitude**2).sum(axis=1, keepdims=True))
        least = 0.01 * law.limits[0]
        most = (law.guard_unobservable_share * rest + least) * health / np.where(lost, 1.0 - health, 1.0)
        amplitude = np.where(lost, np.clip(amplitude, -most, most), amplitude)
    return np.einsum("kji,kj->ki", right, amplitude)


def guard(law: Law, offset: np.ndarray, axis: np.ndarray, velocity: np.ndarray, health: np.ndarray) -> np.ndarray:
    """Return the share of the speed that the guard leaves, shape (k,).

    Args:
        law: The law.
        offset: From the camera centres to a point of each locus, shape (k, p, 3) [m].
        axis: Unit directions of the loci, zero for points, likewise.
        velocity: Of the camera centres in the same frame, shape (k, 3).
        health: Smallest singular values over those of the target, shape (k,).
    """
    offset = offset - np.einsum("kpi,kpi->kp", offset, axis)[..., np.newaxis] * axis
    distance = np.linalg.norm(offset, axis=2)
    speed = np.maximum(np.linalg.norm(velocity, axis=1), 1e-12)[:, np.newaxis]
    cosine = np.einsum("kpi,ki->kp", offset, velocity) / (speed * np.hypot(distance, 0.03 * law.guard_margin))
    slow = ((0.5 + 0.5 * cosine) ** 2 * (1.0 - _smooth(distance / law.guard_margin))).max(axis=1)
    return 1.0 - (1.0 - law.guard_floor) * (1.0 - _smooth(health / law.onset)) * slow


def saturate(twist: np.ndarray, limits: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return twists (k, 6) within limits of |v| and |omega|, and the factors they were scaled by, shape (k,)."""
    speed, turning = np.linalg.norm(twist[:, :3], axis=1), np.linalg.norm(twist[:, 3:], axis=1)
    factor = 1.0 / np.maximum(1.0, np.maximum(speed / limits[0], turning / limits[1]))
    return twist * factor[:, np.newaxis], factor


def _smooth(ratio: np.ndarray) -> np.ndarray:
    r = np.clip(ratio, 0.0, 1.0)
    return r * r * (3.0 - 2.0 * r)
