# SPDX-License-Identifier: Apache-2.0
"""Rows of a message that are good, as nearly all are: checked at once, and not value by value."""

from __future__ import annotations

from itertools import compress

import numpy as np

from plsing_ros import _core
from plsing_ros.arrays import Array, BoolArray
from plsing_ros.features.observation import NORM_TOLERANCE, LineObservation, LinesVerdict
from plsing_ros.features.projection import DEGENERATE_DEPTH
from plsing_ros.geometry import LineSet
from plsing_ros.geometry.line_set import LINE_TOLERANCE

_NO_COVARIANCES, _NO_ENDS = np.zeros((0, 3)), np.zeros((0, 4))


def observation_of_good_rows(
    ids: tuple[int, ...],
    image_lines: Array,
    directions: Array,
    moments: Array,
    visible: BoolArray,
    frame: str,
    covariances: Array | None,
    verdict: LinesVerdict,
    verdict_reason: str,
    lines_source: str,
    ends: Array | None,
) -> LineObservation | None:
    """Return what LineObservation.from_rows does of the same rows, or None where it has something to say about them.

    The arrays, C-contiguous floats of one row for each id, are copied.
    """
    if len(set(ids)) != len(ids):
        return None
    found = _core.good_features(
        image_lines,
        directions,
        moments,
        _NO_COVARIANCES if covariances is None else covariances,
        _NO_ENDS if ends is None else ends,
        visible,
        NORM_TOLERANCE,
        LINE_TOLERANCE,
        DEGENERATE_DEPTH,
    )
    if found is None:
        return None
    used_image, used_direction, used_moment, used_covariances = found
    usable_ids = tuple(compress(ids, visible.tolist()))
    image, usable = image_lines.copy(), visible.copy()
    known, segments = (None if each is None else each.copy() for each in (covariances, ends))
    for each in (image, usable, known, segments, *found):
        if each is not None:
            each.setflags(write=False)
    return LineObservation.unchecked(
        ids=ids,
        image_lines=image,
        usable=usable,
        lines_camera=LineSet.unchecked(used_direction, used_moment, frame, usable_ids),
        verdict=verdict,
        verdict_reason=verdict_reason,
        lines_source=lines_source,
        covariances=known,
        ends=segments,
        usable_ids=usable_ids,
        usable_image_lines=used_image,
        usable_covariances=None if known is None else used_covariances,
    )
