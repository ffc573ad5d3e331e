# SPDX-License-Identifier: Apache-2.0
"""Between messages and the core's values."""

from __future__ import annotations

import array
import math

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Twist, TwistStamped
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
from plsing_ros.features import Conditioning, LineObservation
from plsing_ros.features.feature_message import observation_from_message as observation_from_message
from plsing_ros.features.feature_message import sender_text
from plsing_ros.geometry.pose import checked_twist
from plsing_ros.levels import Level
from plsing_ros.monitoring.assessment import Assessment
from plsing_ros.monitoring.risk import Risk
from plsing_ros.singularities import Kind, LocusDistance, Proximity, SingularSet

_SECOND = 1_000_000_000
_NO_NUMBERS = array.array("d")
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
    message = SingularityStatus()
    fill_status(message, assessment, singular, frame)
    return message


def fill_status(message: SingularityStatus, assessment: Assessment, singular: SingularSet, frame: str) -> None:
    """Write the status of an assessment into a message, whatever was in it before."""
    fill_stamp(message.header.stamp, assessment.stamp)
    message.header.frame_id = frame
    message.level = int(assessment.level)
    message.reason = assessment.reason
    message.line_count = assessment.line_count
    message.trend = int(assessment.trend)
    message.position_source = assessment.position_source
    message.unobservable_motion_text = assessment.unobservable_motion_text
    _fill_locus_distance(message.nearest, assessment.nearest, singular.lines.frame)
    target, time, rate = (
        assessment.target_inverse_condition_number,
        assessment.time_to_critical,
        assessment.inverse_condition_number_rate,
    )
    message.target_valid, message.target_inverse_condition_number = target is not None, target or 0.0
    message.time_to_critical_valid, message.time_to_critical = time is not None, time or 0.0
    message.rate_valid, message.inverse_condition_number_rate = rate is not None, rate or 0.0
    approach = assessment.approach
    message.approach_valid = approach is not None
    message.approach_locus, message.approach_distance, message.time_to_approach = (
        ("", 0.0, 0.0) if approach is None else (approach.name, approach.distance, approach.time)
    )
    distances = assessment.locus_distances
    message.distances_valid = distances is not None
    message.locus_names = [] if distances is None else list(singular.locus_names)
    message.locus_distances = _NO_NUMBERS if distances is None else flat(distances)
    _fill_conditioning(message, assessment.conditioning)
    _fill_proximity(message, assessment.proximity)
    _fill_risk(message, assessment.risk, assessment.stamp)


def _fill_conditioning(message: SingularityStatus, numbers: Conditioning | None) -> None:
    message.unobservable_motion_valid = numbers is not None
    if numbers is None:
        message.inverse_condition_number = message.scaled_inverse_condition_number = 0.0
        message.characteristic_length = 0.0
        message.singular_values = _NO_NUMBERS
        fill_twist(message.unobservable_motion, np.zeros(6))
        return
    message.inverse_condition_number = numbers.inverse_condition_number
    message.scaled_inverse_condition_number = numbers.scaled_inverse_condition_number
    message.characteristic_length = numbers.characteristic_length
    message.singular_values = flat(numbers.singular_values)
    fill_twist(message.unobservable_motion, numbers.least_observable_direction)


def _fill_proximity(message: SingularityStatus, near: Proximity | None) -> None:
    """Fill in how near the camera is to a singular centre; what is infinite is flagged and zero."""
    known = near is not None and math.isfinite(near.distance)
    message.proximity_valid = known
    message.singular_distance, message.relative_condition = (
        (near.distance, near.relative_condition) if near is not None and known else (0.0, 0.0)
    )
    z = None if near is None else near.z
    message.has_z, message.z = (True, z) if z is not None and math.isfinite(z) else (False, 0.0)
    precise = near is not None and math.isfinite(near.position_std) and math.isfinite(near.rotation_std)
    message.precision_valid = precise
    message.position_std, message.rotation_std = (
        (near.position_std, near.rotation_std) if near is not None and precise else (0.0, 0.0)
    )


def _fill_risk(message: SingularityStatus, risk: Risk | None, stamp: int) -> None:
    time = None if risk is None else risk.time_to_harm
    message.risk_valid, message.time_to_harm_valid = risk is not None, time is not None
    message.risk, message.demand, message.harm, message.harm_text = (
        (0.0, 0.0, 0, "") if risk is None else (risk.probability, risk.demand, int(risk.harm), risk.harm_text)
    )
    message.time_to_harm = 0.0 if risk is None or time is None else max(time - (stamp - risk.stamp) / 1e9, 0.0)


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
    _fill_locus_distance(message, nearest, frame)
    return message


def _fill_locus_distance(message: LocusDistanceMessage, nearest: LocusDistance | None, frame: str) -> None:
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
