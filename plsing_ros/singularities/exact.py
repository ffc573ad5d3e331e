"""Exact answers for scenes with rational coordinates: transversals, and how many isolated points are real.

Needs sympy, which is imported when a function is called.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

from plsing_ros.singularities.ternary_forms import exponents

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
        polynomial: Coefficients of the polynomial of degree ten whose roots they are, highest first, rational.
    """

    distinct: int
    real: int
    polynomial: tuple[Any, ...]


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


def exact_point_count(
    points: Sequence[Sequence[Rational]], directions: Sequence[Sequence[Rational]]
) -> ExactCount | None:
    """Return how many isolated singular points four lines with rational coordinates have, by Sturm's theorem.

    The five quartics of isolated_points, their quotient ring and a multiplication matrix on it in rational arithmetic.

    Args:
        points: A point on each line, 4 x 3.
        directions: 4 x 3, not zero; they need not have unit length.

    Returns:
        None if the scene is special: the quotient ring has not dimension ten, or two points share a value of the
        linear forms used.
    """
    import sympy
    from sympy.polys.matrices import DomainMatrix

    x, y = sympy.symbols("x y")
    quartics = [sympy.Poly(minor, x, y) for minor in _force_minors(points, directions, (x, y, sympy.Integer(1)))]
    high, low = exponents(4), exponents(3)
    coefficients = [[quartic.coeff_monomial(x**a * y**b) for a, b, _ in high] for quartic in quartics]
    null = sympy.Matrix(coefficients).nullspace()
    if len(null) != 10:
        return None
    basis = sympy.Matrix.hstack(*null)

    def times(form: tuple[int, int, int]) -> Any:
        rows = []
        for e in low:
            raised = [high.index((e[0] + (v == 0), e[1] + (v == 1), e[2] + (v == 2))) for v in range(3)]
            rows.append(sum((form[v] * basis[raised[v], :] for v in range(3)), sympy.zeros(1, 10)))
        return DomainMatrix.from_Matrix(sympy.Matrix.vstack(*rows)).to_field()

    denominator = times((3, 8, 5))
    if denominator.det() == 0:
        return None
    characteristic = (denominator.inv() * times((6, -3, 7))).charpoly()
    polynomial = sympy.Poly([denominator.domain.to_sympy(value) for value in characteristic], x)
    if sympy.gcd(polynomial, polynomial.diff()).degree() > 0:
        return None
    return ExactCount(10, int(polynomial.count_roots()), tuple(polynomial.all_coeffs()))


def _force_minors(
    points: Sequence[Sequence[Rational]], directions: Sequence[Sequence[Rational]], w: tuple[Any, Any, Any]
) -> list[Any]:
    """Return the five 4 x 4 minors of the matrix of isolated_points.force_matrix at w."""
    import sympy

    feet = [sympy.Matrix([sympy.sympify(v) for v in point]) for point in points]
    along = [sympy.Matrix([sympy.sympify(v) for v in direction]) for direction in directions]
    constraints = sympy.zeros(8, 12)
    for i, (point, u) in enumerate(zip(feet, along, strict=True)):
        columns = slice(3 * i, 3 * i + 3)
        constraints[i, columns] = u.T
        constraints[4:7, columns] = sympy.eye(3)
        # Any point will do, since F is across the line.
        constraints[7, columns] = point.T
    axis = sympy.Matrix(w)
    rows = []
    for force in constraints.nullspace():
        f = [force[3 * i : 3 * i + 3, :] for i in range(4)]
        planes = [axis.dot(f[i].cross(along[i])) for i in range(4)]
        moment = sum(axis.dot(u) * f[i].dot(u.cross(feet[i])) / u.dot(u) for i, u in enumerate(along))
        rows.append([*planes, moment])
    matrix = sympy.Matrix(rows)
    if matrix.rows != 4:
        return [sympy.Integer(0)] * 5
    return [sympy.expand(matrix[:, list(columns)].det(method="berkowitz")) for columns in combinations(range(5), 4)]
