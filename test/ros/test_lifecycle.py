# SPDX-License-Identifier: Apache-2.0
"""Managed nodes over the lifecycle services: what they do in each state, and that no request or fault ends them."""

import numpy as np
import pytest
from builders import features, start_pose, twist_values
from controller_loop import ControllerLoop
from geometry_msgs.msg import TwistStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from monitor_loop import MonitorLoop
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, Trigger

from plsing_msgs.msg import ControllerState, LineFeatureArray, PoseEstimate, SimulatorState, SingularityStatus
from plsing_msgs.srv import CheckPose
from plsing_ros.control.servo_controller import ServoController
from plsing_ros.errors import StartError
from plsing_ros.nodes import qos
from plsing_ros.nodes.controller import ControllerNode
from plsing_ros.nodes.feature_simulator import FeatureSimulatorNode
from plsing_ros.nodes.pose_estimator import PoseEstimatorNode
from plsing_ros.nodes.singularity_monitor import SingularityMonitorNode
from plsing_ros.simulation.simulation import Simulation

NODES = [FeatureSimulatorNode, ControllerNode, PoseEstimatorNode, SingularityMonitorNode]
# What leads into a state, as labels of transitions.
PATHS = {
    "unconfigured": [],
    "inactive": ["configure"],
    "active": ["configure", "activate"],
    "finalized": ["configure", "activate", "shutdown"],
}
POSSIBLE = {
    "unconfigured": {Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_UNCONFIGURED_SHUTDOWN},
    "inactive": {
        Transition.TRANSITION_CLEANUP,
        Transition.TRANSITION_ACTIVATE,
        Transition.TRANSITION_INACTIVE_SHUTDOWN,
    },
    "active": {Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVE_SHUTDOWN},
    "finalized": set(),
}
IN_A_LINE = {"target.position": [3.0, 0.0, 0.0]}
THREE = {
    "lines.points": [0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 3.0, 5.0, 0.0],
    "lines.directions": [1.0, 0.0, 0.0, 4.0, -5.0, 0.0, 3.0, 7.0, 3.0],
    "lines.ids": [1, 2, 3],
}


def change(ros, name, transition):
    """Ask for a transition by its label or id; return whether it succeeded."""
    request = ChangeState.Request()
    if isinstance(transition, str):
        request.transition.label = transition
    else:
        request.transition.id = transition
    return ros.call(ChangeState, f"{name}/change_state", request).success


def state_of(ros, name):
    return ros.call(GetState, f"{name}/get_state", GetState.Request()).current_state.label


@pytest.mark.parametrize("state", PATHS)
@pytest.mark.parametrize("node", NODES)
def test_transitions_that_a_state_does_not_have_are_refused_in_every_state(ros, paper, node, state):
    name = ros.add(node, paper, {"autostart": False}).get_name()
    for transition in PATHS[state]:
        assert change(ros, name, transition)
    assert state_of(ros, name) == state
    for impossible in {*range(10), 97, 255} - POSSIBLE[state]:
        assert not change(ros, name, impossible), impossible
    for label in ("nonsense", "transition_success", "create", {"active": "cleanup"}.get(state, "deactivate")):
        assert not change(ros, name, label), label
    assert state_of(ros, name) == state


def test_a_moving_robot_moves_on_past_impossible_requests_and_gets_its_zero_twist_at_deactivation(ros, paper):
    loop = ControllerLoop(ros, paper)
    loop.answer(features(start_pose(1), loop.now()))
    for impossible in (Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_CLEANUP, 200, "configure"):
        assert not change(ros, "controller", impossible)
        command, state = loop.answer(features(start_pose(1), loop.now()))
        assert state.mode == ControllerState.MODE_SERVOING and np.any(twist_values(command) != 0.0)
    assert change(ros, "controller", "deactivate")
    ros.spin_until(lambda: np.all(twist_values(loop.twists[-1]) == 0.0), "the zero twist")
    ros.spin_until(lambda: "deactivated" in loop.states[-1].reason, "the reason")
    assert loop.states[-1].mode == ControllerState.MODE_HALTED


