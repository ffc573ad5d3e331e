# SPDX-License-Identifier: Apache-2.0
"""The gain lambda as a function of the error."""

from __future__ import annotations

import math

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.parameters.law import LawParameters


def adaptive_gain(error: float, at_zero: float, at_infinity: float, slope: float) -> float:
    """Return lambda(x) = (l0 - linf) exp(-slope / (l0 - linf) x) + linf.

    At zero error it is at_zero and falls with the given slope; a slope of zero gives a constant gain.

    Args:
        error: x >= 0, the largest absolute component of s - s*.
        at_zero: l0 [1/s], above at_infinity unless the slope is zero.
        at_infinity: linf [1/s].
        slope: -d lambda / dx at zero, >= 0 [1/s].

    Source: the adaptive gain of ViSP.
    """
    if slope == 0.0:
        return at_zero
    span = at_zero - at_infinity
    return span * math.exp(-slope / span * error) + at_infinity


def law_gain(parameters: LawParameters, error: Array) -> float:
    """Return lambda [1/s] of the parameters for an error s - s*, shape (m,)."""
    if parameters.gain_slope == 0.0:
        return parameters.gain
    largest = float(np.abs(error).max())
    return adaptive_gain(largest, parameters.gain, parameters.gain_at_infinity, parameters.gain_slope)
