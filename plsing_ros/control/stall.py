# SPDX-License-Identifier: Apache-2.0
"""Whether a servo run has come to rest away from its target."""

from __future__ import annotations

_SECOND = 1_000_000_000


class StallWatch:
    """Notices a twist that changes almost nothing although the error is large, for some time."""

    def __init__(self) -> None:
        self._since: int | None = None

    def clear(self) -> None:
        """Start anew."""
        self._since = None

    def stalled_for(self, ratio: float, error: float, min_ratio: float, min_error: float, stamp: int) -> float | None:
        """Return for how long the run has stalled [s], or None if it has not.

        Args:
            ratio: How fast the twist can change the image, over what the gain asks for.
            error: |s - s*|.
            min_ratio: A ratio below this is a stall.
            min_error: An error up to this is none.
            stamp: Of the observation [ns].
        """
        if ratio >= min_ratio or error <= min_error:
            self._since = None
            return None
        if self._since is None or stamp < self._since:
            self._since = stamp
        return (stamp - self._since) / _SECOND
