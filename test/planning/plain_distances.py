# SPDX-License-Identifier: Apache-2.0
"""Distances to singular loci in plain numpy."""

import numpy as np


def distances(centers, found):
    """From centres (k, 3) to all transversals, isolated points and observed lines, one by one."""
    single = [(t.point, t.direction) for t in found.transversals]
    observed = list(zip(found.lines.point, found.lines.direction, strict=True))
    to_lines = [np.linalg.norm(np.cross(centers - point, direction), axis=1) for point, direction in single + observed]
    to_points = [np.linalg.norm(centers - point, axis=1) for point in found.isolated_points]
    return np.array(to_lines + to_points).T
