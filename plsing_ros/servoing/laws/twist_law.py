"""From an interaction matrix and an error to a twist: the chosen law with its options."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.errors import ObservationError
from plsing_ros.features import factorised
from plsing_ros.parameters import ControllerParameters
from plsing_ros.servoing.laws.gain import adaptive_gain
from plsing_ros.servoing.laws.inverses import (
    adaptive_damping,
    dls_factors,
    limited_amplitudes,
    null_space_part,
    pinv_factors,
    pose_shares,
    smooth_step,
)
from plsing_ros.servoing.laws.mean_interaction import mean_interaction
from plsing_ros.servoing.target import TargetView

# Smallest over largest singular value that damping and guard refer to when the target's is not known, and the least
# one they refer to when it is.
_REFERENCE = 1e-4
_LEAST_REFERENCE = 1e-6
# Which L is inverted with interaction = auto, where it is known at the target; else the current one.
_AUTO = {"guarded": "mean", "detour": "desired"}
# What the guard always leaves to a nearly lost motion, times h / (1 - h), as a share of the speed limit.
_CREEP = 0.01


class LawTwist(NamedTuple):
    """What the law asks for, before the guard and the speed limits.

    Attributes:
        twist: (v, omega) of the camera, shape (6,).
        gain: lambda [1/s].
        values: Singular values of the matrix that was inverted, largest first, shape (m,).
        damping: Of the smallest one.
        health: Smallest singular value of L at the current features over where it is taken as nearly lost; 1 for a
            law without a guard.
    """

    twist: Array
    gain: float
    values: Array
    damping: float
    health: float


def law_twist(
    parameters: ControllerParameters,
    interaction: Array,
    image: Array,
    error: Array,
    integral: Array | None,
    view: TargetView,
    displacement: Array | None = None,
) -> LawTwist:
    """Return the twist of the law in force.

    Args:
        parameters: The law and its options.
        interaction: L at the current features, shape (3n, 6).
        image: s, shape (3n,).
        error: s - s*, shape (3n,).
        integral: To be added to the error, shape (3n,), or None.
        view: The target, or where the way is, seen through the same lines and degrees of freedom.
        displacement: Of the camera from there by the pose, as a twist over unit time, shape (6,): what law = detour
            holds to along motions that the image does not show.

    Raises:
        ObservationError: If the law needs L at the target, which is not known.
        GeometryError: If L is not finite.
    """
    columns = parameters.columns
    gain = parameters.gain
    if parameters.gain_slope > 0.0:
        largest = float(np.abs(error).max())
        gain = adaptive_gain(largest, gain, parameters.gain_at_infinity, parameters.gain_slope)
    current = interaction if len(columns) == 6 else interaction[:, columns]
    inverted = _inverted(parameters, current, image, view)
    left, values, right = factorised(inverted)
    reference = _reference(values, view)
    onset = parameters.onset * reference
    pinv = pinv_factors(values, parameters.pinv_threshold)
    factors, damping = pinv, 0.0
    if parameters.law == "dls":
        damping = parameters.damping * reference
        factors = dls_factors(values, parameters.pinv_threshold, damping)
    elif parameters.law == "adaptive_dls":
        each = adaptive_damping(values, onset, parameters.largest_damping * reference)
        factors, damping = dls_factors(values, parameters.pinv_threshold, each), float(each[-1])
    elif parameters.law == "detour":
        damping = parameters.detour_pose_onset
        factors = dls_factors(values, parameters.pinv_threshold, damping)
    amplitudes = -gain * (factors * ((error if integral is None else error + integral) @ left))
    if displacement is not None:
        amplitudes -= gain * pose_shares(values, factors) * (right @ displacement[list(columns)])
    health = 1.0
    if parameters.law == "guarded":
        least = _CREEP * parameters.speed_limits[0]
        amplitudes = limited_amplitudes(amplitudes, smooth_step(values / onset), parameters.guard_lost_share, least)
        # The mean of two matrices can be healthy where the camera is at a singularity.
        here = values if inverted is current else factorised(current).singular_values
        health = float(here[-1]) / onset
    twist: Array = amplitudes @ right
    if any(parameters.secondary_twist):
        twist = twist + null_space_part(right, pinv, np.array(parameters.secondary_twist)[list(columns)])
    if len(columns) < 6:
        full = np.zeros(6)
        full[list(columns)] = twist
        twist = full
    return LawTwist(twist, gain, values, damping, health)


def _inverted(parameters: ControllerParameters, current: Array, image: Array, view: TargetView) -> Array:
    which = parameters.interaction
    if which == "auto":
        which = _AUTO.get(parameters.law, "current") if view.interaction is not None else "current"
    if which == "current":
        return current
    if view.interaction is None:
        raise ObservationError(
            "the desired features have no 3-D lines (directions and moments are empty), which "
            f"interaction = {which} needs"
        )
    if which == "desired":
        return view.interaction
    return mean_interaction(current, image, view.interaction, view.image)


def _reference(values: Array, view: TargetView) -> float:
    """Return the smallest singular value that is healthy for this target."""
    if view.singular_values is None:
        return max(_REFERENCE * float(values[0]), math.ulp(1.0))
    return max(float(view.singular_values[-1]), _LEAST_REFERENCE * float(view.singular_values[0]), math.ulp(1.0))
