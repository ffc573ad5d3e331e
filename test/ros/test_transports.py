# SPDX-License-Identifier: Apache-2.0
"""A process that moves a robot keeps out of shared memory, unless its user has decided otherwise."""

import pytest
from messages import mentions

from plsing_ros.nodes.container import NODES
from plsing_ros.nodes.transports import RANGE, TRANSPORTS, avoid_shared_memory

CONTROLLER, OTHER = NODES["controller"], NODES["feature_simulator"]


class TakesImages:
    takes_images = True


@pytest.mark.parametrize("nodes", [[CONTROLLER], [OTHER, CONTROLLER]])
def test_nothing_set_by_the_user_is_set_to_udp(nodes):
    environment = {}
    assert avoid_shared_memory(nodes, environment) == ""
    assert environment == {TRANSPORTS: "UDPv4", RANGE: "SUBNET"}


@pytest.mark.parametrize(
    "environment", [{}, {TRANSPORTS: "SHM"}, {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}, {RANGE: "LOCALHOST"}]
)
def test_processes_that_move_nothing_or_use_another_middleware_are_left_alone(environment):
    before = dict(environment)
    nodes = [CONTROLLER] if "RMW_IMPLEMENTATION" in environment else [OTHER]
    assert avoid_shared_memory(nodes, environment) == ""
    assert environment == before


@pytest.mark.parametrize(
    ("environment", "words"),
    [
        ({TRANSPORTS: "DEFAULT"}, f"{TRANSPORTS} is DEFAULT"),
        ({RANGE: "LOCALHOST"}, f"{RANGE} is LOCALHOST"),
        ({RANGE: "localhost", TRANSPORTS: "UDPv4"}, f"{RANGE} is localhost"),
        ({"ROS_LOCALHOST_ONLY": "1"}, "ROS_LOCALHOST_ONLY is 1"),
        ({"FASTDDS_DEFAULT_PROFILES_FILE": "a.xml"}, "FASTDDS_DEFAULT_PROFILES_FILE is a.xml"),
    ],
)
def test_settings_that_leave_the_risk_are_kept_and_named(environment, words):
    before = dict(environment)
    warning = avoid_shared_memory([CONTROLLER], environment)
    assert words in warning and f"{TRANSPORTS}=UDPv4" in warning and f"{RANGE}=SUBNET" in warning
    assert environment == before


def test_images_in_the_same_process_keep_shared_memory():
    environment = {}
    assert mentions(avoid_shared_memory([CONTROLLER, TakesImages], environment), "images", "controller")
    assert environment == {}
    assert avoid_shared_memory([CONTROLLER], {TRANSPORTS: "UDPv4"}) == ""
