# SPDX-License-Identifier: Apache-2.0
"""Proofs that a found point or transversal is near a true one: Krawczyk's test in interval arithmetic.

The lines are taken as the rational ones they are the rounding of, if there are such, else as the exact real lines with
direction u and through the point u x l / |u|^2, for the doubles u, l of the LineSet. Every operation from there on is
done with intervals that enclose the exact result. If Krawczyk's operator maps a box into its own interior, the box
contains exactly one solution of the equations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array
from plsing_ros.geometry import LineSet
from plsing_ros.singularities.bilinear_system import bilinear_tensor
from plsing_ros.singularities.proofs.rational_lines import RationalLines
from plsing_ros.singularities.scene_frame import SceneFrame

# Radii of the boxes tried, relative to the unknowns' order of one.
_RADII = tuple(4.0**i * 1e-15 for i in range(14))


@dataclass(frozen=True, eq=False)
class Certificate:
    """The outcome of one proof.

    Attributes:
        name: What it is about: "transversal 1", "isolated point 1", a pair of rows of isolated_points_complex, a
            surface, or a whole: "what meets all lines", "all isolated points", "singular everywhere".
        proved: Whether the statement is proved.
        radius: How far the found is from the true at most: [m] for points, of the unit Plücker vector in scene
            coordinates for transversals, relative to the largest coefficient for surfaces; infinite if not proved or
            not computed. For a real point it also proves that the true one is real.
        lines: Ids of the lines the proof is about. Interval arithmetic can only be about four: more give more
            equations than unknowns, and no interval test can tell a zero of these from a near miss.
        statement: What is proved, or why it is not.
    """

    name: str
    proved: bool
    radius: float
    lines: tuple[int, ...]
    statement: str


def certify_isolated_point(
    lines: LineSet, frame: SceneFrame, center: npt.NDArray[Any], name: str, exact: RationalLines | None = None
) -> Certificate:
    """Prove that four lines have an isolated singular centre near a given one.

    Args:
        lines: Four lines.
        frame: Their scene frame; any will do, it only conditions the computation.
        center: Real or complex, in the frame of the lines, shape (3,) [m].
        name: For the result.
        exact: The rational lines to prove it for, if not for the doubles.
    """
    scene = np.asarray((center - frame.center) / frame.length)
    real = bool(np.all(np.imag(scene) == 0.0))
    scene = scene.real if real else scene
    tensor = bilinear_tensor(frame.direction[np.newaxis], frame.point[np.newaxis])[0]
    k = np.linalg.svd(np.tensordot(np.array([1.0, *scene]), tensor, axes=1))[2][-1].conj()
    enclosed = _interval_lines(lines, frame, exact)
    unknown = np.concatenate([scene, k])
    system = _PointEquations(_interval_tensor(enclosed), unknown)
    radius = _krawczyk(system, unknown if real else np.concatenate([unknown.real, unknown.imag]), real)
    # The box bounds every coordinate, of the real and the imaginary part, around the centre as rounded into the scene.
    rounding = 8.0 * np.finfo(float).eps * float(np.abs(center).max() + np.abs(frame.center).max())
    length = frame.length * (3.0 if real else 6.0) ** 0.5
    return _enclosed(name, radius, 1.001 * radius * length + rounding, lines.ids)


def certify_transversal(
    lines: LineSet, frame: SceneFrame, point: Array, direction: Array, name: str, exact: RationalLines | None = None
) -> Certificate:
    """Prove that four lines have a transversal near a given one.

    Args:
        lines: Four lines.
        frame: Their scene frame.
        point: A point of the transversal, in the frame of the lines, shape (3,) [m].
        direction: Its unit direction, shape (3,).
        name: For the result.
        exact: The rational lines to prove it for, if not for the doubles.
    """
    foot = frame.to_scene(point)
    line = np.concatenate([direction, np.cross(foot, direction)])
    line /= np.linalg.norm(line)
    radius = _krawczyk(_LineEquations(_interval_lines(lines, frame, exact), line), line, True)
    return _enclosed(name, radius, 1.001 * radius * 6.0**0.5, lines.ids)


def _enclosed(name: str, box: float, radius: float, ids: tuple[int, ...]) -> Certificate:
    if np.isfinite(box):
        return Certificate(name, True, radius, ids, "Interval arithmetic: exactly one is in the box of this radius.")
    return Certificate(name, False, radius, ids, "Not proved: Krawczyk's test fails, as it does at multiple solutions.")


def _interval_lines(
    lines: LineSet, frame: SceneFrame, exact: RationalLines | None
) -> list[tuple[list[Any], list[Any]]]:
    """Return enclosures of direction, of any length, and point of each line in scene coordinates."""
    from mpmath import iv

    center, length = [iv.mpf(c) for c in frame.center.tolist()], iv.mpf(frame.length)
    if exact is None:
        given = []
        for u_row, l_row in zip(lines.direction.tolist(), lines.moment.tolist(), strict=True):
            u, moment = [iv.mpf(x) for x in u_row], [iv.mpf(x) for x in l_row]
            square = u[0] ** 2 + u[1] ** 2 + u[2] ** 2
            given.append((u, [component / square for component in _cross(u, moment)]))
    else:
        given = [
            ([iv.mpf(x) for x in u], [iv.mpf(x.numerator) / iv.mpf(x.denominator) for x in point])
            for u, point in zip(exact.directions, exact.points, strict=True)
        ]
    return [(u, [(x - c) / length for x, c in zip(foot, center, strict=True)]) for u, foot in given]


def _interval_tensor(enclosed: list[tuple[list[Any], list[Any]]]) -> list[list[list[Any]]]:
    """Return enclosures of the coefficients of bilinear_system.bilinear_tensor, index order [h][row][column].

    Written out anew rather than shared, so that the proof does not rest on the code it is to check.
    """
    from mpmath import iv

    zero = iv.mpf(0)
    tensor = [[[zero] * 6 for _ in range(2 * len(enclosed))] for _ in range(4)]
    for i, (u, point) in enumerate(enclosed):
        for a in range(4):
            # M - C for the four unit vectors of (C_0, C), C_0 M - C.
            offset = point if a == 0 else [iv.mpf(-1) if b == a - 1 else zero for b in range(3)]
            f = _cross(u, offset)
            tensor[a][2 * i] = [*f, *_cross(point, f)]
            tensor[a][2 * i + 1] = [zero, zero, zero, *_cross(u, f)]
    return tensor


class _PointEquations:
    """A(1, C) k = 0 and conj(k0) . k = 1 in x = (C, k), nine unknowns."""

    def __init__(self, tensor: list[list[list[Any]]], start: npt.NDArray[Any]) -> None:
        self._tensor = tensor
        self._norm = [complex(value) for value in start[3:].conj()]

    def value(self, x: list[Any]) -> list[Any]:
        rows = self._matrix(x)
        return [*(_dot(row, x[3:]) for row in rows), _dot(self._norm, x[3:]) - 1]

    def jacobian(self, x: list[Any]) -> list[list[Any]]:
        rows = self._matrix(x)
        of_center = [[_dot(self._tensor[a][i], x[3:]) for a in (1, 2, 3)] for i in range(len(rows))]
        return [[*left, *right] for left, right in zip(of_center, rows, strict=True)] + [[0, 0, 0, *self._norm]]

    def _matrix(self, x: list[Any]) -> list[list[Any]]:
        h = [1, *x[:3]]
        return [
            [sum((h[a] * self._tensor[a][i][j] for a in range(1, 4)), self._tensor[0][i][j]) for j in range(6)]
            for i in range(len(self._tensor[0]))
        ]


class _LineEquations:
    """l_i . d + u_i . m = 0, d . m = 0 and t0 . t = 1 in the six unknowns t = (d, m)."""

    def __init__(self, lines: list[tuple[list[Any], list[Any]]], start: Array) -> None:
        self._rows = [[*_cross(point, u), *u] for u, point in lines]
        self._norm = start.tolist()

    def value(self, x: list[Any]) -> list[Any]:
        return [*(_dot(row, x) for row in self._rows), _dot(x[:3], x[3:]), _dot(self._norm, x) - 1]

    def jacobian(self, x: list[Any]) -> list[list[Any]]:
        return [*self._rows, [*x[3:], *x[:3]], self._norm]


def _krawczyk(system: _PointEquations | _LineEquations, start: Array, real: bool) -> float:
    """Return the radius of the smallest tried box around start that holds exactly one solution, infinite if none.

    Complex unknowns come as their real and then their imaginary parts.
    """
    from mpmath import iv

    size = len(start)
    point = [iv.mpf(value) for value in start.tolist()]
    midpoint = np.array([[float(entry.mid) for entry in row] for row in _real_jacobian(system, point, real)])
    try:
        inverse = np.linalg.inv(midpoint).tolist()
    except np.linalg.LinAlgError:
        return float("inf")
    newton = [_dot([iv.mpf(y) for y in row], _real_value(system, point, real)) for row in inverse]
    for radius in _RADII:
        box = [x + iv.mpf([-radius, radius]) for x in point]
        jacobian = _real_jacobian(system, box, real)
        inside = True
        for i in range(size):
            # One component of -Y F(x) + (I - Y J(X)) (X - x).
            image = -newton[i]
            for j in range(size):
                entry = sum((iv.mpf(inverse[i][m]) * jacobian[m][j] for m in range(size)), iv.mpf(0))
                image += (iv.mpf(1 if i == j else 0) - entry) * iv.mpf([-radius, radius])
            if not (float(image.a) > -radius and float(image.b) < radius):
                inside = False
                break
        if inside:
            return radius
    return float("inf")


def _real_value(system: _PointEquations | _LineEquations, x: list[Any], real: bool) -> list[Any]:
    if real:
        return [_real_part(value) for value in system.value(x)]
    values = system.value(_complex(x))
    return [_real_part(value) for value in values] + [_imaginary_part(value) for value in values]


def _real_jacobian(system: _PointEquations | _LineEquations, x: list[Any], real: bool) -> list[list[Any]]:
    if real:
        return [[_real_part(entry) for entry in row] for row in system.jacobian(x)]
    rows = system.jacobian(_complex(x))
    parts = [([_real_part(e) for e in row], [_imaginary_part(e) for e in row]) for row in rows]
    # The Cauchy-Riemann equations.
    return [[*re, *(-e for e in im)] for re, im in parts] + [[*im, *re] for re, im in parts]


def _complex(x: list[Any]) -> list[Any]:
    from mpmath import iv

    half = len(x) // 2
    return [iv.mpc(re, im) for re, im in zip(x[:half], x[half:], strict=True)]


def _real_part(value: Any) -> Any:
    from mpmath import iv

    return iv.mpf(value.real) if isinstance(value, int | float | complex) else value.real


def _imaginary_part(value: Any) -> Any:
    from mpmath import iv

    return iv.mpf(value.imag) if isinstance(value, int | float | complex) else value.imag


def _dot(first: list[Any], second: list[Any]) -> Any:
    from mpmath import iv

    total = iv.mpf(0)
    for x, y in zip(first, second, strict=True):
        total = total + iv.convert(x) * y
    return total


def _cross(a: list[Any], b: list[Any]) -> list[Any]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
