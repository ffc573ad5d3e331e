"""The control laws: a camera twist from an interaction matrix and a feature error."""

from __future__ import annotations

import numpy as np

from plsing_ros.arrays import Array


def pinv_twist(interaction: Array, error: Array, gain: float, threshold: float) -> Array:
    """Return the plain law's camera twist, tau = -lambda pinv(L) (s - s*).

    Args:
        interaction: L at the current features, shape (3n, 6).
        error: s - s*, shape (3n,).
        gain: lambda [1/s].
        threshold: Singular values below this times the largest are taken as zero.

    Returns:
        (v, omega) of the camera in its optical frame, shape (6,) [m/s, rad/s].

    Source: eq. velocity_input, with L for the camera's own twist (docs/conventions.md).
    """
    twist: Array = -gain * (np.linalg.pinv(interaction, rcond=threshold) @ error)
    return twist
