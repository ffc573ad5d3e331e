# SPDX-License-Identifier: Apache-2.0
"""Line features as the fields of a message, wherever the message comes from: a topic or a recording."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.errors import ObservationError
from plsing_ros.features.good_rows import observation_of_good_rows
from plsing_ros.features.observation import LineObservation, LinesVerdict

_MAX_CHARACTERS = 300
# Looked up in a third of an enumeration's time.
_VERDICTS = {int(each): each for each in LinesVerdict}


class LineFeatures(NamedTuple):
    """The fields of a plsing_msgs/LineFeatureArray in their order, without its stamp."""

    frame_id: str
    ids: Any
    image_lines: Any
    covariances: Any
    ends: Any
    directions: Any
    moments: Any
    visible: Any
    lines_source: str
    lines_verdict: int
    lines_reason: str


def observation_from_message(message: Any, frame: str) -> LineObservation:
    """Return the observation that a plsing_msgs/LineFeatureArray in the given frame carries.

    Args:
        message: With the fields of the message; arrays of numbers as ROS or a recording gives them.
        frame: Name of the camera's optical frame.

    Raises:
        ObservationError: If the frame is another one, lengths do not fit, a value is not finite, or ids repeat.
    """
    fields = LineFeatures(
        message.header.frame_id,
        message.ids,
        message.image_lines,
        # Recordings made before lines had covariances and ends are read, too.
        getattr(message, "covariances", ()),
        getattr(message, "ends", ()),
        message.directions,
        message.moments,
        message.visible,
        getattr(message, "lines_source", ""),
        message.lines_verdict,
        message.lines_reason,
    )
    return observation_from_fields(fields, frame)


def observation_from_fields(fields: LineFeatures, frame: str) -> LineObservation:
    """Return the observation that line features in the given frame carry; as observation_from_message."""
    given_frame, ids, image_lines, covariances, ends, directions, moments, visible, source, number, reason = fields
    if given_frame != frame:
        raise ObservationError(
            f"line features are in frame '{sender_text(given_frame)}', expected '{frame}' (parameter camera_frame)"
        )
    n = len(ids)
    if n == 0:
        raise ObservationError("the feature message has no lines")
    for name, values, allowed in (
        ("covariances", covariances, (0, 3 * n)),
        ("ends", ends, (0, 4 * n)),
        ("image_lines", image_lines, (3 * n,)),
        ("directions", directions, (0, 3 * n)),
        ("moments", moments, (len(directions),)),
        ("visible", visible, (0, n)),
    ):
        if len(values) not in allowed:
            raise ObservationError(
                f"field '{name}' of the feature message has {len(values)} numbers for {n} lines; "
                f"expected {' or '.join(map(str, allowed))}"
            )
    verdict = _VERDICTS.get(number)
    if verdict is None:
        raise ObservationError(
            f"field 'lines_verdict' of the feature message is {number}; allowed: 0 to {max(LinesVerdict)}"
        )
    given = verdict is LinesVerdict.GIVEN
    image, direction, moment = np.frombuffer(image_lines).reshape(-1, 3), _rows(directions), _rows(moments)
    usable = np.array(visible, dtype=bool) if len(visible) else np.ones(n, dtype=bool)
    said = verdict, "" if given else sender_text(reason), "" if given else source
    own_ids, known, segments = tuple(ids), _rows(covariances), _rows(ends, 4)
    if direction is not None and moment is not None:
        good = observation_of_good_rows(own_ids, image, direction, moment, usable, frame, known, *said, segments)
        if good is not None:
            return good
    return LineObservation.from_rows(own_ids, image, direction, moment, usable, frame, known, *said, segments)


def sender_text(text: str) -> str:
    """Return what somebody else has sent, fit for a reason: without control characters, of at most 300 characters."""
    shown = "".join(each if each.isprintable() else " " for each in text[:_MAX_CHARACTERS])
    return shown if len(text) <= _MAX_CHARACTERS else f"{shown[:-3]}..."


def _rows(values: Any, width: int = 3) -> Array | None:
    return np.frombuffer(values).reshape(-1, width) if len(values) else None
