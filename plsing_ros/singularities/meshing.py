# SPDX-License-Identifier: Apache-2.0
"""Triangles of a surface inside a cube, for drawing."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, checked_array
from plsing_ros.errors import GeometryError
from plsing_ros.singularities.surfaces import Surface

# The six tetrahedra of a cube around its diagonal: corners as bits x + 2 y + 4 z, one for each order of the axes.
_TETRAHEDRA = [(0, 1 << a, (1 << a) | (1 << b), 7) for a, b, _ in permutations(range(3))]
_EDGES = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]


def _cuts() -> list[list[tuple[int, int, int]]]:
    """Return, for each set of negative corners as bits, the triangles as triples of cut edges."""
    table: list[list[tuple[int, int, int]]] = []
    for negative in range(16):
        inside = [corner for corner in range(4) if negative >> corner & 1]
        outside = [corner for corner in range(4) if corner not in inside]
        if len(inside) in (0, 4):
            table.append([])
            continue
        if len(inside) == 2:
            ring = [(inside[0], outside[0]), (inside[0], outside[1]), (inside[1], outside[1]), (inside[1], outside[0])]
        else:
            lonely, rest = (inside, outside) if len(inside) == 1 else (outside, inside)
            ring = [(lonely[0], corner) for corner in rest]
        numbers = [_EDGES.index((min(edge), max(edge))) for edge in ring]
        table.append([(numbers[0], numbers[i], numbers[i + 1]) for i in range(1, len(numbers) - 1)])
    return table


_CUTS = _cuts()


def surface_triangles(surface: Surface, center: npt.ArrayLike, half_size: float, resolution: int = 32) -> Array:
    """Return triangles of the part of a surface in a cube, by marching tetrahedra with linear interpolation.

    Args:
        surface: The surface.
        center: Centre of the cube, in the frame of the lines, shape (3,) [m].
        half_size: Half its edge [m], > 0.
        resolution: Cells along each edge, >= 1.

    Returns:
        Corners, shape (triangles, 3, 3) [m]; in no order, and not oriented.

    Raises:
        GeometryError: If center is not three finite numbers, or half_size or resolution is out of range.
    """
    middle = checked_array("center", center, (3,))
    if not (np.isfinite(half_size) and half_size > 0.0 and resolution >= 1):
        raise GeometryError(f"half_size {half_size} m and resolution {resolution} must be positive")
    ticks = np.linspace(-half_size, half_size, resolution + 1)
    nodes = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1) + middle
    values = surface.value(nodes.reshape(-1, 3)).reshape(nodes.shape[:3])
    # A node on the surface counts as positive; moved off it by rounding, so that no triangle degenerates.
    values = np.where(values == 0.0, np.finfo(float).tiny, values)
    n = resolution
    corner_values = np.stack([values[i : n + i, j : n + j, k : n + k] for k in (0, 1) for j in (0, 1) for i in (0, 1)])
    corner_nodes = np.stack([nodes[i : n + i, j : n + j, k : n + k] for k in (0, 1) for j in (0, 1) for i in (0, 1)])
    corner_values, corner_nodes = corner_values.reshape(8, -1), corner_nodes.reshape(8, -1, 3)
    triangles = []
    for tetrahedron in _TETRAHEDRA:
        value, node = corner_values[list(tetrahedron)], corner_nodes[list(tetrahedron)]
        pattern = (value < 0.0).T @ np.array([1, 2, 4, 8])
        for negative in range(1, 15):
            cells = np.flatnonzero(pattern == negative)
            for triangle in _CUTS[negative] if len(cells) else []:
                triangles.append(np.stack([_crossing(value, node, cells, _EDGES[e]) for e in triangle], axis=1))
    return np.concatenate(triangles) if triangles else np.zeros((0, 3, 3))


def _crossing(value: Array, node: Array, cells: npt.NDArray[np.intp], edge: tuple[int, int]) -> Array:
    a, b = edge
    share = value[a, cells] / (value[a, cells] - value[b, cells])
    crossing: Array = node[a, cells] + share[:, np.newaxis] * (node[b, cells] - node[a, cells])
    return crossing
