# SPDX-License-Identifier: Apache-2.0
"""Decompositions of single small matrices by LAPACK itself, whose wrappers in numpy take longer."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dgesdd

from plsing_ros.arrays import Array


def right_singular_vectors(matrix: Array) -> tuple[Array, Array]:
    """Return the singular values of a matrix (m, n), and all its right singular vectors as rows (n, n)."""
    _, values, right, info = dgesdd(matrix)
    if info != 0:
        _, values, right = np.linalg.svd(matrix)
    return values, right
