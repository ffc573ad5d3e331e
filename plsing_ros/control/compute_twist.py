# SPDX-License-Identifier: Apache-2.0
"""From an interaction matrix and an error to a twist: the chosen law with its options."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.control.gain import law_gain
from plsing_ros.control.inverses import (
    adaptive_damping,
    dls_factors,
    limited_amplitudes,
    null_space_part,
    pinv_factors,
    pose_shares,
    smooth_step,
)
from plsing_ros.errors import ObservationError
from plsing_ros.features import LeastSquaresSolution, decompose, solve_least_squares
from plsing_ros.features.mean_interaction import mean_interaction
from plsing_ros.features.target import TargetView
from plsing_ros.parameters import ControllerParameters

# Smallest over largest singular value that damping and guard refer to when the target's is not known, and the least
# one they refer to when it is.
_REFERENCE = 1e-4
_MIN_REFERENCE = 1e-6
# Which L is inverted with interaction = auto, where it is known at the target; else the current one.
_AUTO = {"guarded": "mean", "detour": "target"}
# What the guard always leaves to a nearly unobservable motion, times h / (1 - h), as a share of the speed limit.
_CREEP = 0.01


class LawTwist(NamedTuple):
    """What the law asks for, before the guard and the speed limits.

    Attributes:
        twist: (v, omega) of the camera, shape (6,).
        gain: lambda [1/s].
        values: Singular values of the matrix that was inverted, largest first, shape (m,).
        damping: Of the smallest one.
        health: Smallest singular value of L at the current features over where it is taken as nearly unobservable; 1
            for a law without a guard.
        speed: |twist|, not finite if the twist is not.
    """

    twist: Array
    gain: float
    values: Array
    damping: float
    health: float
    speed: float


def compute_twist(
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
        image: Image lines of the 3-D lines that L is taken at, shape (3n,).
        error: s - s*, shape (3n,).
        integral: To be added to the error, shape (3n,), or None.
        view: The target, or where the path is, seen through the same lines and degrees of freedom.
        displacement: Of the camera from there by the pose, as a twist over unit time, shape (6,): what law = detour
            holds to along motions that the image does not show.

    Raises:
        ObservationError: If the law needs L at the target, which is not known.
        GeometryError: If L is not finite.
    """
    columns = parameters.columns
    gain = law_gain(parameters, error)
    current = interaction if len(columns) == 6 else interaction[:, columns]
    inverted = inverted_matrix(parameters, current, image, view)
    solution = solve_least_squares(
        inverted, error if integral is None else error + integral, -gain, parameters.pinv_threshold
    )
    twist, damping, health = solution.solution, 0.0, 1.0
    if parameters.law == "guarded":
        # The mean of two matrices can be healthy where the camera is at a singularity.
        here = solution.singular_values if inverted is current else decompose(current).singular_values
        twist, health = _guarded(parameters, solution, float(here[-1]), view)
    elif parameters.law != "pinv":
        wanted = None if displacement is None else -gain * displacement[list(columns)]
        twist, damping = _damped(parameters, solution, wanted, view)
    if any(parameters.secondary_twist):
        factors = pinv_factors(solution.singular_values, parameters.pinv_threshold)
        twist = twist + null_space_part(solution.right, factors, np.array(parameters.secondary_twist)[list(columns)])
    if len(columns) < 6:
        full = np.zeros(6)
        full[list(columns)] = twist
        twist = full
    return LawTwist(twist, gain, solution.singular_values, damping, health, math.hypot(*twist.tolist()))


def _damped(
    parameters: ControllerParameters, solution: LeastSquaresSolution, wanted: Array | None, view: TargetView
) -> tuple[Array, float]:
    """Return the twist of a law that damps, before its options, and the damping of the smallest singular value.

    Args:
        parameters: The law and its options.
        solution: Of the pseudo-inverse, gain included.
        wanted: By the pose, gain included, shape (m,), or None.
        view: The target.
    """
    values = solution.singular_values
    factors, damping = law_factors(parameters, values, view)
    amplitudes = factors * solution.components
    if wanted is not None:
        amplitudes += pose_shares(values, factors) * (solution.right @ wanted)
    return amplitudes @ solution.right, damping


def law_factors(parameters: ControllerParameters, values: Array, view: TargetView) -> tuple[Array, float]:
    """Return what a law multiplies the image's word along each singular direction with, and the smallest one's damping.

    Args:
        parameters: The law and its options; what guarded limits afterwards is as for pinv.
        values: Singular values, largest first, shape (m,).
        view: The target.
    """
    threshold, reference = parameters.pinv_threshold, _reference(values, view)
    each: float | Array
    if parameters.law in ("pinv", "guarded"):
        return pinv_factors(values, threshold), 0.0
    if parameters.law == "dls":
        each = damping = parameters.damping * reference
    elif parameters.law == "adaptive_dls":
        each = adaptive_damping(values, parameters.onset * reference, parameters.max_damping * reference)
        damping = float(each[-1])
    else:
        each = damping = parameters.detour_pose_onset
    return dls_factors(values, threshold, each), damping


def _guarded(
    parameters: ControllerParameters, solution: LeastSquaresSolution, smallest: float, view: TargetView
) -> tuple[Array, float]:
    """Return the twist with its nearly unobservable motions limited, and the health of the present L.

    Args:
        parameters: The law and its options.
        solution: Of the pseudo-inverse, gain included.
        smallest: Singular value of the present L.
        view: The target.
    """
    values = solution.singular_values
    onset = parameters.onset * _reference(values, view)
    if values[-1] >= onset:
        return solution.solution, smallest / onset
    amplitudes = pinv_factors(values, parameters.pinv_threshold) * solution.components
    least = _CREEP * parameters.speed_limits[0]
    limited = limited_amplitudes(amplitudes, smooth_step(values / onset), parameters.guard_unobservable_share, least)
    return limited @ solution.right, smallest / onset


def law_interaction(parameters: ControllerParameters, view: TargetView) -> str:
    """Return which L is inverted: "current", "target" or "mean"."""
    if parameters.interaction != "auto":
        return parameters.interaction
    return _AUTO.get(parameters.law, "current") if view.interaction is not None else "current"


def inverted_matrix(parameters: ControllerParameters, current: Array, image: Array, view: TargetView) -> Array:
    """Return the L that is inverted: the current one, the target's, or the mean of both.

    Raises:
        ObservationError: If the law needs L at the target, which is not known.
    """
    which = law_interaction(parameters, view)
    if which == "current":
        return current
    if view.interaction is None:
        raise ObservationError(
            "the desired features have no 3-D lines (directions and moments are empty), which "
            f"interaction = {which} needs"
        )
    if which == "target":
        return view.interaction
    return mean_interaction(current, image, view.interaction, view.image)


def _reference(values: Array, view: TargetView) -> float:
    """Return the smallest singular value that is healthy for this target."""
    if view.singular_values is None:
        return max(_REFERENCE * float(values[0]), math.ulp(1.0))
    return max(float(view.singular_values[-1]), _MIN_REFERENCE * float(view.singular_values[0]), math.ulp(1.0))
