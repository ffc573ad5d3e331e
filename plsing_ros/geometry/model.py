# SPDX-License-Identifier: Apache-2.0
"""Objects with straight edges: vertices, edges and faces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, checked_array
from plsing_ros.errors import GeometryError
from plsing_ros.geometry.line_set import LineSet
from plsing_ros.geometry.pose import checked_position

IntArray = npt.NDArray[np.int32]

# Vertices closer than this share of the model's size are one.
_SAME = 1e-9
# Of a face's vertices from its plane, as a share of the model's size.
_MAX_WARP = 1e-2


@dataclass(frozen=True, eq=False)
class Model:
    """An object of straight edges and flat faces, in a frame of its own.

    Edges are what a camera sees as straight lines; faces are what hides them. The direction of an edge, from its first
    vertex to its second, orients its line.

    Attributes:
        vertices: Shape (n, 3) [m].
        edges: Pairs of rows of vertices, shape (m, 2), m >= 1.
        faces: Rows of vertices of each flat polygon, in order round it; both sides of a face hide what is behind.
        frame: Name of the frame of the vertices.
        ids: One distinct integer for each edge; 1 to m if not given.
        triangles: The faces cut into triangles, shape (k, 3).
        edge_triangles: Of each edge, the triangles of the faces that it borders or lies in: these cannot hide it.

    Raises:
        GeometryError: If a value is not finite, a shape is wrong, an edge or a face names a vertex that does not exist,
            an edge has no length, a face is not flat or has no area, or ids are repeated.
    """

    vertices: Array
    edges: IntArray
    faces: tuple[tuple[int, ...], ...] = ()
    frame: str = "world"
    ids: tuple[int, ...] = ()
    triangles: IntArray = field(init=False, repr=False)
    edge_triangles: tuple[tuple[int, ...], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        vertices = checked_array("vertices", self.vertices, (None, 3))
        for row, vertex in enumerate(vertices):
            checked_position(f"vertex {row}", vertex)
        edges = _checked_edges(self.edges, vertices)
        faces = tuple(tuple(int(row) for row in face) for face in self.faces)
        triangles: list[tuple[int, ...]] = []
        face_of: list[int] = []
        for number, face in enumerate(faces):
            cut = _cut(number, face, vertices)
            triangles += cut
            face_of += [number] * len(cut)
        array = np.array(triangles, dtype=np.int32).reshape(-1, 3)
        for value in (edges, array):
            value.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "edges", edges)
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "triangles", array)
        object.__setattr__(self, "ids", self._line_set(vertices, edges).ids)
        object.__setattr__(self, "edge_triangles", _own_triangles(vertices, edges, faces, np.array(face_of, dtype=int)))

    @classmethod
    def from_faces(
        cls,
        vertices: npt.ArrayLike,
        faces: Sequence[Sequence[int]],
        frame: str = "world",
        min_crease: float = 0.17,
        extra_edges: Sequence[tuple[int, int]] = (),
    ) -> Model:
        """Build a model whose edges are the borders of its faces, each once.

        Args:
            vertices: Shape (n, 3) [m]; equal ones are taken as one.
            faces: Rows of the vertices of each polygon.
            frame: Frame of the vertices.
            min_crease: A border between two faces is an edge where they meet at this angle or more [rad], so that flat
                areas may come in triangles.
            extra_edges: Edges that are no borders, as of a drawing on a face.

        Raises:
            GeometryError: As for the class.
        """
        points = checked_array("vertices", vertices, (None, 3))
        merged, row_of = _merged(points)
        try:
            polygons = [tuple(int(row_of[row]) for row in face) for face in faces]
            extra = [(int(row_of[a]), int(row_of[b])) for a, b in extra_edges]
        except IndexError:
            raise GeometryError(
                f"a face names a vertex that does not exist; there are 0 to {len(points) - 1}"
            ) from None
        normals = [_normal(number, face, merged)[0] for number, face in enumerate(polygons)]
        borders: dict[tuple[int, int], list[int]] = {}
        for number, face in enumerate(polygons):
            for a, b in zip(face, face[1:] + face[:1], strict=True):
                if a != b:
                    borders.setdefault((min(a, b), max(a, b)), []).append(number)
        edges = [
            pair
            for pair, around in borders.items()
            if len(around) != 2 or abs(float(normals[around[0]] @ normals[around[1]])) < np.cos(min_crease)
        ]
        edges += [pair for pair in extra if tuple(sorted(pair)) not in borders]
        return cls(merged, np.array(edges, dtype=np.int32).reshape(-1, 2), tuple(polygons), frame)

    def __len__(self) -> int:
        return len(self.edges)

    def lines(self) -> LineSet:
        """Return the lines that the edges lie on, in the model's frame, with the edges' ids."""
        return self._line_set(self.vertices, self.edges)

    def _line_set(self, vertices: Array, edges: IntArray) -> LineSet:
        start = vertices[edges[:, 0]]
        return LineSet.from_points_directions(start, vertices[edges[:, 1]] - start, self.frame, self.ids)

    @cached_property
    def center(self) -> Array:
        """The middle of the box round the vertices, shape (3,) [m]."""
        middle: Array = 0.5 * (self.vertices.min(axis=0) + self.vertices.max(axis=0))
        middle.setflags(write=False)
        return middle

    @cached_property
    def radius(self) -> float:
        """Of the ball about the center that holds all vertices [m]."""
        return float(np.linalg.norm(self.vertices - self.center, axis=1).max())


def _checked_edges(edges: npt.ArrayLike, vertices: Array) -> IntArray:
    pairs = np.array(edges)
    if pairs.ndim != 2 or pairs.shape[1:] != (2,) or not len(pairs) or pairs.dtype.kind not in "iu":
        raise GeometryError(f"edges have shape {pairs.shape}; at least one pair of whole numbers is needed")
    if pairs.min() < 0 or pairs.max() >= len(vertices):
        raise GeometryError(f"edges name vertices {pairs.min()} to {pairs.max()}; there are 0 to {len(vertices) - 1}")
    size = float(np.abs(vertices).max())
    for row, (a, b) in enumerate(pairs):
        if np.linalg.norm(vertices[a] - vertices[b]) <= _SAME * size:
            raise GeometryError(f"edge {row} from vertex {a} to vertex {b} has no length")
    return pairs.astype(np.int32)


def _merged(points: Array) -> tuple[Array, list[int]]:
    size = max(float(np.abs(points).max(initial=0.0)), 1e-300)
    keys: dict[tuple[int, ...], int] = {}
    row_of = [keys.setdefault(tuple(np.round(point / (size * _SAME)).astype(int)), len(keys)) for point in points]
    first = [row_of.index(row) for row in range(len(keys))]
    return points[first], row_of


def _normal(number: int, face: tuple[int, ...], vertices: Array) -> tuple[Array, float]:
    """Return the unit normal of a face and how far its vertices are from its plane [m]."""
    if len(face) < 3:
        raise GeometryError(f"face {number} has {len(face)} vertices; at least 3 are needed")
    if min(face) < 0 or max(face) >= len(vertices):
        raise GeometryError(f"face {number} names vertices {list(face)}; there are 0 to {len(vertices) - 1}")
    corners = vertices[list(face)]
    # Newell's method: exact for flat polygons, convex or not.
    normal = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
    length = float(np.linalg.norm(normal))
    size = float(np.ptp(corners, axis=0).max())
    if length <= 1e-12 * size * size or size == 0.0:
        raise GeometryError(f"face {number} with vertices {list(face)} has no area")
    normal = normal / length
    return normal, float(np.abs((corners - corners.mean(axis=0)) @ normal).max())


def _cut(number: int, face: tuple[int, ...], vertices: Array) -> list[tuple[int, ...]]:
    """Return the triangles of a flat polygon, by cutting off ears."""
    normal, warp = _normal(number, face, vertices)
    size = float(np.ptp(vertices, axis=0).max())
    if warp > _MAX_WARP * size:
        raise GeometryError(
            f"face {number} is not flat: a vertex is {warp:.3g} m from its plane; cut it into triangles"
        )
    rest = list(face)
    triangles: list[tuple[int, ...]] = []
    while len(rest) > 3:
        for i in range(len(rest)):
            a, b, c = rest[i - 1], rest[i], rest[(i + 1) % len(rest)]
            if _is_ear(vertices[[a, b, c]], vertices[[row for row in rest if row not in (a, b, c)]], normal):
                triangles.append((a, b, c))
                del rest[i]
                break
        else:
            raise GeometryError(f"the border of face {number} with vertices {list(face)} crosses itself")
    return [*triangles, (rest[0], rest[1], rest[2])]


def _is_ear(corners: Array, others: Array, normal: Array) -> bool:
    sides = np.roll(corners, -1, axis=0) - corners
    if float(np.cross(sides[0], sides[1]) @ normal) < 0.0:
        return False
    inside = [
        all(float(np.cross(side, other - corner) @ normal) > 0.0 for side, corner in zip(sides, corners, strict=True))
        for other in others
    ]
    return not any(inside)


def _own_triangles(
    vertices: Array, edges: IntArray, faces: tuple[tuple[int, ...], ...], face_of: npt.NDArray[np.int_]
) -> tuple[tuple[int, ...], ...]:
    """Return, for each edge, the triangles of the faces whose plane it lies in and which it touches."""
    size = float(np.ptp(vertices, axis=0).max())
    planes = []
    for number, face in enumerate(faces):
        normal, _ = _normal(number, face, vertices)
        planes.append((normal, float(normal @ vertices[list(face)].mean(axis=0))))
    own = []
    for a, b in edges.tolist():
        touching = [
            number
            for number, (normal, height) in enumerate(planes)
            if max(abs(float(normal @ vertices[row]) - height) for row in (a, b)) < 1e-3 * size
        ]
        own.append(tuple(int(row) for row in np.flatnonzero(np.isin(face_of, touching))))
    return tuple(own)
