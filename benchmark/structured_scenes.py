# SPDX-License-Identifier: Apache-2.0
"""Man-made scenes: kinds of edges that people look at, with sizes drawn at random, and what measuring makes of them."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations, pairwise, product

import numpy as np

from plsing_ros.arrays import Array

Scene = tuple[Array, Array]
Segments = list[tuple[Array, Array]]

X, Y, Z = np.eye(3)


def _lines(segments: Segments) -> Scene:
    """Return midpoints (n, 3) [m] and directions (n, 3) of segments."""
    ends = np.array(segments, dtype=float)
    return ends.mean(axis=1), ends[:, 1] - ends[:, 0]


def _box(a: float, b: float, c: float) -> Segments:
    corners = {bits: np.array(bits) * (a, b, c) for bits in product((0, 1), repeat=3)}
    return [
        (corners[p], corners[q])
        for p, q in combinations(sorted(corners), 2)
        if sum(x != y for x, y in zip(p, q, strict=True)) == 1
    ]


def _polygon(points: Array) -> Segments:
    return [*pairwise(points), (points[-1], points[0])]


def _rectangle(corner: Array, first: Array, second: Array) -> Segments:
    return _polygon(np.array([corner, corner + first, corner + first + second, corner + second]))


def _ring(count: int, radius: float, height: float, start: float = 0.2) -> Array:
    angle = start + 2.0 * np.pi * np.arange(count) / count
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(count, height)], axis=1)


def _prism(count: int, radius: float, height: float) -> tuple[Segments, Segments, Segments]:
    low, high = _ring(count, radius, 0.0), _ring(count, radius, height)
    return _polygon(low), _polygon(high), list(zip(low, high, strict=True))


def box_subset_scenes(count: int, size: tuple[float, float, float] = (0.4, 0.3, 0.2)) -> list[Scene]:
    """Return the sets of `count` edges of a box, one of each class of those that reflections make equal."""
    edges = _box(1.0, 1.0, 1.0)
    middles = np.array([2.0 * (p + q) for p, q in edges])
    images = []
    for flips in product((False, True), repeat=3):
        moved = np.where(np.array(flips), 4.0 - middles, middles)
        images.append([int(np.argmin(np.abs(middles - row).sum(axis=1))) for row in moved])
    seen: set[tuple[int, ...]] = set()
    scenes = []
    for rows in combinations(range(12), count):
        if rows in seen:
            continue
        seen.update(tuple(sorted(image[i] for i in rows)) for image in images)
        scenes.append(_lines([_box(*size)[i] for i in rows]))
    return scenes


def _chosen(segments: Segments, *rows: int) -> Scene:
    return _lines([segments[i] for i in rows])


def _corridor(g: np.random.Generator, *extra: Segments) -> Scene:
    w, h, depth = g.uniform(1.5, 3.0), g.uniform(2.2, 3.2), g.uniform(6.0, 12.0)
    along = [(np.array([x, y, 0.0]), np.array([x, y, depth])) for x in (0.0, w) for y in (0.0, h)]
    return _lines(along + _rectangle(np.array([0.0, 0.0, depth]), w * X, h * Y) + [s for e in extra for s in e])


def _cylinder_edges(g: np.random.Generator) -> Scene:
    w, h = g.uniform(2.0, 4.0), g.uniform(2.0, 4.0)
    along = [(np.array([x, y, 0.0]), np.array([x, y, 6.0])) for x in (0.0, w) for y in (0.0, h)]
    return _lines([*along, (np.array([0.0, 0.0, 2.0]), np.array([w, 0.0, 2.0]))])


def _stairs(g: np.random.Generator, steps: int, sides: bool) -> Scene:
    rise, tread, width = g.uniform(0.15, 0.2), g.uniform(0.25, 0.32), g.uniform(0.9, 1.4)
    nosings = [(np.array([0.0, i * tread, i * rise]), np.array([width, i * tread, i * rise])) for i in range(steps)]
    if sides:
        nosings += [(np.array([x, 0.0, 0.0]), np.array([x, steps * tread, steps * rise])) for x in (0.0, width)]
    return _lines(nosings)


def _stairs_with_risers(g: np.random.Generator) -> Scene:
    rise, tread, width = g.uniform(0.15, 0.2), g.uniform(0.25, 0.32), g.uniform(0.9, 1.4)
    segments: Segments = []
    for i in range(3):
        low, high = np.array([0.0, i * tread, i * rise]), np.array([0.0, i * tread, (i + 1) * rise])
        segments += [(low, high), (high, high + width * X), (low, low + width * X)]
    return _lines(segments)


def _window(g: np.random.Generator, bars: int) -> Scene:
    w, h = g.uniform(0.8, 1.6), g.uniform(1.0, 1.8)
    segments = _rectangle(np.zeros(3), w * X, h * Z)
    segments += [
        (np.array([w * k / (bars + 1), 0.0, 0.0]), np.array([w * k / (bars + 1), 0.0, h])) for k in range(1, bars + 1)
    ]
    return _lines(segments)


def _window_in_wall(g: np.random.Generator) -> Scene:
    w, h, d = g.uniform(0.8, 1.6), g.uniform(1.0, 1.8), g.uniform(0.1, 0.3)
    segments = _rectangle(np.zeros(3), w * X, h * Z) + _rectangle(d * Y, w * X, h * Z)
    return _lines([*segments, (np.zeros(3), d * Y), (w * X, w * X + d * Y)])


def _shelf(g: np.random.Generator, boards: int) -> Scene:
    w, h, d = g.uniform(0.6, 1.2), g.uniform(1.2, 2.2), g.uniform(0.25, 0.4)
    segments = [(np.array([0.0, 0.0, h * k / boards]), np.array([w, 0.0, h * k / boards])) for k in range(boards + 1)]
    segments += [(np.array([x, 0.0, 0.0]), np.array([x, 0.0, h])) for x in (0.0, w)]
    return _lines([*segments, (np.array([0.0, 0.0, h]), np.array([0.0, d, h]))])


def _table(g: np.random.Generator, legs: int) -> Scene:
    w, d, h = g.uniform(1.0, 1.8), g.uniform(0.6, 0.9), g.uniform(0.7, 0.8)
    top = _rectangle(h * Z, w * X, d * Y)
    feet = [(np.array([x, y, 0.0]), np.array([x, y, h])) for x in (0.0, w) for y in (0.0, d)]
    return _lines(top + feet[:legs])


def _door(g: np.random.Generator, floor: bool) -> Scene:
    w, h = g.uniform(0.8, 1.0), g.uniform(2.0, 2.2)
    frame = [(np.zeros(3), h * Z), (w * X, w * X + h * Z), (h * Z, w * X + h * Z)]
    return _lines(frame + [(-X, 2 * X), (np.zeros(3), -2 * Y)] if floor else [*frame, (np.zeros(3), w * X)])


def _open_door(g: np.random.Generator) -> Scene:
    w, h, turn = g.uniform(0.8, 1.0), g.uniform(2.0, 2.2), g.uniform(0.4, 1.2)
    way = w * np.array([np.cos(turn), np.sin(turn), 0.0])
    return _lines(_rectangle(np.zeros(3), w * X, h * Z) + _rectangle(np.zeros(3), way, h * Z)[:3])


def _roof(g: np.random.Generator) -> Scene:
    w, d, h = g.uniform(4.0, 8.0), g.uniform(6.0, 10.0), g.uniform(1.5, 3.0)
    ridge = [np.array([w / 2, y, h]) for y in (0.0, d)]
    eaves = [np.array([x, y, 0.0]) for x in (0.0, w) for y in (0.0, d)]
    return _lines(
        [tuple(ridge), (eaves[0], eaves[1]), (eaves[2], eaves[3]), (eaves[0], ridge[0]), (eaves[2], ridge[0])]
    )


def _hip_roof(g: np.random.Generator) -> Scene:
    w, d, h, s = g.uniform(4.0, 6.0), g.uniform(8.0, 10.0), g.uniform(1.5, 3.0), g.uniform(1.0, 2.0)
    ridge = [np.array([w / 2, s, h]), np.array([w / 2, d - s, h])]
    corners = [np.array([x, y, 0.0]) for x, y in ((0, 0), (w, 0), (w, d), (0, d))]
    hips = [(corners[0], ridge[0]), (corners[1], ridge[0]), (corners[2], ridge[1]), (corners[3], ridge[1])]
    return _lines([*hips, (ridge[0], ridge[1])])


def _pyramid(g: np.random.Generator, count: int, base: int) -> Scene:
    low, top = _ring(count, g.uniform(0.5, 1.0), 0.0), np.array([0.0, 0.0, g.uniform(0.6, 1.5)])
    return _lines([(p, top) for p in low] + _polygon(low)[:base])


def _tetrahedron(g: np.random.Generator) -> Scene:
    return _lines(list(combinations(g.uniform(0.0, 1.0, size=(4, 3)), 2)))


def _prism_parts(g: np.random.Generator, count: int, low: int, high: int, sides: int) -> Scene:
    parts = _prism(count, g.uniform(0.3, 0.8), g.uniform(0.5, 1.5))
    return _lines([s for part, number in zip(parts, (low, high, sides), strict=True) for s in part[:number]])


def _two_boxes(g: np.random.Generator, turned: bool) -> Scene:
    first, second = _box(*g.uniform(0.2, 0.6, size=3)), _box(*g.uniform(0.2, 0.6, size=3))
    angle = g.uniform(0.3, 1.2) if turned else 0.0
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    shift = np.array([1.0, 0.3, 0.0])
    return _lines(first[:5] + [(turn @ p + shift, turn @ q + shift) for p, q in second[4:9]])


def _room_corner(g: np.random.Generator, *rows: int) -> Scene:
    a, b, c = g.uniform(2.0, 5.0, size=3)
    segments = [(np.zeros(3), a * X), (np.zeros(3), b * Y), (np.zeros(3), c * Z)]
    segments += [(a * X, a * X + c * Z), (b * Y, b * Y + c * Z), (c * Z, c * Z + a * X), (c * Z, c * Z + b * Y)]
    return _chosen(segments, *rows)


def _horizontal_beams(g: np.random.Generator, count: int, posts: int) -> Scene:
    angle = np.arange(count) * 0.7 + g.uniform(0.0, 0.3, size=count)
    points = g.uniform(-1.0, 1.0, size=(count + posts, 3))
    directions = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    return points, np.concatenate([directions, np.tile(Z, (posts, 1))])


def _panel(g: np.random.Generator, count: int) -> Scene:
    points = np.concatenate([g.uniform(-1.0, 1.0, size=(count, 2)), np.zeros((count, 1))], axis=1)
    return points, np.concatenate([g.normal(size=(count, 2)), np.zeros((count, 1))], axis=1)


def _grid(g: np.random.Generator, rows: int, columns: int) -> Scene:
    a, b = g.uniform(0.5, 1.0, size=2)
    segments = [(np.array([0.0, a * i, 0.0]), np.array([4.0, a * i, 0.0])) for i in range(rows)]
    return _lines(segments + [(np.array([b * i, 0.0, 0.0]), np.array([b * i, 4.0, 0.0])) for i in range(columns)])


def _grid_and_post(g: np.random.Generator) -> Scene:
    points, directions = _grid(g, 3, 2)
    return np.concatenate([points, [[0.4, 0.7, 0.5]]]), np.concatenate([directions, [Z]])


def _fence(g: np.random.Generator, posts: int, rails: int) -> Scene:
    step, height = g.uniform(1.0, 2.0), g.uniform(1.0, 1.5)
    segments = [(np.array([step * i, 0.0, 0.0]), np.array([step * i, 0.0, height])) for i in range(posts)]
    return _lines(
        segments + [(height * (k + 1) / rails * Z, height * (k + 1) / rails * Z + 6 * X) for k in range(rails)]
    )


def _column_row(g: np.random.Generator) -> Scene:
    posts = [(np.array([2.0 * i, g.uniform(-0.1, 0.1) * 0, 0.0]), np.array([2.0 * i, 0.0, 3.0])) for i in range(4)]
    return _lines([*posts, (np.array([0.0, 1.5, 3.0]), np.array([6.0, 1.5, 3.0])), (3 * Z, 3 * Z + 2 * Y)])


def _rails(g: np.random.Generator, sleepers: int) -> Scene:
    gauge, step = g.uniform(1.0, 1.6), g.uniform(0.5, 0.8)
    segments = [(np.zeros(3), 8 * Y), (gauge * X, gauge * X + 8 * Y)]
    return _lines(segments + [(step * i * Y - 0.3 * X, step * i * Y + (gauge + 0.3) * X) for i in range(sleepers)])


def _frame_and_depth(g: np.random.Generator) -> Scene:
    w, h, d = g.uniform(0.5, 2.0, size=3)
    corners = [np.zeros(3), w * X, w * X + h * Z, h * Z]
    return _lines([*_polygon(np.array(corners)), (corners[0], corners[0] + d * Y), (corners[2], corners[2] + d * Y)])


def _wedge(g: np.random.Generator) -> Scene:
    w, d, h = g.uniform(0.5, 1.0, size=3)
    low = [np.zeros(3), w * X, w * X + d * Y, d * Y]
    return _lines([*_polygon(np.array(low)), (low[1], low[1] + h * Z), (low[0], low[1] + h * Z)])


def _truss(g: np.random.Generator) -> Scene:
    w, h = g.uniform(1.0, 2.0), g.uniform(0.8, 1.2)
    low, high = [i * w * X for i in range(4)], [(i + 0.5) * w * X + h * Z for i in range(3)]
    web = [(low[i], high[i]) for i in range(3)] + [(high[i], low[i + 1]) for i in range(3)]
    return _lines([(low[0], low[3]), (high[0], high[2]), *web])


def _orthogonal_three_and_one(g: np.random.Generator) -> Scene:
    return g.uniform(-1.0, 1.0, size=(4, 3)), np.array([X, Y, Z, g.normal(size=3)])


def _street(g: np.random.Generator) -> Scene:
    w, h = g.uniform(6.0, 10.0), g.uniform(4.0, 8.0)
    along = [(np.array([x, 0.0, z]), np.array([x, 20.0, z])) for x, z in ((0, 0), (w, 0), (0, h), (w, 1.3 * h))]
    return _lines(
        [*along, (np.array([0.0, 4.0, 0.0]), np.array([0.0, 4.0, h])), (w * X + 7 * Y, w * X + 7 * Y + h * Z)]
    )


# Name, function of a generator, and so 3 to 20 lines.
KINDS: dict[str, Callable[[np.random.Generator], Scene]] = {
    "box, all edges": lambda g: _lines(_box(*g.uniform(0.2, 0.6, size=3))),
    "box, nine visible edges": lambda g: _chosen(_box(*g.uniform(0.2, 0.6, size=3)), 0, 1, 2, 3, 4, 5, 6, 8, 9),
    "box corner and a parallel edge": lambda g: _chosen(_box(*g.uniform(0.2, 0.6, size=3)), 0, 1, 2, 7),
    "box, chain of four edges": lambda g: _chosen(_box(*g.uniform(0.2, 0.6, size=3)), 0, 3, 8, 10),
    "box, five edges": lambda g: _chosen(_box(*g.uniform(0.2, 0.6, size=3)), 0, 1, 3, 5, 8),
    "two boxes, aligned": lambda g: _two_boxes(g, False),
    "two boxes, one turned": lambda g: _two_boxes(g, True),
    "corridor with its end wall": lambda g: _corridor(g),
    "corridor with a door": lambda g: _corridor(g, [(np.array([0.0, 0.0, 2.0]), np.array([0.0, 2.0, 2.0]))]),
    "four edges on a cylinder and one across": _cylinder_edges,
    "street": _street,
    "stairs, five nosings and two sides": lambda g: _stairs(g, 5, True),
    "stairs, three nosings and two sides": lambda g: _stairs(g, 3, True),
    "stairs with risers": _stairs_with_risers,
    "window frame": lambda g: _window(g, 0),
    "window with two bars": lambda g: _window(g, 2),
    "window in a thick wall": _window_in_wall,
    "shelf, four boards": lambda g: _shelf(g, 3),
    "shelf, two boards": lambda g: _shelf(g, 1),
    "table": lambda g: _table(g, 4),
    "table, two legs": lambda g: _table(g, 2),
    "door frame": lambda g: _door(g, False),
    "door and floor": lambda g: _door(g, True),
    "open door": _open_door,
    "gable roof": _roof,
    "hip roof": _hip_roof,
    "pyramid, four edges": lambda g: _pyramid(g, 4, 0),
    "pyramid and base": lambda g: _pyramid(g, 4, 4),
    "three edges of a spire and one of its base": lambda g: _pyramid(g, 3, 1),
    "three edges of a spire and its base": lambda g: _pyramid(g, 3, 3),
    "five edges of a spire and one of its base": lambda g: _pyramid(g, 5, 1),
    "tetrahedron": _tetrahedron,
    "triangular prism": lambda g: _prism_parts(g, 3, 3, 3, 3),
    "triangular prism, sides and two edges": lambda g: _prism_parts(g, 3, 1, 1, 3),
    "triangular prism, sides and one edge": lambda g: _prism_parts(g, 3, 1, 0, 3),
    "hexagonal column, sides and one edge": lambda g: _prism_parts(g, 6, 1, 0, 6),
    "hexagonal column": lambda g: _prism_parts(g, 6, 6, 6, 6),
    "octagonal column, sides and two edges": lambda g: _prism_parts(g, 8, 2, 0, 8),
    "corner of a room": lambda g: _room_corner(g, 0, 1, 2, 3),
    "corner of a room, six edges": lambda g: _room_corner(g, 0, 1, 2, 3, 4, 5),
    "three edges of a room": lambda g: _room_corner(g, 0, 4, 5),
    "four horizontal beams": lambda g: _horizontal_beams(g, 4, 0),
    "three horizontal beams and a post": lambda g: _horizontal_beams(g, 3, 1),
    "three horizontal beams and two posts": lambda g: _horizontal_beams(g, 3, 2),
    "five lines of a panel": lambda g: _panel(g, 5),
    "grid of tiles": lambda g: _grid(g, 4, 4),
    "grid and a post": _grid_and_post,
    "fence": lambda g: _fence(g, 4, 2),
    "row of columns and beams": _column_row,
    "railway": lambda g: _rails(g, 4),
    "frame and two edges of depth": _frame_and_depth,
    "wedge": _wedge,
    "truss": _truss,
    "three orthogonal lines and one": _orthogonal_three_and_one,
}


def posed(scene: Scene, generator: np.random.Generator) -> Scene:
    """Return a scene turned and shifted at random, so that nothing is along an axis or at zero."""
    turn, _ = np.linalg.qr(generator.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    points, directions = scene
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return points @ turn.T + generator.uniform(-1.0, 1.0, size=3), unit @ turn.T


def measured(scene: Scene, position_std: float, direction_std: float, generator: np.random.Generator) -> Scene:
    """Return a scene whose points and directions are off by independent normal errors [m, rad]."""
    points, directions = scene
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    moved = points + position_std * generator.normal(size=points.shape)
    turned = unit + direction_std * generator.normal(size=points.shape)
    return moved, turned / np.linalg.norm(turned, axis=1, keepdims=True)


def rounded(scene: Scene, digits: int | None) -> tuple[Scene, float]:
    """Return a scene with rounded numbers, to decimals or to float32 (None), and the largest rounding step."""
    points, directions = scene
    if digits is None:
        step = float(np.spacing(np.float32(max(np.abs(points).max(), 1.0))))
        return (points.astype(np.float32).astype(float), directions.astype(np.float32).astype(float)), step
    return (np.round(points, digits), np.round(directions, digits)), 10.0**-digits
