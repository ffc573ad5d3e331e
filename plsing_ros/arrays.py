# SPDX-License-Identifier: Apache-2.0
"""Input checks for arrays, in one place so that every message reads the same, and products of vectors."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from plsing_ros.errors import GeometryError, PlsingError

Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.intp]

_FEW = 32
_FLOAT = np.dtype(np.float64)


def checked_array(
    name: str, value: npt.ArrayLike, shape: tuple[int | None, ...], error: type[PlsingError] = GeometryError
) -> Array:
    """Return value as a read-only float array, a copy if need be, after checking its shape and that it is finite.

    Args:
        name: What the value is, for the message.
        value: Anything numpy turns into floats.
        shape: Expected shape; None as the first length allows any.
        error: Raised on a mismatch.

    Raises:
        error: If value is not numeric, has another shape, or holds NaN or infinity (the message names the first).
    """
    array = shaped_array(name, value, shape, error)
    # A sum is not finite if one of its numbers is not; numpy takes as long for a few numbers as for many.
    few = array.size <= _FEW and math.isfinite(sum(array.ravel().tolist()))
    if not few and not np.isfinite(array).all():
        first: Any = np.argwhere(~np.isfinite(array))[0]
        raise error(f"{name}{[int(i) for i in first]} is {array[tuple(first)]}; all values must be finite")
    return array


def shaped_array(
    name: str, value: npt.ArrayLike, shape: tuple[int | None, ...], error: type[PlsingError] = GeometryError
) -> Array:
    """Return value as checked_array does, row after row in memory, without the check that it is finite."""
    if isinstance(value, np.ndarray) and value.shape == shape and value.dtype is _FLOAT:
        flags = value.flags
        if flags.owndata and flags.c_contiguous and not flags.writeable:
            # Locked by its owner, and no view of what another may write to.
            return value
    try:
        array: Array = np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError) as problem:
        raise error(f"{name} is not an array of numbers: {problem}") from None
    have = array.shape
    if have != shape and (shape[0] is not None or not have or have[1:] != shape[1:]):
        expected = "(" + ", ".join("n" if want is None else str(want) for want in shape) + ")"
        raise error(f"{name} has shape {have}, expected {expected}")
    array.setflags(write=False)
    return array


def vector_text(values: Iterable[float]) -> str:
    """Return numbers as a vector for a person to read: "(0.5, 1, -2)"."""
    return "(" + ", ".join(f"{value:.6g}" for value in values) + ")"


_YZX, _ZXY = np.array([1, 2, 0]), np.array([2, 0, 1])


def cross(a: Array, b: Array) -> Array:
    """Return the cross products along the last axis; ten times faster than numpy.cross for a handful of rows."""
    result: Array = a.take(_YZX, -1) * b.take(_ZXY, -1) - a.take(_ZXY, -1) * b.take(_YZX, -1)
    return result


# a @ _MINUS_SKEW, as a 3 x 3 matrix, is minus_skew(a).
_MINUS_SKEW = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0],
        [0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    ]
)


def minus_skew(vectors: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the matrices of b -> b x a for vectors a of any leading shape, (..., 3, 3)."""
    matrices: npt.NDArray[Any] = (vectors @ _MINUS_SKEW).reshape(*vectors.shape, 3)
    return matrices
