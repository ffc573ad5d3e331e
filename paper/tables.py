# SPDX-License-Identifier: Apache-2.0
"""Tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt


def markdown_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table; a bar inside a cell is escaped."""
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def yes(holds: bool) -> str:
    """Return "yes" or, so that it is not overlooked, a bold "no"."""
    return "yes" if holds else "**no**"


def vector_text(values: npt.ArrayLike, digits: int = 4) -> str:
    """Return numbers in brackets with so many decimals; what rounds to zero has no sign."""
    rounded = np.round(np.asarray(values, dtype=float), digits) + 0.0
    return "(" + ", ".join(f"{value:.{digits}f}" for value in rounded) + ")"
