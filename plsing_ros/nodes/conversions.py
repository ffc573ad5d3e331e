# SPDX-License-Identifier: Apache-2.0
"""Between messages and the core's values."""

from __future__ import annotations

import array
import math
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Twist, TwistStamped
from rclpy.serialization import deserialize_message
from std_msgs.msg import Header

from plsing_msgs.msg import (
    ControllerState,
    LineFeatureArray,
    SingularityAlert,
    SingularityStatus,
)
from plsing_msgs.msg import LocusDistance as LocusDistanceMessage
from plsing_ros.arrays import Array
from plsing_ros.control.command import Command
from plsing_ros.errors import GeometryError
from plsing_ros.features import LineObservation
from plsing_ros.features.feature_message import observation_from_fields, sender_text
from plsing_ros.features.feature_message import observation_from_message as observation_from_message
from plsing_ros.geometry.pose import checked_twist, is_twist
from plsing_ros.levels import Level
from plsing_ros.monitoring.assessment import Assessment
from plsing_ros.monitoring.risk import Risk
from plsing_ros.nodes.serialization import Serializer
from plsing_ros.singularities import Kind, LocusDistance, Proximity, SingularSet

_SECOND = 1_000_000_000
_STATUS, _TWIST = Serializer(SingularityStatus), Serializer(TwistStamped)
_FEATURES = Serializer(LineFeatureArray)
# What there is in a status in place of what is not known.
_NO_NUMBERS, _STILL = np.zeros(0), np.zeros(6)
_NO_LOCUS = (LocusDistanceMessage.KIND_NONE, "", 0.0, "", np.zeros(3))
_NOT_NEAR, _NO_RISK = (False, False, 0.0, 0.0, 0.0, False, 0.0, 0.0), (False, 0.0, 0.0, False, 0.0, 0, "")
LOCUS_KINDS = {
    Kind.TRANSVERSAL: LocusDistanceMessage.KIND_TRANSVERSAL,
    Kind.ISOLATED_POINT: LocusDistanceMessage.KIND_ISOLATED_POINT,
    Kind.OBSERVED_LINE: LocusDistanceMessage.KIND_OBSERVED_LINE,
    Kind.PLANE: LocusDistanceMessage.KIND_PLANE,
    Kind.QUADRIC: LocusDistanceMessage.KIND_QUADRIC,
    Kind.CUBIC: LocusDistanceMessage.KIND_CUBIC,
    Kind.STRAIGHT_LINE: LocusDistanceMessage.KIND_STRAIGHT_LINE,
    Kind.CONIC: LocusDistanceMessage.KIND_CONIC,
    Kind.EVERYWHERE: LocusDistanceMessage.KIND_EVERYWHERE,
    Kind.CURVE: LocusDistanceMessage.KIND_CURVE,
}


def nanoseconds(stamp: Time) -> int:
    """Return a stamp in nanoseconds."""
    return int(stamp.sec) * _SECOND + int(stamp.nanosec)


def header(stamp: int, frame: str) -> Header:
    """Return a header for a stamp in nanoseconds."""
    # Filled in place, here and below: a constructor makes defaults of all its fields first, also of those it is given.
    head = Header(frame_id=frame)
    fill_stamp(head.stamp, stamp)
    return head


def fill_stamp(message: Time, stamp: int) -> None:
    """Write a stamp given in nanoseconds into a message."""
    message.sec, message.nanosec = divmod(stamp, _SECOND)


def flat(values: Array) -> array.array[float]:
    """Return values row by row as the array type that message fields take without a copy for each element."""
    return array.array("d", np.ascontiguousarray(values, dtype=float).tobytes())


def features_message(observation: LineObservation, head: Header) -> LineFeatureArray:
    """Return the message of an observation."""
    message = LineFeatureArray(header=head)
    fill_features(message, observation)
    return message


