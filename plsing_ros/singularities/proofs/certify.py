# SPDX-License-Identifier: Apache-2.0
"""What is proved of a singular set, and which lines the proofs are about.

Interval arithmetic (mpmath): Krawczyk's operator for each transversal and each simple isolated point. A true one lies
within the stated radius, is the only one in its box, and is real if the found one is. For five and more lines it is
about four of them, whose ids the certificate names.

Exact arithmetic (sympy over the rationals), about all lines together:

- What meets all lines, singular everywhere: rank and signature. Three lines: the quadric and the cubic.
- Four lines: the quotient ring of the five quartics has dimension ten and a characteristic polynomial without multiple
  roots, so there are at most ten; with ten disjoint boxes of Krawczyk's test all are found. Sturm's theorem counts the
  real ones.
- Five and more lines: a point with rational coordinates by the exact rank of xi there. An unobservable screw has an
  axis direction among the zeros of the quartics of each four, so the greatest common divisor of the characteristic
  polynomials of up to four subsets bounds the number of others; for general lines it is 1.

Not proved: curves, isolated points of special scenes as a whole, points of five and more lines that are not rational,
and lines with integers above 10^6.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from plsing_ros.geometry import LineSet
from plsing_ros.singularities.degenerate_scenes import distinct_rows
from plsing_ros.singularities.many_lines import best_subsets
from plsing_ros.singularities.proofs.exact_certificates import everywhere_certificate, exact_certificates
from plsing_ros.singularities.proofs.interval import Certificate, certify_isolated_point, certify_transversal
from plsing_ros.singularities.proofs.rational_lines import RationalLines, rational_lines
from plsing_ros.singularities.scene_frame import SceneFrame
from plsing_ros.singularities.singular_centers import SingularSet

# Four-line subsets of more lines that are tried for a proof; a point can be a singular solution for some of them.
_CERTIFIED_SUBSETS = 3
_INTERVALS = (
    "The lines are taken as exactly the given doubles. Each certificate that is proved encloses one true transversal "
    "or isolated point of the four lines it names. That other lines agree, that there are no other points, and "
    "surfaces are not proved: for this the lines must have small rational coordinates."
)
_EXACT = (
    "The given doubles are lines with small rational coordinates, rounded; all proofs are about these rational lines. "
    "Those in interval arithmetic enclose one true transversal or isolated point of the four lines they name, the "
    "others are exact and about all lines."
)


class Proofs(NamedTuple):
    """What is proved of a singular set.

    Attributes:
        certificates: One for each transversal, real point and conjugate pair, then the exact ones.
        statement: What they prove and what they do not, as a sentence.
    """

    certificates: tuple[Certificate, ...]
    statement: str


def certify(singular: SingularSet) -> Proofs:
    """Prove, in interval arithmetic, that a true transversal or isolated point is near each one of a singular set.

    For more than four distinct lines the proofs are about four of them (Certificate.lines). If all coordinates are
    rational with small numbers (rational_lines), what meets all lines, that there are no other isolated points, and
    the polynomials of surfaces are proved in exact arithmetic too. Takes about a second for four lines, a few for
    integers of four digits or many lines; needs mpmath and sympy.
    """
    distinct = singular.lines.select(distinct_rows(SceneFrame.of(singular.lines)))
    exact = rational_lines(distinct)
    certification = _INTERVALS if exact is None else _EXACT
    if singular.singular_everywhere:
        return Proofs(() if exact is None else (everywhere_certificate(exact, distinct.ids),), certification)
    enclosures = _enclosures(singular, distinct, exact)
    proofs = list(enclosures)
    if exact is not None:
        of_points = enclosures[len(singular.transversals) :]
        proofs += exact_certificates(singular, exact, distinct.ids, of_points)
    return Proofs(tuple(proofs), certification)


def _enclosures(singular: SingularSet, distinct: LineSet, exact: RationalLines | None) -> list[Certificate]:
    """Return proofs in interval arithmetic for the transversals, real points and pairs of complex points."""
    n = len(distinct)
    if n < 4:
        return []
    subsets = best_subsets(singular.frame)[:_CERTIFIED_SUBSETS] if n > 4 else np.arange(4)[np.newaxis]
    fours = []
    for rows in subsets:
        four = distinct.select(rows)
        fours.append((four, SceneFrame.of(four), None if exact is None else exact.select(rows.tolist())))
    proofs = [
        _first_proved(certify_transversal(four, frame, t.point, t.direction, t.name, own) for four, frame, own in fours)
        for t in singular.transversals
    ]
    for i in range(len(singular.isolated_points_complex)):
        center = singular.isolated_points_complex[i, :]
        if i < len(singular.isolated_points):
            name = f"isolated point {i + 1}"
        elif center[np.argmax(np.abs(center.imag))].imag > 0.0:
            name = f"complex point {i + 1} and its conjugate"
        else:
            continue
        proofs.append(
            _first_proved(certify_isolated_point(four, frame, center, name, own) for four, frame, own in fours)
        )
    return proofs


def _first_proved(attempts: Iterable[Certificate]) -> Certificate:
    """Return the first success, or the last failure."""
    for attempt in attempts:
        if attempt.proved:
            break
    return attempt
