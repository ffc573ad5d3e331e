# SPDX-License-Identifier: Apache-2.0
"""Messages read and written in their serialized form, against the middleware's own."""

import array
import struct

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from plsing_msgs.msg import LineFeatureArray, SingularityStatus
from plsing_ros.nodes.serialized import SerializedType

NUMBERS = st.floats(-1e300, 1e300)
TEXTS = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=12)
STAMPS = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))
BYTES = st.integers(0, 255)


def fill(message, stamp, frame):
    message.header.stamp.sec, message.header.stamp.nanosec = stamp
    message.header.frame_id = frame


@settings(max_examples=30)
@given(STAMPS, TEXTS, st.lists(st.integers(-(2**31), 2**31 - 1), max_size=5), st.data())
def test_line_features_are_read_as_they_were_sent(stamp, frame, ids, data):
    message = LineFeatureArray()
    fill(message, stamp, frame)
    message.ids = array.array("i", ids)
    sent = []
    for name in ("image_lines", "covariances", "ends", "directions", "moments"):
        values = data.draw(st.lists(NUMBERS, max_size=7))
        setattr(message, name, array.array("d", values))
        sent.append(values)
    visible, source, verdict, reason = data.draw(st.tuples(st.lists(BYTES, max_size=5), TEXTS, BYTES, TEXTS))
    message.visible, message.lines_source = array.array("B", visible), source
    message.lines_verdict, message.lines_reason = verdict, reason
    found = SerializedType(LineFeatureArray).read(serialize_message(message))
    assert [each.tolist() if isinstance(each, np.ndarray) else each for each in found] == [
        *stamp, frame, tuple(ids), *sent, visible, source, verdict, reason
    ]  # fmt: skip


@settings(max_examples=30)
@given(STAMPS, TEXTS, st.lists(NUMBERS, min_size=43, max_size=43))
def test_doubles_next_to_each_other_are_read_as_one_array(stamp, frame, values):
    message = PoseWithCovarianceStamped()
    fill(message, stamp, frame)
    where = message.pose.pose
    where.position.x, where.position.y, where.position.z = values[:3]
    where.orientation.x, where.orientation.y, where.orientation.z, where.orientation.w = values[3:7]
    message.pose.covariance = values[7:]
    *head, found = SerializedType(PoseWithCovarianceStamped).read(serialize_message(message))
    assert head == [*stamp, frame] and found.tolist() == values


def values_of(message):
    """All values of a message in order, doubles next to each other by themselves."""
    found = []
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        found += values_of(value) if hasattr(value, "get_fields_and_field_types") else [value]
    return found


@settings(max_examples=30)
@given(STAMPS, TEXTS, st.data())
def test_the_middleware_reads_a_status_as_it_was_written(stamp, frame, data):
    message, values = SingularityStatus(), []
    fill(message, stamp, frame)
    values = [*stamp, frame]
    kinds = {bool: st.booleans(), int: BYTES, float: NUMBERS, str: TEXTS}
    for name, kind in list(message.get_fields_and_field_types().items())[1:]:
        part = getattr(message, name)
        if kind == "sequence<string>":
            value = data.draw(st.lists(TEXTS, max_size=3))
        elif kind == "sequence<double>":
            value = array.array("d", data.draw(st.lists(NUMBERS, max_size=3)))
        elif name == "unobservable_motion":
            numbers = data.draw(st.lists(NUMBERS, min_size=6, max_size=6))
            for side, three in ((part.linear, numbers[:3]), (part.angular, numbers[3:])):
                side.x, side.y, side.z = three
            values.append(np.array(numbers))
            continue
        elif name == "nearest":
            part.kind, part.name, part.distance, part.frame_id = data.draw(st.tuples(BYTES, TEXTS, NUMBERS, TEXTS))
            point = data.draw(st.tuples(NUMBERS, NUMBERS, NUMBERS))
            part.closest_point.x, part.closest_point.y, part.closest_point.z = point
            values += [part.kind, part.name, part.distance, part.frame_id, point]
            continue
        else:
            value = data.draw(kinds[type(part)])
        setattr(message, name, value)
        values.append(value)
    written = SerializedType(SingularityStatus).write(joined(values))
    assert values_of(deserialize_message(written, SingularityStatus)) == values_of(message)


def joined(values):
    """Doubles next to each other as one value, as a layout has them."""
    found, run = [], []
    for value in [*values, None]:
        if isinstance(value, float):
            run.append(value)
            continue
        if run:
            found.append(run[0] if len(run) == 1 else tuple(run))
            run = []
        found.append(value)
    return tuple(found[:-1])


def test_what_is_cut_short_or_has_other_values_is_refused():
    twist = TwistStamped()
    twist.header.frame_id = "camera"
    kind, whole = SerializedType(TwistStamped), serialize_message(twist)
    for size in range(4, len(whole)):
        with pytest.raises(ValueError, match="ends before"):
            kind.read(whole[:size])
    with pytest.raises(ValueError, match="value for each"):
        kind.write((1, 2, "camera"))
    with pytest.raises(ValueError, match="as many doubles"):
        kind.write((1, 2, "camera", np.zeros(5)))


def test_a_message_of_a_machine_with_the_other_order_of_bytes_is_read():
    frame, numbers = b"camera\0", (1.0, -2.5, 3.0, 0.25, 5.0, -6.0)
    # Aligned to eight bytes behind the four in front: 4 + 4 + 4 + 7 and 5 of padding.
    data = struct.pack(">BBBBiII7s5x6d", 0, 0, 0, 0, 7, 9, len(frame), frame, *numbers)
    *head, values = SerializedType(TwistStamped).read(data)
    assert head == [7, 9, "camera"] and tuple(values) == numbers