def fill_features(message: LineFeatureArray, observation: LineObservation) -> None:
    """Write an observation into a message, except for the header; without 3-D lines their fields become empty."""
    n, lines = len(observation.ids), observation.lines_camera
    directions: Array
    moments: Array
    if lines is None:
        directions = moments = np.zeros((0, 3))
    elif len(lines) == n:
        directions, moments = lines.direction, lines.moment
    else:
        directions, moments = np.zeros((n, 3)), np.zeros((n, 3))
        directions[observation.usable] = lines.direction
        moments[observation.usable] = lines.moment
    message.ids = array.array("i", observation.ids)
    message.image_lines = flat(observation.image_lines)
    message.covariances = flat(np.zeros(0) if observation.covariances is None else observation.covariances)
    message.ends = flat(np.zeros(0) if observation.ends is None else observation.ends)
    message.directions = flat(directions)
    message.moments = flat(moments)
    message.visible = array.array("B", observation.usable.tobytes())
    message.lines_verdict = int(observation.verdict)
    message.lines_reason = observation.verdict_reason
    message.lines_source = observation.lines_source


def twist_message(twist: Array) -> Twist:
    """Return a twist (v, omega), shape (6,)."""
    message = Twist()
    fill_twist(message, twist)
    return message


def fill_twist(message: Twist, twist: Array) -> None:
    """Write a twist (v, omega), shape (6,), into a message."""
    linear, angular = message.linear, message.angular
    linear.x, linear.y, linear.z, angular.x, angular.y, angular.z = twist.tolist()


def twist_from_message(message: TwistStamped, frame: str, topic: str = "cmd_twist") -> Array:
    """Return (v, omega), shape (6,), of a message on a topic.

    Raises:
        GeometryError: If a value is not finite or beyond 1e50, or the twist is in another frame.
    """
    if message.header.frame_id != frame:
        raise GeometryError(
            f"{topic} is in frame '{sender_text(message.header.frame_id)}', expected '{frame}' (parameter camera_frame)"
        )
    linear, angular = message.twist.linear, message.twist.angular
    return checked_twist(topic, [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z])


def twist_from_data(data: bytes, frame: str) -> tuple[int, Array] | None:
    """Return stamp [ns] and twist of a serialized TwistStamped; None where twist_from_message has to look closer."""
    fields = _TWIST.fields(data)
    if fields is None or fields[2] != frame or not is_twist(fields[3]):
        return None
    return fields[0] * _SECOND + fields[1], fields[3]


def observation_from_data(data: bytes, frame: str) -> tuple[int, LineObservation] | None:
    """Return stamp [ns] and observation of a serialized LineFeatureArray.

    None where observation_from_message has to look closer.
    """
    fields = _FEATURES.fields(data)
    if fields is None or fields[2] != frame:
        return None
    observation = observation_from_fields(fields[3:], frame)
    return None if observation is None else (fields[0] * _SECOND + fields[1], observation)


def point_message(point: Array) -> Point:
    """Return a point, shape (3,) [m]."""
    return Point(x=float(point[0]), y=float(point[1]), z=float(point[2]))


def controller_state_message(
    command: Command, law: str, twist_covariance: Array, unchecked: str, head: Header
) -> ControllerState:
    """Return the state that goes with a command of a law.

    Args:
        command: The command.
        law: By which law.
        twist_covariance: Of the camera's twist, shape (6, 6).
        unchecked: What could not be checked about the features.
        head: Of the message.
    """
    return ControllerState(
        header=head,
        mode=int(command.mode),
        reason=command.reason,
        law=law,
        error_norm=command.error_norm,
        gain=command.gain,
        linear_speed=float(np.linalg.norm(command.twist[:3])),
        angular_speed=float(np.linalg.norm(command.twist[3:])),
        inverse_condition_number=command.inverse_condition_number,
        singular_values=command.singular_values,
        damping=command.damping,
        scale=command.scale,
        saturated=command.saturated,
        path_progress=command.path_progress,
        twist_covariance=twist_covariance.ravel(),
        unchecked=unchecked,
    )


def status_message(assessment: Assessment, singular: SingularSet, frame: str) -> SingularityStatus:
    """Return the status of an assessment; what is not known is flagged and zero."""
    message: SingularityStatus = deserialize_message(status_data(assessment, singular, frame), SingularityStatus)
    return message


def status_data(assessment: Assessment, singular: SingularSet, frame: str) -> bytes:
    """Return the serialized status of an assessment; what is not known is flagged and zero."""
    return _STATUS.data(_status_fields(assessment, singular, frame))