@pytest.mark.parametrize("last", ["deactivate", "shutdown"])
def test_an_inactive_controller_computes_and_commands_nothing(ros, paper, monkeypatch, last):
    loop = ControllerLoop(ros, paper, autostart=False)
    assert change(ros, "controller", "configure")
    calls = []
    for name in ("answer", "silence", "set_target", "check_target"):
        original = getattr(ServoController, name)
        monkeypatch.setattr(
            ServoController, name, lambda self, *a, o=original, n=name: (calls.append(n), o(self, *a))[1]
        )

    def send_in_vain():
        before = len(calls), len(loop.twists), len(loop.states)
        for _ in range(3):
            loop.features.publish(features(start_pose(1), loop.now()))
            ros.spin_for(0.1)
        assert (len(calls), len(loop.twists), len(loop.states)) == before

    send_in_vain()
    answer = ros.call(SetBool, "controller/enable", SetBool.Request(data=True))
    assert not answer.success and "inactive" in answer.message
    assert change(ros, "controller", "activate")
    _, state = loop.answer(features(start_pose(1), loop.now()))
    assert state.mode == ControllerState.MODE_SERVOING and "answer" in calls
    assert change(ros, "controller", last)
    ros.spin_until(lambda: np.all(twist_values(loop.twists[-1]) == 0.0), "the zero twist")
    ros.spin_for(0.1)
    send_in_vain()


def test_an_inactive_monitor_says_so_and_falls_silent(ros, paper):
    loop = MonitorLoop(ros, paper)
    assert loop.status_at(start_pose(1)).level == SingularityStatus.LEVEL_OK
    assert change(ros, "singularity_monitor", "deactivate")
    ros.spin_until(lambda: "deactivated" in loop.statuses[-1].reason, "the last status")
    assert loop.statuses[-1].level == SingularityStatus.LEVEL_UNOBSERVABLE
    ros.spin_until(lambda: loop.alerts[-1].level == SingularityStatus.LEVEL_UNOBSERVABLE, "the alert of it")
    count = len(loop.statuses)
    loop.features.publish(features(start_pose(1), loop.now()))
    ros.spin_for(0.3)
    assert len(loop.statuses) == count
    assert "inactive" in ros.call(CheckPose, "singularity_monitor/check_pose", CheckPose.Request()).message
    assert change(ros, "singularity_monitor", "activate")
    assert loop.status_at(start_pose(1)).level == SingularityStatus.LEVEL_OK


def test_an_inactive_simulator_stands_still(ros, paper):
    ros.add(FeatureSimulatorNode, paper, {"autostart": False})
    seen = ros.collect(LineFeatureArray, "line_features")
    assert change(ros, "feature_simulator", "configure")
    ros.spin_for(0.3)
    assert not seen
    assert "inactive" in ros.call(Trigger, "feature_simulator/reset", Trigger.Request()).message
    assert change(ros, "feature_simulator", "activate")
    ros.spin_until(lambda: seen, "features")


def test_a_latched_target_that_came_while_inactive_is_used_and_so_is_one_from_before_a_cleanup(ros, paper):
    desired = ros.node.create_publisher(LineFeatureArray, "desired_line_features", qos.LATCHED)
    desired.publish(features(start_pose(3), 1.0))
    loop = ControllerLoop(ros, paper, autostart=False, **{"target.source": "topic"})
    assert change(ros, "controller", "configure")
    ros.spin_for(0.3)
    assert change(ros, "controller", "activate")
    _, state = loop.answer(features(start_pose(3), loop.now()))
    assert state.mode == ControllerState.MODE_CONVERGED
    for transition in ("deactivate", "cleanup", "configure", "activate"):
        assert change(ros, "controller", transition)
    _, state = loop.answer(features(start_pose(3), loop.now()))
    assert state.mode == ControllerState.MODE_CONVERGED


def test_what_an_operator_has_switched_off_stays_off_whatever_the_transitions(ros, paper):
    loop = ControllerLoop(ros, paper)
    assert ros.call(SetBool, "controller/enable", SetBool.Request(data=False)).success
    for transition in ("deactivate", "cleanup", "configure", "activate"):
        assert change(ros, "controller", transition)
    command, state = loop.answer(features(start_pose(1), loop.now()))
    assert state.mode == ControllerState.MODE_DISABLED and np.all(twist_values(command) == 0.0)


def test_a_failed_configuration_leaves_the_node_unconfigured_until_its_parameters_are_mended(ros, paper, capfd):
    node = ros.add(ControllerNode, paper, {"autostart": False, **THREE, **IN_A_LINE})
    assert not change(ros, "controller", "configure")
    assert state_of(ros, "controller") == "unconfigured"
    said = [line for line in capfd.readouterr().err.splitlines() if "configure failed" in line]
    assert len(said) == 1 and "2 usable" in said[0] and "ERROR" in said[0]
    mended = ros.call(
        SetParameters,
        "controller/set_parameters",
        SetParameters.Request(parameters=[ParameterMessage(name="target.position", value=double_array(5.0, 2.0, 3.0))]),
    )
    assert mended.results[0].successful
    assert change(ros, "controller", "configure") and change(ros, "controller", "activate")
    assert node.active


