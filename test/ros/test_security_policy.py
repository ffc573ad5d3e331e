# SPDX-License-Identifier: Apache-2.0
"""The SROS2 policy against what the running nodes really offer and use: no more is allowed, and no less."""

import xml.etree.ElementTree as ElementTree

import pytest

from plsing_ros.nodes import container
from plsing_ros.nodes.arm_simulator import ArmSimulatorNode
from plsing_ros.nodes.controller import ControllerNode
from plsing_ros.nodes.feature_simulator import FeatureSimulatorNode
from plsing_ros.nodes.line_tracker import LineTrackerNode
from plsing_ros.nodes.pose_estimator import PoseEstimatorNode
from plsing_ros.nodes.singularity_monitor import SingularityMonitorNode
from plsing_ros.parameters.config_files import config_file
from plsing_ros.testing.harness import Harness

# With what makes every topic of a node appear, one set of parameters after the other.
NODES = {
    "arm_simulator": (
        ArmSimulatorNode,
        [{"mode": "lockstep", "publish_clock": True, "wait_for_status": True, "publish_tf": True}],
    ),
    "controller": (
        ControllerNode,
        [{"gate": "status"}, {"target.source": "topic", "tool_frame": "tool0", "T_tool_camera.source": "tf"}],
    ),
    "singularity_monitor": (SingularityMonitorNode, [{}]),
    "line_tracker": (LineTrackerNode, [{}]),
    "pose_estimator": (PoseEstimatorNode, [{"publish_tf": True}]),
    "feature_simulator": (
        FeatureSimulatorNode,
        [{}, {"mode": "lockstep", "publish_clock": True, "wait_for_status": True, "publish_tf": True}],
    ),
}
OF_IMAGES = (ArmSimulatorNode, LineTrackerNode)
KINDS = [("topic", "publish"), ("topic", "subscribe"), ("service", "reply"), ("service", "request")]


def allowed(node):
    """What the policy file allows a node, by kind, with full names."""
    root = ElementTree.parse(config_file("security/plsing_ros.policy.xml")).getroot()
    (profile,) = root.findall(f"enclaves/enclave[@path='/plsing_ros/{node}']/profiles/profile")
    assert (profile.get("ns"), profile.get("node")) == ("/", node)
    names = {kind: set() for kind in KINDS}
    for group in profile:
        for kind in KINDS:
            if group.get(kind[1]) == "ALLOW":
                names[kind] |= {each.text.replace("~", f"/{node}") for each in group.findall(kind[0])}
    return {kind: {each if each.startswith("/") else f"/{each}" for each in found} for kind, found in names.items()}


def used(node):
    create, configurations = NODES[node]
    names = {kind: set() for kind in KINDS}
    for parameters in configurations:
        with Harness() as ros:
            scene = config_file("camera_arm.yaml" if create in OF_IMAGES else "paper_p4l.yaml")
            created = ros.add(create, scene, {"use_sim_time": True, **parameters})
            ros.spin_until(lambda created=created: created.active, "an active node")
            ask = ros.node
            of_kind = dict(
                zip(
                    KINDS,
                    (
                        ask.get_publisher_names_and_types_by_node,
                        ask.get_subscriber_names_and_types_by_node,
                        ask.get_service_names_and_types_by_node,
                        ask.get_client_names_and_types_by_node,
                    ),
                    strict=True,
                )
            )
            own = {
                KINDS[0]: {each.topic_name for each in created.publishers},
                KINDS[1]: {each.topic_name for each in created.subscriptions},
                KINDS[2]: {each.service_name for each in created.services},
            }

            def found(kind, of_kind=of_kind):
                return {each for each, _ in of_kind[kind](node, "/")} if node in ask.get_node_names() else set()

            ros.spin_until(lambda own=own, found=found: all(own[kind] <= found(kind) for kind in own), "its endpoints")
            # And those that rcl makes without telling rclpy.
            ros.spin_for(1.0)
            for kind in KINDS:
                names[kind] |= found(kind)
    return names


def test_every_node_has_a_policy():
    assert set(NODES) == set(container.NODES)


@pytest.mark.usefixtures("tf2_ros")
@pytest.mark.parametrize("node", NODES)
def test_it_allows_what_the_node_offers_and_uses_and_nothing_else(node):
    assert allowed(node) == used(node)