def _status_fields(assessment: Assessment, singular: SingularSet, frame: str) -> tuple[Any, ...]:
    """Return the fields of a status in the order of its definition."""
    stamp, numbers, distances, nearest = (
        assessment.stamp,
        assessment.conditioning,
        assessment.locus_distances,
        assessment.nearest,
    )
    target, time, rate = (
        assessment.target_inverse_condition_number,
        assessment.time_to_critical,
        assessment.inverse_condition_number_rate,
    )
    approach, near, risk = assessment.approach, assessment.proximity, assessment.risk
    return (
        *divmod(stamp, _SECOND),
        frame,
        assessment.level,
        assessment.reason,
        assessment.line_count,
        *(
            (0.0, 0.0, 0.0, _NO_NUMBERS)
            if numbers is None
            else (
                numbers.inverse_condition_number,
                numbers.scaled_inverse_condition_number,
                numbers.characteristic_length,
                numbers.singular_values,
            )
        ),
        target is not None,
        target or 0.0,
        rate is not None,
        rate or 0.0,
        numbers is not None,
        _STILL if numbers is None else numbers.least_observable_direction,
        assessment.unobservable_motion_text,
        distances is not None,
        assessment.position_source,
        () if distances is None else singular.locus_names,
        _NO_NUMBERS if distances is None else distances,
        *(
            _NO_LOCUS
            if nearest is None
            else (
                LOCUS_KINDS[nearest.kind],
                nearest.name,
                nearest.distance,
                singular.lines.frame,
                nearest.closest_point,
            )
        ),
        *(_NOT_NEAR if near is None else _proximity_fields(near)),
        assessment.trend,
        *((False, "", 0.0, 0.0) if approach is None else (True, approach.name, approach.distance, approach.time)),
        time is not None,
        time or 0.0,
        *(_NO_RISK if risk is None else _risk_fields(risk, stamp)),
    )


def _proximity_fields(near: Proximity) -> tuple[Any, ...]:
    """Return how near the camera is to a singular centre; what is infinite is flagged and zero."""
    z, distance, position, rotation = near.z, near.distance, near.position_std, near.rotation_std
    known, precise = math.isfinite(distance), math.isfinite(position) and math.isfinite(rotation)
    has_z = z is not None and math.isfinite(z)
    return (
        known,
        has_z,
        z if has_z else 0.0,
        *((distance, near.relative_condition) if known else (0.0, 0.0)),
        precise,
        *((position, rotation) if precise else (0.0, 0.0)),
    )


def _risk_fields(risk: Risk, stamp: int) -> tuple[Any, ...]:
    time = risk.time_to_harm
    left = 0.0 if time is None else max(time - (stamp - risk.stamp) / 1e9, 0.0)
    return True, risk.probability, risk.demand, time is not None, left, risk.harm, risk.harm_text


def alert_message(assessment: Assessment, previous: Level, frame: str, scene_frame: str) -> SingularityAlert:
    """Return the alert of a change of level of a camera, whose frame it is, in a scene."""
    numbers = assessment.conditioning
    return SingularityAlert(
        header=header(assessment.stamp, frame),
        level=int(assessment.level),
        previous_level=int(previous),
        text=f"{assessment.level.name}: {assessment.reason}",
        inverse_condition_number=0.0 if numbers is None else numbers.inverse_condition_number,
        nearest=locus_distance_message(assessment.nearest, scene_frame),
    )


def locus_distance_message(nearest: LocusDistance | None, frame: str) -> LocusDistanceMessage:
    """Return the message of a distance in the scene's frame, of kind NONE if there is none."""
    message = LocusDistanceMessage()
    if nearest is None:
        message.kind, message.name, message.distance, message.frame_id = LocusDistanceMessage.KIND_NONE, "", 0.0, ""
        point = [0.0, 0.0, 0.0]
    else:
        message.kind, message.name, message.distance, message.frame_id = (
            LOCUS_KINDS[nearest.kind],
            nearest.name,
            float(nearest.distance),
            frame,
        )
        point = nearest.closest_point.tolist()
    message.closest_point.x, message.closest_point.y, message.closest_point.z = point
    return message
