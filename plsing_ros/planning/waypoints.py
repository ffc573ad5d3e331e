# SPDX-License-Identifier: Apache-2.0
"""The search for the waypoints of a path round singularities: short polygons first."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.stats import qmc

from plsing_ros.arrays import Array, BoolArray
from plsing_ros.planning.clearance import Clearance

# Camera centres at which a straight piece is checked.
_POINTS = 16
# Nodes around what is in the straight path: how many around, and at which multiples of the distance to keep.
_AROUND = 8
_RADII = (1.3, 2.0, 3.0)
# Nodes spread over the space between start and target.
_NODES = 48
# Pairs of waypoints are checked in batches of this size, and no more than so many.
_BATCH = 256
_MAX_PAIRS = 4096


class WaypointSearch:
    """Polygons with one or two waypoints from start to target that are clear, the shortest first."""

    def __init__(self, clearance: Clearance, max_distance: float, usable: Callable[[Array, Array], BoolArray]) -> None:
        """Prepare for one task.

        Args:
            clearance: What to keep clear of.
            max_distance: How far from the target waypoints may be, in distances of the start.
            usable: Returns whether waypoints (k, 3) are of any use, given the progress (k,) of a path there.
        """
        self._clearance = clearance
        self._S, self._G = clearance.start, clearance.target
        nodes = self._nodes(max_distance)
        nodes = nodes[clearance.excess(nodes) >= 0.0]
        first, last = np.linalg.norm(nodes - self._S, axis=1), np.linalg.norm(nodes - self._G, axis=1)
        self._waypoints = nodes[usable(first / np.maximum(first + last, 1e-300), nodes)]
        self._polygons = self._by_length()

    def shortest(self, trouble: list[tuple[Array, float]]) -> Array | None:
        """Return the waypoints, shape (k, 3), of the next polygon that keeps away from trouble, or None."""
        for waypoints in self._polygons:
            points = _along(np.vstack([self._S, waypoints]), np.vstack([waypoints, self._G])).reshape(-1, 3)
            if all(np.linalg.norm(points - center, axis=1).min() >= radius for center, radius in trouble):
                return waypoints
        return None

    def _by_length(self) -> Iterator[Array]:
        nodes = self._waypoints
        from_start, to_target = self._clear(self._S, nodes), self._clear(nodes, self._G)
        first, last = np.linalg.norm(nodes - self._S, axis=1), np.linalg.norm(nodes - self._G, axis=1)
        through = np.flatnonzero(from_start & to_target)
        for i in through[np.argsort((first + last)[through], kind="stable")]:
            yield nodes[i : i + 1]
        a, b = (each.ravel() for each in np.meshgrid(np.flatnonzero(from_start), np.flatnonzero(to_target)))
        length = first[a] + np.linalg.norm(nodes[a] - nodes[b], axis=1) + last[b]
        order = np.argsort(length, kind="stable")[:_MAX_PAIRS]
        for begin in range(0, len(order), _BATCH):
            rows = order[begin : begin + _BATCH]
            for row in rows[self._clear(nodes[a[rows]], nodes[b[rows]])]:
                yield nodes[[a[row], b[row]]]

    def _nodes(self, max_distance: float) -> Array:
        """Return where waypoints may be, shape (k, 3) [m]."""
        clearance, reach = self._clearance, float(np.linalg.norm(self._G - self._S))
        along = (self._G - self._S) / reach if reach > 0.0 else np.eye(3)[0]
        path = _along(self._S, self._G)[1:-1, 0] if reach > 0.0 else self._S[np.newaxis]
        keep = clearance.to_keep(path)
        short = clearance.distances(path) - keep
        nodes = [_halton_points() * (0.7 * reach + clearance.margin) + 0.5 * (self._S + self._G)]
        for part in np.flatnonzero(short.min(axis=0) < 0.0):
            worst = int(np.argmin(short[:, part]))
            for factor in _RADII:
                paths = clearance.directions_out(path[worst], int(part), along, _AROUND)
                nodes.append(path[worst] + factor * keep[worst, part] * paths)
        every = np.concatenate(nodes)
        return np.asarray(every[np.linalg.norm(every - self._G, axis=1) <= max_distance * reach])

    def _clear(self, a: Array, b: Array) -> BoolArray:
        """Return whether the straight paths between points a and b, shapes (k, 3) or (3,), are clear, shape (k,)."""
        points = _along(a, b)
        excess = self._clearance.excess(points.reshape(-1, 3)).reshape(points.shape[:2])
        clear: BoolArray = excess.min(axis=0) >= 0.0
        return clear


def _along(a: Array, b: Array) -> Array:
    """Return points from a to b, shape (_POINTS, k, 3)."""
    share = np.linspace(0.0, 1.0, _POINTS)[:, np.newaxis, np.newaxis]
    points: Array = (1.0 - share) * a + share * b
    return points


def _halton_points() -> Array:
    """Return points spread evenly over the unit ball (Halton's sequence), always the same, shape (_NODES, 3)."""
    # The first point of the sequence is a corner of the cube.
    cube = 2.0 * qmc.Halton(3, scramble=False).random(2 * _NODES + 1)[1:] - 1.0
    return np.asarray(cube[np.linalg.norm(cube, axis=1) <= 1.0][:_NODES])
