# SPDX-License-Identifier: Apache-2.0
"""From an assessment to singularity_status, in its serialized form."""

from __future__ import annotations

import math

import numpy as np
from rclpy.serialization import deserialize_message

from plsing_msgs.msg import LocusDistance, SingularityStatus
from plsing_ros.features import Conditioning
from plsing_ros.monitoring.assessment import Assessment
from plsing_ros.monitoring.risk import Risk
from plsing_ros.nodes.conversions import LOCUS_KINDS
from plsing_ros.nodes.serialized import SerializedType
from plsing_ros.singularities import LocusDistance as Nearest
from plsing_ros.singularities import Proximity, SingularSet

_SECOND = 1_000_000_000
_STATUS = SerializedType(SingularityStatus)
_NO_NUMBERS, _NO_POINT, _NO_MOTION = np.zeros(0), np.zeros(3), np.zeros(6)


def status_message(assessment: Assessment, singular: SingularSet, frame: str) -> SingularityStatus:
    """Return the status of an assessment; what is not known is flagged and zero."""
    return deserialize_message(serialized_status(assessment, singular, frame), SingularityStatus)


def serialized_status(assessment: Assessment, singular: SingularSet, frame: str) -> bytes:
    """Return the status of an assessment as a publisher takes it; what is not known is flagged and zero."""
    target, time, rate = (
        assessment.target_inverse_condition_number,
        assessment.time_to_critical,
        assessment.inverse_condition_number_rate,
    )
    approach, distances = assessment.approach, assessment.locus_distances
    numbers, singular_values, has_motion, motion = _conditioning(assessment.conditioning)
    # In the order of the fields; doubles next to each other are one.
    return _STATUS.write(
        (
            *divmod(assessment.stamp, _SECOND),
            frame,
            assessment.level,
            assessment.reason,
            assessment.line_count,
            numbers,
            singular_values,
            target is not None,
            target or 0.0,
            rate is not None,
            rate or 0.0,
            has_motion,
            motion,
            assessment.unobservable_motion_text,
            distances is not None,
            assessment.position_source,
            () if distances is None else singular.locus_names,
            _NO_NUMBERS if distances is None else distances,
            *_nearest(assessment.nearest, singular.lines.frame),
            *_proximity(assessment.proximity),
            assessment.trend,
            approach is not None,
            *(("", (0.0, 0.0)) if approach is None else (approach.name, (approach.distance, approach.time))),
            time is not None,
            time or 0.0,
            *_risk(assessment.risk, assessment.stamp),
        )
    )


def _conditioning(numbers: Conditioning | None) -> tuple[object, ...]:
    """Return the inverse condition numbers with their length, the singular values, and the least observable motion."""
    if numbers is None:
        return (0.0, 0.0, 0.0), _NO_NUMBERS, False, _NO_MOTION
    inverse = numbers.inverse_condition_number, numbers.scaled_inverse_condition_number, numbers.characteristic_length
    return inverse, numbers.singular_values, True, numbers.least_observable_direction


def _nearest(nearest: Nearest | None, frame: str) -> tuple[object, ...]:
    """Return the fields of a distance in the scene's frame, of kind NONE if there is none."""
    if nearest is None:
        return LocusDistance.KIND_NONE, "", 0.0, "", _NO_POINT
    return LOCUS_KINDS[nearest.kind], nearest.name, nearest.distance, frame, nearest.closest_point


def _proximity(near: Proximity | None) -> tuple[object, ...]:
    """Return how near the camera is to a singular centre; what is infinite is flagged and zero."""
    if near is None:
        return False, False, (0.0, 0.0, 0.0), False, (0.0, 0.0)
    known = math.isfinite(near.distance)
    has_z = near.z is not None and math.isfinite(near.z)
    precise = math.isfinite(near.position_std) and math.isfinite(near.rotation_std)
    return (
        known,
        has_z,
        (near.z if has_z else 0.0, *((near.distance, near.relative_condition) if known else (0.0, 0.0))),
        precise,
        (near.position_std, near.rotation_std) if precise else (0.0, 0.0),
    )


def _risk(risk: Risk | None, stamp: int) -> tuple[object, ...]:
    """Return what comes of the run, as it is known at a stamp [ns]."""
    if risk is None:
        return False, (0.0, 0.0), False, 0.0, 0, ""
    time = risk.time_to_harm
    left = 0.0 if time is None else max(time - (stamp - risk.stamp) / _SECOND, 0.0)
    return True, (risk.probability, risk.demand), time is not None, left, risk.harm, risk.harm_text
