# SPDX-License-Identifier: Apache-2.0
"""A monitor, what it is sent, and what it says."""

import numpy as np
from builders import features
from geometry_msgs.msg import PoseWithCovarianceStamped
from std_msgs.msg import Header

from plsing_msgs.msg import LineFeatureArray, SingularityAlert, SingularityStatus
from plsing_ros.geometry import Pose
from plsing_ros.nodes import qos
from plsing_ros.nodes.singularity_monitor import SingularityMonitorNode
from plsing_ros.simulation.near_transversal import ORIENTATION, POINT_ON_TRANSVERSAL


def beside_transversal(distance):
    """A camera at that distance from the paper's point P_M, across its transversal."""
    along = np.array([0.0, 0.0, 1.0])
    return Pose.from_quaternion(POINT_ON_TRANSVERSAL + distance * np.cross(along, [1.0, 0, 0]), ORIENTATION)


class MonitorLoop:
    """Sends features and poses to a monitor and receives what it says of them."""

    def __init__(self, ros, paper, **parameters):
        self.ros = ros
        self.statuses = ros.collect(SingularityStatus, "singularity_status", qos.STATUS)
        self.alerts = ros.collect(SingularityAlert, "singularity_alerts", qos.LATCHED)
        self.node = ros.add(SingularityMonitorNode, paper, {"features_timeout": 5.0, **parameters})
        self.poses = ros.publisher(PoseWithCovarianceStamped, "camera_pose")
        self.features = ros.publisher(LineFeatureArray, "line_features")

    def now(self):
        return self.ros.node.get_clock().now().to_msg()

    def publish_pose(self, pose, stamp, frame="world"):
        message = PoseWithCovarianceStamped(header=Header(stamp=stamp, frame_id=frame))
        p, q = message.pose.pose.position, message.pose.pose.orientation
        p.x, p.y, p.z = map(float, pose.translation)
        q.x, q.y, q.z, q.w = map(float, pose.quaternion_xyzw)
        self.poses.publish(message)

    def status_at(self, pose, spoil=lambda message: None, with_pose=True):
        """Send what a camera there sees, and return the status that answers it."""
        stamp = self.now()
        if with_pose:
            self.publish_pose(pose, stamp)
            self.ros.spin_for(0.05)  # two topics have no common order
        message = features(pose, stamp)
        spoil(message)
        self.features.publish(message)
        # The first status comes with the first alert, but on another topic.
        self.ros.spin_until(
            lambda: self.statuses and self.statuses[-1].header.stamp == stamp and self.alerts,
            "the status of these features",
        )
        return self.statuses[-1]

    def until_level(self, pose, level, most=50):
        """Stay at a pose until the level is there; levels change after some cycles only."""
        for _ in range(most):
            if self.status_at(pose).level == level:
                return self.statuses[-1]
        raise AssertionError(f"level {level} not reached in {most} cycles: {self.statuses[-1].reason}")
