# SPDX-License-Identifier: Apache-2.0
"""The isolated points and the congruence of many four-line scenes at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, BoolArray, checked_array, cross
from plsing_ros.errors import GeometryError
from plsing_ros.singularities.four_lines import is_generic
from plsing_ros.singularities.isolated_points import ComplexArray, solve_ten_points
from plsing_ros.singularities.scene_frame import scene_coordinates

# Scenes computed together: about 20 kB each, so that a chunk stays in the cache of a usual processor.
CHUNK = 250


@dataclass(frozen=True, eq=False)
class FourLineBatch:
    """What was found for S scenes of four lines.

    Attributes:
        points: The ten complex isolated points of each scene, shape (S, 10, 3) [m]; NaN where there is none.
        real: Which of them are real, shape (S, 10).
        residual: Independent residuals (singularity_residuals), shape (S, 10); 1 where there is no point.
        discriminant: Positive for two real transversals, negative for none, shape (S,).
        generic: Scenes for which this is the whole answer. The others are special, or nearly; singular_set tells how.
    """

    points: ComplexArray
    real: BoolArray
    residual: Array
    discriminant: Array
    generic: BoolArray


def solve_four_line_scenes(points: npt.ArrayLike, directions: npt.ArrayLike, chunk: int = CHUNK) -> FourLineBatch:
    """Return the isolated points and the congruence of S scenes of four lines.

    Memory grows with chunk, not with S, apart from the result.

    Args:
        points: A point on each line, shape (S, 4, 3) [m].
        directions: Directions of any length but zero, shape (S, 4, 3).
        chunk: Scenes computed together.

    Raises:
        GeometryError: If a value is not finite, a shape is wrong or a direction is zero; the message names the scene.
    """
    point = checked_array("points", points, (None, 4, 3))
    direction = checked_array("directions", directions, (len(point), 4, 3))
    largest = np.abs(direction).max(axis=2, keepdims=True, initial=0.0)
    if (largest == 0.0).any():
        scene, line = (int(i) for i in np.argwhere(largest[..., 0] == 0.0)[0])
        raise GeometryError(f"scene {scene}, line {line + 1}: its direction is zero; give any other vector along it")
    unit = direction / largest
    unit /= np.linalg.norm(unit, axis=2, keepdims=True)
    count = len(point)
    result = FourLineBatch(
        points=np.empty((count, 10, 3), dtype=complex),
        real=np.empty((count, 10), dtype=bool),
        residual=np.empty((count, 10)),
        discriminant=np.empty(count),
        generic=np.empty(count, dtype=bool),
    )
    for start in range(0, count, chunk):
        part = slice(start, start + chunk)
        center, length, foot = scene_coordinates(unit[part], point[part])
        ten = solve_ten_points(unit[part], foot)
        scale = np.where(length > 0.0, length, 1.0)[:, np.newaxis, np.newaxis]
        result.points[part] = ten.center * scale + center[:, np.newaxis]
        result.real[part], result.residual[part] = ten.real, ten.residual
        result.discriminant[part] = _discriminants(unit[part], foot)
        result.generic[part] = is_generic(ten) & (length > 0.0)
    return result


def _discriminants(direction: Array, foot: Array) -> Array:
    """Return b^2 - a c of the form d . m on the two weakest right singular vectors of the Plücker matrices, (S,)."""
    rows = np.concatenate([cross(foot, direction), direction], axis=2)
    null = np.linalg.svd(rows)[2][:, 4:]
    form = null[:, :, :3] @ null[:, :, 3:].swapaxes(1, 2)
    mixed = 0.5 * (form[:, 0, 1] + form[:, 1, 0])
    discriminant: Array = mixed**2 - form[:, 0, 0] * form[:, 1, 1]
    return discriminant
