# SPDX-License-Identifier: Apache-2.0
"""Messages for tests, made without the nodes' own conversions where that is what is tested."""

import array

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TwistStamped
from std_msgs.msg import Header

from plsing_msgs.msg import LineFeatureArray
from plsing_ros.features import interaction_matrix, project_lines
from plsing_ros.geometry import Pose
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters.config_files import config_file
from plsing_ros.simulation import near_transversal

CAMERA_FRAME = "camera_optical_frame"
SCENE = read_scene(config_file("paper_p4l.yaml"))
TARGET = Pose.from_quaternion(near_transversal.TARGET_POSITION, near_transversal.ORIENTATION)


def start_pose(number):
    return Pose.from_quaternion(near_transversal.STARTS[number - 1].position, near_transversal.ORIENTATION)


def seen(T_world_camera):
    return SCENE.transformed(T_world_camera.inverse(), CAMERA_FRAME)


def features(T_world_camera, stamp, ids=(1, 2, 3, 4)):
    """The features of the paper's scene; stamp in seconds, or a Time message."""
    lines = seen(T_world_camera)
    rows = [SCENE.ids.index(each) for each in ids]

    def flat(values):
        return array.array("d", np.reshape(values, (-1, 3))[rows].ravel())

    return LineFeatureArray(
        header=Header(stamp=time_of(stamp), frame_id=CAMERA_FRAME),
        ids=list(ids),
        image_lines=flat(project_lines(lines)),
        directions=flat(lines.direction),
        moments=flat(lines.moment),
        visible=[1] * len(rows),
    )


def time_of(stamp):
    if isinstance(stamp, Time):
        return stamp
    return Time(sec=int(stamp), nanosec=round((stamp % 1) * 1e9))


def compute_plain_twist(T_world_camera, gain=near_transversal.GAIN):
    """The law of the paper, by the textbook: minus lambda times the least-squares solution."""
    error = project_lines(seen(T_world_camera)) - project_lines(seen(TARGET))
    return -gain * np.linalg.lstsq(interaction_matrix(seen(T_world_camera)), error, rcond=None)[0]


def twist_values(message):
    v, w = message.twist.linear, message.twist.angular
    return np.array([v.x, v.y, v.z, w.x, w.y, w.z])


def twist(values, stamp, frame=CAMERA_FRAME):
    message = TwistStamped(header=Header(stamp=time_of(stamp), frame_id=frame))
    v, w = message.twist.linear, message.twist.angular
    v.x, v.y, v.z, w.x, w.y, w.z = map(float, values)
    return message


def change(**fields):
    """Return what gives fields of a message other values."""

    def apply(message):
        for name, value in fields.items():
            setattr(message, name, value)

    return apply


def set_number(field, index, value):
    """Return what gives one number of a message's field another value."""

    def apply(message):
        getattr(message, field)[index] = value

    return apply
