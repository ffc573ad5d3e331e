# SPDX-License-Identifier: Apache-2.0
"""The inverses of the interaction matrix: what each law makes of its singular values."""

from __future__ import annotations

import math

import numpy as np

from plsing_ros.arrays import Array


def pinv_factors(values: Array, threshold: float) -> Array:
    """Return what the pseudo-inverse multiplies the singular directions with: 1 / sigma, or 0 at the threshold.

    Args:
        values: Singular values, largest first, shape (m,).
        threshold: Values up to this times the largest are taken as zero.

    Source: eq. velocity_input, with the threshold of numpy.linalg.pinv.
    """
    if float(values[-1]) > threshold * float(values[0]):
        inverse: Array = 1.0 / values
        return inverse
    kept = values > threshold * values[0]
    return np.divide(1.0, values, where=kept, out=np.zeros_like(values))


def dls_factors(values: Array, threshold: float, damping: float | Array) -> Array:
    """Return sigma / (sigma^2 + mu^2) for a damping mu, one for all or one for each singular value; else as pinv.

    Source: damped least squares, the minimum of |L tau - b|^2 + mu^2 |tau|^2.
    """
    # Two divisions by sqrt(sigma^2 + mu^2): squares of tiny values would underflow.
    size = np.hypot(values, damping)
    kept = values > threshold * values[0]
    share = np.divide(values, size, where=kept, out=np.zeros_like(values))
    factors: Array = np.divide(share, size, where=kept, out=share)
    return factors


def pose_shares(values: Array, factors: Array) -> Array:
    """Return the share of the pose in each singular direction: what the image leaves, 1 - sigma f, shape (m,).

    With the factors of dls and a damping mu, the twist is then the minimum over tau of
    |L tau + lambda e|^2 + mu^2 |tau + lambda xi|^2: damped towards the word of the pose, xi, and not towards rest.

    Args:
        values: Singular values, shape (m,).
        factors: What the image is multiplied with, shape (m,).

    Source: new, docs/laws.md.
    """
    shares: Array = 1.0 - values * factors
    return shares


def adaptive_damping(values: Array, onset: float, largest: float) -> Array:
    """Return the damping of each singular value: zero from the onset on, growing to the largest where sigma is zero.

    mu^2 = (1 - (sigma / onset)^2) largest^2 below the onset: continuous, and zero for every direction that is not
    nearly unobservable, so that the task goes on undisturbed there.

    Args:
        values: Singular values, shape (m,).
        onset: In the units of the singular values, > 0.
        largest: Likewise.

    Source: the profile is that of numerical filtering (Maciejewski and Klein); applied to each direction by itself.
    """
    nearness = 1.0 - np.square(np.minimum(values / onset, 1.0))
    damping: Array = largest * np.sqrt(nearness)
    return damping


def smooth_step(ratio: Array) -> Array:
    """Return 0 for ratios up to 0, 1 from 1 on, and r^2 (3 - 2 r) between: continuous with its slope."""
    # Not np.clip, whose checks cost more than both of these.
    r = np.minimum(np.maximum(ratio, 0.0), 1.0)
    step: Array = r * r * (3.0 - 2.0 * r)
    return step


def limited_amplitudes(amplitudes: Array, health: Array, share: float, least: float) -> Array:
    """Return the motions along the singular directions with the nearly unobservable ones limited, the rest unchanged.

    The limit of direction i is (share R + least) h_i / (1 - h_i), where R is the norm of the motions that are not lost
    at all (health 1): infinite at health 1, where the limit sets in, and zero where the direction is lost.

    Args:
        amplitudes: Of the law's twist along each right singular direction, shape (m,).
        health: In [0, 1], shape (m,).
        share: See above.
        least: Speed for R = 0, in the mixed units of a twist.

    Source: new, docs/controller.md.
    """
    lost = health < 1.0
    if not np.count_nonzero(lost):
        return amplitudes
    rest = math.hypot(*amplitudes[~lost].tolist())
    unlimited = np.full(len(health), np.inf)
    limit = np.divide((share * rest + least) * health, 1.0 - health, where=lost, out=unlimited)
    limited: Array = np.minimum(np.maximum(amplitudes, -limit), limit)
    return limited


def null_space_part(right: Array, factors: Array, twist: Array) -> Array:
    """Return the part of a twist that the law leaves free, shape (m,): along right singular vectors of factor zero.

    Args:
        right: The right singular vectors as rows, shape (m, m).
        factors: Of pinv, shape (m,).
        twist: Shape (m,).
    """
    free = right[factors == 0.0]
    part: Array = free.T @ (free @ twist)
    return part
