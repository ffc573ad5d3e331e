# SPDX-License-Identifier: Apache-2.0
"""Homogeneous polynomials in three variables, in the scaled monomial basis that a rotation leaves orthonormal."""

from __future__ import annotations

import math

import numpy as np

from plsing_ros.arrays import Array


def exponents(degree: int) -> list[tuple[int, int, int]]:
    """Return the exponents (a, b, c), a + b + c = degree, of the (degree + 1)(degree + 2) / 2 monomials."""
    return [(a, b, degree - a - b) for a in range(degree, -1, -1) for b in range(degree - a, -1, -1)]


def basis_values(degree: int, w: Array) -> Array:
    """Return sqrt(degree! / (a! b! c!)) x^a y^b z^c at points w (k, 3), shape (k, number of monomials).

    The row of a unit vector has unit length, whatever the degree.
    """
    columns = [_weight(e) * w[:, 0] ** e[0] * w[:, 1] ** e[1] * w[:, 2] ** e[2] for e in exponents(degree)]
    return np.stack(columns, axis=1)


def multiplication_maps(degree: int) -> Array:
    """Return S, shape (3, size of degree - 1, size of degree), with S[a] @ basis(w) = w_a basis_of_degree-1(w)."""
    high = {e: column for column, e in enumerate(exponents(degree))}
    low = exponents(degree - 1)
    maps = np.zeros((3, len(low), len(high)))
    for row, e in enumerate(low):
        for variable in range(3):
            raised = (e[0] + (variable == 0), e[1] + (variable == 1), e[2] + (variable == 2))
            maps[variable, row, high[raised]] = _weight(e) / _weight(raised)
    return maps


def half_sphere_points(count: int) -> Array:
    """Return count unit vectors spread evenly over a half sphere that is in no special position, shape (count, 3).

    Values there determine a form of a degree with at most count monomials, with a condition number of 7.5 for the 15
    monomials of degree 4.
    """
    index = np.arange(count) + 0.5
    z = 1.0 - index / count
    angle = math.pi * (1.0 + math.sqrt(5.0)) * index
    radius = np.sqrt(1.0 - z * z)
    spiral = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    # Any rotation will do; this one keeps the poles and the equator away from the axes, where real scenes have lines.
    rotation, _ = np.linalg.qr(np.array([[0.35, 0.82, -1.30], [0.91, 0.45, -0.54], [0.58, 0.36, 0.29]]))
    points: Array = spiral @ rotation.T
    return points


def _weight(e: tuple[int, int, int]) -> float:
    return math.sqrt(math.factorial(sum(e)) / math.prod(math.factorial(k) for k in e))
