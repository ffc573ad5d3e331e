# SPDX-License-Identifier: Apache-2.0
"""What the nodes say in the terminal: one line at the start, one for each change of kind, errors as ERROR."""

import re

import pytest
from builders import SCENE, features, start_pose, twist
from geometry_msgs.msg import TwistStamped
from messages import mentions

from plsing_msgs.msg import LineFeatureArray, SimulatorState, SingularityStatus
from plsing_ros.geometry import Pose
from plsing_ros.nodes import container, qos
from plsing_ros.nodes.controller import ControllerNode
from plsing_ros.nodes.feature_simulator import FeatureSimulatorNode
from plsing_ros.nodes.singularity_monitor import SingularityMonitorNode
from plsing_ros.parameters.config_files import config_file
from plsing_ros.singularities import singular_set
from plsing_ros.testing.harness import Harness

# What each node must say of scene, law, limits and topics.
FIRST = {
    "arm_simulator": ["realtime", "/cmd_twist in, /image out"],
    "controller": [
        "law guarded, gain 0.5 1/s",
        "at most 0.2 m/s",
        "at any rad/s",
        "4 lines in world",
        "/features in, /cmd_twist out",
    ],
    "feature_simulator": ["realtime", "0.04 s", "4 lines in world", "/cmd_twist in, /line_features out"],
    "line_tracker": ["edges in world", "/image in, /line_features out"],
    "pose_estimator": ["4 lines in world", "/line_features in, /completed_line_features out"],
    "singularity_monitor": [
        "singular set of 4 lines",
        "two lines meet all",
        "/line_features in, /singularity_status out",
    ],
}
OF_IMAGES = ("arm_simulator", "line_tracker")
# Not one of the changes: what transports and loads of this machine make a node say.
NOISE = ("ROS_AUTOMATIC_DISCOVERY_RANGE", "publishers")


def lines(capfd, node):
    """Severity and text of what a node has said since the last call."""
    said = re.findall(r"\[(\w+)\] \[[\d.]+\] \[(\S+)\]: (.*)", capfd.readouterr().err)
    return [(level, text) for level, name, text in said if name == node and not any(each in text for each in NOISE)]


@pytest.fixture
def ros():
    with Harness() as harness:
        yield harness


def test_every_node_is_here():
    assert set(FIRST) == set(container.NODES)


@pytest.mark.parametrize("name", FIRST)
def test_the_first_line_says_what_it_is_going_to_do(ros, capfd, name):
    scene = config_file("camera_arm.yaml" if name in OF_IMAGES else "paper_p4l.yaml")
    given = {"law": "guarded", "gain": 0.5, "max_linear_speed": 0.2} if name == "controller" else {}
    remap = {"line_features": "features"} if name == "controller" else {}
    ros.add(container.NODES[name], scene, given, remap)
    (first, *_) = lines(capfd, name)
    assert first[0] == "INFO" and all(each in first[1] for each in FIRST[name]), first


class Source:
    """Sends the features of a pose, and waits for the answer to each."""

    def __init__(self, ros, kind, topic):
        self.ros = ros
        self.answers = ros.collect(kind, topic, qos.STATUS)
        self.sent = ros.publisher(LineFeatureArray, "line_features")

    def send(self, pose, count, spoil=lambda message: None):
        for _ in range(count):
            message = features(pose, self.ros.node.get_clock().now().to_msg())
            spoil(message)
            self.sent.publish(message)
            stamp = message.header.stamp
            self.ros.spin_until(
                lambda stamp=stamp: any(each.header.stamp == stamp for each in self.answers), "an answer"
            )


def not_a_number(message):
    message.image_lines[0] = float("nan")


def test_the_controller_says_each_change_of_mode_once_and_a_halt_as_an_error(ros, paper, capfd):
    ros.add(ControllerNode, paper, {"features_timeout": 20.0})
    source = Source(ros, TwistStamped, "cmd_twist")
    source.send(start_pose(1), 5)
    lines(capfd, "controller")
    source.send(start_pose(1), 5, not_a_number)
    ((level, text),) = lines(capfd, "controller")
    assert level == "ERROR" and text.startswith("HALTED  ") and "nan" in text
    source.send(start_pose(1), 5)
    assert [level for level, _ in lines(capfd, "controller")] == ["INFO"]


def test_features_that_are_refused_from_the_start_are_one_error(ros, paper, capfd):
    ros.add(ControllerNode, paper)
    source = Source(ros, TwistStamped, "cmd_twist")
    lines(capfd, "controller")
    for _ in range(8):
        # The watchdog speaks in between.
        source.send(start_pose(1), 1, not_a_number)
        ros.spin_for(0.12)
    ((level, text),) = lines(capfd, "controller")
    assert level == "ERROR" and text.startswith("HALTED  ")


def test_a_twist_that_is_refused_again_and_again_is_one_warning(ros, paper, capfd):
    states = ros.collect(SimulatorState, "feature_simulator/state", qos.STATUS)
    ros.add(FeatureSimulatorNode, paper)
    commands = ros.publisher(TwistStamped, "cmd_twist")
    ros.spin_until(lambda: states, "the simulator")
    lines(capfd, "feature_simulator")
    for frame in ("tool0", "camera_optical_frame", "tool0"):
        for _ in range(3):
            commands.publish(twist([0.0] * 6, ros.node.get_clock().now().to_msg(), frame))
            ros.spin_for(0.5)
    said = [text for level, text in lines(capfd, "feature_simulator") if level == "WARN" and "refused" in text]
    assert len(said) == 2 and all(mentions(each, "'tool0'") for each in said)


def test_the_monitor_says_each_change_of_level_once_and_a_critical_one_as_an_error(ros, paper, capfd):
    ros.add(SingularityMonitorNode, paper, {"features_timeout": 20.0})
    source = Source(ros, SingularityStatus, "singularity_status")
    source.send(start_pose(1), 5)
    assert [level for level, _ in lines(capfd, "singularity_monitor")][-1] == "INFO"
    # On a line that meets all four, the interaction matrix loses rank.
    locus = singular_set(SCENE).loci[0]
    source.send(Pose(start_pose(1).rotation, locus.closest_point(start_pose(1).translation) + 1e-4), 5)
    ((level, text),) = lines(capfd, "singularity_monitor")
    assert level == "ERROR" and text.startswith("CRITICAL: ") and "transversal 1" in text


def test_the_simulator_says_when_the_camera_moves_and_when_it_stands(ros, paper, capfd):
    states = ros.collect(SimulatorState, "feature_simulator/state", qos.STATUS)
    ros.add(FeatureSimulatorNode, paper)
    ros.spin_until(lambda: states and states[-1].waiting, "a camera that waits")
    ((level, text),) = lines(capfd, "feature_simulator")[1:]
    assert level == "WARN" and mentions(text, "camera", "no twist")
    commands = ros.publisher(TwistStamped, "cmd_twist")
    commands.publish(twist([0.1, 0, 0, 0, 0, 0], ros.node.get_clock().now().to_msg()))
    ros.spin_until(lambda: not states[-1].waiting, "a camera that moves")
    ((level, text),) = lines(capfd, "feature_simulator")
    assert level == "INFO" and mentions(text, "camera")
    ros.spin_until(lambda: states[-1].waiting, "a camera that stands again")
    ((level, text),) = lines(capfd, "feature_simulator")
    assert level == "WARN" and mentions(text, "0.2 s")
