"""Where isolated points can be in a scene with parallel lines, without any search.

A motion that is lost at a camera centre on no transversal turns the camera about some axis direction w. Two parallel
lines allow only w along themselves or, if the centre is in their plane, across that plane; three in one plane allow the
latter only, and lines on no common circular cylinder none at all. All classes of parallel lines must agree.
Source: new, docs/theory.md section "Five and more lines".
"""

from __future__ import annotations

import enum

import numpy as np

from plsing_ros.arrays import Array, cross
from plsing_ros.singularities.scene_frame import SceneFrame

# Scene coordinates and sines up to which lines are parallel, coplanar, or planes equal, and
_ZERO = 1e-9
# those above which they are certainly not. What is between is not used.
_CERTAIN = 1e-6


class _Shape(enum.Enum):
    """How two or more parallel lines lie to each other."""

    FLAT = "in one plane"
    CYLINDER = "perhaps on a circular cylinder"
    SOLID = "on no circular cylinder"
    UNCERTAIN = "nearly in one plane"


def planes_with_isolated_points(frame: SceneFrame) -> list[Array] | None:
    """Return planes (a, b), a . x + b = 0, that all isolated points are in; None if the parallel lines do not say.

    Args:
        frame: The scene; its lines are different and not all parallel.
    """
    flat: list[tuple[Array, Array, bool]] = []
    axes: list[Array] = []
    for rows in _classes(frame):
        direction = frame.direction[rows[0]]
        shape, plane = _shape_of(direction, frame.point[rows])
        if shape is _Shape.SOLID:
            return []
        if shape is _Shape.CYLINDER:
            axes.append(direction)
        elif shape is _Shape.FLAT:
            flat.append((plane, direction, len(rows) == 2))
    if len(axes) > 1:
        return []
    planes = [plane for plane, _, _ in flat]
    if axes:
        return _common(planes, axes[0])
    found = _common(planes, None)
    for i, (_, direction, turns) in enumerate(flat):
        if turns:
            others = _common(planes[:i] + planes[i + 1 :], direction)
            if found is None or others is None:
                return None
            found += [plane for plane in others if all(plane_difference(plane, own) > _ZERO for own in found)]
    return found


def plane_difference(first: Array, second: Array) -> float:
    """Return the largest difference of two planes' coordinates (a, b), whose sign means nothing."""
    return float(min(np.abs(first - second).max(), np.abs(first + second).max()))


def _common(planes: list[Array], axis: Array | None) -> list[Array] | None:
    """Return the plane that all planes are, none if they differ or are not across an axis; None if that is not certain.

    Without planes, it is not.
    """
    if not planes:
        return None
    differences = [plane_difference(planes[0], plane) for plane in planes[1:]]
    if axis is not None:
        differences.append(float(np.abs(cross(planes[0][:3], axis)).max()))
    if max(differences, default=0.0) > _CERTAIN:
        return []
    return planes[:1] if max(differences, default=0.0) <= _ZERO else None


def _classes(frame: SceneFrame) -> list[list[int]]:
    """Return the rows of parallel lines, of each direction that two or more have and that is no other one nearly."""
    left, classes = list(range(len(frame.direction))), []
    while left:
        sines = np.linalg.norm(cross(frame.direction[left], frame.direction[left[0]]), axis=1)
        parallel = [row for row, sine in zip(left, sines, strict=True) if sine <= _ZERO]
        if len(parallel) > 1 and not ((sines > _ZERO) & (sines <= _CERTAIN)).any():
            classes.append(parallel)
        left = [row for row in left if row not in parallel]
    return classes


def _shape_of(direction: Array, point: Array) -> tuple[_Shape, Array]:
    """Return how parallel lines lie to each other, and their plane (a, b) if they have one."""
    offset = point - point.mean(axis=0)
    _, size, axes = np.linalg.svd(offset)
    normal = cross(direction, axes[0])
    plane = np.append(normal, -normal @ point[0])
    if size[1] <= _CERTAIN:
        return _Shape.FLAT if size[1] <= _ZERO else _Shape.UNCERTAIN, plane
    # Rows (|x|^2, x, y, 1) of points on a circle are dependent.
    x, y = (offset @ axes[:2].T).T
    circle = np.stack([x * x + y * y, x, y, np.ones_like(x)], axis=1)
    solid = len(point) > 3 and bool(np.linalg.svd(circle, compute_uv=False)[3] > _CERTAIN)
    return _Shape.SOLID if solid else _Shape.CYLINDER, plane
