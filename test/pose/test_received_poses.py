# SPDX-License-Identifier: Apache-2.0
import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import numbers, vectors

from plsing_ros.pose.received_poses import covariance_or_none


@given(vectors(36, -1.0, 1.0), st.sampled_from([0.0, 1.0]), numbers(-1.0, 1.0))
def test_a_covariance_is_told_by_its_smallest_eigenvalue(values, square, lift):
    matrix = np.reshape(values, (6, 6))
    matrix = square * (matrix @ matrix.T) + (1.0 - square) * matrix + lift * np.eye(6)
    symmetric = 0.5 * (matrix + matrix.T)
    smallest = np.linalg.eigvalsh(symmetric)[0]
    assume(abs(smallest + 1e-9) > 1e-10)
    found = covariance_or_none(matrix)
    if smallest < -1e-9 or not symmetric.any():
        assert found is None
    else:
        np.testing.assert_array_equal(found, symmetric)
    matrix[2, 3] = np.nan
    assert covariance_or_none(matrix) is None
