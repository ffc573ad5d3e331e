"""What is proved of a singular set, and which lines the proofs are about."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from plsing_ros.geometry import LineSet
from plsing_ros.singularities.certificate import Certificate, certify_isolated_point, certify_transversal
from plsing_ros.singularities.exact_certificate import everywhere_certificate, exact_certificates
from plsing_ros.singularities.many_lines import best_subsets
from plsing_ros.singularities.rational_lines import RationalLines, rational_lines
from plsing_ros.singularities.scene_frame import SceneFrame

if TYPE_CHECKING:
    from plsing_ros.singularities.singular_set import SingularSet

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


def proofs_about(found: SingularSet, distinct: LineSet) -> tuple[tuple[Certificate, ...], str]:
    """Return certificates for what is in a singular set of different lines, and what they prove as a sentence."""
    exact = rational_lines(distinct)
    certification = _INTERVALS if exact is None else _EXACT
    if found.singular_everywhere:
        return () if exact is None else (everywhere_certificate(exact, distinct.ids),), certification
    enclosures = _enclosures(found, distinct, exact)
    proofs = list(enclosures)
    if exact is not None:
        of_points = enclosures[len(found.transversals) :]
        proofs += exact_certificates(found, exact, distinct.ids, of_points)
    return tuple(proofs), certification


def _enclosures(found: SingularSet, distinct: LineSet, exact: RationalLines | None) -> list[Certificate]:
    """Return proofs in interval arithmetic for the transversals, real points and pairs of complex points."""
    n = len(distinct)
    if n < 4:
        return []
    subsets = best_subsets(found.frame)[:_CERTIFIED_SUBSETS] if n > 4 else np.arange(4)[np.newaxis]
    fours = []
    for rows in subsets:
        four = distinct.select(rows)
        fours.append((four, SceneFrame.of(four), None if exact is None else exact.select(rows.tolist())))
    proofs = [
        _first_proved(certify_transversal(four, frame, t.point, t.direction, t.name, own) for four, frame, own in fours)
        for t in found.transversals
    ]
    for i in range(len(found.isolated_points_complex)):
        center = found.isolated_points_complex[i, :]
        if i < len(found.isolated_points):
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
