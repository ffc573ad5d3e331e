# SPDX-License-Identifier: Apache-2.0
"""A rosbag2 of our topics, recorded off the wire, read with rosbags and played into new nodes over DDS."""

import numpy as np
import pytest
from builders import time_of, twist_values
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from rosbags.highlevel import AnyReader
from rosgraph_msgs.msg import Clock

from plsing_msgs.msg import LineFeatureArray, SingularityStatus, SingularLoci
from plsing_ros.nodes import qos
from plsing_ros.nodes.controller import ControllerNode
from plsing_ros.nodes.singularity_monitor import SingularityMonitorNode
from plsing_ros.simulation import near_transversal as experiment
from plsing_ros.testing.harness import Harness
from plsing_ros.testing.lockstep import run_lockstep

FRAMES = 60


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """The recording of a run towards a transversal, and what the run was."""
    from plsing_ros.parameters.config_files import config_file

    folder = tmp_path_factory.mktemp("bag") / "run"
    start = {
        "start.position": experiment.STARTS[1].position.tolist(),
        "start.orientation": experiment.ORIENTATION.tolist(),
    }
    run = run_lockstep("recorded", config_file("paper_p4l.yaml"), start, {}, 0.0, FRAMES, record=folder)
    return folder, run


def recorded(folder):
    with AnyReader([folder]) as reader:
        return [
            (connection.topic, bytes(data), reader.deserialize(data, connection.msgtype))
            for connection, _, data in reader.messages()
        ]


def stamp(message):
    return (message.header.stamp.sec, message.header.stamp.nanosec)


def test_the_nodes_give_the_answers_of_the_run_again(bag, paper):
    folder, run = bag
    messages = recorded(folder)
    told = {stamp(message): message for topic, _, message in messages if topic == "/cmd_twist"}
    assert len(run.time) == FRAMES and len(told) >= FRAMES - 1
    with Harness() as ros:
        statuses = ros.collect(SingularityStatus, "singularity_status", qos.STATUS)
        twists = ros.collect(TwistStamped, "cmd_twist", qos.STATUS)
        loci = ros.collect(SingularLoci, "singular_loci", qos.LATCHED)
        ros.add(SingularityMonitorNode, paper, {"use_sim_time": True})
        ros.add(ControllerNode, paper, {"use_sim_time": True})
        clock = ros.publisher(Clock, "/clock", qos.CLOCK)
        play = {
            "/line_features": ros.publisher(LineFeatureArray, "line_features", qos.SENSOR_DATA),
            "/camera_pose": ros.publisher(PoseWithCovarianceStamped, "camera_pose", qos.SENSOR_DATA),
        }
        answered = []
        for topic, data, message in messages:
            if topic not in play:
                continue
            clock.publish(Clock(clock=time_of(message.header.stamp.sec + message.header.stamp.nanosec * 1e-9)))
            ros.spin_for(0.01)
            play[topic].publish(data)
            if topic == "/line_features" and stamp(message) not in answered:
                answered.append(stamp(message))
                for answers in (statuses, twists):
                    ros.spin_until(
                        lambda answers=answers: any(stamp(each) == answered[-1] for each in answers),
                        "the answer to a recorded message",
                    )
        now = {stamp(each): each for each in twists}
        again = {stamp(each): each for each in statuses}
    assert len(answered) >= FRAMES
    for each in set(told) & set(answered):
        then = told[each].twist
        values = [then.linear.x, then.linear.y, then.linear.z, then.angular.x, then.angular.y, then.angular.z]
        assert twist_values(now[each]) == pytest.approx(values, rel=1e-12, abs=1e-15)
    conditions = np.array([again[each].inverse_condition_number for each in answered[:FRAMES]])
    assert conditions == pytest.approx(run.inverse_condition_number, rel=1e-12)
    (before,) = (message for topic, _, message in messages if topic == "/singular_loci")
    assert [each.name for each in before.loci] == [each.name for each in loci[-1].loci]
    for then, each in zip(before.loci, loci[-1].loci, strict=True):
        assert np.array_equal(then.segments, each.segments) and np.array_equal(then.triangles, each.triangles)
