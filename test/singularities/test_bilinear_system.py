# SPDX-License-Identifier: Apache-2.0
"""Newton's method on A(h) k = 0 finds zeros back that are known."""

import numpy as np
import pytest
from hypothesis import given
from strategies import numbers, vectors

from plsing_ros.singularities.bilinear_system import bilinear_tensor, newton

FIRST = np.zeros(1, dtype=int)


@given(offset=vectors(10, -1.0, 1.0), turn=numbers(0.0, 6.0))
def test_newton_finds_a_zero_back(offset, turn):
    parts = np.random.default_rng(1).normal(size=(2, 4 * 8 * 6 + 4 + 6))
    tensor, h, k = np.split(parts[0] + 1j * parts[1], [192, 196])
    h, k = h / np.linalg.norm(h), k / np.linalg.norm(k)
    tensor = tensor.reshape(1, 4, 8, 6)
    value = np.einsum("a,aij,j->i", h, tensor[0], k)
    tensor = tensor - np.einsum("a,i,j->aij", h.conj(), value, k.conj())
    start = 1e-2 * np.exp(1j * turn) * offset
    x, y = newton(tensor, FIRST, (h + start[:4])[np.newaxis], (k + start[4:])[np.newaxis])
    # Zeros have any phase.
    assert abs(x[0] @ h.conj()) == pytest.approx(1.0, rel=1e-12)
    assert abs(y[0] @ k.conj()) == pytest.approx(1.0, rel=1e-12)
    np.testing.assert_allclose(np.einsum("a,aij,j->i", x[0], tensor[0], y[0]), 0.0, atol=1e-12)


def test_newton_stays_where_the_jacobian_is_singular():
    h, k = newton(np.zeros((1, 4, 8, 6)), FIRST, np.eye(4)[:1], np.eye(6)[:1])
    np.testing.assert_array_equal([h[0, 0], k[0, 0]], 1.0)


def test_newton_of_more_lines():
    direction, point = np.random.default_rng(11).normal(size=(2, 1, 6, 3))
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    transversal = np.array([0.3, -0.5, 0.8])
    point[0] = transversal * np.arange(1.0, 7.0)[:, np.newaxis]
    tensor = bilinear_tensor(direction, point - (point * direction).sum(axis=2, keepdims=True) * direction)
    # The centre half a length along the line that meets all six loses the translation along it.
    h, k = np.array([[1.0, *(0.5 * transversal)]]), np.array([[*transversal, 0.0, 0.0, 0.0]])
    h, k = h / np.linalg.norm(h), k / np.linalg.norm(k)
    np.testing.assert_allclose(np.einsum("a,aij,j->i", h[0], tensor[0], k[0]), 0.0, atol=1e-14)
    x, y = newton(tensor, FIRST, h + 1e-3, k - 1e-3)
    np.testing.assert_allclose(np.einsum("a,aij,j->i", x[0], tensor[0], y[0]), 0.0, atol=1e-12)
