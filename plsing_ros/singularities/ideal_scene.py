# SPDX-License-Identifier: Apache-2.0
"""The nearest scene of exact parallels, right angles, planes and circles within the tolerances of measured lines.

Lines of a man-made scene that are known to a tolerance only are parallel, orthogonal, coplanar or on a circular
cylinder as far as is known of them, where the measured ones miss it by no more than errors explain. The nearest scene
for which all of that is exact has the planes, curves and transversals that the measured one nearly has. Source: new,
docs/near_singular.md section "The ideal scene".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from plsing_ros.arrays import Array, cross
from plsing_ros.geometry import LineSet

# A relation is taken as meant if the lines miss it by up to this many standard deviations of the miss. A true one is
# missed by more in one of a hundred thousand.
_MEANT = 4.5
# Errors of lines in units of their tolerances, root mean square over the relations, above which the relations taken
# together are not meant; then fewer are tried.
_MAX_EXACTNESS, _STRICTER = 3.0, (1.0, 0.6, 0.35)
# Relations that follow from others do so at the solution only, and before that as nearly as it is near: share of the
# largest singular value up to which they are taken to follow, in each step.
_FOLLOWING = (5e-2, 3e-3, 1e-4, 1e-5, 1e-6, 1e-7)
# Sines and scene lengths that are zero in an exact scene.
_ZERO = 1e-9
# Slopes of relations of parallel lines are smaller than this.
_HOPELESS = 30.0
# Classes of directions up to which three of them are looked at for a common plane, and lines of a class for a circle.
_MAX_CLASSES, _MAX_CYLINDER = 6, 12


# The value of a relation of parallel lines or directions, and its derivatives by ("axis", class) or ("line", row).
_Relation = tuple[Callable[[], float], Callable[[], dict[tuple[str, int], Array]]]


@dataclass(frozen=True, eq=False)
class IdealScene:
    """Exact lines near measured ones.

    Attributes:
        lines: The exact lines, in the order and frame of the measured ones.
        exactness: By how many tolerances these differ from them, root mean square over the independent relations; 0 if
            nothing had to be changed.
        relations: How many independent relations were made exact.
    """

    lines: LineSet
    exactness: float
    relations: int


def ideal_scene(lines: LineSet) -> IdealScene:
    """Return the nearest scene in which what lines are within their tolerances is exact.

    Args:
        lines: Measured lines; exact ones are returned as they are.
    """
    if lines.exact or len(lines) < 2:
        return IdealScene(lines, 0.0, 0)
    for strictness in _STRICTER:
        scene = _Relations(lines, _MEANT * strictness)
        scene.relate()
        exactness, relations = scene.solve()
        if scene.add_broken():
            exactness, relations = scene.solve()
        if scene.unchanged():
            return IdealScene(lines, 0.0, relations)
        if exactness <= _MAX_EXACTNESS:
            return IdealScene(scene.exact_lines(), exactness, relations)
    return IdealScene(lines, 0.0, 0)


@dataclass(eq=False)
class _Relations:
    """Measured lines in classes of one direction each, what relates them, and the scene that makes it exact."""

    lines: LineSet
    meant: float
    class_of: Array = field(init=False)
    rows: list[_Relation] = field(init=False)
    held: list[_Relation] = field(init=False)

    def __post_init__(self) -> None:
        self.middle = self.lines.pivot.mean(axis=0)
        self.position = self.lines.pivot - self.middle
        self.size = float(np.linalg.norm(self.position, axis=1).mean()) or 1.0
        self.rows, self.held = [], []
        # Orthogonal classes (a, b); and classes (a, b) of the normal, or (a, -1), and two lines at one height along it.
        self.orthogonal: list[tuple[int, int]] = []
        self.planes: list[tuple[int, int, int, int]] = []
        self._classify()
        self.axis_shift, self.line_shift = np.zeros_like(self.axis), np.zeros_like(self.position)

    def _classify(self) -> None:
        """Gather lines that are parallel within their tolerances, each class with its mean direction."""
        direction, std = self.lines.direction, self.lines.direction_std
        sine = np.linalg.norm(cross(direction[:, np.newaxis], direction), axis=2)
        alike = sine <= self.meant * np.hypot(std[:, np.newaxis], std) + 1e-12
        label = np.full(len(direction), -1)
        for row in range(len(direction)):
            if label[row] < 0:
                members = {row}
                grown = [row]
                while grown:
                    near = set(np.flatnonzero(alike[grown.pop()]).tolist()) - members
                    members |= near
                    grown += sorted(near)
                label[sorted(members)] = label.max() + 1
        count = int(label.max()) + 1
        self.class_of = label
        self.axis, self.axis_variance = np.empty((count, 3)), np.empty(count)
        weight = 1.0 / np.maximum(std, 1e-150) ** 2
        for each in range(count):
            rows = np.flatnonzero(label == each)
            sign = np.sign(direction[rows] @ direction[rows[0]])
            share = np.where(std[rows] == std[rows].min(), 1.0, 0.0) if std[rows].min() == 0.0 else weight[rows]
            mean = (share * sign) @ direction[rows]
            self.axis[each] = mean / np.linalg.norm(mean)
            self.axis_variance[each] = 0.0 if std[rows].min() == 0.0 else 1.0 / weight[rows].sum()
        self.spread = np.array([self._spread_of(each) for each in range(count)])

    def _spread_of(self, each: int) -> float:
        """Return the sum of squares of the errors that the mean of a class leaves, in tolerances."""
        rows = np.flatnonzero(self.class_of == each)
        std = self.lines.direction_std[rows]
        sine = np.linalg.norm(cross(self.lines.direction[rows], self.axis[each]), axis=1)
        return float(((sine[std > 0.0] / std[std > 0.0]) ** 2).sum())

    @property
    def axes(self) -> Array:
        """The directions of the classes now."""
        moved = self.axis + self.axis_shift
        unit: Array = moved / np.linalg.norm(moved, axis=1, keepdims=True)
        return unit

    def relate(self) -> None:
        """Find what is meant: of directions first, which are made exact, and then of positions."""
        axes, deviation = self.axes, np.sqrt(self.axis_variance)
        count = len(axes)
        orthogonal = np.abs(axes @ axes.T) <= self.meant * np.hypot(deviation[:, np.newaxis], deviation) + 1e-12
        for a, b in combinations(range(count), 2):
            if orthogonal[a, b]:
                self.orthogonal.append((a, b))
        if count <= _MAX_CLASSES:
            for a, b, c in combinations(range(count), 3):
                if not orthogonal[[a, b, c]].all(axis=0).any() and not orthogonal[np.ix_([a, b, c], [a, b, c])].any():
                    sides = [np.linalg.norm(cross(axes[i], axes[j])) for i, j in ((b, c), (a, c), (a, b))]
                    miss = float(np.linalg.norm(deviation[[a, b, c]] * sides))
                    if abs(np.linalg.det(axes[[a, b, c]])) <= self.meant * miss + 1e-12:
                        self._add_flat(a, b, c)
        self.solve()
        self._relate_planes()
        self.solve()
        self._relate_cylinders()

    def _relate_planes(self) -> None:
        """Make lines coplanar that are: for each normal of two classes, or class, those across it at equal heights."""
        axes, deviation = self.axes, np.sqrt(self.axis_variance)
        normals = [(axes[a], (a, -1), float(deviation[a])) for a in range(len(axes))]
        for a, b in combinations(range(len(axes)), 2):
            normal = cross(axes[a], axes[b])
            sine = float(np.linalg.norm(normal))
            if all(np.linalg.norm(cross(normal, other)) > _ZERO * sine for other, _, _ in normals):
                normals.append((normal / sine, (a, b), float(np.hypot(deviation[a], deviation[b])) / sine))
        for normal, classes, tilt in normals:
            rows = np.flatnonzero(np.abs(axes[self.class_of] @ normal) <= _ZERO)
            height = (self.position + self.line_shift)[rows] @ normal
            order = rows[np.argsort(height, kind="stable")]
            first: int | None = None
            for row in order.tolist():
                if first is not None and self._same_height(first, row, normal, tilt):
                    self.planes.append((*classes, first, row))
                else:
                    first = row

    def _same_height(self, first: int, second: int, normal: Array, tilt: float) -> bool:
        offset = (self.position + self.line_shift)[second] - (self.position + self.line_shift)[first]
        height = float(offset @ normal)
        lever = float(np.linalg.norm(offset - height * normal))
        shift = np.hypot(*self.lines.position_std[[first, second]])
        return abs(height) <= self.meant * float(np.hypot(shift, lever * tilt)) + 1e-12 * self.size

    def _relate_cylinders(self) -> None:
        """Make parallel lines coplanar or cocircular that are, beyond what planes of several classes say."""
        for each in range(len(self.axis)):
            rows = np.flatnonzero(self.class_of == each).tolist()
            if not 3 <= len(rows) <= _MAX_CYLINDER:
                continue
            base = rows[:2]
            solid = None
            for row in rows[2:]:
                if self._try(self._area, each, [*base, row]):
                    continue
                if solid is None:
                    solid = row
                elif solid != row:
                    self._try(self._circle, each, [*base, solid, row])

    def _try(self, relation: Callable[..., float], each: int, rows: list[int]) -> bool:
        """Add a relation of parallel lines if it is missed by no more than errors explain."""

        def value() -> float:
            return relation(each, *rows)

        def slopes() -> dict[tuple[str, int], Array]:
            return self._slopes(value, each, rows)

        if abs(value()) <= _ZERO * self.size:
            # The planes say so already, or it is so by chance for as long as nothing else moves the lines.
            self.held.append((value, slopes))
            return True
        deviation = float(self.lines.position_std[rows].max() + self.size * np.sqrt(self.axis_variance[each]))
        if abs(value()) > _HOPELESS * self.meant * deviation:
            return False
        std = self.lines.position_std
        variance = sum(
            float((slope**2).sum()) * (std[row] ** 2 if kind == "line" else self.axis_variance[row])
            for (kind, row), slope in slopes().items()
        )
        if abs(value()) > self.meant * np.sqrt(variance) + 1e-12 * self.size:
            return False
        self.rows.append((value, slopes))
        return True

    def add_broken(self) -> bool:
        """Add the relations that held when they were found and hold no more; return whether there are any."""
        broken = [each for each in self.held if abs(each[0]()) > _ZERO * self.size]
        self.held = [each for each in self.held if each not in broken]
        self.rows += broken
        return len(broken) > 0

    def _slopes(self, value: Callable[[], float], each: int, rows: list[int]) -> dict[tuple[str, int], Array]:
        """Return the derivatives of a relation of parallel lines, by central differences."""
        slopes: dict[tuple[str, int], Array] = {}
        for kind, row, shift in [("axis", each, self.axis_shift), *(("line", row, self.line_shift) for row in rows)]:
            step = 1e-5 * (1.0 if kind == "axis" else self.size)
            slope = np.zeros(3)
            for i in range(3):
                start = shift[row, i]
                shift[row, i] = start + step
                high = value()
                shift[row, i] = start - step
                slope[i] = (high - value()) / (2.0 * step)
                shift[row, i] = start
            slopes[kind, row] = slope
        return slopes

    def _section(self, each: int, rows: tuple[int, ...]) -> Array:
        """Return where lines cross a plane across their class, shape (k, 2)."""
        axis = self.axes[each]
        # Changes little with the axis, as the derivatives of what is made of it need.
        first = cross(axis, np.eye(3)[np.abs(self.axis[each]).argmin()])
        first = first / np.linalg.norm(first)
        section: Array = (self.position + self.line_shift)[list(rows)] @ np.stack([first, cross(axis, first)], axis=1)
        return section

    def _area(self, each: int, *rows: int) -> float:
        """Return the height of the triangle of three parallel lines over its longest side [m]."""
        a, b, c = self._section(each, rows)
        longest = float(np.linalg.norm([b - a, c - b, a - c], axis=1).max())
        first, second = b - a, c - a
        return float((first[0] * second[1] - first[1] * second[0]) / max(longest, 1e-300))

    def _circle(self, each: int, *rows: int) -> float:
        """Return how far the fourth of four parallel lines is from the cylinder through three, to first order [m]."""
        points = self._section(each, rows)
        a, b, c = points[:3] - points[0]
        square = np.array([b @ b, c @ c])
        middle = 0.5 * np.linalg.lstsq(np.stack([b, c]), square, rcond=None)[0]
        return float(np.linalg.norm(points[3] - points[0] - middle) - np.linalg.norm(a - middle))

    def _add_flat(self, a: int, b: int, c: int) -> None:
        def slopes() -> dict[tuple[str, int], Array]:
            u, v, w = self.axes[[a, b, c]]
            return {("axis", a): cross(v, w), ("axis", b): cross(w, u), ("axis", c): cross(u, v)}

        self.rows.append((lambda: float(np.linalg.det(self.axes[[a, b, c]])), slopes))

    def solve(self) -> tuple[float, int]:
        """Move directions and positions so that all relations hold, by the least sum of squares in tolerances.

        Returns:
            Root mean square over the independent relations, parallels among them, and their number.
        """
        count, n = len(self.axis), len(self.position)
        variance = np.concatenate([np.repeat(self.axis_variance, 3), np.repeat(self.lines.position_std**2, 3)])
        shift, rank = np.zeros(len(variance)), 0
        for following in _FOLLOWING if self.rows or self.orthogonal or self.planes else ():
            jacobian, value = self._linearized(count, n)
            if rank and np.abs(value).max() <= 1e-14 * max(self.size, 1.0):
                break
            # Scaled by the deviations, the shortest solution is the likeliest change.
            scaled = jacobian * np.sqrt(variance)
            size = np.linalg.norm(scaled, axis=1)
            used = size > 0.0
            left, values, right = np.linalg.svd(scaled[used] / size[used, np.newaxis], full_matrices=False)
            rank = int((values > following * values[0]).sum()) if len(values) else 0
            target = (jacobian @ shift - value)[used] / size[used]
            change = right[:rank].T @ ((left[:, :rank].T @ target) / values[:rank])
            shift = np.sqrt(variance) * change
            self.axis_shift[:] = shift[: 3 * count].reshape(-1, 3)
            self.line_shift[:] = shift[3 * count :].reshape(-1, 3)
        known = variance > 0.0
        total = float((shift[known] ** 2 / variance[known]).sum() + self.spread.sum())
        rank += 2 * (n - count)
        return (np.sqrt(total / rank) if rank else 0.0), rank

    def unchanged(self) -> bool:
        """Whether the measured lines have all relations exactly."""
        turned = np.linalg.norm(cross(self.axes[self.class_of], self.lines.direction), axis=1).max()
        return bool(turned <= 0.1 * _ZERO and np.abs(self.line_shift).max() <= 0.1 * _ZERO * self.size)

    def _linearized(self, count: int, n: int) -> tuple[Array, Array]:
        """Return the derivatives of all relations by (axes, lines), shape (r, 3 (count + n)), and their values."""
        axes, moved = self.axes, self.position + self.line_shift
        first = len(self.orthogonal)
        other = first + len(self.planes)
        jacobian = np.zeros((other + len(self.rows), count + n, 3))
        value = np.zeros(len(jacobian))
        if self.orthogonal:
            a, b = np.array(self.orthogonal).T
            rows = np.arange(first)
            jacobian[rows, a], jacobian[rows, b] = axes[b], axes[a]
            value[:first] = (axes[a] * axes[b]).sum(axis=1)
        if self.planes:
            a, b, low, high = np.array(self.planes).T
            rows, single = np.arange(first, other), (b < 0)[:, np.newaxis]
            product = cross(axes[a], axes[b])
            sine = np.linalg.norm(product, axis=1, keepdims=True)
            normal = np.where(single, axes[a], product / np.maximum(sine, 1e-300))
            between = moved[high] - moved[low]
            jacobian[rows, count + low], jacobian[rows, count + high] = -normal, normal
            # The height over |u x v|; where it is zero, the change of that length does not matter.
            jacobian[rows, a] = np.where(single, between, cross(axes[b], between) / np.maximum(sine, 1e-300))
            jacobian[rows, b] += np.where(single, 0.0, -cross(axes[a], between) / np.maximum(sine, 1e-300))
            value[first:other] = (normal * between).sum(axis=1)
        for i, (own, slopes) in enumerate(self.rows, start=other):
            value[i] = own()
            for (kind, row), slope in slopes().items():
                jacobian[i, row if kind == "axis" else count + row] = slope
        # Only across the directions: along them, neither a direction nor a position changes a line.
        along = np.concatenate([axes, axes[self.class_of]])
        jacobian -= (jacobian * along).sum(axis=2, keepdims=True) * along
        return jacobian.reshape(len(value), -1), value

    def exact_lines(self) -> LineSet:
        """Return the lines now, with the orientations of the measured ones, known exactly."""
        direction = self.axes[self.class_of]
        direction = direction * np.sign((direction * self.lines.direction).sum(axis=1))[:, np.newaxis]
        points = self.position + self.line_shift + self.middle
        return LineSet.from_points_directions(points, direction, self.lines.frame, self.lines.ids)
