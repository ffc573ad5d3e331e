# SPDX-License-Identifier: Apache-2.0
"""Between messages about camera poses and the core's values."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Transform
from std_msgs.msg import Header

from plsing_msgs.msg import PoseEstimate as PoseEstimateMessage
from plsing_ros.arrays import Array
from plsing_ros.errors import GeometryError
from plsing_ros.geometry import Pose
from plsing_ros.nodes.conversions import flat, locus_distance_message, twist_message
from plsing_ros.pose import PoseEstimate
from plsing_ros.pose.received_poses import covariance_or_none


def pose_message(T_world_camera: Pose) -> PoseMessage:
    """Return a pose."""
    message = PoseMessage()
    fill_pose(message, T_world_camera)
    return message


def fill_pose(message: PoseMessage, T_world_camera: Pose) -> None:
    """Write a pose into a message."""
    position, orientation = message.position, message.orientation
    position.x, position.y, position.z = T_world_camera.translation.tolist()
    orientation.x, orientation.y, orientation.z, orientation.w = T_world_camera.quaternion_xyzw.tolist()


def fill_transform(message: Transform, T_parent_child: Pose) -> None:
    """Write a pose into the transform from a frame to its child."""
    translation, rotation = message.translation, message.rotation
    translation.x, translation.y, translation.z = T_parent_child.translation.tolist()
    rotation.x, rotation.y, rotation.z, rotation.w = T_parent_child.quaternion_xyzw.tolist()


def camera_pose_message(
    T_world_camera: Pose, head: Header, covariance: Array | None = None
) -> PoseWithCovarianceStamped:
    """Return the camera's pose in the frame of the header; exactly known, so of zero covariance, if none is given."""
    message = PoseWithCovarianceStamped(header=head)
    fill_pose(message.pose.pose, T_world_camera)
    if covariance is not None:
        message.pose.covariance = covariance.ravel()
    return message


def camera_pose_from_message(message: PoseWithCovarianceStamped, frame: str, topic: str = "camera_pose") -> Pose:
    """Return T_world_camera.

    Args:
        message: The camera's pose.
        frame: That of the scene, which it must be in.
        topic: That it came on, for what is said about it.

    Raises:
        GeometryError: If a value is not finite, the quaternion is not of unit length, or the frame is another one.
    """
    return _pose(topic, message.header.frame_id, message.pose.pose, frame)


def covariance_from_message(message: PoseWithCovarianceStamped) -> Array | None:
    """Return the covariance of the camera's pose in the axes of the header's frame, (position, rotation), shape (6, 6).

    None if it is zero, or no covariance: not finite, or with a negative variance.
    """
    return covariance_or_none(message.pose.covariance.reshape(6, 6))


def pose_from_message(message: PoseStamped, frame: str) -> Pose:
    """Return T_world_camera of a request; an empty frame means the scene's.

    Raises:
        GeometryError: As for camera_pose_from_message.
    """
    return _pose("the pose", message.header.frame_id or frame, message.pose, frame)


def pose_estimate_message(estimate: PoseEstimate, head: Header) -> PoseEstimateMessage:
    """Return the state that says how far an estimate can be trusted; the identity pose if there is none."""
    message = PoseEstimateMessage(
        header=head,
        verdict=int(estimate.verdict),
        reason=estimate.reason,
        covariance_trusted=estimate.covariance_trusted,
        inverse_condition_number=estimate.inverse_condition_number,
        least_observable_direction=twist_message(estimate.least_observable_direction),
        least_observable_standard_deviation=estimate.least_observable_standard_deviation,
        residual=estimate.residual,
        innovation=estimate.innovation,
        source=estimate.source,
        nearest=locus_distance_message(estimate.nearest, head.frame_id),
        alternatives=[pose_message(each.T_world_camera) for each in estimate.alternatives],
        likelihood_ratios=flat(np.array([each.likelihood_ratio for each in estimate.alternatives])),
        used_ids=estimate.used_ids,
        outlier_ids=estimate.outlier_ids,
        reversed_ids=estimate.reversed_ids,
    )
    if estimate.T_world_camera is not None:
        message.pose = camera_pose_message(estimate.T_world_camera, head, estimate.covariance).pose
    return message


def _pose(what: str, given_frame: str, pose: PoseMessage, frame: str) -> Pose:
    if given_frame != frame:
        raise GeometryError(f"{what} is in frame '{given_frame}', expected '{frame}' (parameter scene_frame)")
    position, q = pose.position, pose.orientation
    return Pose.from_quaternion([position.x, position.y, position.z], [q.x, q.y, q.z, q.w])
