# SPDX-License-Identifier: Apache-2.0
"""Exact answers for scenes with rational coordinates: transversals, and how many isolated points are real.

Needs sympy, which is imported when a function is called.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Any

from plsing_ros.singularities.ternary_forms import exponents
from plsing_ros.singularities.transversals import TransversalFamily

# A rational number: int, fractions.Fraction or anything sympy reads as one.
Rational = Any


@dataclass(frozen=True)
class ExactTransversals:
    """What meets all lines, exactly.

    Attributes:
        null_dimension: Dimension of the null space of the Plücker matrix.
        discriminant: For a two-dimensional null space a positive multiple of the discriminant of d . m on it, for a
            one-dimensional one the value d . m of a null vector; None otherwise.
        lines: The single transversals as sympy vectors (d, m), of any length.
    """

    null_dimension: int
    discriminant: Any
    lines: tuple[tuple[Any, ...], ...]


@dataclass(frozen=True)
class ExactCount:
    """How many isolated points four lines have.

    Attributes:
        distinct: Different complex ones.
        real: Different real ones.
    """

    distinct: int
    real: int


def exact_transversals(
    points: Sequence[Sequence[Rational]], directions: Sequence[Sequence[Rational]]
) -> ExactTransversals:
    """Return the transversals of n lines with rational (or algebraic) coordinates.

    Args:
        points: A point on each line, n x 3.
        directions: n x 3, not zero.
    """
    import sympy

    rows = []
    for point, direction in zip(points, directions, strict=True):
        u = sympy.Matrix([sympy.sympify(x) for x in direction])
        rows.append([*sympy.Matrix([sympy.sympify(x) for x in point]).cross(u), *u])
    null = sympy.Matrix(rows).nullspace(simplify=True)
    product = [[sympy.expand(a[:3, 0].dot(b[3:, 0]) + b[:3, 0].dot(a[3:, 0])) / 2 for b in null] for a in null]
    if len(null) == 1:
        value = sympy.simplify(product[0][0])
        return ExactTransversals(1, value, (tuple(null[0]),) if value == 0 else ())
    if len(null) != 2:
        return ExactTransversals(len(null), None, ())
    (a, b), (_, c) = product
    discriminant = sympy.simplify(b * b - a * c)
    root = sympy.sqrt(discriminant)
    if a == 0 and c == 0 and b == 0:
        return ExactTransversals(2, discriminant, ())
    roots = [(1, 0), (-c, 2 * b)] if a == 0 else [(-b + root, a), (-b - root, a)]
    kept = roots if discriminant > 0 else roots[:1] if discriminant == 0 else []
    lines = tuple(tuple(sympy.expand(x * p + y * q) for p, q in zip(null[0], null[1], strict=True)) for x, y in kept)
    return ExactTransversals(2, discriminant, lines)


def exact_family(points: Sequence[Sequence[Rational]], directions: Sequence[Sequence[Rational]]) -> TransversalFamily:
    """Return what meets all n lines with rational coordinates: the table of transversals in docs/theory.md, exactly.

    Args:
        points: A point on each line, n x 3.
        directions: n x 3, not zero.
    """
    rows = [
        [*_cross(_exact(point), _exact(direction)), *_exact(direction)]
        for point, direction in zip(points, directions, strict=True)
    ]
    null = _matrix(rows).nullspace()
    dimension = null.shape[0]
    if dimension in (0, 4, 5):
        return TransversalFamily.EVERYWHERE if dimension else TransversalFamily.NONE
    basis = null.to_list()
    form = _matrix([[_dot(a[:3], b[3:]) + _dot(b[:3], a[3:]) for b in basis] for a in basis])
    positive, negative = _signature(form)
    rank = positive + negative
    if dimension == 1:
        return TransversalFamily.NONE if rank else TransversalFamily.ONE
    if dimension == 2:
        if rank < 2:
            return TransversalFamily.DOUBLE if rank else TransversalFamily.PENCIL
        return TransversalFamily.TWO if positive == negative else TransversalFamily.COMPLEX_PAIR
    if rank == 0:
        flat = _matrix([row[:3] for row in basis]).rank() == 2
        return TransversalFamily.PLANE if flat else TransversalFamily.EVERYWHERE
    if rank == 2:
        return TransversalFamily.TWO_PENCILS if positive == negative else TransversalFamily.ONE
    return TransversalFamily.REGULUS if rank == 3 else TransversalFamily.PENCIL


def _signature(form: Any) -> tuple[int, int]:
    """Return how many eigenvalues of a symmetric rational matrix are positive and negative, by Descartes' rule.

    The rule is exact here, because all roots of the characteristic polynomial are real.
    """
    coefficients = form.charpoly()
    size = len(coefficients) - 1

    def changes(values: list[Any]) -> int:
        signs = [value > 0 for value in values if value != 0]
        return sum(a != b for a, b in pairwise(signs))

    return changes(coefficients), changes([c * (-1) ** (size - i) for i, c in enumerate(coefficients)])


def exact_point_count(
    points: Sequence[Sequence[Rational]], directions: Sequence[Sequence[Rational]]
) -> ExactCount | None:
    """Return how many isolated singular points four lines with rational coordinates have, by Sturm's theorem.

    Args:
        points: A point on each line, 4 x 3.
        directions: 4 x 3, not zero; they need not have unit length.

    Returns:
        None if the scene is special: the quotient ring has not dimension ten, or two points share a value of the
        linear forms used.
    """
    polynomial = axis_polynomial(points, directions)
    if polynomial is None or polynomial.gcd(polynomial.diff()).degree() > 0:
        return None
    return ExactCount(10, int(polynomial.count_roots()))


def axis_polynomial(points: Sequence[Sequence[Rational]], directions: Sequence[Sequence[Rational]]) -> Any:
    """Return the sympy polynomial whose roots are the values of a quotient of two linear forms at the axis directions.

    Every camera centre at which four lines lose a screw has its axis direction among the zeros of the five quartics of
    isolated_points; here these, their quotient ring and a multiplication matrix on it are in rational arithmetic.

    Args:
        points: A point on each line, 4 x 3.
        directions: 4 x 3, not zero.

    Returns:
        None if the quotient ring has not dimension ten, or the denominator vanishes at an axis direction.
    """
    import sympy
    from sympy.polys.matrices import DomainMatrix

    high, low = exponents(4), exponents(3)
    rows = [[minor.get(e, 0) for e in high] for minor in _force_minors(points, directions)]
    null = _matrix(rows).nullspace()
    if null.shape[0] != 10:
        return None
    basis = null.transpose().to_list()

    def times(form: tuple[int, int, int]) -> Any:
        product = []
        for e in low:
            raised = [basis[high.index((e[0] + (v == 0), e[1] + (v == 1), e[2] + (v == 2)))] for v in range(3)]
            product.append([sum(form[v] * raised[v][column] for v in range(3)) for column in range(10)])
        return DomainMatrix(product, (10, 10), null.domain)

    denominator = times((3, 8, 5))
    if denominator.rank() < 10:
        return None
    characteristic = (denominator.inv() * times((6, -3, 7))).charpoly()
    return sympy.Poly([null.domain.to_sympy(value) for value in characteristic], sympy.Symbol("t"))


def exact_rank(points: Sequence[Sequence[Rational]], directions: Sequence[Sequence[Rational]], center: Any) -> int:
    """Return the rank of xi at a rational camera centre (3,), for n lines with rational coordinates.

    Source: eq. basiseta with Q = C; the length of a direction scales rows only.
    """
    rows = []
    for point, direction in zip(points, directions, strict=True):
        offset = [x - c for x, c in zip(_exact(point), _exact(center), strict=True)]
        u = _exact(direction)
        f = _cross(u, offset)
        rows += [[*f, *_cross(offset, f)], [0, 0, 0, *_cross(u, f)]]
    return int(_matrix(rows).rank())


def exact_surfaces(points: Sequence[Sequence[Rational]], directions: Sequence[Sequence[Rational]]) -> tuple[Any, Any]:
    """Return G and H of the first three lines as dictionaries from exponents of (X, Y, Z) to rational coefficients.

    They are the quadric and the cubic of three lines, up to a constant factor.
    """
    from sympy import QQ, ring

    ring_xyz, *center = ring("X,Y,Z", QQ)
    f, m = [], []
    for point, direction in zip(points[:3], directions[:3], strict=True):
        u = _exact(direction)
        f.append(_cross(u, [x - c for x, c in zip(_exact(point), center, strict=True)]))
        m.append(_cross(u, f[-1]))
    return dict(ring_xyz(_dot(f[0], _cross(f[1], f[2])))), dict(ring_xyz(_dot(m[0], _cross(m[1], m[2]))))


def _force_minors(points: Sequence[Sequence[Rational]], directions: Sequence[Sequence[Rational]]) -> list[Any]:
    """Return the five 4 x 4 minors of the force matrix (isolated_points) as polynomials in the axis direction.

    For a basis of forces of another dimension than four there are none: five times zero.
    """
    from sympy import QQ, ring

    polynomials, *w = ring("x,y,z", QQ)
    feet, along = [_exact(point) for point in points], [_exact(direction) for direction in directions]
    constraints = [[0] * 12 for _ in range(8)]
    for i, (point, u) in enumerate(zip(feet, along, strict=True)):
        constraints[i][3 * i : 3 * i + 3] = u
        for axis in range(3):
            constraints[4 + axis][3 * i + axis] = 1
        # Any point will do, since F is across the line.
        constraints[7][3 * i : 3 * i + 3] = point
    rows = []
    for force in _matrix(constraints).nullspace().to_list():
        f = [force[3 * i : 3 * i + 3] for i in range(4)]
        planes = [_dot(w, _cross(f[i], along[i])) for i in range(4)]
        moments = [_dot(f[i], _cross(u, feet[i])) / _dot(u, u) for i, u in enumerate(along)]
        rows.append([*planes, sum(_dot(w, u) * moment for u, moment in zip(along, moments, strict=True))])
    if len(rows) != 4:
        return [{}] * 5
    pairs = [
        {(a, b): one[a] * two[b] - one[b] * two[a] for a, b in combinations(range(5), 2)}
        for one, two in (rows[:2], rows[2:])
    ]
    return [polynomials(_laplace(columns, *pairs)) for columns in combinations(range(5), 4)]


def _laplace(columns: tuple[int, ...], first: dict[Any, Any], second: dict[Any, Any]) -> Any:
    """Return a 4 x 4 minor from the 2 x 2 minors of its first and of its last two rows."""
    total = 0
    for i, j in combinations(range(4), 2):
        rest = [k for k in range(4) if k not in (i, j)]
        product = first[columns[i], columns[j]] * second[columns[rest[0]], columns[rest[1]]]
        total += product if (i + j) % 2 else -product
    return total


def _exact(values: Sequence[Rational]) -> list[Any]:
    """Return rational numbers in sympy's domain QQ."""
    from sympy import QQ, sympify

    return [QQ.from_sympy(sympify(value)) for value in values]


def _matrix(rows: Sequence[Sequence[Any]]) -> Any:
    from sympy import QQ
    from sympy.polys.matrices import DomainMatrix

    return DomainMatrix([[QQ(value) for value in row] for row in rows], (len(rows), len(rows[0])), QQ)


def _dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
