# SPDX-License-Identifier: Apache-2.0
"""How large the errors of image and pose are, as the image shows them, and by how much a pose is to be doubted."""

from __future__ import annotations

import math

import numpy as np

from plsing_ros.arrays import Array

# A share of each frame in what is known of the errors: twenty frames or so are remembered.
_MEMORY = 0.05
# A pose is doubted when the image explains more than this times what its covariance allows.
DOUBTFUL = 2.0
# More at first, for chance averages out with the root of the frames: less than one in a million is more than this.
_AT_FIRST = 4.0
# What is left of a doubt after a frame that shows nothing of it: hundreds of frames until a pose is trusted again.
_TRUST_AGAIN = 0.002
_NO_DOUBT = 0.05
# Degrees of freedom of a pose.
OF_A_POSE = 6
# What is said of lasting errors of the image counts as much as so many degrees of freedom that the image shows.
_SAID = 1.0


class PoseDoubt:
    """What was seen lately of the errors.

    Attributes:
        noise: Variance of the image's errors over what is said, at least 1.
        calibration: The same of those that last, which may be smaller than is said.
    """

    def __init__(self) -> None:
        self.noise, self.calibration = 1.0, 1.0
        # Over what the covariance of the pose allows.
        self._explained, self._frames = 1.0, 0
        # Not forgotten where the image shows less of it.
        self._doubt = 0.0

    def update(self, rows: Array, pose: Array) -> float:
        """Learn from a frame, and return by how much more than its covariance allows the pose is off; 0 if it is not.

        What the best pose leaves of r speaks against the image, what a pose explains beyond its covariance against it.

        Args:
            rows: J and r of the mismatch, whitened by what is said of the image, shape (2n, 7).
            pose: Covariance of what a pose may explain, shape (6, 6).

        Source: new, docs/pose_laws.md.
        """
        J, r = rows[:, :6], rows[:, 6]
        normal, right, square = J.T @ J, J.T @ r, float(r @ r)
        known = np.linalg.inv(pose)
        left = square - float(right @ np.linalg.solve(normal + 1e-6 * known, right))
        explained = square - float(right @ np.linalg.solve(normal + known, right)) - left
        seen = left / max(len(r) - OF_A_POSE, 1.0)
        self.noise = max(1.0, self.noise + _MEMORY * (seen - self.noise))
        self._frames += 1
        # The mean of the first frames, then of the latest.
        share = max(_MEMORY, 1.0 / self._frames)
        self.calibration += share * ((_SAID + left) / (_SAID + max(len(r) - OF_A_POSE, 0.0)) - self.calibration)
        self._explained += share * (explained / (OF_A_POSE * self.noise) - self._explained)
        excess = self._explained - DOUBTFUL - _AT_FIRST / math.sqrt(self._frames)
        self._doubt = max(0.0, excess, self._doubt * (1.0 - _TRUST_AGAIN))
        return self._doubt if self._doubt > _NO_DOUBT else 0.0
