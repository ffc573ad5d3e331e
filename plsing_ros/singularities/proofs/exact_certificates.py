# SPDX-License-Identifier: Apache-2.0
"""Proofs in exact rational arithmetic, of what interval arithmetic cannot prove: that nothing else exists, and facts
about all of more lines than four. They are about rational_lines, whose rounding the given lines are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from itertools import combinations
from typing import Any

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.singularities.loci import Kind
from plsing_ros.singularities.many_lines import best_subsets
from plsing_ros.singularities.proofs.exact import (
    axis_polynomial,
    exact_family,
    exact_point_count,
    exact_rank,
    exact_surfaces,
    exact_transversals,
)
from plsing_ros.singularities.proofs.interval import Certificate
from plsing_ros.singularities.proofs.rational_lines import RationalLines
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.singular_centers import SingularSet
from plsing_ros.singularities.transversals import TransversalFamily, observed_rows

# Four-line subsets whose axis polynomials are compared.
_SUBSETS = 4
# A found value farther than this from the exact one is not its rounding.
_ROUNDING = 1e-6
_DENOMINATOR = 10_000


def exact_certificates(
    singular: SingularSet, exact: RationalLines, ids: tuple[int, ...], enclosures: Sequence[Certificate]
) -> list[Certificate]:
    """Return what exact arithmetic proves of a singular set of three or more different lines.

    Args:
        singular: The set, not singular everywhere.
        exact: The different lines.
        ids: Their ids.
        enclosures: Certificates of the found isolated points of four lines.
    """
    proofs = [_transversals(singular, exact, ids)]
    if len(ids) == 3:
        return proofs + _surfaces(singular, exact, ids)
    if len(ids) == 4:
        return [*proofs, _ten_points(singular, exact, ids, enclosures)]
    return proofs + _surviving_points(singular, exact, ids)


def everywhere_certificate(exact: RationalLines, ids: tuple[int, ...]) -> Certificate:
    """Return a proof that different lines are singular at every camera centre."""
    name = "singular everywhere"
    if len(ids) < 3:
        return Certificate(name, True, 0.0, ids, "Exact: two degrees of freedom for each of fewer than three lines.")
    if exact_family(exact.points, exact.directions) is TransversalFamily.EVERYWHERE:
        return Certificate(name, True, 0.0, ids, "Exact: a line through every point meets all lines.")
    return _failed(name, ids, "the lines are neither parallel nor concurrent, only to rounding")


def _is_observed(line: Array, frame: SceneFrame) -> bool:
    direction = line[:3] / np.linalg.norm(line[:3])
    foot = np.cross(direction, line[3:] / np.linalg.norm(line[:3]))
    return len(observed_rows(frame, foot[np.newaxis], direction[np.newaxis])) > 0


def _transversals(singular: SingularSet, exact: RationalLines, ids: tuple[int, ...]) -> Certificate:
    name = "what meets all lines"
    family = exact_family(exact.points, exact.directions)
    if family is not singular.family:
        return _failed(name, ids, f"{family} in exact arithmetic, but {singular.family} to rounding")
    single = exact_transversals(exact.points, exact.directions).lines if singular.transversals else ()
    # Lines at infinity and observed ones are not among the found ones.
    vectors = [line for line in (_in_scene(line, singular.frame) for line in single) if line is not None]
    vectors = [line for line in vectors if not _is_observed(line, singular.frame)]
    if len(vectors) != len(singular.transversals):
        if singular.transversals and not single:
            return Certificate(name, True, float("inf"), ids, f"Exact: {family}; the line itself was not computed.")
        return _failed(name, ids, f"exact arithmetic gives {len(vectors)} finite lines")
    radius = 0.0
    for transversal in singular.transversals:
        foot = singular.frame.to_scene(transversal.point)
        own = np.array([*transversal.direction, *np.cross(foot, transversal.direction)])
        own /= np.linalg.norm(own)
        radius = max(radius, min(float(min(np.abs(v - own).max(), np.abs(v + own).max())) for v in vectors))
    if radius > _ROUNDING:
        return _failed(name, ids, f"a found transversal is {radius:.1e} from the exact one")
    return Certificate(name, True, 2.5 * radius + 1e-15, ids, f"Exact, for all {len(ids)} lines: {family}.")


def _in_scene(line: tuple[Any, ...], frame: SceneFrame) -> Array | None:
    """Return an exact line (d, m) rounded to a unit vector in scene coordinates; None if it is at infinity."""
    import sympy

    center = [sympy.Rational(*value.as_integer_ratio()) for value in frame.center.tolist()]
    d, m = sympy.Matrix(line[:3]), sympy.Matrix(line[3:])
    if all(sympy.simplify(value) == 0 for value in d):
        return None
    moment = (m - sympy.Matrix(center).cross(d)) / sympy.Rational(*frame.length.as_integer_ratio())
    vector = np.array([float(sympy.N(value, 40)) for value in (*d, *moment)])
    unit: Array = vector / np.linalg.norm(vector)
    return unit


def _surfaces(singular: SingularSet, exact: RationalLines, ids: tuple[int, ...]) -> list[Certificate]:
    proofs = []
    quadric, cubic = exact_surfaces(exact.points, exact.directions)
    for surface in singular.surfaces:
        if surface.kind is Kind.PLANE:
            continue
        polynomial = quadric if surface.kind is Kind.QUADRIC else cubic
        true = [Fraction(int(c.numerator), int(c.denominator)) for c in _coefficients(polynomial, surface.exponents)]
        own = [Fraction(value) for value in surface.coefficients.tolist()]
        largest = max(range(len(true)), key=lambda i: abs(true[i]))
        if true[largest] == 0 or own[largest] == 0:
            proofs.append(_failed(surface.name, ids, "its exact polynomial is zero"))
            continue
        factor = true[largest] / own[largest]
        error = max(abs(float(t - factor * o)) for t, o in zip(true, own, strict=True)) / abs(float(true[largest]))
        if error > _ROUNDING:
            proofs.append(_failed(surface.name, ids, f"a coefficient differs by {error:.1e} from the exact one"))
        else:
            text = (
                "Up to a factor, no coefficient differs by more than the radius from the exact one, over the largest."
            )
            proofs.append(Certificate(surface.name, True, error, ids, text))
    return proofs


def _coefficients(polynomial: dict[Any, Any], exponents: Sequence[tuple[int, int, int]]) -> list[Any]:
    from sympy import QQ

    return [polynomial.get(e, QQ(0)) for e in exponents]


def _ten_points(
    singular: SingularSet, exact: RationalLines, ids: tuple[int, ...], enclosures: Sequence[Certificate]
) -> Certificate:
    name = "all isolated points"
    count = exact_point_count(exact.points, exact.directions)
    if count is None:
        return _failed(name, ids, "the scene is special: there are not ten different axis directions")
    real, total = len(singular.isolated_points), len(singular.isolated_points_complex)
    if (real, total) != (count.real, count.distinct):
        return _failed(
            name,
            ids,
            f"there are {count.distinct} axis directions, {count.real} of them real, but {total} points were found, "
            f"{real} of them real; in a special scene some directions belong to no point",
        )
    points = singular.isolated_points_complex
    radius = max((proof.radius for proof in enclosures), default=float("inf"))
    apart = min(float(np.abs(points[i] - points[j]).max()) for i, j in combinations(range(total), 2))
    if not (all(proof.proved for proof in enclosures) and apart > 2.0 * radius):
        return _failed(name, ids, "not every found point is enclosed apart from the others")
    text = f"Exactly ten isolated points, {count.real} of them real; each found one is within the radius of another."
    return Certificate(name, True, radius, ids, text)


def _surviving_points(singular: SingularSet, exact: RationalLines, ids: tuple[int, ...]) -> list[Certificate]:
    proofs = []
    for i in range(len(singular.isolated_points)):
        name = f"isolated point {i + 1}"
        center = [Fraction(float(singular.isolated_points[i, axis])) for axis in range(3)]
        rational = [value.limit_denominator(_DENOMINATOR) for value in center]
        radius = math.hypot(*(float(c - r) for c, r in zip(center, rational, strict=True)))
        if radius <= _ROUNDING * singular.frame.length and exact_rank(exact.points, exact.directions, rational) < 6:
            text = f"All {len(ids)} lines lose rank at the rational point ({', '.join(map(str, rational))})."
            proofs.append(Certificate(name, True, radius, ids, text))
        else:
            proofs.append(_failed(name, ids, "it is not a point with small rational coordinates"))
    return [*proofs, _no_others(singular, exact, ids)]


def _no_others(singular: SingularSet, exact: RationalLines, ids: tuple[int, ...]) -> Certificate:
    name = "all isolated points"
    common: Any = None
    total = len(singular.isolated_points_complex)
    for rows in best_subsets(singular.frame)[:_SUBSETS]:
        four = exact.select(rows.tolist())
        polynomial = axis_polynomial(four.points, four.directions)
        if polynomial is None:
            continue
        common = polynomial if common is None else common.gcd(polynomial)
        if common.degree() == total:
            text = "Off the transversals of all lines no camera loses a motion" if total == 0 else "There are no others"
            return Certificate(name, True, 0.0, ids, f"{text}: four-line subsets share {total} axis directions.")
    return _failed(name, ids, "the axis directions that four-line subsets share are more, or the subsets are special")


def _failed(name: str, ids: tuple[int, ...], why: str) -> Certificate:
    return Certificate(name, False, float("inf"), ids, f"Not proved: {why}.")
