# SPDX-License-Identifier: Apache-2.0
"""Appendix A and B, the table of cases, and the scenes with orthogonal and parallel lines, as tables."""

from __future__ import annotations

import numpy as np

from paper.scenes import (
    GENERIC_D7,
    PRINTED_L_M,
    PRINTED_L_N,
    SPECIAL_D7,
    TABLE_OF_POINTS,
    five_lines,
    four_lines,
    orthogonal_and_parallel_lines,
    plucker,
)
from paper.special_scenes import agrees, case_examples, special_orthogonal_scenes
from paper.tables import markdown_table, vector_text, yes
from plsing_ros.arrays import Array
from plsing_ros.singularities import IsolatedStatus, Kind, SingularSet, singular_set

# Half a unit of the last printed digit of the table's coordinates, and of the transversals'.
_ROUNDING_OF_POINTS, _ROUNDING_OF_LINES = 1e-3, 6e-5

# For far points the paper prints fewer decimals.
_ROUNDING_OF_FAR_POINTS, _FAR = 0.06, 10.0


def appendix_sections() -> str:
    """Return the sections in Markdown; a few milliseconds of computing."""
    singular = singular_set(four_lines())
    return "\n\n".join([_appendix_a(singular), _appendix_b(), _cases(), _orthogonal_and_parallel()])


def _appendix_a(singular: SingularSet) -> str:
    lines = []
    for name, printed in (("L_M", PRINTED_L_M), ("L_N", PRINTED_L_N)):
        ours, difference = _nearest_transversal(singular, np.array(printed))
        lines.append(
            [name, vector_text(printed), vector_text(ours), _size(difference), yes(difference <= _ROUNDING_OF_LINES)]
        )
    points = [
        _row_of_point(singular, number, starred, np.array(row))
        for number, (starred, row) in enumerate(TABLE_OF_POINTS, start=1)
    ]
    complex_points, real_points = len(singular.isolated_points_complex), len(singular.isolated_points)
    return "\n\n".join(
        [
            "### Appendix A: the four lines",
            f"*{singular.description}* The transversals, as (u, u × x):",
            markdown_table(["line", "printed", "computed", "largest difference", "agrees"], lines),
            f"The paper finds 10 complex isolated points, 6 of them real; we find {complex_points} and {real_points}. "
            "Its table of the 16 real points of V(H) ∩ V(K), of which those with an asterisk are isolated "
            "singularities and the others must be on an observed line or a transversal. Last column: whether the "
            "difference is within the rounding of the printed digits.",
            markdown_table(
                ["paper's row", "printed [m]", "what is there", "at [m]", "difference [m]", "agrees"], points
            ),
            "The ideals of this appendix, their factors with √448189 and the degrees are checked exactly, with "
            "computer algebra, in `test/singularities/test_paper_p3l_p4l.py`.",
        ]
    )


def _nearest_transversal(singular: SingularSet, printed: Array) -> tuple[Array, float]:
    best: tuple[Array, float] | None = None
    for transversal in singular.transversals:
        ours = plucker(transversal.point, transversal.direction)
        ours = ours * np.sign(ours[:3] @ printed[:3])
        difference = float(np.abs(ours - printed).max())
        if best is None or difference < best[1]:
            best = ours, difference
    assert best is not None
    return best


def _row_of_point(singular: SingularSet, number: int, starred: bool, printed: Array) -> list[str]:
    allowed = (Kind.ISOLATED_POINT,) if starred else (Kind.TRANSVERSAL, Kind.OBSERVED_LINE)
    nearest = next(each for each in singular.distances(printed) if each.kind in allowed)
    difference = float(np.abs(nearest.closest_point - printed).max())
    rounding = _ROUNDING_OF_FAR_POINTS if np.abs(printed).max() > _FAR else _ROUNDING_OF_POINTS
    return [
        ("\\*" if starred else "") + str(number),
        vector_text(printed, 3),
        nearest.name,
        vector_text(nearest.closest_point),
        _size(difference),
        yes(difference <= 1.5 * rounding),
    ]


def _appendix_b() -> str:
    generic, special = singular_set(five_lines(GENERIC_D7)), singular_set(five_lines())
    difference = _nearest_transversal(special, np.array(PRINTED_L_M))[1]
    rows = [
        [
            f"d7 = {GENERIC_D7:g}",
            "V(G) is empty; no singularities",
            _content(generic),
            yes(not generic.transversals and not len(generic.isolated_points_complex)),
        ],
        [
            f"d7 = {SPECIAL_D7:.6f} (closed form; the paper prints 7.7178 beside it)",
            "one line, L_M; no isolated points",
            f"{_content(special)}; it differs from the printed L_M by {_size(difference)}",
            yes(
                len(special.transversals) == 1
                and difference <= _ROUNDING_OF_LINES
                and special.isolated_status is IsolatedStatus.NONE
            ),
        ],
    ]
    return "\n\n".join(
        ["### Appendix B: the five lines", markdown_table(["parameters", "the paper", "computed", "agrees"], rows)]
    )


def _cases() -> str:
    rows = []
    for example in case_examples():
        singular = singular_set(example.lines)
        rows.append(
            [
                example.row,
                example.scene,
                str(singular.case).split(":")[0],
                _content(singular),
                yes(agrees(example, singular)),
            ]
        )
    return "\n\n".join(
        [
            "### The table of cases",
            "Each row of table *cases* with a scene of its kind, classified and solved:",
            markdown_table(["the paper's row", "scene", "classified as", "found", "agrees"], rows),
        ]
    )


def _orthogonal_and_parallel() -> str:
    rows = []
    for what, d, on_line, direction in special_orthogonal_scenes():
        singular = singular_set(orthogonal_and_parallel_lines(d))
        off = min(
            (
                float(np.linalg.norm(np.cross(np.array(on_line) - transversal.point, transversal.direction)))
                + float(np.linalg.norm(np.cross(direction, transversal.direction)) / np.linalg.norm(direction))
                for transversal in singular.transversals
            ),
            default=np.inf,
        )
        holds = len(singular.isolated_points) == 0 and off < 1e-9
        rows.append([what, vector_text(d, 2), _content(singular), _size(off), yes(holds)])
    return "\n\n".join(
        [
            "### Orthogonal and parallel lines",
            "The paper's closed forms of the transversals (eq. *transversal_special*, M1, M2, M3), against the nearest "
            "transversal computed; the difference is that of position [m] plus sine of the angle:",
            markdown_table(["the paper's line", "d1, d2, ... [m]", "found", "difference", "agrees"], rows),
            "For the special case of five lines with *a point*, the paper gives 36 conditions and no example; we have "
            "none either. That its candidate point is a zero of all ten cubics, and that it is not singular for "
            "parameters in general, is tested in `test/singularities/test_paper_p5l.py`.",
        ]
    )


def _content(singular: SingularSet) -> str:
    parts = [f"{len(singular.transversals)} transversal{'' if len(singular.transversals) == 1 else 's'}"]
    parts += [surface.name for surface in singular.surfaces]
    if singular.isolated_status is IsolatedStatus.FINITE:
        parts.append(f"{len(singular.isolated_points_complex)} isolated points, {len(singular.isolated_points)} real")
    elif singular.isolated_status is not IsolatedStatus.SURFACES:
        parts.append(str(singular.isolated_status.value))
    return ", ".join(parts)


def _size(difference: float) -> str:
    """Return a difference so that rounding errors look the same on every machine."""
    return "below 1e-9" if difference < 1e-9 else f"{difference:.0e}"
