# SPDX-License-Identifier: Apache-2.0
"""Messages read from and written to bytes at once: the same as the middleware's, and as what looks closer."""

import dataclasses

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from plsing_msgs.msg import LineFeatureArray, LocusDistance, PoseEstimate, SingularityStatus
from plsing_ros.errors import PlsingError
from plsing_ros.nodes.conversions import (
    nanoseconds,
    observation_from_data,
    observation_from_message,
    twist_from_data,
    twist_from_message,
)
from plsing_ros.nodes.pose_conversions import (
    camera_pose_from_message,
    covariance_from_message,
    received_pose_from_data,
)
from plsing_ros.nodes.serialization import Serializer

FRAME = "camera"
TYPES = (LineFeatureArray, PoseWithCovarianceStamped, TwistStamped, SingularityStatus)
WRONG = (np.nan, np.inf, -np.inf, 0.0, 1e60, 1.001, -3.0)


def features(n=4):
    """Sound features of n lines."""
    message, rng = LineFeatureArray(), np.random.default_rng(n)
    message.header.frame_id, message.header.stamp.sec, message.header.stamp.nanosec = FRAME, 7, 11
    direction = rng.normal(size=(n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    moment = np.cross(rng.normal(size=(n, 3)) + [0.0, 0.0, 5.0], direction)
    message.ids = [3 * i + 1 for i in range(n)]
    message.directions, message.moments = direction.ravel().tolist(), moment.ravel().tolist()
    image = moment / np.linalg.norm(moment[:, :2], axis=1, keepdims=True)
    message.image_lines = image.ravel().tolist()
    message.covariances = [1e-6, 1e-8, 2e-6] * n
    message.ends = rng.normal(size=4 * n).tolist()
    message.visible = [1] * n
    message.lines_verdict, message.lines_reason, message.lines_source = LineFeatureArray.LINES_POOR, "near\n", "image"
    return message


def pose():
    """The message of a camera pose."""
    message = PoseWithCovarianceStamped()
    message.header.frame_id, message.header.stamp.sec, message.header.stamp.nanosec = FRAME, 3, 999_999_999
    position, turn = message.pose.pose.position, message.pose.pose.orientation
    position.x, position.y, position.z = 0.7, -4.6, 7.8
    turn.x, turn.y, turn.z, turn.w = 0.1, -0.5, 0.5, 0.7
    message.pose.covariance = np.diag(np.arange(1.0, 7.0)).ravel()
    return message


def twist():
    """The message of a twist."""
    message = TwistStamped()
    message.header.frame_id, message.header.stamp.sec = FRAME, 5
    message.twist.linear.x, message.twist.angular.y = 0.25, -1.5
    return message


def assert_same(a, b):
    """Check that two observations have the same values in all their fields, and arrays that cannot be written to."""
    for field in dataclasses.fields(a):
        one, other = getattr(a, field.name), getattr(b, field.name)
        if field.name == "lines_camera" and other is not None:
            assert_same(one, other)
        elif isinstance(other, np.ndarray):
            np.testing.assert_array_equal(one, other)
            assert one.shape == other.shape and one.dtype == other.dtype and not one.flags.writeable
        else:
            assert one == other and type(one) is type(other), field.name


numbers = st.floats(allow_nan=False)
texts = st.text(st.characters(min_codepoint=1, max_codepoint=0x2FFF), max_size=9)


@st.composite
def statuses(draw):
    """Statuses with random values in all their fields."""
    message = SingularityStatus()
    nearest = LocusDistance()
    for each in (message, nearest):
        for name, kind in each.get_fields_and_field_types().items():
            values = {"double": numbers, "string": texts, "boolean": st.booleans(), "uint8": st.integers(0, 255)}
            values |= {"uint32": st.integers(0, 2**32 - 1), "sequence<double>": st.lists(numbers, max_size=3)}
            values |= {"sequence<string>": st.lists(texts, max_size=3)}
            if kind in values:
                setattr(each, name, draw(values[kind]))
    message.nearest = nearest
    message.unobservable_motion.linear.y, message.nearest.closest_point.z = draw(numbers), draw(numbers)
    message.header.stamp.sec, message.header.frame_id = draw(st.integers(-(2**31), 2**31 - 1)), draw(texts)
    return message


@given(message=statuses())
def test_a_message_comes_back_from_its_fields(message):
    serializer = Serializer(SingularityStatus)
    found = serializer.data(serializer.fields(serialize_message(message)))
    assert deserialize_message(found, SingularityStatus) == message


@pytest.mark.parametrize("message", [features(), features(1), pose(), twist(), *(each() for each in TYPES)])
def test_so_does_each_that_the_monitor_takes_and_none_of_a_part_of_one(message):
    kind = type(message)
    serializer = Serializer(kind)
    fields = serializer.fields(serialize_message(message))
    data = serializer.data(fields)
    assert deserialize_message(data, kind) == message
    # What the middleware writes is padded at the end.
    for length in range(len(data)):
        assert serializer.fields(data[:length]) is None
    assert serializer.fields(b"\0\0" + data[2:]) is None


def test_a_length_that_no_message_has_is_no_reason_to_read_on():
    data = bytearray(Serializer(LineFeatureArray).data((0, 0, "", (), *[np.zeros(0)] * 5, b"", "", 0, "")))
    for place in range(4, len(data) - 3):
        changed = data[:place] + b"\xff\xff\xff\x7f" + data[place + 4 :]
        fields = Serializer(LineFeatureArray).fields(bytes(changed))
        assert fields is None or len(fields) == 13


def test_types_that_it_does_not_know_and_values_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="PoseEstimate has a field of type"):
        Serializer(PoseEstimate)
    serializer = Serializer(TwistStamped)
    for fields in ((0, 0, ""), (0, 0, "", np.zeros(6), 1), (0, 0, "", np.zeros(5)), (0, 0, "", np.zeros((6, 2)))):
        with pytest.raises(ValueError, match="must"):
            serializer.data(fields)


@pytest.mark.parametrize("n", [1, 3, 12])
def test_sound_features_are_read_at_once_as_they_are_from_a_message(n):
    message = features(n)
    for change in (
        {},
        {"covariances": []},
        {"ends": []},
        {"visible": []},
        {"visible": [1, 0, 2, 0, 1, 1, 0, 1, 1, 1, 1, 1][:n]},
        {"lines_verdict": LineFeatureArray.LINES_GIVEN},
        {"lines_reason": "x" * 400},
    ):
        for name, value in change.items():
            setattr(message, name, value)
        stamp, found = observation_from_data(serialize_message(message), FRAME)
        assert stamp == nanoseconds(message.header.stamp)
        assert_same(found, observation_from_message(message, FRAME))


@given(data=st.data())
def test_features_with_anything_wrong_are_left_to_who_says_what(data):
    message = features(3)
    for _ in range(data.draw(st.integers(1, 2))):
        name = data.draw(st.sampled_from(("image_lines", "directions", "moments", "covariances", "ends")))
        values = getattr(message, name)
        if len(values) and data.draw(st.booleans()):
            values[data.draw(st.integers(0, len(values) - 1))] = data.draw(st.sampled_from(WRONG) | numbers)
        elif data.draw(st.booleans()):
            setattr(message, name, values[: data.draw(st.integers(0, len(values)))])
        else:
            message.visible = data.draw(st.lists(st.integers(0, 2), max_size=4))
            message.ids = data.draw(st.lists(st.integers(0, 3), max_size=4))
            message.lines_verdict = data.draw(st.integers(0, 5))
    found = observation_from_data(serialize_message(message), FRAME)
    try:
        expected = observation_from_message(message, FRAME)
    except PlsingError:
        expected = None
    if found is not None:
        assert_same(found[1], expected)
    elif expected is not None:
        # So are lines without an image, and features without 3-D lines.
        assert expected.lines_camera is None or expected.usable.tolist() != [each != 0 for each in message.visible]
    assert observation_from_data(serialize_message(message), "elsewhere") is None


@given(data=st.data())
def test_poses_and_twists_likewise(data):
    where, command = pose(), twist()
    if data.draw(st.booleans()):
        name = data.draw(st.sampled_from("xyz"))
        setattr(data.draw(st.sampled_from((where.pose.pose.position, command.twist.linear))), name, 1e51)
    if data.draw(st.booleans()):
        setattr(where.pose.pose.orientation, data.draw(st.sampled_from("xyzw")), data.draw(st.sampled_from(WRONG)))
    if data.draw(st.booleans()):
        setattr(command.twist.angular, data.draw(st.sampled_from("xyz")), data.draw(st.sampled_from(WRONG)))
    if data.draw(st.booleans()):
        where.pose.covariance[data.draw(st.integers(0, 35))] = data.draw(st.sampled_from(WRONG))
    received = received_pose_from_data(serialize_message(where), FRAME)
    try:
        expected = camera_pose_from_message(where, FRAME)
    except PlsingError:
        assert received is None
    else:
        covariance = covariance_from_message(where)
        assert received.stamp == nanoseconds(where.header.stamp)
        np.testing.assert_allclose(received.T_world_camera.rotation, expected.rotation, atol=1e-15)
        np.testing.assert_array_equal(received.T_world_camera.translation, expected.translation)
        assert (received.covariance is None) == (covariance is None)
        np.testing.assert_array_equal(received.covariance, covariance)
    found = twist_from_data(serialize_message(command), FRAME)
    try:
        expected = twist_from_message(command, FRAME)
    except PlsingError:
        assert found is None
    else:
        assert found[0] == nanoseconds(command.header.stamp)
        np.testing.assert_array_equal(found[1], expected)
    assert received_pose_from_data(serialize_message(where), "") is None
    assert twist_from_data(serialize_message(command), "") is None