def double_array(*values):
    return ParameterValue(type=ParameterType.PARAMETER_DOUBLE_ARRAY, double_array_value=values)


def test_under_autostart_a_failed_configuration_is_an_error_of_the_constructor(ros, paper):
    with pytest.raises(StartError, match="2 usable"):
        ros.add(ControllerNode, paper, {**THREE, **IN_A_LINE})


@pytest.mark.parametrize("transition", ["configure", "activate", "deactivate", "cleanup"])
def test_a_fault_in_a_transition_takes_the_node_down_to_unconfigured_and_not_out(ros, paper, monkeypatch, transition):
    loop = ControllerLoop(ros, paper, autostart=False)

    def broken(*_):
        raise ZeroDivisionError("broken on purpose")

    path = ["configure", "activate", "deactivate", "cleanup"]
    for each in path[: path.index(transition)]:
        assert change(ros, "controller", each)
    with monkeypatch.context() as patch:
        patch.setattr(loop.node, transition, broken)
        assert not change(ros, "controller", transition)
    assert state_of(ros, "controller") == "unconfigured" and not loop.node.active
    assert change(ros, "controller", "configure") and change(ros, "controller", "activate")
    assert loop.answer(features(start_pose(1), loop.now()))[1].mode == ControllerState.MODE_SERVOING


@pytest.mark.parametrize(
    ("node", "core", "method", "topic", "message_type"),
    [
        (ControllerNode, "_servo", "answer", "controller/state", ControllerState),
        (SingularityMonitorNode, "_monitor", "answer", "singularity_status", SingularityStatus),
        (PoseEstimatorNode, "_tracking", "track", "pose_estimator/state", PoseEstimate),
    ],
)
def test_a_fault_of_our_own_is_reported_and_the_next_good_message_goes_on(
    ros, paper, monkeypatch, node, core, method, topic, message_type
):
    states = ros.collect(message_type, topic, qos.STATUS)
    twists = ros.collect(TwistStamped, "cmd_twist", qos.STATUS)
    created = ros.add(node, paper, {"features_timeout": 5.0})
    publisher = ros.publisher(LineFeatureArray, "line_features")

    def answer():
        message = features(start_pose(1), ros.node.get_clock().now().to_msg())
        publisher.publish(message)
        return message.header.stamp

    def broken(*_):
        raise ZeroDivisionError("broken on purpose")

    with monkeypatch.context() as patch:
        patch.setattr(getattr(created, core), method, broken)
        answer()
        ros.spin_until(lambda: states and "broken on purpose" in states[-1].reason, "the report of the fault")
        if node is ControllerNode:
            ros.spin_until(lambda: twists and np.all(twist_values(twists[-1]) == 0.0), "the zero twist")
    stamp = answer()
    ros.spin_until(lambda: states[-1].header.stamp == stamp, "the answer to a good message")
    assert "broken" not in states[-1].reason


def test_a_fault_in_the_simulator_is_reported_and_the_next_twist_moves_it(ros, paper, monkeypatch):
    states = ros.collect(SimulatorState, "feature_simulator/state", qos.STATUS)
    ros.add(FeatureSimulatorNode, paper)
    twists = ros.publisher(TwistStamped, "cmd_twist")

    def twist():
        message = TwistStamped()
        message.header.frame_id = "camera_optical_frame"
        message.header.stamp = ros.node.get_clock().now().to_msg()
        message.twist.linear.x = 0.01
        return message

    def broken(*_):
        raise ZeroDivisionError("broken on purpose")

    with monkeypatch.context() as patch:
        patch.setattr(Simulation, "receive_twist", broken)
        twists.publish(twist())
        ros.spin_until(lambda: any("broken on purpose" in each.reason for each in states), "the report of the fault")

    def moving():
        twists.publish(twist())
        ros.spin_for(0.05)
        return states[-1].twist.linear.x == 0.01

    ros.spin_until(moving, "the camera to move")


def test_requests_and_messages_at_which_rclpy_raises_do_not_end_the_node(ros, paper):
    loop = ControllerLoop(ros, paper, use_sim_time=True)
    of_no_type = ParameterMessage(name="gain")
    of_no_type.value.type = 99
    ros.call(SetParameters, "controller/set_parameters", SetParameters.Request(parameters=[of_no_type]))
    clock = ros.publisher(Clock, "/clock", qos.STATUS)
    for seconds in (-5, 2**31 - 1, 7):
        message = Clock()
        message.clock.sec = seconds
        clock.publish(message)
        ros.spin_for(0.1)
    ros.spin_until(lambda: loop.node.now() == 7_000_000_000, "the clock's last time")
    assert state_of(ros, "controller") == "active"
