# SPDX-License-Identifier: Apache-2.0
"""Line features as the fields of a message, wherever the message comes from: a topic or a recording."""

from __future__ import annotations

from typing import Any

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.errors import ObservationError
from plsing_ros.features.observation import LineObservation, LinesVerdict

_MAX_CHARACTERS = 300
# Looked up in a third of an enumeration's time.
_VERDICTS = {int(each): each for each in LinesVerdict}


def observation_from_message(message: Any, frame: str) -> LineObservation:
    """Return the observation that a plsing_msgs/LineFeatureArray in the given frame carries.

    Args:
        message: With the fields of the message; arrays of numbers as ROS or a recording gives them.
        frame: Name of the camera's optical frame.

    Raises:
        ObservationError: If the frame is another one, lengths do not fit, a value is not finite, or ids repeat.
    """
    if message.header.frame_id != frame:
        raise ObservationError(
            f"line features are in frame '{sender_text(message.header.frame_id)}', "
            f"expected '{frame}' (parameter camera_frame)"
        )
    n = len(message.ids)
    if n == 0:
        raise ObservationError("the feature message has no lines")
    # Recordings made before lines had covariances and ends are read, too.
    covariances, ends = getattr(message, "covariances", ()), getattr(message, "ends", ())
    for name, values, width in (("covariances", covariances, 3), ("ends", ends, 4)):
        if len(values) not in (0, width * n):
            raise ObservationError(
                f"field '{name}' of the feature message has {len(values)} numbers for {n} lines; "
                f"expected 0 or {width * n}"
            )
    for name, allowed in (
        ("image_lines", (3 * n,)),
        ("directions", (0, 3 * n)),
        ("moments", (len(message.directions),)),
        ("visible", (0, n)),
    ):
        if len(getattr(message, name)) not in allowed:
            raise ObservationError(
                f"field '{name}' of the feature message has {len(getattr(message, name))} numbers for {n} lines; "
                f"expected {' or '.join(map(str, allowed))}"
            )
    verdict = _VERDICTS.get(message.lines_verdict)
    if verdict is None:
        raise ObservationError(
            f"field 'lines_verdict' of the feature message is {message.lines_verdict}; allowed: 0 to "
            f"{max(LinesVerdict)}"
        )
    given = verdict is LinesVerdict.GIVEN
    return LineObservation.from_rows(
        tuple(message.ids),
        np.frombuffer(message.image_lines).reshape(-1, 3),
        _rows(message.directions),
        _rows(message.moments),
        np.array(message.visible, dtype=bool) if len(message.visible) else np.ones(n, dtype=bool),
        frame,
        _rows(covariances),
        verdict,
        "" if given else sender_text(message.lines_reason),
        "" if given else getattr(message, "lines_source", ""),
        _rows(ends, 4),
    )


def sender_text(text: str) -> str:
    """Return what somebody else has sent, fit for a reason: without control characters, of at most 300 characters."""
    shown = "".join(each if each.isprintable() else " " for each in text[:_MAX_CHARACTERS])
    return shown if len(text) <= _MAX_CHARACTERS else f"{shown[:-3]}..."


def _rows(values: Any, width: int = 3) -> Array | None:
    return np.frombuffer(values).reshape(-1, width) if len(values) else None
